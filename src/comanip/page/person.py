"""The person at the page's handle, in Python: the twin of `hand` and of the sensor's noise in page.c.

    f = K (p - q) + B (dp - dq), |f| <= cap      the pointer p, smoothed twice, pulls the hand q
    m ddq = f - s g                              the hand has a mass, and holds the object with a soft grip:
    g = K_g (q - x) + B_g (dq - dx)              x, the object's end
    pull on the object = s (g + carried)         s in [0, 1]: whether it holds, given and taken within `grip_s`

A mouse's force is not a hand's: K, B and the cap are chosen so that a pointer can do what a relaxed arm does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from ..interfaces import Array
from ..signals.vectors import length


@dataclass(frozen=True)
class Hand:
    """Numbers of the hand at the handle, as `page.c` names them."""

    hand_n_per_m: float = 80.0  # of an arm at its most relaxed, so that who goes along with the eye alone is no load
    hand_ns_per_m: float = 14.0
    hand_kg: float = 1.0
    hand_cap_n: float = 20.0  # a third of what the envelope bears
    grip_n_per_m: float = 2000.0
    grip_ns_per_m: float = 40.0
    smooth_s: float = 0.040  # twice: a pointer comes in steps, and not evenly
    hand_m_per_s: float = 0.33  # who sets out faster is not led, but pushed: a mouse jumps, and a hand does not
    grip_s: float = 0.15


class Handle:
    """The Partner that a pointer is: row n of `trace` (T, d) [m] is where it is in sub-step n; `holds` (T,) in [0, 1]."""

    def __init__(
        self, trace: Array, *, carried: Array, holds: Array | None = None, hand: Hand = Hand(), step_s: float = 0.001
    ) -> None:
        self.trace, self.carried, self.hand, self._step = trace, [float(c) for c in carried], hand, step_s
        self.holds = np.ones(len(trace)) if holds is None else holds

    def reset(self, position: Array) -> None:
        start = [float(p) for p in position]
        self._drawn, self._aim, self._place = list(start), list(start), list(start)
        self._speed, self._grip, self._n = [0.0] * len(start), 1.0, 0

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        hand, h, d = self.hand, self._step, len(self._aim)
        n = min(self._n, len(self.trace) - 1)
        self._n += 1
        mix, most, size = h / hand.smooth_s, h / hand.grip_s, 0.0
        self._grip += min(max(float(self.holds[n]) - self._grip, -most), most)
        stretch = [0.0] * d
        off = [float(p) - a for p, a in zip(self.trace[n], self._drawn, strict=True)]
        asked = mix * length(off)
        share = hand.hand_m_per_s * h / asked if asked > hand.hand_m_per_s * h else 1.0
        for i in range(d):
            before = self._aim[i]
            self._drawn[i] += share * mix * off[i]
            self._aim[i] += mix * (self._drawn[i] - self._aim[i])
            speed = (self._aim[i] - before) / h
            stretch[i] = hand.hand_n_per_m * (self._aim[i] - self._place[i]) + hand.hand_ns_per_m * (speed - self._speed[i])
            size += stretch[i] * stretch[i]
        size = sqrt(size)
        for i in range(d):
            if size > hand.hand_cap_n:
                stretch[i] *= hand.hand_cap_n / size
            far = self._place[i] - float(position[i])
            grips = self._grip * (hand.grip_n_per_m * far + hand.grip_ns_per_m * (self._speed[i] - float(velocity[i])))
            self._speed[i] += h * (stretch[i] - grips) / hand.hand_kg
            self._place[i] += h * self._speed[i]
            out[i] = grips + self._grip * self.carried[i]


class PageNoise(np.random.Generator):
    """The page's normal numbers: splitmix64, and the sum of twelve uniform ones less six, the same bits on every machine."""

    def __init__(self, seed: int) -> None:
        super().__init__(np.random.PCG64(0))
        self._state = int(seed) & _ALL

    def _uniform(self) -> float:
        self._state = (self._state + 0x9E3779B97F4A7C15) & _ALL
        z = self._state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & _ALL
        z = (z ^ z >> 27) * 0x94D049BB133111EB & _ALL
        return float((z ^ z >> 31) >> 11) * 2.0**-53

    def standard_normal(self, size: Any = None, dtype: Any = np.float64, out: Any = None) -> Any:
        n = 1 if size is None else int(np.prod(size))
        values = []
        for _ in range(n):
            total = 0.0
            for _ in range(12):
                total += self._uniform()
            values.append(total - 6.0)
        return values[0] if size is None else np.array(values).reshape(size)


_ALL = (1 << 64) - 1


def carried_by(mass_kg: float, gravity: Array, share: float = 0.5) -> Array:
    """(d,) [N] that a person who holds the other end carries of the object's weight."""
    return np.array([-(1.0 - share) * mass_kg * g for g in np.asarray(gravity).tolist()])
