"""The judge along the way: faultless hands pass in every task, and each defect has its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.evaluation.metrics import internal_force, log_dimensionless_jerk, vibration, widest
from comanip.recording import Channel, Recording
from comanip.tasks import TASKS, named, usual, way
from comanip.trials import draw_case, judge, paired

DT = 0.01
RUN_HERE = tuple(name for name in TASKS if not named(name).needs)


def run_of(case, change=lambda t, x: x, *, lead=None):
    """What a faultless hand would have recorded; `change` (times, places) makes a defect."""
    t = np.arange(round(case.run_s / DT)) * DT
    course = (case if case.leads else replace(case, partner="leading")).course
    if not case.leads:
        one = way(case.task, replace(usual(case.task, case.drawn.goal), onset_s=0.5))
        course, offset = one.course, case.task.start - case.start_m
    x = course.sampled(t)
    if not case.leads:  # from where it started to where lessons were
        x = x + np.minimum(t / 0.5, 1.0)[:, None] * offset
    x = change(t, x)
    v, d = np.gradient(x, DT, axis=0), len(case.axes)
    still = np.zeros_like(x)
    signals = {"hand.position": case.start_m + x, "hand.velocity": v, "hand.acceleration": np.gradient(v, DT, axis=0)}
    signals |= {"hand.true_force": still, "partner.force": still + case.carried, "beam.tilt": still}
    return Recording({name: Channel(t, values, axes=case.axes if d else ()) for name, values in signals.items()})


def cases(name, role, n=6):
    rng = np.random.default_rng(3)
    return [draw_case(role, rng, task=name) for _ in range(n)]


@pytest.mark.parametrize("role", ["leader", "follower"])
@pytest.mark.parametrize("name", RUN_HERE)
def test_a_faultless_hand_passes(name, role):
    for case in cases(name, role):
        goals = case.task.goals or ("",)
        ends = np.array([case.task.start + way(case.task, usual(case.task, goal)).course.end for goal in goals])
        assert judge(case, run_of(case), taught_ends_m=None if case.leads else ends).failures == ()


def named_defect(name, role, change, **about):
    return judge(cases(name, role, 1)[0], run_of(cases(name, role, 1)[0], change), **about).failures


def straight(t, x):
    """The chord of the way."""
    return x[-1] * (np.linalg.norm(x, axis=1) / np.linalg.norm(x[-1]))[:, None]


def test_defects_have_their_names():
    assert "other number of cycles" in named_defect("saw", "follower", lambda t, x: 0.3 * x)
    assert named_defect("saw", "follower", lambda t, x: 0.9 * x) == ()
    assert "left out a place on the way" in named_defect("lift-hold-lower", "follower", lambda t, x: 0.0 * x)
    assert "rest not kept" in named_defect("lift-hold-lower", "follower", lambda t, x: 0.0 * x)
    assert "hit an obstacle" in named_defect("round-the-corner", "follower", straight)
    assert "missed the taught place" in named_defect("slide", "leader", lambda t, x: 0.8 * x, taught_ends_m=np.array([[0.8]]))
    assert "too slow" in named_defect("slide", "leader", lambda t, x: x[-1] * np.minimum(t / 7.8, 1.0)[:, None])
    assert named_defect("round-the-corner", "leader", lambda t, x: x, lessons_clearance_m=0.5) == (
        "nearer to an obstacle than any lesson",
    )


def test_cycles_are_counted_also_beyond_those_asked_for():
    task = named("saw")
    case = replace(draw_case("leader", np.random.default_rng(0), task=task), start=tuple(task.start))
    for done in (4, 5, 6):
        drawn = replace(task, phases=(replace(task.phases[0], cycles=float(done)),))
        course = way(drawn, replace(usual(drawn), onset_s=0.5)).course
        recording = run_of(case, lambda t, x, course=course: course.sampled(t))
        verdict = judge(case, recording)
        assert verdict.cycles == done
        assert ("other number of cycles" in verdict.failures) == (done != 5)


def test_a_rest_is_measured_as_the_meant_way_would_be():
    task = named("lift-hold-lower")
    case = replace(draw_case("leader", np.random.default_rng(0), task=task), start=tuple(task.start))
    for rest, good in ((2.0, True), (2.8, True), (3.5, False), (0.5, False)):
        course = way(task, replace(usual(task), onset_s=0.5, rest=rest / 2.0)).course
        verdict = judge(case, run_of(case, lambda t, x, course=course: course.sampled(t)))
        assert verdict.rest_error_s == pytest.approx(abs(rest - 2.0), abs=0.05)
        assert ("rest not kept" not in verdict.failures) == good


def test_between_two_shelves_nobody_was_taught_to_stop():
    task = named("two-shelves")
    case = replace(draw_case("leader", np.random.default_rng(0), task=task), start=tuple(task.start))
    ends = task.start + np.array([[0.14], [0.16], [0.34], [0.36]])
    for height, good in ((0.15, True), (0.35, True), (0.25, False)):
        verdict = judge(case, run_of(case, lambda t, x, h=height: x / x[-1] * h), taught_ends_m=ends)
        assert verdict.success == good


@pytest.mark.parametrize("turn", [0.3, 1.0, 2.5])
def test_no_measure_depends_on_how_axes_are_turned(turn):
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 300, 2))
    u = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert widest(one @ u) == pytest.approx(widest(one))
    assert vibration(one @ u, DT) == pytest.approx(vibration(one, DT))
    assert log_dimensionless_jerk(one @ u, DT) == pytest.approx(log_dimensionless_jerk(one, DT))
    assert internal_force(one @ u, other @ u) == pytest.approx(internal_force(one, other) @ u)


def test_one_axis_among_two_measures_as_alone():
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 300))
    wide, wider = (np.column_stack([x, 0.0 * x]) for x in (one, other))
    assert internal_force(wide, wider)[:, 0] == pytest.approx(internal_force(one, other))
    assert vibration(wide, DT) == pytest.approx(vibration(one, DT))
    assert widest(wide) == pytest.approx(np.ptp(one))


def test_vibration_is_what_is_faster_than_people():
    t = np.arange(2000) * DT
    slow, fast = 5.0 * np.sin(2 * np.pi * 0.5 * t), 2.0 * np.sin(2 * np.pi * 8.0 * t)
    assert vibration(slow, DT) < 0.05
    assert vibration(slow + fast, DT) == pytest.approx(np.sqrt(2.0), rel=0.03)
    assert vibration(slow + fast, DT, np.zeros(2000, bool)) == 0.0


def test_paired_differences_know_how_sure_they_are():
    case = cases("lift", "follower", 1)[0]
    verdict = judge(case, run_of(case))._replace(duration_s=2.0)
    rng = np.random.default_rng(0)
    first = [verdict._replace(effort_n2s=float(e)) for e in rng.normal(10.0, 3.0, 60)]
    second = [v._replace(effort_n2s=v.effort_n2s + float(more)) for v, more in zip(first, rng.normal(1.0, 0.5, 60), strict=True)]
    second[0] = second[0]._replace(failures=("peak force",), effort_n2s=1e9)
    apart = paired(first, second, np.random.default_rng(0))
    mean, low, high = apart["effort"]
    assert low < mean < high < 0.0
    assert mean == pytest.approx(-1.0, abs=0.25)
    assert high - low == pytest.approx(2 * 1.96 * 0.5 / np.sqrt(59), rel=0.3)
    assert apart["both"] == 59
    assert apart["success"][0] == pytest.approx(1 / 60)
    assert apart["time_s"] == [0.0, 0.0, 0.0]
