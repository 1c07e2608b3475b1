"""The one loop: read, estimate, step, write, record, taps, advance. Teaching and reproduction are the same run."""

from __future__ import annotations

import gc
import time as _time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from .errors import ParameterError
from .interfaces import Command, Observation, Plant, Skill, Tap
from .recording import Recorder, Recording

_OBSERVED = {"position": "m", "velocity": "m/s", "sensor_force": "N", "force": "N"}
_COMMANDED = {"position": "m", "velocity": "m/s", "acceleration": "m/s^2"}


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

    clock   default: the wall clock for a plant that says it is `real`, else as fast as the machine goes. However the run ends, a
            plant that has `halt()` is halted: a real one brakes what was commanded last
    """
    if not duration_s > 0:
        raise ParameterError(f"duration_s must be positive; got {duration_s}")
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
