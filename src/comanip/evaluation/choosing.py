"""Choices made by the figures that are reported: each lesson foreseen by what was learned from the others, without it.

What is usual is left only for something that is better by more than the lessons differ: with a handful of lessons the smallest
of ten figures is mostly chance.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ComanipError, ParameterError
from ..interfaces import Array
from ..learned.learn import learn
from ..lessons.demonstration import Demonstration
from .following import free_run, one_step_velocity
from .takes import folds_of
from .yardsticks import standing_still

FOLDS = 5
WORST = 2.0  # what one lesson may say against a choice: one in which nothing moves must not choose for all
BUDGET_S = 60.0


def losses(lessons: Sequence[Demonstration], **learning: Any) -> Array:
    """(L,) of each lesson left out: the mean of 1 − R² of the next velocity and of a free run's error in that of standing still.

    0 is perfect, 1 what knowing nothing reaches. `learning` goes to `learn`; inf where nothing can be learned.
    """
    found = np.full(len(lessons), np.inf)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for out in folds_of(lessons, FOLDS):
            try:
                learned = learn([x for i, x in enumerate(lessons) if i not in out], **learning)
                for i in out:
                    speed = _share(one_step_velocity(learned, lessons[i]), lessons[i].velocity, lessons[i].velocity.mean(axis=0))
                    place = _share(free_run(learned, lessons[i]), lessons[i].position, standing_still(lessons[i]))
                    found[i] = 0.5 * (min(WORST, speed) + min(WORST, float(np.sqrt(place))))
            except ComanipError:
                continue
    return found


def _share(guess: Array, truth: Array, plain: Array) -> float:
    """Squared error in that of a plain guess."""
    worst = float(((truth - plain) ** 2).sum())
    return float(((guess - truth) ** 2).sum()) / worst if worst > 0.0 else 0.0


def clearly_better(one: Array, usual: Array) -> bool:
    """Whether one's losses are below the usual one's by more than the standard error of their difference over lessons."""
    if not np.isfinite(usual).all():
        return bool(np.isfinite(one).all())
    apart = np.asarray(usual) - np.asarray(one)
    return bool(np.isfinite(one).all() and apart.mean() > apart.std(ddof=1) / np.sqrt(len(apart)))


@dataclass(frozen=True)
class States:
    """n_states chosen of `tried`: number of states -> mean loss; `whole` where none was left untried for want of time."""

    n_states: int
    tried: Mapping[int, float]
    whole: bool

    def __str__(self) -> str:
        shown = ", ".join(f"{k}: {loss:.3f}" for k, loss in sorted(self.tried.items()))
        late = "" if self.whole else "; there was no time for the others"
        return f"states: {self.n_states} (error on lessons left out, of knowing nothing: {shown}{late})"


def choose_states(
    lessons: Sequence[Demonstration],
    candidates: Iterable[int] = range(3, 13),
    *,
    usual: int = 10,
    budget_s: float = BUDGET_S,
    progress: Callable[[int, int], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
    **learning: Any,
) -> States:
    """Another number of states than the usual one only where it is clearly better; the nearest are tried first, until the time is
    over. Needs two recordings."""
    if len(folds_of(lessons, FOLDS)) < 2:
        raise ParameterError(
            f"a number of states is chosen by lessons left out; allowed: 2 recordings or more; got {len(lessons)}"
        )
    order = [usual, *sorted({int(k) for k in candidates} - {usual}, key=lambda k: (abs(np.log(k / usual)), k))]
    found: dict[int, Array] = {}
    started = clock()
    for done, k in enumerate(order):
        if found and clock() - started >= budget_s:
            break
        found[k] = losses(lessons, n_states=k, **learning)
        if progress is not None:
            progress(done + 1, len(order))
    rivals = [k for k in found if k != usual and clearly_better(found[k], found[usual])]
    best = min(rivals, key=lambda k: float(found[k].mean()), default=usual)
    return States(best, {k: float(v.mean()) for k, v in found.items()}, len(found) == len(order))


@dataclass(frozen=True)
class Tare:
    """Whether to take the force of the rest at the start off each recording: mean loss as recorded, and tared."""

    tare: bool
    as_recorded: float
    tared: float

    def __str__(self) -> str:
        which = "taken off" if self.tare else "left as recorded"
        return (
            f"force at rest {which}: error on lessons left out, of knowing nothing, {self.as_recorded:.3f} as recorded, "
            f"{self.tared:.3f} tared"
        )


def choose_tare(recorded: Sequence[Demonstration], tared: Sequence[Demonstration], **learning: Any) -> Tare:
    """The same lessons as recorded and tared; tared only where that is clearly better on lessons left out."""
    plain, other = losses(recorded, **learning), losses(tared, **learning)
    return Tare(clearly_better(other, plain), float(plain.mean()), float(other.mean()))
