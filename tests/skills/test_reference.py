"""The reference that older skills' clocks give: from their start to the lessons' end, without a force at rest."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.recording import Channel
from comanip.skills.reference import PhaseReference
from lifts import lift, minimum_jerk


def lessons(**about):
    return demonstrations([shifted(lift(seed), **about) for seed in range(3)])


def shifted(recording, force_n=0.0, way=(0.0,)):
    """With a constant force on top, and beside the lift a second axis that goes out and returns."""
    time = recording["hand.force"].time
    x, dx, _ = minimum_jerk(time)
    side = way[0] * np.sin(np.pi * x / 0.25)
    swing = way[0] * np.pi / 0.25 * dx * np.cos(np.pi * x / 0.25)
    rng = np.random.default_rng(1)
    found = {}
    for name, more, noise in (("position", 0.2 + side, 2e-5), ("velocity", swing, 1e-3), ("force", 0.0 * x, 0.1)):
        channel = recording[f"hand.{name}"]
        offset = force_n if name == "force" else 0.0
        beside = more + noise * rng.normal(size=len(time))
        found[f"hand.{name}"] = Channel(
            time, np.column_stack([channel.values[:, 0] + offset, beside + offset]), channel.unit, "task", ("z", "x")
        )
    return recording.with_channels(found)


@pytest.mark.parametrize("force_n", [0.0, 3.0])
def test_a_sensors_offset_is_not_expected_at_rest_nor_along_the_way(force_n):
    """3 N on every sample are not what the partner does: F_r is 0 where lessons rest, and in motion what it is without them."""
    plain, offset = (PhaseReference.learned(learn(lessons(force_n=n), role="follower").clock) for n in (0.0, force_n))
    for reference in (plain, offset):
        assert np.abs(reference.force[[0, -1]]).max() < 0.05
    n = min(len(plain.force), len(offset.force)) // 2
    assert offset.force[n, 0] == pytest.approx(plain.force[n, 0], abs=0.5)
    assert plain.force[n, 0] > 2.0


def test_the_way_ends_where_lessons_end_and_is_stretched_along_itself_though_an_axis_returns():
    """The second axis comes back to where it began: a factor on its net displacement of 0 would throw the hand away."""
    learned = learn(lessons(way=(0.1,)), role="follower")
    end = np.array([1.10, 0.2])
    stretched, as_is = PhaseReference.learned(learned.clock, end), PhaseReference.learned(learned.clock)
    np.testing.assert_allclose(stretched.position[-1], end, atol=1e-9)
    np.testing.assert_allclose(stretched.position[0], as_is.position[0], atol=2e-3)  # what is added grows along the way
    assert as_is.position[0, 0] == pytest.approx(0.8, abs=0.02)  # and it begins where lessons begin
    assert np.ptp(stretched.position[:, 1]) == pytest.approx(0.1, abs=0.05)
    added = stretched.position - as_is.position
    assert (np.diff(np.linalg.norm(added, axis=1)) > -1e-9).all()


def test_the_closest_phase_is_looked_for_around_where_it_was_and_not_where_the_path_was_before():
    """Out and back on one line: the same place twice, and going back does not count as going out."""
    s = np.linspace(0.0, np.pi, 401)
    reference = PhaseReference(0.3 * np.sin(s)[:, None], np.zeros((401, 1)), 0.01)
    assert reference.closest(np.array([0.2]), 3.2) == pytest.approx(3.07, abs=0.02)
    assert reference.closest(np.array([0.2]), 0.9) == pytest.approx(0.93, abs=0.02)
    assert reference.closest(np.array([0.0]), 2.0) == pytest.approx(2.0, abs=0.17), "no farther than 0.15 s at once"
