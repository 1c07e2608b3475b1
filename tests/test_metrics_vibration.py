"""Vibration on signals whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.evaluation.metrics import vibration

DT = 0.01
T = np.arange(0.0, 20.0, DT)
MIDDLE = (T > 3.0) & (T < 17.0)  # the filter's ends left out


@pytest.mark.parametrize(("hertz", "passes"), [(0.5, 0.002), (1.25, 1 / 17), (2.5, 0.5), (5.0, 16 / 17), (10.0, 1.0)])
def test_a_sine_counts_by_how_fast_it_is(hertz, passes):
    """Butterworth of second order, forward and back: 1 - 1/(1 + (f/fc)^4) of the amplitude."""
    force = 2.0 * np.sin(2.0 * np.pi * hertz * T)
    assert vibration(force, DT, MIDDLE) == pytest.approx(2.0 / np.sqrt(2.0) * passes, abs=0.02)


def test_what_stands_or_drifts_does_not_vibrate():
    assert vibration(np.full(len(T), 7.0), DT) == pytest.approx(0.0, abs=1e-9)
    assert vibration(7.0 + 0.5 * T, DT, MIDDLE) == pytest.approx(0.0, abs=1e-6)


def test_only_motion_counts():
    force = np.where(T > 10.0, np.sin(2.0 * np.pi * 8.0 * T), 0.0)
    assert vibration(force, DT, T > 11.0) == pytest.approx(1.0 / np.sqrt(2.0), abs=0.02)
    assert vibration(force, DT, T < 9.0) < 0.01
    assert vibration(force, DT, T < 0.0) == 0.0
