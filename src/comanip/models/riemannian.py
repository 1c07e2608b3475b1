"""Gaussians on R^n x S^3: positions, forces and velocities beside orientations (Zeestraten et al., 2017).

A point holds numbers and unit quaternions, channels of four called `NAME.w, NAME.x, NAME.y, NAME.z`. A Gaussian has its mean
among the points and its covariance in the tangent space there, where a quaternion is a rotation vector [rad] in the mean's own
axes (`signals.sphere`):

    log p(x) = log N(Log_mu(x); 0, Sigma)

Without quaternions all of it is the Euclidean Gaussian to the last digit that matters; with them a state is meant to be narrow
against half a turn, as a state of a task is: the density is not corrected for the curvature of the sphere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from ..recording import expand
from ..signals import sphere
from .gaussian import LEAST_LOG_DENSITY, LOG_2PI, States, channel_names, cholesky, log_sum_exp, normalised, probabilities

CLOSE = 1e-10  # [m, rad, ...] a regression that moves less has settled
UNIT = 1e-6  # a quaternion of a model may be so far from length 1: written with 7 digits it still passes


@dataclass(frozen=True)
class Space:
    """Which channels of a point are numbers and which are quaternions, in their order.

    channels   (P,) of a point; four that end in .w, .x, .y, .z are a quaternion
    tangent    (D,) of a tangent vector: a quaternion has three there, `NAME.rx, NAME.ry, NAME.rz` [rad]
    lines      columns of the numbers in points and in tangent vectors
    turns      columns of each quaternion, in the same two
    """

    channels: tuple[str, ...]
    tangent: tuple[str, ...] = field(init=False)
    lines: tuple[np.ndarray, np.ndarray] = field(init=False, repr=False, compare=False)
    turns: tuple[tuple[slice, slice], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        channels = channel_names(self.channels)
        tangent: list[str] = []
        lines: list[tuple[int, int]] = []
        turns: list[tuple[slice, slice]] = []
        at = 0
        while at < len(channels):
            stem = channels[at].removesuffix(".w")
            if channels[at : at + 4] == tuple(f"{stem}.{c}" for c in "wxyz"):
                turns.append((slice(at, at + 4), slice(len(tangent), len(tangent) + 3)))
                tangent += [f"{stem}.r{c}" for c in "xyz"]
                at += 4
            elif channels[at].endswith(".w"):
                listed = ", ".join(f"{stem}.{c}" for c in "wxyz")
                raise ChannelError(f"channel {channels[at]!r} begins a quaternion; it needs {listed}, side by side")
            else:
                lines.append((at, len(tangent)))
                tangent.append(channels[at])
                at += 1
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "tangent", tuple(tangent))
        index = np.array(lines, dtype=np.intp).reshape(-1, 2)
        object.__setattr__(self, "lines", (index[:, 0], index[:, 1]))
        object.__setattr__(self, "turns", tuple(turns))

    @property
    def n_tangent(self) -> int:
        """D"""
        return len(self.tangent)

    @property
    def quaternions(self) -> tuple[str, ...]:
        """Names of the quaternions, "orientation"."""
        return tuple(self.channels[at.start][: -len(".w")] for at, _ in self.turns)

    def log(self, base: Array, x: Array) -> Array:
        """Tangent vectors (..., D) at `base` (..., P) to points x (..., P)."""
        base, x = np.broadcast_arrays(np.asarray(base, dtype=np.float64), np.asarray(x, dtype=np.float64))
        out = np.empty((*x.shape[:-1], self.n_tangent))
        points, tangents = self.lines
        out[..., tangents] = x[..., points] - base[..., points]
        for point, tangent in self.turns:
            out[..., tangent] = sphere.log(base[..., point], x[..., point])
        return out

    def exp(self, base: Array, step: Array) -> Array:
        """Points (..., P) that tangent vectors (..., D) at `base` (..., P) lead to."""
        base, step = np.asarray(base, dtype=np.float64), np.asarray(step, dtype=np.float64)
        out = np.empty((*np.broadcast_shapes(base.shape[:-1], step.shape[:-1]), len(self.channels)))
        points, tangents = self.lines
        out[..., points] = base[..., points] + step[..., tangents]
        for point, tangent in self.turns:
            out[..., point] = sphere.exp(base[..., point], step[..., tangent])
        return out

    def transport(self, start: Array, end: Array) -> Array:
        """Matrices (..., D, D) that carry tangent vectors from `start` to `end`, points (..., P)."""
        return self.along(self.log(start, end))

    def along(self, step: Array) -> Array:
        """The same for the way that a tangent vector (..., D) stands for."""
        out = np.zeros((*step.shape[:-1], self.n_tangent, self.n_tangent))
        _, tangents = self.lines
        out[..., tangents, tangents] = 1.0
        for _, tangent in self.turns:
            out[..., tangent, tangent] = sphere.carrying(step[..., tangent])
        return out

    def mean(self, x: Array, weights: Array, start: Array | None = None) -> Array:
        """The point (P,) with the smallest weighted sum of squared distances to points x (N, P), from `start` on."""
        out = np.empty(len(self.channels))
        points, _ = self.lines
        share = weights / weights.sum()
        out[points] = share @ x[:, points]
        for point, _ in self.turns:
            out[point] = sphere.mean(x[:, point], share, None if start is None else start[point])
        return out

    def part(self, names: str | Iterable[str]) -> Part:
        """The channels chosen by name, "orientation" for a whole quaternion; in this space's order."""
        chosen = set(expand(names, self.channels))
        for name in self.quaternions:
            if 0 < sum(f"{name}.{c}" in chosen for c in "wxyz") < 4:
                raise ChannelError(f"{name!r} is one quaternion; choose it whole")
        kept = tuple(c for c in self.channels if c in chosen)
        space = Space(kept)
        points = np.array([self.channels.index(c) for c in kept], dtype=np.intp)
        tangents = np.array([self.tangent.index(c) for c in space.tangent], dtype=np.intp)
        return Part(space, points, tangents)

    def checked(self, x: Any, where: str = "points", *, missing: bool = True) -> Array:
        """Points (N, P), quaternions of length 1; NaN is `missing` where that is allowed. Raises ChannelError with the frame."""
        points = np.asarray(x, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != len(self.channels):
            raise ChannelError(f"{where} must be (N, {len(self.channels)}) for channels {self.channels}; got {points.shape}")
        bad = np.isinf(points) if missing else ~np.isfinite(points)
        if bad.any():
            frame, column = np.argwhere(bad)[0].tolist()
            raise ChannelError(f"{where}, frame {frame}: {self.channels[column]} is {points[frame, column]}; allowed: finite")
        for name, (point, _) in zip(self.quaternions, self.turns, strict=True):
            off = np.abs((points[:, point] ** 2).sum(axis=1) - 1.0) > 2.0 * UNIT
            if off.any():
                frame = int(np.flatnonzero(off)[0])
                length = float(np.sqrt((points[frame, point] ** 2).sum()))
                raise ChannelError(f"{where}, frame {frame}: {name} has length {length:.6g}; allowed: 1 (normalise it)")
        return points


class Part(NamedTuple):
    """Some channels of a space: as a space, and their columns in points and in tangent vectors."""

    space: Space
    points: np.ndarray
    tangents: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class RiemannianGmm(States):
    """K weighted Gaussians: weights (K,), means (K, P), covariances (K, D, D) at the means, channels (P,)."""

    weights: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]
    space: Space = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._stored(**_gaussians(self))
        self._stored(weights=probabilities(self.weights, (self.n_states,), "weights"))


