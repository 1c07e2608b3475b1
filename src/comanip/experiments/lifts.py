"""Lessons of the lift in both roles, for Figs. 5 to 7: taught on the exact beam, or on the humanoid after `use("humanoid")`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from comanip.interaction import Payload
from comanip.learned.learn import learn
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import Demonstration, demonstrations
from comanip.plants.beam import Beam
from comanip.teaching import Habits, teach

RATE_HZ = 100.0
LESSONS = 5  # the paper's, for each role; one more is taught and held out
WAITING_N = 6.0  # a teacher who answers only a pull above this


_plant = "beam"


def use(plant: str) -> None:
    """Where lessons are taught from now on: "beam" or "humanoid"."""
    global _plant
    _plant = plant


def taught(role: str, seed: int, *, waiting: bool = False) -> tuple[Demonstration, ...]:
    """Five lessons and a sixth that nobody learns from. `waiting`: the teacher answers only a pull above 6 N (usual: 2 N)."""
    return _taught(role, seed, waiting, _plant)


@lru_cache(maxsize=8)
def _taught(role: str, seed: int, waiting: bool, plant: str) -> tuple[Demonstration, ...]:
    stream = np.random.default_rng([seed, ("leader", "follower").index(role), int(waiting)])
    habits = Habits(teacher_dead_zone_n=WAITING_N) if waiting else Habits()
    recordings = teach(role, LESSONS + 1, rng=stream, habits=habits, plant=plant)
    named = [r.with_metadata(name=f"{role} {n + 1}") for n, r in enumerate(recordings)]
    return demonstrations(named, rate_hz=RATE_HZ, payload=Payload(Beam().mass_kg))


@lru_cache(maxsize=64)
def learned(lessons: tuple[Demonstration, ...]) -> LearnedSkill:
    """The paper's model of 5 states; the same lessons are learned from once."""
    return learn(lessons, law="paper")


def moving(lesson: Demonstration, share: float = 0.05) -> slice:
    """Frames from the first to the last in which the hand is faster than `share` of its top speed."""
    speed = np.linalg.norm(lesson.velocity, axis=1)
    fast = np.flatnonzero(speed > share * speed.max())
    return slice(int(fast[0]), int(fast[-1]) + 1)
