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
kinds of people for tuning. A tick takes some 60 us, in Python; the others stay compiled.
"""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

import numpy as np

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


class Foresight:
    """What the partner means to do next along the path that was taught; see the module.

    velocity, acceleration   (d,) [m/s], [m/s^2] that the plans expect, mean over them; zero while nothing is foreseen
    sure                     in [0, 1]: that it is one of the plans
    departs                  in [0, 1]: that it is one of them, and in its first part
    """

    def __init__(self, dt: float, n_axes: int) -> None:
        self._dt, self._d = dt, n_axes
        self.velocity, self.acceleration, self.departs = [0.0] * n_axes, [0.0] * n_axes, 0.0
        self._keep = exp(-dt / FELT_S)
        self._reference: PhaseReference | None = None

    def reset(self, position: list[float], *, begins: bool = True) -> None:
        """Rests at `position` (d,); `begins`: where the path begins, too. Of motions from elsewhere nothing is foreseen."""
        self._start, self._felt = list(position), [0.0] * self._d
        self._still_s, self._tries, self._restless = 0.0, 0 if begins else TRIES, FIRST_M
        self.awake, self.sure = False, 0.0
        self._nothing()

    def hears(self, x: list[float], v: list[float], force: list[float], reference: PhaseReference, phase_s: float) -> bool:
        """Whether a motion is under way that one of the plans explains; to be asked each tick, before `step`."""
        keep = self._keep
        self._felt = [keep * f + (1.0 - keep) * min(max(n, -50.0), 50.0) for f, n in zip(self._felt, force, strict=True)]
        self._still_s = self._still_s + self._dt if length(v) < RESTS_M_PER_S else 0.0
        if self.awake:
            if self._still_s > RESTS_S:
                self._give_up(TRIES)
        elif self._tries < TRIES:
            self._wake(x, v, reference)
        elif self._still_s > RESTS_S and phase_s <= AT_START * reference.duration_s:
            self._start, self._tries, self._restless = list(x), 0, FIRST_M
        return self.awake

    def _wake(self, x: list[float], v: list[float], reference: PhaseReference) -> None:
        """At the first tick at which the hand is wanted farther along the path than this partner's rest wanders."""
        if self._reference is not reference:
            self._learn(reference)
        off = [p - s + f / STIFFNESS_N_PER_M for p, s, f in zip(x, self._start, self._felt, strict=True)]
        along, size = dot(off, self._heading), length(off)
        self._restless += self._dt / (RISES_S if size > self._restless else FADES_S) * (size - self._restless)
        least = max(BEGINS_M * FARTHER**self._tries, min(RESTLESS * self._restless, MOST_BEGINS_M))
        if along < least or dot(v, self._heading) <= 0.0 or along < ALONG * size:
            return
        begun = np.interp(along / self._sizes, self._way, reference.step_s * np.arange(len(self._way)))
        self._phase = begun + self._paces * self._late  # when each of the plans would be there
        self._p = self._prior.copy()
        self._p_none, self.sure, self.awake = NONE_FIRST, 1.0 - NONE_FIRST, True
        self.departs = self.sure

    def _learn(self, reference: PhaseReference) -> None:
        self._reference = reference
        sizes, paces, late = (a.ravel() for a in np.meshgrid(SIZES, PACES, LATE_S, indexing="ij"))
        self._sizes, self._paces, self._late = sizes, paces, late
        prior = np.exp(-0.5 * (np.log(sizes) / SIZE_SD) ** 2 - 0.5 * (np.log(paces) / PACE_SD) ** 2)
        self._prior = prior / prior.sum()
        acceleration = np.gradient(reference.velocity, reference.step_s, axis=0)
        # one table of position from the start, velocity and acceleration: (N, 3 d), at rest beyond its end
        table = np.concatenate([reference.position - reference.position[0], reference.velocity, acceleration], axis=1)
        table[-1, self._d :] = 0.0
        self._table = table
        self._heading = reference.heading(0.0).tolist()
        self._way = np.maximum.accumulate(table[:, : self._d] @ np.array(self._heading))

    def step(self, x: list[float], v: list[float]) -> None:
        """One tick of the plans, while awake."""
        d, reference = self._d, self._reference
        assert reference is not None
        self._phase += self._paces * self._dt
        place = np.clip(self._phase / reference.step_s, 0.0, len(self._table) - 1.001)
        n = place.astype(int)
        share = (place - n)[:, None]
        rows = (1.0 - share) * self._table[n] + share * self._table[n + 1]
        fast = self._sizes * self._paces
        meant, speed, acceleration = self._sizes[:, None] * rows[:, :d], fast[:, None] * rows[:, d : 2 * d], rows[:, 2 * d :]
        felt = self._felt
        z = np.array([p - s + f / STIFFNESS_N_PER_M for p, s, f in zip(x, self._start, felt, strict=True)])
        u = np.array([c + f / DAMPING_NS_PER_M for c, f in zip(v, felt, strict=True)])
        doubt = PLACE_M + PLACE_SHARE * float(np.sqrt(z @ z))
        slow = SPEED_M_PER_S + SPEED_SHARE * float(np.sqrt(u @ u))
        off, slip = meant - z, speed - u
        worth = min(self._dt / MEMORY_S, 1.0)
        far = (off * off).sum(axis=1) / (doubt * doubt) + (slip * slip).sum(axis=1) / (slow * slow)
        self._p *= np.exp(-0.5 * worth * np.minimum(far, 200.0))
        self._p_none = (self._p_none + self._dt / NONE_COMES_S) * exp(-0.5 * worth * 2.0 * NONE_SIGMAS**2)
        total = float(self._p.sum())
        self.sure = total / (total + self._p_none)
        if self.sure < 1.0 - GIVEN_UP or total < 1e-290:
            self._give_up(self._tries + 1)
            return
        scale = 1.0 / (total + self._p_none)
        self._p *= scale
        self._p_none *= scale
        weights = self._p / self._p.sum()
        reached = reference.duration_s * DEPARTED
        self.departs = self.sure * float(weights @ (self._phase < reached))
        if float(weights @ (self._phase >= reference.duration_s)) > GIVEN_UP:
            self._give_up(TRIES)
            return
        self.velocity = (weights @ speed).tolist()
        self.acceleration = ((weights * fast * self._paces) @ acceleration).tolist()

    def _give_up(self, tries: int) -> None:
        self.awake, self._tries, self.sure = False, tries, 0.0
        self._nothing()

    def _nothing(self) -> None:
        self.velocity, self.acceleration, self.departs = [0.0] * self._d, [0.0] * self._d, 0.0


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
