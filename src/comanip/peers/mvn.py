"""`MVN`: one Gaussian with gmr's interface."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..interfaces import Array
from ..models.gaussian import log_density, marginal, regularised
from ..models.gmr import Conditional, conditional_lines
from .base import EstimatorError, random_state

_random_state = random_state  # arguments of that name are part of the interface


class MVN:
    """One Gaussian: mean (D,), covariance (D, D), with gmr's methods."""

    def __init__(self, mean: Any = None, covariance: Any = None, verbose: int = 0, random_state: Any = None) -> None:
        self.mean = None if mean is None else np.asarray(mean, dtype=np.float64)
        self.covariance = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        self.verbose = verbose
        self.random_state = _random_state(random_state)

    def from_samples(self, X: Any, bessels_correction: bool = True) -> MVN:
        """Mean and covariance of X (N, D); with Bessel's correction the covariance is unbiased, not most likely."""
        x = np.asarray(X, dtype=np.float64)
        self.mean = x.mean(axis=0)
        self.covariance = np.cov(x, rowvar=False, bias=not bessels_correction)
        return self

    def sample(self, n_samples: int) -> Array:
        """Draws (n_samples, D)."""
        mean, covariance = self._initialized()
        return self.random_state.multivariate_normal(mean, covariance, size=(n_samples,))

    def sample_confidence_region(self, n_samples: int, alpha: float) -> Array:
        """Draws until n_samples are inside the region."""
        return _accepted(n_samples, lambda: self.sample(1)[0], lambda x: self.is_in_confidence_region(x, alpha))

    def is_in_confidence_region(self, x: Any, alpha: float) -> bool:
        """gmr's region: D − 1 degrees of freedom for D > 1, see the module."""
        return bool(self.squared_mahalanobis_distance(x) <= squared_radius(alpha, len(x)))

    def squared_mahalanobis_distance(self, x: Any) -> float:
        """Squared distance of x (D,) from the mean, in standard deviations."""
        mean, covariance = self._initialized()
        apart = np.asarray(x, dtype=np.float64) - mean
        return float(apart @ np.linalg.solve(np.atleast_2d(covariance), apart))

    def to_probability_density(self, X: Any) -> Array:
        """p(x) as (N,) for X (N, D)."""
        return np.exp(log_densities(*self._as_mixture(), X)[:, 0])

    def to_norm_factor_and_exponents(self, X: Any) -> tuple[float, Array]:
        """p(x) = factor · exp(exponents)."""
        mean, covariance = self._as_mixture()
        peak = float(log_densities(mean, covariance, mean)[0, 0])
        return float(np.exp(peak)), log_densities(mean, covariance, X)[:, 0] - peak

    def marginalize(self, indices: Any) -> MVN:
        """The Gaussian of the features in `indices`."""
        mean, covariance = marginal(*self._as_mixture(), np.asarray(indices, dtype=int))
        return MVN(mean[0], covariance[0])

    def condition(self, indices: Any, x: Any) -> MVN:
        """p(others | features in `indices` are x)."""
        lines = conditional_lines(*self._as_mixture(), *inputs_and_outputs(indices, self._as_mixture()[0]))
        mean = lines.gains[0] @ np.asarray(x, dtype=np.float64) + lines.offsets[0]
        return MVN(mean, lines.covariances[0], random_state=self.random_state)

    def predict(self, indices: Any, X: Any) -> Conditional:
        """Means (N, D_out) of the other features given X (N, D_in), and their covariance (D_out, D_out)."""
        lines = conditional_lines(*self._as_mixture(), *inputs_and_outputs(indices, self._as_mixture()[0]))
        return Conditional(np.asarray(X) @ lines.gains[0].T + lines.offsets[0], lines.covariances[0])

    def to_ellipse(self, factor: float = 1.0) -> tuple[float, float, float]:
        """Angle, and the semi axes at `factor` standard deviations, of a 2-D Gaussian."""
        _, covariance = self._initialized()
        values, vectors = np.linalg.eigh(covariance)
        width, height = factor * np.sqrt(np.maximum(values[::-1], 0.0))
        return float(np.arctan2(vectors[1, -1], vectors[0, -1])), float(width), float(height)

    def sigma_points(self, alpha: float = 1e-3, kappa: float = 0.0) -> Array:
        """(2 D + 1, D) points of the unscented transform."""
        mean, covariance = self._initialized()
        values, vectors = np.linalg.eigh(alpha**2 * (len(mean) + kappa) * covariance)
        root = (vectors * np.sqrt(np.maximum(values, np.finfo(float).eps))) @ vectors.T
        return np.concatenate([mean[None], mean + root, mean - root])

    def estimate_from_sigma_points(
        self, points: Any, alpha: float = 1e-3, beta: float = 2.0, kappa: float = 0.0, random_state: Any = None
    ) -> MVN:
        """The Gaussian after a transform of `sigma_points`; alpha and kappa as there."""
        n = len(self._initialized()[0])
        points = np.asarray(points, dtype=np.float64)
        spread = alpha**2 * (n + kappa)
        weights = np.full(len(points), 0.5 / spread)
        weights[0] = 1.0 - n / spread
        mean = weights @ points
        weights[0] += 1.0 - alpha**2 + beta
        covariance = (points - mean).T @ ((points - mean) * weights[:, None])
        return MVN(mean, covariance, random_state=self.random_state if random_state is None else random_state)

    def _initialized(self) -> tuple[Array, Array]:
        if self.mean is None or self.covariance is None:
            raise EstimatorError("mean and covariance have not been set; pass both, or call from_samples")
        return self.mean, self.covariance

    def _as_mixture(self) -> tuple[Array, Array]:
        mean, covariance = self._initialized()
        return mean[None], np.reshape(covariance, (1, len(mean), len(mean)))


def plot_error_ellipse(
    ax: Any, mvn: MVN, color: Any = None, alpha: float = 0.25, factors: Iterable[float] = np.linspace(0.25, 2.0, 8)
) -> None:
    """Draws ellipses of a 2-D Gaussian at `factors` standard deviations."""
    for factor in factors:
        add_ellipse(ax, mvn.mean, mvn.to_ellipse(factor), color, alpha)


def add_ellipse(ax: Any, mean: Any, ellipse: tuple[float, float, float], color: Any, alpha: float) -> None:
    from matplotlib.patches import Ellipse

    angle, width, height = ellipse
    patch = Ellipse(xy=mean, width=2.0 * width, height=2.0 * height, angle=float(np.degrees(angle)), alpha=alpha)
    if color is not None:
        patch.set_color(color)
    ax.add_artist(patch)


def squared_radius(alpha: float, n_features: int) -> float:
    """Squared radius that gmr compares Mahalanobis distances with."""
    from scipy.special import gammaincinv

    return 2.0 * float(gammaincinv(max(n_features - 1, 1) / 2.0, alpha))  # of the chi-squared distribution


def inputs_and_outputs(indices: Any, means: Array) -> tuple[np.ndarray, np.ndarray]:
    inputs = np.asarray(indices, dtype=int)
    return inputs, np.setdiff1d(np.arange(means.shape[1]), inputs)


def log_densities(means: Array, covariances: Array, X: Any) -> Array:
    return log_density(np.atleast_2d(np.asarray(X, dtype=np.float64)), means, regularised(covariances, means))


def _accepted(n_samples: int, draw: Callable[[], Array], inside: Callable[[Array], bool]) -> Array:
    found: list[Array] = []
    while len(found) < n_samples:
        x = draw()
        if inside(x):
            found.append(x)
    return np.array(found)
