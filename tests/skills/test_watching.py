"""What the envelope watches in the force, each by itself: what it must see, and what it must not."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.safety.detectors import Jump, LetGo, Shaking

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
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, sudden_s=0.15, steady_n_s=45.0, stands_m_s=0.06, least_n=2.0)
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


def test_an_end_that_is_free_is_seen_within_a_third_of_a_second():
    for speed in (0.0, 0.3):
        assert 15 < let_go([-WEIGHT] * 60, speed=speed)[0] <= 33


def test_a_free_object_is_seen_through_the_hand_s_own_acceleration():
    a = -3.0 * np.ones(60)
    assert let_go(-WEIGHT * (1.0 + a / 9.80665), acceleration=a)
    assert not let_go([-WEIGHT] * 60, acceleration=a)  # that much less would be free: somebody still pulls


def test_an_object_nobody_weighed_says_nothing():
    watch = LetGo(1, DT, alone_n=2.2, alone_s=0.15, sudden_s=0.15, steady_n_s=45.0, stands_m_s=0.06, least_n=2.0)
    for _ in range(100):
        watch.weigh([-WEIGHT], [-WEIGHT], [0.0], False)  # never at rest
        assert not watch.step(0.0, DT)


def test_who_pulls_down_by_and_by_holds():
    assert not let_go(-WEIGHT * np.clip(np.arange(300) / 150.0, 0.0, 1.0))


def test_a_wall_that_answers_the_hand_holds():
    forces = -WEIGHT - 2.5 + 5.2 * np.cos(2.0 * np.pi * 3.0 * np.arange(200) * DT)
    assert not let_go(forces, speed=0.03)
    assert let_go(forces, speed=0.3)  # a hand that moves so fast is at no wall


@pytest.mark.parametrize("hz", [3.0, 8.0])
def test_shaking_is_told_by_its_amplitude(hz):
    shaking = Shaking()
    for n in range(300):
        shaking.step(3.0 + 10.0 * np.sin(2.0 * np.pi * hz * n * DT), DT)
    assert shaking.amplitude == pytest.approx(10.0, rel=0.15)


def test_a_steady_pull_is_no_shaking():
    shaking = Shaking()
    for _ in range(400):
        shaking.step(10.0, DT)
    assert shaking.amplitude < 0.1
