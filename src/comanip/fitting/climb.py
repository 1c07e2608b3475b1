"""What every expectation-maximisation here shares: first guesses, the M-step of Gaussians, the climb, and the Fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from ..errors import ChannelError, InternalError, ParameterError
from ..interfaces import Array
from ..models.gaussian import floored
from .coordinates import Coordinates, Lessons, Notes

Model = TypeVar("Model")
Parameters = TypeVar("Parameters")
Statistics = TypeVar("Statistics")

UNVISITED = 0.1  # [frames] a state that explains less than this in all demonstrations together is removed
MOST_APART = 1e4  # squared distance of a state from its moments' origin over its variance: further out digits are lost
FALL = 1e-9  # relative fall of the likelihood that is rounding; more is a defect


@dataclass(frozen=True, eq=False)
class Fit(Generic[Model]):
    """A model and how it was learned.

    log_likelihood  (iterations + 1,) of all demonstrations together, in the channels' own units; the last is of `model`
    converged       False when the iterations ran out
    notes           everything that was suspicious or changed, one sentence each
    bic             −2 log L + (free parameters) log N: smaller is better
    n_frames        N, frames that were learned from
    """

    model: Model
    log_likelihood: Array
    converged: bool
    notes: tuple[str, ...]
    bic: float
    n_frames: int

    @property
    def n_iterations(self) -> int:
        return len(self.log_likelihood) - 1


def climb(
    parameters: Parameters,
    expect: Callable[[Parameters], tuple[float, Statistics]],
    maximise: Callable[[Statistics, Parameters], Parameters],
    *,
    max_iterations: int,
    rise: float,
    trace: list[float] | None = None,
    fall: float = FALL,
) -> tuple[Parameters, Array, bool]:
    """Expectation-maximisation until the log-likelihood rises by less than `rise`.

    Never returns a model it has not scored. A likelihood that falls breaks a theorem, so it raises InternalError
    instead of being called convergence, if it is by more than the ratio `fall`. `trace`, to go on from a climb that was
    interrupted: its log-likelihoods before `parameters`; it is appended to.
    """
    if max_iterations < 0:
        raise ParameterError(f"max_iterations must not be negative; got {max_iterations!r}")
    trace = [] if trace is None else trace
    for iteration in range(len(trace), max_iterations + 1):
        log_likelihood, statistics = expect(parameters)
        trace.append(log_likelihood)
        if iteration:
            gain = trace[-1] - trace[-2]
            if not gain >= -fall * max(abs(trace[-2]), 1.0):
                raise InternalError(
                    f"the likelihood fell by {-gain:.3e} (from {trace[-2]:.6e}) in iteration {iteration}; "
                    "please report it with these demonstrations"
                )
            if gain < rise:
                return parameters, np.array(trace), True
        if iteration < max_iterations:
            parameters = maximise(statistics, parameters)
    return parameters, np.array(trace), False


def climb_fast_first(
    parameters: Parameters,
    expect: Callable[[Parameters, bool], tuple[float, Statistics]],
    maximise: Callable[[Statistics, Parameters], Parameters],
    *,
    single: bool,
    max_iterations: int,
    rise: float,
) -> tuple[Parameters, Array, bool]:
    """`climb`; with `single`, in float32 as far as that leads, and on from there in float64.

    So the model is as good as one of float64 alone: it is scored in float64, and its last step was taken in float64. A fall in
    float32 is rounding, and ends only the first part.
    """
    before: Array = np.empty(0)
    if single:
        parameters, trace, _ = climb(
            parameters, lambda p: expect(p, True), maximise, max_iterations=max_iterations, rise=rise, fall=np.inf
        )
        before = trace[:-1]
    parameters, trace, converged = climb(
        parameters, lambda p: expect(p, False), maximise, max_iterations=max_iterations - len(before), rise=rise
    )
    return parameters, np.append(before, trace), converged


def best_climb(
    start: Callable[[int], Parameters],
    restarts: int,
    expect: Callable[[Parameters, bool], tuple[float, Statistics]],
    maximise: Callable[[Statistics, Parameters], Parameters],
    *,
    single: bool = False,
    max_iterations: int,
    rise: float,
) -> tuple[Parameters, Array, bool]:
    """The climb that ends highest, from `start(0)`, `start(1)`, ..."""
    climbs = (
        climb_fast_first(start(n), expect, maximise, single=single, max_iterations=max_iterations, rise=rise)
        for n in range(restarts)
    )
    return max(climbs, key=lambda found: float(found[1][-1]))


def guessed_gaussians(guess: Any, lessons: Lessons, n_states: int, floor: float) -> tuple[Array, Array]:
    """Centres and covariances of a model to go on from, in z; ChannelError where it has other states or channels."""
    if guess.channels != lessons.channels or guess.n_states != n_states:
        raise ChannelError(
            f"the model given as initial_guess has {guess.n_states} states of {guess.channels}; "
            f"asked for {n_states} of {lessons.channels}"
        )
    means, covariances = lessons.standardised(guess.means, guess.covariances)
    return means, floored(covariances, floor)


def kept_states(occupancy: Array, time: Array | None, converged: bool, iterations: int, notes: Notes) -> np.ndarray:
    """States in order of their mean time, those that no frame visits left out and reported.

    occupancy (K,) Σγ over all frames; time (K,) the same times the normalised time, or None where states are in order already.
    """
    unvisited = np.flatnonzero(occupancy < UNVISITED)
    say_unvisited(unvisited, len(occupancy), notes)
    say_converged(converged, iterations, notes)
    order = np.arange(len(occupancy))
    if time is not None:
        order = np.argsort(time / np.maximum(occupancy, 1e-300), kind="stable")
    return order[~np.isin(order, unvisited)]


def fit_of(model: Model, trace: Array, converged: bool, ground: Coordinates, free_parameters: int) -> Fit[Model]:
    """The Fit of a model in the channels' units; `trace` is the log-likelihood in z."""
    trace = trace - ground.log_volume
    trace.setflags(write=False)
    return Fit(
        model=model,
        log_likelihood=trace,
        converged=converged,
        notes=tuple(ground.notes),
        bic=float(-2.0 * trace[-1] + free_parameters * np.log(ground.n_frames)),
        n_frames=ground.n_frames,
    )


