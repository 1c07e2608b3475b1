"""The first guess for tasks that repeat: what one cycle looks like, and where in it every frame is.

Cuts of equal time know no period: a state of them holds a piece of every phase, and EM never finds the way back from the last
state to the first. Everything here is made of products of whole frames, so that turned axes give the turned answer.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .. import kernels
from ..interfaces import Array
from ..models.chains import best_path, log_of
from ..models.gaussian import log_density, whitening

ALIKE = 0.4  # likeness of a lesson with itself one period later, from -1 to 1: below it nothing repeats. Lifts have less than 0.1
NEARLY_BEST = 0.9  # of the best likeness: two periods are as alike as one, so the first that comes close is the period
PLACES = 32  # places a period at which the clearest cycle may begin


class Cycle(NamedTuple):
    """What K states of one cycle look like: means (K, D) and variance, one number, in z; and its period [frames]."""

    means: Array
    variance: float
    period: int


def period_of(z: Array, least: int) -> int | None:
    """After how many frames, at least `least`, a lesson z (T, D) looks most like itself; None where it does not repeat.

    Likeness is 2 Σ z_t z_{t+τ} / Σ (|z_t|² + |z_{t+τ}|²) (McLeod & Wyvill 2005), which rests at the ends do not lower much.
    """
    alike = likeness(z)[: len(z) // 2 + 1]
    apart = np.flatnonzero(alike < 0.0)
    if not len(apart):
        return None
    start = max(int(apart[0]), least, 2)  # before it a lesson looks like itself because little has changed
    inside = np.arange(start, len(alike) - 1)
    peaks = inside[(alike[inside] >= alike[inside - 1]) & (alike[inside] > alike[inside + 1]) & (alike[inside] > ALIKE)]
    if not len(peaks):
        return None
    return int(peaks[alike[peaks] >= NEARLY_BEST * alike[peaks].max()][0])


def likeness(z: Array) -> Array:
    """Of a lesson z (T, D) with itself τ = 0, 1, ... T − 1 frames later, (T,)."""
    x = z - z.mean(axis=0)
    n = len(x)
    spectrum = np.fft.rfft(x, 2 * n, axis=0)
    products = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1))[:n]
    energy = np.concatenate([[0.0], np.cumsum((x**2).sum(axis=1))])
    later = np.arange(n)
    both = energy[n - later] + energy[n] - energy[later]
    return 2.0 * products / np.maximum(both, 1e-300)


def first_cycle(lessons: Iterable[Array], n_states: int, rng: np.random.Generator | None = None) -> Cycle | None:
    """From the first lesson, each (T, D) in z, that repeats; with `rng` its states begin elsewhere in the cycle."""
    for z in lessons:
        if len(z) > 2 * n_states and (period := period_of(z, n_states)) is not None:
            begin = _clearest(z, period) + (int(rng.integers(period)) if rng is not None else 0)
            return _cycle(z, min(begin, len(z) - period), period, n_states)
    return None


def _clearest(z: Array, period: int) -> int:
    """Where the cycle begins that most resembles the next one; the more it moves, the more that counts."""
    begins = np.arange(0, len(z) - 2 * period + 1, max(period // PLACES, 1))
    products = []
    for begin in begins:
        one, next_one = z[begin : begin + period], z[begin + period : begin + 2 * period]
        products.append(float(((one - one.mean(axis=0)) * (next_one - next_one.mean(axis=0))).sum()))
    return int(begins[int(np.argmax(products))])


def _cycle(z: Array, begin: int, period: int, n_states: int) -> Cycle:
    parts = np.array_split(z[begin : begin + period], n_states)
    means = np.array([part.mean(axis=0) for part in parts])
    inside = sum(float(((part - mean) ** 2).sum()) for part, mean in zip(parts, means, strict=True))
    return Cycle(means, inside / (period * z.shape[1]) + 1e-4, period)


def phases(z: Array, lengths: np.ndarray, cycle: Cycle) -> np.ndarray:
    """Labels (N,) of the frames of lessons z (N, D) stacked: the most likely way round and round the cycle, at any tempo."""
    n, d = cycle.means.shape
    leave = min(n / cycle.period, 0.5)
    chain = np.eye(n) * (1.0 - leave) + np.roll(np.eye(n), 1, axis=1) * leave
    log_initial, log_transition = np.full(n, -np.log(n)), log_of(chain)
    covariances = np.tile(cycle.variance * np.eye(d), (n, 1, 1))
    if kernels.native is not None:
        white = whitening(cycle.means, covariances)
        return kernels.decode(z, lengths, log_initial, log_transition, white.arrays)[0]
    parts = np.split(log_density(z, cycle.means, covariances), np.cumsum(lengths)[:-1])
    return np.concatenate([best_path(log_b, log_initial, log_transition)[0] for log_b in parts])


def from_its_start(labels: np.ndarray, first: np.ndarray, n_states: int) -> np.ndarray:
    """The same labels (N,), numbered from the one in which most lessons begin; `first` are their first frames."""
    start = int(np.bincount(labels[first], minlength=n_states).argmax())
    return (labels - start) % n_states
