"""Trials with kinds of people: the same draws for all, the kind's own criteria, vibration and time, and what is printed."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from math import inf

import numpy as np
import pytest
from test_judging import ENDS, FOLLOWING, LEADING, run_of

from comanip.interfaces import Observation
from comanip.people import KINDS
from comanip.recording import Channel, Recording
from comanip.trials import Bounds, Case, bounds, draw_case
from comanip.trials.people import (
    IN_TIME_S,
    LED_S,
    USUAL,
    PersonCase,
    body_of,
    criteria_of,
    draw_people,
    judged,
    meet,
    meet_all,
    summary,
)
from comanip.trials.running import estimator_for
from forked import run as shell
from pictures import is_drawn

KNOWN = {f.name for f in fields(Bounds)} | {"vibration_n", "time_s"}


def of_kind(kind, case=FOLLOWING, **about):
    own = {f.name: getattr(case, f.name) for f in fields(Case)}
    return PersonCase(**{**own, "behaviour": KINDS[kind].behaviour, "kind": kind, **about})


def test_every_kind_meets_the_same_draws():
    plain, strong = (draw_people("follower", kind, 4, seed=3) for kind in ("plain", "strong"))
    assert [replace(case, kind="plain") for case in strong] == plain
    assert [case.seed for case in plain] != [case.seed for case in draw_people("follower", "plain", 4, seed=4)]


def test_nobody_plays_what_it_cannot():
    assert draw_people("leader", "snatches", 3, seed=0) == []
    assert draw_people("follower", "sticks", 3, seed=0) == []
    assert all(case.leads for case in draw_people("auto", "snatches", 5, seed=0))
    assert not any(case.leads for case in draw_people("auto", "sticks", 5, seed=0))
    assert {case.leads for case in draw_people("auto", "plain", 12, seed=0)} == {True, False}


def test_arms_are_as_wide_as_said_and_damped_as_drawn():
    rng = np.random.default_rng(0)
    bodies = [body_of(draw_case("follower", rng)) for _ in range(200)]
    for name, low, high in (("arm_kg", 0.5, 2.5), ("grip_n_per_m", 1e3, 4e3), ("force_limit_n", 60, 150), ("delay_s", 0.1, 0.25)):
        values = np.array([getattr(body, name) for body in bodies])
        assert low <= values.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < values.max() <= high
    assert all(0.29 < body.ratio < 0.81 for body in bodies)


@pytest.mark.parametrize("kind", KINDS)
def test_criteria_are_replaced_and_never_dropped(kind):
    """Each is a bound that is known, and looser only where it is stated; a goal of inf only where nobody means one."""
    own = KINDS[kind].criteria
    assert set(own) <= KNOWN
    part = "leading" if "leading" in KINDS[kind].roles else "following"
    case = of_kind(kind, replace(FOLLOWING if part == "leading" else LEADING, partner=part))
    asked, usual = criteria_of(case), bounds(case)
    assert asked.within.peak_n < inf or kind == "releases slowly"
    assert asked.vibration_n < inf or KINDS[kind].behaviour in ("lets go", "blocks", "reverses", "changes role")
    for name in own:
        if name in ("vibration_n", "time_s") or usual.goal == "taught":
            continue
        assert getattr(asked.within, name) != getattr(usual, name) or own[name] == getattr(usual, name)


def test_the_taught_goal_stays_whatever_the_partner_is():
    following = of_kind("tires", replace(LEADING, role="leader"))
    assert criteria_of(following).within.end_m == bounds(LEADING).end_m == 0.02
    assert criteria_of(of_kind("tires")).within.end_m == 0.05


@pytest.mark.parametrize(("newtons", "said"), [(1.0, ()), (1.3, ("vibration",))])
def test_a_force_that_shakes_while_the_hand_moves_is_a_failure(newtons, said):
    """0.8 N rms is an amplitude of 1.13 N; at 8 Hz all but 1 % of it passes."""
    case = of_kind("plain")
    shaking = run_of(case, force=lambda t: newtons * np.sin(2.0 * np.pi * 8.0 * t))
    met = judged(case, shaking, taught_ends_m=ENDS)
    assert met.failures == said
    assert met.vibration_n == pytest.approx(newtons / np.sqrt(2.0), rel=0.15)


def test_shaking_before_and_after_the_motion_is_not_vibration_in_motion():
    case = of_kind("plain")
    rests = run_of(case, force=lambda t: np.where((t < 0.8) | (t > 3.6), 2.0 * np.sin(50.0 * t), 0.0))
    assert judged(case, rests, taught_ends_m=ENDS).vibration_n < 0.2


@pytest.mark.parametrize(("lasts", "said"), [(3.0, ()), (5.8, ("too slow",))])
def test_a_motion_that_does_not_end_in_time_is_a_failure(lasts, said):
    case = of_kind("plain", FOLLOWING)  # 2 s are planned
    met = judged(case, run_of(case, duration=lasts, lasts=9.0), taught_ends_m=ENDS)
    assert met.failures == said
    assert met.time_s == pytest.approx(0.621 * lasts, rel=0.02)  # 27 of 30 cm of a minimum jerk
    assert criteria_of(case).time_s == 2.0 + IN_TIME_S
    assert criteria_of(of_kind("plain", LEADING)).time_s == LED_S


@pytest.mark.parametrize(("asked_m", "said"), [(0.018, ()), (0.03, ("too slow",))])
def test_who_was_asked_at_the_end_and_stayed_had_arrived(asked_m, said):
    """An offer there moves the hand a little, and back."""
    case = of_kind("plain", FOLLOWING)
    rests = run_of(case, duration=2.0, lasts=9.0)
    hand = rests["hand.position"]
    asked = np.where((hand.time > 6.0) & (hand.time < 7.0), asked_m * np.sin(np.pi * hand.time) ** 2, 0.0)[:, None]
    moved = Recording({**rests.channels, "hand.position": replace(hand, values=hand.values + asked)})
    assert judged(case, moved, taught_ends_m=ENDS).failures == said


def test_what_a_kind_makes_of_the_plan_is_what_it_is_judged_by():
    late = of_kind("starts late")
    assert late.course.start_s >= 7.5
    assert late.run_s > late.course.start_s + 2.0
    crawl = of_kind("crawls")
    assert crawl.stop_s == pytest.approx(1.0 + 0.3 / 0.025, abs=0.01)
    assert of_kind("releases slowly").event_s == pytest.approx(2.0)
    assert of_kind("reverses").course.end == pytest.approx(0.0, abs=1e-9)


def test_a_run_is_the_same_for_any_number_of_processes(skills):
    cases = [case for kind in ("plain", "another robot") for case in draw_people("follower", kind, 1, seed=5)]
    one, two = (meet_all(cases, skills, "default", workers=n) for n in (1, 2))
    assert repr(one) == repr(two)  # NaN is never equal to itself


def test_the_arm_is_in_the_loop(skills):
    """Between the intent and the object: the partner's force is not what an arm without mass would exert."""
    (case,) = draw_people("follower", "heavy arm", 1, seed=5)
    recording, met = meet(case, skills, "default")
    assert met.verdict.end_error_m < 0.03
    usual = meet(draw_people("follower", USUAL, 1, seed=5)[0], skills, "default")[0]
    assert not np.allclose(recording["partner.force"].values[:300], usual["partner.force"].values[:300])


