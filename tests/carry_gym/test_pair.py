"""Both ends open: PettingZoo's checkers, one physics for two agents, and who leads."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="the extra gym is not installed")

from comanip.errors import ParameterError
from comanip.gym import CarryPair, Setting
from comanip.parts import TASKS
from comanip.skills.baselines import MassDamper
from comanip.tasks import named


@pytest.fixture(autouse=True)
def without_lessons(monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})  # they take seconds, and say only where a leader's goal is


@pytest.mark.parametrize("task", [name for name in TASKS if not named(name).needs])
def test_pettingzoos_own_checkers_pass(task):
    from pettingzoo.test import parallel_api_test, parallel_seed_test

    for role in ("leader", "follower", "auto"):
        parallel_api_test(CarryPair(task, role), num_cycles=300 if task == "lift" else 40)
        parallel_seed_test(lambda role=role: CarryPair(task, role), num_cycles=20)


def test_the_one_that_leads_sees_where_to_go_and_the_other_does_not():
    for role, leads in (("follower", "partner"), ("leader", "robot")):
        seen, infos = CarryPair("lift", role).reset(seed=3)
        other = {"robot": "partner", "partner": "robot"}[leads]
        assert seen[leads][3] > 0.5
        assert seen[other][3] == 0.0
        assert (infos[leads]["role"], infos[other]["role"]) == ("leader", "follower")


def test_a_led_robot_carries_with_an_agent_and_one_that_holds_does_not():
    env, law = CarryPair("lift", "follower"), MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0)

    def carried(seed, follows):
        obs, _ = env.reset(seed=seed)
        law.reset(None)
        start, goal, t = obs["partner"][0], obs["partner"][3], 0.0
        while env.agents:
            s = min(max((t - 1.0) / 2.5, 0.0), 1.0)
            speed = (goal - start) * s * s * (30.0 + s * (-60.0 + 30.0 * s)) / 2.5
            meant = start + (goal - start) * s**3 * (10.0 + s * (-15.0 + 6.0 * s))
            lead = [speed + 3.0 * (meant - obs["partner"][0]) + 0.004 * obs["partner"][2]]
            own = law.move(obs["robot"][2:3].copy(), 20.0) if follows else [0.0]
            obs, reward, _, _, info = env.step({"robot": own, "partner": lead})
            assert reward["robot"] == reward["partner"]
            t += 0.01
        return info["robot"]["success"]

    assert sum(carried(seed, True) for seed in range(4)) >= 2
    assert sum(carried(seed, False) for seed in range(4)) == 0


@pytest.mark.parametrize(
    "bad",
    [
        {"robot": [0.0]},
        {"robot": [0.0], "partner": [np.nan]},
        {"robot": [0.0, 1.0], "partner": [0.0]},
        {"robot": [0.0], "partner": ["0.0"]},
        {"robot": [0.0], "partner": [0.0], "third": [0.0]},
        {},
        None,
        [[0.0], [0.0]],
    ],
)
def test_a_bad_action_is_one_error_and_nothing_has_moved(bad):
    env, other = CarryPair(), CarryPair()
    env.reset(seed=1)
    other.reset(seed=1)
    for _ in range(10):
        with pytest.raises(ParameterError, match=r"action|agent"):
            env.step(bad)
        good = {"robot": [0.05], "partner": [0.0]}
        assert env.step(good)[0]["robot"].tobytes() == other.step(good)[0]["robot"].tobytes()


def test_what_belongs_to_people_is_refused():
    with pytest.raises(ParameterError, match="people goes with people"):
        CarryPair("lift", people="usual")
