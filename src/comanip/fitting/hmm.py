"""Learning a hidden Markov model from several demonstrations: Baum-Welch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from .. import kernels
from ..interfaces import Array
from ..models.gaussian import in_float32, whitening
from ..models.hmm import Hmm
from .baum_welch import (
    Chain,
    allowed_rows,
    allowed_transitions,
    check_options,
    expect,
    expectations_of,
    free_parameters,
    from_labels,
    maximise,
    rows_of_states,
)
from .climb import Fit, best_climb, fit_of, kept_states
from .coordinates import Coordinates, Lessons, prepare
from .guesses import first_guess, guessed_gaussians


def fit_hmm(
    sequences: Iterable[Any],
    n_states: int,
    *,
    channels: Iterable[str],
    topology: str = "left-right",
    initial_guess: str | Hmm = "time",
    restarts: int = 1,
    rng: np.random.Generator | None = None,
    covariance_floor: float = 1e-4,
    transition_floor: float = 0.0,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
    allow_constant: float | Mapping[str, float] | None = None,
    outlier_ratio: float = 1e3,
    n_threads: int = 1,
    precision: str = "float64",
) -> Fit[Hmm]:
    """Learns an Hmm from several demonstrations, each (T, D), by Baum-Welch; statistics are summed over demonstrations.

    topology          which transitions exist: "left-right" (stay or go on), "cyclic" (the last goes on to the first),
                      "free"
    initial_guess     "time" cuts each demonstration into K equal parts, with "cyclic" one period, where it finds one; "kmeans"
                      needs rng; or an Hmm to go on from
    restarts          further guesses, moved at random; the most likely model wins; more than 1 needs rng
    covariance_floor  least variance in any direction as a ratio of the channels' variance over all demonstrations: 1e-4
                      is 1 % of the standard deviation, about 1 mm in a 0.3 m lift and 0.05 N at 5 N, near what sensors
                      resolve
    transition_floor  least probability of an allowed transition
    tolerance         stop when the log-likelihood rises by less than this per frame
    allow_constant    standard deviation to assume for a channel that never changes (or by name); else it is an error
    outlier_ratio     a few frames this many times farther out than all others are an error; numpy.inf accepts them
    n_threads         threads of the compiled E-step; any number gives the same bits, and no more start than pay:
                      the second with some 1e4 frames
    precision         "float32" climbs in float32, which is up to twice as fast on much data, and takes the last iterations in
                      float64: it converges as "float64" does, to a likelihood equal within `tolerance`, and only the early
                      values of `Fit.log_likelihood` are less exact. Without compiled kernels both are float64

    States come out in order of time; those of "cyclic" in the order of the cycle, from where most demonstrations begin. Read
    `Fit.notes`: what was removed, skipped or suspicious is said there.
    """
    check_options(topology, restarts, transition_floor, n_states, goes_on=isinstance(initial_guess, Hmm))
    single = in_float32(precision)
    lessons = prepare(
        sequences,
        channels,
        n_states=n_states,
        least_frames=n_states + 1,
        covariance_floor=covariance_floor,
        allow_constant=allow_constant,
        outlier_ratio=outlier_ratio,
    )
    allowed = allowed_transitions(topology, n_states)

    def start(attempt: int) -> Chain:
        if isinstance(initial_guess, Hmm):
            gaussians = guessed_gaussians(initial_guess, lessons, n_states, covariance_floor)
            return Chain(initial_guess.initial.copy(), allowed_rows(initial_guess.transition, allowed), *gaussians)
        labels = first_guess(lessons, n_states, initial_guess, rng, jitter=attempt > 0, cyclic=topology == "cyclic")
        return from_labels(lessons, labels, allowed, covariance_floor, topology)

    best = best_climb(
        start,
        restarts,
        lambda p, single: expect(p, lessons, n_threads, single),
        lambda e, p: maximise(e, p, covariance_floor, transition_floor),
        single=single,
        max_iterations=max_iterations,
        rise=tolerance * lessons.n_frames,
    )
    weights = weights_of(best[0], lessons)
    occupancy = weights.sum(axis=0)
    return finished(
        *best, ground=lessons, topology=topology, allowed=allowed, occupancy=occupancy,
        time=lambda: lessons.normalised_time() @ weights, score=lambda p: expect(p, lessons)[0],
    )  # fmt: skip


def finished(
    p: Chain,
    trace: Array,
    converged: bool,
    *,
    ground: Coordinates,
    topology: str,
    allowed: np.ndarray,
    occupancy: Array,
    time: Callable[[], Array],
    score: Callable[[Chain], float],
) -> Fit[Hmm]:
    """Back to the channels' units, states in order of time, unvisited ones removed and reported.

    occupancy (K,) Σγ over all frames; time() the same times the normalised time; score the log-likelihood in z.
    """
    begins = int(p.initial.argmax()) if topology == "cyclic" else 0
    order = kept_states(occupancy, time() if topology == "free" else None, converged, len(trace) - 1, ground.notes, begins)
    initial = p.initial[order] / p.initial[order].sum()
    p = Chain(initial, rows_of_states(p.transition, order), p.means[order], p.covariances[order])
    if len(order) < len(occupancy):
        trace = np.append(trace[:-1], score(p))
    free = free_parameters(topology, allowed[np.ix_(order, order)], p.means.shape[1])
    model = Hmm(p.initial, p.transition, *ground.original(p.means, p.covariances), ground.channels)
    return fit_of(model, trace, converged, ground, free)


def weights_of(p: Chain, lessons: Lessons) -> Array:
    """γ (N, K) of every frame of the lessons."""
    white = whitening(p.means, p.covariances)
    if kernels.native is None:
        return expectations_of(p, white, lessons.z, lessons.lengths).weights
    weights, _, failed = kernels.posteriors(lessons.z, lessons.groups, p.initial, p.transition, white.arrays)
    if failed.any():
        rows = np.repeat(failed, lessons.lengths)
        weights[rows] = expectations_of(p, white, lessons.z[rows], lessons.lengths[failed]).weights
    return weights
