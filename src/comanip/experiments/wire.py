"""ROS 2's wire on loopback, measured: latency, losses, a node that restarts, and partners behind it. Needs comanip[ros].

    python -m comanip.experiments.wire [--seconds 60] [--partners 10] [--realtime 50] [--out wire.json]
    python -m comanip.experiments.wire --over 60

The node (`comanip fake-robot`) is a process of its own; stamps are the system's clock, which both processes share. `--realtime`
asks Linux for a place before all other programs, as a robot's loop has it (`chrt -f 50 comanip run`); it needs the right to.
`--over` carries with so many partners a role over the same bytes in one thread and one time, and without the wire.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from comanip.commands.running import taught
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.interfaces import Array
from comanip.learned.skill import LearnedSkill
from comanip.recording import Recording
from comanip.robots import driving
from comanip.robots.messages import Reader, Writer
from comanip.robots.over import robot_of
from comanip.robots.people import cases
from comanip.robots.robot import Robot, real, simulated
from comanip.robots.settings import Settings, load
from comanip.robots.wire import opened
from comanip.tasks import named
from comanip.trials.judging import judge

RATE_HZ = 500.0
SEED = 7
HOLD = 2.0
LOSS, JITTER_MS = 0.01, 20.0
AWAY_S = 1.0  # of the node that restarts


def free_port() -> int:
    """One that nobody listens to, on this machine alone."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def wired(folder: Path, rate_hz: float) -> tuple[Settings, Path]:
    """The fake robot on a port of its own."""
    path = folder / "robot.toml"
    path.write_text(f'preset = "fake"\nrate_hz = {rate_hz}\nwire.connect = ["tcp/127.0.0.1:{free_port()}"]\n')
    return load(path), path


class Node:
    """`comanip fake-robot` in a process of its own."""

    def __init__(self, path: Path, role: str, *flags: str) -> None:
        words = ["fake-robot", "--robot", str(path), "--role", role, "--seed", str(SEED), "--node-hz", str(RATE_HZ), *flags]
        self._process = subprocess.Popen([sys.executable, "-m", "comanip", *words], stderr=subprocess.PIPE, text=True)
        assert self._process.stderr is not None
        self._process.stderr.readline()  # it says when it is there

    def end(self, how: int = signal.SIGTERM) -> None:
        self._process.send_signal(how)
        self._process.wait()


def latency(settings: Settings, seconds: float) -> dict[str, float]:
    """Both ways [ms]: a pose is stamped, heard in another process, and a twist with its stamp comes back."""
    wiring = replace(settings.wire, listen=settings.wire.connect, connect=())
    here = opened(wiring, "measures")
    echo = subprocess.Popen([sys.executable, "-m", "comanip.experiments.wire", "--echo", settings.source])
    topic, answer = settings.topics["pose"], settings.command.topic
    assert answer is not None
    reader, took = Reader(answer.type), []
    here.subscribe(answer, lambda m: took.append(time.time() - reader.read(m).stamp))
    pose, force = here.advertise(topic), here.advertise(settings.topics["wrench"])
    say, feel = Writer(topic.type, "base"), Writer(settings.topics["wrench"].type, "ft_sensor")
    while not took:  # until the other one is there
        pose(say.write(time.time_ns(), (0.0,) * 3 + (1.0, 0.0, 0.0, 0.0)))
        time.sleep(0.05)
    took.clear()
    due = time.monotonic()
    for _ in range(round(seconds * RATE_HZ)):
        force(feel.write(time.time_ns(), (0.0,) * 6))
        pose(say.write(time.time_ns(), (0.0,) * 3 + (1.0, 0.0, 0.0, 0.0)))
        due += 1.0 / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(0.2)
    echo.terminate()
    echo.wait()
    here.close()
    sent, ms = round(seconds * RATE_HZ), 1e3 * np.array(took)
    return {
        "sent": sent,
        "answered": len(ms),
        "median_ms": float(np.median(ms)),
        "p99_ms": float(np.percentile(ms, 99)),
        "most_ms": float(ms.max()),
    }


def echoes(settings: Settings) -> None:
    """The other process: each pose's stamp comes back on a twist."""
    wire, topic, answer = opened(settings.wire, "echoes"), settings.topics["pose"], settings.command.topic
    assert answer is not None
    reader, writer, say = Reader(topic.type), Writer(answer.type, "base"), wire.advertise(answer)
    heard = Reader(settings.topics["wrench"].type)
    wire.subscribe(settings.topics["wrench"], heard.read)  # type: ignore[arg-type]
    wire.subscribe(topic, lambda m: say(writer.write(round(reader.read(m).stamp * 1e9), (0.0,) * 6)))
    threading.Event().wait()


