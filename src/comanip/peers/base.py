"""What scikit-learn asks of an estimator, without importing it: parameters by name, checked input, tags when asked."""

from __future__ import annotations

import inspect
from typing import Any, Self

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array

FARTHEST = 1e100  # largest number of a sample: sums of squares of it are still float64


class EstimatorError(ParameterError, ValueError):
    """A wrong argument of an estimator; also a ValueError, because scikit-learn's users catch that."""


class Estimator:
    """Parameters are the arguments of `__init__`, stored under the same names and left alone by `fit`."""

    @classmethod
    def _parameter_names(cls) -> list[str]:
        return sorted(n for n in inspect.signature(cls.__init__).parameters if n != "self")

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters by name; `deep` is accepted and means nothing, there are no nested estimators."""
        return {name: getattr(self, name) for name in self._parameter_names()}

    def set_params(self, **params: Any) -> Self:
        names = self._parameter_names()
        for name, value in params.items():
            if name not in names:
                raise EstimatorError(
                    f"Invalid parameter {name!r} for estimator {type(self).__name__}; valid parameters are: {names}"
                )
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        set_here = {k: v for k, v in self.get_params().items() if v is not defaults[k].default}
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in set_here.items())})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "n_features_in_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, Tags, TargetTags

        return Tags(estimator_type=None, target_tags=TargetTags(required=False), input_tags=InputTags())


def not_fitted(estimator: Any) -> Exception:
    """scikit-learn's NotFittedError where it is installed: its users catch that by type."""
    text = f"This {type(estimator).__name__} instance is not fitted yet. Call 'fit' with appropriate arguments first."
    try:
        from sklearn.exceptions import NotFittedError
    except ImportError:
        return EstimatorError(text)
    return NotFittedError(text)


def random_state(seed: Any) -> np.random.RandomState:
    """A RandomState from None (numpy's global one), an integer, a RandomState or a Generator.

    The peers' interfaces promise RandomState streams; everything else in comanip takes a Generator.
    """
    if seed is None or seed is np.random:
        return np.random.mtrand._rand  # the global state that numpy.random.seed sets
    if isinstance(seed, int | np.integer):
        return np.random.RandomState(seed)
    if isinstance(seed, np.random.RandomState):
        return seed
    if isinstance(seed, np.random.Generator):
        return np.random.RandomState(int(seed.integers(2**31)))
    raise EstimatorError(f"{seed!r} cannot be used as random_state; give an integer, a RandomState or a Generator")


def whole_number(value: Any, name: str, least: int) -> int:
    """`value` as an int of at least `least`; else EstimatorError."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer) or value < least:
        raise EstimatorError(f"{name} must be a whole number of at least {least}; got {value!r}")
    return int(value)


def checked_probabilities(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """`values` as float64 of `shape`, none below 0, whose last axis sums to 1; else EstimatorError."""
    try:
        p = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise EstimatorError(f"{name} must be numbers of shape {shape}; got {values!r:.60}") from None
    if p.shape != shape:
        raise EstimatorError(f"{name} must have shape {shape}; got {p.shape}")
    if not (p >= 0.0).all():  # NaN, too
        raise EstimatorError(f"{name} must be probabilities, none below 0; got {p[~(p >= 0.0)][0]:g}")
    if not np.allclose(p.sum(axis=-1), 1.0):
        raise EstimatorError(f"{name} must sum to 1 (got {p.sum(axis=-1)})")
    return p


def checked_means(values: Any, n: int) -> Array:
    """`values` as finite float64 (n, n_features); else EstimatorError that names the state."""
    try:
        means = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise EstimatorError(f"the means must be numbers of shape ({n}, n_features); got {values!r:.60}") from None
    if means.ndim != 2 or len(means) != n or means.shape[1] < 1:
        raise EstimatorError(f"the means must have shape ({n}, n_features); got {means.shape}")
    if not np.isfinite(means).all():
        state, feature = np.argwhere(~np.isfinite(means))[0]
        raise EstimatorError(
            f"the mean of state {state}, feature {feature} is {means[state, feature]}; it must be a finite number"
        )
    return means


def checked_samples(values: Any, estimator: Any, least: int = 1) -> Array:
    """X as float64 (n_samples, n_features), finite. The wording is what scikit-learn's users know."""
    name = getattr(estimator, "__name__", type(estimator).__name__)
    if hasattr(values, "toarray"):
        raise TypeError(f"Sparse data was passed to {name}, but dense data is required. Use X.toarray() to convert.")
    raw = np.asarray(values)
    if np.iscomplexobj(raw):
        raise EstimatorError(f"Complex data not supported by {name}: {raw.dtype}")
    try:
        x = np.asarray(raw, dtype=np.float64)
    except TypeError as error:  # an object that is no number: scikit-learn expects its own words to survive
        raise TypeError(str(error)) from None
    except ValueError as error:
        raise EstimatorError(f"{name} needs numbers: {error}") from None
    if x.ndim != 2:
        advice = "array.reshape(-1, 1) if there is one feature, array.reshape(1, -1) if there is one sample"
        kind = f"{x.ndim}D array" if x.ndim != 0 else "scalar array"
        raise EstimatorError(f"Expected 2D array, got {kind} instead of shape {x.shape}. Reshape your data: {advice}.")
    if x.shape[0] < least:
        raise EstimatorError(
            f"{name} found array with n_samples={len(x)} (shape={x.shape}) while a minimum of {least} is required."
        )
    if x.shape[1] < 1:
        raise EstimatorError(f"Found array with 0 feature(s) (shape={x.shape}) while a minimum of 1 is required.")
    if not np.isfinite(x).all():
        row, column = np.argwhere(~np.isfinite(x))[0]
        what = "NaN" if np.isnan(x).any() else "infinity"
        raise EstimatorError(f"Input X contains {what}: sample {row}, feature {column} is {x[row, column]}.")
    if (np.abs(x) > FARTHEST).any():
        row, column = np.argwhere(np.abs(x) > FARTHEST)[0]
        raise EstimatorError(
            f"Input X contains a value too large: sample {row}, feature {column} is {x[row, column]:g}, and squares beyond "
            f"{FARTHEST:g} leave float64. Use another unit, or cut the sample."
        )
    return x


def checked_features(x: Array, estimator: Any, n_features: int) -> Array:
    """x (N, n_features) itself; else EstimatorError."""
    if x.shape[1] != n_features:
        raise EstimatorError(
            f"X has {x.shape[1]} features, but {type(estimator).__name__} is expecting {n_features} features as input."
        )
    return x
