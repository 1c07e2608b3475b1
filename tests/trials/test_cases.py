"""Whom a skill is tried with: the draw, and people who misbehave."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.people.misbehaving import Blocks, LetsGo, Switches
from comanip.trials import MISBEHAVIOURS, draw_case
from comanip.trials.cases import ROLES

N = 600
RANGES = {
    "lift_m": (0.15, 0.38),
    "duration_s": (1.6, 4.0),
    "onset_s": (0.3, 6.0),
    "yielding_ns_per_m": (15.0, 60.0),
    "delay_s": (0.10, 0.25),
    "beam_mass_kg": (1.4, 2.6),
    "force_bias_n": (-1.0, 1.0),
    "force_noise_n": (0.05, 0.5),
    "sensor_delay_s": (0.0, 0.020),
    "tremor_n": (0.0, 0.1),
    "event": (0.3, 0.7),
    "pause_s": (0.8, 2.5),
}


def drawn(role, misbehaving, n=N, seed=11):
    rng = np.random.default_rng(seed)
    return [draw_case(role, rng, misbehaving=misbehaving) for _ in range(n)]


@pytest.mark.parametrize("role", ROLES)
def test_the_same_seed_draws_the_same_people(role):
    assert drawn(role, 0.3, n=20) == drawn(role, 0.3, n=20)
    assert drawn(role, 0.3, n=20) != drawn(role, 0.3, n=20, seed=12)


@pytest.mark.parametrize("role", ROLES)
def test_who_misbehaves_is_the_same_person_otherwise(role):
    well, badly = drawn(role, 0.0, n=50), drawn(role, 1.0, n=50)
    assert {case.behaviour for case in well} == {"steady"}
    assert [replace(case, behaviour="steady") for case in badly] == well


@pytest.mark.parametrize("role", ROLES)
def test_shares_are_what_was_asked_for(role):
    """Four standard deviations of a binomial share."""
    some = Counter(case.behaviour for case in drawn(role, 0.4))
    assert some["steady"] / N == pytest.approx(0.6, abs=0.08)
    every = Counter(case.behaviour for case in drawn(role, 1.0))
    assert set(every) == set(MISBEHAVIOURS)
    for count in every.values():
        assert count / N == pytest.approx(0.2, abs=0.07)
    leading = np.mean([case.leads for case in drawn(role, 0.0)])
    assert leading == pytest.approx({"leader": 0.0, "follower": 1.0, "auto": 0.5}[role], abs=0.08)


@pytest.mark.parametrize("role", ROLES)
def test_numbers_fill_the_documented_ranges(role):
    cases = drawn(role, 0.5)
    for name, (low, high) in RANGES.items():
        values = np.array([getattr(case, name) for case in cases])
        assert low <= values.min() <= low + 0.05 * (high - low), name
        assert high - 0.05 * (high - low) <= values.max() <= high, name
    for case in cases:
        ratio = case.damping_ns_per_m / (2.0 * np.sqrt(case.stiffness_n_per_m * (1.0 + 0.5 * case.beam_mass_kg)))
        assert 0.3 - 1e-9 <= ratio <= 0.8 + 1e-9
        assert case.stiffness_n_per_m <= 600.0
        assert case.stiffness_n_per_m >= 60.0 or not case.leads
        assert case.run_s > case.stop_s


def test_an_unknown_role_is_said_with_the_known_ones():
    with pytest.raises(ParameterError, match="role 'boss' is unknown; there are: leader, follower, auto"):
        draw_case("boss", np.random.default_rng(0))


class Pulls:
    """A steady force; remembers where it was reset and when it was asked."""

    def __init__(self, newtons):
        self.newtons, self.times, self.began = newtons, [], None

    def reset(self, position):
        self.began = position.copy()

    def force(self, time, position, velocity, out):
        self.times.append(time)
        out[:] = self.newtons


def forces(partner, times, at=0.0, speed=0.0):
    place, velocity, out = np.zeros(1), np.full(1, speed), np.zeros(1)
    partner.reset(np.zeros(1))
    found = []
    for t in times:
        place[:] = at(t) if callable(at) else at
        partner.force(t, place, velocity, out)
        found.append(out[0])
    return np.array(found)


MS = np.arange(0, 3.0, 0.001)


def test_who_lets_go_has_no_force_from_then_on():
    f = forces(LetsGo(Pulls(8.0), 1.0, within_s=0.05), MS)
    assert (f[MS < 1.0] == 8.0).all()
    assert (f[MS >= 1.0501] == 0.0).all()
    assert (np.diff(f) <= 0.0).all()


def test_a_wall_stands_where_it_was_met_and_again_after_a_reset():
    wall = Blocks(Pulls(8.0), 1.0, carried=np.array([9.0]))
    for _ in range(2):
        f = forces(wall, MS, at=lambda t: 0.1 * t)
        assert (f[MS < 1.0] == 8.0).all()
        assert f[MS >= 1.0] == pytest.approx(9.0 - 1e4 * 0.1 * (MS[MS >= 1.0] - 1.0), abs=1e-6)
    assert forces(wall, [1.0, 1.5], at=0.3, speed=0.1) == pytest.approx([9.0 - 20.0] * 2)


@pytest.mark.parametrize("times", [(1.0, 1.2), (2.0, 1.0)])
def test_partners_who_take_over_too_soon_after_each_other_are_refused(times):
    with pytest.raises(ParameterError, match=r"must be in order, 0\.3 s apart or more"):
        Switches(Pulls(0.0), [(time, lambda *_: Pulls(1.0)) for time in times])


def test_a_change_of_partners_is_no_jump_of_force():
    people = [Pulls(0.0), Pulls(10.0), Pulls(-5.0)]
    seen = []

    def enters(n):
        return lambda start, position: seen.append((start[0], position[0])) or people[n]

    f = forces(Switches(people[0], [(1.0, enters(1)), (2.0, enters(2))], blend_s=0.3), MS, at=lambda t: 0.1 * t)
    assert np.abs(np.diff(f)).max() <= 15.0 * 0.001 / 0.3 + 1e-9
    assert f[[500, 1000, 1301, 1999, 2301]] == pytest.approx([0.0, 0.0, 10.0, 10.0, -5.0])
    assert np.array(seen) == pytest.approx(np.array([(0.0, 0.1), (0.0, 0.2)]))
    assert people[1].began == pytest.approx(0.1)
    assert people[1].times[0] == pytest.approx(0.0)
