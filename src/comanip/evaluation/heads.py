"""Linear heads of a forecast: a ridge over the last tenths of a second of velocity and force, in several views.

One slope for every pair of axes learns what turns a push aside, and needs many lessons for it; one slope for all axes that share
a unit (nothing tells x from y then) needs a d²-th of the numbers and wins where lessons are few. Both are the same whatever way
the axes are turned and in whatever units they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from ..lessons.demonstration import Demonstration
from ..lessons.faults import kinds_of_axes

LAGS = 9  # moments of the past that a head sees
EVERY_S = 0.03  # a forecast is made and learned from so often: neighbouring frames say the same
PENALTIES = 10.0 ** np.arange(-4.0, 3.0)  # of the ridge, in standardised inputs, a frame


class View(NamedTuple):
    """What a head sees of the past: span_s of velocity and force, the way from the start, what the skill's model foresees; and
    whether one slope serves all axes of a unit (`shared`)."""

    shared: bool
    span_s: float = 0.4
    place: bool = False
    roll_out: bool = False


RIDGE = View(False)  # the yardstick
VIEWS = (
    RIDGE,
    View(False, place=True),
    View(False, roll_out=True),
    View(True, 0.2),
    View(True),
    View(True, 0.8),
    View(True, place=True),
    View(True, roll_out=True),
)


@dataclass(frozen=True, eq=False)
class Head:
    """What is foreseen = sum of (past − middle) / spread times gains, + offset.

    middle, spread (L, d) of a past (N, L, d); gains (L, d) where axes of a unit share them, else (L d, d); offset (d,)
    """

    shared: bool
    middle: Array
    spread: Array
    gains: Array
    offset: Array

    def __call__(self, past: Array) -> Array:
        """(N, d)"""
        scaled = (past - self.middle) / self.spread
        if self.shared:
            return np.asarray(np.einsum("nld,ld->nd", scaled, self.gains) + self.offset)
        return np.asarray(scaled.reshape(len(past), -1) @ self.gains + self.offset)


def rows_of(lesson: Demonstration) -> np.ndarray:
    """Frames from which forecasts are made."""
    return np.arange(0, len(lesson), max(1, round(EVERY_S / lesson.dt)))


def axes_of(lesson: Demonstration) -> list[list[int]]:
    """Axes by the unit of their position."""
    return list(kinds_of_axes(lesson.units.get("position", ""), lesson.position.shape[1]).values())


def history(lesson: Demonstration, span_s: float = RIDGE.span_s) -> Array:
    """(T, LAGS or 2 LAGS, d) velocity, then force, of the last `span_s`; before the beginning, those of the first frame."""
    back = np.rint(np.linspace(0.0, span_s, LAGS) / lesson.dt).astype(int)
    at = np.maximum(np.arange(len(lesson))[:, None] - back, 0)
    return np.concatenate([signal[at] for signal in _felt(lesson)], axis=1)


def _felt(lesson: Demonstration) -> list[Array]:
    return [lesson.velocity] + ([lesson.force] if "force" in lesson.signals else [])


def past(view: View, lesson: Demonstration, ahead: Array) -> Array:
    """(N, L, d) what the view sees from every 0.03 s on; ahead (N, d) is what the skill's roll-out foresees from there."""
    rows = rows_of(lesson)
    parts = [history(lesson, view.span_s)[rows]]
    if view.place:
        parts.append((lesson.position - lesson.position[0])[rows][:, None])
    if view.roll_out:
        parts.append(ahead[:, None])
    return np.concatenate(parts, axis=1)


def sizes_of(view: View, lesson: Demonstration) -> list[int]:
    """How many rows of a `past` belong to one signal: they have one spread."""
    return [LAGS] * len(_felt(lesson)) + [1] * (view.place + view.roll_out)


