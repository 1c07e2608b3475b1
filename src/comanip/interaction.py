"""Eq. (3): from the force that a wrist sensor feels to the force that the partner means.

    F = F_s + s m (a - g)

F_s is the force of the OBJECT ON THE HAND, s the hand's share of the object (0.5 for two partners, the paper's
footnote 1), m its mass, a the hand's acceleration and g gravity as a vector, (0, 0, -9.80665) m/s^2 for x, y, z up.
The paper prints F = F_s - (m/2)(a - g): read with g = +9.81 the weight cancels but the inertia doubles. With the sign
above the load's weight AND its inertia vanish, and F > 0 when the partner lifts while the hand is still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .errors import ParameterError
from .interfaces import STANDARD_GRAVITY, Array, Observation
from .signals import sphere
from .signals.filters import Lowpass
from .signals.vectors import dot

MOST_GAP_S = 0.05  # between two samples of a slow sensor
# a low-pass is late by 0.225 / cutoff: at 15 Hz by 15 ms, and an arm of 1 kg or more on its grip then shakes at 6-8 Hz
CUTOFF_HZ = 40.0
MOST_OF_THE_RATE = 0.4  # a filter may not be faster than this share of the rate
MAX_FORCE = 1e6  # [N] beyond any sensor of a hand: treated as missing, so that one wild sample cannot ring for seconds


def felt_cutoff_hz(dt: float) -> float:
    """Low-pass of the force estimate [Hz] of a loop of period `dt` [s], unless another is asked for."""
    return min(CUTOFF_HZ, MOST_OF_THE_RATE / dt)


def gravity_along(axes: Sequence[str]) -> Array:
    """Gravity in the task frame, (d,) [m/s^2]: -9.80665 along the axis named "z", zero along the others."""
    return np.array([-STANDARD_GRAVITY if axis == "z" else 0.0 for axis in axes])


def interaction_force(
    sensor_force: Array, acceleration: Array, *, mass_kg: float | Array, load_share: float = 0.5, gravity: Array
) -> Array:
    """Eq. (3), F = F_s + s m (a - g); (T, d) or (d,) [N] from F_s [N], a [m/s^2] and g (d,) [m/s^2].

    mass_kg   one number, or (d,) where inertia differs by axis: an angle at its lever
    The same low-pass must have been applied to F_s and a, or their delay shows up as a force that nobody exerts.
    """
    return np.asarray(sensor_force + load_share * mass_kg * (acceleration - gravity))


class Wrench(NamedTuple):
    """force (T, 3) [N] and torque about the hand's origin (T, 3) [N m], task frame."""

    force: Array
    torque: Array


@dataclass(frozen=True)
class RigidLoad:
    """An object in two hands, for `interaction_wrench`; vectors and matrix in the robot hand's own axes.

    centre_m       (3,) its centre of mass, from the hand's origin [m]
    inertia_kg_m2  (3, 3) about its centre of mass
    partner_m      (3,) where the partner holds it, from the hand's origin [m]; None: on the line through the centre of mass,
                   where the partner's share balances the weight about the hand (the far end of a beam that two share alike)
    share          the robot's, of weight and inertia
    """

    mass_kg: float
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_kg_m2: tuple[tuple[float, float, float], ...] = ((0.0,) * 3,) * 3
    partner_m: tuple[float, float, float] | None = None
    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.mass_kg < math.inf:
            raise ParameterError(f"mass is {self.mass_kg:g} kg; allowed: finite and >= 0")
        if not 0.0 <= self.share <= 1.0:
            raise ParameterError(f"share is {self.share:g}; allowed: 0 to 1")
        for name, shape in (("centre_m", (3,)), ("inertia_kg_m2", (3, 3)), ("partner_m", (3,))):
            value = getattr(self, name)
            if value is not None and (np.shape(value) != shape or not np.isfinite(value).all()):
                raise ParameterError(f"{name} has shape {np.shape(value)}; allowed: {shape}, finite")
        inertia = np.array(self.inertia_kg_m2)
        if not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia)[0] < -1e-12:
            raise ParameterError(
                "inertia_kg_m2 must be symmetric with moments >= 0; products of inertia go in with their minus sign"
            )


