"""Each measure on signals whose answer is known on paper."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.evaluation.metrics import (
    effort,
    effort_share,
    energy_exchanged,
    internal_force,
    log_dimensionless_jerk,
    tracking_rms,
    work,
)
from comanip.people.intent import minimum_jerk

DT = 0.001
T = np.arange(0.0, 2.0, DT)
SINE = np.sin(2.0 * np.pi * T)


def test_effort_is_the_integral_of_force_squared():
    assert effort(3.0 * SINE, DT) == pytest.approx(9.0, rel=1e-9)  # mean sin² is 1/2, over 2 s


def test_work_counts_signs_and_exchanged_energy_does_not():
    assert work(4.0 * SINE, 0.5 * SINE, DT) == pytest.approx(2.0, rel=1e-9)
    assert work(4.0 * SINE, 0.5 * np.cos(2.0 * np.pi * T), DT) == pytest.approx(0.0, abs=1e-9)
    assert energy_exchanged(4.0 * SINE, 0.5 * np.cos(2.0 * np.pi * T), DT) == pytest.approx(2.0 * 2.0 / np.pi, rel=1e-3)


def test_internal_force_is_the_smaller_of_two_that_oppose_each_other_signed_as_the_first():
    first = np.array([3.0, -3.0, 1.0, -1.0, 2.0, 0.0])
    second = np.array([-1.0, 1.0, -4.0, 4.0, 5.0, -2.0])
    np.testing.assert_array_equal(internal_force(first, second), [1.0, -1.0, 1.0, -1.0, 0.0, 0.0])


def test_internal_force_in_three_axes_is_the_smaller_one_by_the_cosine_and_turns_with_them():
    """6 N against 4 N at 60 degrees from opposed: 4 cos 60 = 2 N along the first. Aligned or across: nothing."""
    first = np.array([[6.0, 0.0, 0.0]] * 4)
    second = 4.0 * np.array([[-0.5, np.sqrt(0.75), 0.0], [0.5, np.sqrt(0.75), 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    found = internal_force(first, second)
    np.testing.assert_allclose(found, [[2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [4.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(internal_force(second[:1], first[:1]), 0.5 * second[:1], atol=1e-12)
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    np.testing.assert_allclose(internal_force(first @ turn.T, second @ turn.T), found @ turn.T, atol=1e-12)


def test_energy_is_of_the_power_in_all_axes_together():
    """A force across the motion exchanges nothing, and 1 W in along one axis while 1 W goes out along another is nothing."""
    force, velocity = np.tile([2.0, 2.0], (200, 1)), np.tile([0.5, -0.5], (200, 1))
    assert energy_exchanged(force, velocity, DT) == pytest.approx(0.0, abs=1e-12)
    assert energy_exchanged(force, np.abs(velocity), DT) == pytest.approx(2.0 * 200 * DT)


def test_the_share_of_effort_is_of_squared_forces():
    assert effort_share(3.0 * SINE, SINE) == pytest.approx(0.9)
    assert effort_share(SINE, 3.0 * SINE) == pytest.approx(0.1)
    assert effort_share(SINE, -SINE) == 0.5
    assert effort_share(np.zeros(3), np.zeros(3)) == 0.5


def test_smoothness_is_that_of_minimum_jerk_whatever_its_size_and_duration():
    """Of minimum jerk T³/v_peak² ∫ jerk² = 720/1.875² = 204.8: LDLJ -5.322."""
    for size, duration in ((0.3, 2.0), (1.0, 0.8)):
        t = np.arange(0.0, duration, DT)
        v = np.array([size * minimum_jerk(s / duration)[1] / duration for s in t])
        assert log_dimensionless_jerk(v, DT) == pytest.approx(-np.log(720.0 / 1.875**2), abs=0.02)


def test_a_tremor_makes_a_motion_less_smooth():
    assert log_dimensionless_jerk(SINE + 0.01 * np.sin(60.0 * T), DT) < log_dimensionless_jerk(SINE, DT) - 0.5
    assert log_dimensionless_jerk(np.zeros(10), DT) == 0.0


def test_tracking_is_a_distance_in_all_axes_together():
    path = np.zeros((50, 3))
    assert tracking_rms(path + np.array([0.3, 0.4, 0.0]), path) == pytest.approx(0.5)
