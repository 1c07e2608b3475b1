"""What every expectation-maximisation here shares: first guesses, the M-step of Gaussians, the climb, and the Fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ..errors import InternalError, ParameterError
from ..interfaces import Array
from .coordinates import Coordinates, Notes

Model = TypeVar("Model")
Parameters = TypeVar("Parameters")
Statistics = TypeVar("Statistics")

UNVISITED = 0.1  # [frames] a state that explains less than this in all demonstrations together is removed
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
        """Steps of EM that were taken."""
        return len(self.log_likelihood) - 1

    def __repr__(self) -> str:
        end = "converged" if self.converged else "not converged"
        return f"Fit({self.model!r}, {end} after {self.n_iterations} iterations at log-likelihood {self.log_likelihood[-1]:.6g})"


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


def kept_states(
    occupancy: Array, time: Array | None, converged: bool, iterations: int, notes: Notes, first: int = 0
) -> np.ndarray:
    """States in order of their mean time, those that no frame visits left out and reported.

    occupancy (K,) Σγ over all frames; time (K,) the same times the normalised time, or None where states are in order already:
    round and round from `first`.
    """
    unvisited = np.flatnonzero(occupancy < UNVISITED)
    say_unvisited(unvisited, len(occupancy), notes)
    say_converged(converged, iterations, notes)
    order = np.roll(np.arange(len(occupancy)), -first)
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


def say_unvisited(states: np.ndarray, n_states: int, notes: Notes) -> None:
    if len(states):
        notes.say(
            f"removed states {states.tolist()} of {n_states}: no frame of any demonstration visits them; "
            f"the model has {n_states - len(states)} states"
        )


def say_converged(converged: bool, iterations: int, notes: Notes) -> None:
    if not converged:
        notes.say(f"not converged after {iterations} iterations: raise max_iterations, or use it knowing this")
