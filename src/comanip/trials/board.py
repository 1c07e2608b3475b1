"""From result files to one table: `comanip trial --json` writes them, `comanip board` gathers them.

A score is a share of partners who behave with whom the judge calls the run a success; a law's score is that of its worst task and
role, so who only ever leads, only follows, or only holds has none. Those who misbehave are a column of their own, `safe`.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..parts import LAWS
from ..people.kinds import KINDS
from .cases import ROLES, Case
from .judging import success_interval
from .people import USUAL
from .policies import is_policy

FORMAT = 1
ABOUT = "about"  # the key in a result beside those of tasks and roles
LEAST_PARTNERS = 100  # steady ones, in each task and role, of an entry that is ranked


def about(
    cases: Iterable[Case], laws: Sequence[str], *, version: str, files: Sequence[Path] = (), **asked: Any
) -> dict[str, Any]:
    """What a result needs to be repeated and compared: versions, what was asked, and hashes of partners, policies and skills."""
    met = list(cases)
    by: dict[str, dict[str, list[Case]]] = {}
    for case in met:
        by.setdefault(case.task.name, {}).setdefault(case.role, []).append(case)
    hashes = {law: hash_of(law) for law in laws if is_policy(law)}
    return {
        "format": FORMAT,
        "comanip": version,
        "numpy": np.__version__,
        "python": platform.python_version(),
        **asked,
        "cases_sha256": hash_of_cases(met),
        "cases_by": {task: {role: hash_of_cases(some) for role, some in roles.items()} for task, roles in by.items()},
        "policies_sha256": hashes,
        "skills_sha256": {str(file): hash_of(file) for file in files},
    }


def hash_of_cases(cases: Iterable[Case]) -> str:
    """SHA-256 of all that is drawn of these partners."""
    told = json.dumps([case.about() for case in cases], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()


def hash_of(file: str | Path) -> str:
    """SHA-256 of a file's bytes."""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


