"""Ways to mean it: what people make of a course that a task hands them. Each takes (course, rng) and gives the person's own.

A course is a path and a tempo. `retimed` keeps the path and gives it another tempo, so every habit of timing (even speed, a
snatch, stop and go) works on a lift, on a turn of a crank and round a corner alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..interfaces import Array
from .intent import Course, Curve

Way = Callable[[Array], Array]  # share of the time (T,) -> share of the path (T,)
STEP_S = 0.002  # of sampled courses: a straight line between two samples is off by a h^2/8, 3 um at 5 m/s^2
LATE_S = (7.5, 12.0)
CRAWL_M_PER_S = 0.025


def minimum_jerk_way(s: Array) -> Array:
    """Share of the way behind at the share `s` of the time (T,); Flash and Hogan 1985."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (-15.0 + 6.0 * s)))


def lasting(course: Course) -> float:
    """How long it takes [s]."""
    return course.stop_s - course.start_s


def path(course: Course) -> tuple[Array, Array, Array]:
    """Times (T,) [s], displacements (T, d) [m], and the length (T,) [m] of the path so far."""
    times = np.linspace(course.start_s, course.stop_s, max(2, round(lasting(course) / STEP_S) + 1))
    x = course.sampled(times)
    return times, x, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])


def through(course: Course, start_s: float, duration_s: float, displacements: Array) -> Course:
    """Evenly sampled displacements (T, d) [m] as a course, for the same load as `course`."""
    step = duration_s / (len(displacements) - 1)
    return Course(curve=Curve.through(start_s, step, displacements), feedforward_kg=course.feedforward_kg)


def later(course: Course, by_s: float) -> Course:
    """The same, begun `by_s` later."""
    legs = tuple((start + by_s, duration, far) for start, duration, far in course.legs)
    curve = course.curve and replace(course.curve, start_s=course.curve.start_s + by_s)
    return replace(course, legs=legs, curve=curve)


def enlarged(course: Course, by: float) -> Course:
    """The same, `by` times as far."""
    legs = tuple((start, duration, tuple(by * one for one in far)) for start, duration, far in course.legs)
    curve = course.curve and replace(course.curve, table=by * course.curve.table)
    return replace(course, legs=legs, curve=curve)


def retimed(course: Course, way: Way, *, duration_s: float | None = None, start_s: float | None = None) -> Course:
    """The same path at another tempo: at the share s of the time, `way(s)` of the path's length is behind."""
    _, x, gone = path(course)
    duration = lasting(course) if duration_s is None else duration_s
    at = np.asarray(way(np.linspace(0.0, 1.0, max(2, round(duration / STEP_S) + 1)))) * gone[-1]
    moved = np.concatenate([[True], np.diff(gone) > 0.0])  # a pause has no length, and so no place on the path
    new = np.column_stack([np.interp(at, gone[moved], column[moved]) for column in x.T])
    return through(course, course.start_s if start_s is None else start_s, duration, new)


def as_told(course: Course, rng: np.random.Generator) -> Course:
    return course


def late(course: Course, rng: np.random.Generator) -> Course:
    """Starts 7.5-12 s after the run has begun."""
    return later(course, float(rng.uniform(*LATE_S)) - course.start_s)


def snatch(course: Course, rng: np.random.Generator) -> Course:
    """All of it in 0.6-0.9 s."""
    return retimed(course, minimum_jerk_way, duration_s=float(rng.uniform(0.6, 0.9)))


def crawl(course: Course, rng: np.random.Generator) -> Course:
    """At 2.5 cm/s, with short ramps."""
    return retimed(course, _even, duration_s=float(path(course)[2][-1]) / CRAWL_M_PER_S)


def even_speed(course: Course, rng: np.random.Generator) -> Course:
    """One speed all the way, with short ramps."""
    return retimed(course, _even)


def _even(s: Array) -> Array:
    ramp, top = 0.15, 1.0 / 0.85
    middle = top * (s - ramp / 2.0)
    middle = np.where(s < ramp, top * s * s / (2.0 * ramp), middle)
    return np.where(s > 1.0 - ramp, 1.0 - top * (1.0 - s) ** 2 / (2.0 * ramp), middle)


