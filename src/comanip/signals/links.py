"""A force as a linear function of what moves, each signal on its own clock: least squares, a time offset, and honest errors.

Residuals of people's recordings repeat themselves for tenths of a second, so the textbook error of least squares is ten times too
small. Errors here come from leaving out one block of time after another (delete-a-block jackknife), the offset included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array

BLOCKS = 12
COARSE_S = 0.01  # [s] between offsets that are tried first: what passed a low-pass of 10 Hz has no finer valleys
FINE_S = 1e-5


class Link(NamedTuple):
    """force(t + offset) = columns(t) @ values + residual(t).

    values, errors       (p,) and their standard errors
    offset_s, offset_error_s  how much LATER the force is stamped than the motion [s]; nan where no offset was looked for
    r2                   share of the force's variance that is explained, over all axes
    residual             (T, d) what is not, on the motion's clock
    inside               which frames (start, stop) were fitted
    """

    values: Array
    errors: Array
    offset_s: float
    offset_error_s: float
    r2: float
    residual: Array
    inside: tuple[int, int]


def linked(columns: Array, force: Array, dt: float, *, reach_s: float = 0.0, errors: bool = True) -> Link:
    """Least squares of force (T, d) on columns (T, d, p), with the offset within ± `reach_s` [s] that explains most.

    A shift of the force that the columns can imitate (acceleration and velocity of one swing at one frequency) cannot be told
    from them: `offset_error_s` is large then. Without `errors` these are nan: they take ten times as long as the fit. Raises
    ParameterError where there are too few frames.
    """
    frames, _, p = columns.shape
    edge = math.ceil(reach_s / dt)
    if frames - 2 * edge < 4 * p:
        raise ParameterError(f"{frames} frames are too few for {p} unknowns and offsets up to {reach_s:g} s; record longer")
    inside = slice(edge, frames - edge)
    time: Array = dt * np.arange(frames, dtype=np.float64)
    problem = _Problem(columns[inside], _curve(time, force), time[inside])
    everything = np.ones(len(time[inside]), dtype=bool)
    offset = problem.best_offset(everything, reach_s) if reach_s > 0.0 else 0.0
    values = problem.solve(everything, offset)
    spread = _spread(problem, offset, reach_s, p) if errors else np.full(p + 1, np.nan)
    target = problem.target(offset)
    rest = problem.curve(np.clip(time + offset, time[0], time[-1])) - columns @ values
    total = float(((target - target.mean(axis=0)) ** 2).sum())
    r2 = 1.0 - float((rest[inside] ** 2).sum()) / total if total > 0.0 else math.nan
    found = (offset, float(spread[0])) if reach_s > 0.0 else (math.nan, math.nan)
    return Link(values, spread[1:], *found, r2, rest, (edge, frames - edge))


def _spread(problem: _Problem, offset: float, reach_s: float, p: int) -> Array:
    """(1 + p,) standard errors of the offset and the values: how far they move when one block of time is left out."""
    frames = problem.frames
    scattered = []
    for part in np.array_split(np.arange(frames), min(BLOCKS, frames // p)):
        kept = np.ones(frames, dtype=bool)
        kept[part] = False
        near = problem.refined(kept, offset, reach_s) if reach_s > 0.0 else 0.0
        scattered.append([near, *problem.solve(kept, near)])
    found = np.array(scattered)
    return np.asarray(np.sqrt((len(found) - 1) / len(found) * ((found - found.mean(axis=0)) ** 2).sum(axis=0)))


def _curve(time: Array, values: Array) -> Any:
    from scipy.interpolate import CubicSpline  # slow to import

    return CubicSpline(time, values, axis=0)


def _lowest(cost: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import minimize_scalar  # slow to import

    return float(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": FINE_S}).x)


class _Problem:
    """One regression for many offsets and many choices of frames: the columns are decomposed once.

    With X = U S V', frames left out change U' U from the identity by what they hold of it, which is a matrix of p x p.
    """

    def __init__(self, columns: Array, curve: Any, time: Array) -> None:
        frames, d, p = columns.shape
        self.curve, self._time, self.frames = curve, time, frames
        self._scale = np.sqrt((columns**2).mean(axis=(0, 1)))
        self._scale[self._scale == 0.0] = 1.0
        u, s, v = np.linalg.svd((columns / self._scale).reshape(-1, p), full_matrices=False)
        rank = int((s > 1e-10 * s[0]).sum()) if s[0] > 0.0 else 0
        self._u, self._back = u[:, :rank].reshape(frames, d, rank), v[:rank].T / s[:rank]
        self._last: tuple[bytes, Array, Array] | None = None

    def target(self, offset: float) -> Array:
        return np.asarray(self.curve(self._time + offset))

    def solve(self, kept: np.ndarray, offset: float) -> Array:
        basis, inverse = self._basis(kept)
        return np.asarray(self._back @ (inverse @ (basis.T @ self.target(offset)[kept].reshape(-1))) / self._scale)

    def unexplained(self, kept: np.ndarray, offset: float) -> float:
        """Share of the force that the columns leave, 0 to 1."""
        basis, inverse = self._basis(kept)
        y = self.target(offset)[kept]
        total = float(((y - y.mean(axis=0)) ** 2).sum())
        part = basis.T @ y.reshape(-1)
        return (float((y**2).sum()) - float(part @ inverse @ part)) / total if total > 0.0 else 1.0

    def best_offset(self, kept: np.ndarray, reach_s: float) -> float:
        tried = np.linspace(-reach_s, reach_s, 2 * math.ceil(reach_s / COARSE_S) + 1)
        rough = float(tried[int(np.argmin([self.unexplained(kept, o) for o in tried]))])
        return self.refined(kept, rough, reach_s)

    def refined(self, kept: np.ndarray, near: float, reach_s: float) -> float:
        low, high = max(near - 2.0 * COARSE_S, -reach_s), min(near + 2.0 * COARSE_S, reach_s)
        return _lowest(lambda offset: self.unexplained(kept, offset), low, high)

    def _basis(self, kept: np.ndarray) -> tuple[Array, Array]:
        """(U of the frames kept, stacked; inverse of its U' U)."""
        key = kept.tobytes()
        if self._last is None or self._last[0] != key:
            basis = self._u[kept].reshape(-1, self._u.shape[2])
            self._last = key, basis, np.linalg.pinv(basis.T @ basis, rcond=1e-10, hermitian=True)
        return self._last[1], self._last[2]


def of_each_axis(columns: Sequence[Array]) -> Array:
    """(T, d, d·k) for coefficients of their own on each axis, from k signals (T, d): axis 0's k, then axis 1's."""
    frames, d = columns[0].shape
    found = np.zeros((frames, d, d * len(columns)))
    for axis in range(d):
        for k, column in enumerate(columns):
            found[:, axis, axis * len(columns) + k] = column[:, axis]
    return found
