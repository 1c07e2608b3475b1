"""A taught path carried to another start and another goal: the product of what the lessons look like from each.

Seen from where it began, lessons of one goal agree at the start and differ at the end; seen from where it ended, the other way
round. Both are Gaussians over phase, and linearly transformed to a new start x_s and a new goal x_g (here: moved, A = 1)

    N(x_s + X(p) - X(0), S_s(p))        N(x_g + X(p) - X(1), S_g(p))

and the mean of their product is (1 - g) of the first + g of the second, g = S_s / (S_s + S_g).

With one start and one goal as taught, that is the taught path. A path that grows longer is gone no faster than was taught.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..interfaces import Array
from .taught_path import TaughtPath

SETTLES = 0.15  # share of the path over which the weight of the goal is smoothed: few lessons give it jumps
FASTER = 1.3  # of the taught top speed


def carried(path: TaughtPath, start: Array | None = None, goal: Array | None = None) -> TaughtPath:
    """The path from `start` to `goal` (d,) [m]; None: as it was taught."""
    nothing = np.zeros(path.position.shape[1])
    from_start = nothing if start is None else start - path.position[0]
    from_goal = nothing if goal is None else goal - path.position[-1]
    weight = weight_of_goal(path)[:, None]
    position = path.position + (1.0 - weight) * from_start + weight * from_goal
    time = _unhurried(position, FASTER * _steps(path.position).max())
    even = np.linspace(0.0, time[-1], max(round(float(time[-1])), len(time) - 1) + 1)

    def retimed(table: Array) -> Array:
        return np.stack([np.interp(even, time, column) for column in table.T], axis=1)

    return replace(
        path,
        step_s=path.step_s * float(even[1]),
        position=retimed(position),
        force=retimed(path.force),
        spread=np.interp(even, time, path.spread),
        ends=path.ends + from_goal,
        framed=retimed(path.framed.T).T,
    )


def weight_of_goal(path: TaughtPath) -> Array:
    """g (N,): from 0 at the start to 1 at the goal, never going back."""
    seen_from_start, seen_from_goal = np.square(path.framed)
    both = seen_from_start + seen_from_goal
    n = len(both)
    share = np.divide(seen_from_start, both, out=np.linspace(0.0, 1.0, n), where=both > 0.0)
    half = max(int(SETTLES * n), 1)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.concatenate([np.zeros(half), np.maximum.accumulate(share), np.ones(half)])
    smoothed = np.convolve(padded, window / window.sum(), mode="valid")
    return np.asarray((smoothed - smoothed[0]) / (smoothed[-1] - smoothed[0]))


def _unhurried(position: Array, most: float) -> Array:
    """When each row (N,) is reached, in steps of the taught path, if no step may lead farther than `most` [m]."""
    asked = np.maximum(_steps(position) / most, 1.0)
    half = max(int(0.5 * SETTLES * len(asked)), 1)
    widest = np.max([np.roll(np.pad(asked, half, mode="edge"), k) for k in range(-half, half + 1)], axis=0)
    window = np.hanning(2 * half + 3)[1:-1]
    return np.concatenate([[0.0], np.cumsum(np.convolve(widest, window / window.sum(), mode="valid"))])


def _steps(position: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(position, axis=0), axis=1))
