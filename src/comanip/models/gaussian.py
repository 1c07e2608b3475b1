"""Gaussian densities of all states at once, their marginals, and a covariance floor that knows no units.

Nothing here may overflow, divide by zero or depend on the unit of a channel: a force of 1e5 N or a world frame 1e6 m
away must give finite numbers and the same answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array

LOG_2PI = float(np.log(2.0 * np.pi))
LEAST_LOG_DENSITY = -1e100  # stands for log 0 of a density: finite, so that sums over time stay finite
LEAST_RATIO = 1e-12  # of variances: below it a Cholesky factor is rounding
MOST_FLOAT32 = 1e4  # standard deviations: float32 then rounds to a thousandth of one
FARTHEST = 1e140  # distances beyond this many standard deviations are all alike; its square is still a float64


@dataclass(frozen=True, eq=False)
class Whitening:
    """Inverse Cholesky factors of K Gaussians, prepared once so that a density costs one matrix product.

    With Σ_i = L_i L_iᵀ the distance of x to state i is |L_i⁻¹ (x − μ_i)|². Everything is written around `origin`, the
    mean of the centres, because x and μ_i may both be 1e6 m away from the zero of their frame.

    origin    (D,)      subtract it from x first
    factors   (K·D, D)  rows of all L_i⁻¹
    centres   (K·D,)    L_i⁻¹ (μ_i − origin)
    log_peak  (K,)      log N(μ_i; μ_i, Σ_i)
    """

    origin: Array
    factors: Array
    centres: Array
    log_peak: Array

    @property
    def n_states(self) -> int:
        return len(self.log_peak)

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """As the compiled kernels take them."""
        return self.origin, self.factors, self.centres, self.log_peak

    def distances(self, x: Array) -> Array:
        """Squared Mahalanobis distances (N, K) of x (N, D) to every state."""
        z = np.clip(x - self.origin, -FARTHEST, FARTHEST) @ self.factors.T - self.centres
        np.clip(z, -FARTHEST, FARTHEST, out=z)
        z *= z
        return z.reshape(len(x), self.n_states, len(self.origin)).sum(axis=2)

    def log_density(self, x: Array) -> Array:
        """log N(x; μ_i, Σ_i) as (N, K) for x (N, D)."""
        return np.maximum(self.log_peak - 0.5 * self.distances(x), LEAST_LOG_DENSITY)


def shares(x: Array, means: Array, covariances: Array, log_weights: Array | float = 0.0) -> Array:
    """w_i N(x_n; μ_i, Σ_i) / Σ_j w_j N(x_n; μ_j, Σ_j) as (N, K), compiled where possible; NaN in x as in `log_density`."""
    x = np.asarray(x, dtype=np.float64)
    if kernels.native is None or not np.isfinite(x.sum()) or not len(x):
        return normalised(log_density(x, means, covariances) + log_weights)
    weights = np.zeros(len(means)) + log_weights
    found = kernels.mixture(x, weights, whitening(means, covariances).arrays, weights=True)[2]
    assert found is not None
    return found


def in_float32(precision: str) -> bool:
    """Whether "float64" or "float32" means float32 here: the twins know float64 only."""
    if precision not in ("float64", "float32"):
        raise ParameterError(f"precision must be 'float64' or 'float32'; got {precision!r}")
    return precision == "float32" and kernels.native is not None


def suits_float32(white: Whitening, means: Array, covariances: Array, origin: Array | float | None = None) -> bool:
    """Whether float32 can tell frames within each state apart, seen from `origin`: not with a state far away, or with channels
    that repeat each other."""
    reach = np.abs(means - (white.origin if origin is None else origin)) + np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    factors = np.abs(white.factors).reshape(covariances.shape)
    return bool((factors @ reach[:, :, None]).max() < MOST_FLOAT32)


def whitening(means: Array, covariances: Array) -> Whitening:
    """Prepares the densities of K Gaussians: means (K, D), covariances (K, D, D), all positive definite."""
    n_states, n_channels = means.shape
    factors = np.linalg.inv(cholesky(covariances)) * _triangle(n_channels)
    origin = np.add.reduce(means, axis=0) / n_states
    centres = (factors @ (means - origin)[:, :, None])[:, :, 0]
    log_det = -2.0 * np.add.reduce(np.log(np.diagonal(factors, axis1=1, axis2=2)), axis=1)
    return Whitening(
        origin=origin,
        factors=np.ascontiguousarray(factors.reshape(n_states * n_channels, n_channels)),
        centres=centres.reshape(-1),
        log_peak=-0.5 * (n_channels * LOG_2PI + log_det),
    )


@lru_cache
def _triangle(n: int) -> Array:
    """1 on and below the diagonal: an inverse by pivoting leaves rounding above it."""
    return np.tri(n)


def cholesky(covariances: Array) -> Array:
    """Lower factors (K, D, D); a state without one is named in a ParameterError."""
    try:
        return np.asarray(np.linalg.cholesky(covariances), dtype=np.float64)
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(covariances)[:, 0]
        state = int(np.argmin(least))
        raise ParameterError(
            f"the covariance of state {state} is not positive definite (smallest eigenvalue {least[state]:.3g}); "
            "train with a covariance floor, or drop the channel that repeats another"
        ) from None


def log_density(x: Array, means: Array, covariances: Array) -> Array:
    """log N(x; μ_i, Σ_i) as (N, K): samples (N, D), means (K, D), covariances (K, D, D).

    NaN in x means "missing": those samples get the density of the channels that are present (the marginal), and a
    sample with nothing present gets log 1 = 0 for every state: no evidence.
    """
    x = np.asarray(x, dtype=np.float64)
    missing = np.isnan(x)
    if not missing.any():
        return whitening(means, covariances).log_density(x)
    out = np.zeros((len(x), len(means)))
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for p, pattern in enumerate(patterns):
        present = np.flatnonzero(~pattern)
        if len(present):
            rows = which.reshape(-1) == p
            out[rows] = whitening(*marginal(means, covariances, present)).log_density(x[rows][:, present])
    return out


def marginal(means: Array, covariances: Array, indices: Sequence[int] | np.ndarray) -> tuple[Array, Array]:
    """Means (K, M) and covariances (K, M, M) of the M channels in `indices`: the others are integrated out."""
    index = np.asarray(indices, dtype=np.intp)
    return means[:, index], covariances[:, index[:, None], index[None, :]]


def floored(covariances: Array, floor: float) -> Array:
    """Raises every eigenvalue of (..., D, D) to at least `floor`.

    This is the exact solution of "most likely Σ with Σ − floor·I ⪰ 0", so EM with it still never falls. It has a
    meaning only where the channels share a unit: call it in standardised coordinates.
    """
    try:
        np.linalg.cholesky(covariances - floor * np.eye(covariances.shape[-1]))
        return covariances  # the usual case, at a third of the cost of eigenvalues
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariances)
    lifted = (vectors * np.maximum(values, floor)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return 0.5 * (lifted + np.swapaxes(lifted, -1, -2))


def regularised(covariances: Array, means: Array) -> Array:
    """The same covariances (K, D, D) where they are positive definite; else raised just enough to have a density.

    For covariances that come from elsewhere, learned without a floor. Relative to each channel's spread in the whole
    mixture, so it knows no units.
    """
    size = np.sqrt(np.einsum("kii->ki", covariances).mean(axis=0) + means.var(axis=0))
    size = np.where(size > 0.0, size, 1.0)
    unit = size[:, None] * size[None, :]
    return floored(covariances / unit, LEAST_RATIO) * unit


def log_sum_exp(values: Array, axis: int = -1) -> Array:
    """log Σ exp(values) along `axis`, for finite values."""
    top = values.max(axis=axis, keepdims=True)
    return np.squeeze(top, axis) + np.log(np.exp(values - top).sum(axis=axis))


def normalised(log_weights: Array) -> Array:
    """Weights that sum to 1 along the last axis, from their logarithms."""
    weights = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True))
    return weights / weights.sum(axis=-1, keepdims=True)


def gaussian_blocks(means: Any, covariances: Any, n_states: int, n_channels: int) -> tuple[Array, Array]:
    """Checked, read-only means (K, D) and covariances (K, D, D) of a model."""
    mu, sigma = _read_only(means), _read_only(covariances)
    if mu.shape != (n_states, n_channels) or sigma.shape != (n_states, n_channels, n_channels):
        raise ParameterError(
            f"{n_states} states and {n_channels} channels need means ({n_states}, {n_channels}) and covariances "
            f"({n_states}, {n_channels}, {n_channels}); got {mu.shape} and {sigma.shape}"
        )
    for name, array in (("means", mu), ("covariances", sigma)):
        if not np.isfinite(array).all():
            state = int(np.argwhere(~np.isfinite(array))[0][0])
            raise ParameterError(f"{name} of state {state} are not finite")
    size = np.sqrt(np.abs(np.einsum("kii->ki", sigma)))
    if (np.abs(sigma - np.swapaxes(sigma, 1, 2)) > 1e-8 * size[:, :, None] * size[:, None, :]).any():
        raise ParameterError("covariances must be symmetric")
    cholesky(sigma)
    return mu, sigma


def probabilities(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """Checked, read-only probabilities whose last axis sums to 1."""
    p = _read_only(values)
    if p.shape != shape:
        raise ParameterError(f"{name} must have shape {shape}; got {p.shape}")
    if not np.isfinite(p).all() or (p < 0.0).any():
        raise ParameterError(f"{name} must be finite and not negative")
    sums = p.sum(axis=-1)
    if (np.abs(sums - 1.0) > 1e-6).any():
        raise ParameterError(f"{name} must sum to 1 along the last axis; got {np.round(sums, 6).tolist()}")
    return p


class States:
    """What all values of K Gaussian states over named channels share: how many there are, a line that shows it, and a way in.

    Not a model by itself: `Hmm`, `Hsmm`, `Gmm` and those on curved spaces have the fields.
    """

    means: Array
    channels: tuple[str, ...]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.n_states} states over {', '.join(self.channels)})"

    @property
    def n_states(self) -> int:
        """K"""
        return len(self.means)

    def _stored(self, **checked: Any) -> None:
        """Puts the checked value of each field in the place of the given one: the values are frozen."""
        for name, value in checked.items():
            object.__setattr__(self, name, value)


class EuclideanStates(States):
    """States whose channels are plain numbers: means (K, D), covariances (K, D, D)."""

    covariances: Array

    @property
    def n_channels(self) -> int:
        """D"""
        return len(self.channels)

    def _checked_gaussians(self, n_states: int | None = None) -> int:
        """K, as the means have it where it is not given; stores means, covariances and channels as checked."""
        channels = channel_names(self.channels)
        n = np.shape(self.means)[0] if np.ndim(self.means) == 2 else -1
        if n_states is None and n < 1:
            raise ParameterError(f"means must be (K, D) with at least one state; got shape {np.shape(self.means)}")
        n = n if n_states is None else n_states
        mu, sigma = gaussian_blocks(self.means, self.covariances, n, len(channels))
        self._stored(means=mu, covariances=sigma, channels=channels)
        return n


def channel_names(names: Any) -> tuple[str, ...]:
    """Checked channel names: strings, at least one, none twice."""
    channels = (names,) if isinstance(names, str) else tuple(str(n) for n in names)
    twice = sorted({c for c in channels if channels.count(c) > 1})
    if not channels or twice:
        raise ParameterError(f"channels need names, each once; got {channels}" + (f", twice: {twice}" if twice else ""))
    return channels


def _read_only(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
