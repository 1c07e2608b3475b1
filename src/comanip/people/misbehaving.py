"""Partners who do not do what one hopes: who hesitate, turn back, block, let go, or change their role on the way.

Each wraps or joins partners that are `Partner`s themselves, so any model of a person can misbehave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Partner

NextPartner = Callable[[Array, Array], Partner]  # who takes over, given where it all began and where it is now, (d,) [m]


class LetsGo:
    """Holds like `partner` until `at_s`, and then no more: the force is gone within `within_s`."""

    def __init__(self, partner: Partner, at_s: float, within_s: float = 0.05) -> None:
        self._partner, self._at, self._within = partner, at_s, within_s

    def reset(self, position: Array) -> None:
        self._partner.reset(position)

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        self._partner.force(time, position, velocity, out)
        out *= min(max(1.0 - (time - self._at) / self._within, 0.0), 1.0)


class Blocks:
    """Like `partner` until `at_s`; from then on that end of the object stands against a wall, where it is at that moment."""

    def __init__(
        self,
        partner: Partner,
        at_s: float,
        *,
        carried: Array,
        stiffness_n_per_m: float = 1e4,
        damping_ns_per_m: float = 200.0,
    ) -> None:
        self._partner, self._at, self._carried = partner, at_s, carried
        self._stiffness, self._damping = stiffness_n_per_m, damping_ns_per_m
        self._wall: Array | None = None

    def reset(self, position: Array) -> None:
        self._partner.reset(position)
        self._wall = None

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        if time < self._at:
            self._partner.force(time, position, velocity, out)
            return
        if self._wall is None:
            self._wall = position.copy()
        out[:] = self._carried + self._stiffness * (self._wall - position) - self._damping * velocity


class Switches:
    """Several partners one after the other: each takes over at its time, from where the object then is, within `blend_s`.

    later   (time [s], maker) in order of time; the next partner's own clock starts at 0 at that time
    """

    def __init__(self, first: Partner, later: Sequence[tuple[float, NextPartner]], blend_s: float = 0.3) -> None:
        times = [time for time, _ in later]
        if any(after - before < blend_s for before, after in pairwise(times)):
            raise ParameterError(f"partners who take over must be in order, {blend_s:g} s apart or more; got {times} s")
        self._first, self._later, self._blend = first, list(later), blend_s

    def reset(self, position: Array) -> None:
        self._first.reset(position)
        self._start = position.copy()
        self._old, self._now, self._since, self._next = self._first, self._first, 0.0, 0
        self._old_since = 0.0
        self._fading = np.zeros(len(position))

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        if self._next < len(self._later) and time >= self._later[self._next][0]:
            self._old, self._old_since = self._now, self._since
            self._now, self._since = self._later[self._next][1](self._start, position.copy()), time
            self._now.reset(position.copy())
            self._next += 1
        self._now.force(time - self._since, position, velocity, out)
        share = min((time - self._since) / self._blend, 1.0) if self._next else 1.0
        if share < 1.0:
            self._old.force(time - self._old_since, position, velocity, self._fading)
            out *= share
            out += (1.0 - share) * self._fading
