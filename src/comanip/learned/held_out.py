"""How well a model explains lessons that it has not seen: what its likelihoods must be held against before they are believed.

Frames of one lesson are no independent witnesses. People differ from take to take by tenths of a nat to whole nats a FRAME, so a
lesson of 400 frames that the model never saw scores hundreds of nats lower than one it learned from, and a posterior that adds
frames up is infinitely sure when it is wrong. So skills are compared by their score a frame, in units of how far that varies
among lessons left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import ComanipError
from ..fitting.coordinates import pooled
from ..fitting.hmm import fit_hmm
from ..interfaces import Array
from ..models import chains
from ..models.gaussian import log_density
from ..models.hmm import Hmm

FOLDS = 10  # more lessons are left out several at a time: learning stays a matter of milliseconds
ITERATIONS = 5  # of EM from the full model: as good as learning afresh, measured on nine sets
DOUBT = 0.2  # of a channel group's spread: other takes begin and end elsewhere, and a state at rest is a millimetre wide
STRANGE = 3.0  # [nats] a frame that no state explains costs this much more than one from anywhere in the task


def score(model: Hmm, frames: Array, columns: Sequence[int] | None = None) -> float:
    """Log-likelihood a frame [nats] of frames (T, C) in the given columns of the model (default all), with doubt in each.

    Each state is widened by a fifth of the spread of its channel group, and no frame counts as less than a Gaussian over the
    whole task, 3 nats down: one stretch beside the taught path does not outweigh all others.
    """
    chosen = list(range(model.n_channels)) if columns is None else list(columns)
    means, covariances = model.means[:, chosen], model.covariances[:, chosen][:, :, chosen]
    middle = means.mean(axis=0)
    apart = means - middle
    whole = covariances.mean(axis=0) + apart.T @ apart / len(means)
    spread = np.sqrt(np.diag(whole))
    pooled(spread, tuple(model.channels[c] for c in chosen), np.ones(len(chosen), dtype=bool))
    wide = covariances + np.diag((DOUBT * spread) ** 2)
    log_b = np.logaddexp(log_density(frames, means, wide), log_density(frames, middle[None], whole[None]) - STRANGE)
    *_, found = chains.forward_backward(
        log_b[None], np.array([len(frames)]), chains.log_of(model.initial), chains.log_of(model.transition)
    )
    return float(found[0]) / len(frames)


def held_out_scores(model: Hmm, frames: Sequence[Array], **fit_options: Any) -> list[float]:
    """`score` of each lesson (T, D) under a model of the others [nats]; empty where there are fewer than 3 lessons.

    The models of the others start from `model` and forget the lesson in a few steps of EM. `fit_options` as for `fit_hmm`.
    A fold from which nothing can be learned (a channel that no longer changes) has no number.
    """
    if len(frames) < 3:
        return []
    folds = min(len(frames), FOLDS)
    found: dict[int, float] = {}
    for fold in range(folds):
        others = [x for i, x in enumerate(frames) if i % folds != fold]
        if (again := refitted(model, others, fit_options)) is not None:
            found |= {i: score(again, frames[i]) for i in range(fold, len(frames), folds)}
    return [found[i] for i in sorted(found) if np.isfinite(found[i])]


def refitted(model: Hmm, others: Sequence[Array], options: Mapping[str, Any]) -> Hmm | None:
    """The model after a few steps of EM on `others`."""
    return fitted(others, model.n_states, model.channels, {**options, "initial_guess": model, "max_iterations": ITERATIONS})


def fitted(frames: Sequence[Array], n_states: int, channels: Sequence[str], options: Mapping[str, Any]) -> Hmm | None:
    """In silence, and None where nothing can be learned: what is to be said of the lessons was said when `learn` saw them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return fit_hmm(frames, n_states, channels=channels, **options).model
        except ComanipError:
            return None
