"""tasks: what there is to do, listed and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..tasks import TASKS, Task, named
from .console import print_json, table


def tasks(names: Sequence[str], plot: Path | None, json: bool) -> None:
    found = [named(name) for name in names or TASKS]
    if plot is not None:
        from ..evaluation import drawing
        from ..evaluation.tasks import tasks as picture

        drawing.save(picture(found), plot)
    if json:
        print_json({task.name: _about(task) | ({"picture": str(plot)} if plot is not None else {}) for task in found})
        return
    rows = [(task.name, ", ".join(task.axes), f"{task.moving_s + task.rests_s:.3g}", _parts(task), task.about) for task in found]
    table("Tasks", ("name", "axes", "s", "goes", "what"), rows)
    for task in found:
        if task.needs:
            print(f"{task.name} cannot be run yet: it needs {task.needs}")
    if plot is not None:
        print(plot)


def _about(task: Task) -> dict[str, Any]:
    return {
        "about": task.about,
        "axes": dict(zip(task.axes, task.units, strict=True)),
        "start": task.start.tolist(),
        "gravity_m_per_s2": task.gravity.tolist(),
        "size_m": task.size_m,
        "duration_s": task.moving_s + task.rests_s,
        "phases": [phase.kind for phase in task.phases],
        "goals": {name: list(place) for name, place in task.goals.items()},
        "obstacles": {one.name: {"centre": dict(one.centre), "radius_m": one.radius_m} for one in task.obstacles},
        "cycles": task.cycles,
        "runs_here": not task.needs,
        "needs": task.needs,
        "file": task.source,
    }


def _parts(task: Task) -> str:
    """The phases in a word each, with how often."""
    said = [f"{phase.kind} x {phase.cycles:g}" if phase.cycles != 1.0 else phase.kind for phase in task.phases]
    if task.goals:
        said[-1] += f" to {' or '.join(task.goals)}"
    if task.obstacles:
        said.append(f"past {', '.join(one.name for one in task.obstacles)}")
    return ", ".join(said)
