"""Invariants of the envelope, I1 to I8, for any input and against a partner who means harm."""

from __future__ import annotations

from math import ceil, isfinite

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.reproduction import make_skill
from comanip.safety.checker import Checker
from comanip.safety.limits import Limits
from comanip.trials import draw_case, run_case
from envelopes import DT, Bench

LIMITS = Limits(workspace_m=((0.0, 1.0),))
A, V, F, E0 = LIMITS.a_max_m_per_s2, LIMITS.v_max_m_per_s, LIMITS.force_limit_n, LIMITS.energy_j
NASTY = [np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1e9]
EXAMPLES = {"derandomize": True, "deadline": None, "max_examples": 120}

number = st.one_of(st.floats(-1.0, 1.0), st.floats(-100.0, 100.0), st.sampled_from(NASTY), st.floats())
usual = st.floats(-0.02, 0.02)  # what keeps a run going, so that faults come late too


def often(normal, strange):
    return st.one_of(normal, normal, normal, normal, normal, strange)


anything = st.lists(
    st.tuples(
        often(st.just(DT), number),  # step of the clock
        often(usual, number),  # measured position beside where the hand is
        often(st.floats(-40.0, 40.0), number),  # force
        often(st.floats(-1.0, 1.0), number),  # wish
        often(st.just(0.0), number),  # measured velocity
    ),
    min_size=1,
    max_size=40,
)


def watch(bench, before, last, period):
    """I1 to I5 after a tick; `period` is the longest that this tick may count."""
    command, envelope = bench.command, bench.envelope
    for array in (command.position, command.velocity, command.acceleration):
        assert np.isfinite(array).all()  # I1
    assert np.linalg.norm(command.velocity) <= V + 1e-12  # I2
    assert (np.abs(command.acceleration) <= A).all()
    assert np.linalg.norm(command.velocity - last) <= A * period + 1e-12  # I3
    for x, (low, high) in zip(envelope._x, envelope._walls, strict=True):
        assert low - 1e-9 <= x <= high + 1e-9  # I4
    tank = envelope.diagnostics["tank"]
    assert ((tank >= 0.0) & (tank <= envelope.limits.energy_j)).all()  # I5
    if before:
        assert envelope.mode == "HOLD"  # latched, with the first reason
        assert envelope.reason == before
        assert np.linalg.norm(command.velocity) <= np.linalg.norm(last) + 1e-12
    assert "checker" not in envelope.reason
    assert "envelope:" not in envelope.reason


def drive(sequence, d=1, limits=LIMITS):
    bench = Bench(limits, d=d)
    obs, outputs, in_hold, stamp = bench.obs, [], 0, 0.0
    for tick, (step, beside, force, wish, velocity) in enumerate(sequence):
        last, before = bench.command.velocity.copy(), bench.latched
        obs.time = obs.time + step
        with np.errstate(all="ignore"):
            obs.position[:] = np.array(bench.envelope._x) + last * DT + beside
        obs.force[:], obs.velocity[:], obs.sensor_force[:] = force, velocity, force
        bench.skill.velocity[:] = wish
        bench.envelope.step(obs, bench.command)
        counted = obs.time - stamp if isfinite(obs.time) else 0.0
        if isfinite(obs.time) and (tick == 0 or counted >= 0.1 * DT or counted < 0.0):
            stamp = obs.time
        watch(bench, before, last, max(counted, DT))
        if bench.latched:
            in_hold += 1
            if in_hold >= ceil(V / (A * DT)) + 1:
                assert (bench.command.velocity == 0.0).all()  # I7
        outputs.append(np.concatenate([bench.command.velocity, bench.command.position, bench.command.acceleration]))
    return np.array(outputs).tobytes()


@given(anything)
@settings(**EXAMPLES)
def test_C20_I1_to_I7_hold_for_any_input_and_it_replays_identically(sequence):
    assert drive(sequence) == drive(sequence)


@given(anything)
@settings(**{**EXAMPLES, "max_examples": 40})
def test_C20_I1_to_I7_hold_per_axis_in_three_axes(sequence):
    drive(sequence, 3, Limits(workspace_m=((0.0, 1.0), (0.2, 0.9), (-5.0, 0.6))))


honest = st.lists(
    st.tuples(
        st.sampled_from([0.2, 0.5, 1.0, 1.0, 2.0, 3.0]),  # periods until the next tick
        st.booleans(),  # the sample came
        st.sampled_from([-1.0, -1.0, 0.3, 1.0]),  # the partner's force, share of F_lim, along the motion
        st.sampled_from([-2.0, -0.5, 0.0, 0.5, 2.0, 2.0]),  # wish
    ),
    min_size=60,
    max_size=90,
)


