"""Where EM begins: frames labelled by time or by k-means, or the Gaussians of a model that is known."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ChannelError, ParameterError, check_generator
from ..interfaces import Array
from ..models.gaussian import floored
from . import cycles
from .coordinates import Lessons, Notes
from .m_step import weighted_gaussians


def guessed_gaussians(guess: Any, lessons: Lessons, n_states: int, floor: float) -> tuple[Array, Array]:
    """Centres and covariances of a model to go on from, in z; ChannelError where it has other states or channels."""
    if guess.channels != lessons.channels or guess.n_states != n_states:
        raise ChannelError(
            f"the model given as initial_guess has {guess.n_states} states of {guess.channels}; "
            f"asked for {n_states} of {lessons.channels}"
        )
    means, covariances = lessons.standardised(guess.means, guess.covariances)
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


def cycle_bins(lessons: Lessons, n_states: int, rng: np.random.Generator | None = None) -> np.ndarray:
    """Labels (N,): K parts of equal time of one cycle, found again in all; of the whole demonstration where nothing repeats."""
    cycle = cycles.first_cycle(np.split(lessons.z, lessons.first_frames()[1:]), n_states, rng)
    if cycle is None:
        say_nothing_repeats(lessons.notes)
        return time_bins(lessons, n_states, rng)
    return cycles.from_its_start(cycles.phases(lessons.z, lessons.lengths, cycle), lessons.first_frames(), n_states)


def say_nothing_repeats(notes: Notes) -> None:
    text = (
        "no demonstration repeats itself: nothing shows the way back from the last state to the first; record two cycles or more "
        "without a stop, or use topology 'left-right'"
    )
    if text not in notes:  # once, however many restarts
        notes.say(text)


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


def first_guess(
    lessons: Lessons, n_states: int, how: str, rng: np.random.Generator | None, jitter: bool, cyclic: bool = False
) -> np.ndarray:
    """Labels (N,) by "time" or "kmeans"; `jitter` asks for another one at each call. `cyclic`: time within the period, if any."""
    if how not in ("time", "kmeans"):
        raise ParameterError(f"initial_guess must be 'time', 'kmeans' or a model; got {how!r}")
    if rng is not None:
        check_generator(rng)
    if rng is None and (jitter or how == "kmeans"):
        raise ParameterError("k-means and restarts draw at random; pass rng=numpy.random.default_rng(seed)")
    if how == "time" and cyclic:
        return cycle_bins(lessons, n_states, rng if jitter else None)
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
