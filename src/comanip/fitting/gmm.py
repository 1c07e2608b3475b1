"""Learning a Gaussian mixture from demonstrations: expectation-maximisation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array
from ..models.gaussian import in_float32, log_sum_exp, normalised, suits_float32, whitening
from ..models.gmm import Gmm
from ..models.moments import moments_about
from .climb import Fit, best_climb, fit_of, kept_states
from .coordinates import Lessons, prepare
from .guesses import first_guess, gaussians_of_labels, guessed_gaussians
from .m_step import gaussians_of_moments


def fit_gmm(
    sequences: Iterable[Any],
    n_states: int,
    *,
    channels: Iterable[str],
    initial_guess: str | Gmm = "time",
    restarts: int = 1,
    rng: np.random.Generator | None = None,
    covariance_floor: float = 1e-4,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
    allow_constant: float | Mapping[str, float] | None = None,
    outlier_ratio: float = 1e3,
    precision: str = "float64",
) -> Fit[Gmm]:
    """Learns a Gmm from demonstrations, each (T, D). Parameters as in `fit_hmm`; time serves the first guess only."""
    if restarts < 1 or (restarts > 1 and isinstance(initial_guess, Gmm)):
        raise ParameterError(f"restarts must be at least 1, and 1 when a model is the guess; got {restarts!r}")
    single = in_float32(precision)
    lessons = prepare(
        sequences,
        channels,
        n_states=n_states,
        least_frames=n_states + 1,
        covariance_floor=covariance_floor,
        allow_constant=allow_constant,
        outlier_ratio=outlier_ratio,
    )

    def start(attempt: int) -> _Mixture:
        if isinstance(initial_guess, Gmm):
            return _Mixture(initial_guess.weights.copy(), *guessed_gaussians(initial_guess, lessons, n_states, covariance_floor))
        labels = first_guess(lessons, n_states, initial_guess, rng, jitter=attempt > 0)
        share = (np.bincount(labels, minlength=n_states) + 0.5) / (len(labels) + 0.5 * n_states)
        return _Mixture(share, *gaussians_of_labels(lessons.z, labels, n_states, covariance_floor))

    best = best_climb(
        start,
        restarts,
        lambda p, single: _expect(p, lessons.z, single=single),
        lambda e, p: _maximise(e, p, covariance_floor),
        single=single,
        max_iterations=max_iterations,
        rise=tolerance * lessons.n_frames,
    )
    return _finished(*best, lessons=lessons)


class _Mixture(NamedTuple):
    weights: Any
    means: Array
    covariances: Array


class _Statistics(NamedTuple):
    """moments (K, D + 1, D + 1) as in `models.moments.moments_about` (origin), and γ (N, K) when asked for."""

    moments: Array
    origin: Array
    gamma: Array | None


def _expect(p: _Mixture, z: Array, gamma: bool = False, single: bool = False) -> tuple[float, _Statistics]:
    white, log_weights = whitening(p.means, p.covariances), np.log(np.maximum(p.weights, 1e-300))
    if kernels.native is not None:
        single = single and suits_float32(white, p.means, p.covariances)
        total, moments, found = kernels.mixture(z, log_weights, white.arrays, weights=gamma, single=single)
        if single and np.isnan(total):
            return _expect(p, z, gamma)
        return total, _Statistics(moments, white.origin, found)
    joint = white.log_density(z) + log_weights
    weights = normalised(joint)
    return float(log_sum_exp(joint).sum()), _Statistics(moments_about(white.origin, z, weights), white.origin, weights)


def _maximise(e: _Statistics, p: _Mixture, floor: float) -> _Mixture:
    occupancy = e.moments[:, -1, -1]
    return _Mixture(occupancy / occupancy.sum(), *gaussians_of_moments(e.moments, e.origin, floor, (p.means, p.covariances)))


def _finished(p: _Mixture, trace: Array, converged: bool, *, lessons: Lessons) -> Fit[Gmm]:
    gamma = _expect(p, lessons.z, gamma=True)[1].gamma
    assert gamma is not None
    occupancy = gamma.sum(axis=0)
    order = kept_states(occupancy, lessons.normalised_time() @ gamma, converged, len(trace) - 1, lessons.notes)
    p = _Mixture(p.weights[order] / p.weights[order].sum(), p.means[order], p.covariances[order])
    if len(order) < len(occupancy):
        trace = np.append(trace[:-1], _expect(p, lessons.z)[0])
    n, d = p.means.shape
    model = Gmm(p.weights, *lessons.original(p.means, p.covariances), lessons.channels)
    return fit_of(model, trace, converged, lessons, n - 1 + n * d + n * d * (d + 1) // 2)
