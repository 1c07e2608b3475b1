"""Where will the hand be in a moment? What models of people are for, and where each is held against two simple rules.

constant velocity   x + h v: hard to beat over 0.1 s, useless over one
ridge               a linear map of the last 0.4 s of velocity and force, learned on the same lessons
ours                a weighted mean of several such maps (`heads`): of a longer and a shorter past, with one slope for all axes,
                    with the place, with what the skill's own roll-out foresees

Weights are learned on lessons left out in turn (`stacking`); where these are fewer than three all maps weigh the same.
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
from .heads import RIDGE, VIEWS, Head, View, axes_of, fitted, past, rows_of, sizes_of
from .stacking import weights
from .takes import folds_of

HORIZONS_S = (0.1, 0.25, 0.5, 1.0)
FADE_S = 0.3  # what the present velocity has more than the model's fades over this time
ENOUGH = 3  # lessons from which weights are learned: of two, one is odd and nobody knows which


class Forecast(NamedTuple):
    """Skill 1 − Σ|error|² / Σ|error of constant velocity|² at each horizon: 1 is perfect, 0 no better than constant velocity.

    horizons_s (H,); ours (H,), ridge (H,), the mean over units where axes have several; rmse_m (H,) of ours; nan where the
    lesson is shorter than the horizon
    """

    horizons_s: tuple[float, ...]
    ours: tuple[float, ...]
    ridge: tuple[float, ...]
    rmse_m: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Mixture:
    """Displacement beyond constant velocity over one horizon: views, a head each, and weights (V, d) of what they say."""

    views: tuple[View, ...]
    heads: tuple[Head, ...]
    weights: Array

    def __call__(self, lesson: Demonstration, ahead: Array) -> Array:
        """(N, d) from every 0.03 s on; ahead (N, d) as `roll_outs` has it."""
        used = [(v, h, w) for v, h, w in zip(self.views, self.heads, self.weights, strict=True) if w.any()]
        said = [w * head(past(view, lesson, ahead)) for view, head, w in used]
        return np.sum(said, axis=0) if said else np.zeros_like(ahead)


@dataclass(frozen=True, eq=False)
class Forecaster:
    """Forecasts of one skill, by horizon: ours, and the ridge alone."""

    learned: LearnedSkill
    mixtures: tuple[Mixture, ...]
    ridges: tuple[Mixture, ...]

    def displacement(self, lesson: Demonstration) -> Array:
        """(H, N, d) from the position of every 0.03 s, foreseen with nothing later [m]."""
        return self._by(self.mixtures, lesson)

    def _by(self, mixtures: Sequence[Mixture], lesson: Demonstration) -> Array:
        ahead, velocity = roll_outs(self.learned.model, lesson), lesson.velocity[rows_of(lesson)]
        return np.array([h * velocity + mixtures[i](lesson, ahead[i]) for i, h in enumerate(HORIZONS_S)])

    def judged(self, lesson: Demonstration) -> Forecast:
        """Against what the lesson really did."""
        ours, ridge = (self._by(mixtures, lesson) for mixtures in (self.mixtures, self.ridges))
        table: list[tuple[float, float, float]] = []
        for i, horizon in enumerate(HORIZONS_S):
            beyond = _beyond(lesson, horizon)
            if len(beyond) < 1 or len(lesson) <= round(horizon / lesson.dt) + 1 or round(horizon / lesson.dt) < 1:
                table.append((np.nan, np.nan, np.nan))
                continue
            truth = beyond + horizon * lesson.velocity[rows_of(lesson)][: len(beyond)]
            apart = [truth - x[i, : len(beyond)] for x in (ours, ridge)]
            skill, plain = (_skill(wrong, beyond, axes_of(lesson)) for wrong in apart)
            table.append((skill, plain, float(np.sqrt((apart[0] ** 2).sum() / len(beyond)))))
        a, b, c = (tuple(float(v) for v in column) for column in zip(*table, strict=True))
        return Forecast(HORIZONS_S, a, b, c)


def _skill(wrong: Array, beyond: Array, kinds: Sequence[Sequence[int]]) -> float:
    """1 − Σ|wrong|² / Σ|beyond constant velocity|², the mean over units in which something goes beyond it."""
    plain = [float((beyond[:, axes] ** 2).sum()) for axes in kinds]
    found = [1.0 - float((wrong[:, axes] ** 2).sum()) / p for axes, p in zip(kinds, plain, strict=True) if p > 0.0]
    return float(np.mean(found)) if found else float("nan")


def roll_outs(model: Hmm, lesson: Demonstration) -> Array:
    """(H, N, d) how far eq. (5) goes beyond constant velocity from every 0.03 s on, its force held, states moving by the chain.

    What the present velocity has more than the model's fades over 0.3 s.
    """
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    regression = Regression(model, inputs, "velocity")
    frames = lesson.array(model.channels)
    weigher = ForwardFilter(model)
    rows = rows_of(lesson)
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
    """Learns heads and weights on the skill's lessons, with roll-outs of models which have not seen the lesson.

    On one lesson no roll-out is used: there is no model that has not seen it.
    """
    if not lessons:
        raise ParameterError("there is no lesson to learn a forecaster from; give at least one, two to choose by")
    ahead = _unseen_roll_outs(learned.model, lessons)
    views = VIEWS if ahead is not None else tuple(v for v in VIEWS if not v.roll_out)
    if ahead is None:
        ahead = [np.zeros((len(HORIZONS_S), len(rows_of(x)), x.position.shape[1])) for x in lessons]
    both = [_mixture(views, lessons, [a[i] for a in ahead], horizon) for i, horizon in enumerate(HORIZONS_S)]
    return Forecaster(learned, tuple(ours for ours, _ in both), tuple(ridge for _, ridge in both))


def _unseen_roll_outs(model: Hmm, lessons: Sequence[Demonstration]) -> list[Array] | None:
    """(H, N, d) for each lesson, by a model of the others; None where there are none."""
    folds = folds_of(lessons, len(lessons))
    if len(folds) < 2:
        return None
    frames = [x.array(model.channels) for x in lessons]
    found: dict[int, Array] = {}
    for out in folds:
        unseen = refitted(model, [x for i, x in enumerate(frames) if i not in out], {}) or model
        found |= {i: roll_outs(unseen, lessons[i]) for i in out}
    return [found[i] for i in range(len(lessons))]


def _mixture(
    views: Sequence[View], lessons: Sequence[Demonstration], ahead: Sequence[Array], horizon: float
) -> tuple[Mixture, Mixture]:
    """(ours, the ridge alone); each is constant velocity where that foresees lessons left out better."""
    truth, kinds = [_beyond(x, horizon) for x in lessons], axes_of(lessons[0])
    heads, said = [], []
    for view in views:
        seen = [past(view, x, a) for x, a in zip(lessons, ahead, strict=True)]
        head, left = fitted(view.shared, seen, truth, kinds, sizes_of(view, lessons[0]))
        heads.append(head)
        said.append(left)
    guesses = [np.stack([left[i] for left in said]) for i in range(len(lessons))]
    chosen = np.zeros((len(views), lessons[0].position.shape[1]))
    alone = np.zeros_like(chosen)
    for axes in kinds:
        parts = [g[:, :, axes] for g in guesses], [y[:, axes] for y in truth]
        enough = sum(len(y) > 0 for y in truth) >= ENOUGH
        chosen[:, axes] = (weights(*parts) if enough else _if_better(np.full(len(views), 1.0 / len(views)), *parts))[:, None]
        alone[:, axes] = _if_better(np.eye(len(views))[views.index(RIDGE)], *parts)[:, None]
    return Mixture(tuple(views), tuple(heads), chosen), Mixture(tuple(views), tuple(heads), alone)


def _if_better(stated: Array, guesses: Sequence[Array], truth: Sequence[Array]) -> Array:
    """The stated weights, or none at all where constant velocity foresees lessons left out better."""
    wrong = sum(float(((np.einsum("c,cnd->nd", stated, g) - y) ** 2).sum()) for g, y in zip(guesses, truth, strict=True))
    return stated if wrong < sum(float((y**2).sum()) for y in truth) else np.zeros_like(stated)


def _beyond(lesson: Demonstration, horizon: float) -> Array:
    """(N, d) displacement over the horizon beyond constant velocity, from every 0.03 s that has one."""
    steps = round(horizon / lesson.dt)
    if steps >= len(lesson):
        return np.zeros((0, lesson.position.shape[1]))
    rows = rows_of(lesson)
    rows = rows[rows + steps < len(lesson)]
    return np.asarray(lesson.position[rows + steps] - lesson.position[rows] - horizon * lesson.velocity[rows])


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
