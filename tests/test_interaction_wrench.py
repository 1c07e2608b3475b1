"""Eq. (3) for force and torque, against a free rigid body that two wrenches push about: nothing of the formula is in it."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interaction import RigidLoad, Wrench, interaction_force, interaction_wrench
from comanip.signals import sphere
from comanip.signals.filters import differentiate

DT = 0.001
TIME = np.arange(0.0, 1.0, DT)
GRAVITY = np.array([0.0, 0.0, -9.80665])
MASS, CENTRE, PARTNER = 3.0, np.array([0.4, 0.05, -0.1]), np.array([0.8, 0.0, 0.0])
INERTIA = np.array([[0.05, 0.01, 0.0], [0.01, 0.20, -0.02], [0.0, -0.02, 0.18]])


def hand_on_object(t):
    """Force [N] and torque about the hand [N m] of the robot's hand on the object."""
    return np.array([2.0 * np.sin(3 * t), 1.0 - t, 0.5 * MASS * 9.80665]), np.array(
        [0.2 * np.cos(5 * t), -0.1, 0.15 * np.sin(4 * t)]
    )


def partner_on_object(t):
    """Force [N] at the partner's grip, and torque [N m]."""
    return np.array([-1.0, 2.0 * np.cos(4 * t), 0.5 * MASS * 9.80665 + np.sin(6 * t)]), np.array(
        [0.1, 0.3 * np.sin(2 * t), -0.1 * t]
    )


def rates(t, state):
    """Of centre of mass (3), its velocity (3), quaternion (4) and angular momentum (3), by Newton and Euler in the task frame."""
    q, momentum = state[6:10] / np.linalg.norm(state[6:10]), state[10:]
    turn = sphere.matrix(q)
    omega = np.linalg.solve(turn @ INERTIA @ turn.T, momentum)
    (f1, t1), (f2, t2) = hand_on_object(t), partner_on_object(t)
    at_hand, at_partner = turn @ -CENTRE, turn @ (PARTNER - CENTRE)
    torque = t1 + t2 + np.cross(at_hand, f1) + np.cross(at_partner, f2)
    dq = 0.5 * sphere.product(np.concatenate([[0.0], omega]), q)
    return np.concatenate([state[3:6], (f1 + f2) / MASS + GRAVITY, dq, torque])


@pytest.fixture(scope="module")
def run():
    """Runge-Kutta of fourth order; what a hand would measure: pose, and derivatives by differences."""
    state, rows = np.concatenate([np.zeros(6), sphere.quaternion(np.array([0.2, -0.4, 0.9])), [0.02, -0.05, 0.04]]), []
    for t in TIME:
        rows.append(state)
        k1 = rates(t, state)
        k2 = rates(t + DT / 2, state + DT / 2 * k1)
        k3 = rates(t + DT / 2, state + DT / 2 * k2)
        state = state + DT / 6 * (k1 + 2 * k2 + 2 * k3 + rates(t + DT, state + DT * k3))
    rows = np.array(rows)
    q = sphere.normalised(rows[:, 6:10])
    hand = rows[:, :3] - sphere.matrix(q) @ CENTRE
    turned = sphere.rotation_vector(sphere.product(q[1:], sphere.inverse(q[:-1]))) / DT
    omega = np.concatenate([turned[:1], 0.5 * (turned[1:] + turned[:-1]), turned[-1:]])
    wrench = [np.array([f(t) for t in TIME]) for f in (hand_on_object, partner_on_object)]
    inside = slice(20, -20)
    about = {
        "orientation": q[inside],
        "acceleration": differentiate(differentiate(hand, DT), DT)[inside],
        "angular_velocity": omega[inside],
        "angular_acceleration": differentiate(omega, DT)[inside],
    }
    sensed = Wrench(-wrench[0][inside, 0], -wrench[0][inside, 1])
    return about, sensed, wrench[1][inside]


def load(**about):
    return RigidLoad(MASS, tuple(CENTRE), tuple(map(tuple, INERTIA)), **about)


