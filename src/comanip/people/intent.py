"""A person's side of a shared task: how the hand is meant to move, and why it is never still.

One model serves the partner at the beam (`people.partners`) and the teacher on the handle (`people.teacher`). The hand is an
impedance around an equilibrium x_e that moves by a plan, by what it feels, or by both at once:

    x_e = A mj((t - t_0)/T) + c        T_a dv_c/dt = -v_c + dz(e(t - tau), dead zone)/D + rho u(t - tau),   dc/dt = v_c

e is the pull beyond what the person expects to carry, u the speed beyond the own plan; both pass a 6 Hz filter and the delay
tau. A plan alone leads, yielding alone follows, both together share: nobody was told a role. Numbers: minimum jerk from Flash
and Hogan, delays and dead zone as in haptic tracking, sharing as in Reed and Peshkin's dyads (docs/physics.md).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from math import exp, pi, sin, sqrt

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Array

BLOCK = 2048  # normal numbers drawn at once; kernels/_beam.h knows it


def minimum_jerk(s: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of the unit minimum-jerk motion at phase s, clamped to [0, 1]."""
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    return (
        s * s * s * (10.0 + s * (-15.0 + 6.0 * s)),
        s * s * (30.0 + s * (-60.0 + 30.0 * s)),
        s * (60.0 + s * (-180.0 + 120.0 * s)),
    )


@dataclass(frozen=True)
class Plan:
    """Where somebody means to go: a minimum-jerk lift of `lift_m` in `duration_s` that starts at `onset_s`."""

    lift_m: float = 0.30
    duration_s: float = 2.2
    onset_s: float = 1.0
    feedforward_kg: float = 1.0  # m_ff: how much of the load's inertia is anticipated

    def __post_init__(self) -> None:
        if not self.duration_s > 0:
            raise ParameterError(f"a plan's duration_s must be positive; got {self.duration_s}")

    def at(self, time: float) -> tuple[float, float, float]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] meant at `time` [s]."""
        p, v, a = minimum_jerk((time - self.onset_s) / self.duration_s)
        return self.lift_m * p, self.lift_m * v / self.duration_s, self.lift_m * a / self.duration_s**2


@dataclass(frozen=True)
class Legs:
    """A plan of several minimum-jerk legs: (start [s], duration [s], how far [m]), one after the other or overlapping."""

    legs: tuple[tuple[float, float, float], ...]
    feedforward_kg: float = 1.0

    @property
    def lift_m(self) -> float:
        return sum(far for _, _, far in self.legs)

    def at(self, time: float) -> tuple[float, float, float]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] meant at `time` [s]."""
        x = v = a = 0.0
        for start, duration, far in self.legs:
            p, dp, ddp = minimum_jerk((time - start) / duration)
            x, v, a = x + far * p, v + far * dp / duration, a + far * ddp / duration**2
        return x, v, a


@dataclass(frozen=True, eq=False)
class Curve:
    """A motion given by dense samples, for what legs cannot say (circles): held before its first sample and after its last.

    table   (T, 3, d) displacement [m], velocity [m/s] and acceleration [m/s^2] every `step_s` from `start_s` on, at rest at both
            ends; between samples each of the three is on the straight line
    """

    start_s: float
    step_s: float
    table: Array

    def __post_init__(self) -> None:
        table = np.array(self.table, dtype=float)
        if table.ndim != 3 or table.shape[1] != 3 or len(table) < 2 or not self.step_s > 0:
            raise ParameterError(f"a curve is (T >= 2, 3, d) every step_s > 0; got {table.shape} every {self.step_s} s")
        if not np.isfinite(table).all() or table[[0, -1], 1:].any():
            raise ParameterError("a curve must be finite, and at rest at both ends: velocity and acceleration 0")
        table.setflags(write=False)
        object.__setattr__(self, "table", table)

    @classmethod
    def through(cls, start_s: float, step_s: float, displacement: Array) -> Curve:
        """Through displacements (T, d) [m]; velocity and acceleration are their central differences."""
        velocity = np.gradient(displacement, step_s, axis=0)
        velocity[[0, -1]] = 0.0
        acceleration = np.gradient(velocity, step_s, axis=0)
        acceleration[[0, -1]] = 0.0
        return cls(start_s, step_s, np.stack([displacement, velocity, acceleration], axis=1))

    @property
    def stop_s(self) -> float:
        return self.start_s + self.step_s * (len(self.table) - 1)

    def sampled(self, times_s: Array) -> Array:
        """Displacement (T, d) [m] at `times_s` (T,) [s]."""
        last = len(self.table) - 1
        place = np.clip((times_s - self.start_s) / self.step_s, 0.0, float(last))
        n = np.minimum(place.astype(int), last - 1)
        share = (place - n)[:, None]
        return np.asarray((1.0 - share) * self.table[n, 0] + share * self.table[n + 1, 0])


