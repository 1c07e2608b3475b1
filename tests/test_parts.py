"""The tables of `parts`: what is in them works, and a new part costs its file and one line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import comanip
import forked
from comanip import parts
from comanip.errors import ParameterError

TABLES = {"plant": parts.PLANTS, "device": parts.DEVICES, "law": parts.LAWS, "model": parts.MODELS}
LINES = {  # table -> the one line of a new part
    "DEVICES": '    "glove": Device("comanip.devices.glove:glove", velocity_scale=2.0),\n',
    "LAWS": '    "stiller": Law("comanip.skills.stiller:stiller", 4, "comanip.skills.stiller:Stiller", untold=True),\n',
    "MODELS": '    "point": Model("comanip.models.point:Point", ("weights", "means", "covariances")),\n',
    "FORMATS": '    Format("words", "words_file:load", "words_file:store", (b"WORDS",), (".words",)),\n',
}
FILES = {
    "devices/glove.py": """
from .phantom import HeldHandle

def glove(teacher, *, axes, moves):
    return HeldHandle(teacher, n_axes=len(axes))
""",
    "skills/stiller.py": """
from dataclasses import dataclass
from .baselines import MassDamper

@dataclass(frozen=True)
class Stiller:
    damping_ns_per_m: float = 60.0

def stiller(role, learned, dt, **settings):
    one = next(iter(learned.values()))
    return MassDamper(n_axes=len(one.axes), dt=dt, mass_kg=2.0, damping_ns_per_m=Stiller(**settings).damping_ns_per_m)
""",
    "models/point.py": """
from .gmm import Gmm

class Point(Gmm):
    pass
""",
    "formats/words_file.py": """
from .tables import open_text, write_text

def load(path, data, columns, recover):
    return open_text(path, path.read_bytes()[5:], columns, recover)

def store(recordings, path):
    write_text(recordings, path)
    path.write_bytes(b"WORDS" + path.read_bytes())
""",
}


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, table in TABLES.items() for name in table])
def test_whatever_is_in_a_table_is_there_and_is_documented(kind, name):
    assert TABLES[kind][name].load().__doc__


@pytest.mark.parametrize("form", parts.FORMATS, ids=lambda form: form.name)
def test_formats_are_there(form):
    assert callable(form.reader())
    assert callable(form.writer()) if form.writes else True


@pytest.mark.parametrize("kind", TABLES)
def test_the_error_for_an_unknown_name_lists_the_known_ones(kind):
    names = ", ".join(TABLES[kind])
    for wrong in ("none of them", "", None, 3):
        with pytest.raises(ParameterError, match=f"^{kind} '{wrong}' is unknown; there are: {names}$"):
            parts.known(kind, wrong, TABLES[kind])


def test_a_setting_that_a_law_lacks_is_refused_and_those_that_it_has_are_named():
    with pytest.raises(ParameterError, match="law 'default' has no setting 'sping'; it has: virtual_mass_kg"):
        parts.check_settings("default", {"sping": 1.0})
    with pytest.raises(ParameterError, match="law 'rigid' has no setting 'mass'; it has: none"):
        parts.check_settings("rigid", {"mass": 1.0})


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A copy of the package with one file and one line more of each kind."""
    home = tmp_path_factory.mktemp("house")
    shutil.copytree(Path(comanip.__file__).parent, home / "comanip", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in FILES.items():
        (home / "comanip" / name).write_text(text)
    shutil.copy(home / "comanip/tasks/lift.toml", home / "comanip/tasks/hoist.toml")
    lift = (home / "comanip/tasks/hoist.toml").read_text()
    (home / "comanip/tasks/hoist.toml").write_text(lift.replace('"lift"', '"hoist"', 1))
    table = home / "comanip/parts.py"
    text = table.read_text()
    for name, line in LINES.items():
        begins = text.index("\n", text.index(f"\n{name}: ") + 1) + 1
        text = text[:begins] + line + text[begins:]
    table.write_text(text)
    return home


def run(house, *words, python=False):
    if python:
        environment = {**os.environ, "PYTHONPATH": str(house)}
        done = subprocess.run([sys.executable, "-c", *words], capture_output=True, text=True, cwd=house, env=environment)
    else:
        done = forked.run(*words, cwd=house, env={"PYTHONPATH": str(house)})
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("command", "word"),
    [("teach", "glove"), ("teach", "hoist"), ("trial", "stiller"), ("learn", "stiller"), ("reproduce", "stiller"),
     ("convert", ".words")],
)  # fmt: skip
def test_a_new_part_is_in_the_help(house, command, word):
    assert word in "".join(run(house, command, "--help").split())


def test_new_parts_are_taught_stored_learned_run_and_tried(house):
    """From a lesson on the new device of the new task to the new law with partners, through files of the new format."""
    run(house, "teach", "--role", "follower", "--device", "glove", "--task", "hoist", "--lessons", 3, "-o", "lessons")
    for n in (1, 2, 3):
        run(house, "convert", f"lessons/follower_{n}.mcap", f"lesson_{n}.words")
    lessons = [f"lesson_{n}.words" for n in (1, 2, 3)]
    run(house, "learn", *lessons, "--law", "stiller", "--resample-hz", 100, "-o", "skill.json")
    stored = json.loads((house / "skill.json").read_text())
    assert (stored["law"], len(stored["model"]["initial"])) == ("stiller", 4)
    shown = json.loads(run(house, "reproduce", "skill.json", "--task", "hoist", "--json"))
    assert shown["law"] == "stiller"
    asked = "--role follower --law stiller --partners 1 --misbehaving 0 --skill skill.json --workers 1 --task hoist --json"
    tried = json.loads(run(house, "trial", *asked.split()))
    assert list(tried) == ["hoist", "about"]
    assert tried["hoist"]["follower"]["stiller"]["partners"] == 1


def test_a_new_model_is_stored_in_a_skill_file_and_comes_back(house):
    code = """
from dataclasses import replace
from comanip.learned.file import from_json, to_json
from comanip.learned.skill import LearnedSkill
from comanip.models.point import Point
import numpy as np
model = Point(np.ones(1), np.zeros((1, 3)), np.eye(3)[None], ("position.z", "force.z", "velocity.z"))
skill = LearnedSkill(model, None, "leader", ("z",), 0.01, np.array([[0.0, 1.0]]), np.ones((1, 1)))
back = from_json(to_json(skill))
print(type(back.model).__name__, to_json(skill)["model"]["kind"], np.array_equal(back.model.means, model.means))
"""
    assert run(house, code, python=True).split() == ["Point", "point", "True"]
