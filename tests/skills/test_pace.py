"""A leader's clock: what slows it down, how late it may end, and what it expects to feel meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.models.hmm import Hmm
from comanip.skills.collaborate import BEGINS_S, FADES_BELOW, FADING_S, LATEST, CollaborativeLaw, Pace, Watch
from comanip.skills.reference import PhaseReference

DT, FAR_M, LASTS_S = 0.01, 0.3, 2.0


def path() -> PhaseReference:
    """Minimum jerk over 0.3 m in 2 s; 3 N along it in the middle."""
    s = np.linspace(0.0, 1.0, round(LASTS_S / DT) + 1)[:, None]
    way = FAR_M * s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    return PhaseReference(way, 3.0 * np.sin(np.pi * s), DT)


def gone(resistance_n=0.0, start_m=0.0, law=None, most_s=30.0):
    """Ticks of (time, phase, rate, velocity, expected) to the end, of a hand that goes where it is sent."""
    pace, x, rows = Pace(path(), law or CollaborativeLaw.for_role("leader"), DT), np.array([start_m]), []
    pace.start(0.0, x.copy())
    while not pace.ended and len(rows) * DT < most_s:
        phase = pace.phase
        pace.step(x, np.array([-resistance_n]))
        x += DT * pace.velocity
        rows.append([len(rows) * DT, phase, pace.rate, pace.velocity[0], pace.expected[0]])
    return np.array(rows)


def test_nobody_in_the_way_takes_as_long_as_the_lessons_and_the_start():
    rows = gone()
    assert len(rows) * DT == pytest.approx(LASTS_S + 0.5 * BEGINS_S, abs=0.05)


def test_what_is_comfortable_slows_nothing_and_what_is_more_does():
    law = CollaborativeLaw.for_role("leader", comfortable_n=2.0, yield_gain_per_n=0.2, patience_s=0.05)
    moving = slice(60, 150)
    assert gone(1.9, law=law)[moving, 2] == pytest.approx(1.0)
    assert gone(4.0, law=law)[moving, 2] == pytest.approx(1.0 - 0.2 * (4.0 - 2.0), abs=0.01)


def test_resistance_must_last_before_it_counts():
    law = CollaborativeLaw.for_role("leader", comfortable_n=0.0, yield_gain_per_n=0.2, patience_s=0.6)
    rows = gone(2.0, law=law)
    first, later = np.abs(rows[:, 0] - 0.45).argmin(), np.abs(rows[:, 0] - 2.0).argmin()
    assert 0.7 < rows[first, 2] < 0.9
    assert rows[later, 2] == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("slowest", [0.1, 0.38])
def test_however_much_it_is_held_back_it_ends_in_time(slowest):
    law = CollaborativeLaw.for_role("leader", slowest_clock=slowest, patience_s=0.05)
    took = len(gone(50.0, law=law)) * DT
    assert LASTS_S * 1.5 < took < LASTS_S * LATEST + 0.5


def test_at_half_the_pace_half_the_force_is_expected():
    """A person's resistance grows with speed."""
    law = CollaborativeLaw.for_role("leader", comfortable_n=0.0, yield_gain_per_n=0.25, patience_s=0.05)
    rows = gone(2.0, law=law)
    moving = rows[(rows[:, 0] > 0.8) & (rows[:, 1] < 1.4)]
    there = 3.0 * np.sin(np.pi * moving[:, 1] / LASTS_S)
    assert moving[:, 2].max() < 0.75
    np.testing.assert_allclose(moving[:, 4], moving[:, 2] * there, rtol=0.02, atol=0.02)


def test_it_eases_in_and_no_start_off_the_path_is_hurried():
    rows = gone()
    assert rows[0, 2] < 0.05
    assert (np.diff(rows[: round(BEGINS_S / DT), 2]) > 0.0).all()
    top = path().top_speed
    for off in (0.05, 0.15, -0.2):
        assert np.abs(gone(start_m=off)[:, 3]).max() < 1.6 * top


@pytest.mark.parametrize("off_m", [0.3, 1.0])
def test_what_the_hand_is_off_the_path_fades_no_faster_than_a_share_of_the_taught_speed(off_m):
    """Minimum jerk is 1.875 times as fast in the middle as on the whole."""
    pace = Pace(path(), CollaborativeLaw.for_role("leader"), DT)
    pace.start(0.0, np.array([off_m]))
    fastest = 1.875 * off_m / pace.clock[FADING_S]
    assert fastest <= FADES_BELOW * path().top_speed * (1.0 + 1e-12)


@pytest.mark.parametrize("model_dt", [0.01, 0.02, 0.05])
def test_the_state_is_watched_on_the_clock_of_the_lessons(model_dt, monkeypatch):
    model = Hmm([1.0], [[1.0]], [[0.0, 0.0]], [np.eye(2)], ("position.z", "force.z"))
    watch, taken = Watch(model, model_dt, DT), []
    monkeypatch.setattr(watch.filter, "step", lambda seen: taken.append(seen.copy()))
    for n in range(100):
        watch.step(np.array([0.01 * n]), np.array([1.0]))
    assert len(taken) == pytest.approx(1.0 / model_dt, abs=1)
