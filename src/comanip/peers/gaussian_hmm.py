"""`GaussianHMM`: the interface of hmmlearn over the functions of this package.

For those who have code that calls hmmlearn. New code reads better with `fit_hmm`, which starts from time instead of at
random, knows channels by name, works in standardised coordinates and says what was suspicious.

Where it differs on purpose: a scalar `covars_prior` is added to the DIAGONAL of full and tied covariances (hmmlearn
adds it to every entry, which pushes correlations towards 1 when channels are small numbers); a state that no frame
visits keeps its parameters (there: NaN); a data offset of 1e6 changes nothing.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from .. import kernels
from ..fitting.guesses import k_means
from ..interfaces import Array
from ..models import chains
from ..models.gaussian import Whitening, regularised, whitening
from ..models.moments import loses_digits, moments_about, scatter_of_frames, scatter_of_moments
from .base import (
    Estimator,
    EstimatorError,
    checked_features,
    checked_means,
    checked_probabilities,
    checked_samples,
    not_fitted,
    random_state,
    whole_number,
)
from .covariance_types import COVARIANCE_TYPES, checked_covariances, compressed, expanded, n_features_of
from .monitor import ConvergenceMonitor

_log = logging.getLogger(__name__)
K_MEANS_STARTS, K_MEANS_FRAMES = 10, 10_000
SCALING_LIMIT = -745.0  # exp of it is the last number above 0


class GaussianHMM(Estimator):
    """Gaussian hidden Markov model with hmmlearn's parameters, methods and attributes.

    After `fit`: startprob_ (K,), transmat_ (K, K), means_ (K, D), covars_ as full matrices (K, D, D), monitor_.
    `covars_` is SET in the shape of `covariance_type`: (K,), (K, D), (K, D, D) or (D, D).
    X is (n_samples, D) with sequences one after another, `lengths` their lengths.
    """

    startprob_: Any
    transmat_: Any
    means_: Any

    def __init__(
        self,
        n_components: int = 1,
        covariance_type: str = "diag",
        min_covar: float = 1e-3,
        startprob_prior: Any = 1.0,
        transmat_prior: Any = 1.0,
        means_prior: Any = 0,
        means_weight: Any = 0,
        covars_prior: Any = 1e-2,
        covars_weight: Any = 1,
        algorithm: str = "viterbi",
        random_state: Any = None,
        n_iter: int = 10,
        tol: float = 1e-2,
        verbose: bool = False,
        params: str = "stmc",
        init_params: str = "stmc",
        implementation: str = "log",
    ) -> None:
        """`implementation`: both compute the same; "scaling" keeps refusing frames that no state explains."""
        self.n_components = n_components
        self.covariance_type = covariance_type
        self.min_covar = min_covar
        self.startprob_prior = startprob_prior
        self.transmat_prior = transmat_prior
        self.means_prior = means_prior
        self.means_weight = means_weight
        self.covars_prior = covars_prior
        self.covars_weight = covars_weight
        self.algorithm = algorithm
        self.random_state = random_state
        self.n_iter = n_iter
        self.tol = tol
        self.verbose = verbose
        self.params = params
        self.init_params = init_params
        self.implementation = implementation

    # Attributes

    @property
    def monitor_(self) -> ConvergenceMonitor:
        """Set your own before `fit` to stop by another rule."""
        if "_monitor" not in vars(self):
            self._monitor = ConvergenceMonitor(self.tol, self.n_iter, self.verbose)
            self._monitor_is_ours = True
        return self._monitor

    @monitor_.setter
    def monitor_(self, monitor: Any) -> None:
        self._monitor, self._monitor_is_ours = monitor, False

    @property
    def n_features(self) -> int:
        """D, from the means."""
        return int(np.shape(self.means_)[1])

    @n_features.setter
    def n_features(self, value: int) -> None:
        if hasattr(self, "means_") and value != self.n_features:
            raise EstimatorError(f"means_ has {self.n_features} features; n_features cannot be {value}")

    @property
    def covars_(self) -> Array:
        """(K, D, D), whatever the type."""
        return expanded(self._covars_, self.covariance_type, self.n_components, self.n_features)

    @covars_.setter
    def covars_(self, covars: Any) -> None:
        self._covars_ = checked_covariances(covars, self.covariance_type, self.n_components)

    def __sklearn_is_fitted__(self) -> bool:
        return all(hasattr(self, name) for name in ("startprob_", "transmat_", "means_", "_covars_"))

    # Learning

    def fit(self, X: Any, lengths: Any = None) -> GaussianHMM:
        """Expectation-maximisation from the parameters that `init_params` does not draw anew.

        scikit-learn passes a target y in the second place; one entry per sample that does not sum to n_samples is taken
        for that, and ignored.
        """
        x = checked_samples(X, self)
        self._check_options()
        lengths = self._lengths(lengths, len(x), target_allowed=True)
        self._init(x, lengths)
        self._check()
        checked_features(x, self, self.n_features)
        if getattr(self, "_monitor_is_ours", True):
            vars(self).pop("_monitor", None)
        monitor = self.monitor_
        monitor._reset()
        groups = None if kernels.native is None else kernels.planned(lengths)
        for _ in range(self.n_iter):
            white = self._whitening()
            sums = self._expect(x, lengths, groups, white)
            self._maximise(x, lengths, sums, white)
            monitor.report(float(sums.log_likelihood.sum()))
            if monitor.converged:
                break
        self.n_features_in_ = x.shape[1]
        return self

    def _init(self, X: Array, lengths: Any = None) -> None:
        n, d = whole_number(self.n_components, "n_components", 1), X.shape[1]
        if self.covariance_type not in COVARIANCE_TYPES:
            raise EstimatorError(f"covariance_type must be one of {COVARIANCE_TYPES}; got {self.covariance_type!r}")
        draw = random_state(self.random_state)
        if self._needs("s", "startprob_"):
            self.startprob_ = draw.dirichlet(np.full(n, 1.0 / n))
        if self._needs("t", "transmat_"):
            self.transmat_ = draw.dirichlet(np.full(n, 1.0 / n), size=n)
        if self._needs("m", "means_"):
            self.means_ = _centres(X, n, np.random.default_rng(draw.randint(2**31)))
        if self._needs("c", "_covars_", "covars_"):
            pooled = np.cov(X.T, bias=len(X) < 2).reshape(d, d) + self.min_covar * np.eye(d)
            self._covars_ = compressed(np.tile(pooled, (n, 1, 1)), np.full(n, 1.0 / n), self.covariance_type)
        scalars = self._n_parameters(d)
        if X.size < scalars:
            _log.warning("Learning %d free parameters from %d numbers will result in a degenerate solution.", scalars, X.size)

    def _needs(self, code: str, name: str, shown: str = "") -> bool:
        if code in self.init_params:
            if hasattr(self, name) and not hasattr(self, "n_features_in_"):
                _log.warning("%r is set but will be overwritten, because init_params contains %r.", shown or name, code)
            return True
        return not hasattr(self, name)

    def _check(self) -> None:
        if self.covariance_type not in COVARIANCE_TYPES:
            raise EstimatorError(f"covariance_type must be one of {COVARIANCE_TYPES}; got {self.covariance_type!r}")
        n = whole_number(self.n_components, "n_components", 1)
        self.startprob_ = checked_probabilities(self.startprob_, (n,), "startprob_")
        self.transmat_ = checked_probabilities(self.transmat_, (n, n), "transmat_")
        self.means_ = checked_means(self.means_, n)
        width = n_features_of(checked_covariances(self._covars_, self.covariance_type, n), self.covariance_type)
        if width not in (None, self.n_features):
            raise EstimatorError(f"covars_ are of {width} features, and means_ of {self.n_features}")

    def _check_options(self) -> None:
        """What a wrong argument of `__init__` would end in later, in words that do not name it."""
        for name in ("params", "init_params"):
            letters = getattr(self, name)
            if not isinstance(letters, str) or set(letters) - set("stmc"):
                raise EstimatorError(
                    f"{name} is made of the letters s (startprob_), t (transmat_), m (means_) and c (covars_); got {letters!r}"
                )
        for name, allowed in (("algorithm", ("viterbi", "map")), ("implementation", ("log", "scaling"))):
            if getattr(self, name) not in allowed:
                raise EstimatorError(f"{name} must be {allowed[0]!r} or {allowed[1]!r}; got {getattr(self, name)!r}")
        whole_number(self.n_iter, "n_iter", 0)
        if not isinstance(self.min_covar, int | float | np.number) or not 0.0 <= float(self.min_covar) < np.inf:
            raise EstimatorError(f"min_covar must be a variance, 0 or more; got {self.min_covar!r}")

    def _whitening(self) -> Whitening:
        return whitening(self.means_, regularised(self.covars_, self.means_))

    @property
    def _faintest(self) -> float:
        return SCALING_LIMIT if self.implementation == "scaling" else -np.inf

    def _expect(self, x: Array, lengths: np.ndarray, groups: Any, white: Whitening) -> kernels.Sums:
        """The sums that the M-step needs, compiled where that is possible."""
        if kernels.native is None:
            return self._twin(x, lengths, np.ones(len(lengths), dtype=bool), white)[0]
        sums = kernels.e_step(x, groups, self.startprob_, self.transmat_, white.arrays, faintest=self._faintest)
        if not sums.failed.any():
            return sums
        rest, _ = self._twin(x, lengths, sums.failed, white)
        sums.log_likelihood[sums.failed] = rest.log_likelihood
        return sums._replace(
            moments=sums.moments + rest.moments, transitions=sums.transitions + rest.transitions, first=sums.first + rest.first
        )

    def _twin(self, x: Array, lengths: np.ndarray, chosen: np.ndarray, white: Whitening) -> tuple[kernels.Sums, Array]:
        """The same and γ of the chosen sequences (S,), in numpy and in the log domain."""
        rows = np.flatnonzero(np.repeat(chosen, lengths))
        x, lengths = x[rows], lengths[chosen]
        log_b = white.log_density(x)
        if (log_b.max(axis=1) < self._faintest).any():
            frame = int(rows[log_b.max(axis=1).argmin()])
            raise EstimatorError(f"implementation='scaling' cannot represent frame {frame}, which no state explains; use 'log'")
        e = chains.expectations(
            chains.padded(log_b, lengths), lengths, chains.log_of(self.startprob_), chains.log_of(self.transmat_)
        )
        moments, done = moments_about(white.origin, x, e.weights), np.zeros(len(lengths), dtype=bool)
        return kernels.Sums(moments, e.transitions, e.first, e.log_likelihood, done), e.weights

    def _posteriors(self, x: Array, lengths: np.ndarray) -> tuple[Array, Array]:
        """γ (N, K), and the log-likelihood (S,)."""
        white = self._whitening()
        if kernels.native is None:
            sums, weights = self._twin(x, lengths, np.ones(len(lengths), dtype=bool), white)
            return weights, sums.log_likelihood
        weights, found, failed = kernels.posteriors(
            x, kernels.planned(lengths), self.startprob_, self.transmat_, white.arrays, faintest=self._faintest
        )
        if failed.any():
            sums, weights[np.repeat(failed, lengths)] = self._twin(x, lengths, failed, white)
            found[failed] = sums.log_likelihood
        return weights, found

    @np.errstate(under="ignore")
    def _maximise(self, x: Array, lengths: np.ndarray, sums: kernels.Sums, white: Whitening) -> None:
        """Maximum a posteriori: Dirichlet, normal, inverse gamma or Wishart priors, with hmmlearn's parameters."""
        weights = self._posteriors(x, lengths)[0] if "c" in self.params and loses_digits(sums.moments) else None
        occupancy = sums.moments[:, -1, -1]
        if "s" in self.params:
            self.startprob_ = _with_prior(sums.first, self.startprob_prior, self.startprob_)
        if "t" in self.params:
            self.transmat_ = _with_prior(sums.transitions, self.transmat_prior, self.transmat_)
        prior, weight = np.asarray(self.means_prior, dtype=np.float64), self.means_weight
        if "m" in self.params:
            total = weight + occupancy
            summed = sums.moments[:, :-1, -1] + occupancy[:, None] * white.origin
            means = (weight * prior + summed) / np.maximum(total, 1e-300)[:, None]
            self.means_ = np.where(total[:, None] > 1e-10, means, self.means_)
        if "c" in self.params:
            if weights is None:
                scatter = scatter_of_moments(sums.moments, self.means_ - white.origin)
            else:
                scatter = scatter_of_frames(x, weights, self.means_)
            apart = self.means_ - prior
            scatter += weight * apart[:, :, None] * apart[:, None, :]
            self._covars_ = self._most_likely_covariances(scatter, occupancy)

    def _most_likely_covariances(self, scatter: Array, occupancy: Array) -> Array:
        d = scatter.shape[1]
        prior = np.asarray(self.covars_prior, dtype=np.float64)
        if self.covariance_type in ("spherical", "diag"):
            total = max(self.covars_weight - 1, 0) + occupancy
            if prior.ndim == 1 and self.covariance_type == "spherical":
                prior = prior[:, None]
            variances = (prior + np.einsum("kii->ki", scatter)) / np.maximum(total, 1e-5)[:, None]
            return variances.mean(axis=1) if self.covariance_type == "spherical" else variances
        if prior.ndim < 2:
            prior = prior.reshape(-1, 1, 1) * np.eye(d) if prior.ndim else prior * np.eye(d)
        more = max(self.covars_weight - d, 0)
        if self.covariance_type == "tied":
            return (prior + scatter.sum(axis=0)) / (more + occupancy.sum())
        total = (more + occupancy)[:, None, None]
        return np.where(total > 1e-10, (prior + scatter) / np.maximum(total, 1e-10), self._covars_)

    # Using

    def score_samples(self, X: Any, lengths: Any = None) -> tuple[float, Array]:
        """Log-likelihood of all of X, and posteriors (n_samples, K)."""
        weights, found = self._posteriors(*self._ready(X, lengths))
        return float(found.sum()), weights

    def score(self, X: Any, lengths: Any = None) -> float:
        """Log-likelihood of all of X. A target y in place of `lengths` is ignored, as in `fit`."""
        x, lengths = self._ready(X, lengths, target_allowed=True)
        white = self._whitening()
        if kernels.native is None:
            return float(self._twin(x, lengths, np.ones(len(lengths), dtype=bool), white)[0].log_likelihood.sum())
        found, failed = kernels.likelihoods(
            x, kernels.planned(lengths), self.startprob_, self.transmat_, white.arrays, faintest=self._faintest
        )
        if failed.any():
            found[failed] = self._twin(x, lengths, failed, white)[0].log_likelihood
        return float(found.sum())

    def predict_proba(self, X: Any, lengths: Any = None) -> Array:
        """Posteriors (n_samples, K)."""
        return self.score_samples(X, lengths)[1]

    def decode(self, X: Any, lengths: Any = None, algorithm: str | None = None) -> tuple[float, np.ndarray]:
        """log p(X, states), and the states: "viterbi" the best path, "map" the best state each time.

        States that are best one by one may form a path that no transition allows; its log-probability is −inf.
        """
        x, lengths = self._ready(X, lengths)
        algorithm = algorithm or self.algorithm
        if algorithm == "map":
            states = self._posteriors(x, lengths)[0].argmax(axis=1)
            return self._log_probability(x, lengths, states), states
        if algorithm != "viterbi":
            raise EstimatorError(f"algorithm must be 'viterbi' or 'map'; got {algorithm!r}")
        log_initial, log_transition, white = chains.log_of(self.startprob_), chains.log_of(self.transmat_), self._whitening()
        if kernels.native is not None:
            states, scores = kernels.decode(x, lengths, log_initial, log_transition, white.arrays)
            return float(scores.sum()), states
        parts = np.split(white.log_density(x), np.cumsum(lengths)[:-1])
        paths = [chains.best_path(part, log_initial, log_transition) for part in parts]
        return sum(score for _, score in paths), np.concatenate([path for path, _ in paths])

    def _log_probability(self, x: Array, lengths: np.ndarray, states: np.ndarray) -> float:
        """log p(X, states) of paths (N,) one after another."""
        with np.errstate(divide="ignore"):
            steps = np.log(self.transmat_[states[:-1], states[1:]])
            first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
            steps[first[1:] - 1] = 0.0  # from one sequence to the next there is no transition
            log_b = self._whitening().log_density(x)[np.arange(len(x)), states]
            return float(np.log(self.startprob_[states[first]]).sum() + steps.sum() + log_b.sum())

    def predict(self, X: Any, lengths: Any = None) -> np.ndarray:
        """The best states (n_samples,)."""
        return self.decode(X, lengths)[1]

    def sample(self, n_samples: int = 1, random_state: Any = None, currstate: int | None = None) -> tuple[Array, Any]:
        """Draws X (n_samples, D) and states; `currstate` is the state of the first sample."""
        self._require_fit()
        self._check()
        n_samples = whole_number(n_samples, "n_samples", 0)
        if currstate is not None and whole_number(currstate, "currstate", 0) >= self.n_components:
            raise EstimatorError(f"currstate must be a state from 0 to {self.n_components - 1}; got {currstate!r}")
        draw = _random_state(self.random_state if random_state is None else random_state)
        states = np.empty(n_samples, dtype=int)
        row = np.cumsum(self.startprob_)
        for t in range(n_samples):
            if t == 0 and currstate is not None:
                states[0] = currstate
            else:
                states[t] = np.searchsorted(row, draw.random_sample() * row[-1], side="right")
            row = np.cumsum(self.transmat_[states[t]])
        factors = np.linalg.cholesky(regularised(self.covars_, self.means_))
        noise = draw.standard_normal((n_samples, self.means_.shape[1]))
        return self.means_[states] + np.einsum("nij,nj->ni", factors[states], noise), states

    def aic(self, X: Any, lengths: Any = None) -> float:
        """Akaike's criterion: smaller is better."""
        return -2.0 * self.score(X, lengths) + 2.0 * self._n_parameters(self.n_features)

    def bic(self, X: Any, lengths: Any = None) -> float:
        """Bayes' criterion: smaller is better."""
        return -2.0 * self.score(X, lengths) + self._n_parameters(self.n_features) * float(np.log(len(X)))

    def get_stationary_distribution(self) -> Array:
        """(K,) weights that the chain's transitions leave as they are."""
        self._require_fit()
        n = self.n_components
        equations = np.vstack([np.asarray(self.transmat_).T - np.eye(n), np.ones(n)])
        return np.linalg.lstsq(equations, np.append(np.zeros(n), 1.0), rcond=None)[0]

    # Checks

    def _n_parameters(self, d: int) -> int:
        n = self.n_components
        covariances = {"spherical": n, "diag": n * d, "full": n * d * (d + 1) // 2, "tied": d * (d + 1) // 2}
        count = {"s": n - 1, "t": n * (n - 1), "m": n * d, "c": covariances[self.covariance_type]}
        return sum(count[p] for p in self.params)

    def _require_fit(self) -> None:
        if not self.__sklearn_is_fitted__():
            raise not_fitted(self)

    def _ready(self, X: Any, lengths: Any, target_allowed: bool = False) -> tuple[Array, np.ndarray]:
        self._require_fit()
        self._check()
        x = checked_features(checked_samples(X, self), self, self.means_.shape[1])
        return x, self._lengths(lengths, len(x), target_allowed)

    def _lengths(self, lengths: Any, n_samples: int, target_allowed: bool = False) -> np.ndarray:
        if lengths is None:
            return np.array([n_samples])
        given = np.atleast_1d(lengths)  # hmmlearn takes one number, too
        if given.ndim == 1 and given.dtype.kind in "iu" and len(given) and (given > 0).all() and given.sum() == n_samples:
            return given.astype(np.intp)
        if target_allowed and len(given) == n_samples:
            return np.array([n_samples])
        raise EstimatorError(f"lengths must be whole numbers above 0 that sum to {n_samples} samples; got {lengths!r}")


_random_state = random_state  # `sample` has an argument of that name


def _centres(x: Array, n: int, rng: np.random.Generator) -> Array:
    """k-means centres (n, D): the tightest of several starts. Of very many frames some are enough, drawn at random."""
    if len(x) > K_MEANS_FRAMES:
        x = x[rng.choice(len(x), K_MEANS_FRAMES, replace=False)]
    best, least = x[:1].repeat(n, axis=0), np.inf
    for _ in range(K_MEANS_STARTS if len(x) > n else 1):
        labels = k_means(x, n, rng)
        centres = np.array([x[labels == i].mean(axis=0) if (labels == i).any() else x[i % len(x)] for i in range(n)])
        spread = ((x - centres[labels]) ** 2).sum()
        if spread < least:
            best, least = centres, spread
    return best


def _with_prior(counts: Array, prior: Any, before: Array) -> Array:
    """Rows ∝ counts + prior − 1; what was 0 stays 0, and a row with nothing keeps what it had."""
    rows = np.where(before == 0.0, 0.0, np.maximum(np.asarray(prior) - 1.0 + counts, 0.0))
    total = rows.sum(axis=-1, keepdims=True)
    return np.where(total > 0.0, rows / np.where(total > 0.0, total, 1.0), before)
