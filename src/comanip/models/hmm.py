"""Hidden Markov model with Gaussian outputs: one frozen value, and functions of it.

ξ (D,) is the datapoint of one frame; channels are named, and their order means nothing to a caller.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ChannelError, ParameterError, check_generator
from ..interfaces import Array
from . import chains
from .gaussian import (
    EuclideanStates,
    Whitening,
    in_float32,
    log_density,
    probabilities,
    suits_float32,
    whitening,
)


@dataclass(frozen=True, eq=False, repr=False)
class Hmm(EuclideanStates):
    """K states with Gaussian outputs over D channels.

    initial      (K,)       Π_i
    transition   (K, K)     a_ij, from i to j: ROWS sum to 1
    means        (K, D)     μ_i, in the channels' units
    covariances  (K, D, D)  Σ_i, full
    channels     (D,)       names, for example ("position.z", "force.z", "velocity.z")
    """

    initial: Array
    transition: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        n = self._checked_gaussians()
        self._stored(
            initial=probabilities(self.initial, (n,), "initial"), transition=probabilities(self.transition, (n, n), "transition")
        )

    @cached_property
    def whitening(self) -> Whitening:
        """What the densities of the states are computed with; made once, as a model never changes."""
        return whitening(self.means, self.covariances)


def frames_of(model: Any, sequence: Any) -> Array:
    """One checked sequence (T, D) in the channels of `model`."""
    x = np.asarray(sequence, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != model.n_channels or not len(x):
        raise ChannelError(f"a sequence must be (T, {model.n_channels}) for channels {model.channels}; got {x.shape}")
    return np.ascontiguousarray(x)


class Posteriors(NamedTuple):
    """weights (T, K) of each state at each frame given the WHOLE sequence, and its log-likelihood."""

    weights: Array
    log_likelihood: float


def log_likelihood(model: Hmm, sequences: Iterable[Any], *, precision: str = "float64", n_threads: int = 1) -> Array:
    """log p(ξ_1..ξ_T | model) of each sequence, (S,). NaN channels are integrated out.

    −inf means that no allowed path explains the sequence. Densities carry units: compare models, not units.
    precision "float32" is for much data: up to twice as fast, to 1e-6 of the value and 1e-5 a frame. What it cannot resolve (a
    sequence far from every state, a state far from the others) is taken in float64; without compiled kernels all is.
    """
    single = in_float32(precision) and suits_float32(model.whitening, model.means, model.covariances)
    frames, lengths, missing = _stacked(model, sequences)
    left, found = np.ones(len(lengths), dtype=bool), np.empty(len(lengths))
    for narrow in (True, False) if single else (False,):
        chosen = left & ~missing
        if chosen.any():
            part, groups = frames[_rows(chosen, lengths)], kernels.planned(lengths[chosen], single=narrow)
            white = model.whitening.arrays
            found[chosen], left[chosen] = kernels.likelihoods(
                part, groups, model.initial, model.transition, white, single=narrow, n_threads=n_threads
            )
    if left.any():
        found[left] = _log_likelihood(model, frames[_rows(left, lengths)], lengths[left])
    return found


def _log_likelihood(model: Hmm, frames: Array, lengths: np.ndarray) -> Array:
    log_b = chains.padded(log_density(frames, model.means, model.covariances), lengths)
    *_, found = chains.forward_backward(log_b, lengths, chains.log_of(model.initial), chains.log_of(model.transition))
    return np.where(found < chains.IMPOSSIBLE, -np.inf, found)


def forward_backward(model: Hmm, sequence: Any) -> tuple[Array, Array, float]:
    """log α and log β (T, K) of one sequence (T, D), and its log-likelihood. Eq. (4), in the log domain."""
    log_b = log_density(frames_of(model, sequence), model.means, model.covariances)[None]
    log_alpha, log_beta, found = chains.forward_backward(
        log_b, np.array([log_b.shape[1]]), chains.log_of(model.initial), chains.log_of(model.transition)
    )
    return log_alpha[0], log_beta[0], float(found[0])


def posteriors(model: Hmm, sequence: Any) -> Posteriors:
    """γ_t(i) of one sequence (T, D): uses the future too, so it is for analysis; `ForwardFilter` is for running."""
    return posteriors_of_all(model, [sequence])[0]


def posteriors_of_all(model: Hmm, sequences: Iterable[Any], *, n_threads: int = 1) -> list[Posteriors]:
    """The same of many sequences together, which is quicker than one after another."""
    frames, lengths, left = _stacked(model, sequences)
    if left.all():
        weights, likelihood = np.empty((len(frames), model.n_states)), np.empty(len(lengths))
    else:
        groups, white = kernels.planned(lengths), model.whitening.arrays
        weights, likelihood, failed = kernels.posteriors(
            frames, groups, model.initial, model.transition, white, n_threads=n_threads
        )
        left |= failed
    if left.any():
        rows = _rows(left, lengths)
        log_b = chains.padded(log_density(frames[rows], model.means, model.covariances), lengths[left])
        twin = chains.expectations(log_b, lengths[left], chains.log_of(model.initial), chains.log_of(model.transition))
        weights[rows], likelihood[left] = twin.weights, twin.log_likelihood
    parts = np.split(weights, np.cumsum(lengths)[:-1])
    return [Posteriors(part, float(one)) for part, one in zip(parts, likelihood, strict=True)]


def viterbi(model: Hmm, sequence: Any) -> np.ndarray:
    """The most likely states (T,), integers, of one sequence (T, D)."""
    return viterbi_of_all(model, [sequence])[0]


def viterbi_of_all(model: Hmm, sequences: Iterable[Any], *, n_threads: int = 1) -> list[np.ndarray]:
    """The same of many sequences together, which is quicker than one after another."""
    frames, lengths, left = _stacked(model, sequences)
    log_initial, log_transition = chains.log_of(model.initial), chains.log_of(model.transition)
    if left.all():
        states = np.empty(len(frames), dtype=np.int64)
    else:
        states, _ = kernels.decode(frames, lengths, log_initial, log_transition, model.whitening.arrays, n_threads=n_threads)
    paths = np.split(states, np.cumsum(lengths)[:-1])
    cuts = np.concatenate([[0], np.cumsum(lengths)])
    for s in np.flatnonzero(left):
        log_b = log_density(frames[cuts[s] : cuts[s + 1]], model.means, model.covariances)
        paths[s][:] = chains.best_path(log_b, log_initial, log_transition)[0]
    return paths


def _stacked(model: Hmm, sequences: Iterable[Any]) -> tuple[Array, np.ndarray, np.ndarray]:
    """Frames (N, D) of all sequences, their lengths (S,), and which (S,) are left to the twins: something is missing in them."""
    arrays = [frames_of(model, x) for x in sequences]
    if not arrays:
        raise ParameterError("there is no sequence; give at least one, each (T, D)")
    frames, lengths = np.concatenate(arrays), np.array([len(x) for x in arrays])
    if kernels.native is None:
        return frames, lengths, np.ones(len(arrays), dtype=bool)
    if not np.isnan(frames.sum()):  # much quicker than to look at each
        return frames, lengths, np.zeros(len(arrays), dtype=bool)
    return frames, lengths, np.array([bool(np.isnan(x).any()) for x in arrays])


def _rows(chosen: np.ndarray, lengths: np.ndarray) -> Any:
    """Index of the frames of the chosen sequences (S,)."""
    return slice(None) if chosen.all() else np.repeat(chosen, lengths)


class Sample(NamedTuple):
    """frames (T, D) drawn from a model and the states (T,) they were drawn from."""

    frames: Array
    states: np.ndarray


def sample(model: Hmm, length: int, rng: np.random.Generator) -> Sample:
    """Draws `length` frames and the states behind them."""
    check_generator(rng)
    states = np.empty(length, dtype=np.intp)
    pick = rng.random(length)
    chances = np.cumsum(model.transition, axis=1)
    row = np.cumsum(model.initial)
    for t in range(length):
        # against the row's own sum, so that rounding can never choose a state beyond the last possible one
        states[t] = np.searchsorted(row, pick[t] * row[-1], side="right")
        row = chances[states[t]]
    factors = np.linalg.cholesky(model.covariances)
    noise = rng.standard_normal((length, model.n_channels))
    return Sample(model.means[states] + np.einsum("tij,tj->ti", factors[states], noise), states)