@dataclass(frozen=True, eq=False, repr=False)
class RiemannianHmm(States):
    """K states: initial (K,), transition (K, K) rows sum to 1, means (K, P), covariances (K, D, D), channels (P,)."""

    initial: Array
    transition: Array
    means: Array
    covariances: Array
    channels: tuple[str, ...]
    space: Space = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._stored(**_gaussians(self))
        n = self.n_states
        self._stored(
            initial=probabilities(self.initial, (n,), "initial"), transition=probabilities(self.transition, (n, n), "transition")
        )


def _gaussians(model: RiemannianGmm | RiemannianHmm) -> dict[str, Any]:
    """Space, channels, means and covariances, checked."""
    space = Space(model.channels)
    means = space.checked(model.means, "means", missing=False).copy()
    covariances = np.array(model.covariances, dtype=np.float64)
    k, d = len(means), space.n_tangent
    if k < 1 or covariances.shape != (k, d, d) or not np.isfinite(covariances).all():
        raise ParameterError(
            f"{k} means of {len(space.channels)} channels ({d} in the tangent space) need finite covariances ({k}, {d}, {d}); "
            f"got {covariances.shape}"
        )
    cholesky(covariances)
    for array in (means, covariances):
        array.setflags(write=False)
    return {"space": space, "channels": space.channels, "means": means, "covariances": covariances}


