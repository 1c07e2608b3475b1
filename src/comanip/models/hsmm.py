"""Hidden semi-Markov model with Gaussian outputs: an Hmm that knows how long its states last.

An HMM forgets how long it has been in a state, so each of its durations is geometric: the shortest is the likeliest. Here every
state has a distribution of durations of its own, p_j(d). Functions have the names and signatures of those in `hmm`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..fitting.baum_welch import (
    allowed_rows,
    allowed_transitions,
    check_options,
    free_parameters,
    from_counts,
    label_counts,
    most_likely_rows,
    rows_of_states,
)
from ..fitting.climb import (
    Fit,
    best_climb,
    first_guess,
    fit_of,
    gaussians_of_labels,
    gaussians_of_moments,
    guessed_gaussians,
    kept_states,
    moments_about,
)
from ..fitting.coordinates import Lessons, prepare
from ..interfaces import Array
from . import segments
from .chains import IMPOSSIBLE, log_of, padded
from .durations import most_likely, of_mean, table
from .gaussian import Whitening, channel_names, gaussian_blocks, log_density, probabilities, whitening
from .hmm import Hmm, Posteriors, Sample, frames_of


@dataclass(frozen=True, eq=False)
class Hsmm:
    """K states with Gaussian outputs over D channels, that last from 1 to L frames.

    initial, means, covariances, channels   as in Hmm
    transition   (K, K)  a_ij, to which state when i ends: rows sum to 1, the diagonal is 0; or 1 for a state that is never left
    durations    (K, L)  p_j(d) of d = 1..L frames: rows sum to 1; of a state that is never left they mean nothing

    A sequence begins where its first state begins, and may end anywhere inside its last.
    """

    initial: Array
    transition: Array
    durations: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        channels = channel_names(self.channels)
        shape = np.shape(self.durations)
        if len(shape) != 2 or min(shape) < 1:
            raise ParameterError(f"durations must be (K, L), at least one state and one frame; got shape {shape}")
        n = shape[0]
        mu, sigma = gaussian_blocks(self.means, self.covariances, n, len(channels))
        transition = probabilities(self.transition, (n, n), "transition")
        mixed = [i for i, stays in enumerate(np.diagonal(transition)) if stays not in (0.0, 1.0)]
        if mixed:
            raise ParameterError(
                f"state {mixed[0]} follows itself with probability {transition[mixed[0], mixed[0]]:g}: durations say how long a "
                "state lasts, so the diagonal of transition is 0, or 1 for a state that is never left; see explicit_durations"
            )
        object.__setattr__(self, "initial", probabilities(self.initial, (n,), "initial"))
        object.__setattr__(self, "transition", transition)
        object.__setattr__(self, "durations", probabilities(self.durations, shape, "durations"))
        object.__setattr__(self, "means", mu)
        object.__setattr__(self, "covariances", sigma)
        object.__setattr__(self, "channels", channels)

    @property
    def n_states(self) -> int:
        return len(self.initial)

    @property
    def n_channels(self) -> int:
        return len(self.channels)

    @property
    def longest(self) -> int:
        """L [frames]."""
        return self.durations.shape[1]


class Spread(NamedTuple):
    """mean_s and std_s (K,) of each state's duration [s]; NaN of a state that is never left."""

    mean_s: Array
    std_s: Array


def durations_s(model: Hsmm, dt: float) -> Spread:
    """How long each state lasts; `dt` is the period of the lessons [s]."""
    d = np.arange(1.0, model.longest + 1.0)
    mean = model.durations @ d
    std = np.sqrt(np.maximum(model.durations @ d**2 - mean**2, 0.0))
    ends = np.where(np.diagonal(model.transition) == 1.0, np.nan, dt)
    return Spread(ends * mean, ends * std)


def explicit_durations(model: Hmm, longest: int) -> Hsmm:
    """The Hsmm that an Hmm is: geometric durations. The same densities as long as nothing lasts beyond `longest` frames."""
    stay = np.diagonal(model.transition)
    log_p = np.arange(longest) * np.log(np.clip(stay, 1e-300, 1.0))[:, None]
    p = np.exp(log_p - log_p.max(axis=1, keepdims=True))
    onward = model.transition * ~np.eye(model.n_states, dtype=bool) + np.diag(stay == 1.0)
    return Hsmm(
        model.initial,
        onward / onward.sum(axis=1, keepdims=True),
        p / p.sum(axis=1, keepdims=True),
        model.means,
        model.covariances,
        model.channels,
    )


