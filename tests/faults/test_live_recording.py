"""P1: a run that is killed leaves a file that opens, with all but the last half second."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from comanip.errors import ComanipWarning, RecordingError
from comanip.formats import read, write
from comanip.formats.live import LiveFile
from comanip.loop import run
from hanging import hanging_is_an_error
from haptics import Scripted, driven, pulse

TICKING = """
import sys
from pathlib import Path
from comanip.formats.live import LiveFile
from comanip.loop import WallClock, run
from comanip.skills.teleoperation import Teleoperation
from haptics import FreeHand, Scripted

counter = open(sys.argv[2], "r+b", buffering=0)
def count(obs, command):
    counter.seek(0)
    counter.write(f"{obs.time:12.6f}".encode())

plant = FreeHand(dt=0.01)
skill = Teleoperation(Scripted(lambda t: 0.05), n_axes=1, dt=plant.dt)
run(plant, skill, duration_s=60.0, clock=WallClock(), taps=[LiveFile(Path(sys.argv[1]), {"role": "leader"}), count])
"""


@pytest.mark.parametrize("everything", [False, True], ids=["the run", "the run and the writer"])
@pytest.mark.parametrize("seed", [0, 1])
def test_p1_kill_9_loses_less_than_half_a_second_and_the_file_opens(tmp_path, seed, everything):
    path, counter = tmp_path / "take.live.mcap", tmp_path / "counter"
    counter.write_bytes(b" " * 12)
    process = subprocess.Popen(
        [sys.executable, "-c", TICKING, str(path), str(counter)], env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    )
    deadline = time.monotonic() + 20.0
    while not counter.read_bytes().strip() and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(float(np.random.default_rng(seed).uniform(1.0, 2.0)))
    children = subprocess.run(["ps", "--ppid", str(process.pid), "-o", "pid="], capture_output=True, text=True).stdout.split()
    assert len(children) == 1
    if everything:  # the writer first: when its pipe ends it closes the file as it should
        os.kill(int(children[0]), signal.SIGKILL)
    process.kill()
    process.wait()
    while subprocess.run(["ps", "-p", children[0], "-o", "stat="], capture_output=True, text=True).stdout.strip(" Z\n"):
        time.sleep(0.02)
    reached = float(counter.read_bytes())
    if everything:
        with pytest.warns(ComanipWarning, match="cut short"):
            (back,) = read(path)
    else:
        (back,) = read(path)
    position = back["hand.position"]
    assert reached - position.time[-1] <= (0.5 if everything else 0.2)
    assert position.values[:, 0] == pytest.approx(np.maximum(1.3 * 0.05 * (position.time - 0.01), 0.0), abs=2e-3)
    assert back.metadata["role"] == "leader"
    assert back.metadata["incomplete"] == "the program ended before the recording did"
    assert {"command.velocity", "device.position", "coupling.mode"} <= set(back.channels)


def test_a_run_that_ends_leaves_the_same_values_in_both_files(tmp_path):
    live = LiveFile(tmp_path / "take.live.mcap")
    recording = driven(Scripted(pulse(0.1, 0.3, 0.2)), duration=0.5, taps=[live])
    write(recording, tmp_path / "take.mcap")
    (kept,), (whole,) = read(live.path), read(tmp_path / "take.mcap")
    assert not live.behind
    assert set(kept.channels) == set(whole.channels)
    for name, channel in whole.channels.items():
        assert np.array_equal(kept[name].values, channel.values, equal_nan=True), name
        assert np.array_equal(kept[name].time, channel.time)
        assert (kept[name].unit, kept[name].axes) == (channel.unit, channel.axes)
    live.discard()
    assert not live.path.exists()


def test_a_slow_or_dead_writer_does_not_touch_the_run(tmp_path, monkeypatch):
    live = LiveFile(tmp_path / "take.live.mcap")
    started = live.begin

    def begin(recorder):
        started(recorder)
        os.kill(live._writer.pid, signal.SIGKILL)
        live._writer.wait()

    monkeypatch.setattr(live, "begin", begin)
    monkeypatch.setattr("comanip.formats.live.FLUSH_S", 0.0)
    with hanging_is_an_error():
        recording = run(*_lifting(), duration_s=1.0, taps=[live])
    assert len(recording["hand.position"].time) == 100
    assert live.behind


def _lifting():
    from comanip.skills.teleoperation import Teleoperation
    from haptics import FreeHand

    plant = FreeHand(dt=0.01)
    return plant, Teleoperation(Scripted(lambda t: 0.1), n_axes=1, dt=plant.dt)


def test_a_place_that_cannot_be_written_to_is_named_before_the_run(tmp_path):
    with pytest.raises(RecordingError, match="choose a directory that can be written to"):
        driven(Scripted(lambda t: 0.1), duration=0.1, taps=[LiveFile(tmp_path / "none" / "take.mcap")])
