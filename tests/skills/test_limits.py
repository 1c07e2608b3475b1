"""The envelope's numbers as they follow from what was taught, each with the value that it must have."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.safety.limits import Limits, as_taught, taught_pull, taught_speed


def taught(*, walls=((0.8, 1.1),), speed=(0.2,), spread=(0.05,), force=4.0, length_m=0.3):
    """What a skill says of its lessons: one path along x at 0.1 m/s, pulled along with `force`, and two states."""
    d = len(walls)
    position = np.zeros((101, d))
    position[:, 0] = 0.1 * 0.01 * np.arange(101)
    pull = np.zeros((101, d))
    pull[:, 0] = force
    means = np.zeros((2, 2 * d))
    means[1, d:] = speed
    covariances = np.stack([np.eye(2 * d) * 1e-8, np.diag([1.0] * d + [s**2 for s in spread])])
    model = SimpleNamespace(
        channels=[f"position.{n}" for n in range(d)] + [f"velocity.{n}" for n in range(d)], means=means, covariances=covariances
    )
    path = SimpleNamespace(position=position, force=pull, step_s=0.01, length_m=length_m)
    return SimpleNamespace(workspace=walls, model=model, paths=[path])


def test_the_fastest_lesson_is_mean_and_two_deviations_of_a_vector():
    assert taught_speed(taught()) == pytest.approx(0.3)
    two = taught(walls=((0.0, 1.0),) * 2, speed=(0.3, -0.4), spread=(0.03, 0.04))
    assert taught_speed(two) == pytest.approx(0.6)


def test_the_hand_goes_1_6_times_as_fast_as_the_fastest_lesson_and_never_faster_than_by_default():
    assert as_taught([taught()]).v_max_m_per_s == pytest.approx(0.48)
    assert as_taught([taught(), taught(speed=(0.3,))]).v_max_m_per_s == pytest.approx(0.64)
    assert as_taught([taught(speed=(0.5,))]).v_max_m_per_s == 0.8


def test_the_walls_are_around_all_that_was_taught_and_stated_ones_stay():
    one, other = taught(), taught(walls=((0.5, 0.9),))
    assert as_taught([one, other]).workspace_m == (pytest.approx((0.45, 1.15)),)
    assert as_taught([one], Limits(v_max_m_per_s=0.3)).workspace_m == (pytest.approx((0.75, 1.15)),)
    assert as_taught([one], Limits(v_max_m_per_s=0.3)).v_max_m_per_s == 0.3
    stated = Limits(workspace_m=((0.0, 2.0),))
    assert as_taught([one], stated) == stated
    assert as_taught([one]).begins_beside_m == 0.25
    assert Limits().begins_beside_m is None


def test_a_law_that_yields_is_led_with_6_newtons_or_what_led_the_teacher():
    assert taught_pull(taught(force=9.0)) == pytest.approx(9.0)
    assert taught_pull(taught(force=-9.0)) == 0.0
    for force, newtons in ((4.0, 6.0), (9.0, 9.0)):
        assert as_taught([taught(), taught(force=force)], yields=True).pushed_n == pytest.approx(newtons)
        assert as_taught([taught(force=force)]).pushed_n == 10.0


def test_the_budget_is_10_newtons_over_the_longest_way_and_at_least_3_joules():
    assert as_taught([taught(length_m=0.1)]).energy_j == 3.0
    assert as_taught([taught(), taught(length_m=1.5)]).energy_j == pytest.approx(15.0)


def test_nobody_believes_more_force_while_it_gives_way_to_an_impact_than_180_newtons():
    assert (Limits().force_limit_n, Limits().impact_n, Limits().impact_s) == (60.0, 180.0, 0.2)


@pytest.mark.parametrize("wall", [(1.0, 0.0), (1.0, 1.0), (float("nan"), 1.0), (0.0, float("nan"))])
def test_walls_that_enclose_nothing_are_refused(wall):
    with pytest.raises(ParameterError, match="lowest < highest on each axis"):
        Limits(workspace_m=((0.0, 1.0), wall))
    assert Limits(workspace_m=((-np.inf, np.inf),)).workspace_m == ((-np.inf, np.inf),)
