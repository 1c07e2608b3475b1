"""Forecasts: nothing later than now is seen, the yardstick is right, and what does not help is not used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.evaluation import forecasting
from comanip.evaluation.forecasting import HORIZONS_S, Forecaster, Head, forecaster, history, roll_outs
from comanip.learned.skill import learn


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
    assert past.shape == (len(lesson), 2 * 9)
    assert (past[200, :9] == lesson.velocity[200 - 5 * np.arange(9), 0]).all()
    assert (past[7, 9:] == lesson.force[np.maximum(7 - 5 * np.arange(9), 0), 0]).all()


def test_constant_velocity_itself_has_skill_zero_and_the_truth_has_one(skills, lessons):
    lesson = lessons["follower"][5]
    nothing = Head(np.zeros(18), np.ones(18), np.zeros((18, 1)), np.zeros(1), False)
    judged = Forecaster(skills["follower"], (nothing,) * 4, (nothing,) * 4).judged(lesson)
    assert judged.ours == pytest.approx((0.0,) * 4)
    even = replace(lesson, signals={**lesson.signals, "position": 0.2 * lesson.dt * np.arange(len(lesson))[:, None]})
    even = replace(even, signals={**even.signals, "velocity": np.full_like(even.position, 0.1)})
    right = Head(np.zeros(18), np.ones(18), np.zeros((18, 1)), np.zeros(1), False)
    heads = tuple(replace(right, offset=np.array([0.1 * h])) for h in HORIZONS_S)  # the half that the velocity channel lacks
    assert Forecaster(skills["follower"], heads, heads).judged(even).ours == pytest.approx((1.0,) * 4)


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
    solved = forecasting._solved(z.T @ z, z.T @ y, 1e6)
    assert np.abs(solved[:-1]).max() < 1e-2
    assert solved[-1, 0] == pytest.approx(float(y.mean()), abs=1e-2)


def test_where_nothing_is_to_be_foreseen_the_head_is_exactly_nothing():
    """Noise on noise in four lessons: every ridge costs more on lessons left out than constant velocity does."""
    rng = np.random.default_rng(1)
    inputs, truth = [rng.normal(size=(60, 6)) for _ in range(4)], [rng.normal(size=(60, 1)) for _ in range(4)]
    head, cost = forecasting._ridge(inputs, truth, False)
    assert not head.gains.any()
    assert not head.offset.any()
    assert cost == pytest.approx(sum(float((y**2).sum()) for y in truth))


def test_of_one_lesson_no_roll_out_is_chosen_and_of_several_only_one_that_helps(skills, lessons):
    assert not any(head.uses_roll_out for head in forecaster(skills["follower"], lessons["follower"][:1]).heads)
    several = forecaster(skills["follower"], lessons["follower"][:3])
    for head, ridge in zip(several.heads, several.ridges, strict=True):
        assert head.uses_roll_out or head is ridge
