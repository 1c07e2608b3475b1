"""What a follower foresees of a partner's motion: the plan within some tenths of a second, and nothing of other motions."""

import numpy as np
import pytest

from comanip.people.intent import minimum_jerk
from comanip.skills.foresight import Foresight
from comanip.skills.reference import PhaseReference

DT, LIFT_M, LASTS_S = 0.01, 0.30, 2.2


def taught(way=(1.0,)):
    steps = np.linspace(0.0, 1.0, 221)
    shape = np.array([minimum_jerk(s)[0] for s in steps])[:, None] * LIFT_M
    return PhaseReference(shape * np.array(way), np.zeros((221, len(way))), LASTS_S / 220)


def moved(size, lasts_s, seconds, way=(1.0,), force_n=0.6, begins_s=1.0):
    """After so long, of a partner with whom the robot goes along: foresight, true velocity and acceleration."""
    reference, one, way = taught(way), Foresight(DT, len(way)), np.array(way)
    one.reset([0.0] * len(way))
    for n in range(round((begins_s + seconds) / DT)):
        p, v, a = minimum_jerk((n * DT - begins_s) / lasts_s)
        x, c = size * LIFT_M * p * way, size * LIFT_M * v / lasts_s * way
        pull = (force_n if n * DT > begins_s else 0.0) * way
        if one.hears(x.tolist(), c.tolist(), pull.tolist(), reference, 0.0):
            one.step(x.tolist(), c.tolist())
    return one, c, size * LIFT_M * a / lasts_s**2 * way


@pytest.mark.parametrize(("size", "lasts_s"), [(1.0, 2.2), (0.7, 1.7), (1.2, 3.2)])
def test_the_plan_is_known_at_half_of_the_motion(size, lasts_s):
    one, velocity, _ = moved(size, lasts_s, 0.5 * lasts_s)
    assert one.awake
    assert one.sure > 0.9
    assert one.velocity[0] == pytest.approx(velocity[0], abs=0.03)


def test_braking_is_foreseen():
    one, _, acceleration = moved(1.0, 2.2, 1.6)
    assert acceleration[0] < -0.2
    assert one.acceleration[0] == pytest.approx(acceleration[0], abs=0.12)


def test_axes_may_be_turned():
    straight, _, _ = moved(1.0, 2.2, 1.0)
    turned, _, _ = moved(1.0, 2.2, 1.0, way=(0.6, -0.8))
    assert np.dot(turned.velocity, (0.6, -0.8)) == pytest.approx(straight.velocity[0], rel=1e-9)


def test_who_turns_back_goes_by_none_of_the_plans():
    reference, one = taught(), Foresight(DT, 1)
    one.reset([0.0])
    known = []
    for n in range(250):
        p, v, _ = minimum_jerk(n * DT / 2.2) if n < 80 else minimum_jerk((160 - n) * DT / 2.2)
        x, c = LIFT_M * p, (1 if n < 80 else -1) * LIFT_M * v / 2.2
        if one.hears([x], [c], [0.5 if n < 80 else -3.0], reference, 0.0):
            one.step([x], [c])
        known.append(one.awake)
    assert known[79]
    assert not any(known[110:])  # within 0.3 s


def test_who_sways_at_rest_does_not_set_out():
    reference, one = taught(), Foresight(DT, 1)
    one.reset([0.0])
    for n in range(1000):
        turn = 2 * np.pi * 0.4 * n * DT
        x, c = 0.003 * np.sin(turn), 0.003 * 2 * np.pi * 0.4 * np.cos(turn)
        assert not one.hears([x], [c], [0.8 * np.sin(turn)], reference, 0.0)


def test_of_a_motion_from_elsewhere_nothing_is_foreseen():
    reference, one = taught(), Foresight(DT, 1)
    one.reset([0.1], begins=False)
    for n in range(100):
        assert not one.hears([0.1 + 0.002 * n], [0.2], [1.0], reference, 1.0)


@pytest.mark.parametrize("absurd", [1e6, -1e6, 1e12])
def test_no_number_is_too_large(absurd):
    one, *_ = moved(1.0, 2.2, 1.0)
    for force in (absurd, 0.0):
        one.hears([absurd], [absurd], [force], taught(), 0.5)
        if one.awake:
            one.step([absurd], [absurd])
    assert np.isfinite([*one.velocity, *one.acceleration]).all()
    assert not one.awake
