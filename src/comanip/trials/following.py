"""How a hand went along the way of its task: places, cycles, rests, obstacles."""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from ..tasks import Way, usual, way
from ..tasks.way import QUARTERS
from .cases import Case

RESTING_M_PER_S = 0.03  # slower than this near a place, the hand rests there
NEAR_M = 0.03  # so much farther than `Success.way_m` from it a rest still belongs to it
CYCLE_SHARE = 0.35  # of the task's size: a soft partner pulls less far than meant in each cycle, and has done it
STEP_S = 0.01  # between two places of a meant way
MORE_CYCLES = 3  # so many beyond the asked ones are counted


class Followed(NamedTuple):
    """See `judging.Verdict`; partner_clearance_m is how close a leading partner means to go, meant_s how long."""

    visited: float
    cycles: float
    rest_error_s: float
    clearance_m: float
    partner_clearance_m: float
    meant_s: float


def followed(case: Case, t: Array, x: Array, v: Array) -> Followed:
    """Of a hand at x (T, d) from its start, v (T, d), at times t (T,)."""
    meant, offset = _meant(case)
    places, within = meant.places + offset, case.task.success.way_m
    per_cycle = _per_cycle(case)
    if per_cycle:
        within = max(within, CYCLE_SHARE * case.task.size_m)
    asked = np.vstack([places, np.tile(places[len(places) - per_cycle :], (MORE_CYCLES, 1))]) if per_cycle else places
    at = _visits(x, asked, within)
    start = case.start_m - case.task.start
    own = case.course
    times = np.arange(own.start_s, own.stop_s + 0.01, 0.01)
    free = case.task.clearance_m(own.sampled(times), start) if case.task.obstacles and case.leads else inf
    n_before = len(places) - round(per_cycle * case.task.cycles) if per_cycle else 0
    return Followed(
        visited=min(len(at), len(places)) / len(places) if per_cycle else _on_the_way(at, len(places)),
        cycles=(len(at) - n_before) / per_cycle if per_cycle else nan,
        rest_error_s=_rest_error(_Hand(t, x, v), places, meant, at, within),
        clearance_m=case.task.clearance_m(x, start),
        partner_clearance_m=free,
        meant_s=meant.course.stop_s - meant.course.start_s,
    )


def _meant(case: Case) -> tuple[Way, Array]:
    """The leading one's way, and what to add to its places to have them from where the hand started."""
    if case.leads:
        return case.way, np.zeros(len(case.axes))
    return way(case.task, usual(case.task, case.drawn.goal)), case.task.start - case.start_m


def _per_cycle(case: Case) -> int:
    last = case.task.phases[-1]
    return {"strokes": 2, "circle": QUARTERS}.get(last.kind, 0)


def _visits(x: Array, places: Array, within: float) -> list[int]:
    """The ticks at which places (n, d) are reached one after the other, up to the first that is not."""
    at, now = [], 0
    for place in places:
        near = np.flatnonzero(((x[now:] - place) ** 2).sum(axis=1) <= within**2)
        if not len(near):
            break
        now += int(near[0])
        at.append(now)
    return at


def _on_the_way(at: list[int], n: int) -> float:
    """Share of the places before the last: the end has a bound of its own."""
    return min(len(at), n - 1) / (n - 1) if n > 1 else 1.0


class _Hand(NamedTuple):
    """Times (T,), places and velocities (T, d)."""

    t: Array
    x: Array
    v: Array


def _rest_error(hand: _Hand, places: Array, meant: Way, at: list[int], within: float) -> float:
    """[s] by which the worst rest on the way differs from what is meant; one that never came misses all of it.

    Meant is how long the meant way itself would count as resting there: a slow motion comes to rest early and leaves late.
    """
    waits = np.flatnonzero(meant.rests[:-1] > 0.0).tolist()
    if not waits:
        return 0.0
    own = _gone(meant)
    when = _visits(own.x, meant.places, within)
    worst = 0.0
    for n in waits:
        asked = _rested(own, meant.places[n], when[n], within) if n < len(when) else float(meant.rests[n])
        kept = _rested(hand, places[n], at[n], within) if n < len(at) else 0.0
        worst = max(worst, abs(kept - asked))
    return worst


def _gone(meant: Way) -> _Hand:
    """A hand that goes exactly the meant way."""
    t = np.arange(meant.course.start_s, meant.course.stop_s, STEP_S)
    x = meant.course.sampled(t)
    return _Hand(t, x, np.gradient(x, STEP_S, axis=0))


def _rested(hand: _Hand, place: Array, since: int, within: float) -> float:
    """How long [s] the hand rests near a place, from when it is first there until it has left it."""
    near = ((hand.x[since:] - place) ** 2).sum(axis=1) <= (within + NEAR_M) ** 2
    gone = np.flatnonzero(~near)
    stay = slice(since, since + (int(gone[0]) if len(gone) else len(near)))
    slow = (hand.v[stay] ** 2).sum(axis=1) < RESTING_M_PER_S**2
    return float(slow.sum() * (hand.t[1] - hand.t[0]))
