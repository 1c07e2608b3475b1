"""How many states? A table of scores, and the choice that follows from it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from .hmm import fit_hmm, log_likelihood


@dataclass(frozen=True, eq=False)
class Selection:
    """n_states chosen; candidates (C,) and scores (C,), SMALLER is better; `criterion` says what the scores are.

    "bic": Bayesian information criterion. "cross-validation": −log-likelihood per frame of demonstrations left out.
    """

    n_states: int
    candidates: tuple[int, ...]
    scores: Array
    criterion: str

    def __str__(self) -> str:
        rows = [
            f"{k:4d}  {s:14.4f}{'  <' if k == self.n_states else ''}" for k, s in zip(self.candidates, self.scores, strict=True)
        ]
        return "\n".join([f"   K  {self.criterion}", *rows])


def select_states(
    sequences: Sequence[Any],
    candidates: Iterable[int],
    *,
    channels: Iterable[str],
    criterion: str = "bic",
    folds: int | None = None,
    **fit_options: Any,
) -> Selection:
    """Learns with each number of states and chooses the best; `fit_options` go to `fit_hmm`.

    BIC counts frames as if independent, so it tends to too many states for smooth motions at a high rate; leaving
    demonstrations out (`folds`, default one at a time) asks what matters: does it hold for a demonstration not seen?
    """
    tried = tuple(int(k) for k in candidates)
    if not tried:
        raise ParameterError("candidates is empty; try range(2, 9)")
    names = tuple(channels)
    if criterion == "bic":
        scores = [fit_hmm(sequences, k, channels=names, **fit_options).bic for k in tried]
    elif criterion == "cross-validation":
        scores = [_left_out(sequences, k, names, folds, fit_options) for k in tried]
    else:
        raise ParameterError(f"criterion must be 'bic' or 'cross-validation'; got {criterion!r}")
    table = np.array(scores)
    table.setflags(write=False)
    return Selection(tried[int(table.argmin())], tried, table, criterion)


def _left_out(sequences: Sequence[Any], k: int, names: tuple[str, ...], folds: int | None, options: dict[str, Any]) -> float:
    """−log-likelihood per frame over all demonstrations, each scored by a model that has not seen it."""
    folds = len(sequences) if folds is None else folds
    if not 2 <= folds <= len(sequences):
        raise ParameterError(f"folds must be from 2 to the {len(sequences)} demonstrations; got {folds}")
    total, frames = 0.0, 0
    for fold in range(folds):
        out = [x for s, x in enumerate(sequences) if s % folds == fold]
        model = fit_hmm([x for s, x in enumerate(sequences) if s % folds != fold], k, channels=names, **options).model
        total -= float(log_likelihood(model, out).sum())
        frames += sum(len(x) for x in out)
    return total / frames
