"""A task from its TOML file: every key is checked, and what cannot be used is one line that names file and key."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from .value import ANGLE, LENGTH, Axis, Carried, Lessons, Obstacle, Partners, Phase, Success, Task
from .way import STEP_S, usual, way

MOST_AXES = 6
MOST_CYCLES = 1000
MOST = 1e6  # no task is so large or so heavy, in any unit,
MOST_S = 3600.0  # and none so long: its ways are sampled
TOP = ("name", "about", "fixed_places", "axes", "object", "phases", "goals", "obstacles", "success", "lessons", "partners")
NEEDED = {
    "move": ("duration_s",),
    "rest": ("duration_s",),
    "strokes": ("to", "cycles", "duration_s"),
    "circle": ("centre", "towards", "turns", "duration_s"),
}
ALLOWED = {
    "move": ("to", "duration_s", "overlap_s"),
    "rest": ("duration_s",),
    "strokes": ("to", "cycles", "duration_s"),
    "circle": ("centre", "towards", "turns", "duration_s"),
}


def read_task(file: str | Path) -> Task:
    """The task that `file` describes. Raises ParameterError, one line with file and key."""
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror or error}; a task is a TOML file, see docs/tasks.md") from None
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path}: byte {error.start} is not UTF-8; a task is a TOML file, see docs/tasks.md") from None
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ParameterError(f"{path}: not TOML: {error}") from None
    return _Reader(str(path), path.stem).task(table)


class _Reader:
    """Knows which file it reads, for the messages."""

    def __init__(self, source: str, stem: str) -> None:
        self.source, self.stem = source, stem
        self.axes: tuple[Axis, ...] = ()

    def task(self, table: Mapping[str, Any]) -> Task:
        self._known(table, "", TOP, needed=("axes", "phases"))
        self.axes = self._axes(self._table(table["axes"], "axes"))
        goals = {name: self._place(at, f"goals.{name}") for name, at in self._table(table.get("goals", {}), "goals").items()}
        made = Task(
            name=self._text(table.get("name", self.stem), "name"),
            about=self._text(table.get("about", ""), "about"),
            axes_=self.axes,
            phases=self._phases(table["phases"], goals),
            goals=goals,
            carried=self._carried(self._table(table.get("object", {}), "object")),
            obstacles=self._obstacles(self._table(table.get("obstacles", {}), "obstacles")),
            success=self._values(table.get("success", {}), "success", Success),
            lessons=self._values(table.get("lessons", {}), "lessons", Lessons),
            partners=self._values(table.get("partners", {}), "partners", Partners),
            fixed_places=self._flag(table.get("fixed_places", False), "fixed_places"),
            source=self.source,
        )
        self._consistent(made)
        return made

    def _fail(self, key: str, what: str) -> ParameterError:
        return ParameterError(f"{self.source}: {key}: {what}" if key else f"{self.source}: {what}")

    def _known(self, table: Mapping[str, Any], key: str, allowed: tuple[str, ...], needed: tuple[str, ...] = ()) -> None:
        at = f"{key}." if key else ""
        for name in table:
            if name not in allowed:
                raise self._fail(f"{at}{name}", f"unknown key; there are: {', '.join(allowed)}")
        for name in needed:
            if name not in table:
                raise self._fail(f"{at}{name}", "is missing")

    def _table(self, value: Any, key: str) -> Mapping[str, Any]:
        if not isinstance(value, Mapping):
            raise self._fail(key, f"must be a table; got {value!r}")
        return value

    def _text(self, value: Any, key: str) -> str:
        if not isinstance(value, str) or (key == "name" and not value.strip()):
            raise self._fail(key, f"must be a text; got {value!r}")
        return value

    def _flag(self, value: Any, key: str) -> bool:
        if not isinstance(value, bool):
            raise self._fail(key, f"must be true or false; got {value!r}")
        return value

    def _number(
        self, value: Any, key: str, *, above: float | None = None, least: float | None = None, most: float = MOST
    ) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
            raise self._fail(key, f"must be a finite number; got {value!r}")
        if (above is not None and not value > above) or (least is not None and not value >= least) or abs(value) > most:
            low = f"> {above:g}" if above is not None else f">= {-most if least is None else least:g}"
            raise self._fail(key, f"is {value:g}; allowed: {low} and <= {most:g}")
        return float(value)

    def _axes(self, table: Mapping[str, Any]) -> tuple[Axis, ...]:
        if not 1 <= len(table) <= MOST_AXES:
            raise self._fail("axes", f"a task has 1 to {MOST_AXES} axes; got {len(table)}")
        axes = []
        for name, value in table.items():
            key = f"axes.{name}"
            one = self._table(value, key)
            self._known(one, key, ("kind", "start", "up", "lever_m"))
            kind = self._text(one.get("kind", LENGTH), f"{key}.kind")
            if kind not in (LENGTH, ANGLE):
                raise self._fail(f"{key}.kind", f"is {kind!r}; allowed: {LENGTH}, {ANGLE}")
            up = self._number(one.get("up", 0.0), f"{key}.up", least=-1.0, most=1.0)
            if kind == ANGLE and up:
                raise self._fail(f"{key}.up", "an angle has no weight along it; leave it out")
            if kind == LENGTH and "lever_m" in one:
                raise self._fail(f"{key}.lever_m", "only an angle has a lever; leave it out")
            lever = self._number(one.get("lever_m", Axis.lever_m), f"{key}.lever_m", above=0.0)
            axes.append(Axis(name, kind, self._number(one.get("start", 0.0), f"{key}.start"), up, lever))
        if sum(axis.up**2 for axis in axes) > 1.0 + 1e-9:
            raise self._fail("axes", "the squares of `up` must not add up to more than 1: there is one vertical")
        return tuple(axes)

    def _axis_names(self) -> str:
        return ", ".join(axis.name for axis in self.axes)

    def _named(self, value: Any, key: str) -> dict[str, float]:
        """{axis: number} with axes of this task only."""
        table = self._table(value, key)
        names = [axis.name for axis in self.axes]
        for name in table:
            if name not in names:
                raise self._fail(f"{key}.{name}", f"unknown axis; this task has: {', '.join(names)}")
        if not table:
            raise self._fail(key, f"names no axis; this task has: {', '.join(names)}")
        return {name: self._number(value, f"{key}.{name}") for name, value in table.items()}

    def _place(self, value: Any, key: str) -> tuple[float, ...]:
        named = self._named(value, key)
        return tuple(named.get(axis.name, 0.0) for axis in self.axes)

    def _phases(self, value: Any, goals: Mapping[str, Any]) -> tuple[Phase, ...]:
        if not isinstance(value, list) or not value:
            raise self._fail("phases", f"must be one or more [[phases]]; got {value!r}")
        phases: list[Phase] = []
        for n, one in enumerate(value, 1):
            phases.append(self._phase(self._table(one, f"phases[{n}]"), f"phases[{n}]", goals, phases))
        if all(phase.kind == "rest" for phase in phases):
            raise self._fail("phases", "only rests: a task has to go somewhere")
        return tuple(phases)

    def _phase(self, one: Mapping[str, Any], key: str, goals: Mapping[str, Any], before: list[Phase]) -> Phase:
        kind = self._text(one.get("kind", "move"), f"{key}.kind")
        if kind not in NEEDED:
            raise self._fail(f"{key}.kind", f"is {kind!r}; allowed: {', '.join(NEEDED)}")
        self._known(one, key, ("kind", *ALLOWED[kind]), NEEDED[kind])
        duration = self._number(one["duration_s"], f"{key}.duration_s", above=0.0, most=MOST_S)
        if kind == "rest":
            if not before:
                raise self._fail(key, "a task begins with a motion; a partner's onset is drawn (partners.onset_s)")
            return Phase(kind, duration)
        if kind == "circle":
            turns = self._number(one["turns"], f"{key}.turns", above=0.0, most=MOST_CYCLES)
            places = {name: self._place(one[name], f"{key}.{name}") for name in ("centre", "towards")}
            for name, place in places.items():
                if not any(place):
                    raise self._fail(f"{key}.{name}", "must not be zero")
            return Phase(kind, duration, centre=places["centre"], towards=places["towards"], cycles=turns)
        if kind == "move" and "to" not in one and not goals:
            raise self._fail(f"{key}.to", "is missing, and there are no [goals] to go to")
        to = self._place(one["to"], f"{key}.to") if "to" in one else None
        overlap = self._number(one.get("overlap_s", 0.0), f"{key}.overlap_s", least=0.0)
        if overlap and (not before or before[-1].kind != "move" or overlap >= min(duration, before[-1].duration_s)):
            raise self._fail(f"{key}.overlap_s", "needs a move before this one, and both must last longer than it")
        cycles = 1.0
        if kind == "strokes":
            cycles = self._number(one["cycles"], f"{key}.cycles", least=1.0, most=MOST_CYCLES)
            if cycles != round(cycles):
                raise self._fail(f"{key}.cycles", f"is {cycles:g}; allowed: whole numbers")
        return Phase(kind, duration, to=to, overlap_s=overlap, cycles=cycles)

    def _carried(self, table: Mapping[str, Any]) -> Carried:
        made: Carried = self._values(table, "object", Carried)
        if made.along and made.along not in [axis.name for axis in self.axes]:
            raise self._fail("object.along", f"is {made.along!r}, an unknown axis; this task has: {self._axis_names()}")
        if made.share > 1.0:
            raise self._fail("object.share", f"is {made.share:g}; allowed: 0 to 1")
        for name in ("mass_kg", "length_m", "width_m"):
            if not getattr(made, name) > 0.0:
                raise self._fail(f"object.{name}", f"is {getattr(made, name):g}; allowed: > 0")
        return made

    def _obstacles(self, table: Mapping[str, Any]) -> tuple[Obstacle, ...]:
        found = []
        for name, value in table.items():
            key = f"obstacles.{name}"
            one = self._table(value, key)
            self._known(one, key, ("centre", "radius_m"), ("centre", "radius_m"))
            centre = self._named(one["centre"], f"{key}.centre")
            found.append(Obstacle(name, centre, self._number(one["radius_m"], f"{key}.radius_m", above=0.0)))
        return tuple(found)

    def _values(self, value: Any, key: str, kind: type) -> Any:
        """A dataclass of numbers, (low, high) pairs and texts; a default tells which."""
        table = self._table(value, key)
        known = {f.name: f.default if f.default is not MISSING else None for f in fields(kind)}
        self._known(table, key, tuple(known))
        made: dict[str, Any] = {}
        for name, given in table.items():
            at, default = f"{key}.{name}", known[name]
            if isinstance(default, str):
                made[name] = self._text(given, at)
            elif isinstance(default, tuple):
                made[name] = self._range(given, at, MOST_S if name.endswith("_s") else MOST)
            elif kind is Success and given == inf:  # not asked for
                made[name] = inf
            else:
                made[name] = self._number(given, at, least=0.0, most=MOST_S if name.endswith("_s") else MOST)
        return kind(**made)

    def _range(self, value: Any, key: str, most: float) -> tuple[float, float]:
        if not isinstance(value, list) or len(value) != 2:
            raise self._fail(key, f"must be [lowest, highest]; got {value!r}")
        low, high = (self._number(one, key, least=0.0, most=most) for one in value)
        if low > high:
            raise self._fail(key, f"must be [lowest, highest]; got {value!r}")
        return low, high

    def _consistent(self, task: Task) -> None:
        """What only shows in the whole: goals that nobody goes to, places within an obstacle, a way of no length."""
        aimed = any(phase.kind == "move" and phase.to is None for phase in task.phases)
        if task.goals and not aimed:
            raise self._fail("goals", "no phase goes to them: leave out `to` in the move that does")
        if not task.size_m > 1e-6:
            raise self._fail("phases", "all places are the start: a task has to go somewhere")
        for name in ("size_m", "duration_s"):
            if not getattr(task.partners, name)[0] > 0.0:
                raise self._fail(f"partners.{name}", f"must be above 0; got {list(getattr(task.partners, name))}")
        if task.obstacles:
            self._free(task)

    def _free(self, task: Task) -> None:
        d = len(task.axes)
        if task.clearance_m(np.zeros((1, d))) <= 0.0:
            raise self._fail("obstacles", "the start lies inside an obstacle")
        for name, goal in task.goals.items():
            if task.clearance_m(np.array([goal])) <= 0.0:
                raise self._fail(f"goals.{name}", "lies inside an obstacle")
        for n, phase in enumerate(task.phases, 1):
            if phase.to is not None and task.clearance_m(np.array([phase.to])) <= 0.0:
                raise self._fail(f"phases[{n}].to", "lies inside an obstacle")
        for to in tuple(task.goals) or ("",):
            course = way(task, usual(task, to)).course
            times = np.arange(course.start_s, course.stop_s, STEP_S)
            if task.clearance_m(course.sampled(times)) <= 0.0:
                raise self._fail("phases", "the usual way leads through an obstacle")
