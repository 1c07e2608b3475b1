"""What a task is: axes, the way through them, the object, what stands in the way, and whom it is learned from and tried with.

A task is one TOML file (`tasks.reading`, docs/tasks.md). All places are displacements from the start of the hand; axes are
lengths [m] or angles [rad].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import hypot, nan
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import STANDARD_GRAVITY, Array

LENGTH, ANGLE, ARC = "length", "angle", "arc"  # an arc is an angle at its lever: the length that a point there goes
UNITS = {LENGTH: "m", ANGLE: "rad", ARC: "m"}


@dataclass(frozen=True)
class Axis:
    """One task axis. `up` is the cosine between it and the vertical: 1 points up, -1 down, 0 lies level. An angle counts as a
    length at `lever_m`."""

    name: str
    kind: str = LENGTH
    start: float = 0.0
    up: float = 0.0
    lever_m: float = 0.25

    @property
    def unit(self) -> str:
        return UNITS[self.kind]


@dataclass(frozen=True)
class Phase:
    """A part of the way; durations are the usual ones.

    kind        "move" to `to`, "rest", "strokes" to `to` and back, or "circle" around `centre`, setting out along `towards`
    to          (d,) from the start, None: the drawn goal; centre, towards: (d,) from where the phase begins
    duration_s  of a move or a rest; of one cycle or turn
    overlap_s   a move begins so long before the one before it has ended: that rounds the corner between them
    cycles      strokes there and back, or turns
    """

    kind: str
    duration_s: float
    to: tuple[float, ...] | None = None
    centre: tuple[float, ...] = ()
    towards: tuple[float, ...] = ()
    overlap_s: float = 0.0
    cycles: float = 1.0

    @property
    def whole_s(self) -> float:
        """How much longer the task is by this phase [s]."""
        if self.kind == "circle":
            return self.duration_s * (self.cycles + RAMP)
        return self.duration_s * self.cycles - self.overlap_s


RAMP = 0.5  # of a turn's duration: what a crank takes to come to speed, and to a stand


@dataclass(frozen=True)
class Obstacle:
    """A disc, or a ball: what the hand must not enter. Axes that `centre` does not name do not matter."""

    name: str
    centre: Mapping[str, float]
    radius_m: float


@dataclass(frozen=True)
class Carried:
    """The object: what it weighs, how long and wide it is, the hand's share, and the axis that it lies along ("": across all)."""

    mass_kg: float = 2.0
    length_m: float = 0.8
    width_m: float = 0.2
    share: float = 0.5
    along: str = ""


@dataclass(frozen=True)
class Success:
    """What counts as success with a partner who behaves; distances are lengths of vectors."""

    goal_m: float = 0.03  # from where the partner wants to be
    taught_goal_m: float = 0.02  # from where lessons ended, for a robot that leads
    way_m: float = 0.05  # from every place on the way, visited in order
    rest_s: float = 1.0  # a rest on the way is so much shorter or longer than meant, at most
    peak_n: float = 15.0
    residual_n: float = 3.0
    ripple_m_per_s: float = 0.01
    tilt_deg: float = 3.0
    vibration_n: float = 2.0  # rms of the force above 2.5 Hz while the hand moves
    slowest: float = 3.0  # times the usual duration


@dataclass(frozen=True)
class Lessons:
    """What five lessons of one day are drawn from; a mean is the task's own, these are standard deviations."""

    size_sd_m: float = 0.025
    duration_sd_s: float = 0.25
    shortest_s: float = 1.8
    onset_s: tuple[float, float] = (0.4, 1.2)
    after_s: float = 1.0
    start_sd_m: float = 0.0
    place_sd_m: float = 0.0
    rest_sd: float = 0.0  # share of a rest's usual duration


@dataclass(frozen=True)
class Partners:
    """What the partners of a trial are drawn from, wider than the lessons: uniform between two ends."""

    size_m: tuple[float, float] = (0.15, 0.38)
    duration_s: tuple[float, float] = (1.6, 4.0)
    onset_s: tuple[float, float] = (0.3, 6.0)
    rest: tuple[float, float] = (1.0, 1.0)
    start_sd_m: float = 0.0
    place_sd_m: float = 0.0


