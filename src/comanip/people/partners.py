"""Partners: people as they pull on the other end of the beam.

Each is an impedance around an equilibrium that moves (`comanip.people.intent`; numbers: Mussa-Ivaldi, Burdet,
Tsuji for stiffness, Reed and Peshkin for dyads):

    f = K (x_e - x) + B (v_e - v) + F_stat + m_ff a_d + noise

leader    x_e is a minimum-jerk plan of its own
follower  x_e yields to e = F_stat - f, the pull felt beyond the share of weight carried
sharing   both at once: there is a plan, and it yields to what was not expected, e = F_stat + m_ff a_d - f
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import pi
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import STANDARD_GRAVITY, Array
from ..kernels import layouts
from .intent import Course, Intent, Legs, Noise, Plan, Unsteadiness, Yielding, minimum_jerk

__all__ = [
    "Arm",
    "Course",
    "HumanFollower",
    "HumanLeader",
    "HumanSharing",
    "Legs",
    "Plan",
    "Unsteadiness",
    "Yielding",
    "dyad",
    "minimum_jerk",
]


@dataclass(frozen=True)
class Arm:
    """The impedance of a holding arm and the weight its owner expects to carry."""

    stiffness_n_per_m: float = 120.0
    damping_ns_per_m: float = 20.0
    carried_n: float = 0.5 * 2.0 * STANDARD_GRAVITY  # F_stat, along "z"
    unsteadiness: Unsteadiness = field(default_factory=Unsteadiness)

    def __post_init__(self) -> None:
        if not (self.stiffness_n_per_m > 0 and self.damping_ns_per_m >= 0):
            raise ParameterError(
                f"an arm needs stiffness > 0 and damping >= 0; got {self.stiffness_n_per_m} N/m, {self.damping_ns_per_m} N s/m"
            )


class Person(NamedTuple):
    """A human by numbers, as kernels/_beam.h takes one.

    numbers (16,) its Human; along (d, 4) whether it moves along an axis, what it carries there, its origin, the phase of the
    tremor; legs (n, 2 + d) and curve (T, 3, d) of the plan, with the curve's start and step [s]; late, the delay in sub-steps;
    rng, where the unsteadiness comes from
    """

    numbers: Array
    along: Array
    legs: Array
    curve: Array
    clock: Array
    late: int
    rng: np.random.Generator


class _Human:
    """The one model behind the three: along the axes `moving` it goes as it intends, and it holds the others.

    plan      a `Course` moves along all axes; a `Plan` or `Legs` is the same motion along each axis of `moving`
    carried   (d,) [N] the share of the weight along each axis; default: all of `arm.carried_n` along "z"
    """

    def __init__(
        self,
        plan: Plan | Legs | Course | None,
        yielding: Yielding | None,
        arm: Arm,
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str | tuple[str, ...] = "z",
        carried: Sequence[float] | None = None,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        self.arm, self.axes = arm, axes
        self._plan, self._yielding = plan, yielding
        self._feedforward = plan.feedforward_kg if plan else 0.0
        self._moving = _moves(plan, axes, moving)
        self._carried = tuple(arm.carried_n if name == "z" else 0.0 for name in axes) if carried is None else _each(carried, axes)
        self._intents = [
            Intent(plan.along(i) if isinstance(plan, Course) else plan, yielding, substep_s)
            if m
            else Intent(None, None, substep_s)
            for i, m in enumerate(self._moving)
        ]
        self._noise = [Noise(arm.unsteadiness, substep_s, rng) for _ in axes]
        self._origin = [0.0] * len(axes)

    def reset(self, position: Array) -> None:
        self._origin = [float(p) for p in position]
        for noise, intent in zip(self._noise, self._intents, strict=True):
            noise.reset()
            intent.reset()

    def by_numbers(self) -> Person | None:
        """This human after a reset, and until the next one; None for one who is not wholly of this module."""
        ours = type(self) in (HumanLeader, HumanFollower, HumanSharing) and type(self._plan) in (Plan, Legs, Course, type(None))
        asked = "force" in vars(self) or len(self._origin) != len(self.axes)  # by somebody who knows better, or wrongly
        if not ours or asked or any(noise.block for noise in self._noise):
            return None
        arm, noise, y = self.arm, self._noise[0], self._yielding or Yielding()
        kind, intent = noise.kind, next((i for i, m in zip(self._intents, self._moving, strict=True) if m), self._intents[0])
        numbers = {
            "stiffness_n_per_m": arm.stiffness_n_per_m,
            "damping_ns_per_m": arm.damping_ns_per_m,
            "feedforward": self._feedforward,
            "yields": self._yielding is not None,
            "yielding_ns_per_m": y.damping_ns_per_m,
            "persistence": y.persistence,
            "lag_s": y.lag_s,
            "dead_zone_n": y.dead_zone_n,
            "mix": intent.mix,
            "intent_step_s": intent.step_s,
            "keep": noise.keep,
            "fresh": noise.fresh,
            "relative": kind.relative,
            "absolute_n": kind.absolute_n,
            "tremor_n": kind.tremor_n,
            "phase_step": 2 * pi * kind.tremor_hz * noise.step,
        }
        along = np.column_stack([self._moving, self._carried, self._origin, [n.phase for n in self._noise]])
        return Person(layouts.packed("person", numbers), along, *self._plan_by_numbers(), intent.late, noise.rng)

    def _plan_by_numbers(self) -> tuple[Array, Array, Array]:
        """Legs, curve and its clock as `Person` holds them."""
        plan, d = self._plan, len(self.axes)
        if isinstance(plan, Course):
            legs = np.array([[a, t, *far] for a, t, far in plan.legs]).reshape(-1, 2 + d)
            curve = plan.curve
            if curve is None:
                return legs, np.zeros((0, 3, d)), np.array([0.0, 1.0])
            return legs, curve.table, np.array([curve.start_s, curve.step_s])
        one = () if plan is None else plan.legs if isinstance(plan, Legs) else ((plan.onset_s, plan.duration_s, plan.lift_m),)
        legs = np.array([[a, t, *[far * m for m in self._moving]] for a, t, far in one]).reshape(-1, 2 + d)
        return legs, np.zeros((0, 3, d)), np.array([0.0, 1.0])

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        arm = self.arm
        for i, intent in enumerate(self._intents):
            v = float(velocity[i])
            x_e, v_e, a_d = intent.step(time)
            expected = self._carried[i] + self._feedforward * a_d
            off = self._origin[i] + x_e - float(position[i])
            force = arm.stiffness_n_per_m * off + arm.damping_ns_per_m * (v_e - v) + expected
            force += self._noise[i].sample(force)
            intent.feel(expected - force, v)
            out[i] = force


def _moves(plan: Plan | Legs | Course | None, axes: tuple[str, ...], moving: str | tuple[str, ...]) -> tuple[float, ...]:
    """1 for each axis that somebody moves along, else 0."""
    if isinstance(plan, Course):
        if plan.n_axes != len(axes):
            raise ParameterError(f"the course has {plan.n_axes} axes; the partner's are {', '.join(axes)}")
        return (1.0,) * len(axes)
    names = (moving,) if isinstance(moving, str) else tuple(moving)
    return tuple(1.0 if name in names else 0.0 for name in axes)


def _each(values: Sequence[float], axes: tuple[str, ...]) -> tuple[float, ...]:
    if len(values) != len(axes):
        raise ParameterError(f"carried has {len(values)} entries; allowed: {len(axes)}, one an axis ({', '.join(axes)})")
    return tuple(float(v) for v in values)


class _Planning(_Human):
    """Whoever has a plan. `goal` (d,) [m] is where the far end is meant to be in the end."""

    plan: Plan | Legs | Course

    @property
    def goal(self) -> Array:
        if isinstance(self.plan, Course):
            return np.array(self._origin) + self.plan.end
        return np.array([o + s * self.plan.lift_m for o, s in zip(self._origin, self._moving, strict=True)])


class HumanLeader(_Planning):
    """A partner with a plan, who does not give way."""

    def __init__(
        self,
        plan: Plan | Legs | Course = Plan(),
        arm: Arm = Arm(),
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str | tuple[str, ...] = "z",
        carried: Sequence[float] | None = None,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(plan, None, arm, axes=axes, moving=moving, carried=carried, substep_s=substep_s, rng=rng)
        self.plan = plan


class HumanFollower(_Human):
    """A partner who goes where the hand leads, by force alone, with a person's delay."""

    def __init__(
        self,
        yielding: Yielding = Yielding(),
        arm: Arm = Arm(stiffness_n_per_m=90.0, damping_ns_per_m=22.0),
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str | tuple[str, ...] = "z",
        carried: Sequence[float] | None = None,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(None, yielding, arm, axes=axes, moving=moving, carried=carried, substep_s=substep_s, rng=rng)
        self.yielding = yielding
        self.reset(np.zeros(len(axes)))  # draws a phase of the tremor: the published figures rest on this order of draws


class HumanSharing(_Planning):
    """A partner without a role: knows about where to and when, and gives way to what is felt of the other's plan."""

    def __init__(
        self,
        plan: Plan | Legs | Course = Plan(),
        yielding: Yielding = Yielding(),
        arm: Arm = Arm(stiffness_n_per_m=100.0, damping_ns_per_m=20.0),
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str | tuple[str, ...] = "z",
        carried: Sequence[float] | None = None,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(plan, yielding, arm, axes=axes, moving=moving, carried=carried, substep_s=substep_s, rng=rng)
        self.plan, self.yielding = plan, yielding


def dyad(rng: np.random.Generator, arm: Arm, spread: float = 0.15) -> Arm:
    """The same person on another day: stiffness and damping vary together by `spread` (1 s.d.)."""
    check_generator(rng)
    factor = float(np.clip(rng.normal(1.0, spread), 0.5, 1.5))
    return replace(arm, stiffness_n_per_m=arm.stiffness_n_per_m * factor, damping_ns_per_m=arm.damping_ns_per_m * factor)
