"""The command line as a newcomer meets it: real files, real processes, one line for a mistake."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from forked import fresh
from forked import run as comanip


def answer(*words, cwd=None):
    done = comanip(*words, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="session")
def folder(tmp_path_factory, lessons):
    """Vertical lifts in CSV as somebody else would have them: own column names, no role, a second of rest."""
    path = tmp_path_factory.mktemp("lifts")
    for role, found in lessons.items():
        for n, lesson in enumerate(found):
            rest = np.repeat(np.column_stack([lesson.position, lesson.velocity, lesson.force])[:1], 60, axis=0)
            rest[:, 2] += np.random.default_rng(n).normal(0.0, 0.1, 60)
            rows = np.vstack([rest, np.column_stack([lesson.position, lesson.velocity, lesson.force])])
            np.savetxt(path / f"{role}_{n}.csv", rows, delimiter=",", header="z,vz,Fz", comments="")
    return path


FLAGS = ("--position", "z", "--velocity", "vz", "--force", "Fz", "--rate-hz", "100")


def test_help_answers_before_one_gets_impatient():
    """0.4 s; counted in processor time, so that a loaded machine does not decide."""
    times = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert "learn" in fresh("--help").stdout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(times) < 0.4


def test_learn_evaluate_classify_on_foreign_csv(folder, tmp_path):
    for role in ("leader", "follower"):
        files = sorted(folder.glob(f"{role}_[0-4].csv"))
        learned = answer("learn", *files, "-o", tmp_path / f"{role}.json", *FLAGS)
        assert learned["channels"] == ["position.z", "force.z", "velocity.z"]
        assert len(learned["lessons"]) == 5
        result = answer("evaluate", tmp_path / f"{role}.json", folder / f"{role}_5.csv", *FLAGS)
        assert set(result["overall"]) >= {
            "one_step_velocity_r2",
            "one_step_velocity_rmse",
            "free_run_position_rmse_m",
            "free_run_end_error_m",
            "log_likelihood_per_frame",
        }
        assert result["overall"]["one_step_velocity_r2"] > 0.9
        assert result["overall"]["free_run_position_rmse_m"] < 0.05
    skills = ("--skill", tmp_path / "leader.json", "--skill", tmp_path / "follower.json")
    found = answer("classify", folder / "leader_5.csv", folder / "follower_5.csv", *skills, *FLAGS)["files"]
    assert [f["best"] for f in found] == [str(tmp_path / "leader.json"), str(tmp_path / "follower.json")]


def test_leave_one_out_on_foreign_csv(folder):
    result = answer("evaluate", "--leave-one-out", *sorted(folder.glob("leader_*.csv")), *FLAGS)
    assert len(result["files"]) == 6
    assert result["overall"]["one_step_velocity_r2"] > 0.9
    assert result["overall"]["free_run_position_rmse_m"] < 0.025


def test_teach_learn_reproduce_inspect(tmp_path):
    files = answer("teach", "--role", "follower", "--lessons", 3, "-o", "lessons", cwd=tmp_path)["files"]
    answer("learn", *files, "--resample-hz", 100, "-o", "skill.json", cwd=tmp_path)
    run = answer("reproduce", "skill.json", "--seed", 3, "-o", "run.mcap", "--plot", "run.png", cwd=tmp_path)
    assert run["success"] is True
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"
    replayed = answer("reproduce", "skill.json", "--force-from", files[0], "--law", "paper", "--resample-hz", 100, cwd=tmp_path)
    assert replayed["position_rmse_m"] > 0.0
    assert "hand.position" in answer("inspect", "run.mcap", cwd=tmp_path)[0]["channels"]
    assert len(answer("inspect", "skill.json", "--plot", "skill.svg", cwd=tmp_path)[0]["states"]) == 10
    answer("convert", "run.mcap", "run.csv", cwd=tmp_path)
    a, b = (answer("inspect", f, cwd=tmp_path)[0]["channels"]["hand.force"]["max"] for f in ("run.mcap", "run.csv"))
    assert a == b
    again = answer("learn", "run.mcap", "--states", 4, "-o", "again.json", cwd=tmp_path)  # a rollout is a lesson
    assert again["states"] == 4


def test_a_run_on_the_wall_clock_reaches_the_disk_as_it_goes(tmp_path, folder):
    """And afterwards the whole recording is there, and the live one gone."""
    answer("learn", *sorted(folder.glob("follower_[0-4].csv")), "-o", "skill.json", "--role", "follower", *FLAGS, cwd=tmp_path)
    words = ["reproduce", "skill.json", "--force-from", folder / "follower_5.csv", *FLAGS, "--realtime", "--out", "run.csv"]
    started = time.monotonic()
    going = subprocess.Popen([sys.executable, "-m", "comanip", *map(str, words)], cwd=tmp_path, stdout=subprocess.DEVNULL)
    while not (tmp_path / "run.live.mcap").exists() and going.poll() is None:
        time.sleep(0.05)
    assert going.poll() is None, "it did not last as long as the lesson"
    assert going.wait(timeout=60) == 0
    assert time.monotonic() - started > 2.0
    assert not (tmp_path / "run.live.mcap").exists()
    assert "hand.position" in answer("inspect", "run.csv", cwd=tmp_path)[0]["channels"]


def test_trial_prints_success_by_role_and_law(tmp_path):
    result = answer("trial", "--role", "follower", "--partners", 4, "--law", "default", "--law", "mass-damper", "--workers", 1)
    entry = result["follower"]["default"]
    assert entry["partners"] == 4
    assert 0.0 <= entry["interval"][0] <= entry["success"] <= entry["interval"][1] <= 1.0
    assert {"effort", "peak_force_n", "residual_force_n", "failures"} <= set(entry)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("learn", "absent.csv"), "absent.csv: no such file"),
        (("learn",), "argument"),
        (("learn", "bad.csv", *FLAGS), "no column 'z'"),
        (("evaluate", "bad.csv"), "give a skill file and recordings"),
        (("evaluate", "bad.csv", "bad.csv"), "not a skill file"),
        (("classify", "bad.csv", "--skill", "a.json"), "at least two skills"),
        (("learn", "bad.csv", "--states", "many"), "many"),
        (("reproduce", "absent.json"), "absent.json"),
        (("learn", "bad.csv", "--rate-hz", "fast"), "fast"),
        (("dance",), "dance"),
    ],
)
def test_a_mistake_is_one_line_on_standard_error_and_exit_code_2(tmp_path, words, said):
    (tmp_path / "bad.csv").write_text("time,height\n0.0,1.0\n0.1,1.1\n0.2,1.2\n0.3,1.4\n0.4,1.5\n")
    done = comanip(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    errors = [line for line in done.stderr.splitlines() if not line.startswith("warning:")]
    assert len(errors) == 1, done.stderr
    assert said in errors[0]
    assert "Traceback" not in done.stderr


def test_a_cluster_without_its_address_is_one_line():
    done = comanip("trial", "--role", "follower", "--partners", 1, "--law", "damping", "--backend", "dask")
    assert done.returncode == 2
    assert "needs the scheduler's address" in done.stderr


def test_a_lerobot_folder_is_learned_from_without_being_loaded(tmp_path, lessons):
    pytest.importorskip("pyarrow", reason="needs comanip[parquet]")
    sys.path.insert(0, str(Path(__file__).parent / "models"))
    from test_streaming import lerobot

    lerobot(tmp_path, [x.array(("position.z", "force.z", "velocity.z")) for x in lessons["follower"][:4]], per_file=2)
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text('{"fps": 100, "codebase_version": "v3.0"}')
    columns = ("--position", "observation.state[0]", "--force", "observation.state[1]", "--velocity", "action[0]")
    found = []
    streamed = ("--stream", "--workers", 1)
    for how in (streamed, (*streamed, "--force-unit", "N"), ()):  # as it is, prepared, in memory
        learned = answer("learn", tmp_path, "--overwrite", "-o", tmp_path / "s.json", "--role", "follower", *how, *columns)
        assert learned["rate_hz"] == 100.0
        assert learned["channels"] == ["position.z", "force.z", "velocity.z"]
        assert json.loads((tmp_path / "s.json").read_text())["clock"] is not None
        found.append(np.array(json.loads((tmp_path / "s.json").read_text())["model"]["means"]))
    assert np.allclose(found[0], found[1], atol=1e-6)
    assert np.allclose(found[0], found[2], atol=1e-6)
    refused = comanip("learn", tmp_path, "--stream", *columns[:2])
    assert refused.returncode == 2
    assert "--force names 0 Parquet columns" in refused.stderr
    assert "--states 'ten'" in comanip("learn", tmp_path, *columns, "--states", "ten").stderr
