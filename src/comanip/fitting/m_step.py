"""The M-step of Gaussians: the most likely centres and covariances, no narrower than the floor."""

from __future__ import annotations

import numpy as np

from ..interfaces import Array
from ..models.gaussian import floored


def weighted_gaussians(z: Array, weights: Array, floor: float, before: tuple[Array, Array]) -> tuple[Array, Array]:
    """M-step: centres (K, D) and covariances (K, D, D) of z (N, D) under weights (N, K).

    A state with no weight at all keeps what it had `before`: any value is equally likely then.
    """
    means, covariances = before[0].copy(), before[1].copy()
    occupancy = weights.sum(axis=0)
    for i in np.flatnonzero(occupancy > 1e-10):
        w = weights[:, i] / occupancy[i]
        means[i] = w @ z
        centred = z - means[i]
        covariances[i] = (centred * w[:, None]).T @ centred
    return means, floored(covariances, floor)


def gaussians_of_moments(moments: Array, origin: Array, floor: float, before: tuple[Array, Array]) -> tuple[Array, Array]:
    """M-step from `moments_about`: centres (K, D), covariances (K, D, D). A state with no weight keeps what it had `before`."""
    occupancy = moments[:, -1, -1]
    visited = occupancy > 1e-10
    shares = moments / np.where(visited, occupancy, 1.0)[:, None, None]
    centres = shares[:, :-1, -1]
    covariances = shares[:, :-1, :-1] - centres[:, :, None] * centres[:, None, :]
    covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
    means = centres + origin
    if not visited.all():
        means = np.where(visited[:, None], means, before[0])
        covariances = np.where(visited[:, None, None], covariances, before[1])
    return means, floored(covariances, floor)
