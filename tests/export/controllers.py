"""Skills to export: one axis and three, one goal and two."""

from __future__ import annotations

import sys
from functools import cache, partial
from pathlib import Path

import numpy as np

from comanip.export.controller import controller
from comanip.learned.learn import learn

sys.path.insert(0, str(Path(__file__).parent.parent / "skills"))
from many_tasks import course, lesson, lessons

KINDS = ("leader", "follower", "auto")
TASKS = ("slide", "pick, carry, place", "two goals")


def two_goals(role):
    rng = np.random.default_rng(21)
    heights = (0.34, 0.36, 0.15, 0.35, 0.14, 0.16)
    return [lesson(course([(0.0, 4.0 * np.sqrt(h), (h,))]), ("z",), role, rng, f"{h}") for h in heights]


@cache
def skills(task):
    made = two_goals if task == "two goals" else partial(lessons, task)
    return {role: learn(made(role), role=role) for role in ("leader", "follower")}


def maker(task, kind, **about):
    """What gives a controller that has never run."""
    both = skills(task)
    chosen = list(both.values()) if kind == "auto" else [both[kind]]
    return partial(controller, chosen, role="auto" if kind == "auto" else None, **{"dt": 0.01, "force_delay_s": 0.013, **about})