def fitted(
    shared: bool,
    seen: Sequence[Array],
    truth: Sequence[Array],
    kinds: Sequence[Sequence[int]],
    sizes: Sequence[int],
    penalties: Array = PENALTIES,
) -> tuple[Head, list[Array]]:
    """The head whose penalty foresees lessons left out best, and what heads that have not seen a lesson say of it.

    seen (N, L, d) and truth (N, d) of each lesson, N of truth where it is shorter; one lesson alone is left out by quarters
    kinds     axes by unit (`axes_of`); only within one is a slope shared, or a spread
    sizes     rows of L that have one spread together, in order
    """
    middle, spread = _standard(shared, seen, kinds, sizes)
    whole = [((x - middle) / spread, y) for x, y in zip(seen, truth, strict=True) if len(y)]
    lag, d = middle.shape
    gains, offset = np.zeros((lag, d) if shared else (lag * d, d)), np.zeros(d)
    said = [np.zeros_like(y) for y in truth]
    parts = whole if len(whole) > 1 else [part for x, y in whole for part in _quarters(x, y)]
    for axes in kinds if parts else []:
        solved, left = _ridge([_block(shared, x, y, axes) for x, y in parts], penalties, mean=not shared)
        if shared:
            gains[:, axes] = solved
        else:
            gains[:, axes], offset[axes] = solved[:-1], solved[-1]
        _fill(said, left, axes)
    return Head(shared, middle, spread, gains, offset), said


def _fill(said: Sequence[Array], left: Sequence[Array], axes: Sequence[int]) -> None:
    """What was said of lessons or quarters, in order, put into its axes of the lessons."""
    flat = np.concatenate([x.reshape(-1, len(axes)) for x in left])
    done = 0
    for values in said:
        values[:, axes] = flat[done : done + len(values)]
        done += len(values)


def _standard(shared: bool, seen: Sequence[Array], kinds: Sequence[Sequence[int]], sizes: Sequence[int]) -> tuple[Array, Array]:
    """(L, d) middle and spread of what is seen, one spread a signal and unit: turned axes have the same."""
    every = np.concatenate(list(seen))
    middle = np.zeros(every.shape[1:]) if shared else every.mean(axis=0)
    spread = np.empty_like(middle)
    edges = np.cumsum([0, *sizes])
    for low, high in pairwise(edges):
        for axes in kinds:
            wide = float(np.sqrt(((every - middle)[:, low:high, axes] ** 2).mean()))
            spread[low:high, axes] = wide if wide > 1e-12 * np.abs(every[:, low:high, axes]).max() else np.inf
    return middle, spread


def _quarters(inputs: Array, truth: Array) -> list[tuple[Array, Array]]:
    return [(inputs[part], truth[part]) for part in np.array_split(np.arange(len(truth)), min(4, len(truth))) if len(part)]


def _block(shared: bool, seen: Array, truth: Array, axes: Sequence[int]) -> tuple[Array, Array]:
    """Equations of one lesson: a row a frame, or one a frame and axis where axes share their slopes."""
    seen = seen[: len(truth)]
    if shared:
        return seen[:, :, axes].transpose(0, 2, 1).reshape(-1, seen.shape[1]), truth[:, axes].reshape(-1, 1)
    return np.column_stack([seen.reshape(len(seen), -1), np.ones(len(seen))]), truth[:, axes]


def _ridge(blocks: Sequence[tuple[Array, Array]], penalties: Array, *, mean: bool) -> tuple[Array, list[Array]]:
    """Slopes of the penalty that foresees blocks left out best, and what is said of each block without it."""
    squares = [(z.T @ z, z.T @ y) for z, y in blocks]
    square, cross = np.sum([zz for zz, _ in squares], axis=0), np.sum([zy for _, zy in squares], axis=0)
    penalties = penalties * sum(len(z) for z, _ in blocks)
    left = [z @ _solved(square - zz, cross - zy, penalties, mean) for (z, _), (zz, zy) in zip(blocks, squares, strict=True)]
    costs = np.sum([((said - y) ** 2).sum(axis=(1, 2)) for said, (_, y) in zip(left, blocks, strict=True)], axis=0)
    best = int(np.argmin(costs))
    return _solved(square, cross, penalties[best : best + 1], mean)[0], [said[best] for said in left]


def _solved(square: Array, cross: Array, penalties: Array, mean: bool) -> Array:
    """(penalties, P, outputs); the last column is not held back where it is the mean."""
    held = np.eye(len(square))
    if mean:
        held[-1, -1] = 1e-9  # a sum of no frames has no mean, and is nothing
    every = np.broadcast_to(cross, (len(penalties), *cross.shape))
    return np.asarray(np.linalg.solve(square + penalties[:, None, None] * held, every))
