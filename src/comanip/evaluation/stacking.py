"""Several guesses made one: weights that were learned where the guesses had not seen the truth.

Guesses of different making err differently, so that their weighted mean is mostly better than the best of them, and a guess which
misleads on lessons left out gets no weight. Weights are never negative.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..interfaces import Array

ROUNDS = 3


def nonnegative(square: Array, cross: Array) -> Array:
    """w ≥ 0 (C,) that minimises w' square w / 2 − cross' w, square symmetric and not negative (Lawson and Hanson, 1974)."""
    size = len(cross)
    held = square + 1e-12 * max(float(np.trace(square)), 1e-300) * np.eye(size)  # two guesses may be the same
    found, used = np.zeros(size), np.zeros(size, dtype=bool)
    for _ in range(3 * size):
        slope = cross - held @ found
        slope[used] = -np.inf
        if slope.max(initial=-np.inf) <= 1e-10 * np.abs(cross).max(initial=0.0):
            break
        used[int(np.argmax(slope))] = True
        found, used = _inside(held, cross, found, used)
    return found


def _inside(square: Array, cross: Array, found: Array, used: np.ndarray) -> tuple[Array, np.ndarray]:
    """The best weights of those used; the ones that would be negative leave, one after the other."""
    while True:
        best = np.zeros_like(found)
        best[used] = np.linalg.solve(square[np.ix_(used, used)], cross[used])
        below = used & (best <= 0.0)
        if not below.any():
            return best, used
        part = float((found[below] / (found[below] - best[below] + 1e-300)).min())
        found = found + part * (best - found)
        used = used & (found > 1e-15 * max(1.0, float(np.abs(found).max())))
        found = np.where(used, found, 0.0)


def weights(guesses: Sequence[Array], truth: Sequence[Array], doubt: float = 0.0) -> Array:
    """(C,) weights of C guesses, from what they say (C, N, d) of each lesson's truth (N, d) without having seen it.

    Every lesson counts the same, however long. With `doubt`, in squared errors of one lesson, weights are held towards none at
    all: the worse the lessons are foreseen, and the fewer they are, the less is foreseen.
    """
    pairs = [(g.reshape(len(g), -1), y.reshape(-1), len(y)) for g, y in zip(guesses, truth, strict=True) if len(y)]
    if not pairs:
        return np.zeros(len(guesses[0]) if guesses else 0)
    square = np.sum([g @ g.T / n for g, _, n in pairs], axis=0)
    cross = np.sum([g @ y / n for g, y, n in pairs], axis=0)
    found = nonnegative(square, cross)
    for _ in range(ROUNDS if doubt > 0.0 else 0):
        wrong = doubt * float(np.mean([((found @ g - y) ** 2).sum() / n for g, y, n in pairs]))
        found = nonnegative(square + wrong * np.eye(len(cross)), cross)
    return found
