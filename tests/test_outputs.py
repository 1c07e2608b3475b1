"""Results never take the place of what was read, nor of what something else made; and are whole or not there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from comanip import demonstrations, learn, load_skill, save_skill
from comanip.commands import outputs
from comanip.errors import ParameterError
from comanip.evaluation import prediction
from comanip.whole_file import write_whole
from forked import run as comanip


@pytest.fixture(scope="module")
def folder(tmp_path_factory, lessons, skills):
    path = tmp_path_factory.mktemp("outputs")
    for role, found in lessons.items():
        save_skill(skills[role], path / f"{role}.json")
        for n, lesson in enumerate(found):
            rows = np.column_stack([np.arange(len(lesson)) * lesson.dt, lesson.position, lesson.velocity, lesson.force])
            np.savetxt(path / f"{role}_{n}.csv", rows, delimiter=",", header="t,z,vz,Fz", comments="")
    (path / "foreign.json").write_text('{"my": "notes"}')
    (path / "foreign.mcap").write_bytes(b"\x89MCAP0\r\n another robot's")
    (path / "foreign.png").write_bytes(b"\x89PNG\r\n\x1a\n another camera's")
    (path / "foreign.csv").write_text("t,z\n0,1\n")
    (path / "folder.json").mkdir()
    return path


def content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


REFUSED = [
    ("learn", "leader_0.csv", "leader_1.csv", "-o", "leader_0.csv"),
    ("learn", "leader_0.csv", "leader_1.csv", "-o", "./foreign.json"),
    ("learn", "leader_0.csv", "leader_1.csv", "-o", "folder.json"),
    ("convert", "leader_0.csv", "leader_0.csv"),
    ("convert", "leader_0.csv", "foreign.csv"),
    ("convert", "leader_0.csv", "foreign.mcap"),
    ("reproduce", "leader.json", "-o", "foreign.mcap"),
    ("reproduce", "leader.json", "--plot", "foreign.png"),
    ("reproduce", "leader.json", "--plot", "leader.json"),
    ("inspect", "leader.json", "--plot", "foreign.png"),
    ("teach", "--role", "leader", "-o", "foreign.json"),
    ("demo", "-o", "foreign.csv"),
    ("learn", "leader_0.csv", "leader_1.csv", "-o", "foreign.csv/skill.json"),
]


@pytest.mark.parametrize("words", REFUSED)
def test_nothing_of_others_is_written_over(folder, words):
    before = content(folder)
    done = comanip(*words, cwd=folder)
    assert done.returncode == 2, done.stdout
    assert len([x for x in done.stderr.splitlines() if x.startswith("error:")]) == 1
    assert content(folder) == before


def test_overwrite_is_the_way_to_do_it_all_the_same(tmp_path, folder):
    (tmp_path / "notes.json").write_text("{}")
    words = ("learn", folder / "leader_0.csv", folder / "leader_1.csv", "--role", "leader", "-o", "notes.json")
    assert "--overwrite" in comanip(*words, cwd=tmp_path).stderr
    assert comanip(*words, "--overwrite", cwd=tmp_path).returncode == 0
    assert load_skill(tmp_path / "notes.json").role == "leader"
    assert comanip(*words, cwd=tmp_path).returncode == 0  # what comanip made it may make again


def test_what_comanip_made_is_recognised(tmp_path, skills):
    from comanip.evaluation import drawing

    for suffix in drawing.SUFFIXES:
        drawing.save(drawing.skills(skills), tmp_path / f"a{suffix}")
        assert outputs.is_ours(tmp_path / f"a{suffix}")
    save_skill(skills["leader"], tmp_path / "a.json")
    assert outputs.is_ours(tmp_path / "a.json")
    (tmp_path / "empty.csv").touch()
    assert outputs.is_ours(tmp_path / "empty.csv")
    (tmp_path / "page.html").write_text("<html>mine</html>")
    assert not outputs.is_ours(tmp_path / "page.html")


def test_a_file_is_whole_or_the_old_one(tmp_path, monkeypatch):
    file = tmp_path / "a.png"
    write_whole(file, b"older")
    first = file.stat().st_ino
    write_whole(file, b"old")
    assert file.stat().st_ino != first  # another file has taken its place: nobody ever reads half of one
    monkeypatch.setattr("comanip.whole_file.os.fsync", lambda fd: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match=r"a\.png"):
        write_whole(file, b"new")
    assert file.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.skipif(os.name != "posix", reason="links and devices of POSIX")
def test_links_are_followed_and_devices_stay_devices(tmp_path):
    (tmp_path / "real").mkdir()
    write_whole(tmp_path / "real/a", "old")
    (tmp_path / "link").symlink_to(tmp_path / "real/a")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "real/a").read_text() == "new"
    assert (tmp_path / "link").is_symlink()
    with pytest.raises(OSError, match="ordinary"):
        write_whole(Path("/dev/null"), "gone")
    with pytest.raises(ParameterError, match="ordinary"):
        outputs.may_write([Path("/dev/null")])


@pytest.mark.parametrize(
    "words", [("demo",), ("figures",), ("trial", "--pictures", "x"), ("reproduce", "leader.json", "--plot", "x.png")]
)
def test_without_matplotlib_it_is_said_before_the_work(folder, words):
    without = "import sys; sys.modules['matplotlib'] = None; from comanip.commands.app import main; main()"
    done = subprocess.run([sys.executable, "-c", without, *words], capture_output=True, text=True, cwd=folder, timeout=60)
    assert done.returncode == 2
    assert "comanip[plot]" in done.stderr
    assert "done" not in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("learn", "leader_0.csv", "--role", "folower"), "natural"),
        (("reproduce", "leader.json", "follower.json"), "--role auto"),
        (("reproduce", "leader.json", "leader.json", "follower.json", "--role", "auto"), "not"),
        (("reproduce", "leader.json", "-o", "run.txt"), ".mcap or .csv"),
        (("trial", "--workers", "-3"), "--workers"),
        (("teach", "--role", "leader", "--lessons", "0"), "--lessons"),
        (("classify", "leader_0.csv", "--skill", "leader.json"), "at least two"),
        (("learn", "leader.json"), "a skill, no recording"),
        (("learn", "leader_0.csv", "--force-bias-n", "much"), "--force-bias-n"),
    ],
)
def test_what_cannot_be_done_is_said_in_flags(folder, words, said):
    done = comanip(*words, cwd=folder)
    errors = [x for x in done.stderr.splitlines() if x.startswith("error:")]
    if words[1:3] == ("leader.json", "leader.json"):  # one file twice is one skill
        assert done.returncode == 0
        return
    assert done.returncode == 2
    assert len(errors) == 1
    assert said in errors[0]


def test_a_role_that_lessons_do_not_state_is_set_and_an_unknown_one_refused(lessons):
    from dataclasses import replace

    unstated = [replace(lesson, role="") for lesson in lessons["follower"]]
    assert learn(unstated, role="follower").role == "follower"
    with pytest.raises(ParameterError, match="leader, follower, natural"):
        learn(unstated, role="folower")
    with pytest.raises(ParameterError, match="leader, follower, natural"):
        demonstrations([], role="folower")
    with pytest.raises(Exception, match="asked for"):
        learn(lessons["leader"], role="follower")


@pytest.mark.parametrize("axes", [("x",), ("x", "z")])
def test_a_skill_of_other_axes_is_not_tried_in_lifts(tmp_path, lessons, axes):
    from dataclasses import replace

    rng = np.random.default_rng(0)

    def moved(values):
        return np.hstack([values + 1e-2 * i * rng.normal(size=values.shape) for i in range(len(axes))])

    pushes = [
        replace(x, axes=axes, signals={n: moved(v) for n, v in x.signals.items()}, signal_axes={}) for x in lessons["follower"]
    ]
    save_skill(learn(pushes), tmp_path / "push.json")
    done = comanip("trial", "--role", "follower", "--skill", "push.json", "--partners", 3, cwd=tmp_path)
    assert done.returncode == 2
    assert f"the skill moves axes {', '.join(axes)}; task 'lift' has z" in done.stderr


def test_a_recording_of_neither_is_told(folder, tmp_path):
    t = np.arange(0.0, 4.0, 0.01)
    rows = np.column_stack([t, 0.3 + 0.1 * np.sin(6.0 * t), 0.6 * np.cos(6.0 * t), 3.0 * np.sin(7.0 * t)])
    np.savetxt(tmp_path / "stirring.csv", rows, delimiter=",", header="t,z,vz,Fz", comments="")
    skills = ("--skill", folder / "leader.json", "--skill", folder / "follower.json")
    done = comanip(
        "classify", tmp_path / "stirring.csv", folder / "leader_5.csv", folder / "follower_5.csv", *skills, cwd=tmp_path
    )
    shows = [line.split("│")[-2].strip() for line in done.stdout.splitlines() if line.startswith("│")]
    assert shows == ["neither", "leader", "follower"]


def test_fragments_of_one_recording_are_left_out_together(lessons):
    from dataclasses import replace

    pieces = [replace(lessons["follower"][0], name=f"long#{i}") for i in range(2)]
    with pytest.raises(ParameterError, match="got 1, in 2 fragments"):
        prediction.leave_one_out(pieces)


def test_medians_and_files_without_motion():
    def one(r2):
        return prediction.Prediction("a", 10, 1.0, r2, [r2], 0.1, [0.1], 0.2, 0.3, [0.2])

    found = [one(0.9), one(0.8), one(-34.0), one(float("nan"))]
    assert prediction.medians(found)["one_step_velocity_r2"] == pytest.approx(0.8)
    assert prediction.overall(found)["one_step_velocity_r2"] == pytest.approx(-32.3 / 3.0)


def test_tables_name_the_unit_of_the_axis(tmp_path):
    t = np.arange(0.0, 3.0, 0.01)
    for n in range(3):
        angle = 0.5 * np.sin(t + 0.1 * n)
        rows = np.column_stack([t, angle, 0.5 * np.cos(t + 0.1 * n), np.cos(t) + 0.1 * np.sin(9.0 * t + n)])
        np.savetxt(tmp_path / f"turn{n}.csv", rows, delimiter=",", header="t,lever,speed,torque", comments="")
    flags = ("--position", "lever", "--velocity", "speed", "--force", "torque", "--axes", "lever", "--position-unit", "rad",
             "--velocity-unit", "rad/s", "--force-unit", "N m")  # fmt: skip
    done = comanip("evaluate", "--leave-one-out", *sorted(tmp_path.glob("*.csv")), *flags, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "RMSE mrad/s" in done.stdout
    assert "mm" not in done.stdout.split("one-step R²:")[0].replace("comanip", "")
    assert "median" in done.stdout


def test_metres_and_radians_are_not_added_in_a_table():
    from comanip.commands.units import scale_of, unit_of

    units = {"position": "m, m, rad"}
    assert [scale_of(unit_of(units, "position", i, "m")).unit for i in range(3)] == ["cm", "cm", "mrad"]
    assert scale_of(units["position"]).shown(1.0) == "-"
    assert scale_of("m, m").shown(0.5) == "50.00"


def test_a_run_is_told_in_words_and_units(folder):
    told = comanip("reproduce", "follower.json", "--seed", 3, cwd=folder).stdout
    assert told.splitlines()[0] == "follower.json, as follower, law default, with the partner of seed 3: succeeded"
    for word in ("mm ", "N² s", "LDLJ", "effort share", "internal force"):
        assert word in told
    assert "nan" not in told
    assert "role_right" not in told


def test_states_are_counted_from_one_everywhere(folder):
    rows = [
        x.split("│")[1].strip() for x in comanip("inspect", "leader.json", cwd=folder).stdout.splitlines() if x.startswith("│")
    ]
    assert rows == [str(k) for k in range(1, 11)]


def test_what_a_partner_of_somebody_raises_is_told_by_file_and_line(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    def reset(self, position): pass\n    def force(self, time, position, velocity, out):\n"
        "        out[0] = 1 / 0\n"
    )
    done = comanip("trial", "--role", "follower", "--partners", 1, "--workers", 1, "--partners-from", "mine.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "mine.py: Mine.force at 0.000 s: ZeroDivisionError: division by zero (line 4)" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux bounds the address space of a process")
def test_a_partner_cannot_take_all_memory(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nclass Mine:\n    def reset(self, position): self.kept = []\n"
        "    def force(self, time, position, velocity, out):\n        self.kept.append(np.empty(1 << 25))  # 256 MB, untouched\n"
    )
    done = comanip("trial", "--role", "follower", "--partners", 1, "--workers", 1, "--partners-from", "mine.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "MemoryError" in done.stderr
