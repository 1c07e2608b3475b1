"""What a study on the page gave: files of JSON lines, one a person, to success, effort, time, answers and preference.

A condition is compared with another in pairs. Trial n asks the same of every condition, so a pair is two trials of the same
person and number; with `ENOUGH` persons or more it is two means of the same person, because trials of one person are not
independent. The interval is Student's, 95 %, of the mean difference.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf, isfinite, nan, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording

VERSION = 1
ENOUGH = 5  # persons from whom on a person is a pair
MOST_BYTES = 200_000_000
MEASURES = {  # name -> (what it is, unit, whether more is better)
    "success": ("success", "", True),
    "effort": ("effort ∫F² dt", "N² s", False),
    "peak": ("highest |F|", "N", False),
    "duration": ("time", "s", False),
    "ease": ("ease, 1 to 7", "", True),
    "predictability": ("predictability, 1 to 7", "", True),
}
_VERDICT = {"effort": "effort_n2s", "peak": "peak_n", "duration": "duration_s"}
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


class Difference(NamedTuple):
    """One condition less another: mean, its 95 % interval, and how many pairs it rests on."""

    mean: float
    low: float
    high: float
    pairs: int

    @property
    def told(self) -> bool:
        """Whether the interval leaves out 0."""
        return self.low > 0.0 or self.high < 0.0


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
            trials.append(_trial(path, number, record, about["conditions"]))
        elif kind == "answers":
            answers[_condition(path, number, record, about["conditions"])] = _answered(path, number, record)
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
        raise RecordingError(f"{path}: written as version {record.get('version')!r}; this comanip reads version {VERSION}")
    conditions = record.get("conditions")
    if not (isinstance(conditions, list) and conditions and all(isinstance(c, str) for c in conditions)):
        raise RecordingError(f"{path}: line 1: conditions is a list of names; got {str(conditions)[:60]}")
    return record


def _condition(path: Path, number: int, record: Mapping[str, Any], conditions: Sequence[str]) -> str:
    name = record.get("condition")
    if name not in conditions:
        raise RecordingError(
            f"{path}: line {number}: condition {str(name)[:40]!r} is unknown; the study has: {', '.join(conditions)}"
        )
    return str(name)


def _trial(path: Path, number: int, record: dict[str, Any], conditions: Sequence[str]) -> dict[str, Any]:
    _condition(path, number, record, conditions)
    if not isinstance(record.get("trial"), int):
        raise RecordingError(f"{path}: line {number}: trial is a whole number; got {str(record.get('trial'))[:40]}")
    verdict = record.get("verdict")
    if verdict is not None and not isinstance(verdict, dict):
        raise RecordingError(f"{path}: line {number}: verdict is an object, or null for a trial that was too short")
    return record


def _answered(path: Path, number: int, record: Mapping[str, Any]) -> dict[str, float]:
    given = {name: record.get(name) for name in ("ease", "predictability")}
    for name, value in given.items():
        if not (isinstance(value, int | float) and 1 <= value <= 7):
            raise RecordingError(f"{path}: line {number}: {name} is from 1 to 7; got {str(value)[:40]}")
    return {name: float(value) for name, value in given.items()}  # type: ignore[arg-type]


def measured(person: Person, measure: str, condition: str) -> dict[int, float]:
    """What one person's trials of one condition gave, by number of the trial; of an answer one value, under 0."""
    if measure in ("ease", "predictability"):
        return {0: person.answers[condition][measure]} if condition in person.answers else {}
    found: dict[int, float] = {}
    for trial in person.trials:
        if trial["condition"] == condition:
            found[trial["trial"]] = _value(trial.get("verdict"), measure)
    return {n: value for n, value in found.items() if isfinite(value)}


def _value(verdict: Mapping[str, Any] | None, measure: str) -> float:
    if measure == "success":
        return float(bool(verdict and verdict.get("success")))
    value = (verdict or {}).get(_VERDICT[measure])
    return float(value) if isinstance(value, int | float) else nan


def pairs(persons: Sequence[Person], measure: str, one: str, other: str) -> list[float]:
    """`one` less `other`, pair by pair."""
    means, trials = [], []
    for person in persons:
        a, b = measured(person, measure, one), measured(person, measure, other)
        common = sorted(set(a) & set(b))
        if common:
            trials += [a[n] - b[n] for n in common]
            means.append(float(np.mean([a[n] for n in common]) - np.mean([b[n] for n in common])))
    return means if len(means) >= ENOUGH else trials


def difference(values: Sequence[float]) -> Difference:
    """The mean of paired differences and Student's 95 % interval; of a single pair it is unbounded."""
    n = len(values)
    if n == 0:
        return Difference(nan, -inf, inf, 0)
    mean = float(np.mean(values))
    if n == 1:
        return Difference(mean, -inf, inf, 1)
    from scipy.stats import t

    half = float(t.ppf(0.975, n - 1)) * float(np.std(values, ddof=1)) / sqrt(n)
    return Difference(mean, mean - half, mean + half, n)


def conditions_of(persons: Sequence[Person]) -> tuple[str, ...]:
    """The conditions, in the order of the first file; RecordingError where files differ."""
    first = persons[0]
    for person in persons[1:]:
        if set(person.about["conditions"]) != set(first.about["conditions"]):
            raise RecordingError(
                f"{person.name}: compares {', '.join(person.about['conditions'])}; {first.name} compares "
                f"{', '.join(first.about['conditions'])}: analyse them apart"
            )
    return tuple(first.about["conditions"])


def analysis(persons: Sequence[Person]) -> dict[str, Any]:
    """Means by condition, paired differences of every two, and who prefers what."""
    conditions = conditions_of(persons)
    means = {c: {m: _mean([v for p in persons for v in measured(p, m, c).values()]) for m in MEASURES} for c in conditions}
    compared = {m: {f"{a} - {b}": difference(pairs(persons, m, a, b)) for a, b in combinations(conditions, 2)} for m in MEASURES}
    said = [p.prefers for p in persons if p.prefers]
    return {
        "persons": len(persons),
        "complete": sum(p.complete for p in persons),
        "trials": {c: sum(t["condition"] == c for p in persons for t in p.trials) for c in conditions},
        "means": means,
        "differences": compared,
        "prefer": {c: said.count(c) for c in conditions},
        "pairs_are": "persons" if len(persons) >= ENOUGH else "trials",
    }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else nan


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
