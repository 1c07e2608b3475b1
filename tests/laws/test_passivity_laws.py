"""The passivity controller: what it renders never gives more energy than it was given, and it does nothing while all is well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.devices.link import Network
from comanip.errors import ParameterError
from comanip.skills.passivity import EnergyAccount, Passive, PassivityLaw
from comanip.teaching import PHANTOM, teach
from haptics import Scripted, both_hold, ripple

DT = 0.001
UNBOUNDED = PassivityLaw(alpha_max_ns_per_m=1e12, rest_m_per_s=1e-6, credit_j=0.002)
MOVING = st.floats(1e-4, 1.0) | st.floats(-1.0, -1e-4)


class Handle(Scripted):
    """Says its velocity of the coming period, so that alpha is exact."""

    def __init__(self, velocities):
        self.velocities = velocities
        super().__init__(lambda t: self.velocities[min(round(t / DT), len(self.velocities) - 1)])

    def write(self, force, duration, power=0.0):
        self.forces.append(force.copy())
        self.channels["device.position"][0][:] += duration * self.velocity(self.time)
        self.time += duration


def rendered(forces, velocities, powers=None, law=UNBOUNDED):
    """Forces (T,) on the handle and the observer's energy (T,) for what the coupling asks; the weight is zero."""
    handle = Handle(velocities)
    passive = Passive(handle, law)
    passive.reset()
    passive._rendered = np.zeros(1)  # the first force is no weight
    energy = []
    for force, power in zip(forces, powers if powers is not None else np.zeros(len(forces)), strict=True):
        passive.write(np.array([force]), DT, power)
        energy.append(passive.channels["passivity.energy"][0][0])
    return np.array(handle.forces)[:, 0], np.array(energy)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.floats(-8.0, 8.0), MOVING, st.floats(-2.0, 2.0)), min_size=1, max_size=80))
def test_energy_never_falls_below_zero_by_more_than_one_period(ticks):
    force, velocity, power = np.array(ticks).T
    out, energy = rendered(force, velocity, power)
    paid = np.cumsum(DT * (power - out * velocity))  # by the object and the hand; nothing forgotten
    one_period = DT * np.abs(force * velocity - power).max()
    assert paid.min() >= -UNBOUNDED.credit_j - one_period - 1e-12
    assert energy.min() >= -one_period - 1e-12
    assert energy.max() <= UNBOUNDED.credit_j


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 8.0), st.floats(1e-3, 1.0)), min_size=1, max_size=60))
def test_a_force_that_only_resists_is_rendered_as_it_is(ticks):
    force, velocity = np.array(ticks).T
    out, _ = rendered(-force, velocity)
    assert out == pytest.approx(-force, abs=0.0)


def test_a_leading_partner_may_pull_the_teacher_along_and_delay_may_not():
    force, velocity = np.full(300, 2.0), np.full(300, 0.2)
    led, _ = rendered(force, velocity, force * velocity)
    assert led == pytest.approx(force)
    made_of_nothing, _ = rendered(force, velocity)
    given = 2.0 * 0.2 * DT
    assert made_of_nothing[: int(UNBOUNDED.credit_j / given)] == pytest.approx(2.0)  # on credit
    assert np.abs(made_of_nothing[int(UNBOUNDED.credit_j / given) + 2 :]).max() < 1e-9


def test_alpha_is_bounded_what_is_not_paid_stays_and_rest_is_left_alone():
    account = EnergyAccount(PassivityLaw(alpha_max_ns_per_m=20.0, rest_m_per_s=0.01, credit_j=0.001))
    account.book(-1.0)
    assert account.damping(0.1, DT) == 20.0
    assert account.energy == 0.001 - 1.0
    assert account.damping(0.005, DT) == 0.0
    account.book(5.0)
    assert account.energy == 0.001  # more is forgotten
    assert account.damping(0.1, DT) == 0.0


def test_the_weight_is_no_energy():
    """A rendered weight that is carried down pushes along the motion, and is no fault."""
    handle = Handle(np.full(200, -0.2))
    passive = Passive(handle)
    passive.reset()
    for _ in range(200):
        passive.write(np.array([-1.5]), DT)
    assert np.array(handle.forces) == pytest.approx(-1.5)


@pytest.mark.parametrize(("gain", "delay_s", "grip"), [(0.4, 0.05, "normal"), (0.4, 0.2, "normal"), (0.25, 0.02, "light")])
def test_settings_that_shake_without_it_are_still_with_it(gain, delay_s, grip):
    assert ripple(both_hold(gain, delay_s, grip)) > 0.05
    assert ripple(both_hold(gain, delay_s, grip, passive=True)) < 0.01


def test_an_honest_lesson_over_delay_costs_no_more_force_with_it():
    """Delay borrows energy while the lift begins; the credit covers it."""
    plain, passive = (
        teach("follower", 1, rng=np.random.default_rng(5), coupling=replace(PHANTOM, network=Network(0.01, 0.01), passivity=p))[0]
        for p in (False, True)
    )
    size = [np.sqrt((x["hand.true_force"].values ** 2).mean()) for x in (plain, passive)]
    assert size[1] == pytest.approx(size[0], rel=0.05)
    assert passive["passivity.energy"].values.min() > 0.0


def test_a_device_without_position_and_impossible_numbers_are_named():
    device = Scripted(lambda t: 0.0)
    device.channels = {}
    with pytest.raises(ParameterError, match=r"needs the channel device\.position; the device has: none"):
        Passive(device)
    with pytest.raises(ParameterError, match="alpha_max_ns_per_m > 0"):
        PassivityLaw(alpha_max_ns_per_m=0.0)
