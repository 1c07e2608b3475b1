"""Recordings become demonstrations: what is missing is derived if it can be, and said."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from comanip.errors import ChannelError, ParameterError, RecordingError
from comanip.formats import read, write
from comanip.lessons.alignment import align, warping_path
from comanip.lessons.demonstration import Demonstration, demonstration
from comanip.recording import Channel, Recording
from lifts import corrupt, lift, minimum_jerk


def test_recorded_values_are_untouched():
    recording = lift()
    lesson = demonstration(recording)
    for name in ("position", "velocity", "force"):
        assert np.array_equal(lesson[name], recording[f"hand.{name}"].values)
    assert (lesson.dt, lesson.axes, lesson.role) == (0.01, ("z",), "follower")
    assert not lesson.notes


def test_channels_are_in_the_papers_order_and_chosen_by_name():
    lesson = demonstration(lift())
    assert lesson.channels == ("position.z", "force.z", "velocity.z")
    assert lesson.array("force").shape == (401, 1)
    assert np.array_equal(lesson.array(["velocity", "position.z"])[:, 1], lesson.position[:, 0])
    with pytest.raises(ChannelError, match="forse"):
        lesson.array("forse")


def test_nothing_in_it_can_be_changed():
    lesson = demonstration(lift())
    with pytest.raises(ValueError, match="read-only"):
        lesson.position[0] = 1.0
    with pytest.raises(TypeError):
        lesson.signals["position"] = np.zeros((3, 1))


def test_a_missing_velocity_is_derived_without_delay_and_said():
    lesson = demonstration(corrupt(lift(), "drop", "velocity"))
    true = minimum_jerk(0.01 * np.arange(401))[1]
    assert np.abs(lesson.velocity[:, 0] - true).max() < 0.004
    assert any("velocity derived from position: zero-phase low-pass 10 Hz" in n for n in lesson.notes)
    assert lesson.units["velocity"] == "m/s"


def test_a_missing_position_is_made_only_when_asked():
    recording = corrupt(lift(), "drop", "position")
    with pytest.raises(ChannelError, match=r"no 'hand.position'; found hand.velocity, hand.force; integrate_position"):
        demonstration(recording)
    lesson = demonstration(recording, integrate_position=True)
    assert np.abs(lesson.position[:, 0] - minimum_jerk(0.01 * np.arange(401))[0]).max() < 0.002
    assert any("integrated from velocity" in n for n in lesson.notes)


def test_rest_is_trimmed_only_when_asked():
    lesson = demonstration(lift(), trim_rest_s=0.2)
    start = int(np.argmax(np.abs(lesson.velocity[:, 0]) > 0.02))
    assert 10 < start < 45
    assert len(lesson) < 280
    assert any("trimmed rest" in n for n in lesson.notes)


def test_extras_travel_along_under_their_own_axes():
    recording = lift()
    more = Channel(recording["hand.force"].time, np.ones((401, 2)), "N", "task", ("x", "y"))
    lesson = demonstration(recording.with_channels({"partner.force": more}), extra=("partner.force",))
    assert lesson.channels[-2:] == ("partner.force.x", "partner.force.y")
    assert lesson.array("force").shape == (401, 1)


def test_the_hash_is_of_the_data_not_of_the_file(tmp_path):
    for name in ("a.mcap", "b.csv"):
        write(lift(), tmp_path / name)
    hashes = {demonstration(read(tmp_path / n)[0]).sha256 for n in ("a.mcap", "b.csv")}
    assert len(hashes) == 1
    assert demonstration(lift(1)).sha256 not in hashes


def test_an_option_that_is_not_there_is_named():
    with pytest.raises(ParameterError, match=r"no option 'cutof_hz' of a preparation; there are: rate_hz, cutoff_hz"):
        demonstration(lift(), cutof_hz=3)


def test_channels_of_two_clocks_are_refused():
    recording = lift()
    late = Channel(recording["hand.force"].time + 1000.0, recording["hand.force"].values, "N", "task", ("z",))
    with pytest.raises(RecordingError, match="they need one clock"):
        demonstration(recording.with_channels({"hand.force": late}))


def test_different_axes_are_refused():
    recording = lift()
    other = Channel(recording["hand.force"].time, recording["hand.force"].values, "N", "task", ("x",))
    with pytest.raises(ChannelError, match="different axes"):
        demonstration(recording.with_channels({"hand.force": other}))


def test_two_dimensions_are_nothing_special():
    recording = lift()
    twice = {
        n: Channel(c.time, np.column_stack([0.5 * c.values, c.values]), c.unit, c.frame, ("x", "z"))
        for n, c in recording.channels.items()
    }
    lesson = demonstration(Recording(twice, recording.metadata))
    assert lesson.channels == ("position.x", "position.z", "force.x", "force.z", "velocity.x", "velocity.z")
    assert lesson.array(["position", "force"]).shape == (401, 4)


def test_a_demonstration_refuses_signals_of_different_length():
    with pytest.raises(ChannelError, match="one T"):
        Demonstration("a", 0.01, {"position": np.zeros((5, 1)), "force": np.zeros((4, 1))}, ("z",))


def path_cost(a, b, path):
    return sum(((a[i] - b[j]) ** 2).sum() for i, j in path)


def every_path(size_a, size_b, i=0, j=0):
    if (i, j) == (size_a - 1, size_b - 1):
        yield [(i, j)]
        return
    for di, dj in ((1, 1), (1, 0), (0, 1)):
        if i + di < size_a and j + dj < size_b:
            for rest in every_path(size_a, size_b, i + di, j + dj):
                yield [(i, j), *rest]


@pytest.mark.parametrize("seed", range(6))
def test_the_warping_path_is_the_best_of_all_paths(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(5, 2)), rng.normal(size=(4 + seed % 3, 2))
    best = min(path_cost(a, b, path) for path in every_path(len(a), len(b)))
    found = list(zip(*warping_path(a, b), strict=True))
    assert path_cost(a, b, found) == pytest.approx(best, rel=1e-12)


def test_lessons_of_different_speed_align():
    fast, slow = lift(0), lift(1)
    grid = np.arange(0.0, 1.4 * slow.duration_s, 0.01)
    stretched = {
        n: Channel(grid, np.interp(grid / 1.4, c.time, c.values[:, 0]), c.unit, c.frame, c.axes)
        for n, c in slow.channels.items()
        if n != "hand.velocity"
    }
    slow = Recording(stretched, slow.metadata)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lessons = [demonstration(fast), demonstration(slow)]
    aligned = align(lessons, reference=0)
    assert len(aligned[1]) == len(aligned[0])
    assert np.abs(aligned[1].position - aligned[0].position).max() < 0.01
    assert np.abs(lessons[1].position[:400] - lessons[0].position[:400]).max() > 0.05
    assert "warped" in aligned[1].notes[-1]


def test_warping_refuses_what_it_cannot_hold():
    with pytest.raises(ParameterError, match="resample first"):
        warping_path(np.zeros((6000, 1)), np.zeros((10, 1)))