def interaction_wrench(
    sensed: Wrench,
    orientation: Array,
    acceleration: Array,
    angular_velocity: Array,
    angular_acceleration: Array,
    *,
    load: RigidLoad,
    gravity: Array,
) -> Wrench:
    """Eq. (3) for force and torque of a rigid load: what the partner does to the hand beyond carrying a share of it.

        F = F_s + s m (a_c - g)
        T = T_s + r_c x m (a_c - g) - r_u x (1 - s) m (a_c - g) + s (I dw + w x I w)

    a_c = a + dw x r_c + w x (w x r_c) is the acceleration of the centre of mass; r_c and r_u go from the hand to the centre of
    mass and to the partner. A partner who carries the share 1 - s of weight and inertia and means nothing else gives F = T = 0,
    so a share of 1 gives the partner's whole wrench about the hand.

    sensed                what the OBJECT does to the hand: F_s, T_s
    orientation           (T, 4) of the hand, w, x, y, z; acceleration (T, 3) of its origin [m/s^2]
    angular_*             (T, 3) [rad/s], [rad/s^2], task frame; gravity (3,) [m/s^2]

    The same low-pass must have been applied to all of them, or their delay shows up as a wrench that nobody exerts.
    """
    turn = sphere.matrix(orientation)
    centre = turn @ np.array(load.centre_m)
    inertia = turn @ np.array(load.inertia_kg_m2) @ np.swapaxes(turn, -1, -2)
    w, dw = np.asarray(angular_velocity), np.asarray(angular_acceleration)
    at_centre = acceleration + np.cross(dw, centre) + np.cross(w, np.cross(w, centre))
    carries = load.mass_kg * (at_centre - gravity)
    # where the partner's share balances the load about the hand, the two moments of weight cancel
    held = centre if load.partner_m is None else centre - (1.0 - load.share) * (turn @ np.array(load.partner_m))
    moment = np.zeros_like(carries) if load.partner_m is None and load.share < 1.0 else np.cross(held, carries)
    spin = np.einsum("...ij,...j->...i", inertia, dw) + np.cross(w, np.einsum("...ij,...j->...i", inertia, w))
    return Wrench(np.asarray(sensed.force + load.share * carries), np.asarray(sensed.torque + moment + load.share * spin))


@dataclass(frozen=True)
class Payload:
    """The object in the hands, and how well it is known.

    mass_kg, mass_std_kg         whole object [kg] (this hand carries load_share of it)
    force_bias_n, bias_std_n     (d,) what the sensor reads with nothing in the hand [N]; empty means zero
    """

    mass_kg: float
    mass_std_kg: float = math.nan
    force_bias_n: tuple[float, ...] = ()
    bias_std_n: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.mass_kg < math.inf:
            raise ParameterError(f"mass is {self.mass_kg:g} kg; allowed: finite and >= 0")


def mean_and_error(values: Array) -> tuple[Array, Array]:
    """Mean over time of (T, d) and its standard error, (d,) each, with the samples' autocorrelation counted.

    Neighbouring samples of a filtered sensor repeat each other: the error of the mean is that of T / tau independent
    samples, tau = 1 + 2 sum(rho_k), summed in pairs until a pair is no longer positive (Geyer's initial sequence).
    """
    mean = values.mean(axis=0)
    errors = [math.sqrt(x.var() * _correlation_samples(x) / len(x)) for x in (values - mean).T]
    return mean, np.array(errors)


