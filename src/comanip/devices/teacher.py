"""A teacher's hand on a haptic handle, simulated: the device in `read`/`write` form with a person on it.

Handle and hand are one mass; the person is the arm model of `plants.partners` seen from the device's side. Numbers: apparent
mass of a PHANToM Premium 1.5 with gimbal 0.14 kg, friction as viscous 1 N s/m, a stylus hand 0.5 kg, force limit 8.5 N.

    (M_t + M_d) dv_h/dt = f_teacher + F_m - b v_h
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import exp, pi

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array


@dataclass(frozen=True)
class TeacherHand:
    """A teacher's arm on the stylus. A follower's arm is softer than a leader's."""

    mass_kg: float = 0.64
    stiffness_n_per_m: float = 150.0
    damping_ns_per_m: float = 15.0
    device_friction_ns_per_m: float = 1.0
    device_limit_n: float = 8.5

    def __post_init__(self) -> None:
        if not (self.mass_kg > 0 and self.stiffness_n_per_m > 0):
            raise ParameterError(f"a hand needs mass and stiffness > 0; got {self.mass_kg} kg, {self.stiffness_n_per_m} N/m")


@dataclass(frozen=True)
class TeacherPlan:
    """A leading teacher's minimum-jerk motion of the HANDLE (device scale) along the moving axis."""

    lift_m: float = 0.23
    duration_s: float = 2.2
    onset_s: float = 1.0


@dataclass(frozen=True)
class TeacherYielding:
    """A following teacher: handle speed per newton felt on the handle, after his own delay."""

    damping_ns_per_m: float = 8.0
    persistence: float = 0.3
    lag_s: float = 0.06
    delay_s: float = 0.12
    dead_zone_n: float = 0.4
    felt_bandwidth_hz: float = 6.0


def _plan_of(plan: TeacherPlan, time: float) -> tuple[float, float, float]:
    s = (time - plan.onset_s) / plan.duration_s
    if not 0.0 < s < 1.0:
        return (plan.lift_m if s >= 1.0 else 0.0), 0.0, 0.0
    a, t = plan.lift_m, plan.duration_s
    return (
        a * s**3 * (10 - 15 * s + 6 * s * s),
        a * 30 * s * s * (1 - s) ** 2 / t,
        a * 60 * s * (1 - s) * (1 - 2 * s) / t**2,
    )


class SimulatedTeacher:
    """Implements `HapticDevice`: leads by `plan` or follows by `yielding`, exactly one of them.

    static_force   (d,) [N] the handle force at rest (the rendered weight), which the teacher carries without thinking
    """

    def __init__(
        self,
        *,
        plan: TeacherPlan | None = None,
        yielding: TeacherYielding | None = None,
        hand: TeacherHand = TeacherHand(),
        static_force: Array,
        moving: int = 0,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        if (plan is None) == (yielding is None):
            raise ParameterError("a teacher either leads (plan) or follows (yielding); give exactly one")
        self.plan, self.yielding, self.hand = plan, yielding, hand
        self._static = [float(f) for f in static_force]
        self._moving, self._substep, self._rng = moving, substep_s, rng
        self.reset()

    def reset(self) -> None:
        d = len(self._static)
        self.time = 0.0
        self._x, self._v, self._x_e, self._v_e = [0.0] * d, [0.0] * d, [0.0] * d, [0.0] * d
        self._felt, self._speed = [0.0] * d, [0.0] * d
        delay = self.yielding.delay_s if self.yielding else self._substep
        late = max(1, round(delay / self._substep))
        self._past = [deque([(0.0, 0.0)] * late, maxlen=late) for _ in range(d)]

    def read(self, out: Array) -> None:
        out[:] = self._v

    def write(self, force: Array, duration: float) -> None:
        limit = self.hand.device_limit_n
        felt = [min(max(float(f), -limit), limit) for f in force]
        steps = max(1, round(duration / self._substep))
        for _ in range(steps):
            for i, f_m in enumerate(felt):
                self._advance(i, f_m, duration / steps)
            self.time += duration / steps

    def _advance(self, i: int, f_m: float, h: float) -> None:
        hand, moving = self.hand, i == self._moving
        feedforward = 0.0
        if self.plan is not None:
            x_e, v_e, a_d = _plan_of(self.plan, self.time) if moving else (0.0, 0.0, 0.0)
            feedforward = hand.mass_kg * a_d
        else:
            x_e, v_e = self._follow(i, f_m, h, moving)
        f_teacher = hand.stiffness_n_per_m * (x_e - self._x[i]) + hand.damping_ns_per_m * (v_e - self._v[i])
        f_teacher += feedforward - self._static[i] + 0.02 * float(self._rng.standard_normal())
        self._v[i] += h * (f_teacher + f_m - hand.device_friction_ns_per_m * self._v[i]) / hand.mass_kg
        self._x[i] += h * self._v[i]

    def _follow(self, i: int, f_m: float, h: float, moving: bool) -> tuple[float, float]:
        y = self.yielding
        assert y is not None
        mix = 1.0 - exp(-2 * pi * y.felt_bandwidth_hz * h)
        self._felt[i] += mix * (f_m - self._static[i] - self._felt[i])
        self._speed[i] += mix * (self._v[i] - self._speed[i])
        pull, speed = self._past[i][0]
        self._past[i].append((self._felt[i], self._speed[i]))
        dead = y.dead_zone_n
        beyond = pull - dead if pull > dead else pull + dead if pull < -dead else 0.0
        wanted = (beyond / y.damping_ns_per_m + y.persistence * speed) if moving else 0.0
        self._v_e[i] += h / y.lag_s * (wanted - self._v_e[i])
        self._x_e[i] += h * self._v_e[i]
        return self._x_e[i], self._v_e[i]
