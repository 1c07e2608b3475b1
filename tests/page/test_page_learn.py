"""A skill learned in the page is the one that `comanip learn` makes of the same lessons."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comanip.formats import read, write
from comanip.learned import file as skill_file
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.recording import Channel, Recording
from comanip.tasks import Task, named
from comanip.teaching import teach
from page.node import ran

LEARN = """
const lessons = given.files.map(name => preparedLesson(readCsv(fs.readFileSync(`${given.folder}/${name}`, "utf8")), given.task, name));
fs.writeFileSync(`${given.folder}/skill.json`, learned(lessons, given.task));
"""
MODULES = {"learn": "learned, preparedLesson", "recordings": "readCsv"}
KEPT = ("hand.position", "hand.velocity", "hand.sensor_force")


def as_kept(recording: Recording, stride: int) -> Recording:
    """As the page keeps lessons: position, velocity and the sensor's force at the same stamps."""
    time = np.round(0.01 * np.arange(len(recording["hand.position"].time[::stride])), 9)
    channels = {name: recording[name] for name in KEPT}
    return Recording(
        {name: Channel(time, c.values[::stride], c.unit, c.frame, c.axes) for name, c in channels.items()}, recording.metadata
    )


def told(task: Task) -> dict[str, Any]:
    return {
        "name": task.name, "axes": [{"name": axis} for axis in task.axes], "gravity": task.gravity.tolist(),
        "mass_kg": task.carried.mass_kg, "share": task.carried.share,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "role", "lessons"), [("lift", "leader", 3), ("two-shelves", "leader", 6), ("pick-carry-place", "follower", 2)]
)
def test_the_page_learns_what_comanip_learns(name: str, role: str, lessons: int, tmp_path: Path) -> None:
    task = named(name)
    recordings = teach(role, lessons, rng=np.random.default_rng(41), task=name)
    files = []
    for n, recording in enumerate(recordings):
        stride = round(0.01 / float(np.median(np.diff(recording["hand.position"].time))))
        files.append(f"{role}-{n}.csv")
        write(as_kept(recording, max(stride, 1)), tmp_path / files[-1])
    ran(tmp_path, LEARN, modules=MODULES, task=told(task), files=files)
    found = skill_file.load(tmp_path / "skill.json")
    assert skill_file.to_json(found) == json.loads((tmp_path / "skill.json").read_text())  # saved again it is the same file
    expected = learn(demonstrations([read(tmp_path / file)[0] for file in files]))
    assert (found.role, found.axes, found.dt, found.model.channels) == (role, task.axes, expected.dt, expected.model.channels)
    assert found.provenance["converged"]
    np.testing.assert_allclose(found.provenance["log_likelihood"], expected.provenance["log_likelihood"], rtol=1e-9)
    np.testing.assert_allclose(found.provenance["bic"], expected.provenance["bic"], rtol=1e-9)
    for key in ("initial", "transition", "means", "covariances"):
        np.testing.assert_allclose(getattr(found.model, key), getattr(expected.model, key), rtol=1e-6, atol=1e-9, err_msg=key)
    for key in ("workspace", "ends", "starts", "onsets_s"):
        np.testing.assert_allclose(getattr(found, key), getattr(expected, key), rtol=1e-9, atol=1e-12, err_msg=key)
    assert len(found.paths) == len(expected.paths)
    for ours, theirs in zip(found.paths, expected.paths, strict=True):
        for key in ("step_s", "position", "force", "spread", "ends", "framed"):
            np.testing.assert_allclose(getattr(ours, key), getattr(theirs, key), rtol=1e-6, atol=1e-8, err_msg=key)


def test_lessons_that_need_preparing_are_one_line_and_not_learned_from(tmp_path: Path) -> None:
    recording = as_kept(teach("leader", 1, rng=np.random.default_rng(3))[0], 1)
    channel = recording["hand.velocity"]
    gap = np.delete(np.arange(len(channel.time)), 40)
    wrong = {
        "bare.csv": (Recording({n: recording[n] for n in KEPT[:2]}, {}), "no hand.sensor_force along z"),
        "uneven.csv": (Recording({n: Channel(c.time[gap], c.values[gap], c.unit, c.frame, c.axes) for n, c in recording.channels.items()}, {}), "not of one even rate"),
        "still.csv": (Recording({n: Channel(c.time, 0.0 * c.values, c.unit, c.frame, c.axes) for n, c in recording.channels.items()}, {}), "is the same in all lessons"),
    }  # fmt: skip
    wrong["fast.csv"] = (
        Recording({n: Channel(0.5 * c.time, c.values, c.unit, c.frame, c.axes) for n, c in recording.channels.items()}, {}),
        "200 frames a second",
    )
    for name, (one, _) in wrong.items():
        write(one, tmp_path / name)
    said = ran(tmp_path, """
    answer(given.files.map(name => { try { learned([preparedLesson(readCsv(fs.readFileSync(`${given.folder}/${name}`, "utf8")), given.task, name)], given.task); return "learned"; } catch (error) { return error.message; } }));
    """, modules=MODULES, task=told(named("lift")), files=list(wrong))  # fmt: skip
    for message, (_, says) in zip(said, wrong.values(), strict=True):
        assert says in message
        assert "\n" not in message
