"""One picture of many tasks: the usual way of each, five lessons as drawn, what stands in the way, and where to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..interfaces import Array
from ..tasks import Drawn, Task, draw_lesson, usual, way
from .drawing import ASH, CLAY, INK, SAND, blank, taste

COLUMNS = 4
LESSONS = 5
CAPTION = (
    "Dark: the usual way from the hand's start; over time along one axis, else in the plane or in space. Light: five "
    "lessons as they are drawn. Grey: what the hand must not enter. Refuted as different tasks if one line does them all."
)


def tasks(some: Sequence[Task], seed: int = 0) -> Any:
    """A panel a task: over time where it moves along one axis, in the plane or in space where along two or three."""
    columns = min(COLUMNS, len(some))
    rows = -(-len(some) // columns)
    with taste():
        figure = blank(2.6 * columns, 2.3 * rows, caption=CAPTION)
        for n, task in enumerate(some, 1):
            spatial = sum(axis.kind == "length" for axis in task.axes_) > 2
            ax = figure.add_subplot(rows, columns, n, projection="3d" if spatial else None)
            _draw(ax, task, np.random.default_rng(seed))
    return figure


def _draw(ax: Any, task: Task, rng: np.random.Generator) -> None:
    goals = list(task.goals) or [""]
    lessons = [draw_lesson(task, rng) for _ in range(LESSONS)]
    if task.goals:
        lessons = [_to(goals[n % len(goals)], one) for n, one in enumerate(lessons)]
    for one in lessons:
        _line(ax, task, one, color=SAND, linewidth=0.9)
    for goal in goals:
        _line(ax, task, usual(task, goal), color=INK, linewidth=1.8)
    _obstacles(ax, task)
    title = task.name + (" (needs orientation)" if task.needs else "")
    ax.set_title(title)


def _to(goal: str, one: Drawn) -> Drawn:
    return Drawn(one.size_m, one.duration_s, one.onset_s, one.rest, goal, one.start, one.places)


def _line(ax: Any, task: Task, drawn: Drawn, **style: Any) -> None:
    course = way(task, drawn).course
    times = np.linspace(0.0, course.stop_s + 0.3, 400)
    moved = course.sampled(times)
    planar = _plane(task)
    if len(planar) == 1:
        ax.plot(times, moved[:, planar[0]], **style)
        ax.set_xlabel("s")
        ax.set_ylabel(f"{task.axes[planar[0]]} [{task.units[planar[0]]}]")
        return
    offset = np.array(drawn.start) if drawn.start is not None and task.fixed_places else np.zeros(len(task.axes))
    ax.plot(*(moved[:, i] + offset[i] for i in planar), **style)
    texts = [f"{task.axes[i]} [{task.units[i]}]" for i in planar]
    ax.set_xlabel(texts[0])
    ax.set_ylabel(texts[1])
    if style["color"] != INK:
        return
    if len(planar) == 3:  # beside its axis this name would lie on the next panel
        ax.text2D(0.98, 0.92, f"up: {texts[2]}", transform=ax.transAxes, ha="right", fontsize=8)
    _marks(ax, moved[:, planar], way(task, drawn).places[:, planar], task.cycles)
    ax.set_aspect("equal")


def _plane(task: Task) -> list[int]:
    """Columns that are drawn: all lengths, or the angle where there is nothing else."""
    lengths = [n for n, axis in enumerate(task.axes_) if axis.kind == "length"]
    return lengths[:3] or [0]


def _marks(ax: Any, moved: Array, places: Array, cycles: float) -> None:
    """Start, and the places on the way."""
    ax.plot(*(moved[:1, i] for i in range(moved.shape[1])), marker="o", color=INK, markersize=4)
    if not cycles:
        ax.plot(*(places[:, i] for i in range(places.shape[1])), linestyle="", marker="s", color=CLAY, markersize=3)


def _obstacles(ax: Any, task: Task) -> None:
    plane = _plane(task)
    if len(plane) < 2:
        return
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    names = [task.axes[i] for i in plane]
    for one in task.obstacles:
        if set(one.centre) == set(names[:2]) and len(plane) == 2:
            x, y = (one.centre[name] for name in names[:2])
            ax.fill(x + one.radius_m * np.cos(turn), y + one.radius_m * np.sin(turn), color=ASH, alpha=0.6)
