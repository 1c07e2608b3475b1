"""P4, P6, P9, P10, P11: a take on a full or slow disk, two writers, what a crash leaves, and whose modules a child runs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from comanip.errors import ComanipWarning, ParameterError, RecordingError
from comanip.formats import read, recover, write
from comanip.formats.live import LiveFile
from comanip.loop import run
from comanip.skills.teleoperation import Teleoperation
from hanging import hanging_is_an_error
from haptics import FreeHand, Scripted, driven
from lifts import lift

POSIX = pytest.mark.skipif(os.name != "posix", reason="limits of files and kill -9 are POSIX's")


def lifting(duration_s=0.3, taps=(), clock=None):
    plant = FreeHand(dt=0.01)
    skill = Teleoperation(Scripted(lambda t: 0.1), n_axes=1, dt=plant.dt)
    return run(plant, skill, duration_s=duration_s, taps=list(taps), clock=clock)


# P6, P9 -------------------------------------------------------------------------------------------------------------------


def test_p6_a_second_writer_of_one_take_is_refused_with_the_number_of_the_first(tmp_path):
    first = LiveFile(tmp_path / "take.live.mcap")
    lifting(taps=[first], duration_s=0.1)
    held = LiveFile(tmp_path / "other.live.mcap")
    held._lock.take()
    try:
        code = (
            "import sys; sys.path[:] = sys.argv[2:]\nfrom pathlib import Path\n"
            "from comanip.formats.locks import Lock\nLock(Path(sys.argv[1])).take()"
        )
        said = subprocess.run([sys.executable, "-c", code, str(held.path), *sys.path], capture_output=True, text=True).stderr
        assert f"in use by pid {os.getpid()}; give another name" in said
        with pytest.raises(RecordingError, match=f"in use by pid {os.getpid()}"):
            lifting(taps=[LiveFile(tmp_path / "other.live.mcap")])
    finally:
        held._lock.free()
    lifting(taps=[LiveFile(tmp_path / "other.live.mcap")], duration_s=0.1)
    assert list(tmp_path.glob("*.lock")) == []


def test_p9_a_stale_lock_is_taken_over_and_said(tmp_path):
    (tmp_path / "take.live.mcap.lock").write_text("999999\n")
    with pytest.warns(ComanipWarning, match="the lock of pid 999999, which is gone, was taken over"):
        lifting(taps=[LiveFile(tmp_path / "take.live.mcap")], duration_s=0.1)
    assert list(tmp_path.glob("*.lock")) == []


def test_p9_what_an_earlier_run_left_is_kept_under_another_name(tmp_path):
    lifting(taps=[LiveFile(tmp_path / "take.live.mcap", {"operator": "first"})], duration_s=0.1)
    with pytest.warns(ComanipWarning, match="an earlier run left it behind; kept as take.live-1.mcap"):
        lifting(taps=[LiveFile(tmp_path / "take.live.mcap", {"operator": "second"})], duration_s=0.1)
    assert read(tmp_path / "take.live-1.mcap")[0].metadata["operator"] == "first"
    assert read(tmp_path / "take.live.mcap")[0].metadata["operator"] == "second"


# P4, P10 ------------------------------------------------------------------------------------------------------------------

SMALL_DISK = """
import resource, sys, warnings
from pathlib import Path
sys.path[:] = sys.argv[2:]
from test_takes import lifting
from comanip.formats.live import LiveFile
from comanip.loop import WallClock
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
live = LiveFile(Path(sys.argv[1]))
recording = lifting(4.0, [live], WallClock())
print(len(recording["hand.position"].time), live.stopped)
"""


@POSIX
def test_p4_a_full_disk_ends_the_take_not_the_run_and_keeps_what_is_written(tmp_path):
    path = tmp_path / "take.live.mcap"
    places = [os.path.dirname(__file__), os.path.join(os.path.dirname(__file__), ".."), *sys.path]
    done = subprocess.run([sys.executable, "-c", SMALL_DISK, str(path), *places], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "take.live.mcap: recording stopped: File too large; what was written is kept" in done.stderr
    assert done.stdout.startswith("400 File too large")
    with pytest.warns(ComanipWarning, match="cut short"):
        (kept,) = read(path)
    assert 20 < len(kept["hand.position"].time) < 400
    assert (np.diff(kept["hand.position"].time) > 0).all()


@POSIX
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="/dev/full is Linux's")
def test_p4_a_disk_that_is_full_from_the_start_is_said_without_a_traceback(tmp_path, capfd):
    path = tmp_path / "take.live.mcap"
    path.symlink_to("/dev/full")
    live = LiveFile(path)
    with pytest.warns(ComanipWarning, match="recording stopped: No space left on device"):
        recording = lifting(0.5, [live])
    assert len(recording["hand.position"].time) == 50
    assert "Traceback" not in capfd.readouterr().err


def test_p4_little_room_is_warned_of_before_the_take(tmp_path, monkeypatch):
    import shutil

    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10, 5, 500 << 20))
    with pytest.warns(ComanipWarning, match="500 MB left on the disk"):
        lifting(0.1, [LiveFile(tmp_path / "take.live.mcap")])


@POSIX
def test_p10_a_disk_that_stands_still_costs_the_loop_nothing_and_rows_left_out_are_counted(tmp_path, monkeypatch):
    import comanip.formats.live as module

    monkeypatch.setattr(module, "BACKLOG", 4)
    monkeypatch.setattr(module, "FLUSH_S", 0.0)
    live = LiveFile(tmp_path / "take.live.mcap")
    plant = FreeHand(dt=0.01)
    skill = Teleoperation(Scripted(lambda t: 0.1), n_axes=1, dt=plant.dt)

    def stopped(obs, command):
        if obs.time < 0.005:
            os.kill(live._writer.pid, signal.SIGSTOP)
            os.set_blocking(live._writer.stdin.fileno(), True)
        if obs.time > 5.985:  # the loop went through with nobody reading; it is over, and so is its patience
            monkeypatch.setattr(module, "PATIENCE_S", 0.2)

    with pytest.warns(ComanipWarning, match=r"the disk took no data for 0\.2 s"), hanging_is_an_error():
        recording = run(plant, skill, duration_s=6.0, taps=[live, stopped])
    assert len(recording["hand.position"].time) == 600
    assert live.behind
    assert live._left_out > 300


# Recovery -----------------------------------------------------------------------------------------------------------------


def test_what_a_cut_take_holds_becomes_a_whole_file_and_the_damage_is_said(tmp_path):
    path = tmp_path / "take.live.mcap"
    write(lift(), path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    target, recording = recover(path)
    assert target == tmp_path / "take.recovered.mcap"
    (again,) = read(target)
    assert 100 < len(again["hand.force"].time) < 401
    assert np.array_equal(again["hand.force"].values, lift()["hand.force"].values[: len(again["hand.force"].time)])
    assert "cut short: recovered" in again.metadata["recovered"]
    assert path.read_bytes() == data[: len(data) * 2 // 3]
    with pytest.raises(RecordingError, match="is there already"):
        recover(path)
    assert recover(path, tmp_path / "b.csv")[0].exists()
    with pytest.raises(ParameterError, match="no format for"):
        recover(path, tmp_path / "b.xyz")
    assert recording.metadata["role"] == "follower"


def test_a_take_that_is_being_written_is_not_recovered_and_an_empty_one_is_named(tmp_path):
    live = LiveFile(tmp_path / "take.live.mcap")
    live._lock.take()
    live.path.write_bytes(b"\x89MCAP0\r\n")
    code = "import sys; sys.path[:] = sys.argv[2:]\nfrom comanip.formats import recover\nrecover(sys.argv[1])"
    said = subprocess.run([sys.executable, "-c", code, str(live.path), *sys.path], capture_output=True, text=True).stderr
    live._lock.free()
    assert f"in use by pid {os.getpid()}" in said
    with pytest.raises(RecordingError, match="nothing to recover"):
        recover(live.path)


def test_the_command_says_what_was_saved(tmp_path):
    write(lift(), tmp_path / "run.live.mcap")
    data = (tmp_path / "run.live.mcap").read_bytes()
    (tmp_path / "run.live.mcap").write_bytes(data[: len(data) // 2])
    done = subprocess.run(
        [sys.executable, "-m", "comanip", "recover", "run.live.mcap"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("run.recovered.mcap: ")
    assert "cut short" in done.stdout


# P11, and children of the dead --------------------------------------------------------------------------------------------

TRAPS = ("csv", "mcap", "signal", "random", "json", "numpy", "queue", "h5py", "struct", "logging")
RUNS = """
import os, sys, time
sys.path[:] = sys.argv[2:]
from pathlib import Path
from comanip.formats import read, write
from comanip.formats.background import writing
from comanip.formats.live import LiveFile
from test_takes import lifting
from lifts import lift
if __name__ == "__main__":
    import comanip.formats.mcap_file, mcap.writer
    sys.path.insert(0, "")
    live = LiveFile(Path("take.live.mcap"))
    lifting(0.3, [live])
    assert not live.stopped, live.stopped
    with writing() as store:
        store(lift(), Path("stored.mcap"))
    if sys.argv[1] == "hdf5":
        read("a.hdf5")
    print("through")