def test_a_heavy_arm_and_a_late_sensor_do_not_make_the_loop_shake(skills):
    """2.5 kg on a grip of 4 kN/m, force 20 ms late: with a force estimate of 15 Hz they shake at 6-8 Hz, 1.8 N rms."""
    cases = [replace(case, sensor_delay_s=0.020) for case in draw_people("follower", "heavy arm", 6, seed=11)]
    shakes = [one.vibration_n for one in meet_all(cases, skills, "default")]
    assert np.median(shakes) < 0.7
    assert max(shakes) < 1.0


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.02, 0.05])
def test_the_force_is_estimated_as_fast_as_the_control_rate_allows(dt):
    """A step of the sensor's force has come to half within a third of its period at 15 Hz, or within four ticks."""
    estimator, obs = estimator_for(FOLLOWING, dt), Observation(1)
    obs.velocity[:], obs.sensor_force[:] = 0.0, -9.80665
    for _ in range(round(0.4 / dt)):
        estimator.step(obs)
    obs.sensor_force[:] += 1.0
    ticks = 0
    while ticks < 100:
        estimator.step(obs)
        ticks += 1
        if obs.force[0] > 0.5:
            break
    assert ticks * dt <= max(0.015, 4.0 * dt)


def test_a_diverged_run_is_a_failure():
    case = of_kind("plain")
    bad = run_of(case).with_channels({"hand.true_force": Channel(np.arange(3) * 0.01, np.full(3, np.nan))})
    with np.errstate(invalid="ignore"):
        met = judged(case, bad, taught_ends_m=ENDS)
    assert met.failures == ("diverged",)
    assert met.vibration_n == inf


def test_a_summary_counts_each_kind_and_all_of_them():
    cases = [of_kind("plain"), of_kind("plain"), of_kind("tires")]
    shaken = judged(cases[0], run_of(cases[0], force=lambda t: 3.0 * np.sin(50.0 * t)), taught_ends_m=ENDS)
    calm = judged(cases[1], run_of(cases[1]), taught_ends_m=ENDS)
    found = summary(cases, [shaken, calm, calm])
    assert found["success"] == pytest.approx(2 / 3)
    assert {kind: row["success"] for kind, row in found["kinds"].items()} == {"plain": 0.5, "tires": 1.0}
    assert found["kinds"]["plain"]["failures"] == {"vibration": 1}
    assert found["kinds"]["tires"]["vibration_n"] < 0.8


def test_the_command_line_tries_a_law_with_kinds(tmp_path):
    words = ("--people", "plain", "sticks", "usual", "--role", "leader", "--partners", "1", "--workers", "1", "--json")
    done = shell("trial", *words, cwd=tmp_path)
    found = json.loads(done.stdout)["leader"]["default"]
    assert set(found["kinds"]) == {"plain", "sticks", "usual"}
    assert {"success", "interval", "effort", "kinds"} <= set(found)
    for row in found["kinds"].values():
        assert {"success", "effort", "vibration_n", "time_s"} <= set(row)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("trial", "--people", "ghosts"), "kind of person 'ghosts' is unknown; there are: plain"),
        (("trial", "--people", "sticks", "--role", "follower"), "none of them can be the partner of a robot as follower"),
        (("trial", "--people", "plain", "--partners-from", "x.py"), "--partners-from does not go with --people"),
        (("people", "ghost"), "kind of person 'ghost' is unknown; there are: plain"),
        (("people", "--plot", "x.png"), "--plot draws one kind"),
    ],
)
def test_mistakes_are_said_in_one_line(tmp_path, words, said):
    done = shell(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_people_lists_all_and_plays_one(tmp_path):
    listed = json.loads(shell("people", "--json", cwd=tmp_path).stdout)
    assert set(listed) == set(KINDS)
    assert all({"source", "split", "roles", "about", "criteria"} <= set(row) for row in listed.values())
    played = json.loads(shell("people", "snatches", "--plot", "snatch.png", "--json", cwd=tmp_path).stdout)
    assert played["rail"]["leading"]["most_n"] > 5.0
    assert is_drawn(tmp_path / "snatch.png")
