"""Optimal feedback control of the hand: no planned trajectory, only costs (Todorov and Jordan 2002, Todorov 2005).

States of an axis: distance to the target, velocity, muscle force, excitation (two lags of 40 ms). The person believes that the
hand is a mass, feels distance, velocity and force late and inexactly, estimates the state by a Kalman filter, foresees the
delay by the commands still on their way, and corrects by gains that minimise missing the target and effort:

    sum over [T, T + 0.3 s] of w_p e^2 + w_v v^2 + w_f f^2,  plus r u^2 all the time

So nothing pulls back on the way as long as the target can still be met: softer than any spring, firmer toward the end.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from .minds import Floats, Mind
from .plans import lasting, path

TICK_S = 0.01  # of the person's thought
LAG_S = 0.040
SETTLES_S = 0.30
VIA_S = 0.8  # on a path that bends: a target so far ahead, one after the other
STRAIGHT_M = 0.01
POSITION, VELOCITY, FORCE, COMMAND = 1.0, 0.04, 1e-4, 2e-7  # costs: at 1 m, 1 m/s, 1 N; and of 1 N for one tick
SENSES = (0.002, 0.02, 0.4)  # standard deviations of a tick's feeling: [m], [m/s], [N]
UNFORESEEN = (1e-6, 1e-3, 1.0, 1e-2)  # of a tick's process: variances


class Model(NamedTuple):
    """What the person believes one axis to do in a tick: z' = A z + B u, and how the felt (distance, speed, force) tells it."""

    a: Array  # (4, 4)
    b: Array  # (4,)
    hold: Array  # (4,) gains while nothing ends
    filter: Array  # (4, 3) Kalman gain


@lru_cache(maxsize=64)
def believed(mass_kg: float, damping_ns_per_m: float) -> Model:
    a = _exponential(np.array([
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, -damping_ns_per_m / mass_kg, 1.0 / mass_kg, 0.0, 0.0],
        [0.0, 0.0, -1.0 / LAG_S, 1.0 / LAG_S, 0.0],
        [0.0, 0.0, 0.0, -1.0 / LAG_S, 1.0 / LAG_S],
        [0.0, 0.0, 0.0, 0.0, 0.0],
    ]) * TICK_S)  # fmt: skip
    a, b = a[:4, :4], a[:4, 4]
    q = np.diag([POSITION, VELOCITY, FORCE, 0.0]) * TICK_S / SETTLES_S
    p = q
    for _ in range(400):
        gain, p = _riccati(a, b, q, p, 30.0 * COMMAND)
    feels, noise = np.eye(4)[:3], np.diag(np.square(SENSES))
    s = np.diag(UNFORESEEN)
    for _ in range(400):
        k = s @ feels.T @ np.linalg.inv(feels @ s @ feels.T + noise)
        s = a @ (s - k @ feels @ s) @ a.T + np.diag(UNFORESEEN)
    return Model(a, b, gain, k)


@lru_cache(maxsize=64)
def reaching(mass_kg: float, damping_ns_per_m: float, ticks: int) -> Array:
    """Gains (ticks + settling, 4) of a movement that has so long: from the last backward."""
    a, b, _, _ = believed(mass_kg, damping_ns_per_m)
    q = np.diag([POSITION, VELOCITY, FORCE, 0.0])
    settles = round(SETTLES_S / TICK_S)
    p, gains = q, []
    for n in range(ticks + settles):
        gain, p = _riccati(a, b, q if n < settles else 0.0 * q, p, COMMAND)
        gains.append(gain)
    return np.array(gains[::-1])


def _riccati(a: Array, b: Array, q: Array, p: Array, r: float) -> tuple[Array, Array]:
    """One step back: the gain of u = -gain z, and the cost to go."""
    pb = p @ b
    gain = (pb @ a) / (r + b @ pb)
    return gain, q + a.T @ p @ (a - np.outer(b, gain))


