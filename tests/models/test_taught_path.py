"""The path that lessons share: as long, as sharp and as slow as they are; returning, resting, repeating, turned."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from comanip.learned import file as skill_file
from comanip.learned.learn import learn
from comanip.models.taught_path import goals_of, taught_paths

sys.path.insert(0, str(Path(__file__).parents[1] / "skills"))
from many_tasks import TASKS, course, lesson, lessons


def paths(made):
    return taught_paths([x.position for x in made], [x.force for x in made], made[0].dt)


def length(position, every=5):
    return np.linalg.norm(np.diff(position[::every], axis=0), axis=1).sum()


@pytest.mark.parametrize("task", [*TASKS, "crank"])
@pytest.mark.parametrize("n", [3, 5])
def test_it_is_as_long_and_takes_as_long_as_the_lessons_and_goes_where_they_go(task, n):
    made = lessons(task, "leader", seed=3, n=n)
    (path,), onsets = paths(made)
    assert len(path.ends) == n
    taught = [length(x.position) for x in made]
    assert length(path.position) == pytest.approx(np.mean(taught), rel=0.02)
    seconds = [len(x) * x.dt - onset - 1.0 for x, onset in zip(made, onsets, strict=True)]
    assert path.step_s * (len(path.position) - 1) == pytest.approx(np.mean(seconds), rel=0.08)
    assert path.position[0] == pytest.approx(np.mean([x.position[0] for x in made], axis=0), abs=0.005)
    assert path.position[-1] == pytest.approx(path.ends.mean(axis=0), abs=1e-12)
    assert np.linalg.norm(path.position - path.position[0], axis=1).max() == pytest.approx(
        np.mean([np.linalg.norm(x.position - x.position[0], axis=1).max() for x in made]), rel=0.03
    )
    assert (np.abs(onsets - 0.8) < 0.7).all()


def test_a_corner_is_not_cut():
    made = lessons("corner", "leader", seed=4)

    def from_inside(position):  # the smallest distance from a post on the inside of the corner
        return np.linalg.norm(position - position[0] - [0.2, 0.1], axis=1).min()

    (path,), _ = paths(made)
    assert from_inside(path.position) >= min(from_inside(x.position) for x in made)


def test_a_rest_in_the_middle_lasts_as_taught():
    made = lessons("lift, hold, lower", "leader", seed=5)
    (path,), _ = paths(made)
    speed = np.linalg.norm(np.gradient(path.position, path.step_s, axis=0), axis=1)
    still = path.step_s * np.count_nonzero(speed[50:-50] < 0.05 * speed.max())
    assert still == pytest.approx(2.0, abs=0.6)


def test_lessons_of_two_goals_are_two_paths_and_none_is_the_mean():
    rng = np.random.default_rng(6)
    made = [lesson(course([(0.0, 2.0, (h,))]), ("z",), "leader", rng, f"{h}") for h in (0.35, 0.15, 0.35, 0.16, 0.34)]
    found, _ = paths(made)
    assert [len(path.ends) for path in found] == [3, 2]
    assert [path.position[-1, 0] - path.position[0, 0] for path in found] == pytest.approx([0.347, 0.155], abs=0.01)
    assert any("goal 1 of 3 lessons" in note and "goal 2 of 2 lessons" in note for note in learn(made).notes)


def test_two_ways_round_are_two_goals():
    """The mean of left and right goes through what stands between."""
    up, down = (course([(0.0, 3.0, (0.5, 0.0)), (0.0, 1.5, (0.0, s)), (1.5, 1.5, (0.0, -s))]) for s in (0.2, -0.2))
    assert goals_of([up, up * 1.05, down, up * 0.97], 0.5) == [[0, 1, 3], [2]]


def test_natural_variation_is_one_goal():
    for seed in range(8):
        assert len(paths(lessons("lift", "leader", seed=seed, n=4))[0]) == 1


@pytest.mark.parametrize("task", ["corner", "pick, carry, place", "crank"])
def test_turned_lessons_give_the_turned_path_and_other_units_the_scaled_one(task):
    made = lessons(task, "leader", seed=7)
    d = made[0].position.shape[1]
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(d, d)))[0]
    (path,), onsets = paths(made)
    (other,), same = paths(lessons(task, "leader", seed=7, turned=turned))
    assert other.position == pytest.approx(path.position @ turned.T, abs=1e-9)
    assert other.force == pytest.approx(path.force @ turned.T, abs=1e-9)
    assert same == pytest.approx(onsets)
    (inches,), _ = taught_paths([39.37 * x.position for x in made], [x.force for x in made], made[0].dt)
    assert inches.position == pytest.approx(39.37 * path.position, rel=1e-9)


def test_a_lesson_that_fits_badly_is_left_out():
    made = lessons("saw", "leader", seed=8)
    lame = lesson(
        course([(0.0, 6.0, (0.2,)), (6.0, 0.6, (-0.2,)), *TASKS["saw"][1][2:]]), ("x",), "leader", np.random.default_rng(2)
    )
    (path, *_), _ = paths(made)
    (with_it, *_), _ = paths([*made, lame])
    assert length(with_it.position) == pytest.approx(length(path.position), rel=0.05)


def test_a_skill_file_keeps_the_paths(tmp_path):
    learned = learn(lessons("corner", "leader", seed=9))
    skill_file.save(learned, tmp_path / "skill.json")
    again = skill_file.load(tmp_path / "skill.json")
    for one, other in zip(learned.paths, again.paths, strict=True):
        assert (one.position == other.position).all()
        assert (one.force == other.force).all()
        assert (one.ends == other.ends).all()
        assert one.step_s == other.step_s
    assert (again.onsets_s == learned.onsets_s).all()