def weighted_gaussians(z: Array, weights: Array, floor: float, before: tuple[Array, Array]) -> tuple[Array, Array]:
    """M-step: centres (K, D) and covariances (K, D, D) of z (N, D) under weights (N, K).

    A state with no weight at all keeps what it had `before`: any value is equally likely then.
    """
    means, covariances = before[0].copy(), before[1].copy()
    occupancy = weights.sum(axis=0)
    for i in np.flatnonzero(occupancy > 1e-10):
        w = weights[:, i] / occupancy[i]
        means[i] = w @ z
        centred = z - means[i]
        covariances[i] = (centred * w[:, None]).T @ centred
    return means, floored(covariances, floor)


def moments_about(origin: Array, z: Array, weights: Array) -> Array:
    """Σ_n w_ni (z_n − origin, 1)(z_n − origin, 1)ᵀ, (K, D + 1, D + 1): occupancy, sums and products of every state."""
    d = z.shape[1]
    extended = np.ones((len(z), d + 1))
    np.subtract(z, origin, out=extended[:, :d])
    return np.stack([(extended * w[:, None]).T @ extended for w in weights.T])


def loses_digits(moments: Array) -> bool:
    """Whether a state is so far from the origin of its moments, in its own standard deviations, that its scatter is a small
    difference of large numbers."""
    occupancy = moments[:, -1, -1]
    squared = moments[:, :-1, -1] ** 2 / np.maximum(occupancy, 1e-300)[:, None]
    scatter = np.einsum("kii->ki", moments[:, :-1, :-1]) - squared
    return bool((squared > MOST_APART * scatter)[occupancy > 1e-10].any())


def scatter_of_moments(moments: Array, means: Array) -> Array:
    """Σ_n w_ni (z_n − μ_i)(z_n − μ_i)ᵀ, (K, D, D), from `moments_about` an origin, from which the means (K, D) are seen, too."""
    cross = moments[:, :-1, -1, None] * means[:, None, :]
    squares = moments[:, -1, -1, None, None] * means[:, :, None] * means[:, None, :]
    scatter = moments[:, :-1, :-1] - 2.0 * cross + squares  # made symmetric below
    return 0.5 * (scatter + np.swapaxes(scatter, 1, 2))


def scatter_of_frames(z: Array, weights: Array, means: Array) -> Array:
    """The same from frames (N, D) and weights (N, K), with all digits wherever the states are."""
    centred = (z - mean for mean in means)
    return np.array([(c * w[:, None]).T @ c for c, w in zip(centred, weights.T, strict=True)])


