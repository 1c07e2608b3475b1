"""The arm on its grip: momentum balances, nothing passive gives energy, and without mass it is the person of old."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.people import Body, Course, Hand, Person, make
from comanip.people.minds import Impedance, Resists, StiffShoulder, Trails
from comanip.people.partners import Arm, HumanLeader, Unsteadiness

H = 0.001
CALM = {"relative": 0.0, "tremor_n": 0.0}


def calm(**about):
    return Body(**{**CALM, "carried_n": (9.0,), **about})


def driven(t):
    """A smooth motion of the object's end that starts at rest."""
    grow = 1.0 - np.exp(-t)
    return 0.05 * grow * np.sin(3.0 * t) + 0.01 * grow * np.sin(17.0 * t)


def played(person, seconds=4.0, motion=driven):
    """Times, object's positions and velocities, forces on it, (T,) each."""
    person.reset(np.zeros(1))
    t, out = np.arange(round(seconds / H)) * H, np.zeros(1)
    x = np.array([motion(one) for one in np.append(t, seconds)])
    v = np.diff(x) / H
    forces = []
    for n in range(len(t)):
        person.force(float(t[n]), x[n : n + 1], v[n : n + 1], out)
        forces.append(out[0])
    return t, x[:-1], v, np.array(forces)


@pytest.mark.parametrize(("arm", "grip"), [(0.5, 4000.0), (2.5, 1000.0), (0.01, 1e5)])
def test_the_object_gets_the_momentum_that_the_hand_loses(arm, grip):
    rng, body = np.random.default_rng(1), calm(arm_kg=arm, grip_n_per_m=grip)
    hand = Hand(body, 2 - 1, H)
    pushed = felt = 0.0
    for n in range(2000):
        muscles = 9.0 + 5.0 * rng.standard_normal()
        hand.step([muscles], [driven(n * H)], [(driven((n + 1) * H) - driven(n * H)) / H])
        pushed, felt = pushed + H * muscles, felt + H * hand.felt[0]
    assert pushed - felt == pytest.approx(arm * hand.velocity[0], abs=1e-9)


