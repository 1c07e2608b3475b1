"""Ways to mean it: what people make of a course that a task hands them. Each takes (course, rng) and gives the person's own."""

from __future__ import annotations

import numpy as np

from ..interfaces import Array
from .course import Course, minimum_jerk_way

LATE_S = (7.5, 12.0)
CRAWL_M_PER_S = 0.025


def as_told(course: Course, rng: np.random.Generator) -> Course:
    return course


def late(course: Course, rng: np.random.Generator) -> Course:
    """Starts 7.5-12 s after the run has begun."""
    return course.later(float(rng.uniform(*LATE_S)) - course.start_s)


def snatch(course: Course, rng: np.random.Generator) -> Course:
    """All of it in 0.6-0.9 s."""
    return course.along(minimum_jerk_way, duration_s=float(rng.uniform(0.6, 0.9)))


def crawl(course: Course, rng: np.random.Generator) -> Course:
    """At 2.5 cm/s, with short ramps."""
    return course.along(_even, duration_s=course.length_m / CRAWL_M_PER_S)


def even_speed(course: Course, rng: np.random.Generator) -> Course:
    """One speed all the way, with short ramps."""
    return course.along(_even)


def _even(s: Array) -> Array:
    ramp, top = 0.15, 1.0 / 0.85
    middle = top * (s - ramp / 2.0)
    middle = np.where(s < ramp, top * s * s / (2.0 * ramp), middle)
    return np.where(s > 1.0 - ramp, 1.0 - top * (1.0 - s) ** 2 / (2.0 * ramp), middle)


def quick_start(course: Course, rng: np.random.Generator) -> Course:
    """Fast first, then a long approach: 1.8 times the top speed, in a third of the time."""
    return course.along(lambda s: minimum_jerk_way(1.0 - (1.0 - s) ** 1.8))


def asymmetric(course: Course, rng: np.random.Generator) -> Course:
    """The speed's peak at 0.3-0.4 or at 0.6-0.7 of the time."""
    peak = float(rng.uniform(0.30, 0.40))
    power = np.log(0.5) / np.log(peak if rng.uniform() < 0.5 else 1.0 - peak)
    return course.along(lambda s: minimum_jerk_way(np.clip(s, 0.0, 1.0) ** power))


def two_submovements(course: Course, rng: np.random.Generator) -> Course:
    """A first move of 0.55-0.8 of the way, and a second that overlaps its end."""
    share, overlap = float(rng.uniform(0.55, 0.80)), float(rng.uniform(0.1, 0.3))
    first = 0.55 + overlap / 2.0
    start = first - overlap
    return course.along(
        lambda s: share * minimum_jerk_way(s / first) + (1.0 - share) * minimum_jerk_way((s - start) / (1.0 - start)),
        duration_s=1.2 * course.duration_s,
    )


def ratchet(course: Course, rng: np.random.Generator) -> Course:
    """Stop and go: three to five strokes with 0.15-0.4 s between."""
    n, pause = int(rng.integers(3, 6)), float(rng.uniform(0.15, 0.40))
    stroke = max(0.45, 1.3 * course.duration_s / n)
    whole = n * stroke + (n - 1) * pause

    def way(s: Array) -> Array:
        t = s * whole
        return np.mean([minimum_jerk_way((t - k * (stroke + pause)) / stroke) for k in range(n)], axis=0)

    return course.along(way, duration_s=whole)


def hesitate(course: Course, rng: np.random.Generator) -> Course:
    """Stops on the way for 0.8-2.5 s."""
    share, pause = float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.8, 2.5))
    first, rest = max(0.8, 1.3 * share * course.duration_s), max(0.8, 1.3 * (1.0 - share) * course.duration_s)
    whole = first + pause + rest

    def way(s: Array) -> Array:
        t = s * whole
        return share * minimum_jerk_way(t / first) + (1.0 - share) * minimum_jerk_way((t - first - pause) / rest)

    return course.along(way, duration_s=whole)


def reverse(course: Course, rng: np.random.Generator) -> Course:
    """Turns back on the way, and puts it where it was."""
    share = float(rng.uniform(0.3, 0.7))
    lasts = max(0.8, 1.3 * share * course.duration_s)
    return course.along(lambda s: share * (minimum_jerk_way(2.0 * s) - minimum_jerk_way(2.0 * s - 1.0)), duration_s=2.0 * lasts)


def fine_tune(course: Course, rng: np.random.Generator) -> Course:
    """Two or three small moves of 5-15 mm about the goal before it is good."""
    n, d = int(rng.integers(2, 4)), course.displacements_m.shape[1]
    direction = course.end / max(float(np.linalg.norm(course.end)), 1e-9)
    offs: list[Array] = []
    for k in range(n):
        any_way = rng.standard_normal(d)
        off = direction if d == 1 else 0.7 * direction + 0.3 * any_way / np.linalg.norm(any_way)
        offs.append((-1) ** k * float(rng.uniform(0.005, 0.015)) * off)
    offs.append(np.zeros(d))
    move, pause = 0.5, float(rng.uniform(0.1, 0.4))
    stop = course.stop_s + n * (move + pause)
    times = np.linspace(course.start_s, stop, round((stop - course.start_s) / 0.002) + 1)
    x = np.array([course.at(float(t))[0] for t in times])
    x += minimum_jerk_way((times - course.start_s) / course.duration_s)[:, None] * offs[0]
    for k in range(n):
        began = course.stop_s + pause + k * (move + pause)
        x += minimum_jerk_way((times - began) / move)[:, None] * (offs[k + 1] - offs[k])
    return Course(times, x)