def log_density(space: Space, x: Array, means: Array, covariances: Array) -> Array:
    """log N(Log_mu_i(x_n); 0, Sigma_i), (N, K), of points x (N, P). What is NaN is integrated out, a quaternion as a whole."""
    tangents = space.log(means[None, :, :], np.asarray(x, dtype=np.float64)[:, None, :])
    missing = np.isnan(tangents).any(axis=1)  # (N, D)
    if not missing.any():
        return _density(tangents, covariances)
    out = np.zeros(tangents.shape[:2])
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for p, pattern in enumerate(patterns):
        rows, kept = which.reshape(-1) == p, np.flatnonzero(~pattern)
        if len(kept):
            out[rows] = _density(tangents[rows][:, :, kept], covariances[:, kept[:, None], kept])
    return out


def _density(tangents: Array, covariances: Array) -> Array:
    factors = cholesky(covariances)
    z = np.linalg.solve(factors, np.moveaxis(tangents, 0, -1))  # (K, D, N)
    log_det = 2.0 * np.log(np.einsum("kii->ki", factors)).sum(axis=1)
    peak = -0.5 * (covariances.shape[1] * LOG_2PI + log_det)
    return np.maximum((peak[:, None] - 0.5 * (z * z).sum(axis=1)).T, LEAST_LOG_DENSITY)


def log_likelihood(model: RiemannianGmm, x: Any) -> Array:
    """log p(x_n), (N,), for points x (N, P)."""
    frames = model.space.checked(x)
    return log_sum_exp(log_density(model.space, frames, model.means, model.covariances) + _log(model.weights))


def responsibilities(model: RiemannianGmm, x: Any) -> Array:
    """p(state i | x_n), (N, K), for points x (N, P)."""
    frames = model.space.checked(x)
    return normalised(log_density(model.space, frames, model.means, model.covariances) + _log(model.weights))


def _log(probability: Array) -> Array:
    return np.log(np.maximum(probability, 1e-300))


class RiemannianConditional(NamedTuple):
    """mean (P_o,) among the outputs' points, covariance (D_o, D_o) in the tangent space there."""

    mean: Array
    covariance: Array


class RiemannianRegression:
    """Any channels from any others (Zeestraten et al. 2017, eqs. 12-15): a mean on the manifold, found in tangent spaces.

    Per state, with its covariance carried to (x, y) and cut into blocks,

        step_i(y) = Log_y(mu_i^O) - S_i^OI (S_i^II)^-1 Log_x(mu_i^I)        y <- Exp_y(sum_i h_i step_i)

    again and again until y stays. The covariance is the law of total variance in the tangent space at y.
    """

    def __init__(self, model: RiemannianGmm | RiemannianHmm, inputs: str | Iterable[str], outputs: str | Iterable[str]) -> None:
        self.model = model
        self.inputs, self.outputs = model.space.part(inputs), model.space.part(outputs)
        both = sorted(set(self.inputs.space.channels) & set(self.outputs.space.channels))
        if both:
            raise ChannelError(f"{', '.join(both)} cannot be input and output at once")
        i, o = self.inputs.tangents, self.outputs.tangents
        sigma = model.covariances
        self._mean_in, self._mean_out = model.means[:, self.inputs.points], model.means[:, self.outputs.points]
        self._in = sigma[:, i[:, None], i]
        # carrying turns S^II by a rotation, whose inverse undoes it: the gain is solved for once, at the state's own mean
        self._gain = np.swapaxes(np.linalg.solve(self._in, sigma[:, i[:, None], o]), 1, 2)
        self._left = sigma[:, o[:, None], o] - self._gain @ sigma[:, i[:, None], o]
        self._factor = np.linalg.inv(cholesky(self._in))
        self._peak = np.log(np.einsum("kii->ki", self._factor)).sum(axis=1)

    def shares(self, x: Array, log_weights: Array | float = 0.0) -> Array:
        """h_i ~ w_i N(x; state i's inputs), (K,), for one x (P_i,)."""
        return np.asarray(normalised(self._log_density(self._away(x)) + log_weights))

    def _away(self, x: Array) -> Array:
        """(K, D_i) where x is, seen from every state."""
        return self.inputs.space.log(self._mean_in, x)

    def _log_density(self, away: Array) -> Array:
        z = np.einsum("kij,kj->ki", self._factor, away)
        return np.asarray(self._peak - 0.5 * (z * z).sum(axis=1))

    def predict(self, weights: Array, x: Array, *, start: Array | None = None, most: int = 20) -> RiemannianConditional:
        """For weights (K,) that sum to 1 and one point x (P_i,); `start` (P_o,): the last tick's answer saves passes."""
        space = self.outputs.space
        # Log_x(mu^I) is minus Log_mu(x), carried: at the state's mean the line reads mu^O + gain @ Log_mu(x)
        pulled = np.einsum("koi,ki->ko", self._gain, self._away(np.asarray(x, dtype=np.float64)))
        y = self._mean_out[int(np.argmax(weights))] if start is None else np.asarray(start, dtype=np.float64)
        for _ in range(most):
            apart, carried = self._seen_from(y, pulled)
            step = weights @ apart
            if step @ step < CLOSE**2:
                break
            y = space.exp(y, step)
        covariance = np.einsum("k,kop->op", weights, carried @ self._left @ np.swapaxes(carried, 1, 2))
        covariance += np.einsum("k,ko,kp->op", weights, apart, apart)
        return RiemannianConditional(y, covariance)

    def _seen_from(self, y: Array, pulled: Array) -> tuple[Array, Array]:
        """(K, D_o) from y to what each state says, and the matrices that carry a state's tangent vectors there."""
        space = self.outputs.space
        there = space.log(self._mean_out, y)
        carried = space.along(there)
        # the way back is the way there turned round, in axes that have turned along with it: minus the same three numbers
        return np.matmul(carried, pulled[:, :, None])[:, :, 0] - there, carried


