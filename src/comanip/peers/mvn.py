"""`MVN`: one Gaussian with gmr's interface."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..interfaces import Array
from ..models.gaussian import log_density, marginal, regularised, whitening
from ..models.gmr import Conditional, conditional_lines
from .base import EstimatorError, checked_means, checked_samples, random_state, whole_number

RARE = 0.01  # share of draws inside a region below which to throw the others away would take for ever
ROUNDING = 1e-8  # of correlations
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
        x = checked_samples(X, self, least=1 + bool(bessels_correction))
        self.mean = x.mean(axis=0)
        self.covariance = np.cov(x, rowvar=False, bias=not bessels_correction)
        return self

    def sample(self, n_samples: int) -> Array:
        """Draws (n_samples, D)."""
        mean, covariance = self._initialized()
        return self.random_state.multivariate_normal(mean, covariance, size=(whole_number(n_samples, "n_samples", 0),))

    def sample_confidence_region(self, n_samples: int, alpha: float) -> Array:
        """Draws (n_samples, D) from inside the region."""
        mean, _ = self._initialized()
        n_samples, radius = whole_number(n_samples, "n_samples", 0), squared_radius(alpha, len(mean))
        if _share_within(radius, len(mean)) < RARE:
            return self._within(n_samples, radius)
        found: list[Array] = []
        while len(found) < n_samples:
            x = self.sample(1)[0]
            if self.squared_mahalanobis_distance(x) <= radius:
                found.append(x)
        return np.array(found).reshape(n_samples, len(mean))

    def _within(self, n_samples: int, radius: float) -> Array:
        """The same without a draw that is thrown away: a direction, and a distance below `radius` by its distribution."""
        from scipy.special import gammaincinv

        mean, covariance = self._initialized()
        half = len(mean) / 2.0
        share = self.random_state.random_sample(n_samples) * _share_within(radius, len(mean))
        directions = self.random_state.standard_normal((n_samples, len(mean)))
        directions *= np.sqrt(2.0 * gammaincinv(half, share) / (directions**2).sum(axis=1))[:, None]
        values, vectors = np.linalg.eigh(np.reshape(covariance, (len(mean), len(mean))))
        return mean + directions @ (vectors * np.sqrt(np.maximum(values, 0.0))).T

    def is_in_confidence_region(self, x: Any, alpha: float) -> bool:
        """gmr's region: D − 1 degrees of freedom for D > 1, see the module."""
        return bool(self.squared_mahalanobis_distance(x) <= squared_radius(alpha, len(self._initialized()[0])))

    def squared_mahalanobis_distance(self, x: Any) -> float:
        """Squared distance of x (D,) from the mean, in standard deviations."""
        means, covariances = self._as_mixture()
        x = checked_rows(np.reshape(x, (1, -1)), self, means.shape[1])
        return float(whitening(means, regularised(covariances, means)).distances(x)[0, 0])

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
        means, covariances = self._as_mixture()
        mean, covariance = marginal(means, covariances, feature_indices(indices, means.shape[1]))
        return MVN(mean[0], covariance[0], random_state=self.random_state)

    def condition(self, indices: Any, x: Any) -> MVN:
        """p(others | features in `indices` are x)."""
        inputs, outputs = inputs_and_outputs(indices, self._as_mixture()[0])
        lines = conditional_lines(*self._as_mixture(), inputs, outputs)
        mean = lines.gains[0] @ checked_rows(np.reshape(x, (1, -1)), self, len(inputs))[0] + lines.offsets[0]
        return MVN(mean, without_rounding(lines.covariances)[0], random_state=self.random_state)

    def predict(self, indices: Any, X: Any) -> Conditional:
        """Means (N, D_out) of the other features given X (N, D_in), and their covariance (D_out, D_out)."""
        inputs, outputs = inputs_and_outputs(indices, self._as_mixture()[0])
        lines = conditional_lines(*self._as_mixture(), inputs, outputs)
        x = checked_rows(X, self, len(inputs))
        return Conditional(x @ lines.gains[0].T + lines.offsets[0], without_rounding(lines.covariances)[0])

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
        means = checked_means(np.reshape(self.mean, (1, -1)), 1)
        checked_mixture_covariances(np.reshape(self.covariance, (1, *np.shape(np.atleast_2d(self.covariance)))), means)
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

    if not isinstance(alpha, int | float | np.number) or not 0.0 < float(alpha) <= 1.0:  # NaN compares false
        raise EstimatorError(f"alpha is the share of the samples inside, above 0 and at most 1; got {alpha!r}. 95 % is 0.95")
    return 2.0 * float(gammaincinv(max(n_features - 1, 1) / 2.0, alpha))  # of the chi-squared distribution


