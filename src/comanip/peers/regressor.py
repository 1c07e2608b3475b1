"""`GaussianMixtureRegressor`: Gaussian mixture regression for scikit-learn, a regressor to everything in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..interfaces import Array
from .base import Estimator, EstimatorError, checked_features, checked_samples, not_fitted
from .gmm import GMM


class GaussianMixtureRegressor(Estimator):
    """scikit-learn's regressor over `GMM`: fit(X, y), predict(X), score(X, y); afterwards gmm_."""

    _estimator_type = "regressor"  # scikit-learn before 1.6 asks for this, later ones for the tags

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
        target = self._target(y, len(x))
        self._one_output = np.asarray(y).ndim == 1
        self.gmm_ = GMM(
            self.n_components, self.priors, self.means, self.covariances, self.verbose, self.random_state
        ).from_samples(np.hstack([x, target]), self.R_diff, self.n_iter, self.init_params)
        self.indices_ = np.arange(x.shape[1])
        self.n_features_in_ = x.shape[1]
        return self

    def _target(self, y: Any, n_samples: int) -> Array:
        """y as (N, D_out), finite, as long as X."""
        values = np.asarray(y)
        try:
            target = checked_samples(values[:, None] if values.ndim == 1 else values, self)
        except EstimatorError as error:
            raise EstimatorError(str(error).replace("Input X", "Input y")) from None
        if len(target) != n_samples:
            raise EstimatorError(f"X and y need as many samples; got {n_samples} and {len(target)}")
        return target

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:
        """R² of predict(X), the mean over outputs: 1 is exact, 0 no better than the mean of y. As every regressor's."""
        found = self.predict(X)
        target = self._target(y, len(found))
        if target.shape != np.reshape(found, (len(found), -1)).shape:
            raise EstimatorError(f"y has {target.shape[1]} outputs, and fit had {np.reshape(found, (len(found), -1)).shape[1]}")
        weights = np.ones(len(target)) if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
        if weights.shape != (len(target),) or not (weights >= 0.0).all() or not weights.sum() > 0.0:
            raise EstimatorError(
                f"sample_weight must be ({len(target)},), none below 0 and not all 0; got {np.shape(sample_weight)}"
            )
        left = weights @ (target - found.reshape(target.shape)) ** 2
        spread = weights @ (target - weights @ target / weights.sum()) ** 2
        exact = np.where(left == 0.0, 1.0, 0.0)  # of an output that never changes
        return float(np.where(spread > 0.0, 1.0 - left / np.where(spread > 0.0, spread, 1.0), exact).mean())

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags

        tags = super().__sklearn_tags__()
        tags.estimator_type, tags.regressor_tags = "regressor", RegressorTags()
        tags.target_tags.required = tags.target_tags.multi_output = True
        return tags

    def predict(self, X: Any) -> Array:
        """(N, D_out) as y was given: a 1-D y comes back 1-D."""
        if not hasattr(self, "gmm_"):
            raise not_fitted(self)
        x = checked_features(checked_samples(X, self), self, self.n_features_in_)
        found = self.gmm_.predict(self.indices_, x)
        return found[:, 0] if self._one_output else found