def quick_start(course: Course, rng: np.random.Generator) -> Course:
    """Fast first, then a long approach: 1.8 times the top speed, in a third of the time."""
    return retimed(course, lambda s: minimum_jerk_way(1.0 - (1.0 - s) ** 1.8))


def asymmetric(course: Course, rng: np.random.Generator) -> Course:
    """The speed's peak at 0.3-0.4 or at 0.6-0.7 of the time."""
    peak = float(rng.uniform(0.30, 0.40))
    power = np.log(0.5) / np.log(peak if rng.uniform() < 0.5 else 1.0 - peak)
    return retimed(course, lambda s: minimum_jerk_way(np.clip(s, 0.0, 1.0) ** power))


def two_submovements(course: Course, rng: np.random.Generator) -> Course:
    """A first move of 0.55-0.8 of the way, and a second that overlaps its end."""
    share, overlap = float(rng.uniform(0.55, 0.80)), float(rng.uniform(0.1, 0.3))
    first = 0.55 + overlap / 2.0
    start = first - overlap
    return retimed(
        course,
        lambda s: share * minimum_jerk_way(s / first) + (1.0 - share) * minimum_jerk_way((s - start) / (1.0 - start)),
        duration_s=1.2 * lasting(course),
    )


def ratchet(course: Course, rng: np.random.Generator) -> Course:
    """Stop and go: three to five strokes with 0.15-0.4 s between."""
    n, pause = int(rng.integers(3, 6)), float(rng.uniform(0.15, 0.40))
    stroke = max(0.45, 1.3 * lasting(course) / n)
    whole = n * stroke + (n - 1) * pause

    def way(s: Array) -> Array:
        t = s * whole
        return np.mean([minimum_jerk_way((t - k * (stroke + pause)) / stroke) for k in range(n)], axis=0)

    return retimed(course, way, duration_s=whole)


def hesitate(course: Course, rng: np.random.Generator) -> Course:
    """Stops on the way for 0.8-2.5 s."""
    share, pause = float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.8, 2.5))
    first, rest = max(0.8, 1.3 * share * lasting(course)), max(0.8, 1.3 * (1.0 - share) * lasting(course))
    whole = first + pause + rest

    def way(s: Array) -> Array:
        t = s * whole
        return share * minimum_jerk_way(t / first) + (1.0 - share) * minimum_jerk_way((t - first - pause) / rest)

    return retimed(course, way, duration_s=whole)


def reverse(course: Course, rng: np.random.Generator) -> Course:
    """Turns back on the way, and puts it where it was."""
    share = float(rng.uniform(0.3, 0.7))
    there = max(0.8, 1.3 * share * lasting(course))
    return retimed(
        course, lambda s: share * (minimum_jerk_way(2.0 * s) - minimum_jerk_way(2.0 * s - 1.0)), duration_s=2.0 * there
    )


def fine_tune(course: Course, rng: np.random.Generator) -> Course:
    """Two or three small moves of 5-15 mm about the goal before it is good."""
    n, d = int(rng.integers(2, 4)), course.n_axes
    direction = course.end / max(float(np.linalg.norm(course.end)), 1e-9)
    offs: list[Array] = []
    for k in range(n):
        any_way = rng.standard_normal(d)
        off = direction if d == 1 else 0.7 * direction + 0.3 * any_way / np.linalg.norm(any_way)
        offs.append((-1) ** k * float(rng.uniform(0.005, 0.015)) * off)
    offs.append(np.zeros(d))
    move, pause = 0.5, float(rng.uniform(0.1, 0.4))
    stop = course.stop_s + n * (move + pause)
    times = np.linspace(course.start_s, stop, round((stop - course.start_s) / STEP_S) + 1)
    x = course.sampled(times)
    x += minimum_jerk_way((times - course.start_s) / lasting(course))[:, None] * offs[0]
    for k in range(n):
        began = course.stop_s + pause + k * (move + pause)
        x += minimum_jerk_way((times - began) / move)[:, None] * (offs[k + 1] - offs[k])
    return through(course, course.start_s, stop - course.start_s, x)
