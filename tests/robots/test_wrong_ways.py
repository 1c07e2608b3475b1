"""What is not the robot's own is refused in one line, before anything moves."""

from __future__ import annotations

from comanip.experiments.wrong_ways import tried

SAID = ("dt of 0.01 s", "axes z", "axes y, x", "axes z", "'mm'", "'kgf'", "dt of 0.002 s", "2 axes", "frame 'camera'",
        "frame 'tool0'", "axes.z is [0, 0, 0]", "not orthogonal",
        "walls.z is [0.8, 0.2]", "rate_hz is 0", "force_sign is 2")  # fmt: skip


def test_each_wrong_way_is_refused_in_one_line():
    for (what, line), said in zip(tried(), SAID, strict=True):
        assert said in line, what
        assert "\n" not in line