def gaussians_of_moments(moments: Array, origin: Array, floor: float, before: tuple[Array, Array]) -> tuple[Array, Array]:
    """M-step from `moments_about`: centres (K, D), covariances (K, D, D). A state with no weight keeps what it had `before`."""
    occupancy = moments[:, -1, -1]
    visited = occupancy > 1e-10
    shares = moments / np.where(visited, occupancy, 1.0)[:, None, None]
    centres = shares[:, :-1, -1]
    covariances = shares[:, :-1, :-1] - centres[:, :, None] * centres[:, None, :]
    covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
    means = centres + origin
    if not visited.all():
        means = np.where(visited[:, None], means, before[0])
        covariances = np.where(visited[:, None, None], covariances, before[1])
    return means, floored(covariances, floor)


def time_bins(lessons: Lessons, n_states: int, rng: np.random.Generator | None = None) -> np.ndarray:
    """Labels (N,): every demonstration cut into K parts of equal time.

    The guess that suits a task with a beginning and an end: random starts mostly end far below it. With `rng` the cuts
    are moved at random, for restarts.
    """
    cuts = np.arange(1, n_states) / n_states
    if rng is not None:
        cuts = np.sort(np.clip(cuts + rng.normal(scale=0.4 / n_states, size=len(cuts)), 0.0, 1.0))
    return np.searchsorted(cuts, lessons.normalised_time(), side="right")


def k_means(z: Array, n_clusters: int, rng: np.random.Generator, max_iterations: int = 100) -> np.ndarray:
    """Labels (N,) by Lloyd's iterations from a k-means++ start."""
    z = z - z.mean(axis=0)  # far from zero the products below would lose the distances
    centres = z[rng.integers(len(z))][None, :].copy()
    nearest = ((z - centres) ** 2).sum(axis=1)
    while len(centres) < n_clusters:
        total = nearest.sum()
        chosen = z[rng.choice(len(z), p=nearest / total) if total > 0.0 else rng.integers(len(z))]
        centres = np.concatenate([centres, chosen[None, :]])
        nearest = np.minimum(nearest, ((z - chosen) ** 2).sum(axis=1))
    labels = np.full(len(z), -1)
    for _ in range(max_iterations):
        nearness = z @ centres.T - 0.5 * (centres**2).sum(axis=1)  # (|z|² - distance²) / 2
        previous, labels = labels, nearness.argmax(axis=1)
        if (labels == previous).all():
            break
        for i in range(n_clusters):
            mine = labels == i
            # an empty cluster takes the frame that is served worst
            centres[i] = z[mine].mean(axis=0) if mine.any() else z[((z**2).sum(axis=1) - 2.0 * nearness.max(axis=1)).argmax()]
    return labels


def in_order_of_time(labels: np.ndarray, time: Array, n_states: int) -> np.ndarray:
    """The same clusters, numbered by their mean time."""
    count = np.bincount(labels, minlength=n_states)
    mean = np.bincount(labels, weights=time, minlength=n_states) / np.maximum(count, 1)
    rank = np.empty(n_states, dtype=np.intp)
    rank[np.argsort(np.where(count > 0, mean, np.inf), kind="stable")] = np.arange(n_states)
    return rank[labels]


def first_guess(lessons: Lessons, n_states: int, how: str, rng: np.random.Generator | None, jitter: bool) -> np.ndarray:
    """Labels (N,) by "time" or "kmeans"; `jitter` asks for another one at each call."""
    if how not in ("time", "kmeans"):
        raise ParameterError(f"initial_guess must be 'time', 'kmeans' or a model; got {how!r}")
    if rng is None and (jitter or how == "kmeans"):
        raise ParameterError("k-means and restarts draw at random; pass rng=numpy.random.default_rng(seed)")
    if how == "time":
        return time_bins(lessons, n_states, rng if jitter else None)
    assert rng is not None
    return in_order_of_time(k_means(lessons.z, n_states, rng), lessons.normalised_time(), n_states)


def gaussians_of_labels(z: Array, labels: np.ndarray, n_states: int, floor: float) -> tuple[Array, Array]:
    """Centres and covariances of labelled frames; an empty label gets those of all frames."""
    everything = (
        np.tile(z.mean(axis=0), (n_states, 1)),
        np.tile(np.cov(z.T, bias=True).reshape(z.shape[1], -1), (n_states, 1, 1)),
    )
    return weighted_gaussians(z, np.eye(n_states)[labels], floor, everything)


def say_unvisited(states: np.ndarray, n_states: int, notes: Notes) -> None:
    if len(states):
        notes.say(
            f"removed states {states.tolist()} of {n_states}: no frame of any demonstration visits them; "
            f"the model has {n_states - len(states)} states"
        )


def say_converged(converged: bool, iterations: int, notes: Notes) -> None:
    if not converged:
        notes.say(f"not converged after {iterations} iterations: raise max_iterations, or use it knowing this")
