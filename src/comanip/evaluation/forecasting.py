"""Where will the hand be in a moment? What models of people are for, and where each is held against two simple rules.

constant velocity   x + h v: hard to beat over 0.1 s, useless over one
ridge               a linear map of the last 0.4 s of velocity and force, learned on the same lessons
ours                the ridge with one more input: what the skill's own roll-out foresees

Whether that input helps, and whether a ridge helps at all, is chosen on the lessons themselves, each left out in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..learned.held_out import refitted
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.filtering import ForwardFilter
from ..models.gmr import Regression
from ..models.hmm import Hmm

HORIZONS_S = (0.1, 0.25, 0.5, 1.0)
HISTORY_S, LAGS = 0.4, 9  # of velocity and force, at so many moments
EVERY_S = 0.03  # a forecast is made and learned from so often: neighbouring frames say the same
FADE_S = 0.3  # what the present velocity has more than the model's fades over this time
PENALTIES = tuple(10.0 ** np.arange(-4.0, 3.0))  # of the ridge, in standardised inputs, a frame


class Forecast(NamedTuple):
    """Skill 1 − Σ|error|² / Σ|error of constant velocity|² at each horizon: 1 is perfect, 0 no better than constant velocity.

    horizons_s (H,); ours (H,), ridge (H,); rmse_m (H,) of ours; nan where the lesson is shorter than the horizon
    """

    horizons_s: tuple[float, ...]
    ours: tuple[float, ...]
    ridge: tuple[float, ...]
    rmse_m: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Head:
    """A ridge for one horizon: displacement beyond constant velocity = (inputs − middle) / spread @ gains + offset."""

    middle: Array
    spread: Array
    gains: Array
    offset: Array
    uses_roll_out: bool

    def __call__(self, inputs: Array) -> Array:
        return ((inputs - self.middle) / self.spread) @ self.gains + self.offset


@dataclass(frozen=True, eq=False)
class Forecaster:
    """Forecasts of one skill; `heads` of ours and `ridges` by horizon."""

    learned: LearnedSkill
    heads: tuple[Head, ...]
    ridges: tuple[Head, ...]

    def displacement(self, lesson: Demonstration) -> Array:
        """(H, N, d) from the position of every 0.03 s, foreseen with nothing later [m]."""
        return self._by(self.heads, lesson)

    def _by(self, heads: Sequence[Head], lesson: Demonstration) -> Array:
        rows = _rows(lesson)
        past, ahead = history(lesson)[rows], roll_outs(self.learned.model, lesson)
        found = []
        for h, head in enumerate(heads):
            inputs = np.hstack([past, ahead[h]]) if head.uses_roll_out else past
            found.append(HORIZONS_S[h] * lesson.velocity[rows] + head(inputs))
        return np.array(found)

    def judged(self, lesson: Demonstration) -> Forecast:
        """Against what the lesson really did."""
        ours, ridge = (self._by(heads, lesson) for heads in (self.heads, self.ridges))
        table = []
        for h, horizon in enumerate(HORIZONS_S):
            steps = round(horizon / lesson.dt)
            if steps < 1 or len(lesson) <= steps + 1:
                table.append((np.nan,) * 3)
                continue
            beyond = _beyond(lesson, horizon)
            plain = float((beyond**2).sum())
            carried = horizon * lesson.velocity[_rows(lesson)][: len(beyond)]
            wrong, worse = (float(((beyond + carried - x[h, : len(beyond)]) ** 2).sum()) for x in (ours, ridge))
            skills = (1.0 - wrong / plain, 1.0 - worse / plain) if plain > 0.0 else (np.nan, np.nan)
            table.append((*skills, float(np.sqrt(wrong / len(beyond)))))
        a, b, c = (tuple(float(v) for v in column) for column in zip(*table, strict=True))
        return Forecast(HORIZONS_S, a, b, c)


def history(lesson: Demonstration) -> Array:
    """(T, 2 d LAGS) velocity and force of the last 0.4 s; before the beginning, those of the first frame."""
    back = np.rint(np.linspace(0.0, HISTORY_S, LAGS) / lesson.dt).astype(int)
    at = np.maximum(np.arange(len(lesson))[:, None] - back, 0)
    felt = [lesson.velocity] + ([lesson.force] if "force" in lesson.signals else [])
    return np.hstack([signal[at].reshape(len(lesson), -1) for signal in felt])


def roll_outs(model: Hmm, lesson: Demonstration) -> Array:
    """(H, N, d) how far eq. (5) goes beyond constant velocity from every 0.03 s on, its force held, states moving by the chain.

    What the present velocity has more than the model's fades over 0.3 s.
    """
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    regression = Regression(model, inputs, "velocity")
    frames = lesson.array(model.channels)
    weigher = ForwardFilter(model)
    rows = _rows(lesson)
    h = np.array([weigher.step(xi).copy() for xi in frames])[rows]
    start, velocity, d = lesson.position[rows], lesson.velocity[rows], lesson.position.shape[1]
    felt = lesson.array(regression.inputs)[rows][:, d:]
    low, high = start - 10.0 * _reach(model), start + 10.0 * _reach(model)
    x, found, done = start, [], 0
    extra: Array | None = None
    for horizon in HORIZONS_S:
        for _ in range(round(horizon / lesson.dt) - done):
            v = np.einsum("tk,tko->to", h, regression.means_per_state(np.hstack([x, felt])))
            extra = velocity - v if extra is None else extra * np.exp(-lesson.dt / FADE_S)
            x = np.clip(x + lesson.dt * (v + extra), low, high)
            h = h @ model.transition
            done += 1
        found.append(x - start - horizon * velocity)
    return np.array(found)


def _reach(model: Hmm) -> Array:
    """(d,) standard deviation of each position over the whole task."""
    columns = [i for i, c in enumerate(model.channels) if c.startswith("position.")]
    means = model.means[:, columns]
    own = np.einsum("kii->ki", model.covariances)[:, columns]
    return np.sqrt(means.var(axis=0) + own.mean(axis=0))


def forecaster(learned: LearnedSkill, lessons: Sequence[Demonstration]) -> Forecaster:
    """Learns the heads on the skill's lessons; the roll-outs that they learn from are of models which have not seen the lesson.

    On one lesson nothing can be chosen by another: there the ridge alone is learned, and chosen by quarters of the lesson.
    """
    if not lessons:
        raise ParameterError("there is no lesson to learn a forecaster from; give at least one, two to choose by")
    frames = [x.array(learned.model.channels) for x in lessons]
    models = [
        refitted(learned.model, [y for j, y in enumerate(frames) if j != i], {}) or learned.model for i in range(len(frames))
    ]
    past = [history(x)[_rows(x)] for x in lessons]
    ahead = [roll_outs(model, x) for model, x in zip(models, lessons, strict=True)]
    heads, ridges = [], []
    for h, horizon in enumerate(HORIZONS_S):
        truth = [_beyond(x, horizon) for x in lessons]
        plain, plain_cost = _ridge(past, truth, False)
        both, cost = _ridge([np.hstack([p, a[h]]) for p, a in zip(past, ahead, strict=True)], truth, True)
        ridges.append(plain)
        heads.append(both if cost < plain_cost and len(lessons) > 1 else plain)
    return Forecaster(learned, tuple(heads), tuple(ridges))


def _rows(lesson: Demonstration) -> np.ndarray:
    return np.arange(0, len(lesson), max(1, round(EVERY_S / lesson.dt)))


def _beyond(lesson: Demonstration, horizon: float) -> Array:
    """(N, d) displacement over the horizon beyond constant velocity, from every 0.03 s that has one."""
    steps = round(horizon / lesson.dt)
    if steps >= len(lesson):
        return np.zeros((0, lesson.position.shape[1]))
    rows = _rows(lesson)
    rows = rows[rows + steps < len(lesson)]
    return np.asarray(lesson.position[rows + steps] - lesson.position[rows] - horizon * lesson.velocity[rows])


def _ridge(inputs: Sequence[Array], truth: Sequence[Array], uses_roll_out: bool) -> tuple[Head, float]:
    """The ridge whose penalty foresees lessons left out best, and its squared error on them."""
    pairs = [(x[: len(y)], y) for x, y in zip(inputs, truth, strict=True) if len(y)]
    width, d = inputs[0].shape[1], truth[0].shape[1]
    if not pairs:
        return Head(np.zeros(width), np.ones(width), np.zeros((width, d)), np.zeros(d), uses_roll_out), 0.0
    every = np.concatenate([x for x, _ in pairs])
    middle, spread = every.mean(axis=0), every.std(axis=0)
    spread[spread < 1e-12 * np.abs(every).max()] = np.inf
    pairs = pairs if len(pairs) > 1 else _quarters(*pairs[0])
    blocks = [(np.column_stack([(x - middle) / spread, np.ones(len(x))]), y) for x, y in pairs]
    squares = [(z.T @ z, z.T @ y) for z, y in blocks]
    total = sum((zz for zz, _ in squares), np.zeros(())), sum((zy for _, zy in squares), np.zeros(()))
    frames = sum(len(z) for z, _ in blocks)
    costs = [_left_out(blocks, squares, total, penalty * frames) for penalty in PENALTIES]
    best = int(np.argmin(costs))
    nothing = float(sum((y**2).sum() for _, y in blocks))
    if nothing <= costs[best]:  # constant velocity foresees lessons left out better than any ridge does
        return Head(middle, spread, np.zeros((width, d)), np.zeros(d), uses_roll_out), nothing
    solved = _solved(total[0], total[1], PENALTIES[best] * frames)
    return Head(middle, spread, solved[:-1], solved[-1], uses_roll_out), costs[best]


def _quarters(inputs: Array, truth: Array) -> list[tuple[Array, Array]]:
    return [(inputs[part], truth[part]) for part in np.array_split(np.arange(len(truth)), min(4, len(truth))) if len(part)]


def _left_out(
    blocks: Sequence[tuple[Array, Array]], squares: Sequence[tuple[Array, Array]], total: tuple[Array, Array], penalty: float
) -> float:
    found = 0.0
    for (z, y), (zz, zy) in zip(blocks, squares, strict=True):
        found += float(((y - z @ _solved(total[0] - zz, total[1] - zy, penalty)) ** 2).sum())
    return found


def _solved(square: Array, cross: Array, penalty: float) -> Array:
    held = penalty * np.eye(len(square))
    held[-1, -1] = 0.0  # the mean is not held back
    return np.asarray(np.linalg.lstsq(square + held, cross, rcond=None)[0])


def leave_one_out(
    lessons: Sequence[Demonstration], learn: Callable[[list[Demonstration]], LearnedSkill], takes: Sequence[object] | None = None
) -> list[Forecast]:
    """Each lesson foreseen by a forecaster of the others; pieces of one take (equal `takes`) are left out together."""
    takes = list(range(len(lessons))) if takes is None else list(takes)
    found = []
    for i, lesson in enumerate(lessons):
        others = [x for x, take in zip(lessons, takes, strict=True) if take != takes[i]]
        found.append(forecaster(learn(others), others).judged(lesson))
    return found