@given(honest, st.sampled_from([0.05, 0.5, 0.93]), st.sampled_from([0.1, 0.5, 3.0]))
@settings(**{**EXAMPLES, "max_examples": 60})
def test_I4_I6_walls_and_budget_hold_in_truth_while_the_clock_is_honest(sequence, start, energy):
    """The hand itself, not the ledger; force up to F_lim, samples dropped, periods up to T."""
    limits = Limits(workspace_m=((0.0, 1.0),), energy_j=energy, blocked_n=59.9, blocked_s=0.2)
    bench, given, dropped = Bench(limits, start=start), 0.0, 0
    bench.tick(0.0, 0.0)
    for periods, came, share, wish in sequence:
        dropped = 0 if came else dropped + 1
        came, period = (came, periods * DT) if dropped == 0 else (False, DT)
        last, before = bench.command.velocity.copy(), bench.latched
        force = share * F * (np.sign(last) if last[0] else 1.0)
        bench.tick(wish, force, period=period, sample=came)
        given -= float(force[0] * last[0] if last[0] else 0.0) * period
        watch(bench, before, last, max(period, DT))
        assert 0.0 - 1e-9 <= bench.hand[0] <= 1.0 + 1e-9
        assert given <= energy + 1e-9


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize("energy", [0.05, 0.5, 3.0, 1e3])
@pytest.mark.parametrize("periods", [1.0, 2.0, 3.0])
def test_the_greedy_adversary_gets_no_more_than_walls_and_budget(towards, energy, periods):
    """Skill and partner conspire: full speed at the wall, full force against it, always the longest period."""
    limits = Limits(workspace_m=((0.0, 1.0),), energy_j=energy, blocked_n=61.0, late_s=0.03)  # 61 N: never said to be blocked
    bench, given = Bench(limits), 0.0
    assert bench.tick(0.0, 0.0) == 0.0
    for n in range(200):
        last = bench.command.velocity.copy()
        bench.tick(towards * 9.0, -F * towards, period=periods * DT)
        given += F * abs(float(last[0])) * periods * DT
        watch(bench, "", last, periods * DT)
        assert 0.0 <= bench.hand[0] <= 1.0
        assert given <= energy + 1e-9
        if n == 2 and energy > 1.0:
            assert abs(bench.command.velocity[0]) > min(0.75, 2.9 * A * DT)  # it does move
    wall = 0.5 + 0.5 * towards
    left = min(abs(wall - float(bench.hand[0])), (energy - given) / F)
    assert left <= A * limits.late_s**2 / 8 + V * 0.03  # and uses what there is


def test_the_person_refills_what_the_robot_may_give():
    bench = Bench(Limits(energy_j=2.0, blocked_n=60.0))
    bench.ticks(40, 0.2, -10.0)
    spent = 2.0 - bench.envelope.diagnostics["tank"][0]
    assert spent == pytest.approx(0.1 * 10.0 * 0.01 + 0.2 * 10.0 * 0.38)
    bench.ticks(20, 0.2, 10.0)
    assert 2.0 - bench.envelope.diagnostics["tank"][0] == pytest.approx(spent - 0.2 * 10.0 * 0.20)
    bench.ticks(60, 0.2, 10.0)
    assert bench.envelope.diagnostics["tank"][0] == 2.0


@given(
    st.lists(
        st.tuples(st.floats(-0.9, 0.9), st.floats(-14.0, 14.0)), min_size=1, max_size=60
    ),  # on two axes 20 N in all: not blocked
    st.sampled_from([1, 2]),
)
@settings(**EXAMPLES)
def test_I8_what_is_within_the_limits_passes_unchanged(sequence, d):
    bench, wish = Bench(Limits(energy_j=30.0), d=d), 0.0
    for share, force in sequence:
        wish = min(max(wish + share * A * DT / d**0.5, -0.5), 0.5)
        bench.tick(wish, force)
        assert bench.envelope.mode == "RUN"
        assert (bench.command.velocity == wish).all()
        assert (bench.command.position == bench.hand).all()
        assert (bench.command.acceleration == 0.0).all()


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_I8_the_default_law_with_living_partners_commands_the_same_with_and_without(skills, role):
    rng = np.random.default_rng(77)
    for _ in range(4):
        case = draw_case(role, rng)
        bare = run_case(case, make_skill(skills[role], axes=("z",), dt=DT))
        skill = make_skill(skills[role], axes=("z",), dt=DT, envelope=True)
        wrapped = run_case(case, skill)
        assert skill.notice == ""
        assert (wrapped["skill.mode"].values == 0.0).all()
        for name in ("command.velocity", "command.position", "command.acceleration", "hand.position"):
            assert np.abs(bare[name].values - wrapped[name].values).max() <= 1e-12


