"""docs/robot.md as a reader uses it: what stands there is pasted into files, and runs as it stands."""

from __future__ import annotations

import re
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import comanip
from comanip.learned.file import save
from comanip.robots.settings import load

PAGE = (Path(__file__).parents[2] / "docs" / "robot.md").read_text(encoding="utf-8")
SHARE_N = 9.80665  # of 2 kg that two carry


class Vendor:
    """An arm that goes where it is told, with an object that rests on it. Lazily, by the wall clock."""

    def __init__(self):
        self.at, self.speeds, self.stopped, self.z, self.v = time.monotonic(), [], 0, 0.85, 0.0

    def _now(self):
        now = time.monotonic()
        self.z, self.at = self.z + self.v * (now - self.at), now
        return now

    def pose(self):
        return SimpleNamespace(stamp=self._now(), z=self.z)

    def wrench(self):
        return SimpleNamespace(stamp=self._now(), fz=SHARE_N)

    def speed(self, v):
        self._now()
        self.v = v
        self.speeds.append(v)

    def stop(self):
        self.v, self.stopped = 0.0, self.stopped + 1

    def error(self):
        return ""


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_the_plant_of_forty_lines_runs_as_it_stands(tmp_path, monkeypatch, skills):
    plant, call = blocks("python")
    assert len([line for line in plant.splitlines() if line.strip()]) <= 40
    save(skills["follower"], tmp_path / "follower.json")
    monkeypatch.chdir(tmp_path)
    taken, run, lib = [], comanip.run, Vendor()

    def shorter(*words, duration_s, **about):  # a real plant's second lasts a second
        assert duration_s == 30.0
        taken.append(run(*words, duration_s=0.6, **about))

    monkeypatch.setattr(comanip, "run", shorter)
    exec(plant + call, {"__name__": "mine", "lib": lib})
    (recording,) = taken
    assert len(lib.speeds) > 10
    assert (lib.stopped, lib.v) == (1, 0.0)
    late = recording.metadata.get("notice", "")
    if "late" in late or "old" in late:
        pytest.skip("this machine is too busy for a loop in real time, and the envelope says so")
    assert recording.metadata["stop_reason"] == "duration"
    assert not (recording["skill.mode"].values == 2.0).any()
    assert np.nanmax(np.abs(recording["hand.force"].values)) < 0.5  # the object was weighed: nobody pulls


def test_the_robot_of_the_page_is_one(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(blocks("toml")[0])
    found = load(path)
    assert (found.adapter, tuple(found.axes), found.walls_m["z"]) == ("ros2", ("z",), (0.15, 0.65))
    assert found.turns["fr3_hand"].with_hand
