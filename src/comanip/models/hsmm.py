"""Hidden semi-Markov model with Gaussian outputs: an Hmm that knows how long its states last.

An HMM forgets how long it has been in a state, so each of its durations is geometric: the shortest is the likeliest. Here every
state has a distribution of durations of its own, p_j(d). Functions have the names and signatures of those in `hmm`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from .. import kernels
from ..errors import ParameterError, check_generator
from ..interfaces import Array
from . import segments
from .chains import IMPOSSIBLE, log_of, padded
from .gaussian import EuclideanStates, Whitening, log_density, probabilities, whitening
from .hmm import Hmm, Posteriors, Sample, frames_of
from .moments import moments_about


class Segmented(Protocol):
    """Whatever has the parameters of an Hsmm, in any coordinates: the model itself, or what is being learned."""

    @property
    def initial(self) -> Array: ...

    @property
    def transition(self) -> Array: ...

    @property
    def durations(self) -> Array: ...

    @property
    def means(self) -> Array: ...

    @property
    def covariances(self) -> Array: ...


@dataclass(frozen=True, eq=False, repr=False)
class Hsmm(EuclideanStates):
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
        shape = np.shape(self.durations)
        if len(shape) != 2 or min(shape) < 1:
            raise ParameterError(f"durations must be (K, L), at least one state and one frame; got shape {shape}")
        n = self._checked_gaussians(shape[0])
        transition = probabilities(self.transition, (n, n), "transition")
        mixed = [i for i, stays in enumerate(np.diagonal(transition)) if stays not in (0.0, 1.0)]
        if mixed:
            raise ParameterError(
                f"state {mixed[0]} follows itself with probability {transition[mixed[0], mixed[0]]:g}: durations say how long a "
                "state lasts, so the diagonal of transition is 0, or 1 for a state that is never left; see explicit_durations"
            )
        self._stored(
            initial=probabilities(self.initial, (n,), "initial"),
            transition=transition,
            durations=probabilities(self.durations, shape, "durations"),
        )

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
    return segment_sums(model, np.concatenate(arrays), np.array([len(x) for x in arrays])).log_likelihood


def posteriors(model: Hsmm, sequence: Any) -> Posteriors:
    """γ_t(i) of one sequence (T, D): uses the future too, so it is for analysis; `DurationFilter` is for running."""
    frames = frames_of(model, sequence)
    found = segment_sums(model, frames, np.array([len(frames)]), weights=True)
    assert found.weights is not None
    return Posteriors(found.weights, float(found.log_likelihood[0]))


def viterbi(model: Hsmm, sequence: Any) -> np.ndarray:
    """The most likely segmentation of one sequence (T, D), as states (T,)."""
    log_b = log_density(frames_of(model, sequence), model.means, model.covariances)
    return segments.best_path(log_b, log_of(model.initial), log_of(model.transition), log_of(model.durations))[0]


def sample(model: Hsmm, length: int, rng: np.random.Generator) -> Sample:
    """Draws `length` frames and the states behind them."""
    check_generator(rng)
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


def segment_sums(
    p: Segmented, frames: Array, lengths: np.ndarray, *, weights: bool = False, n_threads: int = 1
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


def _twin(p: Segmented, white: Whitening, frames: Array, lengths: np.ndarray) -> kernels.SegmentSums:
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
