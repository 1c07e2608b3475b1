"""Gaussian mixture model: what a hidden Markov model is when time is forgotten."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ChannelError, ParameterError
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
from .gaussian import (
    channel_names,
    gaussian_blocks,
    in_float32,
    log_density,
    log_sum_exp,
    normalised,
    probabilities,
    shares,
    suits_float32,
    whitening,
)


@dataclass(frozen=True, eq=False)
class Gmm:
    """K weighted Gaussians over D channels: weights (K,), means (K, D), covariances (K, D, D), channels (D,) names."""

    weights: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        channels = channel_names(self.channels)
        n = np.shape(self.means)[0] if np.ndim(self.means) == 2 else -1
        if n < 1:
            raise ParameterError(f"means must be (K, D) with at least one state; got shape {np.shape(self.means)}")
        mu, sigma = gaussian_blocks(self.means, self.covariances, n, len(channels))
        object.__setattr__(self, "weights", probabilities(self.weights, (n,), "weights"))
        object.__setattr__(self, "means", mu)
        object.__setattr__(self, "covariances", sigma)
        object.__setattr__(self, "channels", channels)

    @property
    def n_states(self) -> int:
        return len(self.weights)

    @property
    def n_channels(self) -> int:
        return len(self.channels)


def responsibilities(model: Gmm, x: Any) -> Array:
    """p(state i | x_n), (N, K), for frames x (N, D); NaN channels are integrated out."""
    return shares(_frames(model, x), model.means, model.covariances, np.log(np.maximum(model.weights, 1e-300)))


def log_likelihood(model: Gmm, x: Any) -> Array:
    """log p(x_n), (N,), for frames x (N, D)."""
    return log_sum_exp(_joint(model, x))


def sample(model: Gmm, n: int, rng: np.random.Generator) -> Array:
    """Draws `n` frames (n, D)."""
    states = rng.choice(model.n_states, size=n, p=model.weights / model.weights.sum())
    factors = np.linalg.cholesky(model.covariances)
    return model.means[states] + np.einsum("nij,nj->ni", factors[states], rng.standard_normal((n, model.n_channels)))


def in_confidence_region(model: Gmm, x: Any, alpha: float) -> np.ndarray:
    """(N,) true where frames x (N, D) are inside the region of their closest state that holds `alpha` of its samples.

    Exact: D degrees of freedom. (The D − 1 of a well-known library holds less than it says.)
    """
    from scipy.special import gammaincinv

    frames = _frames(model, x)
    nearest = whitening(model.means, model.covariances).distances(frames).min(axis=1)
    return nearest <= 2.0 * gammaincinv(model.n_channels / 2.0, alpha)  # the chi-squared quantile


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
    """moments (K, D + 1, D + 1) as in `learning.moments_about` (origin), and γ (N, K) when asked for."""

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


def _frames(model: Gmm, x: Any) -> Array:
    frames = np.asarray(x, dtype=np.float64)
    if frames.ndim != 2 or frames.shape[1] != model.n_channels:
        raise ChannelError(f"frames must be (N, {model.n_channels}) for channels {model.channels}; got {frames.shape}")
    return frames


def _joint(model: Gmm, x: Any) -> Array:
    return log_density(_frames(model, x), model.means, model.covariances) + np.log(np.maximum(model.weights, 1e-300))
