"""A haptic handle and the person who holds it, simulated: `HapticDevice` for any teacher on any handle.

Hand and handle are one mass, three coordinates at most; each axis and sub-step:

    (M_t + M_d) dv_h/dt = f_teacher + F_applied + f_wall - b v_h - coulomb sign(v_h)

The handle measures its position in steps and takes the velocity from differences, low-passed, as its driver does. PHANToM
Premium 1.5 (data sheet): 381 x 267 x 191 mm, 8.5 N peak, 1.4 N continuous, 0.03 mm, friction 0.04 N, 1 kHz; apparent mass with
the gimbal 0.14 kg. One step of 0.03 mm in 1 ms is 30 mm/s, hence the low-pass at 20 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, inf, isfinite, pi, sqrt
from typing import Protocol

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array


class Person(Protocol):
    """Whoever holds the handle. Lengths from where it was taken hold of, in the device's scale."""

    mass_kg: float

    def reset(self) -> None: ...

    def force(self, time: float, position: list[float], velocity: list[float], felt: list[float]) -> list[float]:
        """What the arm does to the handle [N], given what the handle does to the hand."""
        ...


@dataclass(frozen=True)
class Handle:
    """What a haptic device is as a thing. Zero or infinite: that imperfection is not there.

    workspace_m   (lowest, highest) per axis [m] in the device's frame; None: no walls
    continuous_n  force that may last; the mean (rms) over `thermal_s` above it is warned of
    """

    mass_kg: float = 0.14
    viscous_ns_per_m: float = 1.0
    coulomb_n: float = 0.0
    resolution_m: float = 0.0
    velocity_cutoff_hz: float = inf
    peak_n: float = 8.5
    continuous_n: float = inf
    thermal_s: float = 10.0
    workspace_m: tuple[tuple[float, float], ...] | None = None
    wall_n_per_m: float = 2000.0
    wall_ns_per_m: float = 20.0

    def __post_init__(self) -> None:
        for name in ("mass_kg", "velocity_cutoff_hz", "peak_n", "continuous_n", "thermal_s"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"handle: {name} must be positive; got {getattr(self, name)}")
        for name in ("viscous_ns_per_m", "coulomb_n", "resolution_m", "wall_n_per_m", "wall_ns_per_m"):
            if not getattr(self, name) >= 0:
                raise ParameterError(f"handle: {name} must not be negative; got {getattr(self, name)}")
        if any(not low < high for low, high in self.workspace_m or ()):
            raise ParameterError(f"handle: workspace_m needs lowest < highest on each axis; got {self.workspace_m}")


IDEAL = Handle()
WORKSPACE_M = {"x": 0.381, "z": 0.267, "y": 0.191}  # width, height, depth of the Premium 1.5


def phantom(axes: tuple[str, ...] = ("z",), **changes: object) -> Handle:
    """A PHANToM Premium 1.5 with the device axes `axes`, centred; `changes` are fields of `Handle`."""
    if unknown := [a for a in axes if a not in WORKSPACE_M]:
        raise ParameterError(f"a PHANToM has the axes {', '.join(WORKSPACE_M)}; got {unknown[0]!r}")
    fields: dict[str, object] = {
        "viscous_ns_per_m": 0.1,
        "coulomb_n": 0.04,
        "resolution_m": 3e-5,
        "velocity_cutoff_hz": 20.0,
        "continuous_n": 1.4,
        "workspace_m": tuple((-0.5 * WORKSPACE_M[a], 0.5 * WORKSPACE_M[a]) for a in axes),
    }
    return Handle(**{**fields, **changes})  # type: ignore[arg-type]


