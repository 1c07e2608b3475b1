"""T1 to T17 of the catalogue of faults: what a user sees when the demonstrations are not as they should be."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.errors import ChannelError, ComanipWarning, InternalError, ParameterError, TrainingError
from comanip.fitting.climb import climb
from comanip.fitting.gmm import fit_gmm
from comanip.fitting.hmm import fit_hmm
from comanip.models.filtering import ForwardFilter
from comanip.models.gmm import Gmm
from comanip.models.gmr import Regression, regress
from comanip.models.hmm import Hmm, log_likelihood
from toys import CHANNELS, lifts, random_gmm


def with_channel(data, channel, value):
    out = [x.copy() for x in data]
    for x in out:
        x[:, channel] = value
    return out


def quiet_fit(data, n_states, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ComanipWarning)
        return fit_hmm(data, n_states, channels=CHANNELS, **options)


def test_a_clean_lesson_trains_without_a_word():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit = fit_hmm(lifts(), 5, channels=CHANNELS)
    assert fit.notes == ()
    assert fit.converged
    assert fit.model.n_states == 5


@pytest.mark.parametrize("value", [0.0, 4.2, -1e6])
@pytest.mark.parametrize("learn", [fit_hmm, fit_gmm])
def test_t1_a_constant_channel_is_an_error_that_names_channel_and_value(learn, value):
    with pytest.raises(TrainingError, match=rf"force\.z is constant {value:.3f} in all demonstrations \(5 of them\)"):
        learn(with_channel(lifts(), 1, value), 3, channels=CHANNELS)


@pytest.mark.parametrize("stated", [0.5, {"force.z": 0.5}, {"force": 0.5}])
def test_t1_a_stated_floor_lets_a_constant_channel_train_with_exactly_that_floor(stated):
    data = with_channel(lifts(), 1, 4.2)
    with pytest.warns(ComanipWarning, match=r"force\.z is constant 4\.200; trained with the stated"):
        fit = fit_hmm(data, 3, channels=CHANNELS, allow_constant=stated)
    assert len(fit.notes) == 1
    np.testing.assert_allclose(fit.model.covariances[:, 1, 1], 0.25)
    np.testing.assert_allclose(fit.model.means[:, 1], 4.2)
    with pytest.raises(ParameterError, match="standard deviation above 0"):
        fit_hmm(data, 3, channels=CHANNELS, allow_constant=0.0)


def test_t2_a_channel_that_repeats_another_trains_and_says_the_condition_number():
    data = [np.column_stack([x[:, 0], x[:, 1], x[:, 0]]) for x in lifts()]
    with pytest.warns(ComanipWarning, match=r"condition number .* closest position\.z and velocity\.z"):
        fit = fit_hmm(data, 5, channels=CHANNELS)
    assert np.isfinite(fit.model.covariances).all()
    assert any("condition number" in note for note in fit.notes)


def test_t5_a_demonstration_too_short_is_skipped_with_its_number_and_rows_still_sum_to_one():
    long, other = lifts(2)
    for short in (1, 2, 3):
        with pytest.warns(ComanipWarning, match=rf"skipped demonstrations .*: 1 \({short} frames\)"):
            fit = fit_hmm([long, long[:short], other], 5, channels=CHANNELS)
        np.testing.assert_allclose(fit.model.transition.sum(axis=1), 1.0)
        assert fit.n_frames == len(long) + len(other)


def test_t6_demonstrations_all_too_short_say_how_many_frames_are_needed():
    with pytest.raises(TrainingError, match="5 states need >= 6 frames in a demonstration; you gave 3 at most"):
        fit_hmm([x[:3] for x in lifts()], 5, channels=CHANNELS)
    with pytest.raises(TrainingError, match="no demonstration was given"):
        fit_hmm([], 5, channels=CHANNELS)


def test_t7_identical_demonstrations_say_that_confidence_is_meaningless():
    one = lifts(1)[0]
    with pytest.warns(ComanipWarning, match="no variability, so confidence is meaningless"):
        fit_hmm([one, one.copy(), one.copy()], 4, channels=CHANNELS)
    with pytest.warns(ComanipWarning, match=r"identical \(0 = 2\)"):
        fit_hmm([one, lifts(1, seed=9)[0], one], 4, channels=CHANNELS)


def test_t8_one_demonstration_trains_with_a_warning():
    with pytest.warns(ComanipWarning, match="only one demonstration"):
        fit = fit_hmm(lifts(1), 5, channels=CHANNELS)
    assert any("only one demonstration" in note for note in fit.notes)


def test_t9_too_many_states_for_a_short_demonstration_still_give_rows_that_sum_to_one():
    fit = quiet_fit([lifts(1)[0][::6]], 20)
    np.testing.assert_allclose(fit.model.transition.sum(axis=1), 1.0)
    np.testing.assert_allclose(fit.model.initial.sum(), 1.0)
    assert np.isfinite(fit.model.means).all()


def test_t9_a_state_that_no_frame_visits_is_removed_and_reported():
    data = lifts(2)
    model = quiet_fit(data, 3).model
    far = Hmm(
        np.append(model.initial, 0.0),
        np.block([[model.transition[:2, :2], model.transition[:2, 2:], np.zeros((2, 1))],
                  [np.zeros((1, 2)), np.array([[0.9, 0.1]])],
                  [np.zeros((1, 3)), np.ones((1, 1))]]),
        np.vstack([model.means, [1e4, 1e4, 1e4]]),
        np.concatenate([model.covariances, model.covariances[-1:]]),
        CHANNELS,
    )  # fmt: skip
    with pytest.warns(ComanipWarning, match=r"removed states \[3\] of 4"):
        fit = fit_hmm(data, 4, channels=CHANNELS, initial_guess=far)
    assert fit.model.n_states == 3
    np.testing.assert_allclose(fit.model.transition.sum(axis=1), 1.0)
    assert fit.log_likelihood[-1] == pytest.approx(log_likelihood(fit.model, data).sum())


@pytest.mark.parametrize("learn", [fit_hmm, fit_gmm])
def test_t10_a_minute_of_exact_rest_does_not_collapse_a_state(learn):
    data = [np.concatenate([np.zeros((1200, 3)), x]) for x in lifts(5)]  # 5 times 12 s
    floor = 1e-4
    fit = learn(data, 5, channels=CHANNELS, covariance_floor=floor)
    spread = np.concatenate(data).std(axis=0)
    least = np.linalg.eigvalsh(fit.model.covariances / np.outer(spread, spread)).min()
    assert least >= floor * (1.0 - 1e-6)


def test_t11_data_in_steps_of_a_newton_and_a_centimetre_train():
    data = [np.column_stack([np.round(x[:, 0], 2), np.round(x[:, 1]), x[:, 2]]) for x in lifts()]
    fit = fit_hmm(data, 5, channels=CHANNELS)
    spread = np.concatenate(data).std(axis=0)
    assert np.linalg.eigvalsh(fit.model.covariances / np.outer(spread, spread)).min() >= 1e-4 * (1.0 - 1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200, 1e5, -1e5])
@pytest.mark.parametrize("learn", [fit_hmm, fit_gmm])
def test_t12_a_value_no_sensor_gives_names_demonstration_frame_channel_and_value(learn, value):
    data = lifts()
    data[3][117, 1] = value
    with pytest.raises(TrainingError, match=r"demonstration 3, frame 117: force\.z is") as error:
        learn(data, 5, channels=CHANNELS)
    assert f"{value:g}" in str(error.value)


def test_t12_an_outlier_is_accepted_when_asked_and_harms_no_sum():
    data = lifts()
    data[3][117, 1] = 1e5
    fit = fit_hmm(data, 5, channels=CHANNELS, outlier_ratio=np.inf)
    assert np.isfinite(fit.log_likelihood).all()
    model = quiet_fit(lifts(), 5).model
    assert np.isfinite(log_likelihood(model, data)).all()


def test_t13_a_likelihood_that_falls_is_an_internal_error():
    values = iter([-100.0, -101.0])
    with pytest.raises(InternalError, match="iteration 1"):
        climb(None, lambda p: (next(values), None), lambda s, p: p, max_iterations=3, rise=0.0)


def test_t14_a_fit_that_ran_out_of_iterations_says_so():
    with pytest.warns(ComanipWarning, match="not converged after 1 iterations"):
        fit = fit_hmm(lifts(), 5, channels=CHANNELS, max_iterations=1)
    assert not fit.converged
    assert fit.n_iterations == 1


@pytest.mark.parametrize("topology", ["left-right", "cyclic", "free"])
def test_t15_states_come_in_order_of_time_and_a_seed_gives_the_same_bytes(topology):
    data = lifts(3, n_frames=100)
    for seed in range(20 if topology == "free" else 3):
        models = [
            quiet_fit(data, 4, topology=topology, initial_guess="kmeans", rng=np.random.default_rng(seed)).model for _ in range(2)
        ]
        for name in ("initial", "transition", "means", "covariances"):
            assert getattr(models[0], name).tobytes() == getattr(models[1], name).tobytes()
        forward = ForwardFilter(models[0])
        weights = np.array([forward.step(xi).copy() for xi in data[0]])
        time = np.arange(len(weights)) @ weights / np.maximum(weights.sum(axis=0), 1e-9)
        visited = weights.sum(axis=0) > 1.0
        assert (np.diff(time[visited]) > 0.0).all()


def test_t16_a_left_right_model_runs_a_second_time():
    data = lifts()
    forward = ForwardFilter(quiet_fit(data, 5).model)
    first = [forward.step(xi).copy() for xi in data[0]]
    second = [forward.step(xi).copy() for xi in data[0]]
    assert np.argmax(first[-1]) == 4
    assert np.argmax(second[10]) == 0
    np.testing.assert_allclose(first[50:], second[50:], atol=1e-3)


MODEL = quiet_fit(lifts(), 5).model
anything = st.floats(-1e9, 1e9)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(anything, anything)
def test_t17_inputs_far_outside_give_finite_answers(x, force):
    found = regress(MODEL, ("position", "force"), "velocity", [[x, force]])
    assert np.isfinite(found.mean).all()
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize("tilt", [0.0, 1e-16, 1e-14, 1e-9])
def test_t17_a_singular_input_block_gives_finite_gains(tilt):
    covariance = np.array([[1.0, 1.0 - tilt, 0.5], [1.0 - tilt, 1.0, 0.5], [0.5, 0.5, 1.0]])
    covariance += 1e-13 * np.eye(3)
    model = Gmm([1.0], np.zeros((1, 3)), covariance[None], ("a", "b", "y"))
    regression = Regression(model, ("a", "b"), "y")
    assert np.isfinite(regression.gains).all()
    # the two inputs say the same, so half of the line is through each
    np.testing.assert_allclose(regression.predict(np.ones(1), np.ones(2)).mean, [0.5], rtol=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"topology": "ring"}, "'left-right', 'cyclic' or 'free'; got 'ring'"),
        ({"initial_guess": "random"}, "'time', 'kmeans' or a model; got 'random'"),
        ({"initial_guess": "kmeans"}, "pass rng=numpy.random.default_rng"),
        ({"restarts": 3}, "pass rng=numpy.random.default_rng"),
        ({"restarts": 0}, "restarts must be at least 1"),
        ({"covariance_floor": 0.0}, "between 0 and 1; got 0.0"),
        ({"transition_floor": 0.5}, "below 1 / n_states; got 0.5"),
        ({"max_iterations": -1}, "must not be negative; got -1"),
    ],
)
def test_a_wrong_parameter_says_what_is_allowed_and_what_was_given(options, message):
    with pytest.raises(ParameterError, match=message):
        fit_hmm(lifts(2), 4, channels=CHANNELS, **options)


def test_a_wrong_shape_says_which_channels_want_what():
    with pytest.raises(ChannelError, match=r"demonstration 0 has shape \(3, \d+\).* want \(T, 3\)"):
        fit_hmm([x.T for x in lifts()], 3, channels=CHANNELS)
    with pytest.raises(ChannelError, match="put a single demonstration into a list"):
        fit_hmm(lifts(1)[0], 3, channels=CHANNELS)
    with pytest.raises(ChannelError, match="channel 'forse' is not here; there are: c0, c1, c2"):
        Regression(random_gmm(np.random.default_rng(0)), "forse", "c0")