def _exponential(m: Array) -> Array:
    """exp(m) for a small m."""
    total, term = np.eye(len(m)), np.eye(len(m))
    for n in range(1, 16):
        term = term @ m / n
        total = total + term
    return total


class Optimal(Mind):
    """Optimal feedback with 120-200 ms of delay and noise that grows with the command."""

    believes_kg: float | None = None  # None: the arm and the whole object
    command_noise = 0.15
    damping = 8.0  # of the muscles themselves, at once

    def draw(self) -> None:
        self._late = max(1, round(float(self.rng.uniform(0.12, 0.20)) / TICK_S))
        mass = self.believes_kg or round(2.0 * (self.body.arm_kg + 2.0 * self.body.load_kg)) / 2.0
        self.model = believed(mass, self.damping)
        a, b = self.model.a, self.model.b
        powers = [np.linalg.matrix_power(a, n) @ b for n in range(self._late)]
        self._ahead, self._answers = np.linalg.matrix_power(a, self._late), np.column_stack(powers[::-1])  # (4, late)
        assert self.course is not None
        self._targets = [(start, stop, end, reaching(mass, self.damping, max(1, round((stop - start) / TICK_S))))
                         for start, stop, end in vias(self)]  # fmt: skip

    def begin(self) -> None:
        d = self.d
        self._state = np.zeros((4, d))  # as it was `late` ago; position from the start
        self._felt: deque[Array] = deque([np.zeros((3, d))] * (self._late + 1), maxlen=self._late + 1)
        self._commands: deque[Array] = deque([np.zeros(d)] * self._late, maxlen=self._late)
        self._u, self._muscle, self._excited = np.zeros(d).tolist(), [0.0] * d, [0.0] * d
        self._next = 0.0

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        if time >= self._next - 1e-9:
            self._next += TICK_S
            self._think(time, np.array([x, v, self._muscle]))
        share, out = self.step_s / LAG_S, []
        for i, u in enumerate(self._u):
            self._excited[i] += share * (u - self._excited[i])
            self._muscle[i] += share * (self._excited[i] - self._muscle[i])
            out.append(self._muscle[i] - self.damping * v[i])
        return out

    def _think(self, time: float, now: Array) -> None:
        model = self.model
        self._felt.append(now + np.array(SENSES)[:, None] * self.rng.standard_normal(now.shape))
        state = self._state + model.filter @ (self._felt[0] - self._state[:3])
        present = self._ahead @ state + self._answers @ np.array(self._commands)
        target, gain = self._wanted(time)
        present[0] -= target
        wanted = -(gain @ present)
        self._state = model.a @ state + np.outer(model.b, self._commands[0])
        self._commands.append(wanted)
        self._u = (wanted * (1.0 + self.command_noise * self.rng.standard_normal(self.d))).tolist()

    def _wanted(self, time: float) -> tuple[Array, Array]:
        """Where to, and with which gains: the movement's while it lasts, else those that hold."""
        begun = [one for one in self._targets if one[0] <= time]
        if not begun:
            return np.zeros(self.d), self.model.hold
        start, _, end, gains = begun[-1]
        n = int((time - start) / TICK_S)
        return end, gains[n] if n < len(gains) else self.model.hold


def vias(mind: Mind) -> Sequence[tuple[float, float, Array]]:
    """(start [s], stop [s], displacement (d,)) of the targets: the end alone where the path is straight, else some on the way."""
    course = mind.course
    assert course is not None
    _, x, _ = path(course)
    size = max(float(np.linalg.norm(course.end)), 1e-9)
    along = x @ (course.end / size)
    aside = np.linalg.norm(x - np.outer(along, course.end / size), axis=1).max()
    if aside < STRAIGHT_M and (along - np.maximum.accumulate(along)).min() > -STRAIGHT_M:
        return [(course.start_s, course.stop_s, course.end)]
    ends = np.linspace(course.start_s, course.stop_s, max(2, round(lasting(course) / VIA_S)) + 1).tolist()
    return [(a, b, np.array(course.at(b)[0])) for a, b in pairwise(ends)]
