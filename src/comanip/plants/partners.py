"""Partners: people as they pull on the other end, and recorded force replayed.

The two human models are impedances around an equilibrium that moves (physics: docs/physics.md; numbers: Mussa-Ivaldi, Burdet,
Tsuji for stiffness, Reed and Peshkin for dyads):

    f = K (x_e - x) + B (v_e - v) + F_stat + m_ff a_d + noise

leader    x_e = x_0 + A mj((t - t_0)/T), a minimum-jerk plan of his own
follower  T_a dv_e/dt = -v_e + dz(e(t - tau), dead zone)/D + rho v(t - tau), dx_e/dt = v_e, where e = F_stat - f is the pull he
          feels beyond the share of weight he carries; e and v pass a 6 Hz filter and his own delay tau
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from math import exp, pi, sin, sqrt

import numpy as np

from ..errors import ParameterError
from ..interfaces import STANDARD_GRAVITY, Array


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
class Unsteadiness:
    """Why a hand is never still: force noise that grows with force, and tremor."""

    relative: float = 0.03  # standard deviation, share of |f|
    absolute_n: float = 0.05
    time_constant_s: float = 0.08
    tremor_n: float = 0.07
    tremor_hz: float = 10.0


class _Noise:
    """Coloured noise and tremor, one stream an axis, drawn in blocks because single draws are slow."""

    def __init__(self, kind: Unsteadiness, step: float, rng: np.random.Generator) -> None:
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
        if not self.block:
            self.block = self.rng.standard_normal(2048).tolist()
        kind = self.kind
        self.value = self.keep * self.value + self.fresh * self.block.pop()
        self.phase += 2 * pi * kind.tremor_hz * self.step
        return self.value * (kind.relative * abs(force) + kind.absolute_n) + kind.tremor_n * sin(self.phase)


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


@dataclass(frozen=True)
class Plan:
    """Where a leader means to go: a minimum-jerk lift of `lift_m` in `duration_s` that starts at `onset_s`."""

    lift_m: float = 0.30
    duration_s: float = 2.2
    onset_s: float = 1.0
    feedforward_kg: float = 1.0  # m_ff: how much of the load's inertia he anticipates


@dataclass(frozen=True)
class Yielding:
    """How a follower moves with what he feels."""

    damping_ns_per_m: float = 25.0  # D: pull [N] it takes for 1 m/s
    persistence: float = 0.5  # rho: share of the felt speed that he keeps up by himself
    lag_s: float = 0.10  # T_a
    delay_s: float = 0.15  # tau, haptic voluntary reaction
    dead_zone_n: float = 0.8
    felt_bandwidth_hz: float = 6.0


class _Human:
    """What both models share: the arm, the axes, the noise."""

    def __init__(self, arm: Arm, *, axes: tuple[str, ...], moving: str, substep_s: float, rng: np.random.Generator) -> None:
        self.arm, self.axes = arm, axes
        self._step = substep_s
        self._moving = tuple(1.0 if name == moving else 0.0 for name in axes)
        self._carried = tuple(arm.carried_n if name == "z" else 0.0 for name in axes)
        self._noise = [_Noise(arm.unsteadiness, substep_s, rng) for _ in axes]
        self._origin = [0.0] * len(axes)

    def reset(self, position: Array) -> None:
        self._origin = [float(p) for p in position]
        for noise in self._noise:
            noise.reset()

    def _pull(self, i: int, x_e: float, v_e: float, x: float, v: float, extra: float) -> float:
        arm = self.arm
        force = arm.stiffness_n_per_m * (x_e - x) + arm.damping_ns_per_m * (v_e - v) + self._carried[i] + extra
        return force + self._noise[i].sample(force)


class HumanLeader(_Human):
    """A partner with a plan of his own. `goal` (d,) [m] is where he means the far end to be in the end."""

    def __init__(
        self,
        plan: Plan = Plan(),
        arm: Arm = Arm(),
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str = "z",
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(arm, axes=axes, moving=moving, substep_s=substep_s, rng=rng)
        self.plan = plan

    @property
    def goal(self) -> Array:
        return np.array([o + s * self.plan.lift_m for o, s in zip(self._origin, self._moving, strict=True)])

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        plan = self.plan
        p, v, a = minimum_jerk((time - plan.onset_s) / plan.duration_s)
        p, v, a = plan.lift_m * p, plan.lift_m * v / plan.duration_s, plan.lift_m * a / plan.duration_s**2
        for i, share in enumerate(self._moving):
            out[i] = self._pull(
                i,
                self._origin[i] + share * p,
                share * v,
                float(position[i]),
                float(velocity[i]),
                plan.feedforward_kg * share * a,
            )


class HumanFollower(_Human):
    """A partner who goes where he is led, by force alone, with a person's delay."""

    def __init__(
        self,
        yielding: Yielding = Yielding(),
        arm: Arm = Arm(stiffness_n_per_m=90.0, damping_ns_per_m=22.0),
        *,
        axes: tuple[str, ...] = ("z",),
        moving: str = "z",
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(arm, axes=axes, moving=moving, substep_s=substep_s, rng=rng)
        self.yielding = yielding
        self._mix = 1.0 - exp(-2 * pi * yielding.felt_bandwidth_hz * substep_s)
        self.reset(np.zeros(len(axes)))

    def reset(self, position: Array) -> None:
        super().reset(position)
        d = len(self.axes)
        late = max(1, round(self.yielding.delay_s / self._step))
        self._x_e, self._v_e = list(self._origin), [0.0] * d
        self._felt, self._speed = [0.0] * d, [0.0] * d
        self._past = [deque([(0.0, 0.0)] * late, maxlen=late) for _ in range(d)]
        self._last = list(self._carried)

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        y, h, mix = self.yielding, self._step, self._mix
        for i, share in enumerate(self._moving):
            x, v = float(position[i]), float(velocity[i])
            pull, speed = self._past[i][0]
            dead = y.dead_zone_n
            beyond = pull - dead if pull > dead else pull + dead if pull < -dead else 0.0
            wanted = share * (beyond / y.damping_ns_per_m + y.persistence * speed)
            self._v_e[i] += h / y.lag_s * (wanted - self._v_e[i])
            self._x_e[i] += h * self._v_e[i]
            self._last[i] = self._pull(i, self._x_e[i], self._v_e[i], x, v, 0.0)
            self._felt[i] += mix * (self._carried[i] - self._last[i] - self._felt[i])
            self._speed[i] += mix * (v - self._speed[i])
            self._past[i].append((self._felt[i], self._speed[i]))
            out[i] = self._last[i]


def dyad(rng: np.random.Generator, arm: Arm, spread: float = 0.15) -> Arm:
    """The same person on another day: stiffness and damping vary together by `spread` (1 s.d.)."""
    factor = float(np.clip(rng.normal(1.0, spread), 0.5, 1.5))
    return replace(arm, stiffness_n_per_m=arm.stiffness_n_per_m * factor, damping_ns_per_m=arm.damping_ns_per_m * factor)
