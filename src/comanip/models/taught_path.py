"""The path that lessons share: where the hand is and what it feels, at every moment of the usual motion.

Lessons of one task differ in pace, in size and by where they begin. They are brought onto one time axis by dynamic time warping
of their shapes (position, direction and share of the way, all without units), and averaged there:

    t(p) = mean_i w_i(p)        x(p) = mean_i x_i(w_i(p))        F(p) = mean_i F_i(w_i(p))

with w_i(p) the time in lesson i that belongs to phase p. A rest then lasts as long as it did on average, a path that returns,
crosses itself or repeats is one path through all of it, and its ends are the means of the lessons' ends. A few Gaussians over
phase cannot do that: they cut corners and leave out cycles.

Lessons that go elsewhere, or elsewhere around, are not averaged: they are another goal (`goals_of`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..errors import TrainingError
from ..interfaces import Array
from ..recording import frozen
from ..signals.filters import smooth

MOVING = 0.03  # share of the top speed that counts as motion
LEFT = 0.03  # share of the extent: so far from where it rested, the hand has left
POINTS_PER_S = 100
ROWS, ROW_S = 200, 0.02  # of the longest lesson in the warping, which costs their square, and never finer than this
CUTOFFS_HZ = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
KEPT = 0.004  # share of the extent by which smoothing may move a lesson's path anywhere
OFF_DIAGONAL = 0.002  # what a step that is no step in both costs: of equally good warpings the straightest
ELSEWHERE = 0.25  # share of the extent from which a path leads elsewhere ...
APART = 3.0  # ... if it is so many times farther off than lessons usually are from their nearest
STRAY = 4.0  # a lesson that fits its goal's path so many times worse than usual is left out


@dataclass(frozen=True, eq=False)
class TaughtPath:
    """One goal's path over the MOVING part of the task; rest before and after is left out.

    step_s            between rows [s]
    position, force   (N, d) [m], [N]
    spread            (N,) [m] how far lessons lie from `position` at equal phase, root mean square
    ends              (lessons, d) where each of its lessons ended [m]
    framed            (2, N) [m] the same seen from where each lesson began, and from where each ended; see `models.frames`
    """

    step_s: float
    position: Array
    force: Array
    spread: Array
    ends: Array
    framed: Array = field(default_factory=lambda: np.zeros((2, 0)))

    def __post_init__(self) -> None:
        if not self.framed.size:  # of a skill that does not say: as if lessons drifted apart evenly
            share = np.sqrt(np.linspace(0.0, 1.0, len(self.position)))
            object.__setattr__(self, "framed", np.stack([share, share[::-1]]))
        for name in ("position", "force", "spread", "ends", "framed"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __repr__(self) -> str:
        return f"TaughtPath({len(self.ends)} lessons, {self.step_s * (len(self.position) - 1):.2f} s, {self.length_m:.3g} m)"

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())


class Motion(NamedTuple):
    """The moving part of a lesson: smoothed position and force (T, d), and when it began [s]."""

    position: Array
    force: Array
    onset_s: float


def taught_paths(positions: Sequence[Array], forces: Sequence[Array], dt: float) -> tuple[tuple[TaughtPath, ...], Array]:
    """The path to each goal, most lessons first, and the onset of each lesson (lessons,) [s].

    positions, forces   (T, d) of each lesson [m], [N], every `dt` [s]
    """
    extent = max(_extent(p) for p in positions)
    if not extent > 0.0:
        raise TrainingError("the lessons show no motion to learn: the hand's position is the same throughout")
    cutoff_hz = _cutoff(positions, dt, extent)
    moving = [_moving(p, f, dt, cutoff_hz) for p, f in zip(positions, forces, strict=True)]
    ends = np.array([p[-1] for p in positions])
    goals = goals_of([m.position for m in moving], extent)
    paths = tuple(_path([moving[i] for i in goal], ends[goal], dt, cutoff_hz, extent) for goal in goals)
    return paths, np.array([m.onset_s for m in moving])


def _extent(position: Array) -> float:
    """How far from where it begins the hand ever is [m]."""
    return float(np.linalg.norm(position - position[0], axis=1).max())


def _cutoff(positions: Sequence[Array], dt: float, extent: float) -> float:
    """The lowest cutoff [Hz] that leaves the paths where they are: what is beyond it is noise of the sensor."""
    highest = 0.4 / dt
    for cutoff_hz in CUTOFFS_HZ:
        if cutoff_hz >= highest:
            break
        moved = max(float(np.linalg.norm(smooth(p, dt, cutoff_hz) - p, axis=1).max()) for p in positions)
        if moved < KEPT * extent:
            return cutoff_hz
    return min(CUTOFFS_HZ[-1], highest)


def _moving(position: Array, force: Array, dt: float, cutoff_hz: float) -> Motion:
    position, force = smooth(position, dt, cutoff_hz), smooth(force, dt, cutoff_hz)
    speed = np.linalg.norm(np.gradient(position, dt, axis=0), axis=1)
    fast = speed > MOVING * speed.max()
    first = _leaves(position, fast)
    last = len(position) - 1 - _leaves(position[::-1], fast[::-1])
    if last - first < 5:
        raise TrainingError("the lessons show no motion to learn: the hand's speed is zero throughout")
    part = slice(first, last + 1)
    return Motion(position[part], force[part], first * dt)


def _leaves(position: Array, fast: np.ndarray) -> int:
    """The frame at which the hand begins to leave where it rests; a twitch that leads nowhere does not count."""
    away = np.linalg.norm(position - position[0], axis=1)
    gone = int(np.argmax(away > LEFT * away.max()))
    slow = np.flatnonzero(~fast[:gone])
    return int(slow[-1]) if len(slow) else 0


# goals


def goals_of(paths: Sequence[Array], extent: float) -> list[list[int]]:
    """Indices of the lessons that go the same way to the same place, most lessons first.

    Paths are compared at equal shares of their length, so pace does not matter; single linkage, cut where the step from one
    lesson to the nearest of another group is both large beside the task and unusual beside the others.
    """
    n = len(paths)
    shares = np.array([_by_length(p, 50) for p in paths])
    apart = np.linalg.norm(shares[:, None] - shares[None], axis=3).max(axis=2)
    edges = _spanning(apart)
    usual = float(np.median([length for *_, length in edges])) if edges else 0.0
    group = list(range(n))
    for i, j, length in edges:
        if length <= max(ELSEWHERE * extent, APART * usual):
            group = [group[i] if g == group[j] else g for g in group]
    found = [[i for i in range(n) if group[i] == g] for g in dict.fromkeys(group)]
    return sorted(found, key=lambda goal: (-len(goal), goal[0]))


def _by_length(path: Array, n: int) -> Array:
    way = _way(path)
    return np.stack([np.interp(np.linspace(0.0, way[-1], n), way, column) for column in path.T], axis=1)


def _way(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _spanning(apart: Array) -> list[tuple[int, int, float]]:
    """Edges (i, j, length) of the smallest tree that joins all (Prim)."""
    nearest, best, edges = np.zeros(len(apart), dtype=int), apart[0].copy(), []
    best[0] = np.inf
    for _ in range(len(apart) - 1):
        j = int(best.argmin())
        edges.append((int(nearest[j]), j, float(best[j])))
        nearer = (apart[j] < best) & np.isfinite(best)
        best[nearer], nearest[nearer] = apart[j][nearer], j
        best[j] = np.inf
    return edges


# alignment


def _path(lessons: Sequence[Motion], ends: Array, dt: float, cutoff_hz: float, extent: float) -> TaughtPath:
    """The mean of lessons of one goal."""
    step_s = max(max(len(m.position) for m in lessons) * dt / ROWS, ROW_S)
    rough = [_resampled(m.position, dt, step_s) for m in lessons]
    template = rough[int(np.argsort([len(r) for r in rough], kind="stable")[len(rough) // 2])]
    fits = [True] * len(lessons)
    for _ in range(2):
        warps, costs = _warped(template, rough)
        fits = [c <= STRAY * float(np.median(costs)) or len(lessons) < 4 for c in costs]
        used = [w for w, fit in zip(warps, fits, strict=True) if fit]
        time = np.mean(used, axis=0)
        mean = np.mean([_at(r, w) for r, w, fit in zip(rough, warps, fits, strict=True) if fit], axis=0)
        even = np.linspace(0.0, time[-1], max(round(float(time[-1])), 5) + 1)
        template = np.stack([np.interp(even, time, column) for column in mean.T], axis=1)
    n = max(round(float(time[-1]) * step_s * POINTS_PER_S), 50) + 1
    phase = np.linspace(0.0, time[-1], n)
    frames = [np.interp(phase, time, w) * step_s / dt for w in used]
    lessons = [m for m, fit in zip(lessons, fits, strict=True) if fit]
    each = np.array([_at(m.position, f) for m, f in zip(lessons, frames, strict=True)])
    force = np.mean([_at(m.force, f) for m, f in zip(lessons, frames, strict=True)], axis=0)
    row_s = float(phase[1]) * step_s
    position = smooth(each.mean(axis=0), row_s, cutoff_hz)
    ends = ends[fits]
    position = _between(position, each[:, 0].mean(axis=0), ends.mean(axis=0))
    force = smooth(force, row_s, cutoff_hz)
    spread = np.sqrt(np.square(each - position).sum(axis=2).mean(axis=0))
    framed = np.stack([_apart(each - each[:, :1]), _apart(each - each[:, -1:])])
    # F is what the partner does beyond carrying a share: at rest nothing, so offsets of a sensor are not expected again
    return TaughtPath(row_s, position, force - np.linspace(force[0], force[-1], len(force)), spread, ends, framed)


def _apart(each: Array) -> Array:
    """(N,) how far lessons (n, N, d) lie from their mean, root mean square."""
    return np.asarray(np.sqrt(np.square(each - each.mean(axis=0)).sum(axis=2).mean(axis=0)))


def _between(path: Array, start: Array, end: Array) -> Array:
    """The path moved to begin and end where it should, by an addition spread along its length: its shape stays what it is."""
    share = _way(path)[:, None]
    share /= share[-1]
    return np.asarray(path + (1.0 - share) * (start - path[0]) + share * (end - path[-1]))


def _resampled(position: Array, dt: float, step_s: float) -> Array:
    n = max(round((len(position) - 1) * dt / step_s), 5)
    return _at(position, np.linspace(0.0, len(position) - 1.0, n + 1))


def _at(table: Array, place: Array) -> Array:
    """Rows (N, d) of `table` at fractional `place` (N,)."""
    n = np.clip(place.astype(int), 0, len(table) - 2)
    share = (place - n)[:, None]
    return np.asarray((1.0 - share) * table[n] + share * table[n + 1])


def _features(path: Array) -> Array:
    """What warping compares: shape, direction and share of the way; of a path twice as long the same."""
    velocity = np.gradient(path, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    top = float(speed.max())
    way = np.cumsum(np.where(speed > MOVING * top, speed, 0.0))
    shape = (path - path[0]) / max(_extent(path), 1e-300)
    return np.column_stack([shape, 0.5 * velocity / max(top, 1e-300), way / max(float(way[-1]), 1e-300)])


def _warped(template: Array, paths: Sequence[Array]) -> tuple[list[Array], list[float]]:
    """For each path its place (rows of the path) that belongs to each row of the template (N,), and how badly they fit."""
    a, n = _features(template), len(template)
    longest = max(map(len, paths))
    cost = np.full((len(paths), n, longest), np.inf)
    for s, path in enumerate(paths):
        b = _features(path)
        cost[s, :, : len(b)] = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    came = _cheapest(cost)
    warps, fits = [], []
    for s, path in enumerate(paths):
        rows, columns = _back(came[:, s], n - 1, len(path) - 1)
        fits.append(float(np.sqrt(cost[s, rows, columns].mean())))
        warps.append(_steady(np.bincount(rows, columns) / np.bincount(rows), len(path) - 1.0))
    return warps, fits


def _cheapest(cost: Array) -> np.ndarray:
    """Whence the cheapest way to each pair, by antidiagonals (N + M - 1, S, N): 0 from both, 1 from row, 2 from column."""
    size, n, m = cost.shape
    came = np.zeros((n + m - 1, size, n), dtype=np.int8)
    before, last = np.full((2, size, n + 1), np.inf)  # shifted by one: index 0 is outside
    rows = np.arange(n)
    for k in range(n + m - 1):
        i = rows[max(0, k - m + 1) : min(n, k + 1)]
        options = np.stack([before[:, i], last[:, i] + OFF_DIAGONAL, last[:, i + 1] + OFF_DIAGONAL])
        choice = options.argmin(axis=0)
        came[k][:, i] = choice
        best = np.take_along_axis(options, choice[None], axis=0)[0]
        now = np.full((size, n + 1), np.inf)
        now[:, i + 1] = cost[:, i, k - i] + (0.0 if k == 0 else best)
        before, last = last, now
    return came


def _back(came: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    pairs = [(i, j)]
    while i or j:
        step = came[i + j, i] if i and j else (1 if i else 2)
        i, j = i - (step != 2), j - (step != 1)
        pairs.append((i, j))
    rows, columns = np.array(pairs[::-1]).T
    return rows, columns


def _steady(warp: Array, last: float) -> Array:
    """Warping goes by whole rows, like a staircase; nobody does. Begins and ends with both, and never goes back."""
    line = np.linspace(0.0, last, len(warp))
    half = max(len(warp) // 60, 2)
    off = np.concatenate([np.zeros(half), warp - line, np.zeros(half)])
    window = np.hanning(2 * half + 3)[1:-1]
    smoothed = line + np.convolve(off, window / window.sum(), mode="valid")
    smoothed[0], smoothed[-1] = 0.0, last
    return np.asarray(np.clip(np.maximum.accumulate(smoothed), 0.0, last))
