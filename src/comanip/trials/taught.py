"""What a robot of a trial has been taught when no skill file is given: five fresh simulated lessons a role."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..learned.learn import learn
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import demonstrations
from ..tasks import Task, named
from ..teaching import teach
from .cases import TASK

RATE_HZ = 100.0
LESSONS = 5
_kept: dict[tuple[str, str], LearnedSkill] = {}


def taught(role: str, seed: int = 0, lessons: int = LESSONS, task: str | Path | Task = TASK) -> LearnedSkill:
    """A skill from fresh simulated lessons. It knows how near to an obstacle any of them came (provenance "clearance_m")."""
    recordings = teach(role, lessons, task=task, rng=np.random.default_rng(seed))
    learned = learn(demonstrations(recordings, rate_hz=RATE_HZ), role=role)
    known = [float(r.metadata["clearance_m"]) for r in recordings if "clearance_m" in r.metadata]
    return replace(learned, provenance={**learned.provenance, "clearance_m": min(known)}) if known else learned


def kept(task: str | Path | Task, roles: Sequence[str]) -> dict[str, LearnedSkill]:
    """The skills of `taught` with its defaults, by role, learned once a process."""
    what = named(task)
    for role in roles:
        if (role, repr(what)) not in _kept:
            _kept[role, repr(what)] = taught(role, task=what)
    return {role: _kept[role, repr(what)] for role in roles}
