"""Models are values: checked, frozen, quick to import."""

import subprocess
import sys

import numpy as np
import pytest

import comanip
from comanip import Hmm, Hsmm, fit_gmm, fit_hmm, fit_hsmm, select_states
from comanip.errors import ChannelError, ParameterError
from comanip.fitting.baum_welch import most_likely_rows
from comanip.fitting.guesses import k_means
from comanip.models import gmm, hmm
from comanip.models.gmr import Regression, regress
from toys import CHANNELS, lifts, random_gmm, random_hmm

GOOD = {
    "initial": [0.5, 0.5],
    "transition": [[0.9, 0.1], [0.0, 1.0]],
    "means": [[0.0], [1.0]],
    "covariances": [[[1.0]], [[2.0]]],
    "channels": ("x",),
}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"transition": [[0.9, 0.2], [0.0, 1.0]]}, r"transition must sum to 1 .*1\.1"),
        ({"initial": [1.5, -0.5]}, "initial must be finite and not negative"),
        ({"initial": [1.0]}, r"initial must have shape \(2,\); got \(1,\)"),
        ({"covariances": [[[1.0]], [[0.0]]]}, "state 1 is not positive definite"),
        ({"means": [[np.nan], [1.0]]}, "means of state 0 are not finite"),
        ({"means": [0.0, 1.0]}, r"means must be \(K, D\)"),
        ({"channels": ("x", "x")}, "twice"),
        ({"channels": ()}, "need names"),
        ({"channels": ("x", "y")}, "2 states and 2 channels need means"),
    ],
)
def test_a_model_that_is_none_cannot_be_made(wrong, message):
    with pytest.raises(ParameterError, match=message):
        Hmm(**{**GOOD, **wrong})


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"transition": [[0.5, 0.5], [0.0, 1.0]]}, "state 0 follows itself with probability 0.5"),
        ({"durations": [[0.5, 0.5], [0.5, 0.4]]}, "durations must sum to 1"),
        ({"durations": [0.5, 0.5]}, r"durations must be \(K, L\)"),
        ({"initial": [1.0]}, r"initial must have shape \(2,\); got \(1,\)"),
    ],
)
def test_durations_that_mean_nothing_are_refused(wrong, message):
    good = GOOD | {"transition": [[0.0, 1.0], [0.0, 1.0]], "durations": [[0.5, 0.5], [0.0, 1.0]]}
    assert Hsmm(**good).longest == 2
    with pytest.raises(ParameterError, match=message):
        Hsmm(**good | wrong)


def test_options_of_durations_say_what_is_allowed():
    data = [x[::10] for x in lifts(3)]
    with pytest.raises(ParameterError, match="duration_floor is a ratio above 0 and at most 1; got 0"):
        fit_hsmm(data, 3, channels=CHANNELS, duration_floor=0.0)
    with pytest.raises(ParameterError, match="longest must be at least 1 frame; got 0"):
        fit_hsmm(data, 3, channels=CHANNELS, longest=0)
    with pytest.raises(ChannelError, match="asked for 3 of"):
        fit_hsmm(data, 3, channels=CHANNELS, initial_guess=fit_hmm(data, 2, channels=CHANNELS).model)


def test_a_model_cannot_be_changed():
    model = Hmm(**GOOD)
    with pytest.raises(AttributeError):
        model.means = np.zeros((2, 1))
    with pytest.raises(ValueError, match="read-only"):
        model.means[0] = 5.0
    fit = fit_hmm(lifts(2), 2, channels=CHANNELS)
    with pytest.raises(ValueError, match="read-only"):
        fit.log_likelihood[0] = 0.0


def test_a_model_copies_what_it_is_given():
    means = np.zeros((2, 1))
    model = Hmm(**{**GOOD, "means": means})
    means[0] = 7.0
    assert model.means[0, 0] == 0.0