@given(
    st.lists(
        st.tuples(st.sampled_from(["tick", "tick", "tick", "hurt", "rearm", "change", "shape"]), number, number),
        min_size=1,
        max_size=40,
    )
)
@settings(**EXAMPLES)
def test_C21_in_any_order_of_calls_it_never_raises_nor_jumps(calls):
    bench = Bench(LIMITS)
    for call, a, b in calls:
        last, mode = bench.command.velocity.copy(), bench.envelope.mode
        if call == "tick":
            bench.tick(a, 1.0)
        elif call == "hurt":
            bench.tick(0.3, b, velocity=a)
        elif call == "rearm":
            refused = bench.envelope.rearm(bench.obs)
            if not refused:
                assert abs(last[0]) <= LIMITS.moving_m_per_s
                assert bench.envelope.mode == "RUN"
            else:
                assert bench.envelope.mode == mode
        elif call == "change":
            bench.envelope.change_skill(type(bench.skill)(), bench.obs)
        else:
            good, bench.obs.force = bench.obs.force, np.zeros(2)
            bench.time += DT
            bench.obs.time = bench.time
            bench.envelope.step(bench.obs, bench.command)
            bench.obs.force = good
        assert np.isfinite(bench.command.velocity).all()
        assert abs(bench.command.velocity[0] - last[0]) <= A * DT + LIMITS.moving_m_per_s + 1e-12
        assert "checker" not in bench.envelope.reason
        bench.envelope.notice  # noqa: B018


def test_whatever_breaks_inside_it_still_brakes():
    bench = Bench(LIMITS)
    bench.ticks(10, 0.3, 1.0)
    bench.obs.position = None
    speeds = []
    for _ in range(6):
        bench.envelope.step(bench.obs, bench.command)
        bench.obs.time += DT
        speeds.append(float(bench.command.velocity[0]))
    assert speeds == pytest.approx([0.3, 0.2, 0.1, 0.0, 0.0, 0.0]) or speeds[:3] == pytest.approx([0.2, 0.1, 0.0])
    assert bench.envelope.mode == "HOLD"


@pytest.mark.parametrize(
    ("velocity", "verdict", "instead"),
    [
        (0.05, "", 0.05),
        (float("nan"), "speed", 0.0),
        (0.9, "speed", 0.0),
        (0.2, "acceleration", 0.0),
        (-0.2, "acceleration", 0.0),
    ],
)
def test_the_checker_replaces_what_breaks_its_rules(velocity, verdict, instead):
    checker, out = Checker(0.8, A, [(0.0, 1.0)], DT), [velocity]
    checker.start([0.5])
    assert checker.judge(DT, out, False) == verdict
    assert out == [instead]


def test_the_checker_brakes_before_a_wall_that_the_envelope_overlooked():
    for towards, wall in ((1.0, 1.0), (-1.0, 0.0)):
        checker, at, v, seen = Checker(0.8, A, [(0.0, 1.0)], DT), 0.5, 0.0, set()
        checker.start([at])
        for _ in range(300):
            at += v * DT
            out = [towards * min(abs(v) + A * DT, 0.8)]
            seen.add(checker.judge(DT, out, False))
            v = out[0]
        assert seen == {"", "room to stop"}
        assert abs(at - wall) < 0.02


def test_the_envelope_obeys_its_checker():
    bench = Bench(LIMITS)
    bench.envelope._compiled = None  # the Python's clip is what breaks here
    bench.ticks(10, 0.3, 1.0)
    bench.envelope._clip = lambda period: [5.0]
    assert bench.tick() == pytest.approx(0.2)
    assert bench.held == "checker: speed"


@given(number, number)
@settings(**EXAMPLES)
def test_position_and_acceleration_of_a_command_are_bounded_too(position, acceleration):
    bench = Bench(LIMITS)

    def trick(command):
        command.velocity[:], command.position[:], command.acceleration[:] = 0.05, position, acceleration

    bench.skill.trick = trick
    for _ in range(5):
        last = bench.command.velocity.copy()
        bench.tick(force=1.0)
        watch(bench, "", last, DT)
        assert abs(bench.command.position[0] - bench.hand[0]) <= V * 0.03 + 1e-9
    assert bench.envelope.mode == ("RUN" if isfinite(position) and isfinite(acceleration) else "HOLD")


def test_the_commanded_position_stays_within_the_walls():
    bench = Bench(LIMITS, start=0.999)

    def trick(command):
        command.velocity[:], command.position[:] = 0.0, 1.01

    bench.skill.trick = trick
    bench.ticks(3)
    assert bench.command.position[0] == 1.0
