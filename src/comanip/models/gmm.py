"""Gaussian mixture model: what a hidden Markov model is when time is forgotten."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ChannelError, check_generator
from ..interfaces import Array
from .gaussian import (
    EuclideanStates,
    log_density,
    log_sum_exp,
    probabilities,
    shares,
    whitening,
)


@dataclass(frozen=True, eq=False, repr=False)
class Gmm(EuclideanStates):
    """K weighted Gaussians over D channels: weights (K,), means (K, D), covariances (K, D, D), channels (D,) names."""

    weights: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        n = self._checked_gaussians()
        self._stored(weights=probabilities(self.weights, (n,), "weights"))


def responsibilities(model: Gmm, x: Any) -> Array:
    """p(state i | x_n), (N, K), for frames x (N, D); NaN channels are integrated out."""
    return shares(_frames(model, x), model.means, model.covariances, np.log(np.maximum(model.weights, 1e-300)))


def log_likelihood(model: Gmm, x: Any) -> Array:
    """log p(x_n), (N,), for frames x (N, D)."""
    return log_sum_exp(_joint(model, x))


def sample(model: Gmm, n: int, rng: np.random.Generator) -> Array:
    """Draws `n` frames (n, D)."""
    check_generator(rng)
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


def _frames(model: Gmm, x: Any) -> Array:
    frames = np.asarray(x, dtype=np.float64)
    if frames.ndim != 2 or frames.shape[1] != model.n_channels:
        raise ChannelError(f"frames must be (N, {model.n_channels}) for channels {model.channels}; got {frames.shape}")
    return frames


def _joint(model: Gmm, x: Any) -> Array:
    return log_density(_frames(model, x), model.means, model.covariances) + np.log(np.maximum(model.weights, 1e-300))
