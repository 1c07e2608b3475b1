"""How commands end: Control-C, kill -9, a closed pipe, a full disk, poor encodings. Real processes, as in a terminal."""

from __future__ import annotations

import io
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from comanip import Beam, Recording, read, teach
from comanip.commands import ending
from comanip.errors import BackendError, ParameterError
from comanip.evaluation import shown
from comanip.formats.background import writing
from comanip.loop import unbroken
from comanip.parallel import each, end_with

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
COMANIP = [sys.executable, "-m", "comanip"]


def started(*words, cwd, **options):
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
    return subprocess.Popen([*COMANIP, *map(str, words)], cwd=cwd, start_new_session=True, **options)


def members(session: int) -> list[int]:
    """Processes of a session that are alive."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def gone(session: int, within_s: float) -> bool:
    until = time.monotonic() + within_s
    while members(session) and time.monotonic() < until:
        time.sleep(0.05)
    return not members(session)


def interrupted(process, group=True):
    (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert "Exception" not in err
    return out, err.strip().splitlines()[-1]


@posix
@pytest.mark.parametrize(
    ("words", "after_s"),
    [
        (("trial", "--role", "follower", "--partners", 400, "--workers", 2), 4.0),
        (("trial", "--role", "follower", "--partners", 400, "--workers", 1), 3.0),
        (("demo", "--plant", "beam"), 5.0),
        (("figures", "--plant", "beam"), 2.0),
    ],
)
def test_control_c_is_one_line_and_130_and_leaves_nobody(tmp_path, words, after_s):
    process = started(*words, cwd=tmp_path)
    time.sleep(after_s)
    if process.poll() is not None:
        pytest.skip("it was over before")
    out, last = interrupted(process)
    assert out == ""
    assert last.startswith("interrupted: ")
    assert gone(process.pid, 5.0)


@posix
def test_control_c_in_teach_keeps_what_is_whole_and_marks_what_is_cut(tmp_path):
    process = started("teach", "--role", "leader", "--lessons", 60, "-o", "out", cwd=tmp_path)
    while len(list((tmp_path / "out").glob("*.mcap"))) < 2 and process.poll() is None:
        time.sleep(0.02)
    _, last = interrupted(process)
    files = sorted((tmp_path / "out").iterdir())
    cut = [f for f in files if read(f)[0].metadata.get("incomplete")]
    assert len(cut) <= 1
    assert f"interrupted: {len(files) - len(cut)} whole lessons of 60 in out" in last
    assert (f"{cut[0].name} is cut" in last) if cut else ("is cut" not in last)


@posix
def test_control_c_in_a_run_keeps_its_recording_and_says_that_it_is_cut(tmp_path, skills):
    from comanip import save_skill

    save_skill(skills["leader"], tmp_path / "leader.json")
    process = started("reproduce", "leader.json", "--realtime", "--out", "run.mcap", cwd=tmp_path)
    while not (tmp_path / "run.live.mcap").exists() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(0.8)
    _, last = interrupted(process)
    (recording,) = read(tmp_path / "run.mcap")
    assert recording.metadata["incomplete"] == "interrupted"
    assert "run.mcap holds the" in last
    assert not (tmp_path / "run.live.mcap").exists()


@posix
@pytest.mark.parametrize("words", [("trial", "--partners", 400, "--workers", 2), ("teach", "--role", "leader", "--lessons", 200)])
def test_workers_do_not_outlive_whoever_was_killed(tmp_path, words):
    process = started(*words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 60.0
    while len(members(process.pid)) < 3 and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert gone(process.pid, 20.0)  # a worker that is still importing notices when it has begun


def test_a_lesson_that_was_cut_ends_teaching(monkeypatch):
    kept = []

    def cut(*given, **options):
        return Recording({}, {"stop_reason": "interrupted", "incomplete": "interrupted"})

    monkeypatch.setattr("comanip.teaching._lesson", cut)
    with pytest.raises(KeyboardInterrupt):
        teach("leader", 5, rng=np.random.default_rng(0), beam=Beam(), keep=lambda number, recording: kept.append(number))
    assert kept == [0]


def test_a_cut_run_is_no_result():
    assert unbroken(Recording({}, {"stop_reason": "duration"})) is not None
    with pytest.raises(KeyboardInterrupt):
        unbroken(Recording({}, {"stop_reason": "interrupted"}))


def _dies():
    os._exit(3)


def test_a_worker_that_dies_is_told_in_one_line():
    with pytest.raises(BackendError, match="worker process died"):
        list(each(_dies, [(), ()], n_jobs=2))


def test_the_asking_process_itself_never_watches():
    before = signal.getsignal(signal.SIGINT)
    end_with(os.getpid())
    assert signal.getsignal(signal.SIGINT) is before


def fail(error):
    def command():
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (ParameterError("role 'x' is unknown"), 2, "error: role 'x' is unknown"),
        (OSError(28, "No space left on device", "run.png"), 2, "error: run.png: No space left on device"),
        (OSError(28, "No space left on device"), 2, "error: output: No space left on device"),
        (MemoryError(), 2, "error: out of memory"),
        (ZeroDivisionError("division by zero"), 1, "a defect of comanip"),
        (ParameterError("two\nlines\x1b[31m"), 2, "error: two lines\\x1b[31m"),
        (BrokenPipeError(), 0, ""),
        (SystemExit(1), 1, ""),
        (KeyboardInterrupt(), 130, "interrupted: nothing was written"),
    ],
)
def test_what_goes_wrong_is_one_line_and_a_code(error, code, said, capsys):
    assert ending.ended_by(fail(error), LookupError) == code
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == (1 if said else 0)
    assert "Traceback" not in err


@posix
def test_whatever_an_interrupt_turns_into_is_still_an_interrupt(monkeypatch, capsys):
    """An import that is cut short ends as ImportError, a pool as a dead worker."""

    def command():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("numpy: cut short") from None

    monkeypatch.setattr(ending, "_no_child_left", lambda: None)
    monkeypatch.setattr(ending, "_asked", False)
    monkeypatch.setattr(ending, "_kept", [])
    before = signal.getsignal(signal.SIGINT)
    try:
        assert ending.ended_by(command, LookupError) == 130
    finally:
        signal.signal(signal.SIGINT, before)
        monkeypatch.setattr(ending, "_asked", False)
    assert capsys.readouterr().err == "interrupted: nothing was written\n"


def test_a_warning_is_said_once(capsys, monkeypatch):
    monkeypatch.setattr(ending, "_warned", set())
    for _ in range(2):
        ending.show_warning("the take is odd; drop such frames with drop_bad", UserWarning)
    assert capsys.readouterr().err == "warning: the take is odd; --drop-bad drops such frames\n"
    assert ending.was_said("the take is odd; drop such frames with drop_bad")


@posix
def test_head_and_a_full_disk(tmp_path):
    done = subprocess.run(
        f"{shlex.quote(sys.executable)} -m comanip doctor | head -1", shell=True, capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("comanip")
    assert done.stderr == ""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMANIP, "doctor"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: output: No space left on device\n")


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_no_encoding_makes_printing_an_error(encoding):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    shown.never_fails(stream)
    stream.write("∫F² dt, ∂v/∂F, 3 °, 日本\udcff")
    stream.flush()
    text = raw.getvalue().decode(encoding)
    assert "日本" in text or "\\u65e5\\u672c" in text
    assert "int F" in text or "∫F" in text
    assert "\\udcff" in text


def test_results_in_a_pipe_of_windows(tmp_path):
    options = {"capture_output": True, "check": True, "cwd": tmp_path, "env": {**os.environ, "PYTHONIOENCODING": "cp1252"}}
    done = subprocess.run([*COMANIP, "trial", "--role", "follower", "--partners", "2", "--workers", "1"], **options)
    assert "N² s" in done.stdout.decode("cp1252") or "N²s" in done.stdout.decode("cp1252")


def test_storing_in_the_background_still_stores(tmp_path):
    (recording,) = teach("leader", 1, rng=np.random.default_rng(0))
    with writing() as store:
        store(recording, tmp_path / "a.mcap")
    assert read(tmp_path / "a.mcap")[0].channels.keys() == recording.channels.keys()
