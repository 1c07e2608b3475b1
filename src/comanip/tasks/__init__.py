"""Tasks as values: twelve that ship, one TOML file each in this folder, and any that a user writes."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from ..errors import ParameterError
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

FOLDER = Path(__file__).parent
_ORDER = (
    "lift", "lower", "lift-hold-lower", "two-stages", "slide", "round-the-corner", "pick-carry-place", "saw", "crank",
    "two-shelves", "turn", "door",
)  # fmt: skip


def _shipped() -> dict[str, Path]:
    """Name -> file, of every .toml in the folder: a new one costs its file."""
    found = {file.stem: file for file in sorted(FOLDER.glob("*.toml"))}
    return {name: found[name] for name in (*(n for n in _ORDER if n in found), *(n for n in found if n not in _ORDER))}


TASKS = _shipped()


def named(task: str | Path | Task) -> Task:
    """A task that ships by its name, a user's own by its file; a Task is what it is."""
    if isinstance(task, Task):
        return task
    if str(task) in TASKS:
        return _kept(str(TASKS[str(task)]))
    if str(task).endswith(".toml") or Path(task).is_file():
        return read_task(task)
    raise ParameterError(f"task {str(task)!r} is unknown; there are: {', '.join(TASKS)}, or the path of your own .toml file")


@lru_cache(maxsize=64)
def _kept(file: str) -> Task:
    return read_task(file)
