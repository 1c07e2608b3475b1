"""Lessons, learning and carrying over the wire of a fake robot; losses, delays, a node that goes away; the pre-flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arms import commanding

from comanip.errors import ParameterError
from comanip.formats import read, write
from comanip.learned.skill import learn
from comanip.lessons.demonstration import demonstrations
from comanip.loop import SimulatedClock
from comanip.robots import driving, preflight
from comanip.robots.guard import limits_of
from comanip.robots.over import maker, robot_of
from comanip.robots.people import plant_of
from comanip.robots.robot import simulated
from comanip.robots.settings import load
from comanip.robots.turns import Turn
from comanip.teaching import teach
from comanip.trials.cases import draw_case
from comanip.trials.judging import judge

FAKE = load("fake")
HOLD = 2.0


def case_of(role, seed):
    return draw_case(role, np.random.default_rng(seed)).starting([0.85])


def flown(robot, skill, *, share=1.0, seconds=0.5, shadow=False):
    guard = driving.guarded(robot, {skill.role: skill}, skill.role, share=share, shadow=shadow)
    lines, payload, heard = driving.fly(robot, guard, {skill.role: skill}, seconds=seconds)
    return guard, lines, payload, heard


def carried(robot, skill, duration_s, **about):
    guard, lines, payload, heard = flown(robot, skill, share=about.pop("share", 1.0), shadow=about.get("shadow", False))
    assert all(one.passed for one in lines), lines
    return guard, driving.drive(robot, guard, payload, duration_s=duration_s, wrench_hz=heard, **about)


@pytest.mark.parametrize("kind", ["twist", "pose", "wrench"])
@pytest.mark.parametrize("seed", [3, 4])
def test_a_lift_over_the_wire_succeeds_whatever_the_arm_takes(skills, kind, seed):
    settings = replace(FAKE, command=commanding(kind, leash_m=0.05, damping_ns_per_m=400.0, force_max_n=100.0))
    case = case_of("follower", seed)
    guard, run = carried(robot_of(settings, case), skills["follower"], case.run_s)
    verdict = judge(case, run, start_m=case.start_m, taught_ends_m=skills["follower"].ends)
    assert verdict.success, (verdict.failures, guard.notice)


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_lessons_recorded_over_the_wire_are_learned_and_carried_over_it(role, tmp_path):
    lessons = teach(role, 3, rng=np.random.default_rng(12), plant=maker(FAKE))
    files = [tmp_path / f"{n}.mcap" for n in range(3)]
    for lesson, file in zip(lessons, files, strict=True):
        assert "incomplete" not in lesson.metadata
        write(lesson, file)
    skill = learn(demonstrations([read(file)[0] for file in files], rate_hz=100.0), role=role)
    case = case_of(role, 21)
    _, run = carried(robot_of(FAKE, case), skill, case.run_s)
    assert judge(case, run, start_m=case.start_m, taught_ends_m=skill.ends).success


def test_the_same_door_leads_to_a_simulated_robot(skills):
    case = case_of("follower", 3)
    _, run = carried(simulated(load("beam"), case), skills["follower"], case.run_s)
    assert judge(case, run, start_m=case.start_m, taught_ends_m=skills["follower"].ends).success


def silent_between(robot, begin_s, end_s, elsewhere=0.0):
    """The node says and does nothing for a while; then it is back, perhaps elsewhere, its clock begun anew."""
    node, clock, tick = robot.plant._node, robot.plant._clock, robot.plant._node.tick
    began = []

    def sometimes():
        if node.plant is not node._resting and not began:
            began.append(clock.seconds)
        since = clock.seconds - began[0] if began else -1.0
        if begin_s <= since < end_s:
            node._heard = None
            return
        if since >= end_s and len(began) == 1:
            began.append(since)
            node._stamp = lambda: round((clock.seconds - 900.0) * 1e9)
            node._velocity[:] = 0.0
            for axis in node.plant._state:
                axis.position += elsewhere
            node.plant.read(node._obs)
        tick()

    node.tick = sometimes


@pytest.mark.parametrize("kind", ["twist", "pose"])
@pytest.mark.parametrize("elsewhere", [0.0, 0.08])
def test_a_node_that_restarts_means_hold_with_the_reason_and_no_jump_after(skills, kind, elsewhere):
    settings = replace(FAKE, command=commanding(kind, leash_m=0.05))
    case = replace(case_of("follower", 3), onset_s=1.0)
    robot = robot_of(settings, case)
    robot.plant._node.plant = robot.plant._node._resting
    silent_between(robot, 1.8, 2.6)  # by then the hand moves
    sent = []
    send = robot.plant.arm.send

    def told(velocity, target, *rest):
        sent.append((velocity[2], target[2], robot.plant._sensed.position[2]))
        send(velocity, target, *rest)

    robot.plant.arm.send = told
    _, run = carried(robot, skills["follower"], 6.0)
    mode, speed = run["skill.mode"].values[:, 0], run["command.velocity"].values[:, 0]
    first = int(np.argmax(mode == HOLD))
    assert 1.8 < run["hand.position"].time[first] < 1.95
    assert speed[:first].max() > 0.05
    assert (mode[first:] == HOLD).all()
    assert "ms old" in run.metadata["notice"]
    assert np.abs(speed[first + 10 :]).max() == 0.0
    assert np.abs(np.diff(speed)).max() <= settings.acceleration_m_per_s2 * robot.plant.dt + 1e-9
    back = sent[round(2.75 / robot.plant.dt) :]
    assert max(abs(target - hand) for _, target, hand in back) < 0.006


def test_what_is_late_or_lost_is_held_with_the_reason_or_carried(skills):
    """1 % lost and up to 20 ms late is carried; the messages of 70 ms lost is a HOLD."""
    case = case_of("follower", 4)
    for loss, right in ((0.01, False), (0.97, True)):
        robot, rng = robot_of(FAKE, case), np.random.default_rng(0)
        guard, _lines, payload, heard = flown(robot, skills["follower"])
        signal = robot.plant.arm.signals
        for one in signal.values():
            hear = one.hear
            one.hear = lambda m, hear=hear, rng=rng, loss=loss: None if rng.random() < loss else hear(m)
        wire = robot.plant.arm._wire
        for one in signal.values():
            wire._hears[one.topic.name] = [one.hear]
        run = driving.drive(robot, guard, payload, duration_s=case.run_s, wrench_hz=heard)
        held = bool((run["skill.mode"].values == HOLD).any())
        assert held == right
        assert not right or "old" in run.metadata["notice"] or "late" in run.metadata["notice"]


def test_a_user_rearms_when_nobody_pulls_and_it_goes_on_from_where_it_is(skills):
    case = replace(case_of("follower", 3), onset_s=1.0)
    robot = robot_of(FAKE, case)
    silent_between(robot, 1.8, 2.4)
    guard, _lines, payload, heard = flown(robot, skills["follower"])
    node, answers = robot.plant._node, []

    def tap(obs, command):
        if obs.time > 3.4 and guard.envelope.mode == "HOLD":
            guard.ask_rearm()
            answers.append(guard.answer)
        if obs.time > 4.0 and not hasattr(node.plant.partner, "_at"):  # the person gives up, and holds
            node.plant = plant_of("beam", case.starting(obs.position), node.plant.dt, at_rest=True)

    run = driving.drive(robot, guard, payload, duration_s=5.0, wrench_hz=heard, taps=[tap])
    mode = run["skill.mode"].values[:, 0]
    assert answers[1].startswith("pulled with")
    assert guard.rearmed == 1
    assert mode[-1] != HOLD
    assert np.abs(np.diff(run["command.velocity"].values, axis=0)).max() <= FAKE.acceleration_m_per_s2 * robot.plant.dt + 1e-9


def test_nothing_runs_again_on_samples_that_stand_still_and_the_reason_stays_in_sight(skills):
    case = replace(case_of("follower", 3), onset_s=1.0)
    robot = robot_of(FAKE, case)
    silent_between(robot, 1.8, 99.0)
    guard, _lines, payload, heard = flown(robot, skills["follower"])
    ticks, answers, notices = [], [], []

    def tap(obs, command):
        ticks.append(obs.time)
        if len(ticks) == 250:
            guard.ask_rearm()
        if len(ticks) == 252:
            answers.append(guard.answer)
            notices.append(guard.notice)

    driving.drive(robot, guard, payload, duration_s=3.0, wrench_hz=heard, taps=[tap])
    assert answers[0].startswith("no ")
    assert "s: cable, node?" in answers[0]
    assert 0.5 < float(answers[0].split()[3]) < 0.9  # silent from 1.8 s on, asked at 2.5 s
    assert guard.rearmed == 0
    assert notices[0].startswith("HOLD: ")
    assert notices[0].endswith(f"; not re-armed: {answers[0]}")


def test_a_slow_start_is_a_share_of_the_speed(skills):
    case = case_of("leader", 3)
    guard, run = carried(robot_of(FAKE, case), skills["leader"], 4.0, share=0.1)
    whole = limits_of(FAKE, ("z",), [skills["leader"]]).v_max_m_per_s
    assert guard.envelope.limits.v_max_m_per_s == pytest.approx(0.1 * whole)
    fastest = np.abs(run["command.velocity"].values).max()
    assert 0.0 < fastest <= 0.1 * whole + 1e-12


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, np.nan])
def test_a_share_of_the_speed_is_one(skills, share):
    with pytest.raises(ParameterError, match=r"\(--limit\) is .*; allowed: above 0, up to 1"):
        limits_of(FAKE, ("z",), [skills["leader"]], share=share)


def test_a_shadow_computes_and_records_and_commands_nothing(skills):
    robot = robot_of(FAKE, case_of("leader", 3))
    heard = []
    robot.plant.arm.send = lambda *sent: heard.append(sent)
    _, run = carried(robot, skills["leader"], 4.0, shadow=True)
    robot.plant.halt()
    assert not heard
    assert np.ptp(run["hand.position"].values) < 1e-3
    assert np.abs(run["command.velocity"].values).max() > 0.05
    assert not (run["skill.mode"].values == HOLD).any()


def test_asked_to_end_it_brakes_to_rest_first(skills):
    case = case_of("leader", 3)
    robot = robot_of(FAKE, case)
    guard, _lines, payload, heard = flown(robot, skills["leader"])

    def tap(obs, command):
        if abs(command.velocity[0]) > 0.05:
            guard.ask_stop()

    run = driving.drive(robot, guard, payload, duration_s=20.0, wrench_hz=heard, taps=[tap])
    speed = run["command.velocity"].values[:, 0]
    assert run.metadata["stop_reason"] == "interrupted"
    assert speed.max() > 0.05
    assert speed[-1] == 0.0
    assert np.abs(np.diff(speed)).max() <= FAKE.acceleration_m_per_s2 * robot.plant.dt + 1e-9


# the pre-flight


def failed(found, skills, settings=FAKE, gravity=(-9.80665,), dt=0.01):
    lines, payload = preflight.checks(
        found, settings=settings, axes=("z",), gravity=np.array(gravity), dt=dt,
        limits=limits_of(settings, ("z",), [skills["follower"]]), learned=[skills["follower"]],
    )  # fmt: skip
    return [one.name for one in lines if not one.passed], payload


@pytest.fixture
def rested():
    """Ten seconds of a hand at rest with half of 2 kg, 0.3 N of bias included in what is felt."""
    rng, n = np.random.default_rng(0), 1000
    time = 0.01 * np.arange(n)
    return preflight.Measured(
        time, np.full(n, np.nan), np.full((n, 1), 0.85), rng.normal(0, 1e-3, (n, 1)), rng.normal(-9.8, 0.2, (n, 1)),
        np.zeros(n), {},
    )  # fmt: skip


def test_a_hand_at_rest_passes_and_the_object_is_weighed(rested, skills):
    names, payload = failed(rested, skills)
    assert names == []
    assert payload.mass_kg == pytest.approx(9.8 / 0.5 / 9.80665, abs=0.01)
    names, payload = failed(rested, skills, replace(FAKE, mass_kg=1.8))
    assert names == []
    assert payload.mass_kg == 1.8
    assert payload.force_bias_n[0] == pytest.approx(-9.8 + 0.9 * 9.80665, abs=0.05)


@pytest.mark.parametrize(
    ("spoil", "name"),
    [
        (lambda m: {"position": np.where(np.arange(1000)[:, None] % 5, m.position, np.nan)}, "samples"),
        (lambda m: {"force": np.full((1000, 1), np.nan)}, "samples"),
        (lambda m: {"time": 0.07 * np.floor(m.time / 0.07)}, "pose rate"),
        (lambda m: {"force_time": 0.07 * np.floor(m.time / 0.07)}, "wrench rate"),
        (lambda m: {"rates": {"pose": (500.0, 0.2)}}, "pose rate"),
        (lambda m: {"late": np.where(np.arange(1000) == 7, 0.05, 0.0)}, "lateness"),
        (lambda m: {"late": np.full(1000, 0.012)}, "lateness"),
        (lambda m: {"velocity": m.velocity + 0.03}, "at rest"),
        (lambda m: {"position": m.position + 0.01 * m.time[:, None]}, "at rest"),
        (lambda m: {"force": np.full((1000, 1), -9.8)}, "sensor"),
        (lambda m: {"force": m.force + 0.4 * m.time[:, None]}, "steady"),
        (lambda m: {"force": -m.force}, "payload"),
        (lambda m: {"position": m.position + 2.0}, "walls"),
    ],
)
def test_each_fault_is_found_by_the_check_of_its_name(rested, skills, spoil, name):
    names, _ = failed(replace(rested, **spoil(rested)), skills)
    assert name in names


def test_a_sensor_slower_than_the_ticks_is_not_missing(rested, skills):
    """It speaks in each third tick alone; a pose that does is a fault."""
    seldom = np.arange(1000)[:, None] % 3 == 0
    names, payload = failed(replace(rested, force=np.where(seldom, rested.force, np.nan)), skills)
    assert names == []
    assert payload.mass_kg == pytest.approx(9.8 / 0.5 / 9.80665, abs=0.02)
    assert failed(replace(rested, position=np.where(seldom, rested.position, np.nan)), skills)[0] == ["samples"]


def test_another_object_and_a_pull_across_gravity_are_found(rested, skills):
    assert failed(rested, skills, replace(FAKE, mass_kg=3.5))[0] == ["payload"]
    wide = replace(
        rested, position=np.hstack([rested.position] * 2), velocity=np.hstack([rested.velocity] * 2),
        force=np.hstack([rested.force, rested.force + 9.8 + 5.0]),
    )  # fmt: skip
    _, lines = preflight.weigh(wide, FAKE, np.array([-9.80665, 0.0]))
    assert [one.name for one in lines if not one.passed] == ["tare"]
    _, lines = preflight.weigh(wide, FAKE, np.array([0.0, 0.0]))  # no weight along these axes: all of it is bias
    assert [one.name for one in lines if not one.passed] == ["tare"]


def test_a_preflight_never_commands(skills):
    robot = robot_of(FAKE, case_of("follower", 3))
    heard = []
    robot.plant.arm.send = lambda *sent: heard.append(sent)
    preflight.measured(robot.at_rest, 0.5, SimulatedClock())
    assert not heard


def test_what_failed_first_is_the_error_and_the_others_are_counted():
    lines = [preflight.Check("a", True, "fine"), preflight.Check("b", False, "bad"), preflight.Check("c", False, "worse")]
    with pytest.raises(ParameterError, match=r"^robot.toml: pre-flight: b: bad \(and 1 more\)$"):
        preflight.require(lines, "robot.toml")


def test_an_envelope_that_leaves_no_speed_is_found(rested, skills):
    """3 J at 60 N are 5 cm; periods of 0.2 s at 10 m/s^2 cannot be braked in them, and the hand would stand for ever."""
    assert failed(rested, skills, replace(FAKE, late_s=0.2))[0] == ["envelope"]
    assert failed(rested, skills, replace(FAKE, late_s=0.1))[0] == []


def test_walls_that_leave_nothing_of_the_lessons_are_refused(skills):
    settings = replace(FAKE, walls_m={"z": (2.0, 3.0)})
    with pytest.raises(ParameterError, match=r"limits.walls.z is 2 to 3 m, and the lessons went"):
        limits_of(settings, ("z",), [skills["follower"]])


def test_a_sensor_whose_frame_is_said_wrongly_weighs_another_object(skills):
    """The fake's sensor turns with the hand; who says that it does not is told before anything moves."""
    robot = robot_of(FAKE, case_of("follower", 3))
    robot.plant.arm._settings = replace(FAKE, turns={"ft_sensor": Turn()}, mass_kg=2.0)
    object.__setattr__(robot, "settings", replace(robot.settings, mass_kg=2.0))
    _, lines, _, _ = flown(robot, skills["follower"])
    assert [one.name for one in lines if not one.passed] == ["payload"]