"""


@pytest.mark.parametrize("kind", ["", "hdf5"])
def test_p11_a_module_of_the_users_is_not_run_by_a_child(tmp_path, kind):
    if kind:
        pytest.importorskip("h5py")
        write(lift(), tmp_path / "a.hdf5")
    for name in TRAPS:
        (tmp_path / f"{name}.py").write_text(f"open('sprung_{name}', 'w').close()\nraise SystemExit(3)\n")
    script = tmp_path / "elsewhere" / "script.py"
    script.parent.mkdir()
    script.write_text(RUNS)
    places = [os.path.dirname(__file__), os.path.join(os.path.dirname(__file__), ".."), *[p for p in sys.path if p]]
    done = subprocess.run(
        [sys.executable, "-P", str(script), kind, *places], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert [p.name for p in tmp_path.glob("sprung_*")] == []
    assert done.stdout == "through\n", done.stderr
    assert len(read(tmp_path / "take.live.mcap")[0]["hand.position"].time) == 30
    assert len(read(tmp_path / "stored.mcap")[0]["hand.position"].time) == 401


DYING = """
import os, sys, time
sys.path[:] = sys.argv[2:]
from pathlib import Path
from comanip.formats.background import writing
from lifts import lift
if __name__ == "__main__":
    with writing() as store:
        store(lift(), Path(sys.argv[1]))
        while not Path(sys.argv[1]).exists():
            time.sleep(0.01)
        print("stored", flush=True)
        time.sleep(60)
"""


@POSIX
def test_the_process_that_stores_ends_when_its_parent_is_killed(tmp_path):
    places = [os.path.join(os.path.dirname(__file__), ".."), *sys.path]
    script = tmp_path / "script.py"
    script.write_text(DYING)
    parent = subprocess.Popen([sys.executable, str(script), str(tmp_path / "a.mcap"), *places], stdout=subprocess.PIPE, text=True)
    assert parent.stdout.readline() == "stored\n"
    found = subprocess.run(["ps", "--ppid", str(parent.pid), "-o", "pid=,args="], capture_output=True, text=True).stdout
    children = [line.split()[0] for line in found.splitlines()]
    assert children
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 10.0
    alive = children
    while alive and time.monotonic() < deadline:
        time.sleep(0.05)
        alive = [
            c
            for c in alive
            if subprocess.run(["ps", "-p", c, "-o", "stat="], capture_output=True, text=True).stdout.strip(" Z\n")
        ]
    assert not alive


def test_driven_runs_leave_no_lock(tmp_path):
    driven(Scripted(lambda t: 0.1), duration=0.1, taps=[LiveFile(tmp_path / "a.live.mcap")])
    assert [p.name for p in tmp_path.iterdir()] == ["a.live.mcap"]
