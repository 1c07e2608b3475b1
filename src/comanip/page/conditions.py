"""Which robots a study on the page compares: the usual three, or those of a TOML file.

trials = 4                  # lifts with each robot; `practice` of them before, which do not count
role = "follower"           # what a robot is told that states no other: leader, follower, or auto (nothing)
consent = "..."             # what whoever takes part reads, and agrees to

[[conditions]]
name = "ours"               # in the results; nobody sees it before the end
skill = "follower.json"     # beside this file; for role "auto" a list of a leader and a follower
law = "even"                # left out: the skill's own

[[conditions]]
name = "mass-damper"
mass_kg = 6.0
damping_ns_per_m = 20.0
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from ..errors import ComanipError, ParameterError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..tasks import Task
from .numbers import encoded, numbers, robot

TOP = ("trials", "practice", "role", "consent", "conditions")
OF_SKILL, OF_PLAIN = ("name", "role", "skill", "law"), ("name", "mass_kg", "damping_ns_per_m")
TOLD = ("leader", "follower", "auto")
MOST_CONDITIONS, MOST_TRIALS, MOST_TEXT = 6, 50, 4000
CONSENT = (
    "You carry a beam with several simulated robots, a few lifts each, and answer two questions about each. It takes about ten "
    "minutes. Your movements and answers are kept in this page alone until you keep them as a file yourself; nothing is sent "
    "anywhere, and no name is asked. You may stop at any time, without a reason."
)


def plan(conditions: Sequence[Mapping[str, Any]], role: str, **more: Any) -> dict[str, Any]:
    """What app/study.js is told."""
    practises = {"kind": "mass-damper", "kg": 4.0, "ns_per_m": 30.0}
    return {
        "role": role,
        "trials": 4,
        "practice": 2,
        "consent": CONSENT,
        "practises": practises,
        "conditions": conditions,
        **more,
    }


def usual_plan(skills: Mapping[str, LearnedSkill]) -> dict[str, Any]:
    """The skill, and the baselines of trials.contestants under the same hand."""
    return plan(
        [
            {"name": "default", "robot": {"kind": "skill"}},
            {"name": "mass-damper", "robot": _plain(6.0, 20.0)},
            {"name": "damping", "robot": _plain(0.0, 40.0)},
        ],
        "follower" if "follower" in skills else "leader",
    )


def read_plan(file: Path, task: Task, *, dt: float) -> dict[str, Any]:
    """The study that `file` describes, for a page of `task`. ParameterError, one line with file and key."""
    return _Reader(file, task, dt).plan()


def _plain(mass_kg: float, damping_ns_per_m: float) -> dict[str, Any]:
    return {"kind": "mass-damper", "kg": mass_kg, "ns_per_m": damping_ns_per_m}


class _Reader:
    """Knows which file it reads, for the messages."""

    def __init__(self, file: Path, task: Task, dt: float) -> None:
        self.file, self.task, self.dt = file, task, dt

    def plan(self) -> dict[str, Any]:
        table = self._content()
        self._known(table, "", TOP)
        role = self._one_of(table.get("role", "follower"), "role", TOLD)
        whole = {key: self._whole(table[key], key, low) for key, low in (("trials", 1), ("practice", 0)) if key in table}
        consent = {"consent": self._text(table["consent"], "consent", MOST_TEXT)} if "consent" in table else {}
        return plan(self._conditions(table.get("conditions"), role), role, **whole, **consent)

    def _content(self) -> dict[str, Any]:
        try:
            return tomllib.loads(self.file.read_text(encoding="utf-8"))
        except OSError as error:
            raise self._fail("", f"{error.strerror or error}; a study is a TOML file, see docs/page.md") from None
        except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
            raise self._fail("", f"not TOML: {error}") from None

    def _conditions(self, given: Any, role: str) -> list[dict[str, Any]]:
        if not isinstance(given, list) or not 2 <= len(given) <= MOST_CONDITIONS:
            got = f"{len(given)}" if isinstance(given, list) else "none" if given is None else f"{given!r}"[:60]
            raise self._fail("conditions", f"a study compares 2 to {MOST_CONDITIONS} [[conditions]]; got {got}")
        made = [self._condition(one, f"conditions[{n}]", role) for n, one in enumerate(given, 1)]
        for n, one in enumerate(made):
            if one["name"] in [other["name"] for other in made[:n]]:
                raise self._fail(f"conditions[{n + 1}].name", f"{one['name']!r} stands there twice; give each its own")
        return made

    def _condition(self, one: Any, key: str, role: str) -> dict[str, Any]:
        if not isinstance(one, Mapping):
            raise self._fail(key, f"must be a table; got {one!r}")
        self._known(one, f"{key}.", tuple(dict.fromkeys((*OF_SKILL, *OF_PLAIN))))
        name = self._text(one.get("name"), f"{key}.name", 60)
        told = self._one_of(one.get("role", role), f"{key}.role", TOLD)
        if "skill" in one:
            self._none_of(one, key, OF_PLAIN[1:], "a robot with a skill has none")
            return {"name": name, **self._of_skill(one, key, told)}
        self._none_of(one, key, ("law",), "a robot without a skill has none")
        if told == "leader":
            raise self._fail(
                f"{key}.role", "is 'leader', and a robot without a skill does not lead: role = \"follower\", or a skill"
            )
        mass, damping = (self._number(one.get(k), f"{key}.{k}") for k in OF_PLAIN[1:])
        if not mass + damping > 0.0:
            raise self._fail(key, "mass_kg and damping_ns_per_m are both 0; one must be above")
        return {"name": name, "role": told, "robot": _plain(mass, damping)}

    def _none_of(self, one: Mapping[str, Any], key: str, names: Sequence[str], why: str) -> None:
        for name in names:
            if name in one:
                raise self._fail(f"{key}.{name}", why)

    def _of_skill(self, one: Mapping[str, Any], key: str, role: str) -> dict[str, Any]:
        skills = self._skills(one["skill"], f"{key}.skill", role)
        law = self._text(one["law"], f"{key}.law", 40) if "law" in one else None
        try:
            block = encoded(numbers(robot(skills, role, dt=self.dt, law=law), self.task))
        except ComanipError as error:
            raise self._fail(key, str(error)) from None
        ends = skills["leader" if role == "auto" else role].ends
        return {
            "role": role, "robot": {"kind": "skill", "numbers": block},
            "ends": (ends - self.task.start).tolist(), "sha256": [skill_file.to_json(s)["sha256"] for s in skills.values()],
        }  # fmt: skip

    def _skills(self, given: Any, key: str, role: str) -> dict[str, LearnedSkill]:
        """The skills of these files by role: one of `role`, or for "auto" one of each."""
        names = [given] if isinstance(given, str) else given
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            raise self._fail(key, f"must be a file, or a list of files; got {given!r}")
        found: dict[str, LearnedSkill] = {}
        for name in names:
            try:
                skill = skill_file.load(self.file.parent / name)
            except ComanipError as error:
                raise self._fail(key, str(error)) from None
            if skill.axes != self.task.axes:
                raise self._fail(key, f"{name} is for the axes {', '.join(skill.axes)}, the task has {', '.join(self.task.axes)}")
            if skill.role in found:
                raise self._fail(key, f"{name} is a {skill.role or 'skill without a role'}, and so is one before it")
            found[skill.role] = skill
        wanted = {"leader", "follower"} if role == "auto" else {role}
        if not wanted <= set(found) or (role != "auto" and len(found) > 1):
            raise self._fail(key, f"role is {role!r}: give {' and '.join(sorted(wanted))}; got {', '.join(map(repr, found))}")
        return found

    def _fail(self, key: str, what: str) -> ParameterError:
        return ParameterError(f"{self.file}: {key}: {what}" if key else f"{self.file}: {what}")

    def _known(self, table: Mapping[str, Any], at: str, allowed: Sequence[str]) -> None:
        for name in table:
            if name not in allowed:
                raise self._fail(f"{at}{name}", f"unknown key; there are: {', '.join(allowed)}")

    def _one_of(self, value: Any, key: str, allowed: Sequence[str]) -> str:
        if value not in allowed:
            raise self._fail(key, f"is {value!r}; allowed: {', '.join(allowed)}")
        return str(value)

    def _text(self, value: Any, key: str, most: int) -> str:
        if not isinstance(value, str) or not value.strip() or len(value) > most:
            raise self._fail(key, f"must be a text of 1 to {most} characters; got {f'{value!r}'[:60]}")
        return value

    def _whole(self, value: Any, key: str, low: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= MOST_TRIALS:
            raise self._fail(key, f"is {value!r}; allowed: whole numbers from {low} to {MOST_TRIALS}")
        return value

    def _number(self, value: Any, key: str) -> float:
        fine = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value) and 0.0 <= value <= 1000.0
        if not fine:
            raise self._fail(key, f"is {value!r}; allowed: a number from 0 to 1000; or state a skill")
        return float(value)
