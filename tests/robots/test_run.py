"""comanip run as a user meets it: one door for simulated and real robots, the take kept, one line for a mistake."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import forked
from comanip.commands.view import MODES, View
from comanip.formats import read
from comanip.interfaces import Command, Observation
from comanip.learned.file import save

ENVIRONMENT = {**os.environ, "PYTHONUNBUFFERED": "1"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, skills):
    path = tmp_path_factory.mktemp("robot")
    for role in ("leader", "follower"):
        save(skills[role], path / f"{role}.json")
    return path


def comanip(folder, *words):
    return forked.run(*words, cwd=folder)


def test_a_simulated_robot_goes_through_the_same_door(folder):
    done = comanip(folder, "run", "follower.json", "--robot", "beam", "--preflight-s", 1, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["success"]
    assert result["recording"] == "beam-follower-1.mcap"
    assert (result["hold_s"], result["rearmed"]) == (0.0, 0)
    for check in ("samples", "pose rate", "wrench rate", "lateness", "at rest", "sensor", "payload", "tare", "walls", "envelope"):
        assert f"ok   {check}" in done.stderr
    assert "FAIL" not in done.stderr
    run = read(folder / "beam-follower-1.mcap")[0]
    assert run.metadata["role"] == "follower"
    assert not (folder / "beam-follower-1.live.mcap").exists()


def test_without_a_name_no_take_is_written_over_another(folder):
    for _ in range(2):
        comanip(folder, "run", "leader.json", "--robot", "beam", "--preflight-s", 1, "--duration-s", 1, "--shadow")
    assert {"beam-leader-1.mcap", "beam-leader-2.mcap"} <= {f.name for f in folder.iterdir()}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("follower.json", "--robot", "beem"), "robot 'beem' is unknown; there are: beam, crisp"),
        (("follower.json", "--robot", "crisp"), "crisp: [axes] is missing"),
        (("follower.json", "--robot", "beam", "--limit", "2"), "(--limit) is 2; allowed: above 0"),
        (("follower.json", "--robot", "beam", "--preflight-s", "0"), "--preflight-s is a time"),
        (("follower.json", "leader.json", "--robot", "beam"), "2 skills and no --role"),
        (("follower.json", "--robot", "beam", "--role", "leader"), "leader"),
        (("follower.json", "--robot", "fake", "--task", "lift"), "--task is for simulated robots"),
        (("follower.json", "--robot", "beam", "-o", "take.txt"), "recordings are stored as .mcap or .csv"),
        (("follower.json", "--robot", "beam", "--task", "move_3d"), "move"),
    ],
)
def test_a_mistake_is_one_line_before_anything_moves(folder, words, said):
    done = comanip(folder, "run", *words)
    assert done.returncode == 2, done.stdout
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert "pre-flight" not in done.stderr


def test_walls_of_this_arm_are_held_against_where_it_stands(folder):
    (folder / "narrow.toml").write_text('preset = "beam"\n[axes]\nz = [0, 0, 1]\n[limits]\nwalls.z = [1.0, 1.2]\n')
    done = comanip(folder, "run", "follower.json", "--robot", "narrow.toml", "--preflight-s", 1)
    assert done.returncode == 2
    assert "narrow.toml: pre-flight: walls: z is 0.8" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("mode", "notice", "reason"),
    [
        (2.0, "HOLD: force 60 ms old; not re-armed: no force for 1.2 s", "force 60 ms old; not re-armed: no force for 1.2 s"),
        (1.0, "COMPLY: a hand that leads alone", "a hand that leads alone"),
        (0.0, "COMPLY: unlike what was taught", "COMPLY: unlike what was taught"),  # running, but not yet as it was taught
    ],
)
def test_the_view_says_the_mode_once_and_the_reason_whole(mode, notice, reason):
    about = {"mode": np.array([mode]), "tank": np.array([1.0])}
    guard = SimpleNamespace(diagnostics=about, notice=notice)
    shown = View(guard, "fake", "follower", ("z",)).shown(Observation(1), Command(1))
    assert (shown["mode"], shown["reason"]) == (MODES[int(mode)], reason)


def busy_if_late(said, code):
    if code == 2 and "FAIL lateness" in said:
        pytest.skip("this machine is too busy for a loop in real time, and the pre-flight says so")


def test_control_c_brakes_and_keeps_the_take(folder):
    words = ("run", "leader.json", "--robot", "beam", "--realtime", "--preflight-s", "1", "-o", "cut.mcap")
    command = [sys.executable, "-m", "comanip", *words]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT)
    before = []
    for line in process.stderr:
        before.append(line)
        if "RUN" in line:
            break
    else:
        busy_if_late("".join(before), process.wait())
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    run = read(folder / "cut.mcap")[0]
    assert run.metadata["incomplete"] == "interrupted"
    speed = np.abs(run["command.velocity"].values)
    assert speed[-1] == 0.0


def test_a_robot_behind_zenoh_is_carried_with_in_real_time(folder):
    pytest.importorskip("zenoh", reason="eclipse-zenoh is the ros extra")
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    (folder / "fake.toml").write_text(f'preset = "fake"\nwire.connect = ["tcp/127.0.0.1:{port}"]\nrates.late_s = 0.1\n')
    words = ["fake-robot", "--robot", "fake.toml", "--role", "leader", "--node-hz", "250"]
    node = subprocess.Popen([sys.executable, "-m", "comanip", *words], cwd=folder, stderr=subprocess.PIPE, text=True)
    try:
        assert "fake robot" in node.stderr.readline()
        about = ("--robot", "fake.toml", "--preflight-s", 1, "--duration-s", 6, "-o", "wire.mcap")
        refused = comanip(folder, "run", "leader.json", *about)
        assert refused.returncode == 2
        assert "--yes" in refused.stderr
        done = comanip(folder, "run", "leader.json", *about, "--yes", "--json")
        busy_if_late(done.stderr, done.returncode)
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)  # on a machine that is late, a HOLD that says so is right, too
        assert result["moved_m"] > 0.1 or (result["hold_s"] > 0.0 and any(w in result["notice"] for w in ("late", "old")))
        assert read(folder / "wire.mcap")[0]["robot.ages"].axes == ("pose", "force")
    finally:
        node.send_signal(signal.SIGINT)
        node.wait(10)


def test_nobody_there_is_one_line(folder):
    pytest.importorskip("zenoh", reason="eclipse-zenoh is the ros extra")
    (folder / "absent.toml").write_text('preset = "fake"\nwire.connect = ["tcp/127.0.0.1:9"]\n')
    done = comanip(folder, "run", "leader.json", "--robot", "absent.toml")
    assert done.returncode == 2
    assert "zenoh: tcp/127.0.0.1:9 cannot be reached" in done.stderr.splitlines()[-1]
