"""run, fake-robot: a skill on a robot, real or simulated, through one door."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MismatchError, ParameterError
from ..formats import write
from ..formats.live import LiveFile
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..loop import WallClock, unbroken
from ..recording import Recording
from ..robots import driving, preflight
from ..robots import settings as robot_settings
from ..robots.guard import Guarded
from ..robots.robot import Robot, real, simulated
from ..robots.settings import Settings
from ..tasks import named
from ..trials.cases import TASK, Case, draw_case
from ..trials.judging import judge
from .console import note, print_json, say
from .ending import keeping
from .keys import keys
from .outputs import may_write, must_store
from .running import _lessons_start, _one_role_or_auto
from .verdicts import told
from .view import View

MOST_BEHIND_S = 0.5  # a fake robot that was kept waiting for longer (a laptop asleep) does not run after it
REAL_S = 60.0  # a run on an arm lasts so long where nobody says
AT_HOLD = (
    "at HOLD the hand brakes and stays stiff: let the object rest in both pairs of hands, take care of what the reason says, "
    "then press space (or r) to go on from there, or Ctrl-C to end"
)


def run(
    paths: Sequence[Path],
    robot: str,
    role: str | None,
    law: str | None,
    task: str | None,
    seed: int,
    shadow: bool,
    limit: float,
    preflight_s: float,
    duration_s: float | None,
    goal: int | None,
    realtime: bool,
    yes: bool,
    out: Path | None,
    overwrite: bool,
    json: bool,
) -> None:
    if not preflight_s > 0.0:
        raise ParameterError(f"--preflight-s is a time of measuring at rest, above 0 s; got {preflight_s:g}")
    found = robot_settings.load(robot)
    skills = {path: skill_file.load(path) for path in paths}
    _one_role_or_auto(skills, role)
    one = next(iter(skills.values()))
    acting = role or one.role
    if not acting:
        raise ParameterError(f"{paths[0]}: the skill states no role; pass --role leader or --role follower")
    out = out or _free(found.name, acting)
    must_store(out)
    may_write([out], inputs=list(paths), overwrite=overwrite)
    if found.real and task is not None:
        raise ParameterError(f"--task is for simulated robots ({', '.join(robot_settings.SIMULATED)}); an arm has its own")
    by_role = {acting: one} if acting != "auto" else {s.role: s for s in skills.values()}
    case = None if found.real else _case(acting, task, seed, one, paths[0])
    made = simulated(found, case) if case is not None else real(found)
    with closing(made):
        guard = driving.guarded(made, by_role, acting, law=law, share=limit, shadow=shadow, goal=goal)
        weighed, heard = _flown(made, guard, by_role, preflight_s, realtime, shadow, json)
        _agreed(made, shadow, yes)
        lasts = duration_s or (case.run_s if case is not None else REAL_S)
        about = {"role": acting, "law": law or one.law, "skill": [str(p) for p in paths], "limit": limit}
        about |= {} if case is None else {"seed": seed, "task": case.task.name, "partner": case.about()}
        view = View(guard, f"{made.settings.name}{', shadow' if shadow else ''}", acting, tuple(made.plant.axes), _notice(made))
        live = LiveFile(_live(out), metadata=about)
        does = {" ": guard.ask_rearm, "r": guard.ask_rearm, "q": lambda: guard.ask_stop("ended by the user")}
        with keys(does):
            recording = driving.drive(
                made, guard, weighed, duration_s=lasts, wrench_hz=heard, realtime=realtime, shadow=shadow, taps=[live, view],
                metadata=about,
            )  # fmt: skip
    _kept(recording, out, live)
    _said(recording, out, about, case, one, guard, json)
    unbroken(recording)


def _free(name: str, role: str) -> Path:
    """Where nobody says, under the first number that is free: a take is never lost, and never over another."""
    number = 1
    while (path := Path(f"{name}-{role}-{number}.mcap")).exists():
        number += 1
    return path


def _live(out: Path) -> Path:
    return out.with_suffix(".live.mcap")


def _case(role: str, task: str | None, seed: int, learned: LearnedSkill, path: Path) -> Case:
    what = named(task or TASK).runnable()
    if learned.axes != what.axes:
        raise MismatchError(
            f"{path}: task {what.name} moves axes {', '.join(what.axes)}; this skill moves {', '.join(learned.axes)}: name its "
            "task with --task (comanip tasks lists them)"
        )
    case = draw_case(role, np.random.default_rng(seed), task=what)
    return case.starting(_lessons_start(learned, what))


def _notice(robot: Robot) -> Any:
    return lambda: str(getattr(robot.plant, "notice", ""))


def _flown(
    robot: Robot,
    guard: Guarded,
    learned: Mapping[str, LearnedSkill],
    seconds: float,
    realtime: bool,
    shadow: bool,
    quiet: bool,
) -> tuple[Any, float]:
    """The pre-flight, told line by line; ParameterError where anything has not passed."""
    print(f"pre-flight: {robot.settings.name} at rest for {seconds:g} s; nothing is commanded", file=sys.stderr)
    lines, payload, heard = driving.fly(robot, guard, learned, seconds=seconds, realtime=realtime, commands=not shadow)
    for one in lines:
        print(f"  {'ok  ' if one.passed else 'FAIL'} {one.name:<12} {one.said}", file=sys.stderr)
    preflight.require(lines, robot.settings.source)
    if not quiet:
        note(AT_HOLD)
    return payload, heard


def _agreed(robot: Robot, shadow: bool, yes: bool) -> None:
    """A real arm moves only after somebody has said so here."""
    if not robot.real or shadow or yes:
        return
    if not sys.stdin.isatty():
        raise ParameterError(
            "a real robot moves only after Enter in a terminal; without one, pass --yes (and --limit 0.1 at first)"
        )
    print("hold your end. Enter: the robot may move now; Ctrl-C: it does not. ", end="", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise ParameterError("nobody said yes: nothing moved")


def _kept(recording: Recording, out: Path, live: LiveFile) -> None:
    cut = recording.metadata["stop_reason"] == "interrupted"
    write(recording.with_metadata(incomplete="interrupted") if cut else recording, out)
    live.discard()
    keeping(f"{out} holds the {recording.duration_s:.1f} s until then, and says that it is cut")


def _said(
    recording: Recording,
    out: Path,
    about: Mapping[str, Any],
    case: Case | None,
    learned: LearnedSkill,
    guard: Guarded,
    json: bool,
) -> None:
    result: dict[str, Any] = {
        "skill": ", ".join(about["skill"]),
        "robot": recording.metadata["robot"],
        "role": about["role"],
        "law": about["law"],
        "stop_reason": recording.metadata["stop_reason"],
        **_numbers(recording, guard),
    }
    if case is not None and not recording.metadata["shadow"]:
        verdict = judge(case, recording, start_m=case.start_m, taught_ends_m=learned.ends)
        result |= {"success": verdict.success, **verdict._asdict()}
    if notice := recording.metadata.get("notice"):
        result["notice"] = notice
    result["recording"] = str(out)
    if json:
        print_json(result)
    elif "success" in result:
        for line in told(result, partner=f"the partner of seed {about['seed']}", units=learned.units):
            say(line)
    else:
        for line in _lines(result):
            say(line)


def _numbers(recording: Recording, guard: Guarded) -> dict[str, Any]:
    mode = Counter(recording["skill.mode"].values[:, 0].tolist())
    dt = recording.metadata["dt_s"]
    late = recording["loop.late"].values[:, 0]
    return {
        "run_s": mode[0.0] * dt,
        "comply_s": mode[1.0] * dt,
        "hold_s": mode[2.0] * dt,
        "rearmed": guard.rearmed,
        "late_s": {"median": float(np.median(late)), "p99": float(np.percentile(late, 99)), "most": float(late.max())},
        "peak_felt_n": float(np.nanmax(np.linalg.norm(recording["hand.force"].values, axis=1), initial=0.0)),
        "moved_m": float(np.linalg.norm(np.ptp(recording["hand.position"].values, axis=0))),
    }


def _lines(result: Mapping[str, Any]) -> list[str]:
    late = result["late_s"]
    return [
        f"{result['skill']} as {result['role']}, law {result['law']}, on {result['robot']}",
        f"ended by: {result['stop_reason']}",
        f"  RUN {result['run_s']:.1f} s, COMPLY {result['comply_s']:.1f} s, HOLD {result['hold_s']:.1f} s, "
        f"re-armed {result['rearmed']} times",
        f"  moved {1e3 * result['moved_m']:.0f} mm, felt at most {result['peak_felt_n']:.1f} N",
        f"  ticks late by {1e3 * late['median']:.2f} ms (median), {1e3 * late['p99']:.2f} ms (99 %), "
        f"{1e3 * late['most']:.1f} ms at most",
        *([f"said at the end: {result['notice']}"] if "notice" in result else []),
        f"recording: {result['recording']}",
    ]


def fake(
    robot: str, role: str, task: str, seed: int, node_hz: float, duration_s: float | None, loss: float, jitter_ms: float
) -> None:
    """A node on this machine until Ctrl-C, or for so long."""
    from ..robots.fake import FakeRobot, Lossy
    from ..robots.people import cases, living, plant_of
    from ..robots.wire import Wire, opened

    found, what = robot_settings.load(robot), named(task).runnable()
    _fits(found, what.axes)
    draw = cases(role, what, seed)
    wiring = found.wire
    if wiring.transport == "zenoh":
        wiring = replace(wiring, listen=wiring.connect or ("tcp/127.0.0.1:7447",), connect=())
    wire: Wire = opened(wiring, "fake_robot")
    if loss or jitter_ms:
        wire = Lossy(wire, loss, 1e-3 * jitter_ms, np.random.default_rng(seed))
    node = FakeRobot(wire, found, plant_of("beam", draw(0), 1.0 / node_hz, at_rest=True), living(draw, 1.0 / node_hz))
    says = ", ".join(topic.name for topic in found.topics.values())
    note(
        f"fake robot: says {says} at {node_hz:g} Hz, hears {found.command.topic.name if found.command.topic else ''}; Ctrl-C ends"
    )
    clock, until = WallClock(), time.monotonic() + (duration_s or float("inf"))
    clock.start(1.0 / node_hz)
    late = 0.0
    with suppress(KeyboardInterrupt), closing(wire):
        while time.monotonic() < until:
            for _ in range(1 + int(min(late, MOST_BEHIND_S) * node_hz)):  # what it missed passes, too: the world does not wait
                node.tick()
            late = clock.wait()


def _fits(found: Settings, axes: tuple[str, ...]) -> None:
    if found.adapter != "ros2":
        raise ParameterError(f"{found.source}: a fake robot speaks adapter ros2; this is {found.adapter}")
    if tuple(found.axes) != axes:
        raise ParameterError(f"{found.source}: [axes] are {', '.join(found.axes)}; this task moves {', '.join(axes)}")
