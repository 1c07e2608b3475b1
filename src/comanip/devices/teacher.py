"""A teacher's hand on a haptic handle, simulated: the device in `read`/`write` form with a person on it.

Handle and hand are one mass; the person is the model of `comanip.humans` seen from the device's side. Numbers: apparent
mass of a PHANToM Premium 1.5 with gimbal 0.14 kg, friction as viscous 1 N s/m, a stylus hand 0.5 kg, force limit 8.5 N.

    (M_t + M_d) dv_h/dt = f_teacher + F_m - b v_h
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError
from ..humans import Intent, Plan, Yielding
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


class SimulatedTeacher:
    """Implements `HapticDevice`: leads by `plan`, follows by `yielding`, or shares with both. Lengths in device scale.

    static_force   (d,) [N] the handle force at rest (the rendered weight), which the teacher carries without thinking
    moving         index of the axis he moves along; the others he holds
    """

    def __init__(
        self,
        *,
        plan: Plan | None = None,
        yielding: Yielding | None = None,
        hand: TeacherHand = TeacherHand(),
        static_force: Array,
        moving: int = 0,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        if plan is None and yielding is None:
            raise ParameterError("a teacher leads (plan), follows (yielding) or shares (both); got neither")
        self.hand = hand
        self._static = [float(f) for f in static_force]
        self._intents = [Intent(plan, yielding, substep_s) for _ in self._static]
        for i in range(len(self._static)):
            if i != moving:
                self._intents[i] = Intent(None, None, substep_s)
        self._substep, self._rng = substep_s, rng
        self.reset()

    def reset(self) -> None:
        d = len(self._static)
        self.time = 0.0
        self._x, self._v = [0.0] * d, [0.0] * d
        for intent in self._intents:
            intent.reset()

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
        hand = self.hand
        x_e, v_e, a_d = self._intents[i].step(self.time)
        self._intents[i].feel(f_m - self._static[i], self._v[i])
        f_teacher = hand.stiffness_n_per_m * (x_e - self._x[i]) + hand.damping_ns_per_m * (v_e - self._v[i])
        f_teacher += hand.mass_kg * a_d - self._static[i] + 0.02 * float(self._rng.standard_normal())
        self._v[i] += h * (f_teacher + f_m - hand.device_friction_ns_per_m * self._v[i]) / hand.mass_kg
        self._x[i] += h * self._v[i]
