"""The table of kinds: whole, split once, and each row does what it says, along any axes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import comanip
from comanip.errors import ParameterError
from comanip.interfaces import Partner
from comanip.people import KINDS, Body, Course, draw_body, for_tuning, make, names_of, planned
from comanip.people.kinds import JUDGING, LEADING, TUNING
from comanip.people.plans import lasting
from comanip.people.rail import on_rail

PEOPLE = [name for name, kind in KINDS.items() if not kind.robot]
PLAYED = [(name, role) for name in PEOPLE for role in KINDS[name].roles]
EXPERIMENTS = Path(comanip.__file__).parent / "experiments"
LIFT = Course(((1.0, 2.0, (0.3,)),))
ROUND = Course(((1.0, 1.5, (0.2, 0.0, 0.0)), (2.0, 1.5, (0.0, 0.1, 0.2))))
GOES_THERE = [n for n in PEOPLE if LEADING in KINDS[n].roles and KINDS[n].behaviour == "steady"]


def somebody(name, role, course=LIFT, axes=("z",), gravity=(-9.8,), seed=0):
    rng = np.random.default_rng(seed)
    body = draw_body(rng, load_kg=2.0, axes_gravity=gravity)
    return make(name, role=role, course=planned(name, course, rng), body=body, axes=axes, rng=rng)


def test_there_are_at_least_25_kinds_each_with_a_source_and_half_of_them_judge():
    assert len(KINDS) >= 25
    assert all(kind.source and kind.about and kind.roles for kind in KINDS.values())
    tuning, judging = names_of(TUNING), names_of(JUDGING)
    assert set(tuning) | set(judging) == set(KINDS) == set(names_of("all"))
    assert not set(tuning) & set(judging)
    assert 0.4 < len(judging) / len(KINDS) < 0.6
    for role in ("leading", "following"):
        play = [sum(role in KINDS[n].roles for n in names) for names in (tuning, judging)]
        assert min(play) > 0.4 * sum(play), (role, play)


def test_a_kind_that_judges_is_refused_for_tuning():
    assert for_tuning() == names_of(TUNING)
    with pytest.raises(ParameterError, match="'Hill muscles' judges; numbers are chosen on: plain"):
        for_tuning(["plain", "Hill muscles"])
    with pytest.raises(ParameterError, match="judges"):
        for_tuning("all")


def chooses_numbers_on(text):
    """Kinds or groups that a script names and that judge."""
    named = [name for name in (*names_of(JUDGING), JUDGING, "all") if re.search(rf"""['"]{re.escape(name)}['"]""", text)]
    return named if "people" in text else []


def test_no_script_that_chooses_numbers_names_a_judging_kind():
    scripts = [path for path in EXPERIMENTS.glob("tun*.py")]
    assert scripts, "experiments/tuning.py is where numbers are chosen"
    assert {path.name: chooses_numbers_on(path.read_text()) for path in scripts} == {path.name: [] for path in scripts}
    assert all("for_tuning(" in path.read_text() for path in scripts)
    assert chooses_numbers_on('from comanip.people import names_of\nnames_of("all")') == ["all"]
    assert chooses_numbers_on('people = ["tremor"]') == ["tremor"]


@pytest.mark.parametrize(("name", "role"), PLAYED)
def test_each_plays_along_any_axes_and_leaves_the_object_alone_at_first(name, role):
    person = somebody(name, role, ROUND, ("x", "y", "z"), (0.0, 0.0, -9.8))
    assert isinstance(person, Partner)
    again, out, other = somebody(name, role, ROUND, ("x", "y", "z"), (0.0, 0.0, -9.8)), np.zeros(3), np.zeros(3)
    here = np.array([0.4, 0.0, 0.9])
    for one in (person, again):
        one.reset(here)
    forces = []
    for n in range(800):
        person.force(n * 0.001, here, np.zeros(3), out)
        again.force(n * 0.001, here, np.zeros(3), other)
        np.testing.assert_array_equal(out, other)  # the same draw is the same person
        forces.append(out.copy())
    off = np.array(forces) - [0.0, 0.0, 9.8]
    shaken = KINDS[name].criteria.get("residual_n", 0.0) > 4.0
    assert np.abs(off.mean(axis=0)).max() < (2.5 if shaken else 0.6)


@pytest.mark.parametrize("name", GOES_THERE)
def test_who_leads_brings_a_free_object_where_it_means_to_be(name):
    """2 kg with a little damping and no robot. Somebody who yields to a mass that resists stops short: no other does."""
    person = somebody(name, LEADING, seed=3)
    person.reset(np.zeros(1))
    out, x, v, way = np.zeros(1), 0.0, 0.0, []
    for n in range(round(1000 * (person.stop_s + 2.5))):
        person.force(n * 0.001, np.array([x]), np.array([v]), out)
        v += 0.001 * (out[0] - 9.8 - 6.0 * v) / 2.0
        x += 0.001 * v
        way.append(x)
    moved = np.flatnonzero(np.abs(np.array(way)) > 0.02)[0] * 0.001
    assert moved > person.onset_s
    assert person.goal_m == pytest.approx(0.3, abs=1e-6)
    assert np.mean(way[-500:]) == pytest.approx(person.goal_m, abs=0.04 if name in ("gives way", "re-grasps") else 0.02)


