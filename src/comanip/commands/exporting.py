"""export: a skill as source that runs without Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ..errors import ParameterError
from ..export.controller import controller
from ..interfaces import Array
from ..learned import file as skill_file
from ..parts import EXPORTS, known
from ..whole_file import write_whole
from .console import print_json, say
from .lifting import export_page
from .outputs import may_write
from .running import _one_role_or_auto


def export(
    paths: Sequence[Path],
    to: str,
    out: Path | None,
    role: str | None,
    law: str | None,
    dt: float,
    goal: int | None,
    mass_kg: float,
    load_share: float,
    tare_s: float,
    force_delay_ms: float,
    gravity: str | None,
    task: str | None,
    study: Path | None,
    overwrite: bool,
    json: bool,
) -> None:
    target = known("target", to, EXPORTS)
    if to == "page":
        export_page(
            paths, out, task, study, {"--role": role, "--law": law, "--goal": goal, "--gravity": gravity}, overwrite, json
        )
        return
    if study is not None:
        raise ParameterError(f"--study is for --to page; --to {to} makes a controller")
    if task is not None:
        raise ParameterError(f"--task is for --to page; --to {to} takes the object by --mass-kg, --load-share and --gravity")
    skills = {path: skill_file.load(path) for path in paths}
    _one_role_or_auto(skills, role)
    out = _named(out, to, target.suffix, paths[0])
    make = partial(
        controller,
        list(skills.values()),
        role=role,
        law=law,
        dt=dt,
        goal=goal,
        gravity=_gravity(gravity),
        mass_kg=mass_kg,
        load_share=load_share,
        tare_s=tare_s,
        force_delay_s=1e-3 * force_delay_ms,
    )
    found = target.load()(make, out)
    may_write(found.files, inputs=list(paths), overwrite=overwrite)
    for path, text in found.files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    files = [str(path) for path in found.files]
    if json:
        print_json({"files": files, **found.about})
        return
    about = found.about
    axes = ", ".join(about["axes"])
    say(f"{', '.join(files)}: {about['role']}, law {about['law']!r}, axes {axes}, a tick each {about['dt_s']:g} s")
    say(f"state {about['state_bytes']} bytes; names begin with {about['prefix']}_; nobody has tried it on a robot: docs/robot.md")


def _named(out: Path | None, to: str, suffix: str, skill: Path) -> Path:
    """Where it goes; default beside the working directory, by the skill's own name."""
    if out is None:
        return Path(skill.stem + (suffix or "_controller"))
    if out.suffix.lower() != suffix:
        what = f"ends in {suffix}" if suffix else "is a folder, its name that of the package"
        raise ParameterError(f"-o {out}: --to {to} {what}; name another")
    return out


def _gravity(said: str | None) -> Array | None:
    if said is None:
        return None
    try:
        return np.array([float(part) for part in said.split(",")])
    except ValueError:
        raise ParameterError(f"--gravity {said}: one number an axis [m/s^2], for example 0,0,-9.81") from None