def test_importing_comanip_and_its_models_loads_neither_scipy_nor_scikit_learn():
    code = (
        "import sys, comanip; assert 'numpy' not in sys.modules; "
        "from comanip import Hmm, Gmm, fit_hmm, ForwardFilter, regress, GaussianHMM, GMM; "
        "print([m for m in ('scipy', 'sklearn', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_can_be_had_and_a_wrong_one_lists_them():
    for name in comanip.__all__:
        assert getattr(comanip, name) is not None
    with pytest.raises(AttributeError, match=r"no attribute 'Hnm'; it has: .*Hmm"):
        comanip.Hnm  # noqa: B018


def test_em_of_a_mixture_never_falls():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        data = [rng.normal(size=(40, 2)).cumsum(axis=0) for _ in range(2)]
        fit = fit_gmm(data, 1 + seed % 5, channels=("a", "b"), initial_guess="kmeans", rng=rng)
        assert np.diff(fit.log_likelihood).min(initial=0.0) >= -1e-9 * np.abs(fit.log_likelihood).max()
        assert fit.log_likelihood[-1] == pytest.approx(gmm.log_likelihood(fit.model, np.concatenate(data)).sum())


def test_restarts_never_end_below_the_first_guess_and_going_on_never_falls():
    data = lifts(3)
    first = fit_hmm(data, 4, channels=CHANNELS)
    more = fit_hmm(data, 4, channels=CHANNELS, restarts=4, rng=np.random.default_rng(0))
    assert more.log_likelihood[-1] >= first.log_likelihood[-1]
    on = fit_hmm(data, 4, channels=CHANNELS, initial_guess=first.model)
    assert on.log_likelihood[0] == pytest.approx(first.log_likelihood[-1], rel=1e-9)
    assert on.log_likelihood[-1] >= first.log_likelihood[-1] - 1e-6
    with pytest.raises(ChannelError, match="asked for 3"):
        fit_hmm(data, 3, channels=CHANNELS, initial_guess=first.model)


def test_a_transition_floor_holds_where_transitions_are_allowed():
    fit = fit_hmm(lifts(3), 4, channels=CHANNELS, topology="cyclic", transition_floor=0.01)
    allowed = np.eye(4, dtype=bool) | np.roll(np.eye(4, dtype=bool), 1, axis=1)
    assert fit.model.transition[allowed].min() >= 0.01 - 1e-12
    assert (fit.model.transition[~allowed] == 0.0).all()
    rows = most_likely_rows(np.array([[97.0, 2.0, 1.0]] * 3), np.full((3, 3), 1 / 3), 0.05)
    np.testing.assert_allclose(rows[0], [0.9, 0.05, 0.05])


def test_bayes_criterion_finds_the_number_of_states_that_made_the_data():
    rng = np.random.default_rng(1)
    transition = 0.9 * np.eye(3) + 0.1 * np.eye(3, k=1)
    transition[-1, -1] = 1.0
    truth = Hmm(np.eye(3)[0], transition, [[0.0, 0.0], [4.0, 1.0], [8.0, -1.0]], np.array([np.eye(2)] * 3), ("a", "b"))
    data = [hmm.sample(truth, 50, rng).frames for _ in range(20)]
    found = select_states(data, range(2, 6), channels=("a", "b"))
    assert found.n_states == 3
    assert "3" in str(found)
    left_out = select_states(data, (2, 3), channels=("a", "b"), criterion="cross-validation", folds=4)
    assert left_out.n_states == 3
    with pytest.raises(ParameterError, match="'bic' or 'cross-validation'"):
        select_states(data, (2,), channels=("a", "b"), criterion="aic")


def test_k_means_finds_clusters_apart_and_leaves_its_input_alone():
    rng = np.random.default_rng(2)
    z = np.concatenate([rng.normal(size=(50, 2)) + 20.0 * k for k in range(3)])
    before = z.copy()
    labels = k_means(z, 3, rng)
    k_means(z, 1, rng)
    np.testing.assert_array_equal(z, before)
    assert [len(set(labels[50 * k : 50 * k + 50])) for k in range(3)] == [1, 1, 1]
    assert len(set(labels)) == 3


def test_a_tick_of_regression_equals_predict_and_writes_in_place():
    rng = np.random.default_rng(3)
    model = random_gmm(rng, 4, 5)
    regression = Regression(model, ("c3", "c0"), ("c1", "c4"))
    weights, x, out = rng.dirichlet(np.ones(4)), rng.normal(size=2), np.empty(2)
    found = regression.mean(weights, x, out)
    assert found is out
    np.testing.assert_allclose(out, regression.predict(weights, x).mean, rtol=1e-12)
    np.testing.assert_allclose(out, weights @ regression.means_per_state(x), rtol=1e-12)


def test_forward_weights_follow_the_order_of_the_rows_and_need_an_hmm():
    rng = np.random.default_rng(4)
    model = random_hmm(rng, 3, 3)
    x = rng.normal(size=(20, 2))
    forward = regress(model, ("c0", "c1"), "c2", x, weights="forward").mean
    assert not np.allclose(forward, regress(model, ("c0", "c1"), "c2", x[::-1], weights="forward").mean[::-1])
    with pytest.raises(ParameterError, match="'mixture-with-priors' for a Gmm, 'forward' for an Hmm"):
        regress(model, "c0", "c2", x[:, :1], weights="mixture-with-priors")
    with pytest.raises(ChannelError, match="c0 cannot be input and output at once"):
        Regression(model, ("c0", "c1"), ("c0",))
    with pytest.raises(ParameterError, match="must be a variance"):
        Regression(model, "c0", "c1", input_noise={"c0": -1.0})