@dataclass(frozen=True, eq=False)
class Course:
    """Where somebody means to go in d axes, from where it began: minimum-jerk legs and, added to them, a sampled curve.

    legs   ((start [s], duration [s], displacement (d,) [m]), ...), one after the other or overlapping, which rounds a corner;
           with one axis a displacement may be a number
    """

    legs: tuple[tuple[float, float, tuple[float, ...]], ...] = ()
    curve: Curve | None = None
    feedforward_kg: float = 1.0  # m_ff: how much of the load's inertia is anticipated

    def __post_init__(self) -> None:
        legs = tuple((float(a), float(t), tuple(np.atleast_1d(np.asarray(far, dtype=float)).tolist())) for a, t, far in self.legs)
        object.__setattr__(self, "legs", legs)
        sizes = {len(far) for _, _, far in legs} | ({self.curve.table.shape[2]} if self.curve is not None else set())
        if len(sizes) != 1:
            raise ParameterError(f"a course needs legs or a curve, all with the same axes; got {sorted(sizes)} axes")
        if any(not duration > 0 for _, duration, _ in legs):
            raise ParameterError(f"legs of a course need durations > 0 s; got {[t for _, t, _ in legs]}")

    @classmethod
    def still(cls, n_axes: int, feedforward_kg: float = 1.0) -> Course:
        """Of somebody who means to stay where it began."""
        return cls(((0.0, 1.0, (0.0,) * n_axes),), feedforward_kg=feedforward_kg)

    @property
    def n_axes(self) -> int:
        return len(self.legs[0][2]) if self.legs else int(self.curve.table.shape[2])  # type: ignore[union-attr]

    @property
    def start_s(self) -> float:
        """When the motion begins [s]."""
        return min([a for a, _, _ in self.legs] + ([self.curve.start_s] if self.curve is not None else []))

    @property
    def stop_s(self) -> float:
        """When it has come to its end [s]."""
        return max([a + t for a, t, _ in self.legs] + ([self.curve.stop_s] if self.curve is not None else []))

    @property
    def end(self) -> Array:
        """Displacement (d,) [m] in the end."""
        sums = [sum(far[i] for _, _, far in self.legs) for i in range(self.n_axes)]
        return np.array(sums, dtype=float) + (self.curve.table[-1, 0] if self.curve is not None else 0.0)

    def divided(self, by: float, feedforward_kg: float) -> Course:
        """The same motion in another scale, for somebody who anticipates another mass."""
        legs = tuple((a, t, tuple(x / by for x in far)) for a, t, far in self.legs)
        curve = None if self.curve is None else replace(self.curve, table=self.curve.table / by)
        return Course(legs, curve, feedforward_kg)

    def along(self, axis: int) -> Along:
        """The same, of one axis."""
        rows = None if self.curve is None else self.curve.table[:, :, axis].tolist()
        clock = (0.0, 1.0) if self.curve is None else (self.curve.start_s, self.curve.step_s)
        return Along(tuple((a, t, far[axis]) for a, t, far in self.legs), rows, clock)

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        """Displacement [m], velocity [m/s] and acceleration [m/s^2], (d,) each, meant at `time_s` [s]."""
        x, v, a = np.array([self.along(i).at(time_s) for i in range(self.n_axes)]).T
        return x, v, a

    def sampled(self, times_s: Array) -> Array:
        """Displacement (T, d) [m] at `times_s` (T,) [s]."""
        times = np.asarray(times_s, dtype=float)
        x = np.zeros((len(times), self.n_axes))
        for start, duration, far in self.legs:  # in the order of Along.at, so to the same bits
            s = np.clip((times - start) / duration, 0.0, 1.0)
            x = x + np.array(far) * (s * s * s * (10.0 + s * (-15.0 + 6.0 * s)))[:, None]
        return x if self.curve is None else x + self.curve.sampled(times)


