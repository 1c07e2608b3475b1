"""Gaussian mixture regression: any channels from any others, chosen by name when it is called.

Eq. (5) is velocity from (position, force); eq. (6) is position from (force, velocity); both are `Regression`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from ..kernels.copies import Copied
from ..recording import expand
from .filtering import ForwardFilter
from .gaussian import log_density, marginal, shares
from .gmm import Gmm
from .hmm import Hmm

LEAST_EIGENVALUE = 1e-12  # of the inputs' correlation: below it an input repeats others and a gain would be rounding


DEAD = 1e-13  # standard deviation over distance from zero: an input that varies less has only rounding to say


class Conditional(NamedTuple):
    """mean (..., Do) and covariance (..., Do, Do) of the outputs given the inputs."""

    mean: Array
    covariance: Array


class Lines(NamedTuple):
    """One regression line a state: y_i(x) = gains[i] @ x + offsets[i], with covariances[i] around it."""

    gains: Array
    offsets: Array
    covariances: Array


def conditional_lines(
    means: Array, covariances: Array, inputs: np.ndarray, outputs: np.ndarray, *, input_noise: Array | None = None
) -> Lines:
    """p(outputs | inputs) of K Gaussians, from means (K, D) and covariances (K, D, D), by column indices."""
    i, o = inputs, outputs
    sigma_ii = covariances[:, i[:, None], i[None, :]]
    if input_noise is not None:
        sigma_ii = sigma_ii + np.diag(input_noise)
    sigma_io = covariances[:, i[:, None], o[None, :]]
    dead = np.einsum("kii->ki", sigma_ii) <= (DEAD * means[:, i]) ** 2
    if dead.any():  # a locked axis: it says nothing, and what stands in for its covariances is rounding
        sigma_ii, sigma_io = _without(sigma_ii, dead), np.where(dead[:, :, None], 0.0, sigma_io)
    sigma_oo = covariances[:, o[:, None], o[None, :]]
    gains = np.ascontiguousarray(np.swapaxes(_solve(sigma_ii, sigma_io), 1, 2))
    offsets = means[:, o] - np.einsum("koi,ki->ko", gains, means[:, i])
    spread = sigma_oo - gains @ sigma_io
    return Lines(gains, offsets, 0.5 * (spread + np.swapaxes(spread, 1, 2)))


class Regression(Copied):
    """One split of a model's channels into inputs and outputs, prepared so that a tick costs two small products.

    Per state i, the regression is a line: y_i(x) = gains[i] @ x + offsets[i], with covariances[i] around it.

    gains        (K, Do, Di)  Σ_i^{OI} (Σ_i^{II})⁻¹
    offsets      (K, Do)      μ_i^O − gains_i μ_i^I
    covariances  (K, Do, Do)  Σ_i^{OO} − gains_i Σ_i^{IO}
    inputs, outputs           scalar channel names, in the order of x and y
    input_index, output_index their columns in the model

    Far from the demonstrations a line goes on for ever: bound what you do with it.
    """

    ANEW = ("_mean",)

    def __init__(
        self,
        model: Hmm | Gmm,
        inputs: str | Iterable[str],
        outputs: str | Iterable[str],
        *,
        input_noise: Mapping[str, float] | None = None,
    ) -> None:
        """`input_noise`: variance to add to inputs by name [unit²]: what the sensor adds on line, or doubt in it."""
        self.model = model
        self.inputs = expand(inputs, model.channels)
        self.outputs = expand(outputs, model.channels)
        both = sorted(set(self.inputs) & set(self.outputs))
        if both:
            raise ChannelError(f"{', '.join(both)} cannot be input and output at once")
        self.input_index = _columns(self.inputs, model.channels)
        self.output_index = _columns(self.outputs, model.channels)
        i, o = self.input_index, self.output_index
        self._noise = _noise(input_noise, self.inputs)
        lines = conditional_lines(model.means, model.covariances, i, o, input_noise=self._noise)
        self.gains, self.offsets, self.covariances = lines
        self._input_means, self._input_covariances = marginal(model.means, model.covariances, i)
        self._input_covariances = self._input_covariances + np.diag(self._noise)
        self._flat_gains = np.ascontiguousarray(self.gains.reshape(self.offsets.size, len(i)))
        self._flat_offsets = self.offsets.reshape(-1).copy()
        self._lines = np.empty_like(self._flat_offsets)
        self._lines_by_state = self._lines.reshape(self.offsets.shape)
        self._link()

    def _link(self) -> None:
        self._mean = None
        if kernels.native is not None and len(self.inputs):
            self._mean = kernels.native.Lines(self._flat_gains, self._flat_offsets, *self.gains.shape).mean

    def __repr__(self) -> str:
        return f"Regression({', '.join(self.inputs)} -> {', '.join(self.outputs)}, {len(self.gains)} states)"

    def without(self, missing: np.ndarray) -> Regression:
        """The same outputs from the inputs that are not `missing` (Di,): the others are integrated out."""
        present = [name for name, gone in zip(self.inputs, missing, strict=True) if not gone]
        noise = {name: float(self._noise[i]) for i, name in enumerate(self.inputs) if not missing[i]}
        return Regression(self.model, present, self.outputs, input_noise=noise)

    def mean(self, weights: Array, x: Array, out: Array | None = None) -> Array:
        """Σ_i h_i y_i(x) as (Do,), for the tick: weights (K,), x (Di,); written into `out` when given."""
        if self._mean is not None:
            found = np.empty(len(self.outputs)) if out is None else out
            if self._mean(weights, x, found):
                return found
        np.dot(self._flat_gains, x, out=self._lines)
        self._lines += self._flat_offsets
        return np.dot(weights, self._lines_by_state, out=out)

    def means_per_state(self, x: Array) -> Array:
        """y_i(x) of every state, (..., K, Do), for x (..., Di)."""
        return np.einsum("koi,...i->...ko", self.gains, x) + self.offsets

    def predict(self, weights: Array, x: Array) -> Conditional:
        """Mean (Do,) and covariance (Do, Do) for weights (K,) that sum to 1 and x (Di,). Works on stacks of both, too.

        The covariance is the law of total variance: what the states leave open, plus how much they disagree.
        """
        weights = np.asarray(weights, dtype=np.float64)
        lines = self.means_per_state(np.asarray(x, dtype=np.float64))
        mean = np.einsum("...k,...ko->...o", weights, lines)
        apart = lines - mean[..., None, :]
        covariance = np.einsum("...k,kop->...op", weights, self.covariances)
        covariance += np.einsum("...k,...ko,...kp->...op", weights, apart, apart)
        return Conditional(mean, covariance)

    def log_density(self, x: Array) -> Array:
        """log N(x; μ_i^I, Σ_i^{II}) of the inputs alone, (N, K) for x (N, Di); `input_noise` included."""
        return log_density(x, self._input_means, self._input_covariances)

    def shares(self, x: Array, log_weights: Array | float = 0.0) -> Array:
        """h_i ∝ w_i N(x; μ_i^I, Σ_i^{II}), eq. (7) with priors, (N, K) for x (N, Di)."""
        return shares(x, self._input_means, self._input_covariances, log_weights)


def regress(
    model: Hmm | Gmm,
    inputs: str | Iterable[str],
    outputs: str | Iterable[str],
    x: Any,
    *,
    weights: str | Array = "mixture",
    input_noise: Mapping[str, float] | None = None,
) -> Conditional:
    """Outputs (N, Do) from inputs x (N, Di), with covariances (N, Do, Do).

    weights  "mixture"              h_i ∝ N(x; μ_i, Σ_i), eq. (7): the paper's, without priors
             "mixture-with-priors"  h_i ∝ π_i N(x; μ_i, Σ_i), the conditional of a Gmm
             "forward"              eq. (4) over x as one sequence in time, for an Hmm: the rows' order matters
             an array (N, K)        your own, rows that sum to 1

    NaN in x is an input that is missing: that row is regressed from the others, and with none it is the states' own means.
    """
    regression = Regression(model, inputs, outputs, input_noise=input_noise)
    frames = np.asarray(x, dtype=np.float64)
    if frames.ndim != 2 or frames.shape[1] != len(regression.inputs):
        raise ChannelError(f"inputs {regression.inputs} want x (N, {len(regression.inputs)}); got {frames.shape}")
    h = _weights(regression, frames, weights)
    missing = np.isnan(frames)
    if not missing.any():
        return regression.predict(h, frames)
    found = Conditional(np.empty((len(frames), len(regression.outputs))), np.empty((len(frames), *[len(regression.outputs)] * 2)))
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for p, pattern in enumerate(patterns):
        rows = which.reshape(-1) == p
        part = regression.without(pattern).predict(h[rows], frames[rows][:, ~pattern])
        found.mean[rows], found.covariance[rows] = part
    return found


def _weights(regression: Regression, x: Array, weights: str | Array) -> Array:
    model = regression.model
    if not isinstance(weights, str):
        h = np.asarray(weights, dtype=np.float64)
        if h.shape != (len(x), model.n_states):
            raise ParameterError(f"weights must be ({len(x)}, {model.n_states}); got {h.shape}")
        return h
    if weights == "mixture":
        return regression.shares(x)
    if weights == "mixture-with-priors" and isinstance(model, Gmm):
        return regression.shares(x, np.log(np.maximum(model.weights, 1e-300)))
    if weights == "forward" and isinstance(model, Hmm):
        forward = ForwardFilter(model, channels=regression.inputs)
        return np.array([forward.step(row).copy() for row in x]).reshape(len(x), model.n_states)
    raise ParameterError(
        f"weights={weights!r} does not fit {type(model).__name__}; allowed: 'mixture', an array (N, K), "
        "'mixture-with-priors' for a Gmm, 'forward' for an Hmm"
    )


def _columns(names: tuple[str, ...], channels: tuple[str, ...]) -> np.ndarray:
    return np.array([channels.index(n) for n in names], dtype=np.intp)


def _noise(noise: Mapping[str, float] | None, inputs: tuple[str, ...]) -> Array:
    variances = np.zeros(len(inputs))
    for name, variance in (noise or {}).items():
        if not (np.isfinite(variance) and variance >= 0.0):
            raise ParameterError(f"input_noise of {name} must be a variance, 0 or more; got {variance!r}")
        for column in expand(name, inputs):
            variances[inputs.index(column)] = variance
    return variances


def _without(sigma_ii: Array, dead: np.ndarray) -> Array:
    """Input blocks (K, Di, Di) in which `dead` (K, Di) inputs are of variance 1 and alone."""
    alone = np.where(dead[:, :, None] | dead[:, None, :], 0.0, sigma_ii)
    return np.where(dead[:, :, None] & np.eye(dead.shape[1], dtype=bool), 1.0, alone)


def _solve(sigma_ii: Array, sigma_io: Array) -> Array:
    """(Σ^{II})⁻¹ Σ^{IO} per state. A singular input block gets floored eigenvalues, so that the gains stay finite."""
    size = np.sqrt(np.einsum("kii->ki", sigma_ii))
    size = np.where(size > 0.0, size, 1.0)
    correlation = sigma_ii / (size[:, :, None] * size[:, None, :])  # without units, so that one floor serves all
    values, vectors = np.linalg.eigh(correlation)
    values = np.maximum(values, LEAST_EIGENVALUE * values[:, -1:])
    inverse = (vectors / values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return (inverse @ (sigma_io / size[:, :, None])) / size[:, :, None]
