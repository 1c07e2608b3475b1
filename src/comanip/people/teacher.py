"""The teacher: the model of `comanip.people.intent` with the hand on a haptic handle (`devices.phantom.HeldHandle`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Array
from .intent import Course, Intent, Plan, Yielding


@dataclass(frozen=True)
class TeacherHand:
    """A teacher's arm on the stylus. A follower's arm is softer than a leader's. Grips: light 0.15 kg, 40 N/m, 2 N s/m; normal
    0.5, 100, 8; stiff 0.8, 300, 20 (ranges of stylus grips: Fu and Cavusoglu, 15 subjects).
    """

    mass_kg: float = 0.5
    stiffness_n_per_m: float = 150.0
    damping_ns_per_m: float = 15.0

    def __post_init__(self) -> None:
        if not (self.mass_kg > 0 and self.stiffness_n_per_m > 0):
            raise ParameterError(f"a hand needs mass and stiffness > 0; got {self.mass_kg} kg, {self.stiffness_n_per_m} N/m")


class Teacher:
    """Leads by `plan`, follows by `yielding`, or shares with both; with neither it holds still. Implements `Person`.

    static_force   (d,) [N] the handle force at rest (the rendered weight), carried without thinking
    plan           a `Course` moves along all axes; a `Plan` along `moving`
    moving         index of the axis, or of the axes, that the hand moves along; the others it holds
    """

    def __init__(
        self,
        *,
        plan: Plan | Course | None = None,
        yielding: Yielding | None = None,
        hand: TeacherHand = TeacherHand(),
        static_force: Array,
        moving: int | Sequence[int] = 0,
        substep_s: float = 0.001,
        unsteady_n: float = 0.02,
        rng: np.random.Generator,
    ) -> None:
        self.hand, self.mass_kg = hand, hand.mass_kg
        self._static = [float(f) for f in static_force]
        n = len(self._static)
        along = range(n) if isinstance(plan, Course) else (moving,) if isinstance(moving, int) else tuple(moving)
        self._intents = [
            Intent(plan.along(i) if isinstance(plan, Course) else plan, yielding, substep_s)
            if i in along
            else Intent(None, None, substep_s)
            for i in range(n)
        ]
        self._feedforward = plan.feedforward_kg if plan else 0.0
        check_generator(rng)
        self._unsteady, self._rng = unsteady_n, rng

    def reset(self) -> None:
        for intent in self._intents:
            intent.reset()

    def force(self, time: float, position: list[float], velocity: list[float], felt: list[float]) -> list[float]:
        hand, out = self.hand, []
        for i, intent in enumerate(self._intents):
            x_e, v_e, a_d = intent.step(time)
            intent.feel(felt[i] - self._static[i], velocity[i])
            force = hand.stiffness_n_per_m * (x_e - position[i]) + hand.damping_ns_per_m * (v_e - velocity[i])
            force += self._feedforward * a_d - self._static[i] + self._unsteady * float(self._rng.standard_normal())
            out.append(force)
        return out