def driven(
    settings: Settings, learned: LearnedSkill, duration_s: float, *, during: Any = None, preflight_s: float = 2.0
) -> tuple[Recording, list[str]]:
    """One run over the wire, and the reasons of its HOLDs; `during` is called on a thread as the run begins."""
    robot = real(settings)
    try:
        guard = driving.guarded(robot, {learned.role: learned}, learned.role)
        lines, payload, heard = driving.fly(robot, guard, {learned.role: learned}, seconds=preflight_s)
        failed = [f"{one.name}: {one.said}" for one in lines if not one.passed]
        reasons: list[str] = []

        def tap(obs: Any, command: Any) -> None:
            if guard.envelope.mode == "HOLD" and guard.envelope.reason not in reasons:
                reasons.append(guard.envelope.reason)

        thread = threading.Thread(target=during) if during is not None else None
        if thread is not None:
            thread.start()
        recording = driving.drive(robot, guard, payload, duration_s=duration_s, wrench_hz=heard, taps=[tap])
        if thread is not None:
            thread.join()
        return recording, [f"pre-flight {one}" for one in failed] + reasons
    finally:
        robot.close()


def summary(recording: Recording, reasons: Sequence[str], settings: Settings) -> dict[str, Any]:
    """What a run over the wire was like: share of ticks in HOLD, lateness, ages, and the largest jump of what was commanded."""
    v, mode = recording["command.velocity"].values, recording["skill.mode"].values[:, 0]
    late, ages = recording["loop.late"].values[:, 0], recording["robot.ages"].values
    jumps = np.linalg.norm(np.diff(v, axis=0, prepend=0.0), axis=1)
    return {
        "hold": float((mode == HOLD).mean()),
        "reasons": list(reasons),
        "late_p99_ms": float(1e3 * np.percentile(late, 99)),
        "late_most_ms": float(1e3 * late.max()),
        "pose_age_median_ms": float(1e3 * np.median(ages[:, 0])),
        "pose_age_p99_ms": float(1e3 * np.percentile(ages[:, 0], 99)),
        "jump_m_per_s": float(jumps.max()),
        "moved_m": float(np.ptp(recording["hand.position"].values)),
    }


def restarted(settings: Settings, path: Path, learned: LearnedSkill) -> dict[str, Any]:
    """The node is killed in the middle of the motion and started again."""
    nodes = [Node(path, learned.role)]
    onset = cases(learned.role, named("lift"), SEED)(0).onset_s

    def during() -> None:
        time.sleep(onset + 0.9)
        nodes.pop().end(signal.SIGKILL)
        time.sleep(AWAY_S)
        nodes.append(Node(path, learned.role))

    try:
        recording, reasons = driven(settings, learned, onset + 7.0, during=during)
    finally:
        for node in nodes:
            node.end()
    found = summary(recording, reasons, settings)
    mode, v = recording["skill.mode"].values[:, 0], recording["command.velocity"].values
    first = int(np.argmax(mode == HOLD))
    settled = first + round(0.2 / recording.metadata["dt_s"])
    return found | {
        "speed_before_m_per_s": float(np.abs(v[:first]).max(initial=0.0)),
        "speed_after_m_per_s": float(np.abs(v[settled:]).max(initial=0.0)),
    }


def partners(folder: Path, learned: LearnedSkill, count: int) -> dict[str, Any]:
    """The end of each run with usual partners, who are known by their numbers, against where they meant to go."""
    settings, path = wired(folder, 100.0)
    node, draw, errors = Node(path, learned.role), cases(learned.role, named("lift"), SEED), []
    try:
        for number in range(count):
            case = draw(number)
            recording, reasons = driven(settings, learned, case.run_s, preflight_s=1.0)
            place = recording["hand.position"].values
            errors.append(float(np.linalg.norm(place[-1] - case.start_m - _meant(case))) if not reasons else float("inf"))
            time.sleep(1.5)  # longer than the node takes for the end of a run
    finally:
        node.end()
    return {"partners": count, "within_2_cm": sum(e < 0.02 for e in errors), "end_errors_m": errors}


