"""The one loop: read, estimate, step, write, record, taps, advance. Teaching and reproduction are the same run."""

from __future__ import annotations

import gc
import time as _time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isclose, isfinite
from numbers import Real
from typing import Any, Protocol

import numpy as np

from .errors import MismatchError, ParameterError, check_has, given
from .interfaces import Command, Observation, Plant, Skill, Tap
from .recording import Recorder, Recording

_OBSERVED = {"position": "m", "velocity": "m/s", "sensor_force": "N", "force": "N"}
_COMMANDED = {"position": "m", "velocity": "m/s", "acceleration": "m/s^2"}
# what the loop asks of each part
PLANT = ("axes", "dt", "channels", "stop_reason", "reset", "read", "write", "advance")
SKILL = ("diagnostics", "stop_reason", "notice", "reset", "step")


class ForceEstimator(Protocol):
    """Fills `obs.force` from `obs.sensor_force`: eq. (3) on line."""

    def reset(self) -> None: ...

    def step(self, obs: Observation) -> None: ...


class Clock(Protocol):
    """Waits for the next tick; returns how late it is [s]."""

    def start(self, dt: float) -> None: ...

    def wait(self) -> float: ...


class SimulatedClock:
    """As fast as the machine goes; never late."""

    def start(self, dt: float) -> None:
        """Time begins; `dt` is the control period [s]."""
        pass

    def wait(self) -> float:
        """Returns at once; 0 s late."""
        return 0.0


class WallClock:
    """Real time on the monotonic clock. Ticks missed by more than a period are dropped, not caught up in a burst."""

    def start(self, dt: float) -> None:
        """Time begins now; `dt` is the control period [s]."""
        self._dt, self._next = dt, _time.monotonic() + dt

    def wait(self) -> float:
        """Sleeps until the next tick is due, and gives how late it is [s]."""
        late = _time.monotonic() - self._next
        if late < 0:
            _time.sleep(-late)
            late = max(0.0, _time.monotonic() - self._next)
        missed = int(late / self._dt)
        self._next += (missed + 1) * self._dt
        return late


