"""Which skills a trial is run with: those of files, or learned now."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import ParameterError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..parts import LAWS
from ..tasks import Task, named
from ..trials.cases import TASK
from .console import note
from .running import taught


def skills_for(
    roles: Sequence[str], laws: Sequence[str], files: Sequence[Path], task: str | Path | Task = TASK
) -> dict[str, LearnedSkill]:
    """Skills by role: from files, or learned now from five fresh lessons of the task."""
    skills: dict[str, LearnedSkill] = {}
    what = named(task)
    for file in files:
        learned = skill_file.load(file)
        if learned.role in skills or not learned.role:
            raise ParameterError(f"{file}: role {learned.role or 'not stated'!r}; --skill takes one file a role")
        if learned.axes != what.axes:
            raise ParameterError(
                f"{file}: the skill moves axes {', '.join(learned.axes)}; task {what.name!r} has {', '.join(what.axes)}: pass "
                "the --task that it was taught"
            )
        skills[learned.role] = learned
    wanted = {"leader", "follower"} if "auto" in roles or any(LAWS[law].both for law in laws if law in LAWS) else set(roles)
    if files and (absent := sorted(wanted - set(skills))):
        note(f"no --skill as {' or '.join(absent)}: learned now from five simulated lessons a role")
    for role in sorted(wanted - set(skills)):
        skills[role] = taught(role, seed=0, task=what)
    if "auto" in roles and "natural" not in skills and not files:
        skills["natural"] = taught("natural", seed=0, task=what)
    return skills
