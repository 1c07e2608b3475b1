"""Dynamic time warping: lessons of the same task, done at different speeds, brought onto one time axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import ParameterError
from ..interfaces import Array
from .agreement import lessons_only
from .demonstration import Demonstration

Frames = NDArray[np.int64]
MAX_FRAMES = 5000  # the table of path costs is T x T float64: 200 MB


def warping_path(a: Array, b: Array, *, band: float = 1.0) -> tuple[Frames, Frames]:
    """(i, j), the frames of `a` (T, D) and `b` (S, D) that belong together; O(T S) time and memory.

    The path starts and ends with both, never goes back, and moves by one frame in `a`, in `b` or in both. `band` is the
    fraction of the length by which the path may leave the diagonal. Scale the columns alike before: the cost is their
    squared distance. Raises ParameterError beyond 5000 frames: resample first.
    """
    if max(len(a), len(b)) > MAX_FRAMES or min(len(a), len(b)) < 1:
        raise ParameterError(f"warping of {len(a)} and {len(b)} frames; allowed: 1 to {MAX_FRAMES}: resample first")
    if not 0.0 < band <= 1.0:
        raise ParameterError(f"band is {band:g}; allowed: 0 < band <= 1")
    total = _path_costs(a, b, band)
    i, j = len(a) - 1, len(b) - 1
    path = [(i, j)]
    while i or j:
        steps = [(i - 1, j - 1), (i - 1, j), (i, j - 1)]
        i, j = min(steps, key=lambda s: total[s[0] + 1, s[1] + 1])
        path.append((i, j))
    rows, columns = np.array(path[::-1], dtype=np.int64).T
    return rows, columns


def _path_costs(a: Array, b: Array, band: float) -> Array:
    """(T + 1, S + 1) cheapest cost of reaching each pair, padded with infinity; filled one antidiagonal at a time."""
    size_a, size_b = len(a), len(b)
    total = np.full((size_a + 1, size_b + 1), np.inf)
    total[0, 0] = 0.0
    width = band * max(size_a, size_b) + 1.0
    for d in range(size_a + size_b - 1):
        i = np.arange(max(0, d - size_b + 1), min(size_a, d + 1))
        j = d - i
        near = np.abs(i * (size_b / size_a) - j) <= max(width, size_b / size_a)
        i, j = i[near], j[near]
        before = np.minimum(np.minimum(total[i, j], total[i, j + 1]), total[i + 1, j])
        total[i + 1, j + 1] = ((a[i] - b[j]) ** 2).sum(axis=1) + before
    return total


def align(
    lessons: Sequence[Demonstration],
    *,
    by: str | Iterable[str] = "position",
    reference: int | None = None,
    band: float = 1.0,
) -> tuple[Demonstration, ...]:
    """The lessons warped onto the time axis of one of them (default: the one of median length).

    `by` names the channels that decide; each is scaled by its spread over all lessons, so units do not matter. Where
    several frames fall on one of the reference's, their mean is taken. Velocities keep their values: they are the
    lesson's own, not the derivative of the warped position, and the notes say so.
    """
    lessons = lessons_only(lessons)
    if reference is None:
        reference = sorted(range(len(lessons)), key=lambda k: len(lessons[k]))[len(lessons) // 2]
    by = (by,) if isinstance(by, str) else tuple(by)
    spread = np.concatenate([lesson.array(by) for lesson in lessons]).std(axis=0)
    spread[spread == 0.0] = 1.0
    if not -len(lessons) <= reference < len(lessons):
        raise ParameterError(f"reference is {reference}; allowed: 0 to {len(lessons) - 1}")
    target = lessons[reference]
    return tuple(lesson if lesson is target else _warped(lesson, target, by, spread, band) for lesson in lessons)


def _warped(lesson: Demonstration, target: Demonstration, by: tuple[str, ...], spread: Array, band: float) -> Demonstration:
    i, j = warping_path(target.array(by) / spread, lesson.array(by) / spread, band=band)
    share = np.bincount(i, minlength=len(target))[:, None]
    signals = {}
    for name, values in lesson.signals.items():
        sums = np.zeros((len(target), values.shape[1]))
        np.add.at(sums, i, values[j])
        signals[name] = sums / share
    note = f"warped in time onto {target.name} by {', '.join(by)} (velocities are those of the original timing)"
    return replace(lesson, signals=signals, notes=(*lesson.notes, note))
