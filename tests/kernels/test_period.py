"""The compiled period of beam and person says bit by bit what the readable twin says, and takes only whom it knows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.interfaces import Command, Observation
from comanip.people.intent import Course, Curve, Legs, Plan, Unsteadiness, Yielding
from comanip.people.misbehaving import Blocks
from comanip.people.partners import Arm, HumanFollower, HumanLeader, HumanSharing
from comanip.plants.beam import Beam, BeamPlant, WristSensor
from toys import same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
AXES = (("z",), ("x",), ("z", "x"), ("y", "z", "x"))  # x lies along the beam
STEPS = ((0.01, 0.001), (0.004, 0.0007), (0.001, 0.001))  # control period and sub-step [s]
KINDS = ("leader", "leader in legs", "leader on a course", "follower", "follower on all axes", "sharing", "sharing a course")


def person(kind, rng, axes, substep_s=0.001):
    about = {"axes": axes, "moving": axes[0], "substep_s": substep_s, "rng": rng}
    arm = Arm(
        rng.uniform(60.0, 600.0), rng.uniform(5.0, 40.0), rng.uniform(5.0, 12.0), Unsteadiness(tremor_n=rng.uniform(0.0, 0.1))
    )
    yielding = Yielding(rng.uniform(15.0, 60.0), rng.uniform(0.0, 1.0), delay_s=rng.uniform(0.0, 0.25))
    if "course" in kind:
        plan = winding(rng, len(axes))
        if kind == "sharing a course":
            return HumanSharing(plan, yielding, arm, **about)
        return HumanLeader(plan, arm, carried=rng.uniform(-9.0, 9.0, len(axes)), **about)
    if kind == "follower on all axes":
        return HumanFollower(yielding, arm, **{**about, "moving": axes})
    plan = Plan(rng.uniform(-0.3, 0.3), rng.uniform(0.3, 3.0), rng.uniform(0.0, 2.0), rng.uniform(0.0, 2.0))
    if kind == "follower":
        return HumanFollower(yielding, arm, **about)
    if kind == "sharing":
        return HumanSharing(plan, yielding, arm, **about)
    legs = Legs(((0.2, 0.7, 0.1), (0.8, 1.5, -0.25), (1.5, 0.4, 0.1)), 0.8)
    return HumanLeader(legs if kind == "leader in legs" else plan, arm, **about)


def winding(rng, d):
    """Overlapping legs in d axes, and a sampled curve added to them that begins and ends within the run."""
    legs = tuple((0.3 * n, rng.uniform(0.4, 1.5), tuple(rng.uniform(-0.2, 0.2, d))) for n in range(3))
    turned = np.sin(np.linspace(0.0, 7.0, 90))[:, None] * rng.uniform(-0.1, 0.1, d)
    return Course(legs, Curve.through(0.21, 0.007, turned), rng.uniform(0.0, 2.0))


def plant(kind, seed, axes, *, compiled, **about):
    rng = np.random.default_rng(seed)
    beam = Beam(rng.uniform(0.5, 4.0), rng.uniform(0.4, 1.2), actuator_lag_s=rng.uniform(0.005, 0.05))
    sensor = WristSensor(rng.uniform(0.0, 0.5), rng.uniform(-1.0, 1.0), rng.uniform(0.0, 0.02))
    made = BeamPlant(person(kind, rng, axes), beam=beam, sensor=sensor, axes=axes, start_position=rng.normal(size=len(axes)),
                     rng=rng, **about)  # fmt: skip
    if not compiled:
        made._as_numbers = lambda late: ((), rng)
        made.reset()
    else:
        made.reset()  # as often, for the twins draw alike
    assert (made._compiled is not None) == compiled
    return made


def course(one, n, lost_at=None):
    """What a plant shows (n, ...) while a hand answers force and goes its own way; at `lost_at` its command is not a number."""
    d = len(one.axes)
    obs, command, rows = Observation(d), Command(d), []
    for k in range(n):
        one.read(obs)
        command.velocity[:] = 0.02 * obs.sensor_force * np.sin(0.01 * k) + 0.2 * np.sin(0.02 * k + np.arange(d))
        if k == lost_at:
            command.velocity[-1] = np.nan
        one.write(command)
        one.advance()
        shown = [obs.position, obs.velocity, obs.sensor_force, *[values for values, _ in one.channels.values()]]
        rows.append(np.concatenate(shown, axis=None))
    return np.array(rows)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(KINDS), st.sampled_from(AXES), st.integers(0, 2**31), st.sampled_from(STEPS))
def test_bit_by_bit(kind, axes, seed, steps):
    about = dict(zip(("dt", "substep_s"), steps, strict=True))
    one, other = (plant(kind, seed, axes, compiled=c, **about) for c in (True, False))
    same(course(one, 350), course(other, 350))


def test_noise_of_three_blocks_is_drawn_as_the_twin_draws_it():
    one, other = (plant("sharing", 1, ("y", "z"), compiled=c) for c in (True, False))
    same(course(one, 650), course(other, 650))
    assert one._rng.standard_normal() == other._rng.standard_normal()


def test_what_is_not_a_number_is_the_same_for_both():
    one, other = (plant("sharing", 2, ("z", "x"), compiled=c) for c in (True, False))
    shown = course(one, 60, lost_at=20)
    same(shown, course(other, 60, lost_at=20))
    assert np.isnan(shown[-1]).any()
    assert one.stop_reason == other.stop_reason == "the plant's state is not finite"


def test_a_second_run_begins_as_the_first():
    one = plant("follower", 3, ("z",), compiled=True)
    course(one, 50)
    before = one._rng.bit_generator.state
    one.reset()
    first = course(one, 300)
    one._rng.bit_generator.state = before
    one.reset()
    same(course(one, 300), first)


class Stubborn(HumanLeader):
    def force(self, time, position, velocity, out):
        out[:] = 1.0


def own(one):
    one.force = lambda time, position, velocity, out: out.fill(1.0)
    return one


@pytest.mark.parametrize(
    "partner",
    [
        lambda rng: Stubborn(rng=rng),
        lambda rng: own(HumanLeader(rng=rng)),
        lambda rng: Blocks(HumanLeader(rng=rng), 0.5, carried=np.array([9.8])),
        lambda rng: HumanLeader(axes=("z", "x"), rng=rng),
    ],
    ids=["of another class", "with a force of his own", "who wraps another", "of other axes"],
)
def test_a_partner_who_is_not_known_by_numbers_is_asked(partner):
    rng = np.random.default_rng(0)
    assert BeamPlant(partner(rng), rng=rng)._compiled is None


def test_steps_finer_than_a_block_of_noise_are_left_to_the_twin():
    rng = np.random.default_rng(0)
    one = BeamPlant(HumanLeader(rng=rng), rng=rng, dt=0.1, substep_s=4e-5)
    assert one._compiled is None
    one.advance()
