"""The file of one person that took part in a study on the page: JSON lines, read strictly; every trial as a recording."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording

VERSION = 1
MOST_BYTES = 200_000_000
SHORTEST_S = 1e-4
UNITS = ("_n2s", "_n", "_m", "_s", "_deg", "_m_per_s")  # what the measures of a verdict end in
_CHANNELS = {
    "position": ("hand.position", "m"), "velocity": ("hand.velocity", "m/s"), "sensor_force": ("hand.sensor_force", "N"),
    "force": ("hand.force_estimate", "N"), "true_force": ("hand.true_force", "N"), "tilt": ("beam.tilt", "rad"),
    "command_velocity": ("command.velocity", "m/s"), "end_position": ("partner.position", "m"), "pull_n": ("partner.force", "N"),
}  # fmt: skip


@dataclass(frozen=True)
class Person:
    """One file: who, the order of conditions, and what was done and said; `complete` unless the person stopped."""

    name: str
    about: Mapping[str, Any]
    trials: tuple[Mapping[str, Any], ...]
    answers: Mapping[str, Mapping[str, float]]
    prefers: str
    complete: bool


def read_person(path: Path) -> Person:
    """The study of one person. RecordingError that names file and line for anything else."""
    about: dict[str, Any] = {}
    trials: list[dict[str, Any]] = []
    answers: dict[str, dict[str, float]] = {}
    prefers, complete = "", False
    for number, record in _lines(path):
        kind = record.get("type")
        if (kind == "study") != (not about):
            raise RecordingError(
                f"{path}: line {number}: {'a second' if about else 'no'} record of type study; it stands first, once"
            )
        if kind == "study":
            about = _about(path, record)
        elif kind == "trial":
            trials.append(_trial(path, number, record, about))
            _once(path, number, f"trial {record['trial']} of", trials, lambda one: (one["condition"], one["trial"]))
        elif kind == "answers":
            condition = _condition(path, number, record, about["conditions"])
            if condition in answers:
                raise RecordingError(f"{path}: line {number}: condition {condition[:40]!r} is answered twice")
            answers[condition] = _answered(path, number, record)
        elif kind == "preference":
            prefers = _condition(path, number, record, about["conditions"])
        elif kind == "end":
            complete = record.get("reason") == "complete"
        else:
            raise RecordingError(
                f"{path}: line {number}: unknown type {str(kind)[:40]!r}; allowed: study, trial, answers, preference, end"
            )
    if not about:
        raise RecordingError(f"{path}: no study of the page: it holds no line")
    return Person(path.name, about, tuple(trials), answers, prefers, complete)


def _lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RecordingError(f"{path}: {path.stat().st_size / 1e6:.0f} MB; a study has at most {MOST_BYTES / 1e6:.0f}")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not a study of the page: {error}") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: line {number}: not JSON: {error}") from None
        if not isinstance(record, dict):
            raise RecordingError(f"{path}: line {number}: a record is an object {{...}}")
        yield number, record


def _about(path: Path, record: dict[str, Any]) -> dict[str, Any]:
    if record.get("version") != VERSION:
        raise RecordingError(
            f"{path}: written as version {str(record.get('version'))[:20]}; this comanip reads version {VERSION}"
        )
    for key, what in (("conditions", "a list of names"), ("axes", "a list of names")):
        names = record.get(key, ["z"] if key == "axes" else None)
        if not (
            isinstance(names, list) and names and all(isinstance(c, str) and c for c in names) and len({*names}) == len(names)
        ):
            raise RecordingError(f"{path}: line 1: {key} is {what}, each once; got {str(names)[:60]}")
    return record


def _condition(path: Path, number: int, record: Mapping[str, Any], conditions: Sequence[str]) -> str:
    name = record.get("condition")
    if name not in conditions:
        raise RecordingError(
            f"{path}: line {number}: condition {str(name)[:40]!r} is unknown; the study has: {', '.join(conditions)[:200]}"
        )
    return str(name)


def _once(path: Path, number: int, what: str, records: Sequence[Any], of: Callable[[Any], Any]) -> None:
    if sum(of(one) == of(records[-1]) for one in records) > 1:
        raise RecordingError(f"{path}: line {number}: {what} condition {records[-1]['condition'][:40]!r} stands there twice")


def _trial(path: Path, number: int, record: dict[str, Any], about: Mapping[str, Any]) -> dict[str, Any]:
    _condition(path, number, record, about["conditions"])
    trial, dt = record.get("trial"), record.get("dt_s", 0.01)
    if isinstance(trial, bool) or not isinstance(trial, int) or not 0 < trial < 10**6:
        raise RecordingError(f"{path}: line {number}: trial is a whole number from 1; got {str(trial)[:40]}")
    if not _is_number(dt) or not SHORTEST_S <= dt <= 1.0:
        raise RecordingError(f"{path}: line {number}: dt_s is from {SHORTEST_S:g} to 1 s; got {str(dt)[:40]}")
    _check_verdict(path, number, record.get("verdict"))
    _check_channels(path, number, record.get("channels"), len(about.get("axes", "z")))
    return record


def _check_verdict(path: Path, number: int, verdict: Any) -> None:
    if verdict is None:
        return
    if not isinstance(verdict, dict):
        raise RecordingError(f"{path}: line {number}: verdict is an object, or null for a trial that was too short")
    if not isinstance(verdict.get("success"), bool):
        raise RecordingError(f"{path}: line {number}: verdict.success is true or false; got {str(verdict.get('success'))[:40]}")
    for name, value in verdict.items():
        if name.endswith(UNITS) and value is not None and not _is_number(value):
            raise RecordingError(f"{path}: line {number}: verdict.{name[:40]!r} is a number or null; got {str(value)[:40]}")


def _check_channels(path: Path, number: int, channels: Any, width: int) -> None:
    """Rows of `width` numbers, of known channels; null is NaN."""
    if channels is None:
        return
    where = f"{path}: line {number}: channels"
    if not isinstance(channels, dict):
        raise RecordingError(f"{where} is an object of lists; got {str(channels)[:40]!r}")
    lengths = {}
    for name, rows in channels.items():
        fine = isinstance(rows, list) and all(
            isinstance(row, list) and len(row) == width and all(x is None or _is_number(x) for x in row) for row in rows
        )
        if not fine:
            raise RecordingError(f"{where}.{name[:40]!r} is a list of rows of {width} numbers")
        lengths[name] = len(rows)
    if len(set(lengths.values())) > 1:
        raise RecordingError(f"{where}: of different lengths: {str(lengths)[:120]}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _answered(path: Path, number: int, record: Mapping[str, Any]) -> dict[str, float]:
    given = {name: record.get(name) for name in ("ease", "predictability")}
    for name, value in given.items():
        if not _is_number(value) or not 1 <= value <= 7:  # type: ignore[operator]
            raise RecordingError(f"{path}: line {number}: {name} is from 1 to 7; got {str(value)[:40]}")
    return {name: float(value) for name, value in given.items()}  # type: ignore[arg-type]


def recordings(person: Person) -> Iterator[tuple[str, Recording]]:
    """Every trial of a person as a recording, with a name for its file."""
    about = person.about
    axes = tuple(about.get("axes", ("z",)))
    for trial in person.trials:
        stated = {k: v for k, v in trial.items() if k not in ("channels", "mode", "type")}
        dt = float(trial.get("dt_s", 0.01))
        channels = {}
        for key, rows in (trial.get("channels") or {}).items():
            values = np.array(rows, dtype=float).reshape(-1, len(axes))
            if key in _CHANNELS:
                name, unit = _CHANNELS[key]
                channels[name] = Channel(_times(len(values), dt), values, unit, "task", axes)
        same = {
            k: about[k]
            for k in ("participant", "task", "load_mass_kg", "load_share", "gravity_m_per_s2", "made_by")
            if k in about
        }
        name = f"{Path(person.name).stem}-{trial['condition']}-{trial['trial']}"
        yield name, Recording(channels, {**same, **stated})


def _times(n: int, dt: float) -> Array:
    return np.round(dt * np.arange(n), 9)