def _share_within(squared: float, n_features: int) -> float:
    """Of the samples of a Gaussian, nearer than the root of `squared` standard deviations."""
    from scipy.special import gammainc

    return float(gammainc(n_features / 2.0, squared / 2.0))


def feature_indices(indices: Any, n_features: int) -> np.ndarray:
    """Features by index, counted from the end where negative, as everywhere in Python; EstimatorError for one that is absent."""
    given = np.atleast_1d(np.asarray(indices))
    if given.dtype == bool and given.shape == (n_features,):
        given = np.flatnonzero(given)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise EstimatorError(f"indices must be whole numbers, one a feature; got {indices!r}")
    if given.size and not (given.min() >= -n_features and given.max() < n_features):
        raise EstimatorError(f"indices must be from {-n_features} to {n_features - 1} for {n_features} features; got {indices!r}")
    found = np.where(given < 0, given + n_features, given).astype(int)
    if len(set(found.tolist())) < len(found):
        raise EstimatorError(f"indices must name each feature once; got {indices!r}")
    return found


def inputs_and_outputs(indices: Any, means: Array) -> tuple[np.ndarray, np.ndarray]:
    inputs = feature_indices(indices, means.shape[1])
    outputs = np.setdiff1d(np.arange(means.shape[1]), inputs)
    if not len(outputs):
        raise EstimatorError(f"indices {indices!r} are all {means.shape[1]} features: nothing is left to predict")
    return inputs, outputs


def checked_rows(values: Any, mixture: Any, n_features: int) -> Array:
    """X (N, n_features) as float64; one row may come as (n_features,). EstimatorError says what was given."""
    x = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if x.ndim != 2 or x.shape[1] != n_features:
        raise EstimatorError(f"X must be (n_samples, {n_features}) for this {type(mixture).__name__}; got {np.shape(values)}")
    if not np.isfinite(x).all():
        row, column = np.argwhere(~np.isfinite(x))[0]
        raise EstimatorError(f"X contains {x[row, column]}: sample {row}, feature {column}")
    return x


def checked_mixture_covariances(covariances: Any, means: Array) -> Array:
    """Covariances (K, D, D): finite, symmetric, no variance below 0, else EstimatorError. A variance of 0 is a locked axis."""
    c = np.asarray(covariances, dtype=np.float64)
    k, d = means.shape
    if c.shape != (k, d, d):
        raise EstimatorError(f"covariances must have shape ({k}, {d}, {d}) as means have {means.shape}; got {c.shape}")
    if not np.isfinite(c).all():
        raise EstimatorError(f"the covariance of component {np.argwhere(~np.isfinite(c))[0][0]} is not finite")
    size = np.sqrt(np.abs(np.einsum("kii->ki", c)))
    size = np.where(size > 0.0, size, 1.0)
    unit = c / (size[:, :, None] * size[:, None, :])  # without units: metres may stand beside millimetres
    if (np.abs(unit - np.swapaxes(unit, 1, 2)) > ROUNDING).any():
        raise EstimatorError("covariances must be symmetric")
    least = np.linalg.eigvalsh(unit)[:, 0]
    if (least < -ROUNDING).any():
        worst = int(least.argmin())
        raise EstimatorError(
            f"the covariance of component {worst} is not positive definite: some direction has a variance below 0 "
            f"(a correlation beyond 1 does that); got {np.round(c[worst], 6).tolist()}"
        )
    return c


def without_rounding(covariances: Array) -> Array:
    """The same covariances (K, D, D), a variance that rounding has pushed below 0 raised to it."""
    values, vectors = np.linalg.eigh(covariances)
    if (values >= 0.0).all():
        return covariances
    raised = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return 0.5 * (raised + np.swapaxes(raised, 1, 2))


def log_densities(means: Array, covariances: Array, X: Any) -> Array:
    x = np.atleast_2d(np.asarray(X, dtype=np.float64))
    if x.shape[1] == 0:  # nothing seen: no evidence
        return np.zeros((len(x), len(means)))
    return log_density(x, means, regularised(covariances, means))
