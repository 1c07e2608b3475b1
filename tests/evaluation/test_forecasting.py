"""Forecasts: nothing later than now is seen, the yardstick is right, and what does not help is not used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.evaluation import forecasting, heads
from comanip.evaluation.forecasting import HORIZONS_S, Forecaster, Mixture, forecaster, roll_outs
from comanip.evaluation.heads import RIDGE, Head, history
from comanip.learned.skill import learn
from comanip.models.hmm import Hmm


@pytest.fixture(scope="module")
def ours(skills, lessons):
    return forecaster(skills["follower"], lessons["follower"][:5])


def test_a_lesson_left_out_is_foreseen_far_better_than_by_constant_velocity(ours, lessons):
    found = ours.judged(lessons["follower"][5])
    assert found.horizons_s == HORIZONS_S
    assert min(found.ours) > 0.7
    assert all(a >= b - 0.02 for a, b in zip(found.ours, found.ridge, strict=True))
    assert list(found.rmse_m) == sorted(found.rmse_m)


def test_nothing_later_than_now_is_seen(ours, lessons):
    lesson = lessons["follower"][5]
    spoiled = {name: np.array(v) for name, v in lesson.signals.items()}
    for values in spoiled.values():
        values[200:] += 3.0
    seen = len(range(0, 200, 3))  # forecasts are made every third frame at 100 Hz
    other = ours.displacement(replace(lesson, signals=spoiled))[:, :seen]
    assert other == pytest.approx(ours.displacement(lesson)[:, :seen], abs=1e-12)


def test_history_reaches_back_and_holds_the_first_frame_before_the_beginning(lessons):
    lesson = lessons["follower"][0]
    past = history(lesson)
    assert past.shape == (len(lesson), 2 * 9, 1)
    assert (past[200, :9, 0] == lesson.velocity[200 - 5 * np.arange(9), 0]).all()
    assert (past[7, 9:, 0] == lesson.force[np.maximum(7 - 5 * np.arange(9), 0), 0]).all()


def test_constant_velocity_itself_has_skill_zero_and_the_truth_has_one(skills, lessons):
    lesson = lessons["follower"][5]

    def constant(metres):
        head = Head(False, np.zeros((18, 1)), np.ones((18, 1)), np.zeros((18, 1)), np.array([metres]))
        return Mixture((RIDGE,), (head,), np.ones((1, 1)))

    nothing = (constant(0.0),) * 4
    assert Forecaster(skills["follower"], nothing, nothing).judged(lesson).ours == pytest.approx((0.0,) * 4)
    even = replace(lesson, signals={**lesson.signals, "position": 0.2 * lesson.dt * np.arange(len(lesson))[:, None]})
    even = replace(even, signals={**even.signals, "velocity": np.full_like(even.position, 0.1)})
    right = tuple(constant(0.1 * h) for h in HORIZONS_S)  # the half that the velocity channel lacks
    assert Forecaster(skills["follower"], right, right).judged(even).ours == pytest.approx((1.0,) * 4)


def test_forces_without_meaning_leave_constant_velocity(lessons):
    """Velocity that is a random walk: nothing foresees it, and no head pretends to."""
    rng = np.random.default_rng(4)
    made = []
    for lesson in lessons["follower"]:
        v = 0.01 * np.cumsum(rng.normal(size=lesson.velocity.shape), axis=0)
        made.append(
            replace(lesson, signals={"position": 0.01 * np.cumsum(v, axis=0), "force": rng.normal(size=v.shape), "velocity": v})
        )
    found = forecaster(learn(made[:5], n_states=4), made[:5]).judged(made[5])
    assert min(found.ours) > -0.15
    assert max(found.ours) < 0.4


def test_a_roll_out_of_a_still_hand_stays(lessons):
    lesson = lessons["follower"][5]
    still = replace(lesson, signals={n: np.repeat(v[:1], len(lesson), axis=0) for n, v in lesson.signals.items()})
    still = replace(still, signals={**still.signals, "velocity": 0.0 * still.velocity, "force": 0.0 * still.force})
    ahead = roll_outs(learn(lessons["follower"][:5]).model, still)
    assert np.abs(ahead[0]).max() < 5e-3


def test_a_lesson_shorter_than_a_horizon_has_no_number_there(ours, lessons):
    lesson = lessons["follower"][5]
    short = replace(lesson, signals={n: v[150:190] for n, v in lesson.signals.items()})
    found = ours.judged(short)
    assert np.isfinite(found.ours[:2]).all()
    assert np.isnan(found.ours[2:]).all()


def test_pieces_of_one_take_are_left_out_together(lessons):
    asked = []
    learnt = forecasting.leave_one_out(
        lessons["follower"][:3], lambda others: asked.append(len(others)) or learn(others), takes=["a", "a", "b"]
    )
    assert asked == [1, 1, 2]
    assert len(learnt) == 3


def test_no_lesson_is_refused(skills):
    with pytest.raises(ParameterError, match="no lesson"):
        forecaster(skills["follower"], [])


def test_a_ridge_holds_back_slopes_and_not_the_mean():
    """With a penalty of 1e6 the slopes are gone, and what is foreseen is the mean of 5, not of 0."""
    rng = np.random.default_rng(0)
    z = np.column_stack([rng.normal(size=(200, 3)), np.ones(200)])
    y = 5.0 + z[:, :1] + 0.1 * rng.normal(size=(200, 1))
    (solved,) = heads._solved(z.T @ z, z.T @ y, np.array([1e6]), True)
    assert np.abs(solved[:-1]).max() < 1e-2
    assert solved[-1, 0] == pytest.approx(float(y.mean()), abs=1e-2)


@pytest.mark.parametrize("shared", [True, False])
def test_a_head_finds_slopes_and_says_of_a_lesson_what_the_others_teach(shared):
    """Two axes, the same slope on both; of the odd lesson the other three say what they know, not what it shows."""
    rng = np.random.default_rng(2)
    seen = [rng.normal(size=(80, 3, 2)) for _ in range(4)]
    truth = [2.0 * x[:, 0] - x[:, 2] for x in seen[:3]] + [-2.0 * seen[3][:, 0]]
    head, said = heads.fitted(shared, seen[:3], truth[:3], [[0, 1]], [3])
    assert head(seen[3]) == pytest.approx(2.0 * seen[3][:, 0] - seen[3][:, 2], abs=0.01)
    _, said = heads.fitted(shared, seen, truth, [[0, 1]], [3])
    assert np.corrcoef(said[3].ravel(), (2.0 * seen[3][:, 0] - seen[3][:, 2]).ravel())[0, 1] > 0.95


@pytest.mark.parametrize("view", heads.VIEWS)
def test_turned_axes_have_the_same_forecast(view, lessons):
    from scipy.spatial.transform import Rotation

    rng, turn = np.random.default_rng(3), Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    seen = [rng.normal(size=(60, 2 * heads.LAGS, 3)) * [1.0, 0.2, 3.0] for _ in range(3)]
    truth = [x[:, 0] + 0.3 * x[:, 10] ** 2 for x in seen]
    plain, _ = heads.fitted(view.shared, seen, truth, [[0, 1, 2]], [heads.LAGS] * 2)
    turned, _ = heads.fitted(view.shared, [x @ turn.T for x in seen], [y @ turn.T for y in truth], [[0, 1, 2]], [heads.LAGS] * 2)
    assert turned(seen[0] @ turn.T) == pytest.approx(plain(seen[0]) @ turn.T, abs=1e-9)


def test_where_nothing_is_to_be_foreseen_the_ridge_is_exactly_nothing(lessons, skills):
    """Velocity that is noise: the ridge costs more on lessons left out than constant velocity does, or nearly nothing is left."""
    rng = np.random.default_rng(1)
    guesses, truth = [rng.normal(size=(2, 60, 1)) for _ in range(4)], [rng.normal(size=(60, 1)) for _ in range(4)]
    assert not forecasting._if_better(np.array([1.0, 0.0]), guesses, truth).any()
    assert forecasting._if_better(np.array([1.0, 0.0]), [np.stack([y, y]) for y in truth], truth).any()


def test_of_one_lesson_no_roll_out_is_used_and_of_two_all_heads_weigh_the_same(skills, lessons):
    one, two = (forecaster(skills["follower"], lessons["follower"][:n]) for n in (1, 2))
    assert not any(view.roll_out for mixture in one.mixtures for view in mixture.views)
    for mixture in two.mixtures:
        assert len(mixture.views) == len(heads.VIEWS)
        assert np.ptp(mixture.weights) == 0.0
    three = forecaster(skills["follower"], lessons["follower"][:3])
    assert any(np.ptp(mixture.weights) > 0.0 for mixture in three.mixtures)
    assert all((mixture.weights >= 0.0).all() for mixture in three.mixtures)


def test_a_penalty_is_a_frame_s_and_not_a_lesson_s():
    """The same lessons with every frame five times over say nothing new: slopes stay as they are."""
    rng = np.random.default_rng(4)
    seen = [rng.normal(size=(30, 3, 1)) for _ in range(3)]
    truth = [x[:, 0] + 2.0 * rng.normal(size=(30, 1)) for x in seen]
    once, _ = heads.fitted(True, seen, truth, [[0]], [3])
    often, _ = heads.fitted(True, [np.repeat(x, 5, axis=0) for x in seen], [np.repeat(y, 5, axis=0) for y in truth], [[0]], [3])
    assert often.gains == pytest.approx(once.gains, rel=1e-9)


def test_every_start_whose_end_is_recorded_counts_up_to_the_last_frame(lessons):
    lesson = lessons["leader"][0]
    steps = round(0.25 / lesson.dt)
    rows = [r for r in heads.rows_of(lesson) if r + steps <= len(lesson) - 1]
    cut = replace(lesson, signals={n: v[: rows[-1] + steps + 1] for n, v in lesson.signals.items()})
    assert len(forecasting._beyond(cut, 0.25)) == len(rows)


def _model(means, transition):
    """Two phases at one place without force, of different velocity, so sharp that the velocity says which it is."""
    channels = ("position.z", "force.z", "velocity.z")
    centres = np.array([[0.0, 0.0, v] for v in means])
    covariances = np.tile(np.diag([1.0, 1.0, 1e-4]), (len(means), 1, 1))
    return Hmm(np.eye(len(means))[0], np.array(transition), centres, covariances, channels)


def _moving(lesson, speed, frames=200):
    signals = {"position": np.zeros((frames, 1)), "force": np.zeros((frames, 1)), "velocity": np.full((frames, 1), speed)}
    return replace(lesson, signals=signals, signal_axes={})


def test_what_the_hand_is_faster_than_its_model_fades_over_0_3_s(lessons):
    lesson = _moving(lessons["leader"][0], 0.01)
    ahead = roll_outs(_model([0.0], [[1.0]]), lesson)
    for horizon, found in zip(HORIZONS_S, ahead[:, 5, 0], strict=True):
        steps = np.arange(round(horizon / lesson.dt))
        assert found == pytest.approx(lesson.dt * 0.01 * np.exp(-lesson.dt * steps / 0.3).sum() - horizon * 0.01, rel=1e-6)


def test_states_move_on_by_the_chain_while_nothing_is_seen(lessons):
    lesson = _moving(lessons["leader"][0], 0.0)
    ahead = roll_outs(_model([0.0, 0.5], [[0.9, 0.1], [0.0, 1.0]]), lesson)
    for horizon, found in zip(HORIZONS_S, ahead[:, 5, 0], strict=True):
        steps = np.arange(round(horizon / lesson.dt))
        assert found == pytest.approx(lesson.dt * 0.5 * (1.0 - 0.9**steps).sum(), rel=1e-3)
