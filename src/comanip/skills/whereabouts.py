"""Where in the task is it, and to which goal does it lead? Eq. (4) over stations along the taught paths.

Position alone cannot tell on a path that returns, crosses itself or repeats. So each path is cut into stations of equal length, a
left-right chain that motion moves along, and the forward filter of eq. (4) says where on it the hand is:

    h_t(m) ~ [sum_n h_(t-1)(n) a_nm(v)] N(x; X_m, s_x) N(v; V_m, s_m)

a(v) moves on by the way that v leads along the path, back as well as forward; a rest moves nothing, however long. Speed counts as
evidence with the freedom that people take (`PACE`), but not rest, which may be anywhere. Several goals are one filter over the
stations of all: the share of each is the probability that the partner means it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np

from ..interfaces import Array
from ..kernels.copies import Copied
from ..signals.exponential import exponential, logarithm
from ..signals.vectors import dot, length, plain_sum
from .reference import PhaseReference

STATIONS = 160  # of all goals together; a tick looks at each
FINEST = 1.0 / 30.0  # share of the extent between stations
PERIOD_S = 0.02
MEMORY_S = 0.2  # samples closer than this repeat each other
POSITION = 0.12  # share of the extent that other people go more or less far
PACE = 0.35  # share of its speed that other people are slower or faster, and ...
SLOW_M_PER_S = 0.05  # ... what no speed is told from another by
RESTS_M_PER_S = 0.02  # slower than this is rest
GATE = 10.0  # [nats] most that one sample may favour one station over another
SLIPS = 0.1  # share of the way that may have gone back or ahead along the path: at a turn nothing else leads round
ASTRAY = 1e-6  # chance that motion came elsewhere than along the path
ABSURD_M = 1e6  # no robot is so far away or so fast: squares stay finite


class Whereabouts(Copied):
    """Probability of each station; `phase` [s] on the path of the likeliest `goal`, and `goals` (G,), the probability of each.

    memory   the stations' probabilities (M,), then the offset (d,) of where it began from the path, then: time to the next
             sample, goal, phase
    """

    def __init__(self, references: Sequence[PhaseReference], dt: float) -> None:
        self.references, self._dt = tuple(references), dt
        total = sum(r.length_m for r in references)
        place, velocity, rows = [], [], []
        self.first = [0]
        # one doubt for all goals: the wider of two Gaussians would explain whatever lies between them
        doubt = max(POSITION * max(r.extent_m for r in references), 1e-9)
        for r in self.references:
            spacing = max(total / (STATIONS - len(references)), FINEST * r.extent_m)
            count = max(round(r.length_m / spacing), 2)
            way = np.linspace(0.0, r.length_m, count + 1)
            phase = np.interp(way, r.way, r.step_s * np.arange(len(r.way)))
            phase[0], phase[-1] = 0.0, r.duration_s
            place += [r.floats_at("position", s) for s in phase]
            velocity += [r.floats_at("velocity", s) for s in phase]
            rows += [[s, way[1], doubt] for s in phase]
            self.first.append(len(place))
        d = len(place[0])
        speeds = [length(v) for v in velocity]
        headings = [h for low, high in pairwise(self.first) for h in _headings(place[low:high])]
        widths = [SLOW_M_PER_S + PACE * s for s in speeds]
        # position, velocity, heading (3 d), phase, spacing, doubt of position, of velocity, its logarithm
        self.stations = np.array(
            [[*p, *v, *h, *r, w, logarithm(w)] for p, v, h, r, w in zip(place, velocity, headings, rows, widths, strict=True)]
        )
        self._rows = [(row[:d], row[d : 2 * d], row[2 * d : 3 * d], *row[3 * d :]) for row in self.stations.tolist()]
        self.memory = np.zeros(len(place) + d + 3)
        self.probabilities, self._offset = self.memory[: len(place)], self.memory[len(place) : -3]
        self._until, self._goal, self._phase = self.memory[-3:].reshape(3, 1)
        self.goals = np.zeros(len(references))
        self.firsts = np.array(self.first, dtype=float)

    @property
    def goal(self) -> int:
        return int(self._goal[0])

    @property
    def phase(self) -> float:
        return float(self._phase[0])

    def reset(self, position: Array, goal: int, entry_s: Sequence[float]) -> None:
        """Rests at `position` (d,), which on the path to each goal is phase `entry_s` [s]; `goal` is the one to name first."""
        self.memory[:] = 0.0
        self._goal[0], self._phase[0] = goal, entry_s[goal]
        self._offset[:] = position - self.references[goal].at(self.references[goal].position, entry_s[goal])
        p = np.full(len(self.probabilities), 1e-3 / len(self.probabilities))
        for g, s in enumerate(entry_s):
            part = slice(self.first[g], self.first[g + 1])
            p[self.first[g] + int(np.abs(self.stations[part, -5] - s).argmin())] += 1.0
        self.probabilities[:] = p / plain_sum(p.tolist())
        self._tell()

    def step(self, position: list[float], velocity: list[float]) -> None:
        """Takes in where the hand is and how it moves, (d,) of finite numbers."""
        self._until[0] -= self._dt
        if self._until[0] > 1e-9:
            return
        x = [_within(p - o) for p, o in zip(position, self._offset.tolist(), strict=True)]
        v = [_within(c) for c in velocity]
        while self._until[0] <= 1e-9:
            self._until[0] += PERIOD_S
            self._sample(x, v)
        self._tell()
        reference = self.references[self.goal]
        best = self.first[self.goal] + int(self.probabilities[self.first[self.goal] : self.first[self.goal + 1]].argmax())
        self._phase[0] = reference.closest(np.array(x), self._rows[best][3])

    def _sample(self, x: list[float], v: list[float]) -> None:
        moved, moves = self._moved(v), length(v) > RESTS_M_PER_S
        said = [self._said(row, x, v if moves else None) for row in self._rows]
        best, worth, total = max(said), PERIOD_S / MEMORY_S, 0.0
        for m, (h, log_b) in enumerate(zip(moved, said, strict=True)):
            moved[m] = h * exponential(max(log_b - best, -GATE) * worth)
            total += moved[m]
        self.probabilities[:] = [h / total for h in moved]

    def _moved(self, v: list[float]) -> list[float]:
        """Where the stations' probabilities are led by the velocity."""
        h, rows = self.probabilities.tolist(), self._rows
        fresh, speed = ASTRAY / len(h), length(v)
        moved = [fresh] * len(h)
        for g in range(len(self.references)):
            low, high = self.first[g], self.first[g + 1] - 1
            for m in range(low, high + 1):
                _, _, heading, _, spacing, *_ = rows[m]
                on = min(max(dot(v, heading) * PERIOD_S / spacing, -1.0), 1.0)
                slips = min(SLIPS * speed * PERIOD_S / spacing, 0.25)
                goes = (1.0 - ASTRAY) * h[m]
                slipped = goes * slips
                moved[min(m + 1, high)] += slipped
                moved[max(m - 1, low)] += slipped
                goes *= 1.0 - 2.0 * slips
                if on >= 0.0:
                    moved[min(m + 1, high)] += goes * on
                    moved[m] += goes * (1.0 - on)
                else:
                    moved[max(m - 1, low)] -= goes * on
                    moved[m] += goes * (1.0 + on)
        return moved

    @staticmethod
    def _said(row: tuple[Any, ...], x: list[float], v: list[float] | None) -> float:
        place, velocity, _, _, _, doubt, width, log_width = row
        far = fast = 0.0
        for a, b in zip(x, place, strict=True):
            far += (a - b) * (a - b)
        if v is None:
            return -0.5 * (far / (doubt * doubt))
        for a, b in zip(v, velocity, strict=True):
            fast += (a - b) * (a - b)
        return -0.5 * (far / (doubt * doubt)) - 0.5 * (fast / (width * width)) - log_width

    def _tell(self) -> None:
        p, best = self.probabilities.tolist(), self.goal
        for g in range(len(self.references)):
            total = 0.0
            for h in p[self.first[g] : self.first[g + 1]]:
                total += h
            self.goals[g] = total
        for g, share in enumerate(self.goals.tolist()):
            if share > self.goals[best] + 0.1:  # or it would flicker between two that are as likely
                best = g
        self._goal[0] = best


def _headings(places: list[list[float]]) -> list[list[float]]:
    """The direction from each station to the next; of the last, as before it."""
    found = []
    for here, there in pairwise(places):
        way = [b - a for a, b in zip(here, there, strict=True)]
        size = length(way)
        found.append([c / size if size > 1e-12 else 0.0 for c in way])
    return [*found, found[-1]]


def _within(value: float) -> float:
    return min(max(value, -ABSURD_M), ABSURD_M) if isfinite(value) else 0.0
