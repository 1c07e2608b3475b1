"""What stands around the exported C: the command, the module for ctypes, the package for ros2_control."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess

import numpy as np
import pytest
from controllers import maker, skills
from stubs import MAIN, STUBS

from comanip import parts
from comanip.commands.app import app
from comanip.errors import ParameterError
from comanip.experiments.export_proof import python_run
from comanip.export.loaded import compiler
from comanip.learned import file as skill_file

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler (cc, gcc or clang) on this machine")


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for role, one in skills("slide").items():
        skill_file.save(one, tmp_path / f"{role}.json")
    return tmp_path


def export(*words):
    app(["export", *map(str, words)], exit_on_error=False, print_error=False, result_action="return_value")


@needs_compiler
def test_the_module_for_ctypes_does_as_the_python(files):
    export("follower.json", "--to", "ctypes", "-o", "mine.py", "--force-delay-ms", "13")
    spec = importlib.util.spec_from_file_location("mine", files / "mine.py")
    mine = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(mine)
    taken = python_run(maker("slide", "follower")(), np.random.default_rng(2), "well", 400)
    for robot in (mine.Controller(), mine.Controller()):  # the second finds the library made
        for n, row in enumerate(taken.obs):
            does = robot.step(row["time"], row["position"], row["velocity"], row["sensor_force"], row["force_time"])
            assert list(does.velocity) == taken.cmd["velocity"][n].tolist()
            assert (does.mode, does.reason) == (taken.cmd["mode"][n], taken.cmd["reason"][n])
            if n in taken.rearmed:
                assert bool(robot.rearm()) == bool(taken.rearmed[n])
    assert len(list(files.glob("libmine-*.so"))) == 1


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler (g++) on this machine")
def test_the_controller_compiles_against_stubs_of_what_it_uses_and_runs(files):
    export("leader.json", "follower.json", "--role", "auto", "--to", "ros2-control", "-o", "carry_it")
    for path, text in STUBS.items():
        (files / "stubs" / path).parent.mkdir(parents=True, exist_ok=True)
        (files / "stubs" / path).write_text(text)
    start = skills("slide")["leader"].starts.mean(axis=0)
    main = "static const double START[] = {" + ", ".join(map(repr, start.tolist())) + "};\n" + MAIN.replace("PACKAGE", "carry_it")
    (files / "main.cpp").write_text(main)
    strict = ["-Wall", "-Wextra", "-Werror"]
    subprocess.run(["gcc", "-std=c99", "-O1", *strict, "-c", "carry_it/src/skill.c"], cwd=files, check=True)
    parts_of_it = ["carry_it/src/carry_it.cpp", "main.cpp", "skill.o"]
    include = ["-I", "stubs", "-I", "carry_it/include", "-I", "carry_it/src"]
    subprocess.run(["g++", "-std=c++17", *strict, *include, *parts_of_it, "-o", "run"], cwd=files, check=True)
    ran = subprocess.run([files / "run"], capture_output=True, text=True)
    assert ran.returncode == 0, f"{ran.returncode}: {ran.stdout}"
    assert "100 Hz" in ran.stdout  # why it was not activated at another rate


def test_the_package_names_itself_alike_everywhere(files):
    export("leader.json", "--to", "ros2-control", "-o", "my-skill", "--dt", "0.002")
    text = "".join(path.read_text() for path in (files / "my-skill").rglob("*") if path.is_file() and path.name != "skill.c")
    assert "@" not in text.replace("nobody@example.org", "")
    assert "update_rate: 500" in text
    assert "my_skill/MySkill" in text


def test_what_was_written_is_told_as_json(files, capsys):
    export("leader.json", "-o", "one.c", "--json", "--gravity=0", "--mass-kg", "3")
    said = json.loads(capsys.readouterr().out)
    assert said["files"] == ["one.c", "one.h"]
    assert (said["mass_kg"], said["gravity_m_s2"], said["role"]) == (3.0, [0.0], "leader")
    assert said["state_bytes"] <= 65536
    export("leader.json", "-o", "one.c")  # its own it may write again


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("leader.json", "follower.json"), "2 skills and no --role"),
        (("leader.json", "-o", "x.py"), "-o x.py: --to c ends in .c; name another"),
        (("leader.json", "--to", "ros2-control", "-o", "x.c"), "-o x.c: --to ros2-control is a folder"),
        (("leader.json", "--gravity", "down"), "--gravity down: one number an axis"),
        (("leader.json", "--law", "paper"), "law 'paper' cannot be exported"),
        (("leader.json", "-o", "theirs.c"), "theirs.c: exists and was not made by comanip"),
    ],
)
def test_refused_in_one_line_and_nothing_is_written(files, words, why):
    (files / "theirs.c").write_text("int main(void) { return 0; }\n")
    before = sorted(path.name for path in files.iterdir())
    with pytest.raises(ParameterError) as said:
        export(*words)
    assert why in str(said.value)
    assert "\n" not in str(said.value)
    assert sorted(path.name for path in files.iterdir()) == before


def test_targets_are_a_table():
    for target in parts.EXPORTS.values():
        assert callable(target.load())
