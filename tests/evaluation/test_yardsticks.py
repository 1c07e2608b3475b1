"""Rules that know nothing of the task, on lessons whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.evaluation import prediction
from comanip.evaluation.yardsticks import MeanLesson, force_onset, last_velocity, persistence_log_likelihood, standing_still


def begun_at(lesson, frame):
    """The same lesson, its force and motion (a ramp of 30 cm) setting in at `frame`."""
    t = np.clip((np.arange(400) - frame) / 100.0, 0.0, 1.0)[:, None]
    signals = {"position": 0.5 + 0.3 * t, "force": 8.0 * (t > 0.0), "velocity": 0.3 * ((t > 0.0) & (t < 1.0))}
    return replace(lesson, signals=signals, name=f"from {frame}")


def test_the_last_velocity_is_one_frame_late_and_nothing_else(lessons):
    lesson = lessons["leader"][0]
    assert (last_velocity(lesson)[1:] == lesson.velocity[:-1]).all()
    assert (last_velocity(lesson)[0] == 0.0).all()
    assert (standing_still(lesson) == lesson.position[0]).all()


def test_the_mean_lesson_begins_when_the_force_does(lessons):
    made = [begun_at(lessons["leader"][0], frame) for frame in (50, 120, 200)]
    other = begun_at(lessons["leader"][0], 160)
    path = MeanLesson.of(made).path(other)
    assert path == pytest.approx(other.position, abs=0.004)
    silent = replace(other, signals={**other.signals, "force": 0.0 * other.force})
    assert (MeanLesson.of(made).path(silent) == other.position[0]).all()


def test_turned_axes_have_the_same_onset():
    rng = np.random.default_rng(0)
    force = np.zeros((100, 3))
    force[40:] = [3.0, -2.0, 1.0]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert force_onset(force, 0.01, "N", {"N": 4.0}) == force_onset(force @ turn, 0.01, "N", {"N": 4.0}) == 40
    assert force_onset(0.0 * force, 0.01, "N", {"N": 4.0}) == 100


def test_persistence_is_the_likelihood_of_steps():
    rng = np.random.default_rng(1)
    walks = [np.cumsum(rng.normal(scale=[0.5, 2.0], size=(4000, 2)), axis=0) for _ in range(3)]
    expected = -0.5 * 2.0 - 0.5 * np.log((2.0 * np.pi) ** 2 * 0.25 * 4.0)
    assert persistence_log_likelihood(walks[0], walks[1:]) == pytest.approx(expected, abs=0.3)


def test_evaluate_sets_them_beside_its_own(lessons):
    found = prediction.leave_one_out(lessons["leader"][:3])
    for one, lesson in zip(found, lessons["leader"][:3], strict=True):
        assert one.last_velocity_r2 > 0.99
        still = np.sqrt(((lesson.position - lesson.position[0]) ** 2).mean())
        assert one.standing_still_rmse_m == pytest.approx(still)
        assert 0.0 < one.mean_lesson_rmse_m < still
        assert np.isfinite(one.persistence_log_likelihood_per_frame)
    assert prediction.medians(found)["last_velocity_r2"] > 0.99
