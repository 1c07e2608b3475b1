"""A tick of the whole default skill within its envelope: plain floats that agree with numpy, no growth, no collection."""

from __future__ import annotations

import gc
import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.interfaces import Command, Observation
from comanip.loop import run
from comanip.people.partners import HumanFollower
from comanip.plants.beam import BeamPlant
from comanip.reproduction import make_skill
from comanip.skills.collaborate import CollaborativeLaw, Compliance, Pace, command_velocity
from comanip.skills.reference import PhaseReference

DT = 0.01


def reference(rng, d, n=60):
    s = np.linspace(0.0, 1.0, n)[:, None]
    shape = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    return PhaseReference(shape * rng.uniform(0.1, 0.4, d), np.sin(np.pi * s) * rng.normal(size=d), 0.02)


def comply(law, c, filters, shakes, excess, reference, feedforward):
    """The compliance with numpy, as the module's docstring writes it."""
    keep = 1.0 - np.exp(-2.0 * np.pi * np.array([law.shake_hz, law.shake_hz, law.grip_hz]) * DT)
    slow = filters[0] + keep[0] * (excess - filters[0])
    quick = excess - slow
    slower, gripping = filters[1] + keep[1] * (quick - filters[1]), filters[2] + keep[2] * (quick - filters[2])
    (shake, went_on), (turn, turned) = shakes
    shake = shake + DT / 0.3 * (np.linalg.norm(quick - slower) - shake)
    turn = turn + DT / 0.3 * (np.linalg.norm(quick - gripping) - turn)
    amplitude, turns = max(1.57 * shake - law.shake_n, 0.0), max(1.57 * turn - law.grip_n, 0.0)
    went_on = went_on + DT * (law.shake_growth_per_s * amplitude - went_on / law.shake_memory_s)
    turned = turned + DT * (law.shake_growth_per_s * turns - turned / law.shake_memory_s)
    rest = 1.0 - min(max(np.linalg.norm(c), np.linalg.norm(reference)) / law.moving_speed_m_per_s, 1.0)
    damping = law.moving_damping_ns_per_m + rest**2 * (law.resting_damping_ns_per_m - law.moving_damping_ns_per_m)
    damping += law.shake_damping_ns_per_m_per_n * (amplitude + went_on)
    push = excess * max(1.0 - law.dead_zone_n * rest / np.linalg.norm(excess), 0.0)
    m = law.virtual_mass_kg + law.grip_mass_kg_per_n * (turns + turned)
    c = (c + DT / m * push + DT * feedforward) / (1.0 + DT / m * damping)
    return c, (slow, slower, gripping), ((shake, went_on), (turn, turned))


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31), st.sampled_from(["leader", "follower"]))
def test_the_compliance_is_what_numpy_says(d, seed, role):
    rng, law, one = np.random.default_rng(seed), CollaborativeLaw.for_role(role), Compliance(d, DT)
    c, filters, shakes = np.zeros(d), np.zeros((3, d)), ((0.0, 0.0), (0.0, 0.0))
    for _ in range(50):
        given_ = rng.normal(size=(3, d)) * [[rng.choice([0.1, 5.0, 40.0])], [0.1], [0.5]]
        one.step(law, *given_)
        c, filters, shakes = comply(law, c, filters, shakes, *given_)
        np.testing.assert_allclose(one.velocity, c, rtol=1e-10, atol=1e-14)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31))
