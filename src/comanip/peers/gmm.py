"""`GMM` and `MVN`: the interface of gmr over the functions of this package, and a regressor for scikit-learn.

For those who have code that calls gmr. New code reads better with `fit_gmm` and `Regression`: channels by name, a
covariance floor, notes.

Where it differs on purpose: densities are relative to each channel's spread, so metres against millimetres change
nothing (gmr clamps a determinant at 2e-16, which flips responsibilities); a region of a 1-D Gaussian is cut at the
standard deviation (there: at the variance). What is kept although it is wrong: `is_in_confidence_region` of a
D-dimensional Gaussian counts D − 1 degrees of freedom, so LESS than alpha of the samples are inside;
`gmm.in_confidence_region` is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from .. import kernels
from ..interfaces import Array
from ..models.gaussian import log_sum_exp, marginal, normalised, regularised, shares, whitening
from ..models.gmr import conditional_lines
from ..models.moments import loses_digits, moments_about, scatter_of_frames, scatter_of_moments
from .base import EstimatorError, checked_means, checked_probabilities, checked_samples, random_state, whole_number
from .mvn import (
    MVN,
    add_ellipse,
    checked_mixture_covariances,
    checked_rows,
    feature_indices,
    inputs_and_outputs,
    log_densities,
    squared_radius,
    without_rounding,
)

_random_state = random_state  # arguments of that name are part of the interface


class GMM:
    """Gaussian mixture with gmr's methods and attributes: priors (K,), means (K, D), covariances (K, D, D)."""

    def __init__(
        self,
        n_components: int,
        priors: Any = None,
        means: Any = None,
        covariances: Any = None,
        verbose: int = 0,
        random_state: Any = None,
    ) -> None:
        self.n_components = n_components
        self.priors = None if priors is None else np.asarray(priors, dtype=np.float64)
        self.means = None if means is None else np.asarray(means, dtype=np.float64)
        self.covariances = None if covariances is None else np.array(covariances, dtype=np.float64)
        self.verbose = verbose
        self.random_state = _random_state(random_state)

    def from_samples(
        self,
        X: Any,
        R_diff: float = 1e-4,
        n_iter: int = 100,
        init_params: str = "random",
        oracle_approximating_shrinkage: bool = False,
    ) -> GMM:
        """Expectation-maximisation on X (N, D) from what is set already; the rest starts as `init_params` says.

        "random" takes K samples as means and unit covariances, which means something only when features are of size 1;
        "kmeans++" spreads the means. Stops when responsibilities change by less than R_diff (Frobenius norm).
        """
        if init_params not in ("random", "kmeans++"):
            raise EstimatorError(f"'init_params' must be 'random' or 'kmeans++'; got {init_params!r}")
        whole_number(n_iter, "n_iter", 0)
        x = checked_samples(X, self)
        self._start(x, init_params)
        checked_rows(x[:1], self, self._initialized()[1].shape[1])
        before = np.zeros((len(x), self.n_components))
        for _ in range(n_iter):
            moments, gamma, origin = self._expect(x)
            if np.linalg.norm(gamma - before) < R_diff:
                if self.verbose:
                    print("EM converged.")
                break
            before = gamma
            occupancy = moments[:, -1, -1]
            total = (occupancy + 10.0 * np.finfo(float).eps)[:, None]
            self.priors = occupancy / occupancy.sum()
            self.means = (moments[:, :-1, -1] + occupancy[:, None] * origin) / total
            if loses_digits(moments):
                self.covariances = scatter_of_frames(x, gamma, self.means) / total[:, :, None]
            else:
                self.covariances = scatter_of_moments(moments, self.means - origin) / total[:, :, None]
            still = np.ptp(x, axis=0) == 0.0  # a locked axis varies by rounding, which would be taken for knowledge
            self.covariances[:, still, :] = self.covariances[:, :, still] = 0.0
            self.means[:, still] = x[0, still]
            if oracle_approximating_shrinkage:
                self.apply_oracle_approximating_shrinkage(gamma.sum(axis=0) ** 2 / (gamma**2).sum(axis=0))
        return self

    def _expect(self, x: Array) -> tuple[Array, Array, Array]:
        """Moments as in `models.moments.moments_about`, γ (N, K), and the moments' origin (D,)."""
        priors, means, covariances = self._parameters()
        white = whitening(means, regularised(covariances, means))
        if kernels.native is None:
            gamma = normalised(white.log_density(x) + _log(priors))
            return moments_about(white.origin, x, gamma), gamma, white.origin
        _, moments, found = kernels.mixture(x, _log(priors), white.arrays, weights=True)
        assert found is not None
        return moments, found, white.origin

    def _start(self, x: Array, init_params: str) -> None:
        n, d = whole_number(self.n_components, "n_components", 1), x.shape[1]
        if self.priors is None:
            self.priors = np.full(n, 1.0 / n)
        if self.means is None and init_params == "random":
            self.means = x[self.random_state.choice(np.arange(len(x)), n)]
        elif self.means is None:
            self.means = kmeansplusplus_initialization(x, n, self.random_state)
        if self.covariances is None and init_params == "random":
            self.covariances = np.tile(np.eye(d), (n, 1, 1))
        elif self.covariances is None:
            self.covariances = covariance_initialization(x, n)

    def apply_oracle_approximating_shrinkage(self, n_samples_eff: Any) -> None:
        """Shrinks covariances towards a sphere, the more the fewer samples they came from (Chen et al., 2010)."""
        _, means, covariances = self._initialized()
        d = means.shape[1]
        for k, n in enumerate(np.broadcast_to(n_samples_eff, (self.n_components,))):
            sphere, power = np.trace(covariances[k]) / d, np.mean(covariances[k] ** 2)
            apart = (n + 1.0) * (power - sphere**2 / d)
            shrinkage = 1.0 if apart == 0.0 else min((power + sphere**2) / apart, 1.0)
            covariances[k] = (1.0 - shrinkage) * covariances[k] + shrinkage * sphere * np.eye(d)

    def to_responsibilities(self, X: Any) -> Array:
        """p(k | x) as (N, K)."""
        priors, means, covariances = self._initialized()
        return shares(checked_rows(X, self, means.shape[1]), means, regularised(covariances, means), _log(priors))

    def to_probability_density(self, X: Any) -> Array:
        """p(x) as (N,)."""
        priors, means, covariances = self._initialized()
        x = checked_rows(X, self, means.shape[1])
        return np.exp(log_sum_exp(log_densities(means, covariances, x) + _log(priors)))

    def to_mahalanobis_distance(self, X: Any) -> Array:
        """Distance (N, K) of each sample to each component, in standard deviations."""
        _, means, covariances = self._initialized()
        x = checked_rows(X, self, means.shape[1])
        return np.sqrt(whitening(means, regularised(covariances, means)).distances(x))

    def condition(self, indices: Any, x: Any) -> GMM:
        """p(others | features in `indices` are x), again a mixture."""
        priors, means, covariances = self._initialized()
        inputs, outputs = inputs_and_outputs(indices, means)
        lines = conditional_lines(means, covariances, inputs, outputs)
        given = checked_rows(np.reshape(x, (1, -1)), self, len(inputs))
        weights = normalised(log_densities(*marginal(means, covariances, inputs), given) + _log(priors))[0]
        return GMM(
            self.n_components, weights, lines.gains @ given[0] + lines.offsets, without_rounding(lines.covariances),
            random_state=self.random_state,
        )  # fmt: skip

    def predict(self, indices: Any, X: Any) -> Array:
        """Means (N, D_out) of the other features given X (N, D_in)."""
        priors, means, covariances = self._initialized()
        inputs, outputs = inputs_and_outputs(indices, means)
        lines = conditional_lines(means, covariances, inputs, outputs)
        x = checked_rows(X, self, len(inputs))
        seen = marginal(means, covariances, inputs)
        weights = np.tile(priors, (len(x), 1))
        if len(inputs):
            weights = shares(x, seen[0], regularised(seen[1], seen[0]), _log(priors))
        each = x @ lines.gains.reshape(lines.offsets.size, len(inputs)).T + lines.offsets.reshape(-1)
        return np.einsum("nk,nko->no", weights, each.reshape(len(x), *lines.offsets.shape))

    def marginalize(self, indices: Any) -> GMM:
        """The mixture of the features in `indices`."""
        priors, means, covariances = self._initialized()
        kept = marginal(means, covariances, feature_indices(indices, means.shape[1]))
        return GMM(self.n_components, priors, *kept, random_state=self.random_state)

    def sample(self, n_samples: int) -> Array:
        """Draws (n_samples, D), component after component."""
        return self._by_component(n_samples, lambda mvn, n: mvn.sample(n))

    def sample_confidence_region(self, n_samples: int, alpha: float) -> Array:
        """Draws from the regions of the components."""
        squared_radius(alpha, 1)  # refused also where nothing is drawn
        return self._by_component(n_samples, lambda mvn, n: mvn.sample_confidence_region(n, alpha))

    def is_in_confidence_region(self, x: Any, alpha: float) -> bool:
        """Is x in gmr's region of the closest component?"""
        _, means, covariances = self._initialized()
        point = checked_rows(np.reshape(x, (1, -1)), self, means.shape[1])
        nearest = whitening(means, regularised(covariances, means)).distances(point).min()
        return bool(nearest <= squared_radius(alpha, means.shape[1]))

    def to_ellipses(self, factor: float = 1.0) -> list[tuple[Array, tuple[float, float, float]]]:
        """Mean and ellipse of every component, see `MVN.to_ellipse`."""
        _, means, _ = self._initialized()
        return [(mean, self.extract_mvn(k).to_ellipse(factor)) for k, mean in enumerate(means)]

    def to_mvn(self) -> MVN:
        """One Gaussian with the mixture's mean and covariance."""
        priors, means, covariances = self._initialized()
        mean = priors @ means
        between = (means - mean).T @ ((means - mean) * priors[:, None])
        covariance = np.einsum("k,kij->ij", priors, covariances) + between
        return MVN(mean, covariance, self.verbose, self.random_state)

    def extract_mvn(self, component_idx: int) -> MVN:
        """One component."""
        _, means, covariances = self._initialized()
        if not 0 <= component_idx < self.n_components:
            raise EstimatorError(f"component_idx must be from 0 to {self.n_components - 1}; got {component_idx!r}")
        return MVN(means[component_idx], covariances[component_idx], self.verbose, self.random_state)

    def _by_component(self, n_samples: int, draw: Callable[[MVN, int], Array]) -> Array:
        priors, means, _ = self._initialized()
        chosen = self.random_state.choice(self.n_components, size=(whole_number(n_samples, "n_samples", 0),), p=priors)
        count = np.bincount(chosen, minlength=self.n_components)
        parts = [draw(self.extract_mvn(int(k)), int(count[k])) for k in np.flatnonzero(count)]
        return np.concatenate([np.empty((0, means.shape[1])), *parts])

    def _initialized(self) -> tuple[Array, Array, Array]:
        """What is set, checked: attributes may be assigned at any time."""
        priors, means, covariances = self._parameters()
        n = whole_number(self.n_components, "n_components", 1)
        means = checked_means(means, n)
        return checked_probabilities(priors, (n,), "priors"), means, checked_mixture_covariances(covariances, means)

    def _parameters(self) -> tuple[Array, Array, Array]:
        if self.priors is None or self.means is None or self.covariances is None:
            raise EstimatorError("priors, means and covariances have not all been set; pass them, or call from_samples")
        return self.priors, self.means, self.covariances


