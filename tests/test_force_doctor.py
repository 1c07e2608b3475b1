"""The force doctor on the command line: inspect, doctor-force, classify and evaluate say what the library finds."""

from __future__ import annotations

import shlex

import numpy as np
import pytest

from pictures import is_drawn
from test_cli import answer, comanip

T = np.arange(0.0, 6.0, 0.01)


def recorded(path, *, late_s=0.0, bias=0.0, seed=0):
    """A follower's lift as a foreign CSV: F = 2 a + 15 v + bias, stamped late; velocity has small pushes of many frequencies."""
    rng = np.random.default_rng(seed)
    waves = [(rng.uniform(0.3, 2.0), rng.uniform(0, 6.3), rng.uniform(0.02, 0.06)) for _ in range(8)]

    def at(t, n):
        w = [2 * np.pi * f for f, _, _ in waves]
        if n == 0:
            return sum(-a / w1 * np.cos(w1 * t + p) for (_, p, a), w1 in zip(waves, w, strict=True))
        if n == 1:
            return sum(a * np.sin(w1 * t + p) for (_, p, a), w1 in zip(waves, w, strict=True))
        return sum(a * w1 * np.cos(w1 * t + p) for (_, p, a), w1 in zip(waves, w, strict=True))

    force = 2.0 * at(T - late_s, 2) + 15.0 * at(T - late_s, 1) + bias + 0.02 * rng.normal(size=len(T))
    rows = np.column_stack([T, at(T, 0), at(T, 1), force])
    np.savetxt(path, rows, delimiter=",", header="t,z,vz,Fz", comments="", fmt="%.9f")
    return path


def test_doctor_force_finds_clock_and_law_and_writes_what_it_says(tmp_path):
    file = recorded(tmp_path / "lift.csv", late_s=0.02, bias=3.0)
    (found,) = answer("doctor-force", file, "--role", "follower", "-o", tmp_path / "clean.csv")["recordings"]
    law = found["admittance"]
    assert law["terms"] == "M D"
    assert law["inertia"][0]["value"] == pytest.approx(2.0, rel=0.05)
    assert law["damping"][0]["value"] == pytest.approx(15.0, rel=0.02)
    assert law["force_at_rest"][0]["value"] == pytest.approx(3.0, abs=0.05)
    assert law["offset_s"]["value"] == pytest.approx(0.02, abs=1e-3)
    (again,) = answer("doctor-force", tmp_path / "clean.csv")["recordings"]
    assert again["admittance"]["offset_s"]["value"] == pytest.approx(0.0, abs=1e-3)
    assert again["admittance"]["force_at_rest"][0]["value"] == pytest.approx(0.0, abs=0.05)
    assert "R² 0.99" in comanip("doctor-force", file).stdout or "R² 1.0" in comanip("doctor-force", file).stdout


def test_the_advice_of_inspect_is_a_command_that_runs(tmp_path):
    file = recorded(tmp_path / "lift.csv")
    lines = file.read_text().splitlines()
    lines[300] = lines[300].rpartition(",")[0] + ",nan"
    file.write_text("\n".join([*lines[:400], *lines[460:]]))
    entries = answer("inspect", file, "--role", "follower")
    checkup = entries[-1]["checkup"]
    assert [f["rank"] for f in checkup["findings"]][:2] == ["refused", "refused"]
    assert "--drop-bad" in checkup["advice"]
    assert "--split-gaps" in checkup["advice"]
    assert comanip("learn", file, "--role", "follower", cwd=tmp_path).returncode == 2
    done = comanip(*shlex.split(checkup["advice"])[1:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_columns_are_listed_where_nothing_is_mapped_and_where_nothing_can_be(tmp_path):
    (tmp_path / "odd.csv").write_text("alpha,beta\n" + "\n".join(f"{i},{i * i}" for i in range(20)))
    done = comanip("inspect", tmp_path / "odd.csv")
    assert done.returncode == 0
    assert "beta" in done.stdout
    assert "361" in done.stdout
    assert "not read:" in done.stdout
    file = recorded(tmp_path / "lift.csv")
    assert any("listed" in e for e in answer("inspect", file))
    assert not any("listed" in e for e in answer("inspect", file, "--position", "z", "--force", "Fz"))


def test_a_picture_of_a_checkup_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    file = recorded(tmp_path / "lift.csv")
    assert comanip("inspect", file, "--plot", tmp_path / "lift.png").returncode == 0
    assert is_drawn(tmp_path / "lift.png")


def test_evaluate_says_what_was_chosen_and_what_the_skill_alone_reaches(tmp_path):
    files = [recorded(tmp_path / f"lift{i}.csv", seed=i) for i in range(3)]
    result = answer("evaluate", "--leave-one-out", *files, "--role", "follower")
    for one in result["files"]:
        assert one["chosen"].startswith("velocity")
        assert one["last_velocity_r2"] > 0.9
        assert len(one["forecast"]["ours"]) == 4
    assert result["median"]["one_step_velocity_r2"] >= result["median"]["skill_velocity_r2"] - 0.05