def log_likelihood(model: Hsmm, sequences: Iterable[Any]) -> Array:
    """log p(ξ_1..ξ_T | model) of each sequence, (S,); see `hmm.log_likelihood`."""
    arrays = [frames_of(model, x) for x in sequences]
    return _sums(model, np.concatenate(arrays), np.array([len(x) for x in arrays])).log_likelihood


def posteriors(model: Hsmm, sequence: Any) -> Posteriors:
    """γ_t(i) of one sequence (T, D): uses the future too, so it is for analysis; `DurationFilter` is for running."""
    frames = frames_of(model, sequence)
    found = _sums(model, frames, np.array([len(frames)]), weights=True)
    assert found.weights is not None
    return Posteriors(found.weights, float(found.log_likelihood[0]))


def viterbi(model: Hsmm, sequence: Any) -> np.ndarray:
    """The most likely segmentation of one sequence (T, D), as states (T,)."""
    log_b = log_density(frames_of(model, sequence), model.means, model.covariances)
    return segments.best_path(log_b, log_of(model.initial), log_of(model.transition), log_of(model.durations))[0]


def sample(model: Hsmm, length: int, rng: np.random.Generator) -> Sample:
    """Draws `length` frames and the states behind them."""
    states = np.empty(length, dtype=np.intp)
    chances = model.initial
    end = 0
    while end < length:
        state = rng.choice(model.n_states, p=chances / chances.sum())
        start, end = end, end + 1 + rng.choice(model.longest, p=model.durations[state] / model.durations[state].sum())
        states[start:end] = state
        chances = model.transition[state]
    factors = np.linalg.cholesky(model.covariances)
    noise = rng.standard_normal((length, model.n_channels))
    return Sample(model.means[states] + np.einsum("tij,tj->ti", factors[states], noise), states)


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
        labels = first_guess(lessons, n_states, initial_guess, rng, jitter=attempt > 0)
        return _from_labels(lessons, labels, allowed, longest, covariance_floor, topology)

    best, trace, converged = best_climb(
        start,
        restarts,
        lambda p, _: _expect(p, lessons, n_threads),
        lambda e, p: _maximise(e, p, covariance_floor, transition_floor, duration_floor),
        max_iterations=max_iterations,
        rise=tolerance * lessons.n_frames,
    )
    weights = _sums(best, lessons.z, lessons.lengths, weights=True).weights
    assert weights is not None
    time = None if topology == "left-right" else lessons.normalised_time() @ weights
    order = kept_states(weights.sum(axis=0), time, converged, len(trace) - 1, lessons.notes)
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
    sums = _sums(p, lessons.z, lessons.lengths, n_threads=n_threads)
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


def _sums(
    p: Hsmm | _Parameters, frames: Array, lengths: np.ndarray, *, weights: bool = False, n_threads: int = 1
) -> kernels.SegmentSums:
    """The E-step of frames (N, D) of sequences one after another; compiled where that is possible."""
    white = whitening(p.means, p.covariances)
    if kernels.native is None or np.isnan(frames).any():
        return _twin(p, white, frames, lengths)
    sums = kernels.segments(
        frames, lengths, p.initial, p.transition, p.durations, white.arrays, weights=weights, n_threads=n_threads
    )
    if not sums.failed.any():
        return sums
    rows = np.repeat(sums.failed, lengths)
    rest = _twin(p, white, frames[rows], lengths[sums.failed])
    sums.log_likelihood[sums.failed] = rest.log_likelihood
    if sums.weights is not None:
        sums.weights[rows] = rest.weights
    added = {name: getattr(sums, name) + getattr(rest, name) for name in ("moments", "transitions", "first", "durations")}
    return sums._replace(**added)


def _twin(p: Hsmm | _Parameters, white: Whitening, frames: Array, lengths: np.ndarray) -> kernels.SegmentSums:
    """The readable twin of the compiled E-step, and its refuge where scaling runs out of float64.

    Densities are taken relative to the best state, frame by frame: only ratios between states matter, so a frame that nothing
    explains keeps a finite meaning.
    """
    log_b = log_density(frames, p.means, p.covariances)
    top = log_b.max(axis=1)
    e = segments.expectations(
        padded(log_b - top[:, None], lengths), lengths, log_of(p.initial), log_of(p.transition), log_of(p.durations)
    )
    total = e.log_likelihood + np.add.reduceat(top, np.concatenate([[0], np.cumsum(lengths)[:-1]]))
    total = np.where(e.log_likelihood < IMPOSSIBLE, -np.inf, total)
    moments = moments_about(white.origin, frames, e.weights)
    return kernels.SegmentSums(moments, e.transitions, e.first, e.durations, total, np.zeros(len(lengths), dtype=bool), e.weights)


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