def test_the_pace_and_the_command_are_what_numpy_says(d, seed):
    rng, law = np.random.default_rng(seed), CollaborativeLaw.for_role("leader")
    ref = reference(rng, d)
    pace, command, velocity = Pace(ref, law, DT), Command(d), np.zeros(d)
    pace.start(0.0, ref.position[0], waits_s=0.05, eases=False)
    for n in range(150):
        x, force, s = rng.normal(scale=0.1, size=d), rng.normal(scale=4.0, size=d), pace.phase
        pace.step(x, force)
        assert (pace.phase > 0.0) == (n >= 5)
        target = ref.at(ref.position, s)
        v = ref.at(ref.velocity, s) if n >= 5 and s < ref.duration_s else np.zeros(d)
        f = ref.at(ref.force, s) if n >= 5 else np.zeros(d)
        pull = law.attraction_per_s * (target - x)
        pull *= min(1.0, np.linalg.norm(ref.velocity, axis=1).max() / max(np.linalg.norm(pull), 1e-12))
        np.testing.assert_allclose(pace.velocity, pace.rate * v + pull, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(pace.expected, pace.rate * f, rtol=1e-10, atol=1e-13)
        before = velocity.copy()
        command_velocity(law, DT, x, pace.velocity, velocity, command)
        change = pace.velocity - before
        change *= min(law.max_acceleration_m_per_s2 * DT / max(np.linalg.norm(change), 1e-12), 1.0)
        np.testing.assert_allclose(velocity, before + change, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(command.velocity, velocity + law.lead_s / DT * change, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(command.position, x + DT * velocity, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(command.acceleration, change / DT, rtol=1e-10, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31))
def test_the_closest_phase_and_rows_in_floats_are_those_of_the_tables(d, seed):
    rng = np.random.default_rng(seed)
    ref = reference(rng, d)
    x, near = rng.normal(scale=0.2, size=d), rng.uniform(0.2, 1.0)
    s = ref.closest(x, near)
    around = np.arange(len(ref.position)) * ref.step_s
    reached = ref.position[np.abs(around - near) <= 0.12]
    assert np.linalg.norm(ref.at(ref.position, s) - x) <= np.linalg.norm(reached - x, axis=1).min() + 1e-12
    for name in ("position", "velocity", "force"):
        np.testing.assert_allclose(ref.floats_at(name, near), ref.at(getattr(ref, name), near), rtol=1e-12, atol=1e-15)


def ticks(skill, start, n, held, *, collect=False):
    """n ticks of somebody who leads up and down; how much more `held()` says after them than before."""
    obs, command = Observation(1), Command(1)
    obs.position[:] = start
    obs.force[:] = obs.velocity[:] = obs.sensor_force[:] = 0.0
    skill.reset(obs)
    force = 3.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 600)) + 0.05 * np.random.default_rng(0).normal(size=600)
    before, warm = 0, 1000
    if not collect:
        gc.disable()
    try:
        for i in range(warm + n):
            if i == warm:
                before = held()
            obs.time = i * DT
            obs.force[0] = force[i % 600]
            obs.sensor_force[0] = -obs.force[0]
            skill.step(obs, command)
            obs.position[0], obs.velocity[0] = command.position[0], command.velocity[0]
        return held() - before
    finally:
        gc.enable()


def whole(skills, role):
    learned = skills[role]
    return make_skill(learned, axes=learned.axes, dt=DT, role=role, envelope=True), learned.workspace.mean(axis=1)


@pytest.mark.parametrize(("role", "n"), [("follower", 100_000), ("leader", 100_000)])
def test_a_hundred_thousand_ticks_hold_no_more_memory(skills, role, n):
    """Blocks that Python's allocator has handed out; one kept a tick would be n."""
    skill, start = whole(skills, role)
    assert ticks(skill, start, n, sys.getallocatedblocks) < 300
    assert skill.mode != "HOLD", skill.reason


def test_traced_memory_is_flat(skills):
    """The same with tracemalloc, which sees numpy too, and slows a tick twentyfold."""
    skill, start = whole(skills, "follower")
    n = 2_000 if kernels.native is None else 100_000
    tracemalloc.start()
    try:
        left = ticks(skill, start, n, lambda: tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert left < 10_000  # bytes; a float a tick would be 24 n


@pytest.mark.skipif(kernels.native is None, reason="the Python's lists come and go by the thousand")
def test_a_hundred_thousand_ticks_start_no_collection(skills):
    skill, start = whole(skills, "follower")
    assert ticks(skill, start, 100_000, lambda: sum(one["collections"] for one in gc.get_stats()), collect=True) == 0


def test_no_collection_inside_a_run(skills):
    inside, seen = [False], []

    def watch(phase, info):
        if inside[0]:
            seen.append(phase)

    def tap(obs, command):
        inside[0] = obs.time < 1.9  # from the first tick until shortly before the end
        [[] for _ in range(100)]  # a hundred containers a tick would start collections at once

    learned = skills["leader"]
    skill = make_skill(learned, axes=learned.axes, dt=DT, role="leader", envelope=True)
    plant = BeamPlant(HumanFollower(rng=np.random.default_rng(0)), start_position=np.array([0.85]), dt=DT,
                      rng=np.random.default_rng(0))  # fmt: skip
    before = gc.get_threshold()
    gc.callbacks.append(watch)
    gc.set_threshold(50)
    try:
        run(plant, skill, duration_s=2.0, taps=[tap])
    finally:
        gc.set_threshold(*before)
        gc.callbacks.remove(watch)
    assert not seen