@pytest.mark.parametrize("name", [n for n in PEOPLE if LEADING in KINDS[n].roles])
def test_a_plan_keeps_the_path_and_its_end(name):
    course, rng = ROUND, np.random.default_rng(5)
    own = planned(name, course, rng)
    times = np.linspace(own.start_s, own.stop_s, 400)
    path, usual = own.sampled(times), course.sampled(np.linspace(course.start_s, course.stop_s, 2000))
    far = np.array([np.linalg.norm(usual - p, axis=1).min() for p in path]).max()
    assert far < (0.03 if name == "fine-tunes" else 0.002)
    np.testing.assert_allclose(own.end, np.zeros(3) if name == "reverses" else course.end, atol=1e-6)
    assert np.abs(own.at(own.start_s - 0.1)[0]).max() == 0.0
    np.testing.assert_array_equal(own.at(own.stop_s + 9.0)[0], own.at(own.stop_s)[0])


def test_timing_is_as_the_rows_say():
    rng = np.random.default_rng(0)
    plans = {name: [planned(name, LIFT, rng) for _ in range(50)] for name in ("snatches", "crawls", "starts late", "ratchets")}
    assert all(0.6 <= lasting(c) <= 0.9 for c in plans["snatches"])
    assert all(c.along(0).at(c.start_s + 0.5 * lasting(c))[1] == pytest.approx(0.025 / 0.85, rel=0.02) for c in plans["crawls"])
    assert all(7.5 <= c.start_s <= 12.0 for c in plans["starts late"])
    for course in plans["ratchets"]:
        along = course.along(0)
        speed = np.array([along.at(t)[1] for t in np.arange(course.start_s, course.stop_s, 0.01)])
        stands = np.flatnonzero((speed[1:-1] < 1e-4) & (np.arange(len(speed) - 2) > 5))
        assert len(stands) >= 2 * 15  # two pauses of 0.15 s at least


@pytest.mark.parametrize(("name", "least", "most"), [("tremor", 1.0, 2.5), ("trembles", 0.25, 0.8), ("plain", 0.0, 0.3)])
def test_tremor_shakes_a_rail(name, least, most):
    force = on_rail(name, "following", seed=1)["hand.true_force"].values[:900, 0]
    assert least < force.std() < most


def test_a_weak_person_is_weak_and_a_strong_one_strong():
    ends = {n: on_rail(n, LEADING, seed=2)["hand.true_force"].values[-500:].mean() for n in ("child", "plain", "strong")}
    assert ends["child"] < 8.0 < ends["plain"] < 60.0 < ends["strong"]


def test_letting_go_takes_its_time_and_ends_with_an_open_hand():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        body = Body(carried_n=(9.8,))
        person = make("releases slowly", role=LEADING, course=LIFT, body=body, axes=("z",), rng=rng, event_s=3.0)
        person.reset(np.zeros(1))
        out, holds = np.zeros(1), []
        for n in range(3200):
            person.force(n * 0.001, np.zeros(1), np.zeros(1), out)
            holds.append(person.habits[0].hold)
        opening = 3.0 - 0.001 * np.flatnonzero(np.array(holds) < 1.0)[0]
        assert 0.19 < opening < 2.01
        assert holds[2950] > 0.0
        assert out[0] == 0.0


def test_nobody_lets_go_while_the_object_is_weighed():
    for seed in range(10):
        rng, body, out = np.random.default_rng(seed), Body(carried_n=(9.8,)), np.zeros(1)
        person = make("releases slowly", role=LEADING, course=LIFT, body=body, axes=("z",), rng=rng, event_s=1.2)
        person.reset(np.zeros(1))
        for n in range(1250):
            person.force(n * 0.001, np.zeros(1), np.zeros(1), out)
            assert n > 500 or person.habits[0].hold == 1.0
        assert person.habits[0].hold == 0.0


def test_somebody_who_levels_pushes_against_what_it_sees_and_not_at_once():
    person = somebody("levels by eye", "following", seed=1)
    person.reset(np.zeros(1))
    out, forces = np.zeros(1), []
    for n in range(1000):
        person.see([0.004 if n >= 300 else 0.0], [0.0])
        person.force(n * 0.001, np.zeros(1), np.zeros(1), out)
        forces.append(out[0] - person.body.carried_n[0])
    assert abs(np.mean(forces[300:440])) < 0.5
    assert np.mean(forces[900:]) < -4.0


@pytest.mark.parametrize(
    ("about", "said"),
    [
        ({"name": "ghost"}, "kind of person 'ghost' is unknown; there are: plain"),
        ({"name": "sticks"}, "'sticks' plays following only; got role 'leading'"),
        ({"course": None}, "cannot lead without a course"),
        ({"axes": ("x", "z")}, "a body that carries along 1 axes cannot hold 2"),
        ({"name": "another robot"}, "needs a skill"),
    ],
)
def test_what_cannot_be_is_said(about, said):
    given = {
        "name": "plain",
        "role": LEADING,
        "course": LIFT,
        "body": Body(),
        "axes": ("z",),
        "rng": np.random.default_rng(0),
        **about,
    }
    with pytest.raises(ParameterError, match=said):
        make(given.pop("name"), **given)


def test_no_body_without_strength():
    with pytest.raises(ParameterError, match="a body's arm_kg must be positive; got 0"):
        Body(arm_kg=0.0)
