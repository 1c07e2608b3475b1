"""Where is the partner going to pull? A posterior over the partner's plan, with what was taught as the prior.

A plan is the taught path, gone farther or less far (A), slower or faster (r), and begun sooner or later (t_0):

    x(t) = x_0 + A (X(r (t - t_0)) - X(0))        p(plan | seen) ~ p(plan) prod N(seen - x(t), v(t))

What is seen is where the partner wants the hand: the hand itself, and ahead of it what the force still pulls,

    z = x + F / K        u = v + F / B

with an arm as usual as K and B. So motion alone cannot confirm itself: a hand that went where nobody wanted it is pulled back,
and the plans that led there lose. "None of these" stands beside the plans with a density of its own: whoever goes another way is
known within some tenths of a second, and nothing is foreseen of such a motion until it has gone on for a while, or rested.

A motion begins where the hand is wanted farther along the path than this partner's rest wanders: who sways does not set out. All
lasts as long as the hand moves; of a motion that begins elsewhere on the path nothing is foreseen. Numbers were chosen on the
kinds of people for tuning. What is remembered lies in `memory`, which kernels/_foresight.h shares: there the same tick is written
once more, for speed. Sums are in the order of the plans in both.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..interfaces import Array
from ..kernels.copies import Copied
from ..signals.exponential import exponential
from ..signals.vectors import dot, length
from .reference import PhaseReference

if TYPE_CHECKING:
    from .collaborate import CollaborativeLaw

SIZES = np.exp(np.linspace(np.log(0.5), np.log(1.4), 10))  # A, beside what was taught
PACES = np.exp(np.linspace(np.log(0.45), np.log(1.6), 10))  # r
LATE_S = np.array([-0.08, 0.0, 0.08])  # of the onset, about where it is guessed
SIZE_SD, PACE_SD = 0.25, 0.30  # of their logarithms, at least: other people differ more than the lessons of one teacher
STIFFNESS_N_PER_M, DAMPING_NS_PER_M = 300.0, 40.0  # K, B: half of the force is for the place and half for the speed
PLACE_M, PLACE_SHARE = 0.006, 0.04  # doubt of z, and its share of the way gone
SPEED_M_PER_S, SPEED_SHARE = 0.02, 0.10  # doubt of u, and its share of the speed
MEMORY_S = 0.10  # samples closer than this repeat each other
NONE_SIGMAS = 1.6  # so far off is as likely under "none of these"
NONE_FIRST, NONE_COMES_S = 0.10, 5.0  # its prior, and how fast a plan is given up without a reason
GIVEN_UP = 0.8  # from here on nothing is foreseen any more
FELT_S = 0.015  # smoothing of the force
BEGINS_M = 0.006  # so far is the hand wanted, along the path, when a motion has begun
DEPARTED = 1.0  # share of the duration from which a motion comes to its end
TRIES, FARTHER = 3, 2.5  # what was none of these may be the motion's beginning, badly guessed: asked again so much farther on
RISES_S, FADES_S, RESTLESS = 0.5, 4.0, 2.0  # a partner who sways does not begin: so many times more than the rest wanders
MOST_BEGINS_M = 0.02
FIRST_M = 0.0045  # that the rest of somebody unknown wanders
ALONG = 0.7  # share of it along the path
AT_START = 0.02  # share of the duration
RESTS_M_PER_S, RESTS_S = 0.015, 0.4
MOST_PACE = 1.5  # of the taught top speed: nothing faster is foreseen
MOST_FORESEEN = 3.0  # [m/s^2] of acceleration that is anticipated from the path alone; quick strokes have 2


STILL_S, TRIED, RESTLESSNESS, AWAKE, SURE, DEPARTS, NONE, WHICH = range(8)  # Foresight.memory, after four vectors
GRID = np.stack([a.ravel() for a in np.meshgrid(SIZES, PACES, LATE_S, indexing="ij")]).copy()  # (3, plans): A, r, lateness


class Plans(NamedTuple):
    """What the plans along one path share.

    table    (N, 3 d) position from its start, velocity and acceleration; at rest beyond its end
    way      (N,) how far along `heading` (d,), where it sets out to [m]
    """

    reference: PhaseReference
    table: Array
    way: Array
    heading: Array

    @classmethod
    def along(cls, reference: PhaseReference) -> Plans:
        acceleration = np.gradient(reference.velocity, reference.step_s, axis=0)
        table = np.concatenate([reference.position - reference.position[0], reference.velocity, acceleration], axis=1)
        d, heading = reference.position.shape[1], reference.heading(0.0)
        table[-1, d:] = 0.0
        return cls(reference, table, np.maximum.accumulate(table[:, :d] @ heading), heading)

    def begun(self, along_m: float) -> float:
        """Phase [s] at which the path, gone as taught, is so far along."""
        way, last = self.way.tolist(), len(self.way) - 1
        if along_m >= way[-1]:
            return self.reference.step_s * last
        n = max(bisect_right(way, along_m) - 1, 0)
        return self.reference.step_s * (n + max(along_m - way[n], 0.0) / (way[n + 1] - way[n]))


def _prior() -> Array:
    sizes, paces, _ = GRID
    prior = np.exp(-0.5 * (np.log(sizes) / SIZE_SD) ** 2 - 0.5 * (np.log(paces) / PACE_SD) ** 2)
    return np.asarray(prior / prior.sum())


PRIOR = _prior()


class Foresight(Copied):
    """What the partner means to do next along the path that was taught; see the module.

    velocity, acceleration   (d,) [m/s], [m/s^2] that the plans expect, mean over them; zero while nothing is foreseen
    sure                     in [0, 1]: that it is one of the plans
    departs                  in [0, 1]: that it is one of them, and in its first part
    """

    def __init__(self, dt: float, n_axes: int, references: Sequence[PhaseReference] = ()) -> None:
        self._dt, self._d = dt, n_axes
        self._keep = exponential(-dt / FELT_S)
        self.plans = [Plans.along(reference) for reference in references]
        n = GRID.shape[1]
        self.memory = np.zeros(4 * n_axes + 8 + 2 * n)
        self._start, self._felt, self.velocity, self.acceleration = self.memory[: 4 * n_axes].reshape(4, n_axes)
        self._told, rest = self.memory[4 * n_axes : -2 * n], self.memory[-2 * n :]
        self._phase, self._p = rest.reshape(2, n)

    def shared(self) -> tuple[Any, ...]:
        """All of it, as kernels/_foresight.h takes it; of the paths that it was made for."""
        tables, ways = (np.concatenate([getattr(one, name) for one in self.plans]) for name in ("table", "way"))
        headings = np.array([one.heading for one in self.plans])
        return tables, ways, headings, GRID, PRIOR, self.memory, len(PACES) * len(LATE_S), self._keep

    @property
    def awake(self) -> bool:
        """Whether a motion is under way that one of the plans explains."""
        return bool(self._told[AWAKE] != 0.0)

    @property
    def sure(self) -> float:
        return float(self._told[SURE])

    @property
    def departs(self) -> float:
        return float(self._told[DEPARTS])

    def reset(self, position: Sequence[float], *, begins: bool = True) -> None:
        """Rests at `position` (d,); `begins`: where the path begins, too. Of motions from elsewhere nothing is foreseen."""
        self.memory[:] = 0.0
        self._start[:] = position
        self._told[TRIED], self._told[RESTLESSNESS] = 0 if begins else TRIES, FIRST_M

    def hears(self, x: list[float], v: list[float], force: list[float], reference: PhaseReference, phase_s: float) -> bool:
        """Whether a motion is under way that one of the plans explains; to be asked each tick, before `step`."""
        keep, told = self._keep, self._told
        for i, (f, n) in enumerate(zip(self._felt.tolist(), force, strict=True)):
            self._felt[i] = keep * f + (1.0 - keep) * min(max(n, -50.0), 50.0)
        told[STILL_S] = told[STILL_S] + self._dt if length(v) < RESTS_M_PER_S else 0.0
        if self.awake:
            if told[STILL_S] > RESTS_S:
                self._give_up(TRIES)
        elif told[TRIED] < TRIES:
            self._wake(x, v, reference)
        elif told[STILL_S] > RESTS_S and phase_s <= AT_START * reference.duration_s:
            self._start[:] = x
            told[TRIED], told[RESTLESSNESS] = 0.0, FIRST_M
        return self.awake

    def _wake(self, x: list[float], v: list[float], reference: PhaseReference) -> None:
        """At the first tick at which the hand is wanted farther along the path than this partner's rest wanders."""
        told, which = self._told, self._which(reference)
        plans = self.plans[which]
        off = [p - s + f / STIFFNESS_N_PER_M for p, s, f in zip(x, self._start.tolist(), self._felt.tolist(), strict=True)]
        heading = plans.heading.tolist()
        along, size, restless = dot(off, heading), length(off), float(told[RESTLESSNESS])
        restless += self._dt / (RISES_S if size > restless else FADES_S) * (size - restless)
        told[RESTLESSNESS] = restless
        least = max(BEGINS_M * FARTHER ** int(told[TRIED]), min(RESTLESS * restless, MOST_BEGINS_M))
        if along < least or dot(v, heading) <= 0.0 or along < ALONG * size:
            return
        sizes, paces, late = GRID
        begun = np.repeat([plans.begun(along / size) for size in SIZES.tolist()], len(sizes) // len(SIZES))
        self._phase[:] = begun + paces * late  # when each of the plans would be there
        self._p[:] = PRIOR
        told[NONE], told[SURE], told[AWAKE], told[WHICH] = NONE_FIRST, 1.0 - NONE_FIRST, 1.0, which
        told[DEPARTS] = told[SURE]

    def _which(self, reference: PhaseReference) -> int:
        for n, plans in enumerate(self.plans):
            if plans.reference is reference:
                return n
        self.plans.append(Plans.along(reference))
        return len(self.plans) - 1

    def step(self, x: list[float], v: list[float]) -> None:
        """One tick of the plans, while awake."""
        told, d, (sizes, paces, _) = self._told, self._d, GRID
        reference, table, *_ = self.plans[int(told[WHICH])]
        self._phase += paces * self._dt
        rows = self._rows(table, reference.step_s)
        fast = sizes * paces
        meant, speed, acceleration = sizes[:, None] * rows[:, :d], fast[:, None] * rows[:, d : 2 * d], rows[:, 2 * d :]
        felt = self._felt.tolist()
        z = [p - s + f / STIFFNESS_N_PER_M for p, s, f in zip(x, self._start.tolist(), felt, strict=True)]
        u = [c + f / DAMPING_NS_PER_M for c, f in zip(v, felt, strict=True)]
        doubt = PLACE_M + PLACE_SHARE * length(z)
        slow = SPEED_M_PER_S + SPEED_SHARE * length(u)
        worth = min(self._dt / MEMORY_S, 1.0)
        far = _squares(meant - z) / (doubt * doubt) + _squares(speed - u) / (slow * slow)
        self._p *= [exponential(log_b) for log_b in (-0.5 * worth * np.minimum(far, 200.0)).tolist()]
        none = (float(told[NONE]) + self._dt / NONE_COMES_S) * exponential(-0.5 * worth * 2.0 * NONE_SIGMAS * NONE_SIGMAS)
        total = _sum(self._p)
        sure = total / (total + none)
        if sure < 1.0 - GIVEN_UP or total < 1e-290:
            self._give_up(int(told[TRIED]) + 1)
            return
        scale = 1.0 / (total + none)
        self._p *= scale
        told[NONE], told[SURE] = none * scale, sure
        weights = self._p / _sum(self._p)
        told[DEPARTS] = sure * _sum(weights * (self._phase < reference.duration_s * DEPARTED))
        if _sum(weights * (self._phase >= reference.duration_s)) > GIVEN_UP:
            self._give_up(TRIES)
            return
        for i in range(d):
            self.velocity[i] = _sum(weights * speed[:, i])
            self.acceleration[i] = _sum(weights * fast * paces * acceleration[:, i])

    def _rows(self, table: Array, step_s: float) -> Array:
        """The table (plans, 3 d) where each of the plans is."""
        place = np.clip(self._phase / step_s, 0.0, len(table) - 1.001)
        n = place.astype(int)
        share = (place - n)[:, None]
        return np.asarray((1.0 - share) * table[n] + share * table[n + 1])

    def _give_up(self, tries: int) -> None:
        told = self._told
        told[AWAKE], told[TRIED], told[SURE], told[DEPARTS] = 0.0, tries, 0.0, 0.0
        self.velocity[:] = self.acceleration[:] = 0.0

    def foreseen(self, law: CollaborativeLaw, force: list[float]) -> list[float]:
        """Acceleration (d,) that takes the hand along with the plans: theirs, and what damping would take from their speed."""
        plans = self.velocity.tolist()
        along = dot(force, plans) / max(length(plans), 1e-3)
        share = law.foresight * self.sure * min(max((along + 2.0) / 1.5, 0.0), 1.0)
        damped = law.moving_damping_ns_per_m / law.virtual_mass_kg
        return [share * (a + damped * v) for a, v in zip(self.acceleration.tolist(), plans, strict=True)]


def _sum(values: Array) -> float:
    """In the order of the values: numpy's own sum takes them in pairs."""
    return 0.0 + float(np.cumsum(values)[-1])


def _squares(off: Array) -> Array:
    """The squared length (N,) of each row."""
    total = off[:, 0] * off[:, 0]
    for n in range(1, off.shape[1]):
        total += off[:, n] * off[:, n]
    return np.asarray(total)


def anticipated(
    law: CollaborativeLaw, reference: PhaseReference, phase_s: float, velocity: list[float], force: list[float]
) -> list[float]:
    """(d,) [m/s^2] The taught change of speed just ahead, scaled to the partner's present speed: what a follower does by itself.

    Not where the partner goes another way than was taught here, and not against the partner's pull.
    """
    speed = length(velocity)
    if speed < 0.02:
        return [0.0] * len(velocity)
    now = reference.floats_at("velocity", phase_s)
    usual = max(length(now), 0.03)
    ahead = reference.floats_at("velocity", phase_s + law.anticipation_s * min(speed / usual, 2.0))
    agreement = max(dot(now, velocity), 0.0) / max(length(now) * speed, 1e-9)
    agreement *= min(speed / law.moving_speed_m_per_s, 1.0)
    scale = min(speed / usual, 1.5)
    foreseen = [(a - n) / law.anticipation_s * scale for a, n in zip(ahead, now, strict=True)]
    asked = length(foreseen)
    agreement *= min(max((dot(force, foreseen) / max(asked, 1e-9) + 1.0) / 2.0, 0.0), 1.0)
    agreement *= law.anticipation / max(asked / MOST_FORESEEN, 1.0)
    return [agreement * a for a in foreseen]
