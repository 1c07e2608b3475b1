"""teach, reproduce: one run of the loop at a time."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..devices.link import Network
from ..errors import ComanipWarning, ParameterError
from ..formats import write
from ..formats.background import writing
from ..formats.live import LiveFile
from ..interfaces import Array, Tap
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..loop import SimulatedClock, WallClock, run, unbroken
from ..plants.replay import ReplayPlant
from ..recording import Recording
from ..reproduction import goal_of, make_auto, make_skill
from ..tasks import Task, named
from ..teaching import DYADS, Coupling
from ..teaching import teach as record_lessons
from ..trials import draw_case, judge, run_case
from ..trials.cases import TASK
from ..trials.running import told_goal
from ..trials.taught import taught as learned_now
from .console import note, print_json, progress, say, say_if_slow, table
from .ending import keeping
from .flags import DataFlags
from .outputs import may_draw, may_fill, may_write, must_store
from .reading import read_lessons
from .verdicts import told

LESSON_RATE_HZ = 100.0


def best_plant() -> str:
    """The humanoid where MuJoCo is installed, else the exact beam, which is said."""
    if find_spec("mujoco") is not None:
        return "humanoid"
    note("on the exact beam; for the humanoid: pip install 'comanip[humanoid]'")
    return "beam"


def teach(
    role: str,
    task: str,
    lessons: int,
    dyad: str,
    device: str,
    delay_ms: float,
    passivity: bool,
    seed: int,
    plant: str,
    out: Path,
    overwrite: bool,
    json: bool,
) -> None:
    if lessons < 1:
        raise ParameterError(f"--lessons must be at least 1; got {lessons}")
    network = Network(0.0005 * delay_ms, 0.0005 * delay_ms) if delay_ms else None
    coupling = Coupling.usual(device, network=network, passivity=passivity)
    files = [out / f"{role}_{n + 1}.mcap" for n in range(lessons)]
    may_fill(out, (file.name for file in files), overwrite=overwrite)
    out.mkdir(parents=True, exist_ok=True)

    def keep(number: int, recording: Recording) -> None:
        store(recording.with_metadata(seed=seed, plant=plant, dyad=dyad), files[number])
        whole = [f.name for f in files[: number + 1]]
        cut = f"; {whole.pop()} is cut, and says so" if recording.metadata.get("incomplete") == "interrupted" else ""
        keeping(f"{len(whole)} whole lessons of {lessons} in {out}{cut}")

    with writing() as store, progress(f"lessons as {role}") as report:
        recordings = record_lessons(
            role,
            lessons,
            task=task,
            rng=np.random.default_rng(seed),
            habits=DYADS[dyad],
            coupling=coupling,
            plant=plant,
            progress=report,
            keep=keep,
        )
    for said in sorted({str(r.metadata[k]) for r in recordings for k in ("incomplete", "notice") if k in r.metadata}):
        warnings.warn(said, ComanipWarning, stacklevel=2)
    if json:
        print_json({"role": role, "task": named(task).name, "files": [str(f) for f in files]})
        return
    rows = [
        (f.name, f"{r.duration_s:.1f}", f"{_farthest(r):.2f}", f"{np.linalg.norm(r['hand.true_force'].values, axis=1).max():.1f}")
        for f, r in zip(files, recordings, strict=True)
    ]
    table(f"Lessons of {named(task).name} as {role} in {out}", ("file", "s", "far m", "peak F N"), rows)


def _farthest(recording: Recording) -> float:
    """How far the hand comes from where it began [m]."""
    place = recording["hand.position"].values
    return float(np.linalg.norm(place - place[0], axis=1).max())


def taught(role: str, seed: int, lessons: int = 5, task: str | Path | Task = TASK) -> LearnedSkill:
    """A skill from fresh simulated lessons: what `trial` and `demo` use when no file is given. It knows how near to an obstacle
    any of them came (provenance "clearance_m")."""
    say_if_slow()
    return learned_now(role, seed, lessons, task)


def reproduce(
    paths: Sequence[Path],
    task: str | None,
    seed: int,
    role: str | None,
    law: str | None,
    plant: str,
    dt: float,
    goal: int | None,
    force_from: Path | None,
    realtime: bool,
    out: Path | None,
    plot: Path | None,
    data: DataFlags,
    overwrite: bool,
    json: bool,
) -> None:
    inputs = [*paths, *([force_from] if force_from else [])]
    may_draw(plot, inputs=inputs, overwrite=overwrite)
    if out is not None:
        must_store(out)
        may_write([out], inputs=inputs, overwrite=overwrite)
    skills = {path: skill_file.load(path) for path in paths}
    learned, path = skills[paths[0]], paths[0]
    _one_role_or_auto(skills, role)
    clock = WallClock() if realtime else SimulatedClock()
    # a run on the wall clock is on real time, and cannot be had again: it reaches the disk as it goes
    live = [LiveFile(out.with_suffix(".live.mcap"))] if realtime and out is not None else []
    if force_from is not None:
        recording, result = _replayed(learned, force_from, law, role, data, clock, live)
    else:
        acting = role or learned.role
        what = named(task or TASK).runnable()
        if learned.axes != what.axes:
            asked = f"--task {what.name}" if task else f"without --task it is {what.name}, which"
            raise ParameterError(
                f"{path}: {asked} moves axes {', '.join(what.axes)}; this skill moves {', '.join(learned.axes)}: name its task "
                "with --task (comanip tasks lists them), or use --force-from FILE"
            )
        if not acting:
            raise ParameterError(f"{path}: the skill states no role; pass --role leader or --role follower")
        case = draw_case(acting, np.random.default_rng(seed), task=what)
        if acting == "auto":
            skill = make_auto({one.role: one for one in skills.values()}, axes=learned.axes, dt=dt, law=law, goal=goal)
        else:
            number = goal if goal is not None else _number(learned, told_goal(case), law)
            skill = make_skill(learned, axes=learned.axes, dt=dt, law=law, role=acting, goal=number)
        start = _lessons_start(learned, what)
        about = {"seed": seed, "law": law or learned.law}
        recording = run_case(case, skill, plant=plant, dt=dt, start_m=start, clock=clock, taps=live, metadata=about)
        verdict = judge(case, recording, start_m=start, taught_ends_m=learned.ends)
        result = {"role": acting, "success": verdict.success, **verdict._asdict()}
    result = {
        "skill": ", ".join(str(one) for one in paths),
        "law": law or learned.law,
        "stop_reason": recording.metadata["stop_reason"],
        **result,
    }
    if notice := recording.metadata.get("notice"):
        result["notice"] = notice
    cut = recording.metadata["stop_reason"] == "interrupted"
    if out is not None:
        write(recording.with_metadata(incomplete="interrupted") if cut else recording, out)
        for file in live:
            file.discard()
        result["recording"] = str(out)
        keeping(f"{out} holds the {recording.duration_s:.1f} s until then, and says that it is cut")
    unbroken(recording)
    if plot is not None:
        from ..evaluation import drawing as figures

        stems = " and ".join(one.stem for one in paths)
        told_it = ", told nothing" if role == "auto" else ""
        figures.save(figures.reproduction(recording, title=f"{stems}{told_it}, law {result['law']}"), plot)
        result["picture"] = str(plot)
    if json:
        print_json(result)
        return
    for line in told(result, partner=f"the partner of seed {seed}", units=learned.units):
        say(line)


def _one_role_or_auto(skills: Mapping[Path, LearnedSkill], role: str | None) -> None:
    """Several skills are for a robot that finds out its role; otherwise all but the first would be left out in silence."""
    if len(skills) > 1 and role != "auto":
        raise ParameterError(
            f"{len(skills)} skills and {'--role ' + role if role else 'no --role'}: one is run; only --role auto takes "
            "skills of both roles"
        )
    roles = Counter(one.role for one in skills.values())
    if role == "auto" and (twice := [r or "not stated" for r, n in roles.items() if n > 1]):
        raise ParameterError(f"--role auto takes one skill a role; {twice[0]} comes twice among {', '.join(map(str, skills))}")


def _number(learned: LearnedSkill, place: Array | None, law: str | None) -> int | None:
    """Of the taught goal near `place` (d,) [m], from 1; None where the task says none, or the law knows none."""
    return None if place is None or (law or learned.law) == "paper" else (goal_of(learned, place) or 0) + 1


def _lessons_start(learned: LearnedSkill, task: Task) -> Array | None:
    """(d,) where the lessons started on average, of a task that goes one way along one axis. None: as the task says. A skill of
    an older version knows its workspace alone, the lessons' range half wider."""
    if len(task.axes) > 1 or len(task.phases) > 1 or task.cycles:
        return None
    if len(learned.starts):
        return np.asarray(learned.starts.mean(axis=0))
    up = (task.phases[0].to or next(iter(task.goals.values())))[0] > 0.0
    return np.asarray(learned.workspace @ ([0.75, 0.25] if up else [0.25, 0.75]))


def _replayed(
    learned: LearnedSkill, source: Path, law: str | None, role: str | None, data: DataFlags, clock: Any, taps: Sequence[Tap]
) -> tuple[Recording, dict[str, Any]]:
    """The paper's Fig. 7 way: recorded force as input. Says how the skill responds, nothing about collaboration."""
    lesson = read_lessons([source], data)[0]
    plant = ReplayPlant(lesson.force, dt=lesson.dt, start_position=lesson.position[0], axes=learned.axes)
    # nobody is there to be protected, and nobody answers: the envelope would only end the replay
    skill = make_skill(learned, axes=learned.axes, dt=lesson.dt, law=law, role=role, envelope=False, gives_way=False)
    recording = run(
        plant, skill, duration_s=len(lesson) * lesson.dt, clock=clock, taps=taps, metadata={"force_from": str(source)}
    )
    apart = recording["hand.position"].values - lesson.position
    return recording, {
        "force_from": str(source),
        "position_rmse_m": float(np.sqrt((apart**2).sum(axis=1).mean())),
        "end_error_m": float(np.linalg.norm(apart[-1])),
    }
