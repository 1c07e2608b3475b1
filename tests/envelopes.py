"""An envelope on a virtual clock, around a skill that a test dictates."""

from __future__ import annotations

import numpy as np

from comanip.interfaces import Command, Observation
from comanip.safety.envelope import Envelope
from comanip.safety.limits import Limits

DT = 0.01
ROOM = Limits(workspace_m=((0.0, 1.0),))


class Dictated:
    """Commands `velocity` (set by the test) or does what `trick` says."""

    stop_reason = notice = ""

    def __init__(self, d=1):
        self.velocity, self.trick, self.resets = np.zeros(d), None, 0
        self.diagnostics = {"asked": self.velocity}

    def reset(self, obs):
        self.resets += 1

    def step(self, obs, command):
        if self.trick is not None:
            self.trick(command)
            return
        command.velocity[:] = self.velocity
        command.position[:] = obs.position
        command.acceleration[:] = 0.0


class Bench:
    """Envelope, dictated skill and a hand that follows; `tick` is one period."""

    def __init__(self, limits=ROOM, d=1, dt=DT, start=0.5, skill=None, **settings):
        self.skill = skill or Dictated(d)
        self.envelope = Envelope(self.skill, axes=tuple("xyz"[:d]), dt=dt, limits=limits, **settings)
        self.obs, self.command, self.dt, self.d = Observation(d), Command(d), dt, d
        self.obs.position[:], self.obs.velocity[:], self.obs.force[:] = start, 0.0, 0.0
        self.hand, self.time, self.force, self.count = np.full(d, start, dtype=float), 0.0, np.zeros(d), 0
        self.envelope.reset(self.obs)
        self.velocities = [np.zeros(d)]

    def tick(self, wish=None, force=None, *, period=None, sample=True, **seen):
        """Time passes, the hand moves as commanded, then the envelope steps. `seen` overrides what the sensors say."""
        period = self.dt if period is None else period
        self.time += period
        self.hand += self.command.velocity * period
        self.count += 1
        if wish is not None:
            self.skill.velocity[:] = wish
        if force is not None:
            self.force[:] = force
        if sample:
            obs = self.obs
            obs.time, obs.position[:], obs.velocity[:] = self.time, self.hand, self.command.velocity
            obs.force[:], obs.sensor_force[:] = self.force, self.force + 1e-6 * np.sin(self.count**2)
            for name, value in seen.items():
                if name == "time":
                    obs.time = value
                else:
                    getattr(obs, name)[:] = value
        self.envelope.step(self.obs, self.command)
        self.velocities.append(self.command.velocity.copy())
        return float(self.command.velocity[0])

    def ticks(self, n, wish=None, force=None, **seen):
        return [self.tick(wish, force, **seen) for _ in range(n)]

    @property
    def latched(self):
        """Why it is in a HOLD that only the user ends."""
        return "" if self.envelope.passes else self.held

    @property
    def held(self):
        return self.envelope.reason if self.envelope.mode == "HOLD" else ""
