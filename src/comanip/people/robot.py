"""Another robot at the other end: a Skill with a hand of its own, adapted to the Partner socket.

Its hand follows the skill's velocity through a lag and holds the object by a grip that is a spring and a damper; its sensor feels
that grip, late and with noise, as the first robot's does. So two robots carry together, each with its own estimate of the force.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import exp, inf
from typing import Protocol

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Skill


def stated(goal: Array | None) -> float | Array | None:
    """A goal (d,) as a judge takes it: along the only axis a number."""
    return None if goal is None else float(goal[0]) if len(goal) == 1 else goal


class Estimates(Protocol):
    """Fills `obs.force` from `obs.sensor_force` (`interaction.TaringInteractionForce`)."""

    def reset(self) -> None: ...

    def step(self, obs: Observation) -> None: ...


@dataclass(frozen=True)
class Gripper:
    """How the other robot holds the object, and how well it feels."""

    stiffness_n_per_m: float = 1500.0
    damping_ns_per_m: float = 40.0
    lag_s: float = 0.020  # velocity command -> hand velocity
    delay_s: float = 0.005  # of its force sensor
    noise_n: float = 0.2  # standard deviation of one sample

    def __post_init__(self) -> None:
        for name, least in (("stiffness_n_per_m", 0.0), ("lag_s", 0.0), ("damping_ns_per_m", -inf)):
            if not getattr(self, name) > least:
                raise ParameterError(f"a gripper's {name} must be positive; got {getattr(self, name)}")


class RobotPartner:
    """`skill` as the partner of another robot.

    carried_n       (d,) share of the weight along each axis [N]
    goal (d,), onset_s, stop_s   as stated by who makes it: where and when it means to go, if it leads
    """

    def __init__(
        self,
        skill: Skill,
        estimator: Estimates,
        *,
        carried_n: tuple[float, ...],
        gripper: Gripper = Gripper(),
        dt: float = 0.01,
        substep_s: float = 0.001,
        rng: np.random.Generator,
        goal: Array | None = None,
        onset_s: float | None = None,
        stop_s: float | None = None,
    ) -> None:
        self.skill, self.estimator, self.gripper, self.carried_n = skill, estimator, gripper, carried_n
        self.goal, self.onset_s, self.stop_s = goal, onset_s, stop_s
        self.goal_m = stated(goal)
        self._dt, self._step, self._rng, self._d = dt, substep_s, rng, len(carried_n)
        self._keep = exp(-substep_s / gripper.lag_s)

    def reset(self, position: Array) -> None:
        d, late = self._d, round(self.gripper.delay_s / self._step)
        self._obs, self._command = Observation(d), Command(d)
        self._hand, self._velocity = [float(p) for p in position], [0.0] * d
        self._sag = [c / self.gripper.stiffness_n_per_m for c in self.carried_n]
        self._line: deque[list[float]] = deque([list(self.carried_n)] * (late + 1), maxlen=late + 1)
        self._sum, self._count, self._next = list(self.carried_n), 1, self._dt
        self._observe(0.0)
        self.estimator.reset()
        self.estimator.step(self._obs)
        self._command.position[:] = self._obs.position
        self.skill.reset(self._obs)
        self.skill.step(self._obs, self._command)

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        if time >= self._next - 1e-9:
            self._next += self._dt
            self._observe(time)
            self.estimator.step(self._obs)
            self.skill.step(self._obs, self._command)
        grip, h, lag, keep = self.gripper, self._step, self.gripper.lag_s, self._keep
        now = []
        for i, asked in enumerate(self._command.velocity.tolist()):
            error = self._velocity[i] - asked
            off, slip = self._hand[i] + self._sag[i] - float(position[i]), self._velocity[i] - float(velocity[i])
            now.append(grip.stiffness_n_per_m * off + grip.damping_ns_per_m * slip)
            self._hand[i] += asked * h + error * lag * (1.0 - keep)
            self._velocity[i] = asked + error * keep
        self._line.append(now)
        self._sum = [s + f for s, f in zip(self._sum, self._line[0], strict=True)]
        self._count += 1
        out[:] = now

    def _observe(self, time: float) -> None:
        """What its own sensors say: the object pulls its hand with the opposite of the grip, mean over the period."""
        obs, noise = self._obs, self._rng.standard_normal(self._d).tolist()
        obs.time = time
        obs.position[:], obs.velocity[:] = self._hand, self._velocity
        for i, total in enumerate(self._sum):
            obs.sensor_force[i] = -total / self._count + self.gripper.noise_n * noise[i]
        self._sum, self._count = [0.0] * self._d, 0
