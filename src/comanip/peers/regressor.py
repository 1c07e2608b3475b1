"""`GaussianMixtureRegressor`: Gaussian mixture regression for scikit-learn."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..interfaces import Array
from .base import Estimator, EstimatorError, checked_features, checked_samples, not_fitted
from .gmm import GMM


class GaussianMixtureRegressor(Estimator):
    """scikit-learn's regressor over `GMM`: fit(X, y), predict(X); afterwards gmm_."""

    def __init__(
        self,
        n_components: int = 1,
        priors: Any = None,
        means: Any = None,
        covariances: Any = None,
        verbose: int = 0,
        random_state: Any = None,
        R_diff: float = 1e-4,
        n_iter: int = 500,
        init_params: str = "random",
    ) -> None:
        self.n_components = n_components
        self.priors = priors
        self.means = means
        self.covariances = covariances
        self.verbose = verbose
        self.random_state = random_state
        self.R_diff = R_diff
        self.n_iter = n_iter
        self.init_params = init_params

    def fit(self, X: Any, y: Any) -> GaussianMixtureRegressor:
        """Learns the joint density of X (N, Di) and y (N,) or (N, Do); returns itself."""
        x = checked_samples(X, self)
        if y is None:
            raise EstimatorError("requires y to be passed, but the target y is None")
        self._one_output = np.ndim(y) == 1
        target = checked_samples(np.asarray(y).reshape(len(y), -1) if np.ndim(y) else y, self)
        if len(target) != len(x):
            raise EstimatorError(f"X and y need as many samples; got {len(x)} and {len(target)}")
        self.gmm_ = GMM(
            self.n_components, self.priors, self.means, self.covariances, self.verbose, self.random_state
        ).from_samples(np.hstack([x, target]), self.R_diff, self.n_iter, self.init_params)
        self.indices_ = np.arange(x.shape[1])
        self.n_features_in_ = x.shape[1]
        return self

    def predict(self, X: Any) -> Array:
        """(N, D_out) as y was given: a 1-D y comes back 1-D."""
        if not hasattr(self, "gmm_"):
            raise not_fitted(self)
        x = checked_features(checked_samples(X, self), self, self.n_features_in_)
        found = self.gmm_.predict(self.indices_, x)
        return found[:, 0] if self._one_output else found
