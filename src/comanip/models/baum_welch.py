"""Expectation-maximisation of a Gaussian hidden Markov model, in standardised coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from . import chains
from .gaussian import whitening
from .learning import gaussians_of_labels, weighted_gaussians
from .lessons import Lessons


class Chain(NamedTuple):
    """Parameters in standardised coordinates while they are being learned."""

    initial: Array
    transition: Array
    means: Array
    covariances: Array


def expect(p: Chain, lessons: Lessons) -> tuple[float, chains.Expectations]:
    log_b = chains.padded(whitening(p.means, p.covariances).log_density(lessons.z), lessons.lengths)
    e = chains.expectations(log_b, lessons.lengths, chains.log_of(p.initial), chains.log_of(p.transition))
    return float(e.log_likelihood.sum()), e


def maximise(e: chains.Expectations, p: Chain, z: Array, covariance_floor: float, transition_floor: float) -> Chain:
    means, covariances = weighted_gaussians(z, e.weights, covariance_floor, (p.means, p.covariances))
    return Chain(
        e.first / e.first.sum(),
        most_likely_rows(e.transitions, p.transition, transition_floor),
        means,
        covariances,
    )


def most_likely_rows(counts: Array, before: Array, floor: float) -> Array:
    """Rows that maximise Σ counts log a, with a ≥ floor where `before` allows a transition. A row never left stays."""
    rows = before.copy()
    for i in np.flatnonzero(counts.sum(axis=1) > 1e-10):
        row = counts[i] / counts[i].sum()
        low = np.zeros(len(row), dtype=bool)
        allowed = before[i] > 0.0
        while (raised := allowed & ~low & (row < floor)).any():  # raising one may push another below
            low |= raised
            rest = counts[i] * ~low
            row = np.where(low, floor, rest / max(rest.sum(), 1e-300) * (1.0 - floor * low.sum()))
        rows[i] = row / row.sum()
    return rows


def allowed_transitions(topology: str, n_states: int) -> np.ndarray:
    if topology == "free":
        return np.ones((n_states, n_states), dtype=bool)
    on = np.eye(n_states, k=1, dtype=bool)
    if topology == "cyclic":
        on[-1, 0] = True
    return np.eye(n_states, dtype=bool) | on


def from_labels(lessons: Lessons, labels: np.ndarray, allowed: np.ndarray, floor: float, topology: str) -> Chain:
    n = len(allowed)
    first = lessons.first_frames()
    inside = np.setdiff1d(np.arange(1, len(labels)), first)
    counts = np.zeros((n, n))
    np.add.at(counts, (labels[inside - 1], labels[inside]), 1.0)
    # EM cannot bring a zero back to life, so every allowed transition starts with something
    counts = (counts + 0.5 + 0.05 * counts.sum(axis=1, keepdims=True) / n) * allowed
    initial = np.bincount(labels[first], minlength=n) / len(first)
    initial = np.eye(n)[0] if topology == "left-right" else 0.95 * initial + 0.05 / n
    means, covariances = gaussians_of_labels(lessons.z, labels, n, floor)
    return Chain(initial, counts / counts.sum(axis=1, keepdims=True), means, covariances)
