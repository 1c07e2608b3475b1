"""What the field uses: each law does what its formula says."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.skills.baselines import ActivePassive, Homotopy, MassDamper, MinimumJerkFollower, VariableDamping
from lifts import minimum_jerk

DT = 0.01


def seen(force=0.0, position=0.85, velocity=0.0, time=0.0):
    obs = Observation(1)
    obs.time, obs.position[:], obs.velocity[:], obs.force[:] = time, position, velocity, force
    return obs


def speeds(skill, forces):
    command = Command(1)
    skill.reset(seen())
    found = []
    for n, force in enumerate(forces):
        skill.step(seen(force, velocity=found[-1] if found else 0.0, time=n * DT), command)
        found.append(float(command.velocity[0]))
    return np.array(found)


@pytest.mark.parametrize(("mass", "damping"), [(6.0, 25.0), (2.0, 10.0), (0.0, 40.0)])
def test_a_mass_damper_comes_to_force_over_damping(mass, damping):
    v = speeds(MassDamper(n_axes=1, dt=DT, mass_kg=mass, damping_ns_per_m=damping), np.full(400, 5.0))
    assert v[-1] == pytest.approx(5.0 / damping, rel=1e-3)
    after = round(mass / damping / DT)  # one time constant
    assert v[after] == pytest.approx((1.0 - np.exp(-1.0)) * 5.0 / damping if mass else 5.0 / damping, rel=0.05)
    assert (np.diff(v) >= 0.0).all()


def test_a_missing_force_is_none():
    assert speeds(MassDamper(n_axes=1, dt=DT), [np.nan, np.inf, 0.0]).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("mass", "damping"), [(-1.0, 10.0), (2.0, 0.0), (2.0, np.nan)])
def test_a_mass_damper_that_cannot_be_is_refused(mass, damping):
    with pytest.raises(ParameterError, match="mass >= 0 and damping > 0"):
        MassDamper(n_axes=1, dt=DT, mass_kg=mass, damping_ns_per_m=damping)


def test_variable_damping_lies_between_its_bounds_and_reaches_both():
    """From speed and force of each tick the damping that was at work: D = (F dt - M dv) / (v dt)."""
    force = np.repeat([6.0, -6.0, 6.0], 150)
    v = np.concatenate(
        [[0.0], speeds(VariableDamping(n_axes=1, dt=DT, mass_kg=4.0, low_ns_per_m=10.0, high_ns_per_m=40.0), force)]
    )
    fast = np.abs(v[1:]) > 0.05
    damping = ((force * DT - 4.0 * np.diff(v)) / (v[1:] * DT))[fast]
    assert damping.min() >= 10.0 - 1e-9
    assert damping.max() <= 40.0 + 1e-9
    assert damping.min() < 11.0
    turned = np.flatnonzero(fast & (force < 0.0) & (v[1:] > 0.0))
    assert turned.size > 3
    assert np.diff(((force * DT - 4.0 * np.diff(v)) / (v[1:] * DT))[turned[:4]]).min() > 0.0  # rises against the motion


class Says:
    diagnostics, stop_reason, notice = {}, "", ""

    def __init__(self, velocity):
        self.velocity = velocity

    def reset(self, obs):
        pass

    def step(self, obs, command):
        command.velocity[:] = self.velocity


@pytest.mark.parametrize(("alpha", "expected"), [(1.0, 0.3), (0.0, -0.1), (0.5, 0.1), (0.25, 0.0)])
def test_homotopy_lies_on_the_line_between_leader_and_follower(alpha, expected):
    skill = Homotopy(Says(0.3), Says(-0.1), n_axes=1, dt=DT, alpha=alpha)
    assert speeds(skill, [0.0, 5.0]) == pytest.approx([expected] * 2)


@pytest.mark.parametrize("alpha", [-0.1, 1.1, np.nan])
def test_an_alpha_outside_of_0_to_1_is_refused(alpha):
    with pytest.raises(ParameterError, match="alpha must lie"):
        Homotopy(Says(0.0), Says(0.0), n_axes=1, dt=DT, alpha=alpha)


@pytest.mark.parametrize(("height", "duration"), [(0.2, 2.0), (0.3, 3.0), (-0.15, 2.4), (0.35, 1.6)])
def test_a_minimum_jerk_follower_finds_the_motion_from_its_beginning(height, duration):
    """With all its trust, no force and clean data, it moves by itself as the motion that it sees: T and A are right."""
    skill, command = MinimumJerkFollower(n_axes=1, dt=DT, trust=1.0), Command(1)
    skill.reset(seen())
    t = np.arange(0.0, 0.85 * duration, DT)
    x, v, _ = minimum_jerk(t, 0.0, duration, height)
    asked = []
    for now, place in zip(t, x, strict=True):
        skill.step(seen(position=0.85 + place, time=now), command)
        asked.append(float(command.velocity[0]))
    later = t > 0.6 * duration
    assert np.abs(np.array(asked) - v)[later].max() < 0.2 * np.abs(v).max()  # durations are 0.2 s apart


def test_a_minimum_jerk_follower_is_a_mass_damper_while_nothing_moves():
    plain = MassDamper(n_axes=1, dt=DT, mass_kg=6.0, damping_ns_per_m=25.0)
    assert speeds(MinimumJerkFollower(n_axes=1, dt=DT), np.full(50, 3.0)) == pytest.approx(speeds(plain, np.full(50, 3.0)))


def test_active_passive_leads_who_resists_and_follows_who_pulls(skills):
    clocks = {"passive": skills["leader"].clock, "active": skills["follower"].clock}
    skill, command = ActivePassive(Says(0.3), Says(-0.1), **clocks, axis="z", n_axes=1, dt=DT), Command(1)
    skill.reset(seen())
    passive = skill.diagnostics["role"]
    assert passive.tolist() == [0.1, 0.9, 0.0]

    def feels(force, velocity, ticks=200):
        for _ in range(ticks):
            skill.step(seen(force, velocity=velocity), command)
        assert passive[:2].sum() == pytest.approx(1.0)
        return float(passive[0])

    assert feels(-6.0, 0.15) > 0.9  # his force against the motion: he is taken along
    assert command.velocity[0] == pytest.approx(0.3)
    assert feels(6.0, 0.15) < 0.1
    assert command.velocity[0] == pytest.approx(-0.1)
    assert feels(0.0, 0.0, ticks=600) < 0.1  # nothing said, within his patience
    assert feels(0.0, 0.0, ticks=100) > 0.5  # and beyond
    skill.reset(seen())
    assert passive.tolist() == [0.1, 0.9, 0.0]