def test_with_the_whole_load_it_is_the_partners_wrench_about_the_hand(run):
    about, sensed, partner = run
    found = interaction_wrench(sensed, **about, load=load(share=1.0), gravity=GRAVITY)
    at = sphere.matrix(about["orientation"]) @ PARTNER
    np.testing.assert_allclose(found.force, partner[:, 0], atol=2e-3)
    np.testing.assert_allclose(found.torque, partner[:, 1] + np.cross(at, partner[:, 0]), atol=2e-3)
    assert np.abs(found.torque).max() > 5.0


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
def test_a_partner_who_only_carries_a_share_is_not_felt(run, share):
    """What the partner does beyond the share of weight and inertia, where it holds, is F and T."""
    about, sensed, partner = run
    turn = sphere.matrix(about["orientation"])
    found = interaction_wrench(sensed, **about, load=load(share=share, partner_m=tuple(PARTNER)), gravity=GRAVITY)
    whole = interaction_wrench(sensed, **about, load=load(share=1.0), gravity=GRAVITY)
    w, dw, at = about["angular_velocity"], about["angular_acceleration"], turn @ PARTNER
    carries = partner[:, 0] - sensed.force  # both hands together: m (a_c - g)
    inertia = turn @ INERTIA @ np.swapaxes(turn, 1, 2)
    spin = np.einsum("tij,tj->ti", inertia, dw) + np.cross(w, np.einsum("tij,tj->ti", inertia, w))
    np.testing.assert_allclose(found.force, partner[:, 0] - (1 - share) * carries, atol=2e-3)
    np.testing.assert_allclose(found.torque, whole.torque - (1 - share) * (np.cross(at, carries) + spin), atol=2e-3)


def test_a_beam_at_rest_that_two_share_alike_is_not_felt_however_it_is_turned():
    q = sphere.normalised(np.random.default_rng(0).normal(size=(7, 4)))
    centre = sphere.matrix(q) @ np.array([0.4, 0.0, 0.0])
    weight = np.tile(0.5 * MASS * GRAVITY, (7, 1))
    still = np.zeros((7, 3))
    for partner in (None, (0.8, 0.0, 0.0)):
        beam = RigidLoad(MASS, (0.4, 0.0, 0.0), partner_m=partner)
        found = interaction_wrench(Wrench(weight, still), q, still, still, still, load=beam, gravity=GRAVITY)
        np.testing.assert_allclose(found.force, 0.0, atol=1e-12)
        np.testing.assert_allclose(found.torque, 0.0, atol=1e-12)
    alone = interaction_wrench(
        Wrench(weight, np.cross(centre, MASS * GRAVITY)), q, still, still, still,
        load=RigidLoad(MASS, (0.4, 0.0, 0.0), share=1.0), gravity=GRAVITY,
    )  # fmt: skip
    np.testing.assert_allclose(alone.torque, 0.0, atol=1e-12)


def test_without_turning_the_force_is_that_of_one_axis(run):
    _, sensed, _ = run
    a, still = np.random.default_rng(1).normal(size=sensed.force.shape), np.zeros_like(sensed.force)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(a), 1))
    found = interaction_wrench(sensed, q, a, still, still, load=load(), gravity=GRAVITY)
    np.testing.assert_array_equal(found.force, interaction_force(sensed.force, a, mass_kg=MASS, gravity=GRAVITY))


def test_turning_the_world_turns_the_wrench(run):
    about, sensed, _ = run
    p = sphere.normalised(np.array([0.3, -0.5, 0.2, 0.7]))
    r = sphere.matrix(p)
    one = interaction_wrench(sensed, **about, load=load(), gravity=GRAVITY)
    turned = {k: v @ r.T for k, v in about.items() if k != "orientation"}
    turned["orientation"] = sphere.product(p, about["orientation"])
    seen = Wrench(sensed.force @ r.T, sensed.torque @ r.T)
    other = interaction_wrench(seen, **turned, load=load(), gravity=r @ GRAVITY)
    np.testing.assert_allclose(other.force, one.force @ r.T, atol=1e-9)
    np.testing.assert_allclose(other.torque, one.torque @ r.T, atol=1e-9)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass_kg": -1.0}, "mass is -1 kg"),
        ({"share": 1.5}, "share is 1.5; allowed: 0 to 1"),
        ({"centre_m": (0.0, 1.0)}, r"centre_m has shape \(2,\); allowed: \(3,\)"),
        ({"inertia_kg_m2": ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "must be symmetric"),
    ],
)
def test_a_load_that_cannot_be_is_refused(wrong, message):
    with pytest.raises(ParameterError, match=message):
        RigidLoad(**{"mass_kg": 1.0, **wrong})
