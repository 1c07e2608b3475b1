"""How many states? A table of scores, and the choice that follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Array
from ..models import hmm, hsmm
from ..parallel import each
from .hmm import fit_hmm
from .hsmm import fit_hsmm

MODELS: dict[str, tuple[Callable[..., Any], Callable[..., Array]]] = {
    "hmm": (fit_hmm, hmm.log_likelihood),
    "hsmm": (fit_hsmm, hsmm.log_likelihood),
}


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
    model: str = "hmm",
    criterion: str = "bic",
    folds: int | None = None,
    n_jobs: int = 1,
    **fit_options: Any,
) -> Selection:
    """Learns with each number of states and chooses the best; `fit_options` go to `fit_hmm`, or with model="hsmm" to `fit_hsmm`.

    n_jobs  processes; −1 is one a core; inside `comanip.backend("dask", ...)` the whole cluster. The same seed
            gives the same scores whatever their number: each fit draws from a generator of its own, spawned from `rng`
            in a fixed order.

    BIC counts frames as if independent, so it tends to too many states for smooth motions at a high rate; leaving
    demonstrations out (`folds`, default one at a time) asks what matters: does it hold for a demonstration not seen?
    """
    tried = tuple(int(k) for k in candidates)
    if not tried:
        raise ParameterError("candidates is empty; try range(2, 9)")
    if model not in MODELS:
        raise ParameterError(f"model must be one of {', '.join(MODELS)}; got {model!r}")
    names = tuple(channels)
    folds = len(sequences) if folds is None else folds
    work: list[tuple[Any, ...]]
    if criterion == "bic":
        work = [(_bic, sequences, model, k, names) for k in tried]
    elif criterion != "cross-validation":
        raise ParameterError(f"criterion must be 'bic' or 'cross-validation'; got {criterion!r}")
    elif not 2 <= folds <= len(sequences):
        raise ParameterError(f"folds must be from 2 to the {len(sequences)} demonstrations; got {folds}")
    else:
        work = [(_left_out, (sequences, fold, folds), model, k, names) for k in tried for fold in range(folds)]
    found = np.array(_all(work, n_jobs, fit_options))
    table = found if criterion == "bic" else found.reshape(len(tried), folds).sum(axis=1) / sum(len(x) for x in sequences)
    table.setflags(write=False)
    return Selection(tried[int(table.argmin())], tried, table, criterion)


def _all(work: Sequence[tuple[Any, ...]], n_jobs: int, options: dict[str, Any]) -> list[float]:
    """Every score, in order. The longest fits come last in `work`, so they are handed out first."""
    rng = options.pop("rng", None)
    if rng is not None:
        check_generator(rng)
    own = rng.spawn(len(work)) if rng is not None else [None] * len(work)
    tasks = [(*item, options if r is None else {**options, "rng": r}) for item, r in zip(work, own, strict=True)]
    return list(each(_score, reversed(tasks), n_jobs=n_jobs))[::-1]


def _score(score: Callable[..., float], *arguments: Any) -> float:
    return score(*arguments)


def _bic(sequences: Sequence[Any], model: str, k: int, names: tuple[str, ...], options: dict[str, Any]) -> float:
    return float(MODELS[model][0](sequences, k, channels=names, **options).bic)


def _left_out(
    split: tuple[Sequence[Any], int, int], model: str, k: int, names: tuple[str, ...], options: dict[str, Any]
) -> float:
    """−log-likelihood of the demonstrations of one fold, under a model that has not seen them."""
    sequences, fold, folds = split
    out = [x for s, x in enumerate(sequences) if s % folds == fold]
    fit, log_likelihood = MODELS[model]
    learned = fit([x for s, x in enumerate(sequences) if s % folds != fold], k, channels=names, **options).model
    return -float(log_likelihood(learned, out).sum())
