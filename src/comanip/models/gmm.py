"""Gaussian mixture model: what a hidden Markov model is when time is forgotten."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from .gaussian import (
    channel_names,
    floored,
    gaussian_blocks,
    log_density,
    log_sum_exp,
    normalised,
    probabilities,
    suits_float32,
    whitening,
)
from .learning import (
    UNVISITED,
    Fit,
    climb_fast_first,
    first_guess,
    gaussians_of_labels,
    gaussians_of_moments,
    moments_about,
    say_converged,
    say_unvisited,
)
from .lessons import Lessons, prepare


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
    return normalised(_joint(model, x))


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
    single = kernels.single(precision)
    lessons = prepare(
        sequences,
        channels,
        n_states=n_states,
        least_frames=n_states + 1,
        covariance_floor=covariance_floor,
        allow_constant=allow_constant,
        outlier_ratio=outlier_ratio,
    )
    best: tuple[_Mixture, Array, bool] | None = None
    for attempt in range(restarts):
        if isinstance(initial_guess, Gmm):
            start = _from_model(lessons, initial_guess, n_states, covariance_floor)
        else:
            labels = first_guess(lessons, n_states, initial_guess, rng, jitter=attempt > 0)
            share = (np.bincount(labels, minlength=n_states) + 0.5) / (len(labels) + 0.5 * n_states)
            start = _Mixture(share, *gaussians_of_labels(lessons.z, labels, n_states, covariance_floor))
        found = climb_fast_first(
            start,
            lambda p, single: _expect(p, lessons.z, single=single),
            lambda e, p: _maximise(e, p, covariance_floor),
            single=single,
            max_iterations=max_iterations,
            rise=tolerance * lessons.n_frames,
        )
        if best is None or found[1][-1] > best[1][-1]:
            best = found
    assert best is not None
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


def _from_model(lessons: Lessons, guess: Gmm, n_states: int, floor: float) -> _Mixture:
    if guess.channels != lessons.channels or guess.n_states != n_states:
        raise ChannelError(
            f"the model given as initial_guess has {guess.n_states} states of {guess.channels}; "
            f"asked for {n_states} of {lessons.channels}"
        )
    means, covariances = lessons.standardised(guess.means, guess.covariances)
    return _Mixture(guess.weights.copy(), means, floored(covariances, floor))


def _finished(p: _Mixture, trace: Array, converged: bool, *, lessons: Lessons) -> Fit[Gmm]:
    gamma = _expect(p, lessons.z, gamma=True)[1].gamma
    assert gamma is not None
    occupancy = gamma.sum(axis=0)
    unvisited = np.flatnonzero(occupancy < UNVISITED)
    say_unvisited(unvisited, len(occupancy), lessons.notes)
    say_converged(converged, len(trace) - 1, lessons.notes)
    order = np.argsort(lessons.normalised_time() @ gamma / np.maximum(occupancy, 1e-300), kind="stable")
    order = order[~np.isin(order, unvisited)]
    p = _Mixture(p.weights[order] / p.weights[order].sum(), p.means[order], p.covariances[order])
    if len(unvisited):
        trace = np.append(trace[:-1], _expect(p, lessons.z)[0])
    means, covariances = lessons.original(p.means, p.covariances)
    trace = trace - lessons.log_volume
    trace.setflags(write=False)
    n, d = means.shape
    free = n - 1 + n * d + n * d * (d + 1) // 2
    return Fit(
        model=Gmm(p.weights, means, covariances, lessons.channels),
        log_likelihood=trace,
        converged=converged,
        notes=tuple(lessons.notes),
        bic=float(-2.0 * trace[-1] + free * np.log(lessons.n_frames)),
        n_frames=lessons.n_frames,
    )


def _frames(model: Gmm, x: Any) -> Array:
    frames = np.asarray(x, dtype=np.float64)
    if frames.ndim != 2 or frames.shape[1] != model.n_channels:
        raise ChannelError(f"frames must be (N, {model.n_channels}) for channels {model.channels}; got {frames.shape}")
    return frames


def _joint(model: Gmm, x: Any) -> Array:
    return log_density(_frames(model, x), model.means, model.covariances) + np.log(np.maximum(model.weights, 1e-300))
