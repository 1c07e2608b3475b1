"""From learned skills to the page: one HTML file that holds the robot, the world and the application, and asks no network."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MismatchError, ParameterError
from ..formats.cdr import SCHEMAS
from ..learned.file import to_json
from ..learned.skill import LearnedSkill
from ..tasks import Task, named
from ..tasks.way import spread, usual, way
from ..whole_file import write_whole
from .conditions import read_plan, usual_plan
from .numbers import EXPECTED_DELAY_S, constants, encoded, numbers, robot, roles
from .person import Hand

DT_S, WAY_STEP_S = 0.01, 0.02
MODULES = (
    "files", "recordings", "mcap", "engine", "scene", "hands", "sound", "judge", "strips", "session", "prepare", "skillfile",
    "em", "learn", "teach", "study", "understand", "about", "main",
)  # fmt: skip
# of the exact beam and its sensor, as plants.beam has them
ROBOT = {
    "dt_s": DT_S, "step_s": 0.001, "wrist_stiffness_nm_per_rad": 2000.0, "wrist_damping_nms_per_rad": 29.0,
    "actuator_lag_s": 0.02, "noise_n": 0.2, "bias_n": 0.0, "delay_s": 0.005, "expected_delay_s": EXPECTED_DELAY_S,
    "v_max_m_per_s": 0.8, "a_max_m_per_s2": 10.0,
}  # fmt: skip
ABOUT = [
    "You hold one end of a beam, a robot the other. The robot learned to lead and to follow from a few lessons. Its whole skill "
    "(force estimate, model, law, roles) and its whole safety envelope are computed in this page, by the same C that comanip "
    "runs elsewhere, a hundred times a second; beam and hand a thousand times. Nothing is sent anywhere.",
    "The beam is the exact beam of comanip, held level by the robot's wrist. Your pointer leads your hand, at 0.33 m/s at most, "
    "through a spring of 80 N/m and 14 N s/m, at most 20 N; your hand weighs 1 kg and holds the beam with a soft grip of "
    "2 kN/m. How far the elastic stretches is the force. A mouse gives no force back: you see and hear it, and do not feel it.",
    "The robots without a skill, in lessons and studies (mass-damper, damping, a plan that gives way), have no envelope but a "
    "limit of speed and acceleration. This is a simulation, and no statement about a real robot or about real people.",
]
_IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const|let)\b)", re.MULTILINE)


def write_page(
    skills: Mapping[str, LearnedSkill], out: Path, *, task: str | Path | None = None, seed: int = 1, study: Path | None = None
) -> None:
    """Writes the page for skills by role ("leader", "follower", "natural") to `out`."""
    write_whole(out, page(skills, task=task, seed=seed, study=study))


def page(
    skills: Mapping[str, LearnedSkill],
    *,
    task: str | Path | None = None,
    seed: int = 1,
    title: str = "",
    study: Path | None = None,
) -> str:
    """The page as text.

    task   what is carried, and from where: a name of `parts.TASKS`, or a file; None: the one the lessons state, else lift
    study  a TOML file of the robots that a study compares (conditions.py); None: the skill, a mass-damper and a damper
    Raises MismatchError where the skills' axes are not the task's, or turn.
    """
    if not skills:
        raise ParameterError("a page needs a skill: leader, follower, or both")
    known = _task(skills, task)
    config = {
        "title": title or known.name,
        "seed": seed,
        "task": _told(known),
        "robot": ROBOT,
        "hand": asdict(Hand()),
        "skills": {role: to_json(one) for role, one in skills.items()},
        "numbers": _numbers(skills, known),
        "prepare": constants(known, dt=DT_S),
        "energy_j": 3.0,
        "study": read_plan(study, known, dt=DT_S) if study else usual_plan(skills),
        "about": ABOUT,
        "wasm": base64.b64encode(_read_bytes("page.wasm")).decode(),
    }
    filled = {"/*STYLE*/": _read("style.css"), "/*CONFIG*/": _script(config), "/*SCRIPT*/": bundle()}
    parts = re.split(r"(/\*(?:STYLE|CONFIG|SCRIPT)\*/)", _read("index.html"))
    return "".join(filled.get(part, part) for part in parts)


def bundle() -> str:
    """The modules of app/ as one script, each after those that it imports."""
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", _read(f"{name}.js"))) for name in MODULES)


def _numbers(skills: Mapping[str, LearnedSkill], task: Task) -> dict[str, str]:
    """What the page can be told -> the numbers of that robot."""
    return {role: encoded(numbers(robot(skills, role, dt=DT_S), task)) for role in roles(skills)}


def _task(skills: Mapping[str, LearnedSkill], task: str | Path | None) -> Task:
    known = named(str(task or "lift"))
    if turning := [axis.name for axis in known.axes_ if axis.kind != "length"]:
        raise MismatchError(f"task {known.name!r} turns along {turning[0]!r}; the page carries along straight axes alone")
    for role, one in skills.items():
        if one.axes != known.axes:
            raise MismatchError(
                f"skill {role!r} is for the axes {', '.join(one.axes)}, task {known.name!r} has {', '.join(known.axes)}: "
                "give another --task"
            )
    return known


def _told(task: Task) -> dict[str, Any]:
    gravity = task.gravity.tolist()
    return {
        "name": task.name,
        "axes": [
            {"name": axis.name, "up": axis.up, "start": float(start)} for axis, start in zip(task.axes_, task.start, strict=True)
        ],
        "gravity": gravity,
        "axial": [float(axis == task.carried.along) for axis in task.axes],
        "mass_kg": task.carried.mass_kg,
        "length_m": task.carried.length_m,
        "share": task.carried.share,
        "ways": [_way(task, goal) for goal in (task.goals or ("",))],
        "lessons": _lessons(task),
        "schemas": dict(SCHEMAS),
    }


def _way(task: Task, goal: str) -> list[list[float]]:
    """Rows (d,) [m] from the start, `WAY_STEP_S` apart: the usual way, by which a scripted robot leads lessons."""
    course = way(task, usual(task, goal)).course
    times = np.arange(0.0, course.stop_s + WAY_STEP_S, WAY_STEP_S)
    return [[round(x, 6) for x in course.at(t)[0].tolist()] for t in times.tolist()]


def _lessons(task: Task) -> dict[str, Any]:
    """How lessons differ: deviations and the shortest as shares of the usual way."""
    of = spread(task)
    return {
        "size_sd": of.size_m[1] / of.size_m[0],
        "duration_sd": of.duration_s[1] / of.duration_s[0],
        "shortest": of.shortest_s / of.duration_s[0],
        "onset_s": list(of.onset_s),
        "step_s": WAY_STEP_S,
    }


def _script(value: Any) -> str:
    """JSON that cannot end the script it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def _read(name: str) -> str:
    return (files(__package__) / "app" / name).read_text(encoding="utf-8")


def _read_bytes(name: str) -> bytes:
    return (files(__package__) / name).read_bytes()
