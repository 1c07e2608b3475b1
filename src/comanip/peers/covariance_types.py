"""Covariances as hmmlearn stores them: full, diagonal, spherical, or one for all states."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..interfaces import Array
from .base import EstimatorError

COVARIANCE_TYPES = ("spherical", "diag", "full", "tied")


def expanded(covars: Array, covariance_type: str, n: int, d: int) -> Array:
    """Full matrices (n, d, d) from the compressed form of a type."""
    if covariance_type == "full":
        return covars
    if covariance_type == "tied":
        return np.tile(covars, (n, 1, 1))
    if covariance_type == "spherical":
        return np.reshape(covars, (n, -1)).mean(axis=1)[:, None, None] * np.eye(d)
    return covars[:, :, None] * np.eye(d)


def compressed(full: Array, shares: Array, covariance_type: str) -> Array:
    """The form in which a type is stored, from full matrices (n, d, d); `shares` (n,) weigh the states for "tied"."""
    variances = np.einsum("kii->ki", full).copy()
    if covariance_type == "tied":
        return np.einsum("k,kij->ij", shares, full)
    return {"full": full, "diag": variances, "spherical": variances.mean(axis=1)}[covariance_type]


def checked_covariances(covars: Any, covariance_type: str, n: int) -> Array:
    """A copy of `covars` in the shape of its type, positive definite; else EstimatorError."""
    try:
        c = np.array(covars, dtype=np.float64)
    except (TypeError, ValueError):
        raise EstimatorError(f"covars_ of type {covariance_type!r} must be numbers; got {covars!r:.60}") from None
    if not np.isfinite(c).all():
        raise EstimatorError(f"covars_ of state {np.argwhere(~np.isfinite(c))[0][0]} are not finite")
    if covariance_type == "spherical":
        fits, positive = c.ndim >= 1 and len(c) == n, c.size > 0 and bool((c > 0.0).all())
    elif covariance_type == "diag":
        fits, positive = c.ndim == 2 and len(c) == n, bool((c > 0.0).all())
    elif covariance_type in ("tied", "full"):
        fits = c.ndim == (2 if covariance_type == "tied" else 3) and c.shape[-1] == c.shape[-2]
        fits = fits and (covariance_type == "tied" or len(c) == n)
        symmetric = fits and np.allclose(c, np.swapaxes(c, -1, -2))
        positive = bool(symmetric and (np.linalg.eigvalsh(c) > 0.0).all())
    else:
        raise EstimatorError(f"covariance_type must be one of {COVARIANCE_TYPES}; got {covariance_type!r}")
    if not (fits and positive):
        raise EstimatorError(
            f"covars_ of type {covariance_type!r} must be positive definite in their own shape for {n} states; "
            f"got shape {c.shape}"
        )
    return c


def n_features_of(covars: Array, covariance_type: str) -> int | None:
    """D of covariances as a type stores them; None where the type does not say."""
    return None if covariance_type == "spherical" else int(covars.shape[-1])
