"""Expectation-maximisation of a Gaussian hidden Markov model, in standardised coordinates."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array
from ..models import chains
from ..models.gaussian import Whitening, suits_float32, whitening
from ..models.moments import moments_about
from .coordinates import Lessons
from .guesses import gaussians_of_labels
from .m_step import gaussians_of_moments


class Chain(NamedTuple):
    """Parameters in standardised coordinates while they are being learned."""

    initial: Array
    transition: Array
    means: Array
    covariances: Array


class Statistics(NamedTuple):
    """What the M-step needs from the E-step; `moments` (K, D + 1, D + 1) as in `models.moments.moments_about` (origin)."""

    moments: Array
    origin: Array
    transitions: Array
    first: Array


def expect(p: Chain, lessons: Lessons, n_threads: int = 1, single: bool = False) -> tuple[float, Statistics]:
    """Log-likelihood of all lessons, and the sums that the M-step needs; compiled where that is possible.

    A lesson in which float32 (`single`) fails is taken in float64, and one in which that fails by the twin.
    """
    white = whitening(p.means, p.covariances)
    if kernels.native is None:
        return _expect(p, white, lessons.z, lessons.lengths)
    single = single and suits_float32(white, p.means, p.covariances)
    groups = lessons.narrow_groups if single else lessons.groups
    sums = kernels.e_step(lessons.z, groups, p.initial, p.transition, white.arrays, n_threads=n_threads, single=single)
    found = Statistics(sums.moments, white.origin, sums.transitions, sums.first)
    if not sums.failed.any():
        return float(sums.log_likelihood.sum()), found
    z, lengths = lessons.z[np.repeat(sums.failed, lessons.lengths)], lessons.lengths[sums.failed]
    if single:
        rest, more = expect(p, replace(lessons, z=z, lengths=lengths), n_threads)
    else:
        rest, more = _expect(p, white, z, lengths)
    total = float(sums.log_likelihood[~sums.failed].sum()) + rest
    return total, Statistics(
        found.moments + more.moments, white.origin, found.transitions + more.transitions, found.first + more.first
    )


def _expect(p: Chain, white: Whitening, z: Array, lengths: np.ndarray) -> tuple[float, Statistics]:
    """The readable twin of the compiled E-step, and its refuge where scaling runs out of float64."""
    e = expectations_of(p, white, z, lengths)
    return float(e.log_likelihood.sum()), Statistics(
        moments_about(white.origin, z, e.weights), white.origin, e.transitions, e.first
    )


def expectations_of(p: Chain, white: Whitening, z: Array, lengths: np.ndarray) -> chains.Expectations:
    log_b = chains.padded(white.log_density(z), lengths)
    return chains.expectations(log_b, lengths, chains.log_of(p.initial), chains.log_of(p.transition))


def maximise(e: Statistics, p: Chain, covariance_floor: float, transition_floor: float) -> Chain:
    means, covariances = gaussians_of_moments(e.moments, e.origin, covariance_floor, (p.means, p.covariances))
    return Chain(
        e.first / e.first.sum(),
        most_likely_rows(e.transitions, p.transition, transition_floor),
        means,
        covariances,
    )


def most_likely_rows(counts: Array, before: Array, floor: float) -> Array:
    """Rows that maximise Σ counts log a, with a ≥ floor where `before` allows a transition. A row never left stays."""
    total = counts.sum(axis=1, keepdims=True)
    left = total > 1e-10
    rows = np.where(left, counts / np.where(left, total, 1.0), before)
    if floor == 0.0:
        return rows
    for i in np.flatnonzero(left):
        row = rows[i]
        low = np.zeros(len(row), dtype=bool)
        allowed = before[i] > 0.0
        while (raised := allowed & ~low & (row < floor)).any():  # raising one may push another below
            low |= raised
            rest = counts[i] * ~low
            row = np.where(low, floor, rest / max(rest.sum(), 1e-300) * (1.0 - floor * low.sum()))
        rows[i] = row / row.sum()
    return rows


def check_options(topology: str, restarts: int, transition_floor: float, n_states: int, *, goes_on: bool) -> None:
    """`goes_on`: a model is the first guess."""
    if topology not in ("left-right", "cyclic", "free"):
        raise ParameterError(f"topology must be 'left-right', 'cyclic' or 'free'; got {topology!r}")
    if restarts < 1 or (restarts > 1 and goes_on):
        raise ParameterError(f"restarts must be at least 1, and 1 when a model is the guess; got {restarts!r}")
    if not 0.0 <= transition_floor * n_states < 1.0:
        raise ParameterError(f"transition_floor must be below 1 / n_states; got {transition_floor!r}")


def allowed_transitions(topology: str, n_states: int) -> np.ndarray:
    if topology == "free":
        return np.ones((n_states, n_states), dtype=bool)
    on = np.eye(n_states, k=1, dtype=bool)
    if topology == "cyclic":
        on[-1, 0] = True
    return np.eye(n_states, dtype=bool) | on


def allowed_rows(transition: Array, allowed: np.ndarray) -> Array:
    """The rows of another model, what is not allowed left out; a row with nothing left allows everything."""
    rows = transition * allowed
    stuck = rows.sum(axis=1) <= 0.0
    rows[stuck] = allowed[stuck]
    return rows / rows.sum(axis=1, keepdims=True)


def rows_of_states(transition: Array, order: np.ndarray) -> Array:
    """The chain among the states of `order`; a state from which only others led is never left."""
    rows = transition[np.ix_(order, order)]
    rows = rows + np.diag(rows.sum(axis=1) <= 0.0)
    return rows / rows.sum(axis=1, keepdims=True)


def free_parameters(topology: str, allowed: np.ndarray, n_channels: int) -> int:
    """Of Π, of the transitions that `allowed` (K, K) has, and of full Gaussians."""
    n, d = len(allowed), n_channels
    chain = (0 if topology == "left-right" else n - 1) + int((allowed.sum(axis=1) - 1).clip(0).sum())
    return chain + n * d + n * d * (d + 1) // 2


def from_labels(lessons: Lessons, labels: np.ndarray, allowed: np.ndarray, floor: float, topology: str) -> Chain:
    counts, initial = label_counts(lessons, labels, len(allowed))
    means, covariances = gaussians_of_labels(lessons.z, labels, len(allowed), floor)
    return from_counts(counts, initial, means, covariances, allowed, topology)


def label_counts(lessons: Lessons, labels: np.ndarray, n_states: int) -> tuple[Array, Array]:
    """How often each label follows each, (K, K), and begins a lesson, (K,)."""
    first = lessons.first_frames()
    inside = np.setdiff1d(np.arange(1, len(labels)), first)
    counts = np.zeros((n_states, n_states))
    np.add.at(counts, (labels[inside - 1], labels[inside]), 1.0)
    return counts, np.bincount(labels[first], minlength=n_states).astype(float)


def from_counts(counts: Array, first: Array, means: Array, covariances: Array, allowed: np.ndarray, topology: str) -> Chain:
    n = len(allowed)
    # EM cannot bring a zero back to life, so every allowed transition starts with something
    counts = (counts + 0.5 + 0.05 * counts.sum(axis=1, keepdims=True) / n) * allowed
    initial = first / first.sum()
    initial = np.eye(n)[0] if topology == "left-right" else 0.95 * initial + 0.05 / n
    return Chain(initial, counts / counts.sum(axis=1, keepdims=True), means, covariances)