@dataclass(frozen=True, eq=False)
class Along:
    """One axis of a `Course`, in plain floats: kernels/_beam.h adds in the same order."""

    legs: tuple[tuple[float, float, float], ...]
    rows: list[list[float]] | None = field(default=None, repr=False)
    clock: tuple[float, float] = (0.0, 1.0)

    def at(self, time: float) -> tuple[float, float, float]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] meant at `time` [s]."""
        x = v = a = 0.0
        for start, duration, far in self.legs:
            p, dp, ddp = minimum_jerk((time - start) / duration)
            x, v, a = x + far * p, v + far * dp / duration, a + far * ddp / duration**2
        if self.rows is None:
            return x, v, a
        last = len(self.rows) - 1
        place = min(max((time - self.clock[0]) / self.clock[1], 0.0), float(last))
        n = min(int(place), last - 1)
        share = place - n
        one, other = self.rows[n], self.rows[n + 1]
        return (
            x + ((1.0 - share) * one[0] + share * other[0]),
            v + ((1.0 - share) * one[1] + share * other[1]),
            a + ((1.0 - share) * one[2] + share * other[2]),
        )


@dataclass(frozen=True)
class Yielding:
    """How somebody moves with what is felt."""

    damping_ns_per_m: float = 25.0  # D: pull [N] it takes for 1 m/s
    persistence: float = 0.5  # rho: share of the felt speed that is kept up without being felt
    lag_s: float = 0.10  # T_a
    delay_s: float = 0.15  # tau, haptic voluntary reaction
    dead_zone_n: float = 0.8
    felt_bandwidth_hz: float = 6.0

    def __post_init__(self) -> None:
        for name in ("damping_ns_per_m", "lag_s", "felt_bandwidth_hz"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"yielding: {name} must be positive; got {getattr(self, name)}")


class Intent:
    """One axis of where a person means the hand to be. `step` says it, `feel` tells what came of it.

    plan, yielding   either or both; neither is a hand that stays where it is
    step_s           [s] between two calls of `step`
    """

    def __init__(self, plan: Plan | Legs | Along | None, yielding: Yielding | None, step_s: float) -> None:
        self.plan, self.yielding, self.step_s = plan, yielding, step_s
        self.mix = 1.0 - exp(-2 * pi * yielding.felt_bandwidth_hz * step_s) if yielding else 0.0
        self.late = max(1, round(yielding.delay_s / step_s)) if yielding else 1
        self.reset()

    def reset(self) -> None:
        self._correction = self._correction_speed = 0.0
        self._felt = self._surplus = self._planned_speed = 0.0
        self._past = deque([(0.0, 0.0)] * self.late, maxlen=self.late)

    def step(self, time: float) -> tuple[float, float, float]:
        """Equilibrium [m] from the start, its velocity [m/s] and the planned acceleration [m/s^2] at `time` [s]."""
        x, v, a = self.plan.at(time) if self.plan else (0.0, 0.0, 0.0)
        self._planned_speed = v
        y = self.yielding
        if y is None:
            return x, v, a
        pull, surplus = self._past[0]
        dead = y.dead_zone_n
        beyond = pull - dead if pull > dead else pull + dead if pull < -dead else 0.0
        wanted = beyond / y.damping_ns_per_m + y.persistence * surplus
        self._correction_speed += self.step_s / y.lag_s * (wanted - self._correction_speed)
        self._correction += self.step_s * self._correction_speed
        return x + self._correction, v + self._correction_speed, a

    def feel(self, pull: float, speed: float) -> None:
        """`pull` e [N]: force on the hand beyond what is expected; `speed` [m/s] of the hand."""
        if self.yielding is None:
            return
        self._felt += self.mix * (pull - self._felt)
        self._surplus += self.mix * (speed - self._planned_speed - self._surplus)
        self._past.append((self._felt, self._surplus))


@dataclass(frozen=True)
class Unsteadiness:
    """Why a hand is never still: force noise that grows with force, and tremor."""

    relative: float = 0.03  # standard deviation, share of |f|
    absolute_n: float = 0.05
    time_constant_s: float = 0.08
    tremor_n: float = 0.07
    tremor_hz: float = 10.0


class Noise:
    """Coloured noise and tremor of one axis, drawn in blocks because single draws are slow."""

    def __init__(self, kind: Unsteadiness, step: float, rng: np.random.Generator) -> None:
        check_generator(rng)
        self.kind, self.rng = kind, rng
        self.keep = exp(-step / kind.time_constant_s)
        self.fresh = sqrt(1.0 - self.keep**2)
        self.step = step
        self.value, self.phase = 0.0, 0.0
        self.block: list[float] = []

    def reset(self) -> None:
        self.value = 0.0
        self.block = []
        self.phase = float(self.rng.uniform(0, 2 * pi))

    def sample(self, force: float) -> float:
        """The next disturbance [N] of a hand that exerts `force` [N]."""
        if not self.block:
            self.block = self.rng.standard_normal(BLOCK).tolist()
        kind = self.kind
        self.value = self.keep * self.value + self.fresh * self.block.pop()
        self.phase += 2 * pi * kind.tremor_hz * self.step
        return self.value * (kind.relative * abs(force) + kind.absolute_n) + kind.tremor_n * sin(self.phase)