@dataclass(frozen=True)
class Task:
    """See the module. `goals` name the places that a move without `to` goes to, one of them in each lesson.

    fixed_places   places stay where they are in the world when a hand starts elsewhere; else they move with it
    source         the file that it was read from
    """

    name: str
    about: str
    axes_: tuple[Axis, ...]
    phases: tuple[Phase, ...]
    goals: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    carried: Carried = field(default_factory=Carried)
    obstacles: tuple[Obstacle, ...] = ()
    success: Success = field(default_factory=Success)
    lessons: Lessons = field(default_factory=Lessons)
    partners: Partners = field(default_factory=Partners)
    fixed_places: bool = False
    source: str = field(default="", compare=False)

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes_)

    @property
    def units(self) -> tuple[str, ...]:
        """Of each axis, "m" or "rad"."""
        return tuple(axis.unit for axis in self.axes_)

    @property
    def start(self) -> Array:
        """(d,) where the hand usually starts."""
        return np.array([axis.start for axis in self.axes_])

    @property
    def gravity(self) -> Array:
        """(d,) [m/s^2] of gravity along each axis."""
        return np.array([0.0 - axis.up * STANDARD_GRAVITY for axis in self.axes_])

    @property
    def needs(self) -> str:
        """What no exact plant here can do yet; empty where the beam runs the task."""
        turned = [axis.name for axis in self.axes_ if axis.kind != LENGTH]
        if len(turned) > 1:
            return f"a plant that turns the object about more than one axis ({', '.join(turned)})"
        if turned and len(turned) < len(self.axes_):
            return f"a partner who, from the far end, leads the robot's end too ({turned[0]} beside lengths); its plant is there"
        share = self.carried.share
        return "" if share == 0.5 else f"a plant whose hand carries {share:g} of the object (the beam halves it)"

    def runnable(self) -> Task:
        """The task itself; raises ParameterError where no plant here can do it."""
        if self.needs:
            raise ParameterError(f"task {self.name!r} cannot be run yet: it needs {self.needs}; `comanip tasks` draws it")
        return self

    @property
    def levers_m(self) -> tuple[float, ...]:
        """(d,) at which an angle counts as a length; NaN for a length."""
        return tuple(nan if axis.kind == LENGTH else axis.lever_m for axis in self.axes_)

    @property
    def turns(self) -> bool:
        """Whether any axis is an angle."""
        return any(axis.kind != LENGTH for axis in self.axes_)

    def in_arcs(self) -> Task:
        """The same with every angle as the arc at its lever [m], so that lengths of vectors mean something.

        Where all axes are angles, what lessons and partners vary is rad in the file, and at the lever of the first here.
        """
        if all(axis.kind != ANGLE for axis in self.axes_):
            return self
        scale = np.array([axis.lever_m if axis.kind == ANGLE else 1.0 for axis in self.axes_])

        def at(place: tuple[float, ...]) -> tuple[float, ...]:
            return tuple((np.array(place) * scale).tolist()) if place else place

        axes = tuple(
            replace(axis, kind=ARC, start=axis.start * axis.lever_m) if axis.kind == ANGLE else axis for axis in self.axes_
        )
        phases = tuple(
            replace(p, to=None if p.to is None else at(p.to), centre=at(p.centre), towards=at(p.towards)) for p in self.phases
        )
        goals = {name: at(place) for name, place in self.goals.items()}
        alone = axes[0].lever_m if all(axis.kind == ARC for axis in axes) else 1.0
        lessons, partners = _scaled(self.lessons, alone), _scaled(self.partners, alone)
        return replace(self, axes_=axes, phases=phases, goals=goals, lessons=lessons, partners=partners)

    @property
    def size_m(self) -> float:
        """How far from the start the usual way goes: the measure that lessons and partners vary."""
        far = [p for phase in self.phases for p in _reached(phase)] + list(self.goals.values())
        lengths = [axis.kind == LENGTH for axis in self.axes_]
        lengths_only = [[x for x, is_length in zip(place, lengths, strict=True) if is_length] for place in far]
        return max(hypot(*place) for place in (lengths_only if any(map(any, lengths_only)) else far))

    @property
    def moving_s(self) -> float:
        """Usual duration without the rests [s]."""
        return sum(phase.whole_s for phase in self.phases if phase.kind != "rest")

    @property
    def rests_s(self) -> float:
        return sum(phase.whole_s for phase in self.phases if phase.kind == "rest")

    @property
    def cycles(self) -> float:
        """Of strokes or turns; 0 for a task that is done once."""
        return sum(phase.cycles for phase in self.phases if phase.kind in ("strokes", "circle"))

    @property
    def end_is(self) -> str:
        """In a word, for messages: what lessons of this task teach the end of."""
        return "height" if len(self.axes_) == 1 and abs(self.axes_[0].up) == 1.0 else "place"

    def clearance_m(self, displacement: Array, offset: Array | None = None) -> float:
        """Smallest distance of hands (T, d), from where they started, to all obstacles [m]; negative inside, inf without any.

        offset   (d,) of the start from the task's own
        """
        found = np.inf
        for obstacle in self.obstacles:
            columns = [self.axes.index(name) for name in obstacle.centre]
            shift = np.zeros(len(columns)) if offset is None or not self.fixed_places else np.asarray(offset)[columns]
            apart = np.asarray(displacement)[:, columns] + shift - np.array(list(obstacle.centre.values()))
            found = min(found, float(np.sqrt((apart**2).sum(axis=1)).min()) - obstacle.radius_m)
        return float(found)


def _scaled(spread: Any, by: float) -> Any:
    """Lessons or Partners whose lengths (names that end in _m) are `by` times as large."""
    found = {name: getattr(spread, name) for name in spread.__dataclass_fields__ if name.endswith("_m")}
    return replace(spread, **{n: tuple(by * x for x in v) if isinstance(v, tuple) else by * v for n, v in found.items()})


def _reached(phase: Phase) -> list[tuple[float, ...]]:
    if phase.kind == "circle":
        return [tuple(2.0 * c for c in phase.centre)]
    return [] if phase.to is None else [phase.to]
