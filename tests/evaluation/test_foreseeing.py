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


def test_a_ridge_is_a_share_of_the_inputs_own_variance_in_any_unit(lessons):
    """Forces a thousand times as large, in a model learned from them: the same velocity at every ridge, another at each."""
    large = [replace(x, signals={**x.signals, "force": 1e3 * x.force}) for x in lessons["follower"][:4]]
    one, other = learn(lessons["follower"][:4], n_states=4), learn(large, n_states=4)
    ridges = [0.0, 0.05, 0.2]
    said = foreseeing.velocities_of(one.model, lessons["follower"][3], one, ridges)
    again = foreseeing.velocities_of(other.model, large[3], other, ridges)
    for a, b in zip(said, again, strict=True):
        assert b == pytest.approx(a, abs=1e-4)
    assert np.abs(said[1] - said[0]).max() > 1e-3
    by_rule = foreseeing._by_rules([Rule(False, r) for r in ridges], one, None, lessons["follower"][3])
    assert all((a == b).all() for a, b in zip(by_rule, said, strict=True))


def test_what_weighs_ways_has_not_seen_the_lesson_and_doubt_is_of_lessons(lessons, monkeypatch):
    taught, real = [], foreseeing.ways_of
    monkeypatch.setattr(foreseeing, "ways_of", lambda a, b, some: taught.append({id(x) for x in some}) or real(a, b, some))
    some = lessons["follower"][:4]
    learned = learn(some, n_states=4)
    doubted = foreseer(learned, some).weights
    assert [[id(x) in one for one in taught].count(False) for x in some] == [
        1,
        1,
        1,
        1,
    ]  # all ways once on all, once without each
    monkeypatch.setattr(foreseeing, "DOUBT", 0.0)
    sure = foreseer(learned, some).weights
    assert sum(w.sum() for w in doubted.values()) < sum(w.sum() for w in sure.values())


def test_the_skills_own_way_is_of_each_lesson_its_own(lessons):
    way = ways.the_skills(learn(lessons["follower"][:3], n_states=4))[ways.SKILLS]
    assert not np.array_equal(way(lessons["follower"][4])[:200], way(lessons["follower"][5])[:200])


def test_a_bias_of_the_force_moves_nothing_where_place_comes_from_pushes(lessons):
    way, lesson = ways.pushed(lessons["follower"][:3], True), lessons["follower"][4]
    biased = replace(lesson, signals={**lesson.signals, "force": lesson.force + 5.0})
    assert way(biased) == pytest.approx(way(lesson), abs=1e-9)


def test_a_hand_that_answers_ever_faster_in_lessons_does_not_run_away(lessons):
    """v grows by 2 % a frame in every lesson: after a push, what was learned goes on, but not faster and faster."""
    made = []
    for x in lessons["follower"][:3]:
        v = (1e-3 * 1.02 ** np.arange(200))[:, None]
        signals = {"position": 0.01 * np.cumsum(v, axis=0), "velocity": v, "force": np.full((200, 1), 1e-3)}
        made.append(replace(x, signals=signals, signal_axes={}))
    force = np.where(np.arange(200)[:, None] < 5, 1e-3, 0.0)
    went = ways.answering(made, False)(replace(made[0], signals={**made[0].signals, "force": force}))
    speeds = np.abs(np.diff(went[:, 0]))[30:]
    assert speeds[0] > 0.0
    assert (np.diff(speeds) <= 1e-15).all()


def test_force_that_sets_in_behind_the_motion_gives_no_onset(lessons):
    one = lessons["leader"][0]
    begins = int(np.argmax(np.abs(one.position - one.position[0]).max(axis=1) > 0.05 * np.ptp(one.position)))
    pushed = np.where(np.arange(len(one))[:, None] > begins + 30, 5.0, 0.0)
    assert ways.begins([replace(one, signals={**one.signals, "force": pushed})]) == START