def regress(
    model: RiemannianGmm | RiemannianHmm, inputs: str | Iterable[str], outputs: str | Iterable[str], x: Any
) -> RiemannianConditional:
    """Outputs (N, P_o) from inputs x (N, P_i), with covariances (N, D_o, D_o); h_i as in eq. (7), with priors for a Gmm."""
    regression = RiemannianRegression(model, inputs, outputs)
    frames = regression.inputs.space.checked(x, "inputs", missing=False)
    prior = _log(model.weights) if isinstance(model, RiemannianGmm) else 0.0
    found = [regression.predict(regression.shares(row, prior), row) for row in frames]
    return RiemannianConditional(np.array([f.mean for f in found]), np.array([f.covariance for f in found]))


class RiemannianFilter:
    """Eq. (4) tick by tick: which state is it now? Options as in `models.filtering.StateFilter`.

    channels   which are evidence; the others are integrated out, and so is what is NaN at a tick
    """

    def __init__(
        self,
        model: RiemannianHmm,
        channels: str | Sequence[str] | None = None,
        *,
        transition_floor: float = 1e-6,
        gate: float = 20.0,
    ) -> None:
        if not (0.0 < transition_floor <= 1.0 and gate > 0.0):
            raise ParameterError(f"transition_floor {transition_floor:g}, gate {gate:g}; allowed: 0 < floor <= 1, gate > 0 nats")
        self.model, self.gate = model, gate
        part = model.space.part(model.channels if channels is None else channels)
        self.space, self.channels = part.space, part.space.channels
        self._means = model.means[:, part.points]
        self._covariances = model.covariances[:, part.tangents[:, None], part.tangents]
        self._factor = np.linalg.inv(cholesky(self._covariances))
        self._peak = np.log(np.einsum("kii->ki", self._factor)).sum(axis=1) - 0.5 * self.space.n_tangent * LOG_2PI
        k = model.n_states
        self._initial = (1.0 - transition_floor) * model.initial + transition_floor / k
        self._transition = (1.0 - transition_floor) * model.transition + transition_floor / k
        self.reset()

    def reset(self) -> None:
        """Forgets everything: the next step is the first."""
        self.weights: Array = self._initial.copy()
        self._fresh = True

    def step(self, xi: Array) -> Array:
        """Weights (K,) after the point xi (P,); never NaN, whatever xi is."""
        predicted = self.weights if self._fresh else self.weights @ self._transition
        self._fresh = False
        log_b = self._evidence(np.asarray(xi, dtype=np.float64))
        best = float(log_b.max())
        h = np.log(np.maximum(predicted, 1e-300)) + np.maximum(log_b, best - self.gate)
        self.weights = normalised(h)
        return self.weights

    def _evidence(self, xi: Array) -> Array:
        xi = np.where(np.abs(xi) < 1e100, xi, np.nan)  # farther out is no measurement
        away = self.space.log(self._means, xi)
        if np.isnan(away).any():
            return log_density(self.space, xi[None], self._means, self._covariances)[0]
        z = np.einsum("kij,kj->ki", self._factor, away)
        return np.asarray(self._peak - 0.5 * (z * z).sum(axis=1))