def kmeansplusplus_initialization(X: Any, n_components: int, random_state: Any = None) -> Array:
    """K samples (K, D) spread over X: each drawn in proportion to its squared distance to those drawn before."""
    x = checked_samples(X, kmeansplusplus_initialization)
    if not 0 < n_components <= len(x):
        raise EstimatorError(f"n_components must be from 1 to the {len(x)} samples; got {n_components!r}")
    draw = _random_state(random_state)
    chosen = [int(draw.choice(len(x)))]
    while len(chosen) < n_components:
        apart = ((x[:, None, :] - x[chosen][None]) ** 2).sum(axis=2).min(axis=1)
        apart[chosen] = 0.0
        if apart.sum() <= 0.0:  # only copies are left
            apart = np.ones(len(x))
            apart[chosen] = 0.0
        chosen.append(int(draw.choice(len(x), p=apart / apart.sum())))
    return x[chosen]


def covariance_initialization(X: Any, n_components: int) -> Array:
    """Diagonal covariances (K, D, D): the mean distance of two samples in each feature, divided by K, squared."""
    if n_components <= 0:
        raise EstimatorError(f"n_components must be above 0; got {n_components!r}")
    x = np.sort(checked_samples(X, covariance_initialization, least=2), axis=0)
    n = len(x)
    # Σ_{i<j} (x_j − x_i) of sorted numbers is Σ_i (2 i − n + 1) x_i: no table of all pairs
    average = (2.0 * np.arange(n) - n + 1.0) @ x / (0.5 * n * (n - 1.0))
    return np.tile(np.diag((average / n_components) ** 2), (n_components, 1, 1))


def plot_error_ellipses(
    ax: Any, gmm: GMM, colors: Any = None, alpha: float = 0.25, factors: Iterable[float] = np.linspace(0.25, 2.0, 8)
) -> None:
    """Draws ellipses of every component of a 2-D mixture."""
    palette = list(colors) if colors is not None else [None]
    for factor in factors:
        for k, (mean, ellipse) in enumerate(gmm.to_ellipses(factor)):
            add_ellipse(ax, mean, ellipse, palette[k % len(palette)], alpha)


def _log(priors: Array) -> Array:
    return np.log(np.maximum(priors, 1e-300))
