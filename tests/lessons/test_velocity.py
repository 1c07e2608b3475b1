"""Velocity against d(position)/dt: late, early, or only unlike; and stamps that jitter against frames that are missing."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ComanipWarning, RecordingError
from comanip.lessons.demonstration import demonstration
from comanip.recording import Channel
from lifts import lift


def shifted(frames, rate_hz=200.0, seed=0):
    """A lift whose velocity comes `frames` later than its position."""
    recording = lift(seed, rate_hz=rate_hz)
    velocity = recording["hand.velocity"]
    return recording.with_channels({"hand.velocity": replace(velocity, values=np.roll(velocity.values, frames, axis=0))})


@pytest.mark.parametrize(("ms", "word"), [(40, "late"), (-40, "early")])
def test_a_lag_of_40_ms_is_said_with_its_sign_and_size(ms, word):
    with pytest.warns(ComanipWarning, match=rf"when shifted by {ms} ms: velocity is {word}"):
        demonstration(shifted(ms // 5))


@pytest.mark.parametrize("ms", [80, -80])
def test_a_lag_of_80_ms_is_refused(ms):
    with pytest.raises(RecordingError, match=rf"velocity is {'late' if ms > 0 else 'early'}; leave the velocity out"):
        demonstration(shifted(ms // 5))


@pytest.mark.parametrize("ms", [0, 10, -10])
def test_what_filters_delay_is_no_lag(ms):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        demonstration(shifted(ms // 5))


def test_a_shift_that_explains_little_is_no_lag():
    """Slow noise over the velocity, by which some lag always fits a hair better, is not late: shifting leaves most of it."""
    rng, recording = np.random.default_rng(3), lift(rate_hz=200.0)
    velocity = recording["hand.velocity"]
    slow = np.convolve(rng.normal(size=len(velocity.time)), np.hanning(60), mode="same")[:, None]
    moving = np.abs(velocity.values) > 0.02
    spoilt = velocity.values + 0.045 * slow / slow.std() * moving
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        demonstration(recording.with_channels({"hand.velocity": replace(velocity, values=spoilt)}))
    assert not [w for w in said if "shifted by" in str(w.message)]


def jittered(lost=0, seed=0):
    """1 kHz with 0.3 ms of jitter, in order, and `lost` frames gone in the middle."""
    rng, recording = np.random.default_rng(seed), lift(rate_hz=1000.0)
    n = len(recording["hand.force"].time)
    stamps = np.sort(np.arange(n) * 1e-3 + rng.normal(scale=3e-4, size=n)) - 0.0
    stamps = np.maximum.accumulate(stamps + 1e-9 * np.arange(n))
    keep = np.ones(n, dtype=bool)
    keep[2000 : 2000 + lost] = False
    return recording.with_channels(
        {name: Channel(stamps[keep], c.values[keep], c.unit, c.frame, c.axes) for name, c in recording.channels.items()}
    )


@pytest.mark.parametrize("lost", [0, 3])
def test_jitter_is_no_missing_frame_and_a_missing_frame_is_no_jitter(lost):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = demonstration(jittered(lost))
    assert 1.0 / found.dt == pytest.approx(1000.0, rel=1e-3)
    assert len(found) == pytest.approx(4001, abs=4)
    told = " ".join(found.notes)
    assert ("missing" in told) == (lost > 0), told