def test_a_hand_at_rest_carries_the_weight_from_the_first_moment():
    hand = Hand(calm(), 1, H)
    for _ in range(500):
        hand.step([9.0], [0.0], [0.0])
        assert hand.felt[0] == pytest.approx(9.0, abs=1e-9)
    assert hand.position[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("arm", [0.5, 2.5])
def test_on_a_rail_the_hand_rings_at_its_own_frequency_and_damping(arm):
    body = calm(arm_kg=arm, grip_n_per_m=2000.0, grip_ns_per_m=4.0)
    hand, felt = Hand(body, 1, H), []
    hand.velocity[0] = 0.1
    for _ in range(1000):
        hand.step([9.0], [0.0], [0.0])
        felt.append(hand.position[0])
    a, w = 4.0 / (2.0 * arm), np.sqrt(2000.0 / arm - (4.0 / (2.0 * arm)) ** 2)
    t = (np.arange(1000) + 1) * H
    np.testing.assert_allclose(felt, 0.1 / w * np.exp(-a * t) * np.sin(w * t), atol=1e-9)


@pytest.mark.parametrize("mind", [Resists, Trails, StiffShoulder, Impedance])
@pytest.mark.parametrize("arm", [0.5, 2.5])
def test_who_means_nothing_gives_no_energy(mind, arm):
    """What flows into the object never exceeds what flowed out of it before: the stores (arm, grip, spring) began empty."""
    body = calm(carried_n=(0.0,), arm_kg=arm, grip_n_per_m=4000.0, grip_ns_per_m=30.0)
    person = Person(body, mind(body, None, 1, H, np.random.default_rng(0)), n_axes=1, rng=np.random.default_rng(0))
    _, _, v, force = played(person)
    given = np.cumsum(force * v) * H
    assert given.max() < 1e-3 * np.abs(given).max()
    assert given[-1] < 0.0


def test_without_mass_and_with_a_rigid_grip_the_object_feels_the_muscles_themselves():
    legs, rng = ((0.5, 1.2, (0.2,)),), np.random.default_rng(0)
    arm = Arm(200.0, 25.0, 9.0, Unsteadiness(relative=0.0, absolute_n=0.0, tremor_n=0.0))
    _, _, _, wanted = played(HumanLeader(Course(legs, feedforward_kg=1.0), arm, rng=rng))
    off = []
    for mass, grip in ((1e-1, 1e5), (1e-2, 1e6), (1e-3, 1e7)):
        body = calm(stiffness_n_per_m=200.0, damping_ns_per_m=25.0, arm_kg=mass, grip_n_per_m=grip, grip_ns_per_m=40.0)
        person = make("plain", role="leading", course=Course(legs), body=body, axes=("z",), rng=rng)
        person._noise[0].sample = lambda force: 0.0
        _, _, _, force = played(person)
        off.append(float(np.sqrt(np.mean((force - wanted) ** 2))))
    assert off[1] < 0.4 * off[0]
    assert off[2] < 0.1 < 0.02 * np.abs(wanted - 9.0).max()


def test_an_arm_pulls_with_no_more_than_its_strength():
    body = calm(force_limit_n=15.0, stiffness_n_per_m=600.0)
    person = make(
        "plain", role="leading", course=Course(((0.0, 1.0, (0.3,)),)), body=body, axes=("z",), rng=np.random.default_rng(0)
    )
    _, _, _, force = played(person, motion=lambda t: 0.0)
    assert force[-500:].mean() == pytest.approx(15.0, abs=0.01)


def test_an_open_hand_exerts_nothing_and_takes_hold_again_without_a_jerk():
    body = calm()
    hand, felt = Hand(body, 1, H), []
    for n in range(3000):
        hold = 0.0 if 1000 <= n < 1500 else 1.0 if n < 1000 else min((n - 1500) / 200.0, 1.0)
        x, v = (0.0, 0.0) if n < 1000 else (-0.1 * (n - 1000) * H, -0.1) if n < 1500 else (-0.05, 0.0)
        hand.step([9.0 * hold], [x], [v], hold)
        felt.append(hand.felt[0])
    assert max(map(abs, felt[1000:1500])) == 0.0
    assert max(felt[1500:]) < 2.0 * 9.0
    assert felt[-1] == pytest.approx(9.0, abs=0.01)


def test_axes_do_not_know_of_each_other():
    course = Course(((0.2, 1.0, (0.1, -0.2)),))
    body = Body(**CALM, carried_n=(0.0, 9.0))
    both = make("plain", role="leading", course=course, body=body, axes=("y", "z"), rng=np.random.default_rng(0))
    both.reset(np.array([1.0, 2.0]))
    out, one = np.zeros(2), []
    for n in range(1500):
        both.force(n * H, np.array([1.0, 2.0]), np.zeros(2), out)
        one.append(out.copy())
    for axis, (far, carried) in enumerate(((0.1, 0.0), (-0.2, 9.0))):
        own = replace(body, carried_n=(carried,))
        alone = make(
            "plain", role="leading", course=Course(((0.2, 1.0, (far,)),)), body=own, axes=("q",), rng=np.random.default_rng(0)
        )
        alone._noise[0].sample = lambda force: 0.0
        _, _, _, force = played(alone, seconds=1.5, motion=lambda t: 0.0)
        np.testing.assert_allclose(np.array(one)[:, axis], force, atol=0.5)
        assert abs(force[-1] - carried) > 5.0


@pytest.mark.parametrize("kind", ["plain", "Hill muscles", "optimal feedback", "child"])
def test_the_quick_way_of_one_axis_is_the_same_to_the_last_bit(kind):
    forces = []
    for slow in (False, True):
        rng, course = np.random.default_rng(4), Course(((0.3, 1.0, (0.2,)),))
        person = make(kind, role="leading", course=course, body=Body(), axes=("z",), rng=rng)
        if slow:
            person.force = person._force
        forces.append(played(person, seconds=1.5)[3])
    np.testing.assert_array_equal(*forces)
