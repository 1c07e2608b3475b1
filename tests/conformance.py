"""One list a socket, and what is common to all that fit into it: a new part joins the common tests by one line here.

Each entry makes the part anew. Laws, plants, devices and formats of `comanip.parts` are here without a line.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from comanip import parts
from comanip.models.filtering import DurationFilter, ForwardFilter
from comanip.models.gmm import Gmm
from comanip.models.hmm import Hmm
from comanip.models.hsmm import explicit_durations
from comanip.people.kinds import KINDS, make, planned
from comanip.people.partners import HumanFollower, HumanLeader, HumanSharing
from comanip.plants.beam import Beam, WristSensor
from comanip.plants.replay import ReplayPlant
from comanip.skills.baselines import MassDamper, MinimumJerkFollower, VariableDamping
from comanip.tasks import named, usual, way
from comanip.trials import contestant

Make = Callable[[], Any]
CHANNELS = ("position.z", "force.z", "velocity.z")


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def hmm() -> Hmm:
    means = np.array([[0.0, 1.0, 0.1], [0.2, -1.0, 0.2]])
    covariances = np.array([np.diag([0.01, 1.0, 0.01]), np.diag([0.02, 2.0, 0.02])])
    return Hmm(np.array([0.7, 0.3]), np.array([[0.9, 0.1], [0.2, 0.8]]), means, covariances, CHANNELS)


MODELS: dict[str, Make] = {
    "hmm": hmm,
    "hsmm": lambda: explicit_durations(hmm(), 60),
    "gmm": lambda: Gmm(np.array([0.6, 0.4]), hmm().means, hmm().covariances, CHANNELS),
}
ESTIMATORS: dict[str, Make] = {  # on-line filters over position and force
    "forward": lambda: ForwardFilter(hmm(), ("position", "force")),
    "duration": lambda: DurationFilter(explicit_durations(hmm(), 60), ("position", "force")),
}
PARTNERS: dict[str, Make] = {
    "leader": lambda: HumanLeader(rng=rng()),
    "follower": lambda: HumanFollower(rng=rng()),
    "sharing": lambda: HumanSharing(rng=rng()),
}
BASELINES: dict[str, Make] = {
    "mass-damper": lambda: MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0),
    "variable damping": lambda: VariableDamping(n_axes=1, dt=0.01),
    "minimum jerk": lambda: MinimumJerkFollower(n_axes=1, dt=0.01),
}


def skills(learned: Any) -> dict[str, Make]:
    """Every law of `parts.LAWS` in every role that it can have, and the baselines by themselves."""
    found = dict(BASELINES)
    for law, part in parts.LAWS.items():
        for role in ("leader", "follower", *(["auto"] if part.untold else [])):
            found[f"{law} as {role}"] = lambda law=law, role=role: contestant(law, role, learned, dt=0.01)
    return found


def plants() -> dict[str, Make]:
    about = {"beam": Beam(), "sensor": WristSensor(), "dt": 0.01, "start_position": np.array([0.85]), "task": named("lift")}
    made = {
        name: lambda name=name: parts.PLANTS[name].load()(HumanLeader(rng=rng()), rng=rng(2), **about)
        for name in parts.PLANTS
        if name != "humanoid"  # minutes of physics: tests/plants/test_humanoid.py
    }
    return made | {"replay": lambda: ReplayPlant(np.full((200, 1), 2.0), dt=0.01, start_position=np.array([0.85]), axes=("z",))}


WRITTEN = [form for form in parts.FORMATS if form.writes]
__all__ = ["ESTIMATORS", "KINDS", "MODELS", "PARTNERS", "WRITTEN", "make", "planned", "plants", "skills", "usual", "way"]
