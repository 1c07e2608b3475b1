"""From a task and a draw to a way: the course that somebody means to go, and the places that it visits in order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import NamedTuple

import numpy as np

from ..errors import check_generator
from ..interfaces import Array
from ..people.intent import Course, Curve, minimum_jerk
from .value import RAMP, Phase, Task

STEP_S = 0.005  # of sampled curves
QUARTERS = 4  # places that a turn visits


@dataclass(frozen=True)
class Drawn:
    """One way through a task: what varies from lesson to lesson and from partner to partner.

    size_m      how far it goes, in the measure of `Task.size_m`
    duration_s  of the motion without its rests
    rest        factor of the usual rests
    goal        which of the task's goals; "" where there is one
    start       (d,) displacement of the hand from the usual start
    places      (n, d) added to the places that phases end at, one row a phase; None adds nothing
    """

    size_m: float
    duration_s: float
    onset_s: float
    rest: float = 1.0
    goal: str = ""
    start: tuple[float, ...] | None = None
    places: tuple[tuple[float, ...], ...] | None = None


class Way(NamedTuple):
    """course, and what it visits: places (n, d) from the start in order; rests (n,) [s] that are meant at each of them."""

    course: Course
    places: Array
    rests: Array


def usual(task: Task, goal: str = "") -> Drawn:
    """The task's own numbers."""
    return Drawn(task.size_m, task.moving_s, 0.0, goal=goal)


@dataclass(frozen=True)
class Spread:
    """What one lesson is drawn from: (mean, standard deviation), (low, high) of the onset, and the shortest duration."""

    size_m: tuple[float, float]
    duration_s: tuple[float, float]
    shortest_s: float
    onset_s: tuple[float, float]


def spread(task: Task) -> Spread:
    """The task's own."""
    one = task.lessons
    return Spread((task.size_m, one.size_sd_m), (task.moving_s, one.duration_sd_s), one.shortest_s, one.onset_s)


def draw_lesson(task: Task, rng: np.random.Generator, of: Spread | None = None) -> Drawn:
    """One lesson; `of` for people who differ from the usual."""
    check_generator(rng)
    of, one = of or spread(task), task.lessons
    size_m = float(rng.normal(*of.size_m))
    duration = max(of.shortest_s, float(rng.normal(*of.duration_s)))
    drawn = Drawn(size_m, duration, float(rng.uniform(*of.onset_s)))
    rest = max(0.3, float(rng.normal(1.0, one.rest_sd))) if one.rest_sd else 1.0
    return _with_places(task, replace(drawn, rest=rest), rng, one.start_sd_m, one.place_sd_m)


def draw_partner(task: Task, rng: np.random.Generator, size_m: float, duration_s: float, onset_s: float) -> Drawn:
    """One partner of a trial, whose size, duration and onset have been drawn already."""
    check_generator(rng)
    one = task.partners
    rest = float(rng.uniform(*one.rest))
    return _with_places(task, Drawn(size_m, duration_s, onset_s, rest=rest), rng, one.start_sd_m, one.place_sd_m)


def _with_places(task: Task, drawn: Drawn, rng: np.random.Generator, start_sd: float, place_sd: float) -> Drawn:
    d, names = len(task.axes), list(task.goals)
    goal = names[int(rng.integers(len(names)))] if names else ""
    places = tuple(tuple(row) for row in rng.normal(0.0, place_sd, (len(task.phases), d)).tolist()) if place_sd else None
    start = tuple(rng.normal(0.0, start_sd, d).tolist())
    return replace(drawn, goal=goal, start=start, places=places)


def way(task: Task, drawn: Drawn, feedforward_kg: float = 1.0) -> Way:
    """The way of this draw, from the hand's own start on."""
    d = len(task.axes)
    made = _Making(task, drawn)
    if task.fixed_places and drawn.start is not None:
        made.shift = -np.array(drawn.start)
    for n, phase in enumerate(task.phases):
        shake = np.zeros(d) if drawn.places is None else np.array(drawn.places[n])
        _MAKERS[phase.kind](made, phase, task.goals.get(drawn.goal), shake, drawn)
    curve = _joined(made.curves) if made.curves else None
    course = Course(tuple(made.legs), curve, feedforward_kg)
    places = np.array(made.places).reshape(-1, d)
    for n, passed_s in made.rounded:
        places[n] = course.at(passed_s)[0]
    return Way(course, places, np.array(made.rests))


