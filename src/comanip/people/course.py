"""Where somebody wants the object's end to go, in d axes: a course in time, and the ways to walk it.

A course is a path and a tempo. `along` keeps the path and gives it another tempo, so every habit of timing (even speed, a
snatch, stop and go) works on a lift, on a turn of a crank and round a corner alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array

STEP_S = 0.002  # of the samples inside: a straight line between two is off by a h^2/8, 3 um at 5 m/s^2

Vector = tuple[float, ...]
Way = Callable[[Array], Array]  # share of the time (T,) -> share of the path (T,)


@dataclass(frozen=True)
class Course:
    """Displacement from the start over time, held before and after.

    times_s          (T,) increasing; the first is when the motion begins, the last when it has ended
    displacements_m  (T, d) from the start [m]; smoothed by a cubic spline, at rest at both ends, where samples are coarse
    """

    times_s: Array
    displacements_m: Array
    _rows: list[tuple[Vector, Vector, Vector]] = field(init=False, repr=False, compare=False)  # each STEP_S: x, v, a
    _start_per_s_still: tuple[float, float, Vector] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        times = np.array(self.times_s, dtype=float)
        way = np.array(self.displacements_m, dtype=float)
        way = way[:, None] if way.ndim == 1 else way
        if times.ndim != 1 or len(times) < 2 or way.ndim != 2 or len(way) != len(times):
            raise ParameterError(f"a course takes times (T >= 2,) and displacements (T, d); got {times.shape} and {way.shape}")
        if not (np.isfinite(times).all() and np.isfinite(way).all() and (np.diff(times) > 0.0).all()):
            raise ParameterError("a course's times must increase, and its times and displacements be finite")
        n = max(2, round((times[-1] - times[0]) / STEP_S) + 1)
        even = np.linspace(times[0], times[-1], n)
        x, v, a = _smooth(times, way, even)
        rows = list(zip(map(tuple, x.tolist()), map(tuple, v.tolist()), map(tuple, a.tolist()), strict=True))
        times.setflags(write=False)
        way.setflags(write=False)
        fast = (float(times[0]), (n - 1) / float(times[-1] - times[0]), (0.0,) * way.shape[1])
        for name, value in (("times_s", times), ("displacements_m", way), ("_rows", rows), ("_start_per_s_still", fast)):
            object.__setattr__(self, name, value)

    @property
    def start_s(self) -> float:
        return float(self.times_s[0])

    @property
    def stop_s(self) -> float:
        return float(self.times_s[-1])

    @property
    def duration_s(self) -> float:
        return self.stop_s - self.start_s

    @property
    def end(self) -> Array:
        """(d,) displacement at the end [m]."""
        return np.array(self.displacements_m[-1])

    @property
    def length_m(self) -> float:
        """Of the path, there and back counted."""
        return float(np.linalg.norm(np.diff(self.displacements_m, axis=0), axis=1).sum())

    def at(self, time_s: float) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """Displacement [m], velocity [m/s] and acceleration [m/s^2] meant at `time_s`, (d,) floats each."""
        rows, (start, per_s, still) = self._rows, self._start_per_s_still
        share = (time_s - start) * per_s
        if share <= 0.0:
            return rows[0][0], still, still
        n = int(share)
        if n >= len(rows) - 1:
            return rows[-1][0], still, still
        b = share - n
        (x0, v0, a0), (x1, v1, a1) = rows[n], rows[n + 1]
        if len(x0) == 1:
            return (x0[0] + b * (x1[0] - x0[0]),), (v0[0] + b * (v1[0] - v0[0]),), (a0[0] + b * (a1[0] - a0[0]),)
        return _between(x0, x1, b), _between(v0, v1, b), _between(a0, a1, b)

    def later(self, by_s: float) -> Course:
        """The same, begun `by_s` later."""
        return Course(self.times_s + by_s, self.displacements_m)

    def along(self, way: Way, *, duration_s: float | None = None, start_s: float | None = None) -> Course:
        """The same path at another tempo: at the share s of the time, `way(s)` of the path's length is behind."""
        gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.displacements_m, axis=0), axis=1))])
        duration = self.duration_s if duration_s is None else duration_s
        start = self.start_s if start_s is None else start_s
        s = np.linspace(0.0, 1.0, max(2, round(duration / STEP_S) + 1))
        at = np.asarray(way(s)) * gone[-1]
        moved = np.concatenate([[True], np.diff(gone) > 0.0])  # a pause has no length, and so no place on the path
        new = [np.interp(at, gone[moved], column[moved]) for column in self.displacements_m.T]
        return Course(start + s * duration, np.column_stack(new))

    @staticmethod
    def of_legs(legs: Sequence[tuple[float, float, float | Sequence[float]]]) -> Course:
        """Minimum-jerk legs (start [s], duration [s], displacement (d,) or along the one axis [m]), which may overlap."""
        if not legs or not all(duration > 0.0 for _, duration, _ in legs):
            raise ParameterError(f"a course needs legs (start_s, duration_s > 0, displacement); got {list(legs)}")
        start, stop = min(one[0] for one in legs), max(one[0] + one[1] for one in legs)
        times = np.linspace(start, stop, max(2, round((stop - start) / STEP_S) + 1))
        parts = [minimum_jerk_way((times - t) / duration)[:, None] * np.atleast_1d(far) for t, duration, far in legs]
        return Course(times, np.sum(parts, axis=0))


def _smooth(times: Array, way: Array, even: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (n, d) of samples at `even` times; at rest at both ends."""
    if np.diff(times).max() > 1.5 * STEP_S:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(times, way, bc_type="clamped")
        return spline(even), spline(even, 1), spline(even, 2)
    x = np.column_stack([np.interp(even, times, column) for column in way.T])
    v = np.gradient(x, even, axis=0)
    return x, v, np.gradient(v, even, axis=0)


def _between(a: Vector, b: Vector, share: float) -> Vector:
    return tuple(p + share * (q - p) for p, q in zip(a, b, strict=True))


def minimum_jerk_way(s: Array) -> Array:
    """Share of the way behind at the share `s` of the time (T,); Flash and Hogan 1985."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (-15.0 + 6.0 * s)))
