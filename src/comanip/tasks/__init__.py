"""Tasks as values: twelve that ship, one TOML file each in this folder (`parts.TASKS`), and any that a user writes."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from ..parts import TASKS, unknown
from .reading import read_task
from .value import Axis, Carried, Lessons, Obstacle, Partners, Phase, Success, Task
from .way import Drawn, Spread, Way, draw_lesson, draw_partner, retimed, spread, usual, way

__all__ = [
    "TASKS",
    "Axis",
    "Carried",
    "Drawn",
    "Lessons",
    "Obstacle",
    "Partners",
    "Phase",
    "Spread",
    "Success",
    "Task",
    "Way",
    "draw_lesson",
    "draw_partner",
    "named",
    "read_task",
    "retimed",
    "spread",
    "usual",
    "way",
]


def named(task: str | Path | Task) -> Task:
    """A task that ships by its name, a user's own by its file; a Task is what it is."""
    if isinstance(task, Task):
        return task
    if not isinstance(task, (str, Path)):
        raise unknown("task", task, TASKS, ", or the path of your own .toml file")
    if str(task) in TASKS:
        return _kept(str(TASKS[str(task)]))
    if str(task).endswith(".toml") or Path(task).is_file():
        return read_task(task)
    raise unknown("task", task, TASKS, ", or the path of your own .toml file")


@lru_cache(maxsize=64)
def _kept(file: str) -> Task:
    return read_task(file)