def over(count: int, *, seed: int = SEED, told: Any = lambda _: None) -> list[dict[str, Any]]:
    """The same usual partners over the wire's bytes and without them, in one thread and one time: who succeeds, by role."""
    rows = []
    for role in ("follower", "leader", "auto"):
        learned = {one: taught(one, seed=1) for one in (("leader", "follower") if role == "auto" else (role,))}
        draw, fake, plain = cases(role, named("lift"), seed), load("fake"), load("beam")
        wired, direct = [], []
        for number in range(count):
            case = draw(number)
            wired.append(_succeeds(robot_of(fake, case), learned, case))
            direct.append(_succeeds(simulated(plain, case), learned, case))
            told(f"{role}: {number + 1} of {count}, {sum(wired)} over the wire, {sum(direct)} without")
        only = [n for n in range(count) if wired[n] != direct[n]]
        rows.append({"role": role, "partners": count, "over_the_wire": sum(wired), "without": sum(direct), "otherwise": only})
    return rows


def _succeeds(robot: Robot, learned: dict[str, LearnedSkill], case: Any) -> bool:
    guard = driving.guarded(robot, learned, case.role)
    lines, payload, heard = driving.fly(robot, guard, learned, seconds=0.5)
    if not all(one.passed for one in lines):
        return False
    recording = driving.drive(robot, guard, payload, duration_s=case.run_s, wrench_hz=heard)
    ends = (learned.get("leader") or learned[case.role]).ends
    return judge(case, recording, start_m=case.start_m, taught_ends_m=ends).success


def _meant(case: Any) -> Array:
    course = case.course
    return np.asarray(course.sampled(np.array([course.stop_s]))[0])


def measure(folder: Path, seconds: float, count: int) -> tuple[dict[str, Any], list[Claim]]:
    """Everything, and what is claimed of it."""
    learned = taught("follower", seed=1)
    settings, path = wired(folder, RATE_HZ)
    found: dict[str, Any] = {"latency": latency(settings, seconds)}
    for name, flags in (("loop", ()), ("loss", ("--loss", str(LOSS), "--jitter-ms", str(JITTER_MS)))):
        settings, path = wired(folder, RATE_HZ)
        node = Node(path, "follower", *flags)
        try:
            found[name] = summary(*driven(settings, learned, seconds if name == "loop" else min(seconds, 20.0)), settings)
        finally:
            node.end()
    settings, path = wired(folder, RATE_HZ)
    found["restart"] = restarted(settings, path, learned)
    found["partners"] = partners(folder, learned, count)
    step = settings.acceleration_m_per_s2 / RATE_HZ
    claims = [
        at_most("both ways over the wire, median", found["latency"]["median_ms"], 1.0, unit="ms", refuted_by="a slower wire"),
        at_most("both ways over the wire, 99 %", found["latency"]["p99_ms"], 3.0, unit="ms", refuted_by="stalls"),
        at_most("share of ticks in HOLD at 500 Hz", found["loop"]["hold"], 0.0, refuted_by="a late tick"),
        at_least("ticks in HOLD after the node was killed", found["restart"]["hold"], 0.01, refuted_by="going on blind"),
        at_most(
            "speed commanded from 0.2 s after", found["restart"]["speed_after_m_per_s"], 0.0, unit="m/s", refuted_by="a jump"
        ),
        at_least("partners of the wire, within 2 cm", found["partners"]["within_2_cm"], count, refuted_by="one who is not"),
    ]
    claims += [
        at_most(
            f"change of the command in a tick, {name}", found[name]["jump_m_per_s"], 10.0 * step, unit="m/s", refuted_by="a jump"
        )
        for name in ("loop", "loss", "restart")
    ]
    return found, claims


def main() -> None:
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    about.add_argument("--seconds", type=float, default=60.0)
    about.add_argument("--partners", type=int, default=10)
    about.add_argument("--out", type=Path)
    about.add_argument("--over", type=int, help="partners a role in one thread and one time, with and without the wire; no more")
    about.add_argument("--realtime", type=int, help="priority of SCHED_FIFO, 1 to 99")
    about.add_argument("--echo", type=Path, help=argparse.SUPPRESS)
    asked = about.parse_args()
    if asked.echo:
        echoes(load(asked.echo))
        return
    if asked.over:
        print(json.dumps(over(asked.over, told=lambda text: print(text, file=sys.stderr)), indent=1))
        return
    if asked.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(asked.realtime))
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        found, claims = measure(Path(folder), asked.seconds, asked.partners)
    print(json.dumps(found, indent=1))
    for claim in claims:
        print(f"{'pass' if claim.passed else 'FAIL'}  {claim.text}: {claim.measured:.4g} ({claim.bound})")
    if asked.out:
        asked.out.write_text(json.dumps({"found": found, "claims": [c._asdict() for c in claims]}, indent=1))


if __name__ == "__main__":
    main()
