"""Weighted sums and products of frames: what means and covariances are made of."""

from __future__ import annotations

import numpy as np

from ..interfaces import Array

MOST_APART = 1e4  # squared distance of a state from its moments' origin over its variance: further out digits are lost


def moments_about(origin: Array, z: Array, weights: Array) -> Array:
    """Σ_n w_ni (z_n − origin, 1)(z_n − origin, 1)ᵀ, (K, D + 1, D + 1): occupancy, sums and products of every state."""
    d = z.shape[1]
    extended = np.ones((len(z), d + 1))
    np.subtract(z, origin, out=extended[:, :d])
    return np.stack([(extended * w[:, None]).T @ extended for w in weights.T])


def loses_digits(moments: Array) -> bool:
    """Whether a state is so far from the origin of its moments, in its own standard deviations, that its scatter is a small
    difference of large numbers."""
    occupancy = moments[:, -1, -1]
    squared = moments[:, :-1, -1] ** 2 / np.maximum(occupancy, 1e-300)[:, None]
    scatter = np.einsum("kii->ki", moments[:, :-1, :-1]) - squared
    return bool((squared > MOST_APART * scatter)[occupancy > 1e-10].any())


def scatter_of_moments(moments: Array, means: Array) -> Array:
    """Σ_n w_ni (z_n − μ_i)(z_n − μ_i)ᵀ, (K, D, D), from `moments_about` an origin, from which the means (K, D) are seen, too."""
    cross = moments[:, :-1, -1, None] * means[:, None, :]
    squares = moments[:, -1, -1, None, None] * means[:, :, None] * means[:, None, :]
    scatter = moments[:, :-1, :-1] - 2.0 * cross + squares  # made symmetric below
    return 0.5 * (scatter + np.swapaxes(scatter, 1, 2))


def scatter_of_frames(z: Array, weights: Array, means: Array) -> Array:
    """The same from frames (N, D) and weights (N, K), with all digits wherever the states are."""
    centred = (z - mean for mean in means)
    return np.array([(c * w[:, None]).T @ c for c, w in zip(centred, weights.T, strict=True)])
