"""Expectation-maximisation of Gaussians on R^n x S^3: the E-step as ever, the M-step in tangent spaces.

The centre of a state is its iterated tangent average, its covariance that of the frames in the tangent space there. On a curved
space this average need not be the most likely centre when a state is wide; the step towards it is then halved until the
likelihood rises, so that it never falls (generalised EM).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..errors import ChannelError, ParameterError, TrainingError
from ..interfaces import Array
from ..models import chains
from ..models.gaussian import cholesky, floored, log_sum_exp, normalised
from ..models.riemannian import RiemannianGmm, RiemannianHmm, Space, log_density
from .baum_welch import allowed_transitions, check_options, from_counts, most_likely_rows
from .climb import UNVISITED, Fit, climb, fit_of
from .coordinates import Coordinates, Notes

HALVINGS = 12  # of a step towards the tangent average; then the centre stays
SAME = 1e-9  # a spread below this share of a channel's distance from zero is rounding


class _Gaussians(NamedTuple):
    weights: Array  # (K,) of a mixture; not used by a chain
    initial: Array
    transition: Array
    means: Array
    covariances: Array


@dataclass(frozen=True, eq=False)
class _Ground(Coordinates):
    """Frames (N, P) of S demonstrations stacked, lengths (S,), and the size (D,) of each tangent channel over all frames."""

    space: Space
    frames: Array
    lengths: np.ndarray
    size: Array
    floor: float
    notes: Notes

    @property
    def n_frames(self) -> int:
        return len(self.frames)

    @property
    def log_volume(self) -> float:
        return 0.0  # likelihoods are of the channels' own units already

    def normalised_time(self) -> Array:
        return np.concatenate([(np.arange(n) + 0.5) / n for n in self.lengths])

    def first_frames(self) -> np.ndarray:
        return np.concatenate([[0], np.cumsum(self.lengths)[:-1]])

    def floored(self, covariances: Array) -> Array:
        """No narrower than the floor, in channels divided by their size."""
        unit = self.size[:, None] * self.size[None, :]
        return floored(covariances / unit, self.floor) * unit


def fit_riemannian_gmm(
    sequences: Iterable[Any],
    n_states: int,
    *,
    channels: Iterable[str],
    covariance_floor: float = 1e-4,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
) -> Fit[RiemannianGmm]:
    """Learns a mixture from demonstrations (T, P), whose quaternions may have any sign; begins with K equal parts of time.

    covariance_floor   least variance in any direction as a ratio of the channel's over all demonstrations
    """
    ground = _prepare(sequences, tuple(channels), n_states, covariance_floor)

    def expect(p: _Gaussians) -> tuple[float, Any]:
        joint = log_density(ground.space, ground.frames, p.means, p.covariances) + np.log(np.maximum(p.weights, 1e-300))
        return float(log_sum_exp(joint).sum()), (normalised(joint), None)

    def maximise(found: Any, p: _Gaussians) -> _Gaussians:
        gamma = found[0]
        occupancy = gamma.sum(axis=0)
        return p._replace(weights=occupancy / occupancy.sum(), **_gaussians(ground, gamma, p))

    p, trace, converged, order = _climbed(ground, n_states, expect, maximise, "free", max_iterations, tolerance)
    k, d = len(order), ground.space.n_tangent
    weights = p.weights[order] / p.weights[order].sum()
    model = RiemannianGmm(weights, p.means[order], p.covariances[order], ground.space.channels)
    return fit_of(model, trace, converged, ground, k - 1 + k * d + k * d * (d + 1) // 2)


def fit_riemannian_hmm(
    sequences: Iterable[Any],
    n_states: int,
    *,
    channels: Iterable[str],
    topology: str = "left-right",
    covariance_floor: float = 1e-4,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
) -> Fit[RiemannianHmm]:
    """Learns an HMM from demonstrations (T, P) by Baum-Welch, as `fit_hmm` does where no channel is a quaternion."""
    check_options(topology, 1, 0.0, n_states, goes_on=False)
    ground = _prepare(sequences, tuple(channels), n_states, covariance_floor)

    def expect(p: _Gaussians) -> tuple[float, Any]:
        log_b = chains.padded(log_density(ground.space, ground.frames, p.means, p.covariances), ground.lengths)
        found = chains.expectations(log_b, ground.lengths, chains.log_of(p.initial), chains.log_of(p.transition))
        return float(found.log_likelihood.sum()), (found.weights, found)

    def maximise(found: Any, p: _Gaussians) -> _Gaussians:
        gamma, e = found
        rows = most_likely_rows(e.transitions, p.transition, 0.0)
        return p._replace(initial=e.first / e.first.sum(), transition=rows, **_gaussians(ground, gamma, p))

    p, trace, converged, order = _climbed(ground, n_states, expect, maximise, topology, max_iterations, tolerance)
    k, d = len(order), ground.space.n_tangent
    transition = p.transition[np.ix_(order, order)]
    transition = transition + np.diag(transition.sum(axis=1) <= 0.0)
    transition /= transition.sum(axis=1, keepdims=True)
    initial = p.initial[order] / p.initial[order].sum()
    model = RiemannianHmm(initial, transition, p.means[order], p.covariances[order], ground.space.channels)
    chain = int((transition > 0.0).sum()) - k
    return fit_of(model, trace, converged, ground, chain + k * d + k * d * (d + 1) // 2)


def _climbed(
    ground: _Ground,
    n_states: int,
    expect: Callable[[_Gaussians], tuple[float, Any]],
    maximise: Callable[[Any, _Gaussians], _Gaussians],
    topology: str,
    max_iterations: int,
    tolerance: float,
) -> tuple[_Gaussians, Array, bool, np.ndarray]:
    start = _first_guess(ground, n_states, topology)
    p, trace, converged = climb(start, expect, maximise, max_iterations=max_iterations, rise=tolerance * ground.n_frames)
    occupancy = expect(p)[1][0].sum(axis=0)
    order = np.flatnonzero(occupancy >= UNVISITED)
    if len(order) < n_states:
        ground.notes.say(f"removed {n_states - len(order)} of {n_states} states: no frame of any demonstration visits them")
    if not converged:
        ground.notes.say(f"not converged after {len(trace) - 1} iterations: raise max_iterations, or use it knowing this")
    return p, trace, converged, order


def _first_guess(ground: _Ground, n_states: int, topology: str) -> _Gaussians:
    labels = np.minimum((ground.normalised_time() * n_states).astype(int), n_states - 1)
    d = ground.space.n_tangent
    centre = ground.space.mean(ground.frames, np.ones(ground.n_frames))
    everything = _Gaussians(
        np.full(n_states, 1.0 / n_states), np.empty(0), np.empty(0), np.tile(centre, (n_states, 1)),
        np.tile(np.diag(ground.size**2), (n_states, 1, 1)).reshape(n_states, d, d),
    )  # fmt: skip
    gamma = np.eye(n_states)[labels]
    first = ground.first_frames()
    inside = np.setdiff1d(np.arange(1, len(labels)), first)
    counts = np.zeros((n_states, n_states))
    np.add.at(counts, (labels[inside - 1], labels[inside]), 1.0)
    begun = np.bincount(labels[first], minlength=n_states).astype(float)
    found = _gaussians(ground, gamma, everything, first_time=True)
    chain = from_counts(counts, begun, found["means"], found["covariances"], allowed_transitions(topology, n_states), topology)
    return _Gaussians(gamma.mean(axis=0), chain.initial, chain.transition, chain.means, chain.covariances)


def _gaussians(ground: _Ground, gamma: Array, before: _Gaussians, first_time: bool = False) -> dict[str, Array]:
    """The M-step: means (K, P) and covariances (K, D, D). A state with no weight keeps what it had."""
    means, covariances = before.means.copy(), before.covariances.copy()
    for i in np.flatnonzero(gamma.sum(axis=0) > 1e-10):
        w = gamma[:, i] / gamma[:, i].sum()
        average = ground.space.mean(ground.frames, w, None if first_time else means[i])
        if first_time:
            means[i], covariances[i], _ = _scored(ground, w, average)
        else:
            means[i], covariances[i] = _risen(ground, w, means[i], average)
    return {"means": means, "covariances": covariances}


def _risen(ground: _Ground, w: Array, before: Array, average: Array) -> tuple[Array, Array]:
    """The centre on the way from `before` to the tangent average, and its covariance, that are no less likely than `before`."""
    stays = _scored(ground, w, before)
    step = ground.space.log(before, average)
    for _ in range(HALVINGS):
        found = _scored(ground, w, ground.space.exp(before, step))
        if found[2] >= stays[2]:
            return found[0], found[1]
        step = 0.5 * step
    return stays[0], stays[1]


def _scored(ground: _Ground, w: Array, mean: Array) -> tuple[Array, Array, float]:
    """(mean, its most likely covariance above the floor, mean log-density of the frames under both), weights w (N,) sum to 1."""
    tangents = ground.space.log(mean, ground.frames)
    scatter = (tangents * w[:, None]).T @ tangents
    covariance = ground.floored(0.5 * (scatter + scatter.T)[None])[0]
    factor = cholesky(covariance[None])[0]
    inside = np.linalg.solve(factor, np.linalg.solve(factor, scatter).T)
    return mean, covariance, float(-np.log(np.diagonal(factor)).sum() - 0.5 * np.trace(inside))


def _prepare(sequences: Iterable[Any], channels: tuple[str, ...], n_states: int, floor: float) -> _Ground:
    space = Space(channels)
    if int(n_states) != n_states or n_states < 1:
        raise ParameterError(f"n_states must be a whole number of at least 1; got {n_states!r}")
    if not 0.0 < floor < 1.0:
        raise ParameterError(f"covariance_floor is a ratio of variances between 0 and 1; got {floor!r}")
    arrays = []
    for s, x in enumerate(sequences):
        if np.ndim(x) != 2:
            raise ChannelError(f"demonstration {s} has shape {np.shape(x)}; allowed: (T, {len(channels)})")
        arrays.append(space.checked(x, f"demonstration {s}", missing=False))
        if len(arrays[-1]) <= n_states:
            raise TrainingError(f"demonstration {s} has {len(arrays[-1])} frames; {n_states} states need {n_states + 1} or more")
    if not arrays:
        raise TrainingError("there is no demonstration; give at least one, each (T, P)")
    frames = np.concatenate(arrays)
    size = _size(space, frames)
    return _Ground(space, frames, np.array([len(a) for a in arrays]), size, floor, Notes())


def _size(space: Space, frames: Array) -> Array:
    """(D,) standard deviation of each number, and of each quaternion's turns together: that knows no axes."""
    centre = space.mean(frames, np.ones(len(frames)))
    tangents = space.log(centre, frames)
    size = np.sqrt((tangents**2).mean(axis=0))
    for _, at in space.turns:
        size[at] = np.sqrt((size[at] ** 2).mean())
    numbers = np.array([abs(centre[space.channels.index(n)]) if n in space.channels else 1.0 for n in space.tangent])
    for name, one, far in zip(space.tangent, size.tolist(), numbers.tolist(), strict=True):
        if one <= SAME * far or one == 0.0:
            raise TrainingError(f"channel {name!r} never changes in any demonstration; leave it out")
    return size