class _Making:
    """A way that grows phase by phase."""

    def __init__(self, task: Task, drawn: Drawn) -> None:
        self._task, self._drawn = task, drawn
        self.time, self.place = drawn.onset_s, np.zeros(len(task.axes))
        self.shift = np.zeros_like(self.place)
        self.legs: list[tuple[float, float, tuple[float, ...]]] = []
        self.curves: list[tuple[float, Array]] = []
        self.places: list[Array] = []
        self.rests: list[float] = []
        self.rounded: list[tuple[int, float]] = []  # which place is a corner that is only passed, and when

    def sized(self, displacement: tuple[float, ...]) -> Array:
        """(d,) of the task as large as drawn: shares of its size first, so that the usual way of one move is drawn exactly."""
        return np.array(displacement) / self._task.size_m * self._drawn.size_m

    def paced(self, duration_s: float) -> float:
        return duration_s / self._task.moving_s * self._drawn.duration_s

    def go(self, target: Array, duration_s: float, overlap_s: float = 0.0) -> None:
        start = self.time - overlap_s
        if overlap_s:
            self.rounded.append((len(self.places) - 1, self.time - 0.5 * overlap_s))
        self.legs.append((start, duration_s, tuple((target - self.place).tolist())))
        self.time, self.place = start + duration_s, target
        self.visit(target)

    def visit(self, place: Array) -> None:
        self.places.append(place)
        self.rests.append(0.0)


def _move(made: _Making, phase: Phase, goal: tuple[float, ...] | None, shake: Array, drawn: Drawn) -> None:
    to = phase.to if phase.to is not None else goal
    assert to is not None
    made.go(made.sized(to) + made.shift + shake, made.paced(phase.duration_s), made.paced(phase.overlap_s))


def _rest(made: _Making, phase: Phase, goal: tuple[float, ...] | None, shake: Array, drawn: Drawn) -> None:
    made.time += phase.duration_s * drawn.rest
    made.rests[-1] += phase.duration_s * drawn.rest


def _strokes(made: _Making, phase: Phase, goal: tuple[float, ...] | None, shake: Array, drawn: Drawn) -> None:
    assert phase.to is not None
    near, far = made.place, made.sized(phase.to) + made.shift + shake
    for _ in range(round(phase.cycles)):
        made.go(far, 0.5 * made.paced(phase.duration_s))
        made.go(near, 0.5 * made.paced(phase.duration_s))


def _circle(made: _Making, phase: Phase, goal: tuple[float, ...] | None, shake: Array, drawn: Drawn) -> None:
    turn_s = made.paced(phase.duration_s)
    steps = max(round(turn_s * (phase.cycles + RAMP) / STEP_S), 2)
    angle = 2.0 * pi * _turned(np.linspace(0.0, phase.cycles + RAMP, steps + 1), phase.cycles)
    out, side = made.sized(phase.centre) + shake, made.sized(phase.towards)
    made.curves.append((made.time, out * (1.0 - np.cos(angle))[:, None] + side * np.sin(angle)[:, None]))
    for quarter in range(1, round(QUARTERS * phase.cycles) + 1):
        turned = 2.0 * pi * quarter / QUARTERS
        made.visit(made.place + out * (1.0 - np.cos(turned)) + side * np.sin(turned))
    made.time += STEP_S * steps
    made.place = made.place + made.curves[-1][1][-1]


def _turned(turns_s: Array, turns: float) -> Array:
    """Turns (T,) after `turns_s` usual turns' time: a constant rate, reached and left within RAMP."""
    up = np.minimum(turns_s / RAMP, 1.0)
    down = np.clip((turns_s - turns) / RAMP, 0.0, 1.0)
    # the integral of the smooth step 3 u^2 - 2 u^3 is u^3 - u^4 / 2
    rising = RAMP * (up**3 - 0.5 * up**4) + np.maximum(turns_s - RAMP, 0.0)
    return np.asarray(rising - RAMP * (down**3 - 0.5 * down**4))


def _joined(curves: list[tuple[float, Array]]) -> Curve:
    """One curve from those of several phases, each held after its end."""
    begin = curves[0][0]
    steps = max(round((start - begin) / STEP_S) + len(moved) for start, moved in curves)
    whole = np.zeros((steps, curves[0][1].shape[1]))
    for start, moved in curves:
        at = round((start - begin) / STEP_S)
        whole[at : at + len(moved)] += moved
        whole[at + len(moved) :] += moved[-1]
    return Curve.through(begin, STEP_S, whole)


_MAKERS = {"move": _move, "rest": _rest, "strokes": _strokes, "circle": _circle}


def retimed(course: Course, knots: list[tuple[float, float, float]]) -> Course:
    """The same places at other times: knots (start [s], duration [s], how much of the course's own time [s], may be negative)
    are minimum-jerk legs of the course's clock, which begins at its start."""
    begin, stop = min(start for start, _, _ in knots), max(start + duration for start, duration, _ in knots)
    times = begin + STEP_S * np.arange(round((stop - begin) / STEP_S) + 1)
    own = np.array([sum(far * minimum_jerk((t - start) / duration)[0] for start, duration, far in knots) for t in times.tolist()])
    own[0], own[-1] = 0.0, sum(far for _, _, far in knots)
    curve = Curve.through(begin, STEP_S, course.sampled(course.start_s + own))
    return Course((), curve, course.feedforward_kg)