def _correlation_samples(x: Array) -> float:
    size = len(x)
    spectrum = np.fft.rfft(x, 2 * size)
    rho = np.fft.irfft(np.abs(spectrum) ** 2)[:size]
    if rho[0] <= 0.0:
        return 1.0
    rho = rho / rho[0]
    pairs = rho[: size // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0.0)
    stop = int(negative[0]) if len(negative) else len(pairs)
    return float(min(max(2.0 * pairs[:stop].sum() - 1.0, 1.0), size))


def identify_payload(
    holding: Array,
    *,
    gravity: Array,
    load_share: float = 0.5,
    empty: Array | None = None,
    force_bias_n: Sequence[float] | None = None,
    mass_kg: float | None = None,
) -> Payload:
    """Mass and sensor bias from windows of F_s at rest (footnote 2), with their standard errors.

    At rest, both holding, F_s = s m g + bias. ONE such pose cannot give both unknowns, so say which one is known:
    `empty`, a window before the grasp, gives the bias and then the mass; `force_bias_n` gives the mass (default: no
    bias, the footnote's m = |mean F_s| / (s g0)); `mass_kg` gives the bias.

    holding, empty   (T, d) [N], hand at rest; gravity (d,) [m/s^2]
    Raises ParameterError for two of the three, where no weight acts along the axes, or if the mass comes out negative.
    """
    known = [n for n, v in (("empty", empty), ("force_bias_n", force_bias_n), ("mass_kg", mass_kg)) if v is not None]
    if len(known) > 1:
        raise ParameterError(f"{' and '.join(known)} are given; allowed: one of empty, force_bias_n, mass_kg")
    holding = _window("holding", holding, len(gravity))
    mean, error = mean_and_error(holding)
    if mass_kg is not None:
        bias = mean - load_share * mass_kg * gravity
        return Payload(mass_kg, 0.0, tuple(bias.tolist()), tuple(error.tolist()))
    bias, bias_error = np.zeros(len(gravity)), np.zeros(len(gravity))
    if empty is not None:
        bias, bias_error = mean_and_error(_window("empty", empty, len(gravity)))
    elif force_bias_n is not None:
        bias = np.asarray(force_bias_n, dtype=np.float64)
    square = float(gravity @ gravity)
    if square == 0.0 or load_share <= 0.0:
        raise ParameterError("no weight acts along these axes; a mass needs the vertical axis and load_share > 0")
    mass = float((mean - bias) @ gravity) / (load_share * square)
    if mass < 0.0:
        raise ParameterError(
            f"mass comes out as {mass:.3g} kg: F_s must be the force of the object on the hand (negative at rest, up "
            "positive); flip the column's sign or give the bias"
        )
    mass_std = math.sqrt(float(gravity**2 @ (error**2 + bias_error**2))) / (load_share * square)
    return Payload(mass, mass_std, tuple(bias.tolist()), tuple(bias_error.tolist()))


def _window(name: str, values: Array, n_axes: int) -> Array:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != n_axes or len(values) < 2 or not np.isfinite(values).all():
        raise ParameterError(f"{name} has shape {values.shape}; a window is (T >= 2, {n_axes}) of finite forces [N]")
    return values


class CausalInteractionForce:
    """Eq. (3) tick by tick: the causal twin of what `demonstration` does with a recording.

    Fills `obs.force` from `obs.sensor_force` and `obs.velocity`. The sum F_s + s m (a - g) is filtered, so F_s and a
    pass the SAME low-pass, of `felt_cutoff_hz` where none is given. a is a backward difference, half a tick late; F_s is
    matched to it (mean of two ticks), or, where the sensor itself is later than that (`force_delay_s`), a waits for F_s. A
    sensor that averages over a tick, as anti-aliased ones do, is half a tick later than its own delay.

    A tick whose input is missing (NaN, infinite, beyond 1e6 N) gives NaN and leaves the filter as it was; the next good
    tick differentiates over the hole. Of a sensor slower than the ticks, which gives NaN between its samples, the last one
    stays good for `sensor_period_s` and half as long again.
    """

    def __init__(
        self,
        dt: float,
        *,
        mass_kg: float | Sequence[float],
        gravity: Sequence[float],
        load_share: float = 0.5,
        bias: Sequence[float] = (),
        cutoff_hz: float | None = None,
        force_delay_s: float = 0.0,
        sensor_period_s: float = 0.0,
    ) -> None:
        """`gravity`, `bias`: (d,) [m/s^2], [N]; `mass_kg`: one, or one an axis; `force_delay_s`: how much later F_s comes [s].

        cutoff_hz         of the low-pass; None: 40 Hz, or 0.4 of the rate where that is less
        sensor_period_s   of a force sensor slower than `dt` [s]; 0: a sample each tick
        """
        masses = [float(mass_kg)] * len(gravity) if isinstance(mass_kg, int | float) else [float(m) for m in mass_kg]
        if len(masses) != len(gravity):
            raise ParameterError(f"mass_kg has {len(masses)} entries; allowed: 1, or {len(gravity)}, one an axis")
        least = min(masses, default=0.0)
        if not (dt > 0.0 and least >= 0.0 and 0.0 <= load_share <= 1.0 and force_delay_s >= 0.0 and sensor_period_s >= 0.0):
            raise ParameterError(
                f"dt {dt:g} s, mass {least:g} kg, load_share {load_share:g}, force_delay_s {force_delay_s:g}, "
                f"sensor_period_s {sensor_period_s:g}; allowed: dt > 0, mass >= 0, 0 <= load_share <= 1, delay and period >= 0"
            )
        self._good_s = 1.5 * sensor_period_s  # of a sample
        self._dt = dt
        self._loads = [load_share * mass for mass in masses]  # [kg]
        bias = tuple(bias) or (0.0,) * len(gravity)
        if len(bias) != len(gravity):
            raise ParameterError(f"bias has {len(bias)} entries; allowed: {len(gravity)}, one an axis")
        self._offset = [-load * g - b for load, g, b in zip(self._loads, gravity, bias, strict=True)]  # [N]
        self._average = force_delay_s < 0.5 * dt
        wait = (force_delay_s if self._average else force_delay_s - 0.5 * dt) / dt  # [ticks]
        self._late, self._blend = int(wait), wait - int(wait)
        self._filters = [Lowpass(felt_cutoff_hz(dt) if cutoff_hz is None else cutoff_hz, dt) for _ in gravity]
        self.reset()

    @property
    def dt(self) -> float:
        """The period that it is stepped with [s]."""
        return self._dt

    @property
    def n_axes(self) -> int:
        """Number of axes that it was made for."""
        return len(self._filters)

    def reset(self) -> None:
        """Forgets the past; the next good tick counts as rest."""
        for section in self._filters:
            section.reset()
        n = len(self._filters)
        self._velocity = [math.nan] * n
        self._force = [math.nan] * n
        self._elapsed = [0.0] * n  # [s] since the last good tick
        self._sample, self._age = [math.nan] * n, [0.0] * n  # of the sensor [N], [s]
        self._past = [[0.0] * (self._late + 2) for _ in range(n)]  # accelerations, newest first

    def step(self, obs: Observation) -> None:
        """Writes F (d,) [N] into `obs.force`; NaN on an axis whose force or velocity is missing."""
        forces, velocities = obs.sensor_force.tolist(), obs.velocity.tolist()
        for i, section in enumerate(self._filters):
            force, velocity = self._held(i, forces[i]), velocities[i]
            self._elapsed[i] += self._dt
            if not (-MAX_FORCE < force < MAX_FORCE and math.isfinite(velocity)):
                obs.force[i] = math.nan
                continue
            before, last = self._velocity[i], self._force[i]
            acceleration = 0.0 if before != before else (velocity - before) / self._elapsed[i]
            self._velocity[i], self._force[i], self._elapsed[i] = velocity, force, 0.0
            past = self._past[i]
            past.insert(0, acceleration)
            past.pop()
            acceleration = past[self._late] + self._blend * (past[self._late + 1] - past[self._late])
            if self._average and last == last:
                force = 0.5 * (force + last)
            obs.force[i] = section.step(force + self._loads[i] * acceleration + self._offset[i])

    def begin(self, sample: Sequence[float], age_s: float) -> None:
        """After `sample` (d,) of F_s [N], so old: the first ticks may come before the next."""
        self._sample, self._age = list(sample), [age_s] * len(self._filters)

    def _held(self, axis: int, sample: float) -> float:
        """The sensor's last sample while that is good; only NaN says that there is no new one."""
        self._age[axis] = self._age[axis] + self._dt if sample != sample else 0.0
        if sample == sample:
            self._sample[axis] = sample
        return self._sample[axis] if self._age[axis] <= self._good_s else sample


class TaringInteractionForce:
    """`CausalInteractionForce` that weighs the object first (the paper's footnote 2, on line).

    For the first `tare_s` of a run, while the hand rests and both partners hold, it averages F_s and reports F = 0. The part
    along gravity becomes the mass, the rest a bias; so at rest F starts from zero whatever the object weighs and however far
    the sensor is off. (A bias along gravity is taken for mass: 1 N looks like 0.2 kg at a share of 1/2.) Motion or a force that
    is not finite ends the tare early; with less than 3 good ticks the stated mass is used. `payload_kg` is what it found.

    A sensor slower than the ticks may give NaN between its samples: seen three times during the tare it is known, and each
    sample then held until the next is due.
    """

    def __init__(
        self,
        dt: float,
        *,
        gravity: Sequence[float],
        mass_kg: float = 2.0,
        load_share: float = 0.5,
        tare_s: float = 0.25,
        moving_m_per_s: float = 0.01,
        **filtering: Any,
    ) -> None:
        self._dt, self._gravity, self._stated, self._share = dt, list(gravity), mass_kg, load_share
        self._ticks, self._moving, self._filtering = round(tare_s / dt), moving_m_per_s, filtering
        self.reset()

    @property
    def dt(self) -> float:
        """The period that it is stepped with [s]."""
        return self._dt

    @property
    def n_axes(self) -> int:
        """Number of axes that it was made for."""
        return len(self._gravity)

    def reset(self) -> None:
        """Forgets what was weighed: the next window at rest counts."""
        self._sum, self._count, self._left = [0.0] * len(self._gravity), 0, self._ticks
        self._last = [math.nan] * len(self._gravity)
        self._gap, self._longest, self._gaps = 0, 0, 0  # ticks without a sample: now, at most, and how often
        self.payload_kg = self._stated
        self._force: CausalInteractionForce | None = None

    def step(self, obs: Observation) -> None:
        """Writes F (d,) [N] into `obs.force`, NaN until the window at rest is full."""
        if self._force is None:
            forces = obs.sensor_force.tolist()
            at_rest = all(abs(v) < self._moving for v in obs.velocity.tolist())
            self._left -= 1
            if self._left >= 0 and at_rest and self._weighs(forces):
                obs.force[:] = 0.0
                return
            self._force = self._weighed()
        self._force.step(obs)

    def _weighs(self, forces: list[float]) -> bool:
        """One more sample, or none yet of a slow sensor; no, where it is neither."""
        if self._count > 0 and all(f != f for f in forces) and self._gap < MOST_GAP_S / self._dt:
            self._gap += 1
            return True
        if not all(math.isfinite(f) for f in forces):
            return False
        self._gaps, self._longest, self._gap = self._gaps + (self._gap > 0), max(self._longest, self._gap), 0
        self._sum = [total + f for total, f in zip(self._sum, forces, strict=True)]
        self._count, self._last = self._count + 1, forces
        return True

    def _weighed(self) -> CausalInteractionForce:
        g2, bias = dot(self._gravity, self._gravity), [0.0] * len(self._gravity)
        if self._count >= 3 and g2 > 0.0:
            mean = [total / self._count for total in self._sum]
            along = dot(mean, self._gravity) / g2  # F_s = s m g at rest
            self.payload_kg = max(along / self._share, 0.0)
            bias = [f - self._share * self.payload_kg * g for f, g in zip(mean, self._gravity, strict=True)]
        force = CausalInteractionForce(
            self._dt,
            mass_kg=self.payload_kg,
            gravity=self._gravity,
            load_share=self._share,
            bias=bias,
            **{"sensor_period_s": (self._longest + 1) * self._dt if self._gaps >= 3 else 0.0, **self._filtering},
        )
        force.begin(self._last, self._gap * self._dt)
        return force


@dataclass(frozen=True)
class TurningLoad:
    """What a hand carries of an object that turns about one axis, the angle an arc [m] at `lever_m`, torque a force there [N].

    carried_kg      (d,) the hand's share of mass; of the arc, its share of the inertia about the centre of mass over lever_m^2
    gravity         (d,) [m/s^2]
    angle           column of the arc; across, axial: of the lengths that the object turns towards, and lies along at the start
    centre_m        from the hand to the centre of mass, along the object [m]; 0 where it rolls
    """

    carried_kg: tuple[float, ...]
    gravity: tuple[float, ...]
    angle: int
    lever_m: float
    across: int | None = None
    axial: int | None = None
    centre_m: float = 0.0

    def centre_velocity(self, moved: Array, velocity: Array) -> Array:
        """(..., d) [m/s] of the centre of mass; the arc keeps its own. `moved` (..., d) [m] from the start."""
        out = np.array(velocity, dtype=float)
        turned, rate = moved[..., self.angle] / self.lever_m, velocity[..., self.angle] / self.lever_m
        if self.across is not None:
            out[..., self.across] += rate * self.centre_m * np.cos(turned)
        if self.axial is not None:
            out[..., self.axial] -= rate * self.centre_m * np.sin(turned)
        return out

    def interaction(self, sensor_force: Array, velocity_rate: Array) -> Array:
        """Eq. (3), (T, d) [N], from F_s and the acceleration of the centre of mass (T, d) [m/s^2]."""
        return interaction_force(
            sensor_force, velocity_rate, mass_kg=np.array(self.carried_kg), load_share=1.0, gravity=np.array(self.gravity)
        )


class TurningInteractionForce:
    """Eq. (3) tick by tick for a `TurningLoad`: `CausalInteractionForce` of its centre of mass, tared at rest.

    What the sensor reads in the first `tare_s` of a run, at rest, beyond the stated weight, is its bias.
    """

    def __init__(
        self, dt: float, load: TurningLoad, *, tare_s: float = 0.25, moving_m_per_s: float = 0.01, **filtering: Any
    ) -> None:
        self._dt, self._load, self._filtering = dt, load, filtering
        self._ticks, self._moving = round(tare_s / dt), moving_m_per_s
        self._weight = np.array(load.carried_kg) * np.array(load.gravity)
        self._seen = Observation(len(load.gravity))
        self.reset()

    def reset(self) -> None:
        """Forgets the past and the bias: the next window at rest counts."""
        self._sum, self._count = np.zeros(len(self._weight)), 0
        self._start: Array | None = None
        self._force: CausalInteractionForce | None = None

    def step(self, obs: Observation) -> None:
        """Writes F (d,) [N] into `obs.force`; 0 while it tares, NaN where force or velocity is missing."""
        if self._start is None and np.isfinite(obs.position).all():
            self._start = obs.position.copy()
        if self._force is None:
            resting = bool((np.abs(obs.velocity) < self._moving).all()) and bool((np.abs(obs.sensor_force) < MAX_FORCE).all())
            if resting and self._count < self._ticks:
                self._sum += obs.sensor_force
                self._count += 1
                obs.force[:] = 0.0
                return
            self._force = self._tared()
        seen = self._seen
        seen.sensor_force[:] = obs.sensor_force
        # an angle that is missing for a tick leaves what turns with it missing, too
        moved = obs.position - (obs.position if self._start is None else self._start)
        seen.velocity[:] = self._load.centre_velocity(moved, obs.velocity)
        self._force.step(seen)
        obs.force[:] = seen.force

    def _tared(self) -> CausalInteractionForce:
        bias = self._sum / self._count - self._weight if self._count >= 3 else np.zeros(len(self._weight))
        load = self._load
        return CausalInteractionForce(
            self._dt, mass_kg=load.carried_kg, load_share=1.0, gravity=load.gravity, bias=bias.tolist(), **self._filtering
        )
