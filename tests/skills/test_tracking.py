"""How firmly and how fast a leader goes along the taught path: minimal intervention, a clock in time, and what counts as rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from many_tasks import lessons

from comanip.errors import ParameterError, TrainingError
from comanip.learned.skill import learn
from comanip.reproduction import make_auto, make_skill, references_of
from comanip.skills.collaborate import LATEST, CollaborativeLaw, Compliance, Pace
from comanip.skills.compliance import untaught
from comanip.skills.reference import GAINS_PER_S, INTERVENES_M_PER_S, PhaseReference

DT = 0.01
LEADER = CollaborativeLaw.for_role("leader")


def path(duration_s=4.0, spread=None, far=0.3):
    s = np.linspace(0.0, 1.0, round(duration_s / DT) + 1)[:, None]
    x = far * s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    return PhaseReference(x, np.zeros_like(x), DT, spread=spread)


@pytest.mark.parametrize("spread_m", [0.008, 0.02])
def test_of_an_even_spread_the_gain_is_that_of_the_steady_riccati_equation(spread_m):
    made = path(spread=np.full(401, spread_m)).tracked(4.0)
    np.testing.assert_allclose(4.0 * made.gain, INTERVENES_M_PER_S / spread_m, rtol=1e-9)


def test_it_is_firm_where_lessons_agreed_and_begins_to_be_before():
    spread = np.where(np.arange(401) < 200, 0.03, 0.006)
    gain = path(spread=spread).tracked(1.0).gain
    assert gain[-1] == pytest.approx(10.0)
    assert gain[0] == pytest.approx(2.0, rel=0.01)
    assert 3.0 < gain[195] < 10.0  # it will soon matter
    assert gain[150] < gain[180] < gain[195] < gain[210]
    assert GAINS_PER_S[0] <= gain.min()
    assert gain.max() <= GAINS_PER_S[1]


def test_a_pull_moves_the_hand_less_where_lessons_agreed():
    def off(spread_m):
        pace, hand = Pace(path(spread=np.full(401, spread_m)).tracked(LEADER.attraction_per_s), LEADER, DT), np.zeros(1)
        pace.start(0.0, hand)
        worst = 0.0
        for _ in range(400):
            pace.step(hand, np.zeros(1))
            hand += DT * (pace.velocity - 0.05)  # what compliance gives way to a steady pull
            worst = max(worst, float(pace.reference.at(pace.reference.position, pace.phase)[0] - hand[0]))
        return worst

    assert off(0.006) == pytest.approx(0.05 / 10.0, rel=0.2)
    assert off(0.020) == pytest.approx(0.05 / 3.0, rel=0.2)


def test_lessons_that_do_not_say_how_far_they_differ_are_refused_by_lqt_and_tracked_evenly_by_default():
    one = learn(lessons("lift", "leader", seed=11))
    silent = replace(one, paths=tuple(replace(p, spread=np.zeros_like(p.spread)) for p in one.paths))
    with pytest.raises(TrainingError, match="lqt"):
        make_skill(silent, axes=one.axes, dt=DT, law="lqt")
    assert (make_skill(silent, axes=one.axes, dt=DT, envelope=False)._pace.reference.gain == 1.0).all()
    assert (make_skill(one, axes=one.axes, dt=DT, law="even", envelope=False)._pace.reference.gain == 1.0).all()
    default, lqt = (make_skill(one, axes=one.axes, dt=DT, law=law, envelope=False)._pace.reference for law in ("default", "lqt"))
    np.testing.assert_array_equal(default.gain, lqt.gain)
    assert np.ptp(default.gain) > 0.0


def test_an_unknown_law_is_refused_and_auto_takes_lqt():
    one = {role: learn(lessons("lift", role, seed=11)) for role in ("leader", "follower")}
    with pytest.raises(ParameterError, match="lqr"):
        make_skill(one["leader"], axes=one["leader"].axes, dt=DT, law="lqr")
    skill = make_auto(one, axes=one["leader"].axes, dt=DT, law="lqt", envelope=False)
    assert np.ptp(skill.reference.gain) > 0.0


def ends_after(reference, pull_n):
    """How long [s] a leader takes along the path while a partner pulls back with so much."""
    pace, hand = Pace(reference, LEADER, DT), np.zeros(1)
    pace.start(0.0, hand)
    for tick in range(100_000):
        if pace.ended:
            return tick * DT
        pace.step(hand, np.array([-pull_n]))
        hand = reference.at(reference.position, pace.phase)
    raise AssertionError("never")


@pytest.mark.parametrize("duration_s", [2.0, 12.0])
def test_who_is_held_back_takes_longer_but_no_more_than_so_much_longer(duration_s):
    reference = path(duration_s)
    assert ends_after(reference, 0.0) < 1.1 * duration_s + 0.3
    late = ends_after(reference, 8.0)
    assert 1.5 * duration_s < late < LATEST * duration_s + 0.1


def swung(law, hz, size_n, seconds=15.0):
    """Largest speed [m/s] of a hand that is swung with so much force, in the last quarter."""
    hand, nothing = Compliance(1, DT), np.zeros(1)
    speeds = []
    for tick in range(round(seconds / DT)):
        hand.step(law, np.array([size_n * np.sin(2.0 * np.pi * hz * tick * DT)]), nothing, nothing)
        speeds.append(abs(float(hand.velocity[0])))
    return max(speeds[-round(0.25 * seconds / DT) :])


def test_strokes_as_fast_as_people_go_are_not_shaking_and_faster_ones_are():
    law = CollaborativeLaw.for_role("follower")
    free = replace(law, shake_n=1e6)
    assert swung(law, 0.6, 9.0) > 0.95 * swung(free, 0.6, 9.0)
    assert swung(law, 5.0, 9.0) < 0.6 * swung(free, 5.0, 9.0)


def test_a_leader_in_balance_with_a_pull_at_the_end_stands_firm():
    """Attraction and compliance are both large there, and the hand rests: less than 4 mm off for a pull of 1.4 N."""
    reference = path(2.0)
    pace, hand, compliance = Pace(reference, LEADER, DT), reference.position[-1].copy(), Compliance(1, DT)
    pace.start(reference.duration_s, hand, eases=False)
    pull, nothing = np.array([-1.4]), np.zeros(1)
    for _ in range(800):
        pace.step(hand, pull)
        compliance.step(LEADER, pull, pace.velocity, nothing, going=pace.going)
        hand = hand + DT * (pace.velocity + compliance.velocity)
    assert abs(float(hand[0] - reference.position[-1][0])) < 0.004


def test_a_path_that_repeats_is_begun_at_its_beginning_by_who_starts_a_little_beside_it():
    s = np.linspace(0.0, 5.0, 600)[:, None]
    turns = PhaseReference(0.12 * np.hstack([np.sin(2 * np.pi * s), 1.0 - np.cos(2 * np.pi * s)]), np.zeros((600, 2)), 0.02)
    assert turns.entry(np.array([-0.029, -0.003])) < 0.2


def test_references_of_a_skill_have_no_gain_of_their_own():
    assert (references_of(learn(lessons("lift", "leader", seed=11)))[0].gain == 1.0).all()


def round_a_corner():
    """(N, 2): along x, and then along y, 0.3 m each in 2 s."""
    n, still = 200, np.zeros(201)
    s = minimum_jerk(n)
    return np.column_stack([np.concatenate([s, still[1:] + 0.3]), np.concatenate([still, s[1:]])])


def minimum_jerk(n):
    u = np.arange(n + 1) / n
    return 0.3 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


@pytest.mark.parametrize("turn_rad", [0.0, 0.8])
def test_how_fast_lessons_went_that_way_is_of_the_place_and_the_direction(turn_rad):
    r = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    reference = PhaseReference(round_a_corner() @ r.T, np.zeros((401, 2)), 0.01)

    def taught(position, velocity):
        return r.T @ reference.that_way(r @ np.array(position), r @ np.array(velocity))

    top = 1.875 * 0.3 / 2.0
    assert taught([0.15, 0.0], [0.1, 0.0]) == pytest.approx([top, 0.0], rel=2e-3)
    assert taught([0.15, 0.0], [-0.1, 0.0]) == pytest.approx([0.0, 0.0], abs=1e-9)  # nobody went back
    assert taught([0.3, 0.15], [0.0, 0.5]) == pytest.approx([0.0, top], rel=2e-3)
    assert taught([0.9, 0.9], [0.1, 0.0]) == pytest.approx([0.0, 0.0], abs=1e-12)  # nobody was there
    assert taught([0.15, 0.0], [0.0, 0.0]) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_follower_damps_what_swings_back_and_not_who_goes_on():
    def after(untaught):
        compliance, law = Compliance(1, 0.01), CollaborativeLaw.for_role("follower")
        compliance.velocity[0] = 0.3
        compliance.step(law, np.zeros(1), np.zeros(1), np.zeros(1), untaught=untaught)
        return compliance.velocity[0]

    law = CollaborativeLaw.for_role("follower")
    assert 0.3 / after(1.0) - 0.3 / after(0.0) == pytest.approx(0.01 * law.untaught_damping_ns_per_m / law.virtual_mass_kg)
    assert untaught(np.array([0.0, -0.2]), np.zeros(2)) == 1.0
    assert untaught(np.array([0.0, -0.2]), np.array([0.0, -0.025])) == pytest.approx(0.5)
    assert untaught(np.array([0.3, 0.4]), np.array([0.06, 0.08])) == pytest.approx(0.2)
    assert untaught(np.zeros(2), np.zeros(2)) == 1.0
    assert untaught(np.ones(2), np.ones(2)) == 0.0
