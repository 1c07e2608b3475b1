"""What a study on the page gave: files of JSON lines, one a person, to success, effort, time, answers and preference.

A condition is compared with another in pairs. Trial n asks the same of every condition, so a pair is two trials of the same
person and number; with `ENOUGH` persons or more it is two means of the same person, because trials of one person are not
independent. The interval is Student's, 95 %, of the mean difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import inf, isfinite, nan, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..errors import RecordingError
from .study_file import Person as Person
from .study_file import read_person as read_person
from .study_file import recordings as recordings

ENOUGH = 5  # persons from whom on a person is a pair
MEASURES = {  # name -> (what it is, unit, whether more is better)
    "success": ("success", "", True),
    "effort": ("effort ∫F² dt", "N² s", False),
    "peak": ("highest |F|", "N", False),
    "duration": ("time", "s", False),
    "ease": ("ease, 1 to 7", "", True),
    "predictability": ("predictability, 1 to 7", "", True),
}
_VERDICT = {"effort": "effort_n2s", "peak": "peak_n", "duration": "duration_s"}


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
