"""A taught path carried to other starts and goals."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.commands.running import taught
from comanip.errors import ParameterError
from comanip.models.frames import carried, weight_of_goal
from comanip.models.taught_path import taught_paths
from comanip.reproduction import carried_to, make_skill
from comanip.tasks import named
from comanip.trials import judge, run_case
from comanip.trials.cases import draw_case


def lesson(size, start, seconds):
    s = np.linspace(0.0, 1.0, round(seconds * 100))[:, None]
    shape = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    path = np.hstack([start + size * shape, 0.05 * np.sin(np.pi * shape)])
    return np.vstack([np.repeat(path[:1], 30, axis=0), path, np.repeat(path[-1:], 60, axis=0)])


@pytest.fixture(scope="module")
def path():
    made = [lesson(0.3 + 0.02 * n, 0.1 + 0.002 * n, 2.0 + 0.1 * n) for n in (-2, -1, 0, 1, 2)]
    return taught_paths(made, [np.zeros_like(m) for m in made], 0.01)[0][0]


def test_lessons_agree_at_the_start_seen_from_the_start_and_at_the_end_seen_from_the_end(path):
    from_start, from_end = path.framed
    assert from_start[0] == pytest.approx(0.0, abs=1e-12)
    assert from_end[-1] == pytest.approx(0.0, abs=1e-12)
    assert from_start[-1] == pytest.approx(0.02 * np.sqrt(2.0), rel=0.1)
    weight = weight_of_goal(path)
    assert weight[0] == 0.0
    assert weight[-1] == 1.0
    assert (np.diff(weight) >= 0.0).all()


def test_as_taught_it_is_the_taught_path(path):
    same = carried(path, path.position[0], path.position[-1])
    np.testing.assert_allclose(same.position, path.position, atol=1e-12)
    assert same.step_s == pytest.approx(path.step_s)


def test_it_begins_and_ends_where_it_is_told_no_faster_and_as_curved_as_taught(path):
    start, goal = path.position[0] + [-0.1, 0.2], path.position[-1] + [0.3, 0.0]
    made = carried(path, start, goal)
    np.testing.assert_allclose(made.position[[0, -1]], [start, goal], atol=1e-12)
    np.testing.assert_allclose(made.ends.mean(axis=0) - path.ends.mean(axis=0), goal - path.position[-1], atol=1e-12)

    def top(one):
        return np.linalg.norm(np.diff(one.position, axis=0), axis=1).max() / one.step_s

    assert top(made) < 1.45 * top(path)
    both = carried(path, path.position[0] + 0.3, path.position[-1] + 0.3)
    np.testing.assert_allclose(both.position, path.position + 0.3, atol=1e-12)


@pytest.mark.parametrize("task", ["lift", "slide"])
def test_a_leader_carries_the_task_to_starts_and_goals_outside_the_lessons(task):
    one, rng = taught("leader", seed=0, task=named(task)), np.random.default_rng(5)
    taught_way = one.paths[0].position[-1] - one.paths[0].position[0]
    ahead = 0.3 * taught_way / np.linalg.norm(taught_way)
    for start, goal in ((one.paths[0].position[0] - ahead, None), (None, one.paths[0].position[-1] + ahead)):
        case = draw_case("leader", rng, task=named(task)).starting(one.paths[0].position[0] if start is None else start)
        skill = make_skill(one, axes=one.axes, dt=0.01, start=start, goal=goal, envelope=False)
        verdict = judge(case, run_case(case, skill), taught_ends_m=carried_to(one, start, goal)[0].ends)
        assert verdict.success, verdict


def test_a_start_of_another_shape_and_a_law_without_frames_are_refused():
    one = taught("leader", seed=0)
    with pytest.raises(ParameterError, match="a start is a position"):
        make_skill(one, axes=one.axes, dt=0.01, start=[0.1, 0.2])
    with pytest.raises(ParameterError, match="paper"):
        make_skill(one, axes=one.axes, dt=0.01, law="paper", start=[0.9])
