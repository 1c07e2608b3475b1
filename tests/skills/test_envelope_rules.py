"""Each rule of the envelope by itself, with the number that it must give: what a change of one sign or one number would break."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, sqrt

import numpy as np
import pytest

from comanip.interfaces import Observation
from comanip.safety.checker import Checker
from comanip.safety.detectors import AGAIN, Jump, LetGo, Missing, Pushed, Shaking, Sinking, Stuck
from comanip.safety.limits import Limits
from envelopes import DT, ROOM, Bench, Dictated

WEIGHT, G = 9.8, 9.80665


# the checker


def checked(velocity, *, last=(0.0, 0.0), at=(0.5, 0.5), period=DT, late=False, walls=((0.0, 1.0), (0.0, 1.0))):
    checker, out = Checker(0.8, 10.0, walls, DT), list(velocity)
    checker.start(at)
    checker.last = list(last)
    return checker, checker.judge(period, out, late), out


def test_the_checker_lets_pass_what_is_just_allowed_and_remembers_it():
    checker, verdict, out = checked((0.06, 0.08))
    assert (verdict, out, checker.last, checker.at) == ("", [0.06, 0.08], [0.06, 0.08], [0.5, 0.5])
    assert checker.judge(0.02, [0.06, 0.08], False) == ""
    assert checker.at == pytest.approx([0.5012, 0.5016])  # where the last command led
    assert checked((0.48, 0.64), last=(0.48, 0.64))[1] == ""


def test_a_checker_that_was_not_told_where_the_arm_is_takes_it_to_rest_at_the_origin():
    def fresh():
        return Checker(0.8, 10.0, ((-0.002, 0.9),), DT)

    assert fresh().judge(DT, [0.09], False) == ""
    assert fresh().judge(DT, [0.11], False) == "acceleration"
    assert fresh().judge(0.03, [-0.19], False) == ""  # 1.8 mm to stop
    assert fresh().judge(0.03, [-0.21], False) == "room to stop"


@pytest.mark.parametrize("turn", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8), (-0.6, -0.8)])
def test_the_checker_s_speed_and_acceleration_are_of_vectors(turn):
    x, y = turn
    assert checked((0.801 * x, 0.801 * y), last=(0.79 * x, 0.79 * y))[1] == "speed"
    assert checked((nan, 0.0))[1] == "speed"
    assert checked((0.1001 * x, 0.1001 * y))[1] == "acceleration"
    assert checked((0.0999 * x, 0.0999 * y))[1] == ""
    assert checked((0.19 * x, 0.19 * y), period=0.02)[1] == ""  # of the period that passed
    _, verdict, out = checked((0.6 * x, 0.6 * y), last=(0.3 * x, 0.3 * y))
    assert verdict == "acceleration"
    assert out == pytest.approx([0.2 * x, 0.2 * y])  # the last one, slower by a T
    assert checked((0.6 * x, 0.6 * y), last=(0.05 * x, 0.05 * y))[2] == [0.0, 0.0]
    assert checked((0.6, 0.6))[2] == [0.0, 0.0]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_the_checker_leaves_room_to_stop_before_each_wall(axis, towards):
    def verdict(left, speed=0.5, last=0.5):
        velocity, at, before = [0.0, 0.0], [0.5, 0.5], [0.0, 0.0]
        velocity[axis], before[axis] = towards * speed, towards * last
        at[axis] = (1.0 if towards > 0.0 else 0.0) - towards * (left + last * DT)
        return checked(velocity, last=before, at=at)[1]

    stop = 0.5**2 / 20.0
    assert verdict(stop + 1e-6) == ""
    assert verdict(stop - 1e-6) == "room to stop"
    assert verdict(stop - 1e-6, speed=0.4) == ""  # who brakes as hard as can be passes
    assert verdict(-0.001, speed=-0.1, last=0.0) == ""  # so does who comes back


def test_the_checker_holds_a_late_command_for_dt_and_lets_it_brake():
    checker, _, _ = checked((0.0, 0.0), last=(0.3, 0.0), period=0.02, late=True)
    assert checker.at[0] == pytest.approx(0.5 + 0.3 * 0.01 + 0.3 * 0.01 - 5.0 * 0.01**2)
    checker, _, _ = checked((0.0, 0.0), last=(0.3, 0.0), period=1.0, late=True)
    assert checker.at[0] == pytest.approx(0.5 + 0.3 * 0.01 + 0.3**2 / 20.0)
    checker, _, _ = checked((0.0, 0.0), last=(0.3, 0.0), period=0.005, late=True)
    assert checker.at[0] == pytest.approx(0.5 + 0.3 * 0.01)
    checker, _, _ = checked((0.0, 0.0), last=(0.0, 0.0), period=0.02, late=True)
    assert checker.at == [0.5, 0.5]


# nobody at the other end, where nothing weighs along the axes


def missing(forces, *, speed=0.2, leads=1.0, bias=0.0, carried=0.0, noise=0.0, rest=40, at_rest=None, seed=0):
    """Ticks after which it is said that the partner is gone, of F [N], without a bias that is there from the start.

    carried   s m a [N] of each tick, which F has and F_s has not
    """
    watch = Missing(1, nobody_n=0.3, nobody_s=0.4, held_n=2.0, fast_m_per_s=0.08, moving_m_per_s=0.01, bias_n=1.5)
    rng, said = np.random.default_rng(seed), []
    for _ in range(rest):
        felt = bias + noise * rng.normal() + 1e-3
        assert not watch.step([felt], [felt if at_rest is None else at_rest], 0.0, 0.0, DT)
    forces = np.asarray(forces, dtype=float)
    for n, (force, own) in enumerate(zip(forces, np.broadcast_to(carried, forces.shape), strict=True)):
        felt = force + bias + noise * rng.normal()
        if watch.step([felt - own], [felt], speed, leads, DT):
            said.append(n)
            break
    return said[0] if said else None, watch


@pytest.mark.parametrize("bias", [0.0, 0.35, -1.0])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_hand_that_leads_knows_within_half_a_second_that_nobody_is_led_whatever_the_sensor_s_bias(bias, noise):
    held = [-4.0] * 30
    said, watch = missing(held + [0.0] * 60, bias=bias, noise=noise)
    assert 30 + 25 < said <= 30 + 45
    assert watch.zero[0] == pytest.approx(bias, abs=0.15)
    assert missing(held * 4, bias=bias, noise=noise)[0] is None
    assert missing([-1.2] * 200, bias=bias, noise=noise)[0] is None  # the softest arm's damping at 0.08 m/s


def test_a_hand_that_leads_takes_the_object_s_own_inertia_for_nobody():
    held = [-4.0] * 30
    inertia = -1.6 * np.sin(np.arange(90) * DT * 6.0)  # F = -(1 - s) m a, and s m a is as much
    assert missing([*held, *inertia], carried=[*[0.0] * 30, *-inertia])[0] is not None
    assert missing([*held, *inertia], carried=0.0)[0] is None


def test_who_leads_and_never_met_anybody_is_not_let_go_and_met_once_is_enough():
    assert missing([-1.9] * 20 + [0.0] * 100)[0] is None
    said, watch = missing([-2.1] * 20 + [0.0] * 100)
    assert said is not None
    watch.mistaken()
    assert not any(watch.step([0.0], [0.0], 0.2, 1.0, DT) for _ in range(100))  # somebody new has to be met
    watch.step([-4.0], [-4.0], 0.2, 1.0, DT)
    after = [n for n in range(200) if watch.step([0.0], [0.0], 0.2, 1.0, DT)]
    assert after[0] * DT == pytest.approx(0.25 * AGAIN[1], abs=0.06)


def test_met_before_a_rest_is_met_and_held_before_a_rest_is_not():
    for leads, found in ((1.0, True), (0.0, False)):
        watch = missing([-4.0] * 20, leads=leads)[1]
        for _ in range(5):
            watch.step([0.0], [1e-3], 0.005, leads, DT)
        assert any(watch.step([0.0], [0.1], 0.2, leads, DT) for _ in range(100)) == found


def test_a_hand_that_is_led_must_feel_next_to_nothing_for_longer():
    assert missing([4.0] * 30 + [0.0] * 60, leads=0.0)[0] == pytest.approx(70, abs=1)
    assert missing([4.0] * 30 + [0.35] * 100, leads=0.0)[0] is None  # gently led, or a bias
    assert missing([4.0] * 30 + [0.0] * 100, leads=0.5)[0] == pytest.approx(70, abs=1)  # half is not leading
    assert missing([4.0] * 30 + [0.0] * 100, leads=0.0, speed=0.07)[0] is None
    assert missing([-4.0] * 30 + [0.0] * 100, leads=1.0, speed=0.07)[0] is None


def test_a_pull_at_rest_is_no_bias_and_neither_is_a_force_that_is_not_known_yet():
    assert missing([], at_rest=6.0)[1].zero == [0.0]
    assert missing([], at_rest=0.0)[1].known == 0.0
    assert missing([], rest=80, bias=0.5)[1].known == 50.0
    watch = missing([], bias=0.5)[1]
    watch.step([nan], [3.0], 0.2, 1.0, DT)  # a reading that is missing says nothing of inertia
    assert watch.pull[0] == pytest.approx(DT / 0.06 * (3.0 - watch.zero[0]), abs=0.02)


class Leading(Dictated):
    """Says that it goes by itself."""

    def __init__(self, d=1):
        super().__init__(d)
        self.leading = np.ones(1)


def led(after, n=60):
    bench = Bench(replace(ROOM, workspace_m=None), skill=Leading(), start=0.0)
    bench.ticks(60, 0.0, 0.4)
    bench.ticks(5, 0.2, 0.4)  # in motion, where no jump is looked for
    bench.ticks(40, 0.2, -3.6)
    assert bench.envelope.mode == "RUN"
    bench.ticks(n, 0.2, after)
    return bench


def test_C11_a_hand_that_leads_stops_when_nobody_is_led_any_more_and_goes_on_with_who_answers():
    bench = led(0.4)
    assert bench.envelope.notice == "COMPLY: let go"
    x = bench.hand[0]
    bench.ticks(100, 0.2, 0.4)
    assert abs(bench.hand[0] - x) < 0.005
    assert bench.envelope.mode == "COMPLY"
    for n in range(8):  # as people pull: at once it would be a zero that jumped
        bench.tick(0.2, 0.4 - 0.25 * n)
    bench.ticks(14, 0.2, -1.6)
    assert bench.envelope.mode == "COMPLY"
    bench.ticks(25, 0.2, -1.6)
    assert bench.envelope.mode == "RUN"
    assert led(-0.8).envelope.mode == "RUN"


def test_C11_one_absurd_reading_does_not_hide_that_nobody_is_led():
    bench = led(-3.6, n=5)
    bench.tick(0.2, -3.6, sensor_force=1e308)
    bench.ticks(60, 0.2, 0.4)
    assert bench.envelope.notice == "COMPLY: let go"


def test_a_bias_of_one_newton_is_no_weight_along_a_level_axis():
    bench = Bench(replace(ROOM, workspace_m=None), start=0.0)
    bench.ticks(30, 0.0, 0.0, sensor_force=-1.0)  # the estimate says 0 while it tares, and then the bias as well
    for n in range(200):
        bench.tick(-0.15, -1.0, sensor_force=-1.0 + 1e-3 * np.sin(n * n))
    assert bench.envelope.notice == ""
    assert bench.command.velocity[0] == -0.15


# the others, beside tests/skills/test_watching.py


def test_what_weighs_is_the_mean_of_25_good_ticks_at_rest():
    watch = LetGo(2, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for n in range(24):
        watch.weigh([-3.0 + 0.1 * (-1) ** n, -4.0], [0.0, 0.0], [0.0, 0.0], True)
    watch.weigh([nan, 0.0], [0.0, 0.0], [0.0, 0.0], True)
    watch.weigh([9.0, 9.0], [0.0, 0.0], [0.0, 0.0], False)
    assert (watch.load, watch.weighs) == (0.0, True)
    watch.weigh([-3.0, -4.0], [0.0, 0.0], [0.0, 0.0], True)
    assert watch.load == pytest.approx(5.0, abs=1e-3)
    assert not watch.weighs
    watch.weigh([0.0, 0.0], [1.0, 2.0], [0.0, G], True)
    assert watch.pull() == pytest.approx([4.0, 10.0])  # F - w (1 + a / g)


@pytest.mark.parametrize(("more", "lasts"), [(0.0, True), (1.9, True), (2.6, False), (-2.6, False)])
def test_carrying_it_all_is_within_a_third_of_the_share_and_2_2_newtons(more, lasts):
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    said = []
    for _ in range(60):
        watch.weigh([-WEIGHT], [-WEIGHT + more], [0.0], False)
        said.append(watch.step(0.1, DT))
    assert any(said) == lasts
    light = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        light.weigh([-3.9], [0.0], [0.0], True)
    for _ in range(60):
        light.weigh([-3.9], [-3.9], [0.0], False)
        assert not light.step(0.1, DT)  # of 4 N and less, only sinking tells


@pytest.mark.parametrize(("newtons_per_s", "said"), [(0.0, True), (6.0, True), (11.0, False)])
def test_the_pull_of_nobody_changes_no_faster_than_8_newtons_a_second(newtons_per_s, said):
    watch, found = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06), []
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    for n in range(100):
        pull = -3.0 + newtons_per_s * DT * n if newtons_per_s else 0.5
        watch.weigh([-WEIGHT], [-WEIGHT + pull], [0.0], False)
        found.append(watch.step(0.0, DT))
    assert any(found) == said


@pytest.mark.parametrize(("speed", "said"), [(0.1, True), (0.05, False)])
def test_an_object_that_swings_at_6_hz_is_told_by_its_longer_mean_while_the_hand_moves(speed, said):
    watch, found = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=60.0, stands_m_s=0.06), []
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    for n in range(200):
        watch.weigh([-WEIGHT], [-WEIGHT + 8.0 * np.sin(2.0 * np.pi * n / 16.0)], [0.0], False)
        found.append(watch.step(speed, DT))
    assert any(found) == said


@pytest.mark.parametrize(("off_n", "said"), [(1.7, True), (-1.7, True), (1.8, False), (2.1, False), (-2.1, False)])
def test_a_light_share_is_carried_alone_within_a_third_of_it(off_n, said):
    """0.35 of 5 N are 1.75 N, less than the 2.2 N of a heavy one."""
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        watch.weigh([-5.0], [0.0], [0.0], True)
    found = []
    for _ in range(60):
        watch.weigh([-10.0 + off_n], [-5.0 + off_n], [0.0], False)
        found.append(watch.step(0.1, DT))
    assert any(found) == said


@pytest.mark.parametrize(("off_n", "said"), [(1.7, True), (1.8, False)])
def test_what_answers_a_light_share_is_more_than_a_third_of_it(off_n, said):
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        watch.weigh([-5.0], [0.0], [0.0], True)
    for _ in range(20):
        watch.weigh([-10.0 + off_n], [-5.0 + off_n], [0.0], False)
    assert watch.nobody_pulls([off_n]) == said


def test_a_person_answers_within_the_way_that_a_hand_gives():
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    for _ in range(20):
        watch.weigh([-WEIGHT], [-WEIGHT + 1.0], [0.0], False)
    assert watch.nobody_pulls([1.6])
    assert not watch.nobody_pulls([0.2])
    assert watch.nobody_pulls([1.8])  # who was still letting go
    for _ in range(20):
        watch.weigh([-WEIGHT], [-WEIGHT + 2.3], [0.0], False)
    assert not watch.nobody_pulls([2.3])


@pytest.mark.parametrize(("force", "mode", "reason"), [(-4.5, "COMPLY", "blocked"), (-5.3, "RUN", ""), (-9.3, "HOLD", "let go")])
def test_a_hand_that_gave_way_feels_a_wall_below_half_the_share_somebody_above_it_or_nobody(force, mode, reason):
    """Its share is 9.8 N; while it gives way the force changes to `force`."""
    bench = Bench(replace(ROOM, energy_j=1e3), start=0.2)

    def feels(force, n):
        for k in range(n):
            bench.tick(0.1, force, sensor_force=force - WEIGHT + 1e-3 * np.sin(k * k))
            if bench.envelope.mode == "COMPLY":
                return

    for _ in range(30):
        bench.tick(0.0, 0.0, sensor_force=-WEIGHT)
    feels(0.0, 30)
    feels(-WEIGHT, 60)
    assert bench.envelope.reason.startswith("let go")
    for k in range(27):
        bench.tick(0.1, force, sensor_force=force - WEIGHT + 1e-3 * np.sin(k * k))
    assert bench.envelope.mode == mode
    assert bench.envelope.reason.startswith(reason)


def sinks(more, *, seconds=0.3, speed=-0.1, led_up_before=None, alone_n=2.2):
    sinking = Sinking(alone_n)
    if led_up_before is not None:
        sinking.step([-WEIGHT], WEIGHT, [0.0], [0.1], [0.0], DT)
        for _ in range(round(led_up_before / DT)):
            sinking.step([-WEIGHT], WEIGHT, [0.0], [0.0], [0.0], DT)
    for _ in range(round(seconds / DT)):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * more], [speed], [0.0], DT)
    return sinking


def test_who_turns_back_may_lack_more_of_the_share_for_two_seconds():
    assert sinks(0.13).sunk == pytest.approx(0.03)
    assert sinks(0.13, led_up_before=1.0).sunk == 0.0
    assert sinks(0.225, led_up_before=1.0).sunk == pytest.approx(0.015)
    assert sinks(0.13, led_up_before=2.1).sunk == pytest.approx(0.03)
    assert sinks(0.02).sunk == 0.0
    assert sinks(1.2).sunk == pytest.approx(0.03)  # the whole object, and what nobody is told from
    assert sinks(1.23).sunk == 0.0


def test_what_was_sunk_is_forgotten_after_a_tenth_of_a_second_of_carrying():
    sinking = sinks(0.5)
    assert sinking.hangs
    for _ in range(9):
        sinking.step([-WEIGHT], WEIGHT, [0.0], [-0.1], [0.0], DT)
    assert sinking.sunk == pytest.approx(0.03)
    for _ in range(2):
        sinking.step([-WEIGHT], WEIGHT, [0.0], [-0.1], [0.0], DT)
    assert (sinking.sunk, sinking.hangs) == (0.0, False)
    light = Sinking(2.2)
    light.step([-1.2], 1.2, [-1.2], [-0.1], [0.0], DT)
    assert not light.hangs


def test_a_pull_that_peaked_answers_until_its_peak_is_forgotten():
    sinking = sinks(0.29, seconds=0.05)
    for _ in range(20):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * 0.2], [-0.1], [0.0], DT)
    assert sinking.sunk > 0.02  # the peak was no pull
    sinking = sinks(0.6, seconds=0.05)
    for _ in range(20):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * 0.45], [-0.1], [0.0], DT)
    assert sinking.sunk < 0.01
    for _ in range(400):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * 0.45], [-0.1], [0.0], DT)
    assert sinking.sunk > 0.02


def test_a_push_is_work_beyond_what_is_usual_while_it_stays_near_its_peak():
    pushed = Pushed(6.0)
    for _ in range(10):
        pushed.step([8.0], [0.1], DT)
    assert pushed.work == pytest.approx(2.0 * 0.1 * 0.1)
    pushed.step([6.2], [0.1], DT)  # less than 0.8 of the peak: it fell
    assert pushed.work == pytest.approx(0.02 - 6.0 * 0.1 * DT)
    pushed.step([6.5], [0.1], DT)
    assert pushed.work == pytest.approx(0.02 - 6.0 * 0.1 * DT + 0.5 * 0.1 * DT, abs=1e-4)
    for _ in range(60):
        pushed.step([-20.0], [0.1], DT)
    assert pushed.work == 0.0
    pushed.step([8.0], [0.0], DT)
    assert pushed.work == 0.0
    forgets = Pushed(1.0)
    forgets.step([10.0], [0.0, 0.1][1:], DT)
    for _ in range(10):
        forgets.step([0.0], [0.1], DT)
    forgets.step([7.0], [0.1], DT)  # 0.8 of a peak of 10 N after 0.1 s, which is 8.2 N
    assert forgets.work == pytest.approx(6.0 * 0.1 * DT)


def test_each_axis_is_a_sensor_and_changes_of_one_do_not_excuse_the_other():
    watch, rng = Stuck(2, 0.2, 0.25), np.random.default_rng(1)
    said = []
    for n in range(60):
        said.append(watch.step([rng.normal(), 1.0 if n >= 20 else rng.normal()], 0.0, DT))
    assert said.index(True) == 41
    few = Stuck(1, 0.2, 0.25)
    for reading in rng.normal(size=8):  # the first is no change
        few.step([reading], 0.0, DT)
    assert not any(few.step([reading], 0.0, DT) for _ in range(60))
    far = Stuck(1, 0.2, 0.25)
    said = [far.step([1.0], 0.5, DT) for _ in range(60)]
    assert said.index(True) in (50, 51)


def test_a_sensor_that_falls_silent_stands_still_whatever_the_estimate_makes_of_it():
    bench, rng = Bench(), np.random.default_rng(3)
    for _ in range(40):
        bench.tick(0.05, 0.0, sensor_force=float(rng.normal()))
    begun = bench.time
    while not bench.held and bench.time < 1.0:
        bench.tick(0.05, 0.1 * float(rng.normal()), sensor_force=nan)
    assert bench.held == "force stuck"
    assert bench.time - begun == pytest.approx(0.21)
    never = Bench()
    for _ in range(60):  # one that never says anything is judged by the estimate
        never.tick(0.0, 0.1 * float(rng.normal()), sensor_force=nan)
    assert never.held == ""


def test_a_dead_band_once_seen_is_known():
    rng = np.random.default_rng(2)
    watch = Stuck(1, 0.2, 10.0)
    for _ in range(13):
        watch.step([0.0], 0.0, DT)  # stands before it is known as one that never repeats itself
    for _ in range(30):
        watch.step([float(rng.normal())], 0.0, DT)
    assert not any(watch.step([0.0], 0.0, DT) for _ in range(60))
    watch.step([0.5], 0.0, DT)
    assert any(watch.step([0.7], 0.0, DT) for _ in range(30))


@pytest.mark.parametrize(("stays", "seen"), [(1.0, True), (0.75, True), (1.25, True), (0.6, False), (1.4, False), (0.0, False)])
def test_a_zero_that_moved_stays_within_a_third(stays, seen):
    jump = Jump(2, 0.8, 0.3, 0.05)
    for n in range(60):
        assert jump.step([1e-3 * (n % 3), 1.0], True, DT) == 0.0
    said = [jump.step([3.0, 5.0], True, DT)]
    said += [jump.step([3.0 * stays, 1.0 + 4.0 * stays], True, DT) for _ in range(10)]
    assert (max(said) == pytest.approx(5.0, rel=1e-3)) == seen
    assert seen or max(said) == 0.0


def test_a_jump_needs_rest_before_it_and_a_change_beyond_the_usual():
    def after(rest_ticks, newtons, usual=0.0):
        jump = Jump(1, 0.8, 0.3, 0.05)
        for n in range(100):
            jump.step([usual * (-1) ** n], False, DT)
        for n in range(rest_ticks):
            jump.step([usual * (-1) ** n], True, DT)
        return max(jump.step([newtons + usual], True, DT) for _ in range(12))

    assert after(31, 2.0) > 0.0
    assert after(29, 2.0) == 0.0
    assert after(60, 0.9) > 0.0
    assert after(60, 0.7) == 0.0
    assert after(60, 2.0, usual=0.2) == 0.0  # 0.8 and 6 times 0.4 N
    assert after(60, 4.0, usual=0.2) > 0.0


def test_a_sample_that_is_held_between_ticks_is_one_sample_of_a_noisy_sensor():
    jump = Jump(1, 0.8, 0.3, 0.05)
    for n in range(600):
        assert jump.step([0.2 * (-1) ** (n // 5)], n > 300, DT) == 0.0
    assert max(jump.step([2.2], True, DT) for _ in range(12)) == 0.0  # 0.8 and 6 times 0.4 N
    again = Jump(1, 0.8, 0.3, 0.05)
    for n in range(600):
        again.step([0.2 * (-1) ** (n // 5)], n > 300, DT)
    assert max(again.step([4.2], True, DT) for _ in range(12)) > 3.0


def test_shaking_is_the_amplitude_above_one_hertz_and_takes_half_a_second():
    shaking = Shaking(2)
    for n in range(30):
        shaking.step([6.0 * np.sin(0.6 * n), 8.0 * np.sin(0.6 * n)], DT)
    assert 0.3 * 10.0 < shaking.amplitude < 0.65 * 10.0
    for n in range(30, 400):
        shaking.step([6.0 * np.sin(0.6 * n), 8.0 * np.sin(0.6 * n)], DT)
    assert shaking.amplitude == pytest.approx(10.0, rel=0.1)


# bounds


def test_the_fastest_is_what_can_be_braked_before_the_wall_and_within_the_tank():
    def cap(room, late=0.030):
        return max(0.0, sqrt(2.0 * 10.0 * room) - 0.5 * 10.0 * late)

    bench = Bench(replace(ROOM, energy_j=1e3), start=0.99)
    for _ in range(30):
        before = bench.envelope._x[0]
        v = bench.tick(1.0, 0.0)
        assert v <= cap(1.0 - before) + 1e-12
    assert bench.tick(1.0) == pytest.approx(0.0, abs=1e-12)
    assert bench.envelope._x[0] > 0.9985  # and it gets as near as T allows
    bench = Bench(Limits(energy_j=0.6), start=0.0)
    assert max(bench.ticks(40, 0.8, -10.0)) == pytest.approx(cap(0.6 / 60.0 - 0.0), rel=0.1)


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_a_wall_on_one_axis_slows_that_axis(towards):
    bench = Bench(Limits(workspace_m=((0.0, 1.0), (0.0, 1.0))), d=2, start=0.5)
    bench.hand[0] = 0.5 + 0.49 * towards
    bench.obs.position[:] = bench.hand
    bench.envelope.reset(bench.obs)
    for _ in range(100):
        bench.tick(np.array([0.1 * towards, 0.1]), np.zeros(2))
    assert abs(bench.hand[0] - 0.5) == pytest.approx(0.4989, abs=3e-4)
    assert bench.command.velocity[1] == pytest.approx(0.1)
    assert bench.hand[1] > 0.58


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_the_speed_along_a_slanting_way_is_what_can_be_braked_on_it(towards):
    bench = Bench(Limits(workspace_m=((0.0, 1.0), (0.0, 9.0))), d=2, start=0.5)
    bench.hand[:] = 0.5 + 0.44 * towards, 4.0
    bench.obs.position[:] = bench.hand
    bench.envelope.reset(bench.obs)
    slowed = 0
    for _ in range(25):
        bench.tick(towards * np.array([0.3, 0.4]), np.zeros(2))
        speed = float(np.linalg.norm(bench.command.velocity))
        room = 0.5 - abs(bench.envelope._x[0] - 0.5)
        along = room * speed / max(abs(bench.command.velocity[0]), 1e-12)
        assert speed <= max(sqrt(20.0 * along) - 0.15, 0.0) + 1e-9
        slowed += speed < 0.49
    assert slowed > 10


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_a_hand_that_was_pushed_behind_a_wall_comes_back_and_goes_no_farther(towards):
    bench = Bench(start=0.5 + 0.499 * towards)
    bench.ticks(3, 0.0, 0.0)
    outside = np.array([0.5 + 0.51 * towards])
    bench.tick(0.1 * towards, 0.0, position=outside)
    assert (bench.held, bench.command.velocity[0]) == ("", 0.0)
    bench.tick(-0.1 * towards, 0.0, position=outside)
    assert bench.command.velocity[0] == pytest.approx(-0.1 * towards)


def test_a_change_is_no_faster_than_a_and_straight_toward_what_is_wanted():
    bench = Bench(Limits(), d=2, start=0.0)
    bench.tick(np.array([0.3, 0.4]), np.zeros(2))
    v = bench.command.velocity.copy()
    bench.tick(np.array([0.3, 0.4]))
    assert bench.command.velocity - v == pytest.approx([0.06, 0.08])
    for _ in range(20):
        bench.tick(np.array([0.3, 0.4]))
    v = bench.command.velocity.copy()
    assert v == pytest.approx([0.3, 0.4])
    bench.tick(np.array([-0.3, 0.4]))
    assert bench.command.velocity - v == pytest.approx([-0.1, 0.0])
    bench = Bench(Limits(v_max_m_per_s=0.3), d=2, start=0.0)
    for _ in range(20):
        bench.tick(np.array([0.6, 0.8]), np.zeros(2))
    assert bench.command.velocity == pytest.approx([0.18, 0.24])


def test_energy_is_booked_with_the_force_along_the_way():
    bench = Bench(Limits(energy_j=2.0), d=2, start=0.0)
    for _ in range(20):
        bench.tick(np.array([0.1, 0.0]), np.array([0.0, 0.0]))
    bench.ticks(50, np.array([0.1, 0.0]), np.array([-8.0, 30.0]))
    assert bench.envelope.diagnostics["tank"][0] == pytest.approx(2.0 - 50 * 8.0 * 0.1 * DT)
    bench.ticks(30, np.array([0.1, 0.0]), np.array([5.0, 0.0]))
    assert bench.envelope.diagnostics["tank"][0] == pytest.approx(2.0 - 0.4 + 0.15)
    bench.ticks(300, np.array([0.1, 0.0]), np.array([5.0, 0.0]))
    assert bench.envelope.diagnostics["tank"][0] == 2.0


def test_the_tank_goes_down_to_nothing_and_then_the_hand_gives_no_more():
    bench, given = Bench(Limits(energy_j=0.4), start=0.0), 0.0
    for _ in range(200):
        bench.tick(0.3, -10.0)
        given += 10.0 * max(bench.command.velocity[0], 0.0) * DT
    assert 0.3 < given <= 0.4
    assert bench.command.velocity[0] == pytest.approx(0.0, abs=1e-9)
    assert bench.envelope.diagnostics["tank"][0] < 0.1


@pytest.mark.parametrize(("speed", "led_m"), [(0.3, 0.3 * 0.035 - 5.0 * 0.025**2), (0.05, 0.05 * 0.01 + 0.05**2 / 20.0)])
@pytest.mark.parametrize("turn", [(1.0, 0.0), (0.6, -0.8)])
def test_a_late_command_led_for_dt_and_then_until_it_was_braked(turn, speed, led_m):
    """At 0.3 m/s it still moves after 25 ms of braking at 10 m/s^2; at 0.05 m/s it stands after 5 ms."""
    way = np.array(turn)
    bench = Bench(Limits(energy_j=1e3), d=2, start=0.0)
    bench.ticks(20, speed * way, np.zeros(2))
    before = np.array(bench.envelope._x)
    bench.tick(speed * way, np.zeros(2), period=0.035)
    assert bench.held == "late 35 ms"
    assert np.array(bench.envelope._x) - before == pytest.approx(led_m * way, abs=1e-12)


def test_a_hold_brakes_by_itself_before_the_checker_has_to():
    bench = Bench(Limits(), d=2, start=0.0)
    bench.ticks(20, np.array([0.18, -0.24]), np.zeros(2))
    bench.envelope._checker.judge = lambda *_: ""
    bench.tick(None, np.array([0.0, 70.0]))
    assert bench.held
    assert bench.command.velocity == pytest.approx([0.12, -0.16])
    bench.ticks(2)
    assert bench.command.velocity == pytest.approx([0.0, 0.0])


def test_two_ticks_at_one_time_change_nothing_and_raise_nothing():
    bench = Bench(start=0.2)
    bench.ticks(10, 0.1, 0.0)
    before = bench.command.velocity[0]
    assert bench.tick(0.5, 0.0, period=0.0) == before
    assert bench.held == ""
    bench.tick(sample=False)  # coasts for 10 ms; then a sample that was taken 8 ms after the last one
    assert bench.tick(0.5, 0.0, period=-0.002) == pytest.approx(before)
    assert bench.held == ""


def test_where_it_begins_beside_the_walls_they_are_moved_there_and_no_farther():
    limits = replace(ROOM, begins_beside_m=0.2)
    for start, low, high in ((-0.15, -0.15, 1.0), (1.15, 0.0, 1.15), (0.5, 0.0, 1.0)):
        bench = Bench(limits, start=start)
        assert bench.envelope._walls == ((low, high),)
        assert bench.envelope._checker.walls == ((low, high),)
        bench.tick(0.0, 0.0)
        assert bench.envelope.mode == "RUN"
    assert Bench(limits, start=1.25).held.startswith("0.25 m outside the workspace: x 1.25 m, allowed 0 to 1 m")
    assert Bench(ROOM, start=-0.1).held.startswith("0.1 m outside the workspace")


def sunk(force, wish=-0.2, n=200):
    bench = Bench(replace(ROOM, workspace_m=None), start=0.0)
    bench.ticks(30, 0.0, 0.0, sensor_force=-WEIGHT)
    for k in range(n):
        bench.tick(wish, force, sensor_force=force - WEIGHT + 1e-3 * np.sin(k * k))
        if bench.held:
            break
    return bench


def test_C24_who_sinks_slows_down_creeps_and_then_stops():
    bench = sunk(-0.5 * WEIGHT)
    assert bench.held.startswith("let go or loaded")
    assert -bench.hand[0] == pytest.approx(0.022 + 0.015, abs=0.012)
    assert sunk(0.0).held == ""
    assert sunk(-0.5 * WEIGHT, n=30).command.velocity[0] == pytest.approx(-0.025, abs=0.03)


def test_C24_a_hand_that_sinks_slows_down_by_a_metre_a_second_in_a_second():
    bench, slowed = sunk(0.0, wish=0.0, n=5), 0
    for n in range(40):
        bench.tick(-0.5, -0.5 * WEIGHT, sensor_force=-1.5 * WEIGHT + 1e-3 * np.sin(n * n))
        left = max(0.022 - bench.envelope._sinking.sunk, 0.0)
        assert -bench.command.velocity[0] <= max(sqrt(2.0 * left), 0.025) + 1e-9
        slowed += 0.03 < -bench.command.velocity[0] < 0.2
    assert slowed > 3


# what stops it, and what lets it go on


@pytest.mark.parametrize(
    ("force", "n", "mode"), [(-19.0, 60, "RUN"), (-21.0, 2, "RUN"), (-21.0, 4, "COMPLY"), (-40.0, 2, "COMPLY")]
)
def test_C12_blocked_is_20_newtons_against_the_motion_for_30_ms(force, n, mode):
    bench = Bench(replace(ROOM, energy_j=1e3))
    bench.ticks(12, 0.1, 0.0)
    bench.ticks(n, 0.1, force)
    assert bench.envelope.mode == mode
    assert bench.envelope.reason == ("blocked" if mode == "COMPLY" else "")


def test_C12_what_pushes_along_does_not_block():
    bench = Bench(replace(ROOM, pushed_n=59.0))
    bench.ticks(12, 0.1, 0.0)
    bench.ticks(20, 0.1, 40.0)
    assert bench.envelope.mode == "RUN"


def test_C12_it_offers_to_go_on_half_a_second_after_the_wall_left_and_takes_two_seconds_to_full_speed():
    bench = Bench(replace(ROOM, energy_j=1e3))
    bench.ticks(12, 0.1, 0.0)
    bench.ticks(5, 0.1, -25.0)
    assert bench.envelope.mode == "COMPLY"
    bench.ticks(49, 0.1, -2.0)
    assert bench.envelope.mode == "COMPLY"
    bench.ticks(5, 0.1, 0.0)
    assert bench.envelope.mode == "RUN"
    assert bench.envelope.notice == "goes on by itself: blocked has passed"
    bench.ticks(100, 0.1, 0.0)
    assert bench.command.velocity[0] == pytest.approx(0.05, abs=0.004)
    bench.ticks(110, 0.1, 0.0)
    assert bench.command.velocity[0] == pytest.approx(0.1)
    assert bench.envelope.notice == ""


def offered(mistaken=False):
    """Was blocked, and offers to go on; an object of 9.8 N hangs on the hand."""
    bench = Bench(replace(ROOM, energy_j=1e3), start=0.2)
    bench.ticks(30, 0.0, 0.0, sensor_force=-WEIGHT)

    def feels(force, n):
        for k in range(n):
            bench.tick(0.1, force, sensor_force=force - WEIGHT + 1e-3 * np.sin(k * k))

    feels(0.0, 30)
    feels(-25.0, 5)
    assert bench.envelope.mode == "COMPLY"
    if mistaken:
        bench.envelope._let_go.mistaken()
    feels(0.0, 52)
    assert bench.envelope.mode == "RUN"
    return bench, feels


@pytest.mark.parametrize(
    ("share", "still", "passed"), [(9.8, -2.8, True), (9.8, -3.2, False), (5.0, -2.3, True), (5.0, -2.7, False)]
)
def test_what_blocked_has_passed_below_three_newtons_and_half_the_share(share, still, passed):
    bench = Bench(replace(ROOM, energy_j=1e3), start=0.2)
    bench.ticks(30, 0.0, 0.0, sensor_force=-share)
    for n, force in enumerate([0.0] * 30 + [-25.0] * 5 + [still] * 54):
        bench.tick(0.1, force, sensor_force=force - share + 1e-3 * np.sin(n * n))
    assert bench.skill.resets == (2 if passed else 1)


def test_after_a_hold_that_passed_it_goes_on_from_where_the_arm_was_put():
    bench = Bench(replace(ROOM, workspace_m=None, pushed_n=6.0), start=0.0)
    bench.ticks(15, 0.2, 0.0)
    while not bench.held:
        bench.tick(0.2, 12.0)
    for _ in range(20):
        bench.hand += 0.002
        bench.tick(0.0, 1.0)
    assert bench.held
    bench.ticks(45, 0.0, 1.0)
    assert bench.envelope.mode == "RUN"
    assert bench.envelope._x == pytest.approx(bench.hand.tolist(), abs=1e-3)
    for _ in range(20):
        bench.hand += 0.002
        bench.tick(0.0, 1.0)
    assert bench.held == ""  # 4 cm more, and 4 cm before


def test_an_observation_that_cannot_be_read_refuses_to_re_arm_and_raises_nothing():
    bench = Bench()
    bench.tick(0.0, nan)
    bench.obs.time = "now"
    assert bench.envelope.rearm(bench.obs).startswith("sensors: TypeError")


def waits(feels, bench):
    """[s] until it offers again after a wall of 3 N was still there."""
    for k in range(20):
        feels(max(-0.4 * k, -3.0), 1)  # at once it would be a zero that jumped
    assert bench.envelope.mode == "COMPLY"
    n = 0
    while bench.envelope.mode != "RUN" and n < 1200:
        feels(0.0, 1)
        n += 1
    return n * DT


def test_C29_it_waits_twice_as_long_each_time_a_wall_is_still_there_up_to_eight_seconds():
    bench, feels = offered()
    assert [waits(feels, bench) for _ in range(4)] == pytest.approx([1.0, 2.0, 4.0, 8.0], abs=0.05)
    feels(0.0, 220)  # all the way back: it begins anew
    feels(-25.0, 5)
    begun = bench.time
    while bench.envelope.mode != "RUN":
        feels(0.0, 1)
    assert bench.time - begun == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("newtons", "mistaken", "mode"), [(1.8, 0, "RUN"), (2.2, 0, "COMPLY"), (11.0, 1, "RUN"), (12.5, 1, "COMPLY")]
)
def test_C29_an_offer_ends_at_two_newtons_and_with_an_arm_that_is_led_up_by_its_weight_at_that(newtons, mistaken, mode):
    bench, feels = offered(bool(mistaken))
    feels(-newtons, 5)
    assert bench.envelope.mode == mode


def test_C25_pushed_along_for_a_quarter_joule_complies_and_then_holds():
    bench = Bench(replace(ROOM, workspace_m=None, pushed_n=6.0), start=0.0)
    bench.ticks(15, 0.2, 0.0)
    begun = bench.time
    while bench.envelope.mode == "RUN":
        bench.tick(0.2, 12.0)
    assert bench.time - begun == pytest.approx(0.25 / (6.0 * 0.2), abs=0.03)
    assert bench.envelope.reason == "pushed along with 12 N: sensor, or a weight on it?"
    begun = bench.time
    while not bench.held:
        bench.tick(0.2, 12.0)
    assert bench.time - begun == pytest.approx(0.25 / (6.0 * 12.0 / 150.0), abs=0.06)
    bench.ticks(40, 0.2, 1.0)
    assert bench.held
    bench.ticks(20, 0.2, 1.0)
    assert bench.envelope.mode == "RUN"


@pytest.mark.parametrize(("newtons", "softer"), [(4.0, 1.0), (12.0, 2.0), (30.0, 5.0)])
def test_a_complying_hand_is_damped_in_proportion_to_what_shakes_it_beyond_6_newtons(newtons, softer):
    bench = Bench(replace(ROOM, workspace_m=None, pushed_n=50.0, energy_j=1e3))
    bench.ticks(10, 0.1, 0.0)
    bench.ticks(10, 0.1, -25.0)
    assert bench.envelope.mode == "COMPLY"
    for n in range(49):
        bench.tick(0.1, newtons * np.sin(2.0 * np.pi * 3.0 * n * DT))
    stiffer = max(bench.envelope._shaking.amplitude / 6.0, 1.0)
    assert bench.envelope.mode == "COMPLY"
    assert bench.command.velocity[0] == pytest.approx(bench.force[0] / (150.0 * stiffer))
    assert stiffer == pytest.approx(softer, rel=0.4)


def test_it_goes_on_only_when_what_stopped_it_is_below_three_newtons():
    bench = Bench(replace(ROOM, workspace_m=None, pushed_n=6.0), start=0.0)
    bench.ticks(15, 0.2, 0.0)
    while not bench.held:
        bench.tick(0.2, 12.0)
    bench.ticks(100, 0.2, 3.2)
    assert bench.held
    bench.ticks(45, 0.2, 2.8)
    bench.ticks(10, 0.2, 3.2)
    bench.ticks(45, 0.2, 2.8)
    assert bench.held  # half a second without a break
    bench.ticks(10, 0.2, 2.8)
    assert bench.envelope.mode == "RUN"


def test_flags_say_shaking_tare_walls_and_an_empty_tank():
    for joules, used_up in ((0.067, True), (0.068, False)):  # room for a T^2 / 8 at 60 N
        bench = Bench(Limits(energy_j=joules), start=0.0)
        bench.ticks(3, 0.0, 0.0)
        assert bench.envelope.notice == ("energy budget used up: re-arm" if used_up else "")
    bench = Bench(start=0.9915)
    bench.ticks(5, 0.0, 0.0)
    assert bench.envelope.notice == "at the edge of the workspace: x 0.99 m of 0.00 to 1.00 m"
    bench = Bench(start=0.985)
    bench.ticks(5, 0.0, 0.0)
    assert bench.envelope.notice == ""
    bench = Bench(replace(ROOM, workspace_m=None))
    for n in range(300):
        bench.tick(0.0, 8.0 * np.sin(2.0 * np.pi * 4.0 * n * DT))
    assert bench.envelope.notice.startswith("shaking, 7 N")
    bench = Bench(replace(ROOM, workspace_m=None))
    bench.ticks(3, 0.0, 1.4)
    assert bench.envelope.notice == ""
    bench = Bench(replace(ROOM, workspace_m=None))
    bench.ticks(4, 0.0, 2.0)
    assert bench.envelope.notice == "felt 2.0 N at rest: wrong mass? tare"


@pytest.mark.parametrize(("speed", "said"), [(0.045, True), (0.055, False)])
def test_what_is_felt_in_motion_is_no_wrong_tare(speed, said):
    bench = Bench(Limits(workspace_m=((0.0, 9.0),), energy_j=1e3), start=0.2)
    bench.ticks(20, speed, 0.0)
    bench.ticks(400, speed, -2.0)
    assert bench.envelope.notice.startswith("felt") == said


def test_a_hold_commands_the_place_where_it_stands_and_comply_where_the_hand_is():
    bench = Bench()
    bench.ticks(30, 0.3, 0.0)
    bench.tick(0.3, nan)
    places = [bench.command.position[0]]
    for _ in range(6):
        bench.tick(0.3, nan)
        places.append(bench.command.position[0])
    assert np.diff(places)[-1] == 0.0
    assert places[-1] - places[0] == pytest.approx(sum(DT * (0.2 - 0.1 * k) for k in range(1, 3)), abs=0.003)
    bench.hand += 0.003  # pushed aside: it stays stiff where it was
    bench.tick(0.3, nan)
    assert bench.command.position[0] == places[-1]
    assert bench.command.acceleration[0] == 0.0


def test_position_and_acceleration_pass_with_the_velocity_and_no_farther_than_a_late_period_leads():
    bench = Bench()

    def asks(command):
        command.velocity[:], command.position[:], command.acceleration[:] = 0.05, bench.obs.position + 0.5, 30.0

    bench.skill.trick = asks
    bench.tick(None, 0.0)
    assert bench.command.position[0] == pytest.approx(bench.hand[0] + 0.8 * 0.030)
    assert bench.command.acceleration[0] == 10.0

    def asks_more(command):
        command.velocity[:], command.position[:], command.acceleration[:] = 0.5, bench.obs.position - 0.5, 30.0

    bench.skill.trick = asks_more
    bench.tick(None, 0.0)
    v = bench.command.velocity[0]
    assert bench.command.position[0] == pytest.approx(bench.hand[0] + v * DT)  # faded: where that velocity leads
    assert bench.command.acceleration[0] == 0.0

    def asks_less(command):
        command.velocity[:], command.position[:], command.acceleration[:] = -0.5, bench.obs.position - 0.5, 30.0

    bench.skill.trick = asks_less
    bench.tick(None, 0.0)
    assert bench.command.velocity[0] > -0.5
    assert bench.command.position[0] == pytest.approx(bench.hand[0] + bench.command.velocity[0] * DT)


@pytest.mark.parametrize("reading", [1e6, -1e9, 1e300, inf, -inf])
def test_a_reading_that_no_sensor_says_is_a_missing_one(reading):
    bench = Bench()
    for n in range(40):
        bench.tick(0.0, 0.0, sensor_force=reading if n in (5, 35) else -WEIGHT + 1e-3 * np.sin(n * n))
        assert bench.held == ""
    assert bench.envelope._let_go.load == pytest.approx(WEIGHT, abs=1e-3)


def test_clock_and_samples_have_their_limits():
    bench = Bench()
    bench.ticks(5, 0.1, 0.0)
    bench.tick(0.1, 0.0, period=0.0299)
    assert bench.held == ""
    bench.tick(0.1, 0.0, period=0.0301)
    assert bench.held == "late 30 ms"
    bench = Bench()
    bench.ticks(5, 0.1, 0.0)
    for _ in range(5):
        bench.tick(sample=False)
    assert bench.held == ""
    bench.tick(sample=False)
    assert bench.held == "force 60 ms old"
    bench = Bench()
    bench.ticks(5, 0.1, 0.0)
    bench.obs.force_time = bench.time + DT - 0.049
    bench.tick(0.1, 0.0)
    assert bench.held == ""
    bench.obs.force_time = bench.time + DT - 0.052
    bench.tick(0.1, 0.0)
    assert bench.held == "force 52 ms old"


@pytest.mark.parametrize(("off", "held"), [(0.049, ""), (-0.049, ""), (0.052, "does not follow: 0.052 m off")])
def test_a_hand_may_be_5_cm_off_its_ledger(off, held):
    bench = Bench()
    for n in range(26):
        bench.tick(0.0, 0.0, position=bench.hand + off * min(n / 20, 1.0))
    assert bench.held == held


@pytest.mark.parametrize(("jump", "held"), [(0.035, ""), (0.037, "position jump 0.037 m")])
def test_a_position_may_jump_2_cm_beyond_twice_the_fastest(jump, held):
    bench = Bench(replace(ROOM, drift_m=1.0))
    bench.ticks(5, 0.0, 0.0)
    bench.tick(0.0, 0.0, position=bench.hand + jump)
    assert bench.held == held


def test_three_axes_each_count_for_force_and_velocity():
    for axis in range(3):
        force, velocity = np.zeros(3), np.zeros(3)
        force[axis], velocity[axis] = 60.5, 8.1
        bench = Bench(Limits(), d=3)
        bench.tick(np.zeros(3), force)
        assert bench.held == "force 60 N > 60 N"
        bench = Bench(Limits(), d=3)
        bench.tick(np.zeros(3), np.zeros(3), velocity=velocity)
        assert bench.held == "velocity not plausible"
        bench = Bench(Limits(), d=3)
        bench.tick(np.zeros(3), np.zeros(3), velocity=np.where(np.arange(3) == axis, nan, 0.1))
        assert bench.held == ""


def test_it_is_re_armed_at_rest_only_and_a_skill_goes_on_where_it_was():
    bench = Bench()
    bench.ticks(20, 0.1, 0.0)
    assert bench.envelope.rearm(bench.obs).startswith("in motion: 0.1 m/s")
    bench.tick(0.1, nan)
    bench.ticks(5, 0.1, nan)
    bench.obs.force[:] = 0.0
    bench.obs.velocity[:] = 0.021
    assert bench.envelope.rearm(bench.obs) == "in motion: 0.021 m/s"
    bench.obs.velocity[:] = [0.019]
    bench.obs.force[:] = 3.1
    assert bench.envelope.rearm(bench.obs) == "pulled with 3 N > 3 N: let the object rest, or tare"
    bench.obs.force[:] = 2.9
    assert bench.envelope.rearm(bench.obs) == ""
    assert (bench.envelope.mode, bench.skill.resets) == ("RUN", 2)
    assert bench.envelope.diagnostics["tank"][0] == bench.envelope.limits.energy_j


def test_what_is_shown_is_what_counts():
    bench = Bench()
    assert bench.envelope.axes == ("x",)
    assert bench.envelope.dt == DT
    assert bench.envelope.stop_reason == ""
    assert set(bench.envelope.diagnostics) == {"asked", "mode", "tank", "confidence"}
    bench.ticks(5, 0.1, 0.0)
    assert bench.envelope.diagnostics["mode"][0] == 0.0
    assert not bench.envelope.passes
    bench.tick(0.1, nan)
    assert (bench.envelope.diagnostics["mode"][0], bench.envelope.passes) == (2.0, False)


def test_an_envelope_before_its_start_holds():
    bench = Bench()
    from comanip.safety.envelope import Envelope

    fresh = Envelope(Dictated(), axes=("x",), dt=DT)
    assert (fresh.mode, fresh.reason) == ("HOLD", "not started")
    obs = Observation(1)
    obs.position[:], obs.velocity[:], obs.force[:] = 0.5, 0.0, 0.0
    assert fresh.rearm(obs) == ""
    assert bench.envelope.limits.workspace_m == ((0.0, 1.0),)
    assert inf > bench.envelope._late == pytest.approx(0.03)
