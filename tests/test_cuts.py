"""Where a recording is cut, with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.lessons.cuts import between, merged, trimmed
from comanip.recording import Channel

EDGE = 8  # frames by which motion may seem longer than it is


@pytest.mark.parametrize(
    ("cuts", "expected"),
    [
        ([], []),
        ([(1.0, 2.0), (3.0, 4.0)], [(1.0, 2.0), (3.0, 4.0)]),
        ([(1.0, 3.0), (2.0, 4.0)], [(1.0, 4.0)]),
        ([(1.0, 5.0), (2.0, 3.0)], [(1.0, 5.0)]),  # one inside the other: the longer end counts
        ([(1.0, 2.0), (2.0, 3.0)], [(1.0, 2.0), (2.0, 3.0)]),  # they touch: a sample lies between
        ([(1.0, 4.0), (2.0, 3.0), (3.5, 6.0), (7.0, 8.0)], [(1.0, 6.0), (7.0, 8.0)]),
    ],
)
def test_holes_that_overlap_are_one(cuts, expected):
    assert merged(cuts) == expected


def test_what_lies_between_two_holes_has_both_of_its_ends():
    channel = Channel(time=np.arange(6.0), values=np.arange(6.0)[:, None], unit="m", axes=("z",))
    assert between(channel, 1.0, 4.0).time.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert between(channel, 1.0, 4.0).values[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(("before", "after"), [(50, 80), (80, 50), (20, 90), (0, 60), (60, 0)])
def test_rest_is_trimmed_at_both_ends_to_what_was_asked(before, after):
    """100 frames in motion at 100 Hz between rests; 0.3 s of rest stay where there were more."""
    dt, moving = 0.01, 100
    velocity = np.concatenate([np.zeros(before), np.full(moving, 0.2), np.zeros(after)])[:, None]
    signals = {"velocity": velocity, "frame": np.arange(float(len(velocity)))[:, None]}
    notes = []
    found = trimmed(signals, dt, 0.3, "m/s", notes)
    first, last = found["frame"][0, 0], found["frame"][-1, 0]
    assert max(0, before - 30 - EDGE) <= first <= max(0, before - 30)  # the first frames in motion may count as rest, or the last
    assert before + moving + min(after, 30) - 1 <= last <= before + moving + min(after, 30 + EDGE) - 1
    assert len(found["velocity"]) == len(found["frame"])
    assert len(notes) == 1
    assert f"{first * dt:.3g} s at the start, {(len(velocity) - 1 - last) * dt:.3g} s at the end" in notes[0]
    assert trimmed(signals, dt, None, "m/s", notes) is signals
    assert trimmed(signals, dt, 1.0, "m/s", notes) is signals
