"""Lessons of many tasks in d axes, made from formulas, and partners for them on the exact beam: one vector person for all."""

from __future__ import annotations

from collections import deque
from math import exp, pi, sqrt

import numpy as np

from comanip.interaction import TaringInteractionForce, gravity_along
from comanip.interfaces import STANDARD_GRAVITY
from comanip.lessons.demonstration import Demonstration
from comanip.loop import run
from comanip.plants.beam import BeamPlant

STEP_S = 0.001
TASKS = {  # axes, and legs (start [s], duration [s], displacement (d,) [m])
    "lift": (("z",), [(0.0, 2.2, (0.3,))]),
    "lower": (("z",), [(0.0, 2.2, (-0.3,))]),
    "slide": (("x",), [(0.0, 2.2, (-0.3,))]),
    "two stages": (("z",), [(0.0, 1.5, (0.15,)), (2.5, 1.5, (0.15,))]),
    "lift, hold, lower": (("z",), [(0.0, 2.0, (0.3,)), (4.0, 2.0, (-0.3,))]),
    "corner": (("x", "y"), [(0.0, 1.8, (0.3, 0.0)), (1.44, 1.8, (0.0, 0.3))]),
    "pick, carry, place": (("x", "y", "z"), [(0.0, 1.3, (0, 0, 0.15)), (1.0, 2.3, (0.4, 0.2, 0)), (3.1, 1.3, (0, 0, -0.12))]),
    "saw": (("x",), [(0.9 * k, 0.9, (0.2 * (-1) ** k,)) for k in range(10)]),
}


def minimum_jerk(s):
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 + s * (-15.0 + 6.0 * s))


def course(legs, size=1.0, pace=1.0):
    """Displacement (N, d) every STEP_S of somebody `size` times as large and `pace` times as slow."""
    time = np.arange(0.0, pace * max(s + t for s, t, _ in legs) + 1e-9, STEP_S)
    return sum(minimum_jerk((time - pace * s) / (pace * t))[:, None] * size * np.array(f, dtype=float) for s, t, f in legs)


def crank(size=1.0, pace=1.0, turns=5, radius_m=0.12):
    """The same of turns in a plane (N, 2)."""
    duration = 2.0 * pace * (turns + 0.5)
    time = np.arange(0.0, duration, STEP_S)
    rate = np.clip(np.minimum(time, duration - time) / pace, 0.0, 1.0)
    angle = np.cumsum(rate * rate * (3.0 - 2.0 * rate))
    angle *= 2.0 * pi * turns / angle[-1]
    return size * radius_m * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])


def lesson(way, axes, role, rng, name="lesson", turned=None):
    """At 100 Hz, with rest before and after; the partner resists a leader, and pulls a follower, by 12 N s/m of speed."""
    onset, d = rng.uniform(0.4, 1.2), way.shape[1]
    way = np.vstack([np.zeros((round(onset / STEP_S), d)), way, np.tile(way[-1], (1000, 1))])[::10]
    x = 0.85 + 0.01 * rng.normal(size=d) + way + 1e-4 * rng.normal(size=way.shape)
    v = np.gradient(way, 0.01, axis=0)
    force = (-12.0 if role == "leader" else 12.0) * v + 0.1 * rng.normal(size=way.shape)
    v = v + 1e-3 * rng.normal(size=way.shape)
    turned = np.eye(d) if turned is None else turned
    signals = {"position": x @ turned.T, "force": force @ turned.T, "velocity": v @ turned.T}
    return Demonstration(name, 0.01, signals, axes, role, units={"position": "m", "force": "N", "velocity": "m/s"})


def lessons(task, role, seed=0, n=5, turned=None):
    """Lessons of a task by name, each of its own size (0.92 to 1.08) and pace (0.85 to 1.15)."""
    rng = np.random.default_rng([seed, role == "leader"])
    made = []
    for k in range(n):
        size, pace = rng.uniform(0.92, 1.08), rng.uniform(0.85, 1.15)
        axes, way = (("x", "z"), crank(size, pace)) if task == "crank" else (TASKS[task][0], course(TASKS[task][1], size, pace))
        made.append(lesson(way, axes, role, rng, f"{task} {k}", turned))
    return made


class Person:
    """An impedance around a course of his own, or around a point that yields to what he feels; in d axes."""

    def __init__(self, axes, rng, way=None, onset_s=1.0, stiffness=120.0, damping=20.0, mass_kg=2.0):
        self._carried = np.array([0.5 * mass_kg * STANDARD_GRAVITY if a == "z" else 0.0 for a in axes])
        self._way, self._onset, self._k, self._b, self._rng = way, onset_s, stiffness, damping, rng
        self._share = 0.5 * mass_kg

    def reset(self, position):
        d = len(position)
        self._origin, self._at, self._speed = position.copy(), np.zeros(d), np.zeros(d)
        self._felt, self._moved = np.zeros(d), np.zeros(d)
        self._past = deque([(np.zeros(d), np.zeros(d))] * 150, maxlen=150)

    def force(self, time, position, velocity, out):
        if self._way is not None:
            n = int(np.clip((time - self._onset) / STEP_S, 1, len(self._way) - 2))
            at = self._way[n] if time >= self._onset else self._way[0]
            moving = self._onset < time < self._onset + len(self._way) * STEP_S
            speed = (self._way[n + 1] - self._way[n - 1]) / (2 * STEP_S) * moving
            meant = (self._way[n + 1] - 2 * self._way[n] + self._way[n - 1]) / STEP_S**2 * moving
        else:
            pull, seen = self._past[0]
            size = sqrt(pull @ pull)
            wish = (pull * max(1.0 - 0.8 / size, 0.0) if size > 0.0 else pull) / 25.0 + 0.5 * seen
            self._speed = self._speed + 0.01 * (wish - self._speed)
            self._at = self._at + STEP_S * self._speed
            at, speed, meant = self._at, self._speed, 0.0
        expected = self._carried + self._share * meant
        out[:] = self._k * (self._origin + at - position) + self._b * (speed - velocity) + expected
        mix = 1.0 - exp(-2 * pi * 6.0 * STEP_S)
        self._felt = self._felt + mix * (expected - out - self._felt)
        self._moved = self._moved + mix * (velocity - self._moved)
        self._past.append((self._felt, self._moved))


def carry(skill, axes, seconds, *, way=None, onset_s=1.0, start=0.85, dt=0.01, seed=0):
    """The recording of a run with somebody who leads along `way` (N, d), or follows."""
    rng = np.random.default_rng(seed)
    leads = {} if way is not None else {"stiffness": 90.0, "damping": 22.0}
    person = Person(axes, rng, way, onset_s, **leads)
    begin = np.broadcast_to(np.asarray(start, dtype=float), (len(axes),)).copy()
    plant = BeamPlant(person, axes=axes, start_position=begin, dt=dt, rng=rng)
    estimator = TaringInteractionForce(dt, gravity=gravity_along(axes).tolist(), cutoff_hz=15.0)
    return run(plant, skill, duration_s=seconds, estimator=estimator)
