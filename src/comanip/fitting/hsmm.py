"""Learning a hidden semi-Markov model from demonstrations: expectation-maximisation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array
from ..models.durations import most_likely, of_mean, table
from ..models.hmm import Hmm
from ..models.hsmm import Hsmm, explicit_durations, segment_sums
from .baum_welch import (
    allowed_rows,
    allowed_transitions,
    check_options,
    free_parameters,
    from_counts,
    label_counts,
    most_likely_rows,
    rows_of_states,
)
from .climb import Fit, best_climb, fit_of, kept_states
from .coordinates import Lessons, prepare
from .guesses import first_guess, gaussians_of_labels, guessed_gaussians
from .m_step import gaussians_of_moments


def fit_hsmm(
    sequences: Iterable[Any],
    n_states: int,
    *,
    channels: Iterable[str],
    topology: str = "left-right",
    initial_guess: str | Hmm | Hsmm = "time",
    restarts: int = 1,
    rng: np.random.Generator | None = None,
    longest: int | None = None,
    duration_floor: float = 0.2,
    covariance_floor: float = 1e-4,
    transition_floor: float = 0.0,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
    allow_constant: float | Mapping[str, float] | None = None,
    outlier_ratio: float = 1e3,
    n_threads: int = 1,
) -> Fit[Hsmm]:
    """Learns an Hsmm from several demonstrations, each (T, D), by expectation-maximisation; options as in `fit_hmm`, and

    initial_guess   also an Hmm to go on from: the likelihood begins at its own, and only rises
    longest         L, most frames that a state may last; None takes the longest demonstration. Time grows with it
    duration_floor  least spread of a state's duration as a ratio of its mean: five lessons may agree by chance. Of 0.05 to 0.3
                    simulated lessons left out prefer 0.2, by little

    Durations are discrete Gamma distributions, see `durations`. The last state of "left-right" is never left: no lesson shows its
    end. What a demonstration cuts short counts as "at least so long".
    """
    known = isinstance(initial_guess, (Hmm, Hsmm))
    check_options(topology, restarts, transition_floor, n_states, goes_on=known)
    if not 0.0 < duration_floor <= 1.0:
        raise ParameterError(f"duration_floor is a ratio above 0 and at most 1; got {duration_floor!r}")
    lessons = prepare(
        sequences,
        channels,
        n_states=n_states,
        least_frames=n_states + 1,
        covariance_floor=covariance_floor,
        allow_constant=allow_constant,
        outlier_ratio=outlier_ratio,
    )
    longest = int(lessons.lengths.max()) if longest is None else longest
    if longest < 1:
        raise ParameterError(f"longest must be at least 1 frame; got {longest!r}")
    allowed = _onward(allowed_transitions(topology, n_states))

    def start(attempt: int) -> _Parameters:
        if isinstance(initial_guess, (Hmm, Hsmm)):
            return _from_model(initial_guess, lessons, n_states, allowed, longest, duration_floor, covariance_floor)
        labels = first_guess(lessons, n_states, initial_guess, rng, jitter=attempt > 0, cyclic=topology == "cyclic")
        return _from_labels(lessons, labels, allowed, longest, covariance_floor, topology)

    best, trace, converged = best_climb(
        start,
        restarts,
        lambda p, _: _expect(p, lessons, n_threads),
        lambda e, p: _maximise(e, p, covariance_floor, transition_floor, duration_floor),
        max_iterations=max_iterations,
        rise=tolerance * lessons.n_frames,
    )
    weights = segment_sums(best, lessons.z, lessons.lengths, weights=True).weights
    assert weights is not None
    time = lessons.normalised_time() @ weights if topology == "free" else None
    begins = int(best.initial.argmax()) if topology == "cyclic" else 0
    order = kept_states(weights.sum(axis=0), time, converged, len(trace) - 1, lessons.notes, begins)
    initial = best.initial[order] / best.initial[order].sum()
    p = _Parameters(
        initial, rows_of_states(best.transition, order), best.gamma[order], longest, best.means[order], best.covariances[order]
    )
    if len(order) < n_states:
        trace = np.append(trace[:-1], _expect(p, lessons)[0])
    free = free_parameters(topology, allowed[np.ix_(order, order)], p.means.shape[1])
    free += 2 * int((np.diagonal(p.transition) < 1.0).sum())
    model = Hsmm(p.initial, p.transition, p.durations, *lessons.original(p.means, p.covariances), lessons.channels)
    return fit_of(model, trace, converged, lessons, free)


class _Parameters(NamedTuple):
    """In standardised coordinates while they are being learned; gamma (K, 2) are those of `durations`."""

    initial: Array
    transition: Array
    gamma: Array
    longest: int
    means: Array
    covariances: Array

    @property
    def durations(self) -> Array:
        return table(self.gamma, self.longest)


def _expect(p: _Parameters, lessons: Lessons, n_threads: int = 1) -> tuple[float, kernels.SegmentSums]:
    sums = segment_sums(p, lessons.z, lessons.lengths, n_threads=n_threads)
    return float(sums.log_likelihood.sum()), sums


def _maximise(
    e: kernels.SegmentSums, p: _Parameters, covariance_floor: float, transition_floor: float, floor: float
) -> _Parameters:
    origin = p.means.mean(axis=0)  # of the moments, as in whitening
    return _Parameters(
        e.first / e.first.sum(),
        most_likely_rows(e.transitions, p.transition, transition_floor),
        most_likely(e.durations, p.gamma, floor),
        p.longest,
        *gaussians_of_moments(e.moments, origin, covariance_floor, (p.means, p.covariances)),
    )


def _onward(allowed: np.ndarray) -> np.ndarray:
    """Which states may follow: not the same one, unless there is no other."""
    others = allowed & ~np.eye(len(allowed), dtype=bool)
    return others | np.diag(~others.any(axis=1))


def _from_model(
    guess: Hmm | Hsmm, lessons: Lessons, n_states: int, allowed: np.ndarray, longest: int, floor: float, covariance_floor: float
) -> _Parameters:
    gaussians = guessed_gaussians(guess, lessons, n_states, covariance_floor)
    known = explicit_durations(guess, longest) if isinstance(guess, Hmm) else guess
    counts = known.durations[:, :longest]
    mean = np.maximum(counts @ np.arange(1.0, counts.shape[1] + 1.0) / np.maximum(counts.sum(axis=1), 1e-300), 1.0)
    counts = np.pad(counts, ((0, 0), (0, longest - counts.shape[1])))
    gamma = most_likely(counts, of_mean(mean, 1.0, longest), floor)
    return _Parameters(known.initial.copy(), allowed_rows(known.transition, allowed), gamma, longest, *gaussians)


def _from_labels(
    lessons: Lessons, labels: np.ndarray, allowed: np.ndarray, longest: int, covariance_floor: float, topology: str
) -> _Parameters:
    """Wide durations, half of their mean: cuts of equal time say little about how long anything takes."""
    counts, first = label_counts(lessons, labels, len(allowed))
    runs = counts.sum(axis=0) - np.diagonal(counts) + first
    mean = np.bincount(labels, minlength=len(allowed)) / np.maximum(runs, 1.0)
    gaussians = gaussians_of_labels(lessons.z, labels, len(allowed), covariance_floor)
    p = from_counts(counts * allowed, first, *gaussians, allowed, topology)
    return _Parameters(p.initial, p.transition, of_mean(mean.clip(1.0, longest), 4.0, longest), longest, *gaussians)
