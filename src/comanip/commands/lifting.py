"""The page on which a person lifts: as a file (export --to page), and served here (page)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from .console import note, print_json, progress, say
from .outputs import may_write


def export_page(
    files: Sequence[Path],
    out: Path | None,
    task: str | None,
    study: Path | None,
    others: Mapping[str, Any],
    overwrite: bool,
    json: bool,
) -> None:
    """`others`: flags of other targets; a page has every role, and the object of its task."""
    from ..page.export import write_page

    if given := sorted(name for name, value in others.items() if value is not None):
        raise ParameterError(f"{given[0]} is not for --to page: it offers every role there is a skill of, with --task's object")
    out = out or Path("lift.html")
    if out.suffix.lower() != ".html":
        raise ParameterError(f"-o {out}: --to page ends in .html; name another")
    may_write([out], inputs=files, overwrite=overwrite)
    write_page(skills_by_role(files), out, task=task, study=study)
    if json:
        print_json({"files": [str(out)], "bytes": out.stat().st_size})
        return
    say(f"{out}: {out.stat().st_size / 1e3:.0f} kB; open it in a browser")


def skills_by_role(files: Sequence[Path]) -> dict[str, LearnedSkill]:
    """The skills in these files by role, one a role."""
    found: dict[str, LearnedSkill] = {}
    whose: dict[str, Path] = {}
    for file in files:
        one = skill_file.load(file)
        if not one.role:
            raise ParameterError(f"{file}: states no role; learn it with --role leader, follower or natural")
        if one.role in found:
            raise ParameterError(f"{file}: is a {one.role} as {whose[one.role]} is; give one skill a role")
        found[one.role], whose[one.role] = one, file
    return found


def page(files: Sequence[Path], task: str | None, study: Path | None, port: int) -> None:
    from ..page.export import page as made
    from ..page.serve import serve

    if not 0 <= port <= 65535:
        raise ParameterError(f"--port is from 0 (any that is free) to 65535; got {port}")
    skills = skills_by_role(files) if files else _taught(task or "lift")
    text = made(skills, task=task, study=study)
    try:
        serve(text, port, lambda where: say(f"{where}  (Ctrl-C ends it)"))
    except OSError as error:
        raise ParameterError(f"--port {port}: {error.strerror or error}; leave it out for one that is free") from None
    except KeyboardInterrupt:
        note("ended")


def _taught(task: str) -> dict[str, LearnedSkill]:
    """Skills of both roles from five simulated lessons each, for who has none."""
    from ..learned.learn import learn
    from ..lessons.demonstration import demonstrations
    from ..teaching import ROLES, teach

    found = {}
    for n, role in enumerate(ROLES):
        with progress(f"five simulated lessons as {role}") as report:
            lessons = teach(role, 5, task=task, rng=np.random.default_rng(n), progress=report)
        found[role] = learn(demonstrations(lessons, rate_hz=100.0), role=role)
    return found