class HeldHandle:
    """Implements `HapticDevice`: `person` on `handle`.

    start_m    (d,) [m] where the handle is when it is taken, device frame; default: the middle
    servo_s    [s] period of the device's own loop (physics and measurement)

    Channels: device.position (measured) [m], device.applied (force after saturation) [N], device.clutch (1: held down),
    device.warmth (rms force over `thermal_s`) [N].
    """

    problem = ""

    def __init__(
        self, person: Person, handle: Handle = IDEAL, *, n_axes: int = 1, start_m: Array | None = None, servo_s: float = 0.001
    ) -> None:
        walls = handle.workspace_m or ((-inf, inf),) * n_axes
        start = [0.0] * n_axes if start_m is None else [float(x) for x in start_m]
        if len(walls) != n_axes or len(start) != n_axes:
            raise ParameterError(f"{n_axes} axes need as many walls and start positions; got {len(walls)} and {len(start)}")
        if any(not low <= x <= high for x, (low, high) in zip(start, walls, strict=True)):
            raise ParameterError(f"start_m {start} lies outside the device's workspace {walls}")
        self.person, self.handle, self._servo = person, handle, servo_s
        self._walls, self._start = walls, start
        self._position, self._applied = np.zeros(n_axes), np.zeros(n_axes)
        self._clutch, self._warmth = np.ones(1), np.zeros(1)
        self._channels = {
            "device.position": (self._position, "m"),
            "device.applied": (self._applied, "N"),
            "device.clutch": (self._clutch, ""),
            "device.warmth": (self._warmth, "N"),
        }
        cutoff = handle.velocity_cutoff_hz
        self._mix = 1.0 - exp(-2 * pi * cutoff * servo_s) if isfinite(cutoff) else 1.0
        self.reset()

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def notice(self) -> str:
        said = []
        if self._wanted > self.handle.peak_n:
            said.append(f"handle force clipped: {self._wanted:.1f} N asked, the device gives {self.handle.peak_n:g} N")
        if self._warmth[0] > self.handle.continuous_n:
            said.append(f"device gets warm: {self._warmth[0]:.1f} N on the mean, {self.handle.continuous_n:g} N may last")
        if any(self._at_edge):
            said.append("handle at the edge of its workspace: use the clutch")
        return "; ".join(said)

    def press(self, down: bool) -> None:
        """The button on the stylus: the robot follows while it is down."""
        self._clutch[0] = float(down)

    def reset(self) -> None:
        d = len(self._start)
        self.person.reset()
        self.time, self._heat, self._wanted = 0.0, 0.0, 0.0
        self._at_edge = [False] * d
        self._x, self._v, self._speed = [0.0] * d, [0.0] * d, [0.0] * d
        self._position[:] = self._read_out = [self._measured(i) for i in range(d)]
        self._applied[:] = 0.0
        self._warmth[0] = 0.0

    def _measured(self, i: int) -> float:
        x, step = self._start[i] + self._x[i], self.handle.resolution_m
        return step * round(x / step) if step else x

    def read(self, out: Array) -> None:
        out[:] = self._speed

    def write(self, force: Array, duration: float, power: float = 0.0) -> None:
        wanted = [float(f) if isfinite(f) else 0.0 for f in force]  # an amplifier that is told nonsense gives nothing
        self._wanted = sqrt(sum(f * f for f in wanted))
        scale = min(1.0, self.handle.peak_n / self._wanted) if self._wanted else 1.0
        applied = [scale * f for f in wanted]
        steps = max(1, round(duration / self._servo))
        h = duration / steps
        for _ in range(steps):
            self._advance(applied, h)
        self._applied[:] = applied
        self._position[:] = self._read_out
        self._heat += min(1.0, duration / self.handle.thermal_s) * (min(self._wanted, self.handle.peak_n) ** 2 - self._heat)
        self._warmth[0] = sqrt(self._heat)

    def _advance(self, applied: list[float], h: float) -> None:
        handle, mass = self.handle, self.handle.mass_kg + self.person.mass_kg
        felt = [a + self._wall(i) for i, a in enumerate(applied)]
        arm = self.person.force(self.time, self._x, self._v, felt)
        stop = h * handle.coulomb_n / mass
        for i, before in enumerate(self._read_out):
            v = self._v[i] + h * (arm[i] + felt[i] - handle.viscous_ns_per_m * self._v[i]) / mass
            self._v[i] = 0.0 if abs(v) <= stop else v - stop if v > 0.0 else v + stop
            self._x[i] += h * self._v[i]
            self._read_out[i] = self._measured(i)
            speed = (self._read_out[i] - before) / h if handle.resolution_m else self._v[i]
            self._speed[i] += self._mix * (speed - self._speed[i])
        self.time += h

    def _wall(self, i: int) -> float:
        low, high = self._walls[i]
        x = self._start[i] + self._x[i]
        beyond = x - high if x > high else x - low if x < low else 0.0
        self._at_edge[i] = beyond != 0.0
        push = -self.handle.wall_n_per_m * beyond - self.handle.wall_ns_per_m * self._v[i]
        return min(0.0, push) if beyond > 0.0 else max(0.0, push) if beyond < 0.0 else 0.0  # a wall does not pull
