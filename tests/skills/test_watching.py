"""What the envelope watches in the force, each by itself: what it must see, and what it must not."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.safety.detectors import Drag, Jump, LetGo, Pushed, Shaking, Sinking, Stuck
from envelopes import Bench

DT, WEIGHT = 0.01, 9.8


def jumps(readings, rest=True):
    jump = Jump(1, least_n=0.8, rest_s=0.3, stays_s=0.05)
    said = [jump.step([x], rest, DT) for x in readings]
    return [(n, size) for n, size in enumerate(said) if size]


def noise(sigma, n, seed=0):
    return -WEIGHT + np.random.default_rng(seed).normal(0.0, sigma, n)


@pytest.mark.parametrize(("sigma", "newtons"), [(0.05, 2.0), (0.05, -2.0), (0.1, 2.0), (0.3, 4.0), (0.3, -8.0)])
def test_a_zero_that_moved_is_seen_after_50_ms_with_its_size(sigma, newtons):
    found = jumps(noise(sigma, 200) + newtons * (np.arange(200) >= 120))
    assert [n for n, _ in found] == [125]
    assert found[0][1] == pytest.approx(abs(newtons), abs=4.0 * sigma)


def test_it_is_seen_on_any_axis():
    jump, seen = Jump(3, least_n=0.8, rest_s=0.3, stays_s=0.05), []
    for n in range(200):
        seen.append(jump.step([0.0, 0.0, 4.0 * (n >= 100)], True, DT))
    assert max(seen) == pytest.approx(4.0)


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.2, 0.5, 1.0])
def test_noise_is_no_jump(sigma):
    assert jumps(noise(sigma, 20_000)) == []


@pytest.mark.parametrize("lasting", [1, 2, 3])
def test_a_knock_is_no_jump(lasting):
    readings = noise(0.05, 200)
    readings[120 : 120 + lasting] += 8.0
    assert jumps(readings) == []


def test_a_pull_that_grows_as_people_pull_is_no_jump():
    for rise_s in (0.1, 0.2, 0.5):
        assert jumps(noise(0.05, 200) + 8.0 * np.clip((np.arange(200) - 120) * DT / rise_s, 0.0, 1.0)) == []


def test_in_motion_nothing_is_a_jump_and_shortly_after_neither():
    readings = noise(0.05, 200) + 4.0 * (np.arange(200) >= 120)
    assert jumps(readings, rest=False) == []
    jump = Jump(1, least_n=0.8, rest_s=0.3, stays_s=0.05)
    assert not any(jump.step([x], n > 100, DT) for n, x in enumerate(readings))


def test_a_reading_that_is_missing_is_passed_over():
    readings = noise(0.05, 200) + 4.0 * (np.arange(200) >= 150)
    readings[[30, 60, 61]] = np.nan
    assert len(jumps(readings)) == 1


def let_go(forces, *, speed=0.1, acceleration=None):
    """Ticks after which it is said that the partner let go, of forces F that follow 0.5 s of carrying at rest."""
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    acceleration = np.zeros(len(forces)) if acceleration is None else acceleration
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], False)
        assert not watch.step(speed, DT)
    said = []
    for n, (f, a) in enumerate(zip(forces, acceleration, strict=True)):
        watch.weigh([f - WEIGHT], [f], [a], False)
        if watch.step(speed, DT):
            said.append(n)
    return said


def test_an_end_that_is_free_is_seen_within_half_a_second():
    for speed in (0.0, 0.3):
        assert 30 < let_go([-WEIGHT] * 60, speed=speed)[0] <= 45


def test_a_free_object_is_seen_through_the_hand_s_own_acceleration():
    a = -3.0 * np.ones(60)
    assert let_go(-WEIGHT * (1.0 + a / 9.80665), acceleration=a)
    assert not let_go([-WEIGHT] * 60, acceleration=a)  # that much less would be free: somebody still pulls


def test_an_object_nobody_weighed_says_nothing():
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(100):
        watch.weigh([-WEIGHT], [-WEIGHT], [0.0], False)  # never at rest
        assert not watch.step(0.0, DT)


@pytest.mark.parametrize("within_s", [0.01, 0.3, 1.0, 2.0])
def test_letting_go_slowly_is_letting_go(within_s):
    n = int(within_s / DT)
    said = let_go(-WEIGHT * np.clip(np.arange(n + 60) / max(n, 1), 0.0, 1.0))
    assert 0.75 * n < said[0] <= n + 45


def test_who_pulls_through_the_weight_to_more_holds():
    assert not let_go(-WEIGHT * np.clip(np.arange(300) / 60.0, 0.0, 2.0))


def sunk(more, speed=-0.1, seconds=0.5, alone_n=2.2, taught=0.0):
    """Metres sunk under a share that lacks `more` of it, at this speed along up."""
    sinking = Sinking(alone_n)
    for _ in range(round(seconds / DT)):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * more], [speed], [taught], DT)
    return sinking.sunk


def test_sinking_counts_what_lacks_and_neither_a_partner_who_carries_nor_one_who_pulls():
    assert sunk(0.5) == pytest.approx(0.05)
    assert sunk(0.07) == pytest.approx(0.025)  # half of it
    assert sunk(0.0) == sunk(1.5) == sunk(0.5, speed=0.1) == 0.0


def test_where_lessons_went_down_it_does_not_count_while_the_partner_carries_half_of_the_share():
    assert sunk(0.4, taught=-0.06) == 0.0
    assert sunk(0.4, taught=-0.03) == pytest.approx(0.02)  # 0.1 m/s, and 0.06 of them as taught
    assert sunk(0.7, taught=-0.05) == pytest.approx(0.025)  # half way from leading down to letting go
    assert sunk(0.95, taught=-0.06) == pytest.approx(sunk(0.95))
    assert sunk(0.4, taught=0.06) == pytest.approx(sunk(0.4))  # lessons went up here


def test_a_pull_that_falls_as_the_hand_follows_is_a_person_and_forgotten():
    sinking = Sinking(2.2)
    for n in range(60):
        sinking.step([-WEIGHT], WEIGHT, [-WEIGHT * (0.6 if n < 20 else 0.4)], [-0.1], [0.0], DT)
    assert sinking.sunk == 0.0


def test_a_push_that_does_not_fall_is_work_and_one_that_does_is_not():
    falls = [10.0 - 0.4 * n for n in range(25)]
    for force, least, most in (([10.0] * 50, 0.36, 0.38), (falls, 0.0, 0.1), ([2.0] * 50, 0.0, 0.0)):
        pushed, work = Pushed(2.5), []
        for f in force:
            pushed.step([0.6 * f, 0.8 * f], [0.06, 0.08], DT)  # along the motion, which is along no axis
            work.append(pushed.work)
        assert least <= max(work) <= most


def stuck(readings, speed=0.0):
    watch = Stuck(1, 0.2, 0.25)
    return [n for n, reading in enumerate(readings) if watch.step([reading], speed, DT)]


def test_a_sensor_that_never_repeats_itself_is_stuck_after_200_ms_at_rest_too():
    readings = noise(0.1, 200)
    readings[100:] = readings[99]
    for speed in (0.0, 0.2):
        assert stuck(readings, speed)[0] == 120


def test_coarse_steps_and_a_dead_band_are_not_stuck_but_a_whole_motion_without_a_change_is():
    path = 3.0 * np.sin(np.linspace(0.0, 3.0, 400))
    assert stuck(np.round(2.0 * path) / 2.0, 0.05) == []
    band = noise(0.02, 400) + np.where(np.arange(400) < 100, 0.0, path)
    assert stuck(np.where(np.abs(band + WEIGHT) < 1.0, -WEIGHT, band), 0.05) == []
    assert stuck([3.0] * 200, 0.2)[0] == pytest.approx(125, abs=2)


def test_a_wall_that_answers_the_hand_holds():
    forces = -WEIGHT - 2.5 + 5.2 * np.cos(2.0 * np.pi * 3.0 * np.arange(200) * DT)
    assert not let_go(forces, speed=0.03)


@pytest.mark.parametrize("hz", [3.0, 8.0])
def test_shaking_is_told_by_its_amplitude(hz):
    shaking = Shaking(1)
    for n in range(300):
        shaking.step([3.0 + 10.0 * np.sin(2.0 * np.pi * hz * n * DT)], DT)
    assert shaking.amplitude == pytest.approx(10.0, rel=0.15)


def test_a_steady_pull_is_no_shaking():
    shaking = Shaking(1)
    for _ in range(400):
        shaking.step([10.0], DT)
    assert shaking.amplitude < 0.1


def standing(newtons, seconds=1.5):
    """Where a hand that has sunk, and stands, is after so long with this much on it, of 12 N that the whole object adds."""
    bench, rng = Bench(), np.random.default_rng(0)

    def carried(force, wish, n):
        for _ in range(n):
            bench.tick(wish, force, sensor_force=force - 12.0 + rng.normal(0.0, 0.01))

    carried(0.0, 0.0, 60)
    carried(0.0, -0.02, 5)  # in motion, where no jump is looked for
    while not bench.held and bench.time < 3.0:
        carried(-6.0, -0.1, 1)
    assert bench.held.startswith("let go or loaded")
    carried(newtons, 0.0, round(seconds / DT))
    return bench.envelope.mode, bench.skill.resets


def test_a_hand_that_sank_goes_on_with_somebody_who_carries_or_pulls_harder_and_not_under_the_object():
    assert standing(-6.0) == ("RUN", 2)
    assert standing(-16.0) == ("RUN", 2)
    assert standing(-9.0) == ("RUN", 2)
    assert standing(-12.0) == standing(-11.0) == standing(-13.0) == ("HOLD", 1)
    assert standing(-6.0, seconds=0.4) == ("HOLD", 1)


def test_who_was_taken_for_nobody_is_asked_again_sooner_the_first_time():
    said = []
    for mistakes in range(4):
        watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
        for _ in range(30):
            watch.weigh([-WEIGHT], [0.0], [0.0], True)
        for _ in range(mistakes):
            watch.mistaken()
        n = 0
        while True:
            n += 1
            watch.weigh([-2.0 * WEIGHT], [-WEIGHT], [0.0], False)
            if watch.step(0.1, DT):
                break
        said.append(n * DT)
    assert np.diff(said) == pytest.approx([0.3, 2.55, 0.0], abs=0.02)


def led_up(resists, *, d=1, axis=None, seconds=3.0):
    """A Drag that has seen minimum-jerk motions up at up to 0.15 m/s; `resists` gives the resistance [N] at (time, speed)."""
    drag, said, axis = Drag(), [], np.eye(d)[0] if axis is None else np.asarray(axis)
    for time in np.arange(0.0, seconds, DT):
        s = (time % 2.0) / 2.0
        speed = 0.15 * 16.0 * s**2 * (1.0 - s) ** 2
        drag.step((-resists(time, speed) * axis).tolist(), (speed * axis).tolist(), DT)
        said.append(drag.explains(WEIGHT))
    return drag, np.array(said)


@pytest.mark.parametrize(("friction_n", "damping"), [(0.0, 40.0), (2.0, 45.0), (2.0, 60.0), (3.0, 30.0)])
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
def test_a_stiff_shoulder_is_explained_by_what_it_was(friction_n, damping, axis):
    drag, said = led_up(lambda _, v: friction_n + damping * v, d=3, axis=axis)
    assert said[100:].all()
    assert drag.at(0.1) == pytest.approx(friction_n + 0.1 * damping, abs=0.1)


def test_nobody_is_not_explained_however_long_the_hand_is_led():
    assert not led_up(lambda _, v: WEIGHT, seconds=8.0)[1].any()


def test_who_lets_go_is_told_from_what_the_partner_was_as_soon_as_the_two_differ():
    """At top speed that resistance is 8.8 N of the weight's 9.8; where the hand slows down to 0.1 m/s it would be 6.5 N."""
    _, said = led_up(lambda time, v: 2.0 + 45.0 * v if time < 2.8 else WEIGHT, seconds=4.0)
    assert said[270:280].all()
    assert not said[340:].any()


def test_a_pull_aside_is_not_explained():
    drag = Drag()
    for n in range(200):
        speed = 0.05 + 0.0005 * n
        drag.step([-45.0 * speed, 4.0 * (n > 150)], [speed, 0.0], DT)
        assert drag.explains(WEIGHT) == (n < 150) or n < 40 or 150 <= n < 160


def test_after_a_mistake_who_resists_as_then_has_not_let_go():
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, steady_n_s=8.0, stands_m_s=0.06)
    for _ in range(25):
        watch.weigh([-WEIGHT], [0.0], [0.0], True)
    for _ in range(100):
        watch.weigh([-2.0 * WEIGHT], [-WEIGHT], [0.0], False)
        assert not watch.step(0.1, DT, True)
    assert any(watch.step(0.1, DT, False) for _ in range(20))
