"""What is chosen on the lessons: the right input where it matters, never by looking at what is foreseen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.evaluation import foreseeing, prediction, ways
from comanip.evaluation.foreseeing import UNCHOSEN, Rule, foreseer, leaked
from comanip.evaluation.ways import ONSET, START
from comanip.learned.skill import learn


def driven(lessons, of_force, seed=0):
    """Lessons in which velocity is exactly a function of the force (T, 1): pushes of random height and length."""
    rng, made = np.random.default_rng(seed), []
    for i, lesson in enumerate(lessons):
        t = np.arange(300) * lesson.dt
        f = np.sum([rng.uniform(1, 4) * np.exp(-(((t - rng.uniform(0.5, 2.5)) / 0.15) ** 2)) for _ in range(3)], axis=0)[:, None]
        v = of_force(replace(lesson, signals={"position": f, "force": f, "velocity": f}, signal_axes={}))
        x = np.cumsum(v, axis=0) * lesson.dt
        made.append(replace(lesson, name=f"{i}", signals={"position": x, "force": f, "velocity": v}, signal_axes={}))
    return made


def test_a_leak_is_a_first_order_low_pass_from_its_first_value(lessons):
    lesson = lessons["leader"][0]
    step = replace(lesson, signals={**lesson.signals, "force": 2.0 * (np.arange(len(lesson)) >= 100)[:, None]})
    felt = leaked(step).signals["leak"][:, 0]
    assert (felt[:100] == 0.0).all()
    assert felt[100 + 29] == pytest.approx(2.0 * (1.0 - np.exp(-1.0)), rel=1e-9)  # 0.3 s are 30 frames, the first one included
    constant = replace(lesson, signals={**lesson.signals, "force": np.full_like(lesson.force, 3.0)})
    assert leaked(constant).signals["leak"] == pytest.approx(3.0)


def test_lessons_that_answer_through_a_leak_choose_it_and_are_foreseen(lessons):
    made = driven(lessons["follower"], lambda x: 0.1 * leaked(x).signals["leak"])
    learned = learn(made[:5])
    found = foreseer(learned, made[:5])
    assert sum(w.item() for rule, w in found.rules.items() if rule.leak) > 0.8
    ours = prediction.predict(learned, made[5], made[:5], found)
    assert ours.one_step_velocity_r2 > 0.99
    assert ours.skill_velocity_r2 < ours.one_step_velocity_r2
    assert ours.free_run_position_rmse_m < ours.skill_path_rmse_m


def test_lessons_that_answer_the_force_of_the_moment_do_not_lose_by_the_choice(lessons):
    made = driven(lessons["follower"], lambda x: 0.1 * x.force)
    learned = learn(made[:5])
    ours = prediction.predict(learned, made[5], made[:5], foreseer(learned, made[:5]))
    assert ours.one_step_velocity_r2 > ours.skill_velocity_r2 - 0.01


def test_the_plain_rule_is_the_skills_own_model(lessons):
    learned = learn(lessons["leader"][:5])
    (plain,) = foreseeing.velocities_of(learned.model, lessons["leader"][5], learned, [0.0])
    assert plain == pytest.approx(prediction.one_step_velocity(learned, lessons["leader"][5]), abs=1e-12)


def test_a_choice_on_one_lesson_is_a_stated_one(lessons):
    with pytest.warns(UserWarning, match="only one demonstration"):
        learned = learn(lessons["leader"][:1])
    found = foreseer(learned, lessons["leader"][:1])
    assert list(found.rules) == [UNCHOSEN]
    assert list(found.weights) == [ONSET]  # the motion follows its force at once
    without = learn(lessons["leader"][:3], with_force=False)
    assert list(foreseer(without, lessons["leader"][:3]).rules) == [Rule(False, 0.0)]


def test_of_one_lesson_whose_force_comes_behind_its_motion_the_time_is_believed(lessons):
    one = lessons["leader"][0]
    late = replace(one, signals={**one.signals, "force": np.roll(one.force, 150, axis=0)})
    early = replace(one, signals={**one.signals, "force": np.concatenate([one.force[100:], 0 * one.force[:100]])})
    assert ways.begins([one]) == ONSET
    assert ways.begins([late]) == START
    assert ways.begins([early]) in (ONSET, START)


def test_nothing_of_the_lesson_left_out_is_chosen_by(lessons, monkeypatch):
    seen = []
    real = prediction.foreseer
    monkeypatch.setattr(
        prediction, "foreseer", lambda learned, others, **k: seen.append([x.sha256 for x in others]) or real(learned, others, **k)
    )
    found = prediction.leave_one_out(lessons["leader"][:3], choose=True, n_states=4)
    for lesson, others in zip(lessons["leader"][:3], seen, strict=True):
        assert lesson.sha256 not in others
    assert all(p.chosen for p in found)


def test_velocity_and_path_see_nothing_that_they_foresee(lessons):
    found = foreseer(learn(lessons["follower"][:4]), lessons["follower"][:4])
    lesson = lessons["follower"][5]
    v, x = np.array(lesson.velocity), np.array(lesson.position)
    v[200:], x[1:] = 5.0, x[1:] + 0.1
    for leak in (False, True):
        one = replace(found, rules={Rule(leak, 0.0): np.ones(1)})
        other = replace(lesson, signals={**lesson.signals, "velocity": v})
        assert one.velocity(other)[:201] == pytest.approx(one.velocity(lesson)[:201], abs=1e-12)
    assert len(found.ways) == 10
    for way in found.ways:
        one = replace(found, weights={way: np.ones(1)})
        assert (one.path(replace(lesson, signals={**lesson.signals, "position": x, "velocity": v})) == one.path(lesson)).all(), (
            way
        )
    felt = np.array(lesson.force)
    felt[200:] += 5.0
    later = replace(lesson, signals={**lesson.signals, "force": felt})
    for way in found.ways:
        one = replace(found, weights={way: np.ones(1)})
        assert one.path(later)[:200] == pytest.approx(one.path(lesson)[:200], abs=1e-12), way


@pytest.mark.parametrize("spring", [False, True])
def test_a_mass_in_a_damper_is_foreseen_exactly_by_its_answers(lessons, spring):
    """2 kg, 5 N s/m, on a spring of 20 N/m, in two turned axes, by Euler's steps."""
    rng, made = np.random.default_rng(1), []
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    for i in range(3):
        t = np.arange(300) * 0.01
        f = np.stack([rng.uniform(1, 4) * np.sin(2 * np.pi * rng.uniform(0.2, 0.6) * t) for _ in range(2)], axis=1)
        x, v = np.zeros((300, 2)), np.zeros((300, 2))
        for k in range(300):
            before, at = (v[k - 1], x[k]) if k else (np.zeros(2), np.zeros(2))
            v[k] = before + 0.01 / 2.0 * (f[k] - 5.0 * before - 20.0 * spring * at)
            if k < 299:
                x[k + 1] = x[k] + 0.01 * v[k]
        signals = {"position": x @ turn.T, "force": f @ turn.T, "velocity": v @ turn.T}
        made.append(replace(lessons["leader"][0], name=f"{i}", axes=("x", "y"), signals=signals, signal_axes={}))
    path = ways.answering(made[:2], spring)(made[2])
    assert np.abs(path - made[2].position).max() < 0.01 * np.abs(made[2].position).max()
