"""The clock of the lessons: state by state at the median pace, in memory and streamed alike."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.formats import Columns, write
from comanip.learned.learn import learn
from comanip.learned.stream import learn_stream
from comanip.lessons.demonstration import Preparation, demonstrations
from comanip.lessons.shards import RecordingShards
from comanip.models.clock import aligned_phase, learn_clock
from comanip.models.hmm import Hmm
from lifts import lift

CHANNELS = ("position.z", "velocity.z")


def stays(*frames):
    """Posteriors (T, K) of a lesson that is so many frames in each state, without a doubt."""
    return np.repeat(np.eye(len(frames)), frames, axis=0)


def test_a_lesson_goes_through_each_state_at_the_median_pace_over_its_own():
    """The third rests for 90 frames where others rest for 10: by the mean the task would last 77 frames, by the median 50."""
    phases = aligned_phase([stays(10, 40), stays(20, 40), stays(90, 20)], 0.01)
    for phase, first in zip(phases, (10, 20, 90), strict=True):
        assert phase[-1] == pytest.approx(0.60)  # 20 and 40 frames are usual
        assert phase[first - 1] == pytest.approx(0.20)
        assert (np.diff(phase) > 0.0).all()
    assert np.diff(phases[2])[0] == pytest.approx(0.01 * 20 / 90)


def two_states():
    """At 0 and at rest, then at 1 and moving."""
    return Hmm(
        np.array([1.0, 0.0]), np.array([[0.95, 0.05], [0.0, 1.0]]), np.array([[0.0, 0.0], [1.0, 0.5]]),
        np.tile(1e-2 * np.eye(2), (2, 1, 1)), CHANNELS,
    )  # fmt: skip


def one(first, second, seed):
    rng = np.random.default_rng(seed)
    frames = np.concatenate([np.zeros((first, 2)), np.tile([1.0, 0.5], (second, 1))])
    return frames + 1e-3 * rng.normal(size=frames.shape)


def test_the_clock_says_when_a_state_is_usual():
    clock = learn_clock(two_states(), [one(10, 40, 0), one(20, 40, 1), one(90, 20, 2)], 0.01)
    at = clock.means[:, clock.channels.index("phase")]
    assert at[0] == pytest.approx(0.10, abs=0.01)  # the middle of 0 to 0.2 s,
    assert at[1] == pytest.approx(0.40, abs=0.01)  # and of 0.2 to 0.6 s


def late(seed, rest_s):
    """A lift before which the hand rests for so long."""
    recording = lift(seed)
    frames = round(rest_s * 100)
    channels = {}
    for name, channel in recording.channels.items():
        values = np.concatenate([np.repeat(channel.values[:1], frames, axis=0), channel.values])
        values[:frames] += np.random.default_rng(seed).normal(size=(frames, 1)) * 1e-4
        channels[name] = type(channel)(0.01 * np.arange(len(values)), values, channel.unit, channel.frame, channel.axes)
    return recording.with_channels(channels)


def test_a_streamed_clock_is_that_of_memory_though_one_lesson_rests_for_long(tmp_path):
    """Mean and median of its occupancies are apart: one of three lessons rests for 6 s before it moves."""
    takes = [lift(0), lift(1), late(2, 6.0)]
    for n, take in enumerate(takes):
        write(take, tmp_path / f"{n}.mcap")
    names = ("position.z", "force.z", "velocity.z")
    shards = RecordingShards(names, Columns(), Preparation(role="follower", rate_hz=100.0))
    files = sorted(map(str, tmp_path.glob("*.mcap")))
    streamed = learn_stream(files, read=shards, channels=names, dt=0.01, role="follower", n_states=4)
    memory = learn(demonstrations(takes), role="follower", n_states=4)
    assert streamed.clock is not None
    assert memory.clock is not None
    phase = [skill.clock.means[:, skill.clock.channels.index("phase")] for skill in (memory, streamed)]
    np.testing.assert_allclose(phase[1], phase[0], atol=0.05)
    usual = np.concatenate(aligned_phase([stays(400), stays(400), stays(1000)], 0.01)).max()
    assert max(p.max() for p in phase) < usual == pytest.approx(4.0)
