"""C24 to C30: releases, lying and slow sensors, pauses that end, forces along no axis; the envelope as made for a skill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.interaction import CausalInteractionForce, TaringInteractionForce
from comanip.interfaces import Observation
from comanip.loop import run
from comanip.people.misbehaving import LetsGo
from comanip.people.partners import HumanFollower, HumanLeader
from comanip.plants.beam import BeamPlant
from comanip.reproduction import make_skill
from comanip.safety.checker import Checker
from comanip.safety.limits import ISO_SLOW_M_PER_S, LED_N, Limits, as_taught, taught_speed, taught_walls
from envelopes import DT, ROOM, Bench

WEIGHT = 9.8  # [N] this hand's share
GRAVITY = [-9.80665]


class Senses:
    """A plant whose sensor says `reading(tick, F_s)`."""

    def __init__(self, plant, reading):
        self.plant, self.reading, self.tick = plant, reading, 0

    def __getattr__(self, name):
        return getattr(self.plant, name)

    def read(self, obs):
        self.plant.read(obs)
        obs.sensor_force[:] = self.reading(self.tick, obs.sensor_force)
        self.tick += 1


def lifts(learned, role, *, seed=0, reading=lambda tick, f: f, within=None, at=2.2, dt=DT, seconds=7.0):
    rng = np.random.default_rng(seed)
    person = (HumanLeader if role == "follower" else HumanFollower)(rng=rng)
    person = person if within is None else LetsGo(person, at, within)
    plant = Senses(BeamPlant(person, start_position=np.array([0.85]), dt=dt, rng=rng), reading)
    skill, said = make_skill(learned, axes=("z",), dt=dt), []
    taps = [lambda obs, command: said.append(skill.notice)]
    ran = run(plant, skill, duration_s=seconds, estimator=TaringInteractionForce(dt, gravity=GRAVITY), taps=taps)
    return skill, ran, {notice for notice in said if notice}


@pytest.mark.parametrize("role", ["leader", "follower"])
@pytest.mark.parametrize("within", [0.01, 0.15, 0.4, 1.0])
@pytest.mark.parametrize("at", [0.4, 2.2, 4.5])
def test_C24_who_lets_go_however_slowly_is_noticed_before_the_hand_has_sunk_10_cm(skills, role, within, at):
    for seed in range(2):
        skill, ran, _ = lifts(skills[role], role, seed=seed, within=within, at=at, seconds=at + within + 2.0)
        x = ran["hand.position"].values[round(at / DT) :, 0]
        assert x[0] - x.min() < 0.10
        assert skill.mode in ("HOLD", "COMPLY")
        assert skill.reason


@pytest.mark.parametrize("role", ["leader", "follower"])
@pytest.mark.parametrize(
    "lie",
    [
        lambda f, rng: 0.2 * rng.standard_normal(1),
        lambda f, rng: -5.0 + 0.2 * rng.standard_normal(1),
        lambda f, rng: 0.0 * f,
        lambda f, rng: -f,
        lambda f, rng: 2.0 * f,
        lambda f, rng: f + 10.0,
        lambda f, rng: f - 10.0,
        lambda f, rng: f - 49.0,
    ],
)
@pytest.mark.parametrize("from_tick", [35, 220])
def test_C25_C27_a_force_that_lies_moves_the_hand_no_farther_and_no_faster_than_taught(skills, role, lie, from_tick):
    rng = np.random.default_rng(5)
    limits = as_taught([skills[role]])
    _, ran, said = lifts(skills[role], role, reading=lambda n, f: lie(f, rng) if n >= from_tick else f)
    x, (low, high) = ran["hand.position"].values[:, 0], limits.workspace_m[0]
    assert low - 0.01 < x.min()
    assert x.max() < high + 0.01
    assert np.abs(ran["command.velocity"].values).max() <= limits.v_max_m_per_s + 1e-12
    assert said or x.max() - x[0] < 0.4  # a person who holds his place is not carried away by a few newtons


def test_C25_a_constant_error_walks_a_follower_to_the_wall_and_there_it_is_said(skills):
    bench = Bench(as_taught([skills["follower"]], yields=True), start=0.85)
    bench.envelope.skill.trick = lambda command: command.velocity.fill(0.1)
    for _ in range(1500):
        bench.tick(force=1.0)
    (low, high), *_ = taught_walls(skills["follower"])
    assert high - 0.01 < bench.hand[0] <= high
    assert f"at the edge of the workspace: x {bench.hand[0]:.2f} m of {low:.2f} to {high:.2f} m" in bench.envelope.notice


def test_walls_and_speed_are_those_of_the_lessons_unless_stated(skills):
    learned = skills["leader"]
    limits = as_taught([learned], yields=True)
    (low, high), taught = limits.workspace_m[0], learned.workspace[0]
    assert (low, high) == (pytest.approx(taught[0] - 0.05), pytest.approx(taught[1] + 0.05))
    assert limits.v_max_m_per_s == pytest.approx(min(1.6 * taught_speed(learned), 0.8))
    assert limits.pushed_n == LED_N
    slow = make_skill(learned, axes=("z",), dt=DT, envelope=Limits(v_max_m_per_s=ISO_SLOW_M_PER_S))
    assert slow.limits == replace(Limits(v_max_m_per_s=0.25), workspace_m=limits.workspace_m)
    free = Limits(workspace_m=((-np.inf, np.inf),))
    assert make_skill(learned, axes=("z",), dt=DT, envelope=free).limits is free


@pytest.mark.parametrize("missing", ["held", "NaN"])
@pytest.mark.parametrize(("dt", "every"), [(0.01, 2), (0.002, 4), (0.002, 10)])
def test_C26_a_sensor_slower_than_the_ticks_stops_nothing(skills, missing, dt, every):
    last = [None]

    def reading(tick, f):
        if tick % every == 0:
            last[0] = f.copy()
            return f
        return last[0] if missing == "held" else np.full(1, np.nan)

    _, ran, said = lifts(skills["follower"], "follower", reading=reading, dt=dt, seconds=6.0)
    assert said == set()
    assert ran["hand.position"].values[-1, 0] > 1.05


@pytest.mark.parametrize("step_n", [0.05, 0.5])
def test_C26_coarse_steps_stop_nothing(skills, step_n):
    _, ran, said = lifts(skills["follower"], "follower", reading=lambda n, f: np.round(f / step_n) * step_n, seconds=6.0)
    assert said == set()
    assert ran["hand.position"].values[-1, 0] > 1.05


def test_C26_a_sample_that_states_its_age_is_held_to_it():
    bench = Bench()
    bench.ticks(20, 0.1, 1.0)
    bench.obs.force_time = bench.time - 0.03
    bench.tick()
    assert bench.held == ""
    bench.obs.force_time = bench.time - 0.06
    bench.tick()
    assert bench.held == "force 70 ms old"


def test_C26_the_estimator_holds_a_slow_sample_until_the_next_is_due_and_no_longer():
    obs = Observation(1)
    obs.velocity[:] = 0.0
    estimate = CausalInteractionForce(DT, mass_kg=0.0, gravity=GRAVITY, sensor_period_s=0.04)
    felt = []
    for sample in (5.0, np.nan, np.nan, np.nan, 5.0, *[np.nan] * 8):
        obs.sensor_force[:] = sample
        estimate.step(obs)
        felt.append(bool(np.isfinite(obs.force[0])))
    assert felt == [True] * 11 + [False] * 2 or felt == [True] * 10 + [False] * 3  # 60 ms, to a rounding
    obs.sensor_force[:] = np.inf
    estimate.step(obs)
    assert np.isnan(obs.force[0])


def weighed(d=1, turn=None):
    bench = Bench(replace(ROOM, workspace_m=None), d=d, start=0.2)
    turn = np.eye(d)[0] if turn is None else turn
    for n in range(70):
        bench.tick(0.0, 0.0, sensor_force=-WEIGHT * turn + 1e-3 * np.sin(n * n))
    return bench, turn


def carries(bench, turn, force, n, wish=0.1):
    for k in range(n):
        bench.tick(wish * turn, force * turn, sensor_force=(force - WEIGHT) * turn + 1e-3 * np.sin(k * k))


def test_C29_a_hold_ends_by_itself_half_a_second_after_the_weight_is_back():
    bench, up = weighed()
    carries(bench, up, 0.0, 40)
    carries(bench, up, -WEIGHT, 70)
    assert bench.held == "let go: the hand carries the whole object"
    assert bench.envelope.passes
    carries(bench, up, 0.0, 45)
    assert bench.held
    before = len(bench.velocities)
    carries(bench, up, 0.0, 80)
    assert bench.envelope.mode == "RUN"
    assert np.abs(np.diff(np.ravel(bench.velocities[before:]))).max() < 0.01  # faded in
    assert bench.command.velocity[0] == pytest.approx(0.1)


def test_C29_where_it_was_blocked_it_tries_again_and_a_wall_that_is_still_there_makes_it_wait_longer():
    bench = Bench(replace(ROOM, workspace_m=None))
    wall, modes, peak = None, [], 0.0
    for n in range(900):
        wall = bench.hand[0] if n == 20 else wall
        force = 0.0 if wall is None else min(-3e3 * (bench.hand[0] - wall), 0.0)
        bench.tick(0.1, force)
        modes.append(bench.envelope.mode)
        peak = max(peak, -force) if n > 100 else peak
    tries = np.flatnonzero(np.diff([mode == "RUN" for mode in modes[100:]]) == 1)
    assert 3 <= len(tries) <= 10
    assert peak < 8.0
    bench.ticks(1000, 0.1, 0.0)
    assert bench.envelope.mode == "RUN"


def test_C28_rearming_is_refused_while_somebody_pulls_or_the_sensor_still_stands():
    bench = Bench()
    bench.ticks(30, 0.1, 1.0)
    bench.ticks(30, 0.1, 1.0, sensor_force=1.0)
    assert bench.held == "force stuck"
    assert bench.envelope.rearm(bench.obs) == "force stuck still: sensor?"
    bench.obs.sensor_force[:] = 1.01
    bench.obs.force[:] = 10.0
    assert bench.envelope.rearm(bench.obs) == "pulled with 10 N > 3 N: let the object rest, or tare"
    bench.obs.force[:] = 1.0
    assert bench.envelope.rearm(bench.obs) == ""


def story(turn):
    """One run of pulls, a block, a release and its end under axes turned by `turn` (2, 2); velocities and modes, turned back."""
    bench = Bench(replace(ROOM, workspace_m=None, blocked_n=12.0), d=2, start=0.0)
    up, rng, seen = np.array([0.0, 1.0]), np.random.default_rng(2), []
    pulls = ((0.0, 0.0), 60), ((2.0, 3.0), 30), ((-15.0, -15.0), 10), ((0.3, 0.0), 350), ((0.0, -WEIGHT), 90), ((0.0, 0.0), 120)
    forces = [force for force, ticks in pulls for _ in range(ticks)]
    for n, force in enumerate(forces):
        f = np.array(force) + 0.05 * rng.normal(size=2)
        wish = np.array([0.15, 0.2]) if n > 60 else np.zeros(2)
        bench.tick(turn @ wish, turn @ f, sensor_force=turn @ (f - WEIGHT * up))
        seen.append((turn.T @ bench.command.velocity, bench.envelope.mode, bench.envelope.reason))
    return seen


@pytest.mark.parametrize("angle", [0.3, 0.785398, 1.2, 2.5])
def test_C30_a_task_that_is_turned_gives_the_same_turned(angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    straight, turned = story(np.eye(2)), story(turn)
    assert [s[1:] for s in straight] == [s[1:] for s in turned]
    assert np.allclose([s[0] for s in straight], [s[0] for s in turned], atol=1e-9)
    assert {s[1] for s in straight} == {"RUN", "COMPLY", "HOLD"}


def test_C30_a_constant_pull_along_no_axis_is_a_tare_and_no_shaking():
    bench = Bench(Limits(), d=2)
    for n in range(400):
        bench.tick(0.0, 6.0 / np.sqrt(2.0) * np.array([1.0, -1.0]) * (1.0 + 1e-3 * (-1) ** n))
    assert bench.envelope.notice == "felt 6.0 N at rest: wrong mass? tare"


def test_I3_ticks_that_come_early_change_the_speed_by_no_more_than_their_time_allows():
    bench = Bench()
    for n in range(400):
        period = DT * (0.05 if n % 3 else 1.0)
        last = bench.command.velocity[0]
        bench.tick(0.7 if n < 200 else -0.7, 0.0, period=period)
        assert abs(bench.command.velocity[0] - last) <= 10.0 * period + 1e-9
        if bench.held:
            break


def test_the_age_of_a_sample_starts_again_with_each_new_one():
    bench = Bench()
    bench.ticks(10, 0.1, 1.0)
    for _ in range(6):
        bench.ticks(3, sample=False)
        bench.tick()
    assert bench.held == ""


def test_a_late_tick_is_booked_as_held_for_a_period_and_then_braked_and_never_earns():
    bench = Bench(replace(ROOM, energy_j=3.0))
    bench.ticks(10, 0.3, -5.0)
    x, tank = bench.envelope._x[0], bench.envelope.diagnostics["tank"][0]
    bench.tick(0.3, 50.0, period=0.1)
    way = 0.3 * DT + 0.3**2 / (2.0 * 10.0)
    assert bench.envelope._x[0] - x == pytest.approx(way)
    assert tank - bench.envelope.diagnostics["tank"][0] == pytest.approx(60.0 * way)


def test_what_shakes_a_complying_hand_moves_it_less():
    def swing(n_newtons):
        bench = Bench(replace(ROOM, workspace_m=None, pushed_n=50.0))
        bench.ticks(10, 0.1, 0.0)
        bench.ticks(10, 0.1, -25.0)
        assert bench.envelope.mode == "COMPLY"
        speeds = [abs(bench.tick(force=n_newtons * np.sin(2.0 * np.pi * 3.0 * n * DT))) for n in range(300)]
        return max(speeds[100:]) / n_newtons

    assert swing(30.0) < 0.6 * swing(5.0)


def test_the_checker_s_room_to_stop_is_half_of_what_the_speed_would_go():
    checker, out = Checker(0.8, 10.0, [(0.0, 1.0)], DT), [0.55]
    checker.start([1.0 - 0.5**2 / 20.0 - 0.55 * DT])
    checker.last = [0.55]
    assert checker.judge(DT, out, False) == "room to stop"
    checker, out = Checker(0.8, 10.0, [(0.0, 1.0)], DT), [0.55]
    checker.start([1.0 - 0.551**2 / 20.0 - 0.55 * DT])
    checker.last = [0.55]
    assert checker.judge(DT, out, False) == ""
