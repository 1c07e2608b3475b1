"""evaluate: the numbers mean what their names say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.evaluation import prediction


def test_lessons_left_out_are_predicted_from_force(lessons):
    for role in ("leader", "follower"):
        found = prediction.leave_one_out(lessons[role])
        overall = prediction.overall(found)
        assert overall["one_step_velocity_r2"] > 0.90
        assert overall["free_run_position_rmse_m"] < 0.025
        assert found[0].one_step_velocity_r2_per_axis == pytest.approx([found[0].one_step_velocity_r2])


def test_noise_bias_and_another_start_do_not_lock_the_free_run_at_rest(lessons):
    """A second of rest, 1.5 N of force noise, starts 1 cm apart: the regime of real sensors."""
    rng = np.random.default_rng(0)
    spoiled = []
    for lesson in lessons["leader"]:
        rest = {n: np.vstack([np.repeat(v[:1], 100, axis=0), v]) for n, v in lesson.signals.items()}
        rest["force"] = rest["force"] + rng.normal(0.0, 1.5, rest["force"].shape)
        rest["position"] = rest["position"] + rng.normal(0.0, 0.01)
        spoiled.append(replace(lesson, signals=rest))
    overall = prediction.overall(prediction.leave_one_out(spoiled))
    assert overall["one_step_velocity_r2"] > 0.90
    assert overall["free_run_position_rmse_m"] < 0.025


def test_one_step_is_given_no_velocity_of_its_own_frame(skills, lessons):
    lesson = lessons["leader"][5]
    spoiled = np.array(lesson.velocity)
    spoiled[200] = 5.0
    other = replace(lesson, signals={**lesson.signals, "velocity": spoiled})
    a, b = (prediction.one_step_velocity(skills["leader"], x) for x in (lesson, other))
    assert a[: 200 + 1] == pytest.approx(b[: 200 + 1], abs=1e-12)


def test_the_free_run_is_given_only_force_after_its_first_frame(skills, lessons):
    lesson = lessons["follower"][5]
    elsewhere = np.array(lesson.position)
    elsewhere[1:] += 0.1
    other = replace(lesson, signals={**lesson.signals, "position": elsewhere, "velocity": lesson.velocity * 0.0})
    assert (prediction.free_run(skills["follower"], lesson) == prediction.free_run(skills["follower"], other)).all()
    silent = replace(lesson, signals={**lesson.signals, "force": lesson.force * 0.0})
    assert np.abs(prediction.free_run(skills["follower"], silent) - lesson.position).max() > 0.1


def test_r2_of_a_perfect_and_of_a_mean_prediction():
    rng = np.random.default_rng(0)
    actual = rng.normal(size=(50, 2))
    assert prediction._fit_of(actual, actual)[0] == 1.0
    assert prediction._fit_of(np.broadcast_to(actual.mean(axis=0), actual.shape), actual)[0] == pytest.approx(0.0)


def test_leave_one_out_never_sees_the_lesson_it_predicts(lessons, monkeypatch):
    seen = []
    learn = prediction.learn
    monkeypatch.setattr(prediction, "learn", lambda others, **k: seen.append([x.sha256 for x in others]) or learn(others, **k))
    found = prediction.leave_one_out(lessons["leader"][:3], n_states=4)
    assert len(found) == 3
    for lesson, others in zip(lessons["leader"][:3], seen, strict=True):
        assert lesson.sha256 not in others
        assert len(others) == 2
    with pytest.raises(ParameterError, match="at least 2"):
        prediction.leave_one_out(lessons["leader"][:1])


def test_another_rate_is_refused_with_the_remedy(skills, lessons):
    with pytest.raises(ParameterError, match="resample"):
        prediction.predict(skills["leader"], replace(lessons["leader"][5], dt=0.02))