@contextmanager
def _collection_off() -> Iterator[None]:
    """No garbage collection inside a run: a collection can cost several ticks."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextmanager
def _halted(plant: Plant) -> Iterator[None]:
    """A real hand is not left with the last velocity, whatever ended the run."""
    try:
        yield
    finally:
        if hasattr(plant, "halt"):
            plant.halt()


@contextmanager
def _watched(taps: Sequence[Tap], recorder: Recorder) -> Iterator[None]:
    """Taps that want the whole row, not only what the skill sees, have `begin(recorder)` and `end()`."""
    begun = []
    try:
        for tap in taps:
            if hasattr(tap, "begin"):
                tap.begin(recorder)
                begun.append(tap)
        yield
    finally:
        for tap in begun:
            tap.end()  # type: ignore[attr-defined]


def run(
    plant: Plant,
    skill: Skill,
    *,
    duration_s: float,
    estimator: ForceEstimator | None = None,
    clock: Clock | None = None,
    taps: Sequence[Tap] = (),
    metadata: Mapping[str, Any] | None = None,
) -> Recording:
    """Runs `skill` on `plant` for at most `duration_s`; the Recording holds what was observed, commanded and thought.

    Channels: hand.position, hand.velocity, hand.sensor_force, hand.force (what the skill saw), command.* (what it asked for),
    the plant's own truths, and the skill's diagnostics under "skill.<name>". `metadata["stop_reason"]` says why it ended:
    the skill's or the plant's own reason, "duration", or "interrupted" (Ctrl-C keeps what was recorded).
    Raises MismatchError before anything moves where period, axes or units of skill, plant and estimator differ.

    clock   default: the wall clock for a plant that says it is `real`, else as fast as the machine goes. However the run ends, a
            plant that has `halt()` is halted: a real one brakes what was commanded last
    """
    _check_fits(plant, skill, estimator, duration_s)
    d = len(plant.axes)
    obs, command = Observation(d), Command(d)
    clock = clock or (WallClock() if getattr(plant, "real", False) else SimulatedClock())
    _begin(plant, skill, estimator, obs, command)
    observed = tuple(name for name in _OBSERVED if not np.isnan(getattr(obs, name)).all())  # what this plant measures
    recorder = Recorder(_layout(plant, skill, observed))
    reason, late = "duration", 0.0
    with _watched(taps, recorder), _halted(plant), _collection_off():
        if getattr(plant, "real", False):  # making files took time, and what was read before is old by now: a late tick
            _begin(plant, skill, estimator, obs, command)
        clock.start(plant.dt)
        try:
            for _ in range(max(1, round(duration_s / plant.dt))):
                skill.step(obs, command)
                plant.write(command)
                _record(recorder, observed, obs, command, plant, skill, late)
                for tap in taps:
                    tap(obs, command)
                reason = plant.stop_reason or skill.stop_reason
                if reason:
                    break
                plant.advance()
                late = clock.wait()
                plant.read(obs)
                if estimator is not None:
                    estimator.step(obs)
            else:
                reason = "duration"
        except KeyboardInterrupt:
            reason = "interrupted"
    notice = {"notice": skill.notice} if skill.notice else {}
    return recorder.recording({**(metadata or {}), **notice, "stop_reason": reason, "dt_s": plant.dt})


class Stepper:
    """The same loop for whoever decides from outside when time goes on (`comanip.gym`): `act`, then `advance`, and so on.

    The rows, and so the recording, are those that `run` would have kept. Raises what `run` raises before anything moves.
    """

    def __init__(self, plant: Plant, skill: Skill, estimator: ForceEstimator | None = None, *, most_s: float = 3600.0) -> None:
        _check_fits(plant, skill, estimator, most_s)
        self.plant, self.skill, self.estimator = plant, skill, estimator
        self.obs, self.command = Observation(len(plant.axes)), Command(len(plant.axes))
        _begin(plant, skill, estimator, self.obs, self.command)
        self.observed = tuple(name for name in _OBSERVED if not np.isnan(getattr(self.obs, name)).all())
        self.recorder = Recorder(_layout(plant, skill, self.observed))

    def act(self) -> str:
        """The skill steps, the plant is told, the row is kept; why the run must end, or nothing."""
        self.skill.step(self.obs, self.command)
        return self.send()

    def send(self) -> str:
        """What is left of `act` when the skill has stepped."""
        self.plant.write(self.command)
        _record(self.recorder, self.observed, self.obs, self.command, self.plant, self.skill, 0.0)
        return self.plant.stop_reason or self.skill.stop_reason

    def advance(self) -> None:
        """One control period passes, and what came of it is measured."""
        self.plant.advance()
        self.plant.read(self.obs)
        if self.estimator is not None:
            self.estimator.step(self.obs)

    def recording(self, metadata: Mapping[str, Any] | None = None) -> Recording:
        """What was kept so far."""
        notice = {"notice": self.skill.notice} if self.skill.notice else {}
        return self.recorder.recording({**(metadata or {}), **notice, "dt_s": self.plant.dt})


def _check_fits(plant: Plant, skill: Skill, estimator: ForceEstimator | None, duration_s: float) -> None:
    """Before the first command, because a wrong period or axis moves a robot wrongly.

    Raises ParameterError for what is no plant, skill, estimator or duration, MismatchError for parts made for another robot. What
    a skill wraps is asked, too: an envelope of the right period around a law of another is no better.
    """
    if not (isinstance(duration_s, Real) and isfinite(duration_s) and duration_s > 0):
        raise ParameterError(f"duration_s must be a positive number of seconds; got {given(duration_s)}")
    check_has(plant, "plant", PLANT, "comanip.interfaces.Plant")
    check_has(skill, "skill", SKILL, "comanip.interfaces.Skill")
    if estimator is not None:
        check_has(estimator, "estimator", ("reset", "step"), "comanip.loop.ForceEstimator")
    check_matches(plant, skill, estimator)


def check_matches(plant: Plant, skill: Skill, estimator: ForceEstimator | None = None) -> None:
    """Refuses period, axes and units that skill or estimator state and that are not the plant's; what is not stated passes.

    A skill made for 2 ms on a plant of 10 ms believes that a fifth of the time has passed: it moves at a fifth of its speed.
    """
    for part in _inside(skill):
        _check_period(f"the skill {type(part).__name__}", part, plant)
        _check_axes(part, plant)
    if estimator is not None:
        _check_period(f"the estimator {type(estimator).__name__}", estimator, plant)
        _check_number(estimator, plant)
    for name, unit in getattr(plant, "units", {}).items():
        if _OBSERVED.get(name, unit) != unit:
            raise MismatchError(f"the plant's {name} is in {unit!r}; skills take {_OBSERVED[name]!r}: convert it in its `read`")


def _inside(skill: Any) -> Iterator[Any]:
    """The skill, and whatever it wraps under the name `skill`."""
    seen: list[Any] = []
    while skill is not None and not any(skill is one for one in seen):
        seen.append(skill)
        yield skill
        skill = getattr(skill, "skill", None)


def _check_period(name: str, part: Any, plant: Plant) -> None:
    dt = getattr(part, "dt", None)
    if dt is not None and not isclose(dt, plant.dt, rel_tol=1e-6):
        raise MismatchError(
            f"{name} is made for a control period dt of {dt:g} s, the plant {type(plant).__name__} has {plant.dt:g} s; "
            "make both with the same dt"
        )


def _check_axes(part: Any, plant: Plant) -> None:
    axes = getattr(part, "axes", None)
    if axes is not None and tuple(axes) != tuple(plant.axes):
        raise MismatchError(
            f"the skill {type(part).__name__} is made for the axes {', '.join(axes)}, the plant {type(plant).__name__} has "
            f"{', '.join(plant.axes)}; make both with the same axes, in the same order"
        )


def _check_number(estimator: Any, plant: Plant) -> None:
    n = getattr(estimator, "n_axes", None)
    if n is not None and n != len(plant.axes):
        raise MismatchError(
            f"the estimator {type(estimator).__name__} is made for {n} axes, the plant {type(plant).__name__} has "
            f"{len(plant.axes)}: {', '.join(plant.axes)}; give it gravity with one entry an axis"
        )


def _begin(plant: Plant, skill: Skill, estimator: ForceEstimator | None, obs: Observation, command: Command) -> None:
    """All that has a memory forgets it, and looks for the first time."""
    plant.reset()
    plant.read(obs)
    if estimator is not None:
        estimator.reset()
        estimator.step(obs)
    command.position[:] = obs.position
    skill.reset(obs)


def unbroken(recording: Recording) -> Recording:
    """The recording of a run that nobody interrupted; otherwise Control-C goes on to whoever has more to run."""
    if recording.metadata["stop_reason"] == "interrupted":
        raise KeyboardInterrupt
    return recording


def _layout(plant: Plant, skill: Skill, observed: Sequence[str]) -> dict[str, tuple[int, str, tuple[str, ...]]]:
    d, axes = len(plant.axes), tuple(plant.axes)
    layout = {f"hand.{name}": (d, _OBSERVED[name], axes) for name in observed}
    layout |= {f"command.{name}": (d, unit, axes) for name, unit in _COMMANDED.items()}
    columns = getattr(plant, "columns", {})
    layout |= {name: (len(array), unit, columns.get(name, axes)) for name, (array, unit) in plant.channels.items()}
    for name, array in skill.diagnostics.items():
        n = array.size
        names = axes if n == d else tuple(str(i) for i in range(n))
        layout[name if "." in name else f"skill.{name}"] = (n, getattr(skill, "units", {}).get(name, ""), names)
    layout["loop.late"] = (1, "s", ("t",))
    return layout


def _record(
    recorder: Recorder, observed: Sequence[str], obs: Observation, command: Command, plant: Plant, skill: Skill, late: float
) -> None:
    recorder.add(
        obs.time,
        [
            *[getattr(obs, name) for name in observed],
            *[getattr(command, name) for name in _COMMANDED],
            *[array for array, _ in plant.channels.values()],
            *skill.diagnostics.values(),
            late,
        ],
    )
