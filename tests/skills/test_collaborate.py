"""The default law: with living partners, from where it was not taught, and against wrong robots."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import MismatchError, ParameterError
from comanip.interfaces import Command, Observation
from comanip.learned.learn import learn
from comanip.reproduction import make_skill, references_of
from comanip.skills.collaborate import CollaborativeLaw
from comanip.trials import draw_case, judge, run_case, run_cases, success_interval

PARTNERS = 25


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_it_carries_the_beam_with_partners_that_were_not_used_in_teaching(skills, role):
    rng = np.random.default_rng(2024)
    verdicts = run_cases([draw_case(role, rng) for _ in range(PARTNERS)], skills, "default")
    failed = [v.failures for v in verdicts if v.failures]
    assert len(failed) <= 1, failed


def test_the_literal_law_of_the_paper_fails_with_living_partners(skills):
    """The finding that the default law answers; were it to change, the documents would be wrong."""
    rng = np.random.default_rng(5)
    verdicts = run_cases([draw_case("follower", rng) for _ in range(8)], skills, "paper")
    assert sum(v.success for v in verdicts) <= 4


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_compliance_is_passive_a_lifting_partner_never_lowers_the_hand(skills, role):
    for force in (1.0, 5.0, 20.0):
        speeds = []
        for pull in (0.0, force):
            skill = make_skill(skills[role], axes=("z",), dt=0.01, envelope=False)
            obs, command = Observation(1), Command(1)
            obs.position[:], obs.velocity[:], obs.force[:] = 0.85, 0.0, 0.0
            skill.reset(obs)
            obs.force[:] = pull
            for _ in range(20):
                skill.step(obs, command)
            speeds.append(command.velocity[0])
        assert speeds[1] > speeds[0]


def test_a_follower_left_alone_does_not_start_by_itself(skills):
    case = replace(draw_case("follower", np.random.default_rng(3)), onset_s=20.0, lift_m=0.2)
    recording = run_case(case, make_skill(skills["follower"], axes=("z",), dt=0.01))
    waiting = recording["hand.position"].time < 20.0
    assert np.abs(recording["hand.position"].values[waiting] - 0.85).max() < 0.01


def test_a_leader_repeats_the_same_lift_from_other_starts(skills):
    for start in (0.80, 0.90):
        case = draw_case("leader", np.random.default_rng(4))
        recording = run_case(case, make_skill(skills["leader"], axes=("z",), dt=0.01), start_m=start)
        ends = skills["leader"].ends
        assert ends.min() - 0.02 <= recording["hand.position"].values[-1, 0] <= ends.max() + 0.02


@pytest.mark.parametrize(("role", "offset"), [("leader", -0.5), ("leader", 0.5), *[("follower", x) for x in (-0.5, -0.15, 0.5)]])
def test_C10_a_start_outside_the_lessons_is_said_and_only_complied_with(skills, role, offset):
    start = (0.85 if offset < 0 else float(skills[role].ends.max())) + offset
    case = replace(draw_case(role, np.random.default_rng(6)), onset_s=30.0, tremor_n=0.0)
    recording = run_case(case, make_skill(skills[role], axes=("z",), dt=0.01), start_m=start)
    assert re.search("outside (what was taught|of what was taught|the workspace)", recording.metadata["notice"])
    assert np.isfinite(recording["command.velocity"].values).all()
    still = recording["hand.position"].time < 3.0
    assert np.abs(recording["hand.position"].values[still] - start).max() < 0.05


def test_a_start_among_the_lessons_has_no_notice(skills):
    recording = run_case(draw_case("leader", np.random.default_rng(6)), make_skill(skills["leader"], axes=("z",), dt=0.01))
    assert "notice" not in recording.metadata


def test_C19_a_skill_of_another_robot_refuses_to_arm(skills):
    learned = skills["leader"]
    renamed = replace(learned.model, channels=("position.y", "force.z", "velocity.z"))
    extra = replace(learned.model, channels=("position.z", "force.z", "torque.z"))
    wrong = [
        (learned, {"axes": ("x",)}, "moves axes"),
        (learned, {"axes": ("y", "z")}, "moves axes"),
        (learned, {"dt": 0.2}, "control period"),
        (learned, {"dt": float("nan")}, "control period"),
        (learned, {"role": "follower"}, "learned as 'leader'"),
        (replace(learned, dt=1.0), {}, "period of 1.0 s"),
        (replace(learned, units={"position": "mm", "force": "N", "velocity": "m/s"}), {}, "position is in 'mm'"),
        (replace(learned, model=renamed), {}, "channels are position.y"),
        (replace(learned, model=extra), {}, "torque.z"),
        (replace(learned, clock=None, paths=()), {}, "order of time"),
        (replace(learned, role=""), {}, "needs a role"),
    ]
    for skill, change, said in wrong:
        with pytest.raises(MismatchError, match=said):
            make_skill(skill, **{"axes": ("z",), "dt": 0.01, **change})


def test_the_reference_starts_and_ends_where_the_lessons_did(skills, lessons):
    for role in ("leader", "follower"):
        reference, *others = references_of(skills[role])
        assert not others
        starts = np.array([lesson.position[0, 0] for lesson in lessons[role][:5]])
        assert reference.position[0, 0] == pytest.approx(starts.mean(), abs=0.02)
        assert reference.position[-1, 0] == pytest.approx(skills[role].ends.mean(), abs=0.02)
        assert 1.0 < reference.duration_s < 3.5
        sign = -1.0 if role == "leader" else 1.0
        assert (sign * reference.force[len(reference.force) // 5 : len(reference.force) // 2] > 0.5).all()


def test_units_of_the_lessons_do_not_change_the_clock(lessons):
    from comanip.fitting.hmm import fit_hmm
    from comanip.models.clock import learn_clock

    frames = [lesson.array(lesson.channels) for lesson in lessons["leader"][:4]]
    scale = np.array([1000.0, 0.1, 1000.0])
    names = lessons["leader"][0].channels
    a = learn_clock(fit_hmm(frames, 6, channels=names).model, frames, 0.01)
    scaled = [f * scale for f in frames]
    b = learn_clock(fit_hmm(scaled, 6, channels=names).model, scaled, 0.01)
    assert b.means[:, 0] == pytest.approx(a.means[:, 0], rel=1e-5)
    assert b.means[:, 1:] == pytest.approx(a.means[:, 1:] * scale, rel=1e-5, abs=1e-6)


def test_wilson_interval_of_known_values():
    assert success_interval(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-3)
    assert success_interval(200, 200)[0] == pytest.approx(0.9812, abs=1e-3)


def test_a_verdict_names_each_failure(skills):
    case = draw_case("follower", np.random.default_rng(9))
    recording = run_case(case, make_skill(skills["follower"], axes=("z",), dt=0.01))
    assert judge(case, recording).success
    assert "missed the partner's goal" in judge(replace(case, lift_m=case.lift_m + 0.05), recording).failures
    assert "moved before the partner" in judge(replace(case, onset_s=case.onset_s + case.duration_s), recording).failures


def test_an_unknown_setting_lists_the_known_ones():
    with pytest.raises(ParameterError, match="it has: virtual_mass_kg"):
        CollaborativeLaw.for_role("leader", stiffness=3.0)


def test_position_only_lessons_make_a_skill_without_force(lessons):
    learned = learn(lessons["leader"][:5], with_force=False, role="leader")
    assert learned.model.channels == ("position.z", "velocity.z")
    case = draw_case("leader", np.random.default_rng(4))
    recording = run_case(case, make_skill(learned, axes=("z",), dt=0.01))
    assert recording["hand.position"].values[-1, 0] == pytest.approx(learned.ends.mean(), abs=0.05)
