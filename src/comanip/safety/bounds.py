"""How fast the envelope lets a hand go: never so that it cannot brake inside what is left (docs/safety.md)."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite, sqrt
from typing import Any

import numpy as np

from ..signals.vectors import apart, dot, length
from .checker import Checker
from .detectors import LIGHT_N
from .situation import COMPLY, HOLD

CREEP_M_S = 0.025  # and then creeps, until it is sure: a person's pull falls by a tenth with each few millimetres
STANDS_M_S = 1e-9  # what braking leaves of a speed by rounding is rest
SINK_M_S2 = 1.0  # a hand that sinks slows down softly: a stop would swing the object, which feels like an answer


class Bounds:
    """A part of `Envelope`."""

    def _unfit(self: Any) -> str:
        inner = self._inner
        for name in ("velocity", "position", "acceleration"):
            array = getattr(inner, name)
            if np.shape(array) != (self._d,):
                return f"{name} has shape {np.shape(array)} instead of ({self._d},)"
            for value in array.tolist():
                if not isfinite(value):
                    return f"{name} is {value}"
        return ""

    def _book(self: Any, period: float, late: bool) -> None:
        """Where the last command led, and what it cost at worst."""
        limits, speed = self.limits, length(self._v)
        way = [v * period for v in self._v]
        if late and speed > 0.0:  # a command is valid for one period; then the low level brakes
            braking = min(period - self._dt, speed / limits.a_max_m_per_s2)
            far = speed * (self._dt + braking) - 0.5 * limits.a_max_m_per_s2 * braking * braking
            way = [v / speed * far for v in self._v]
        self._x = [x + w for x, w in zip(self._x, way, strict=True)]
        gain = dot(self._force, way) if self._known and not late else -limits.force_limit_n * length(way)
        self._energy = min(limits.energy_j, max(0.0, self._energy + gain))
        if (off := apart(self._x, self._at)) > limits.drift_m and self._state != HOLD:
            self._fault(f"does not follow: {off:.2g} m off")

    def _braked(self: Any, period: float) -> list[float]:
        speed = length(self._v)
        left = speed - self.limits.a_max_m_per_s2 * period
        return [v * (left / speed) for v in self._v] if left > STANDS_M_S else [0.0] * self._d

    def _enclose(self: Any, position: Sequence[float]) -> None:
        """Walls around the stated ones and `position` [m], where the arm begins, if that is near enough to them."""
        beside = self.limits.begins_beside_m
        walls = self.limits.workspace_m or ((-inf, inf),) * self._d
        if beside is not None and len(position) == len(walls):
            near = [max(low - x, x - high) <= beside for x, (low, high) in zip(position, walls, strict=True)]
            if all(near):
                walls = tuple((min(low, x), max(high, x)) for x, (low, high) in zip(position, walls, strict=True))
        if walls != self._walls:
            self._take_back()
            self._walls = walls
            self._checker = Checker(self.limits.v_max_m_per_s, self.limits.a_max_m_per_s2, walls, self._dt)
            self._link()

    def _cap(self: Any, room: float) -> float:
        """Fastest speed [m/s] from which one can brake inside `room` [m]."""
        a = self.limits.a_max_m_per_s2
        return max(0.0, sqrt(2.0 * a * room) - 0.5 * a * self._late) if room > 0.0 else 0.0

    def _rooms(self: Any) -> list[tuple[float, float]]:
        """Metres left to the walls, below and above, by what was commanded and by what was measured."""
        where = zip(self._x, self._at, self._walls, strict=True)
        return [(min(x, at) - low, high - max(x, at)) for x, at, (low, high) in where]

    def _fastest(self: Any, velocity: Sequence[float], rooms: Sequence[tuple[float, float]]) -> float:
        """Speed [m/s] allowed in the direction of `velocity`: from it one can brake before every wall and within the tank."""
        speed, room = length(velocity), self._energy / self.limits.force_limit_n
        for v, (below, above) in zip(velocity, rooms, strict=True):
            if v != 0.0:
                room = min(room, max(above if v > 0.0 else below, 0.0) * (speed / abs(v)))
        return min(self.limits.v_max_m_per_s, self._cap(room))

    def _clip(self: Any, period: float) -> list[float]:
        """What is brakeable AND reachable, whatever was wanted. The two always meet (docs/safety.md)."""
        limits = self.limits
        self._asked = self._wanted
        if self._state == COMPLY:
            b = limits.comply_damping_ns_per_m * max(self._shaking.amplitude / limits.shake_n, 1.0)  # harder where it is shaken
            self._asked = [f / b for f in self._force]
        if self._state == HOLD:
            return self._braked(period)
        rooms, most = self._rooms(), limits.a_max_m_per_s2 * period
        target = [min(max(v, -self._cap(b)), self._cap(a)) for v, (b, a) in zip(self._unsunk(self._asked), rooms, strict=True)]
        speed, fastest = length(target), self._fastest(target, rooms)
        if speed > fastest:
            target = [v * (fastest / speed) for v in target]
        far = apart(target, self._v)
        if far > most:
            target = [old + (new - old) * (most / far) for new, old in zip(target, self._v, strict=True)]
            if length(target) > self._fastest(target, rooms) + 1e-12:  # between two walls; along the old way one can always brake
                return self._braked(period)
        return target

    def _unsunk(self: Any, velocity: list[float]) -> list[float]:
        """Without what is faster down than the hand may sink."""
        load = self._let_go.load
        if not self._sinking.hangs or load <= LIGHT_N:
            return velocity
        left = max(self.limits.sink_m - self._sinking.sunk, 0.0)
        may = max(sqrt(2.0 * SINK_M_S2 * left), CREEP_M_S) + self._sinking.led
        beyond = dot(velocity, self._let_go.weight) / load - may
        if beyond <= 0.0:
            return velocity
        return [v - beyond * (w / load) for v, w in zip(velocity, self._let_go.weight, strict=True)]
