"""What the tests of the humanoid share: a partner who pulls as told, a skill that moves as told, a plant without noise."""

from __future__ import annotations

import numpy as np

from comanip.interfaces import STANDARD_GRAVITY
from comanip.people.partners import minimum_jerk
from comanip.plants.beam import WristSensor
from comanip.plants.humanoid import HumanoidPlant

QUIET = WristSensor(noise_n=0.0, bias_n=0.0, delay_s=0.0)
HALF = 0.5 * 2.0 * STANDARD_GRAVITY


class Pulling:
    """A partner who carries his share and pulls by an extra force that may change with time."""

    def __init__(self, extra=lambda time: 0.0, *, axes=("z",), share=HALF):
        self.extra, self.carried = extra, np.array([share if a == "z" else 0.0 for a in axes])

    def reset(self, position):
        self.taken_at = position.copy()

    def force(self, time, position, velocity, out):
        out[:] = self.carried + self.extra(time)


class Follows:
    """A skill that asks for a velocity that is a function of time."""

    stop_reason = notice = ""

    def __init__(self, velocity):
        self.velocity, self.diagnostics = velocity, {}

    def reset(self, obs):
        pass

    def step(self, obs, command):
        command.velocity[:] = self.velocity(obs.time)


def still(time):
    return 0.0


def lift(time, by=0.38, lasting=2.0, onset=0.2):
    return by / lasting * minimum_jerk((time - onset) / lasting)[1]


def plant_of(partner=None, **settings):
    settings = {"sensor": QUIET, "rng": np.random.default_rng(0), **settings}
    return HumanoidPlant(partner or Pulling(axes=settings.get("axes", ("z",))), **settings)