@dataclass(frozen=True)
class Row:
    """One law on one task in one role. Partners who behave, and those who do not, as (successes, partners)."""

    task: str
    role: str
    law: str
    steady: tuple[int, int]
    safe: tuple[int, int]
    effort_n2s: float | None
    time_s: float | None
    peak_n: float | None
    group: str  # of results that may be compared: the same partners on the same plant
    made: Mapping[str, Any]
    source: str

    @property
    def score(self) -> float:
        """Share of the partners who behave; 0 where there was none."""
        return self.steady[0] / self.steady[1] if self.steady[1] else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of the score."""
        return success_interval(*self.steady)


@dataclass(frozen=True)
class Entry:
    """A law over all that it was tried in: its score is that of its worst row."""

    law: str
    rows: tuple[Row, ...]

    @property
    def worst(self) -> Row:
        return min(self.rows, key=lambda row: (row.score, row.task, row.role))

    @property
    def roles(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(row.role for row in self.rows))

    @property
    def safe(self) -> tuple[int, int]:
        """Of partners who misbehave, over all rows."""
        return sum(row.safe[0] for row in self.rows), sum(row.safe[1] for row in self.rows)

    @property
    def lacks(self) -> str:
        """Why it is listed and not ranked; empty where it is ranked."""
        if missing := {"leader", "follower"} - set(self.roles):
            return f"not tried as {' and '.join(sorted(missing))}"
        few = min(row.steady[1] for row in self.rows)
        return f"{few} partners who behave < {LEAST_PARTNERS}" if few < LEAST_PARTNERS else ""


def why_not(law: str, role: str) -> str:
    """Why a board has no row of a law in a role."""
    return "has to be told its role" if role == "auto" and law in LAWS and not LAWS[law].untold else "not tried"


def grid(rows: Sequence[Row]) -> tuple[list[tuple[str, str]], dict[str, list[Row | None]]]:
    """Tasks and roles that anybody was tried in, and by law its row of each; of several with other partners the largest."""
    cells = sorted({(row.task, row.role) for row in rows}, key=lambda cell: (cell[0], ROLES.index(cell[1])))
    best: dict[tuple[str, str, str], Row] = {}
    for row in rows:
        at = row.law, row.task, row.role
        if at not in best or row.steady[1] > best[at].steady[1]:
            best[at] = row
    laws = [one.law for one in entries(rows)]
    return cells, {law: [best.get((law, *cell)) for cell in cells] for law in laws}


def gathered(folder: Path) -> list[Row]:
    """The rows of all results in a folder, and those below it.

    Raises ParameterError for a folder that is absent or has none, and for a .json that is no result, with its name.
    """
    if not folder.is_dir():
        raise ParameterError(f"{folder}: is no folder; board takes one with files of `comanip trial --json`")
    files = sorted(folder.rglob("*.json"))
    if not files:
        raise ParameterError(f"{folder}: holds no .json; make one: comanip trial --json > {folder / 'mine.json'}")
    rows = [row for file in files for row in _rows(file)]
    seen: dict[str, Row] = {}
    for row in rows:
        other = seen.setdefault(_same(row), row)
        if (other.steady, other.safe) != (row.steady, row.safe):
            raise ParameterError(
                f"{row.source}: {row.law} as {row.role} on {row.task} differs from {other.source}, with the same partners and "
                "versions: one of them was changed"
            )
    return list(seen.values())


def _same(row: Row) -> str:
    """Of rows that must hold the same numbers."""
    made = [row.made.get(name) for name in ("comanip", "numpy", "python", "skills_sha256")]
    return json.dumps([row.task, row.role, row.law, row.group, made], sort_keys=True)


def _rows(file: Path) -> list[Row]:
    try:
        result = json.loads(file.read_text(encoding="utf-8"))
        made = result.pop(ABOUT)
        if made["format"] > FORMAT:
            raise ParameterError(f"{file}: result of format {made['format']}; this comanip reads up to {FORMAT}")
        by_task = result if made["by_task"] else {made["tasks"][0]: result}
        return [
            _row(file, made, task, role, law, numbers)
            for task, by_role in by_task.items()
            for role, by_law in by_role.items()
            for law, numbers in by_law.items()
        ]
    except ParameterError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ParameterError(
            f"{file}: no result of `comanip trial --json` of this version ({type(error).__name__}: {error}); move it elsewhere"
        ) from None


def _row(file: Path, made: Mapping[str, Any], task: str, role: str, law: str, numbers: Mapping[str, Any]) -> Row:
    steady, safe = _counted(numbers)
    peak = numbers["peak_force_n"]
    if law in made["policies_sha256"]:  # two files may have one name
        law = f"{Path(law).name} {made['policies_sha256'][law][:8]}"
    cases = made.get("cases_by", {}).get(task, {}).get(role, made["cases_sha256"])  # older results: of all roles in one
    group = f"{cases} {made['plant']}"
    return Row(task, role, law, steady, safe, numbers["effort"], numbers["time_s"], peak, group, made, str(file))


def _counted(numbers: Mapping[str, Any]) -> tuple[tuple[int, int], tuple[int, int]]:
    """(successes, partners) of those who behave, and of the others."""
    if "behaviours" in numbers:
        by = [(name == "steady", one["successes"], one["partners"]) for name, one in numbers["behaviours"].items()]
    else:
        by = [
            (kind == USUAL or KINDS[kind].behaviour == "steady", round(one["success"] * one["partners"]), one["partners"])
            for kind, one in numbers["kinds"].items()
        ]

    def over(behaves: bool) -> tuple[int, int]:
        return sum(s for b, s, _ in by if b == behaves), sum(n for b, _, n in by if b == behaves)

    return over(True), over(False)


def entries(rows: Sequence[Row]) -> list[Entry]:
    """One a law, ranked ones first, the best first: by score, then by safe, then by the effort of its partners."""
    by: dict[str, list[Row]] = {}
    for row in rows:
        by.setdefault(row.law, []).append(row)
    found = [Entry(law, tuple(some)) for law, some in by.items()]
    return sorted(found, key=lambda one: (bool(one.lacks), -one.worst.score, -_share(one.safe), _effort(one), one.law))


def _share(counted: tuple[int, int]) -> float:
    return counted[0] / counted[1] if counted[1] else 0.0


def _effort(entry: Entry) -> float:
    known = [row.effort_n2s for row in entry.rows if row.effort_n2s is not None]
    return float(np.median(known)) if known else float("inf")
