"""Choices by lessons left out: the better is taken where it is clearly better, the usual one otherwise, and time is bounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.evaluation import choosing
from comanip.evaluation.choosing import choose_states, clearly_better, losses


def strokes(lessons, seed=0):
    """Four lessons of five strokes to and fro, slightly different: three states cannot tell the strokes apart."""
    rng, made = np.random.default_rng(seed), []
    for i, lesson in enumerate(lessons["leader"][:4]):
        t = np.arange(400) * 0.01
        x = (0.1 + 0.01 * rng.normal()) * np.sin(2 * np.pi * t * 1.0 + 0.1 * rng.normal())
        v = np.gradient(x, 0.01)
        f = 3.0 * v + 0.05 * rng.normal(size=400)
        signals = {n: a[:, None] for n, a in (("position", x), ("force", f), ("velocity", v))}
        made.append(replace(lesson, name=f"{i}", signals=signals, signal_axes={}))
    return made


def test_knowing_nothing_is_one_and_a_good_model_far_below(lessons):
    found = losses(lessons["leader"][:4], n_states=8)
    assert found.shape == (4,)
    assert found.max() < 0.2
    still = [replace(x, signals={**x.signals, "velocity": 1e-3 * np.sign(np.random.default_rng(0).normal(size=x.velocity.shape))})
             for x in lessons["leader"][:3]]  # fmt: skip
    assert losses(still, n_states=3).min() > 0.3
    assert losses(still, n_states=3).max() <= choosing.WORST


def test_a_number_that_is_clearly_better_is_taken_and_said(lessons):
    chosen = choose_states(strokes(lessons), (3, 12), usual=3)
    assert chosen.n_states == 12
    assert chosen.tried[12] < chosen.tried[3]
    assert str(chosen).startswith("states: 12 (error on lessons left out")


def test_the_usual_number_stays_where_another_is_better_by_chance():
    usual = np.array([0.10, 0.20, 0.15, 0.12])
    assert not clearly_better(usual - [0.08, -0.07, 0.06, -0.05], usual)
    assert clearly_better(usual - [0.02, 0.03, 0.02, 0.03], usual)
    assert not clearly_better(np.array([0.0, 0.0, np.inf, 0.0]), usual)


def test_time_is_bounded_and_what_was_left_out_is_said(lessons):
    now = iter(range(0, 1000, 30))
    seen = []
    chosen = choose_states(
        lessons["leader"][:3],
        (3, 4, 5),
        usual=4,
        budget_s=50.0,
        clock=lambda: next(now),
        progress=lambda d, t: seen.append((d, t)),
    )
    assert list(chosen.tried) == [4, 5]  # the usual one, then the nearest
    assert seen == [(1, 3), (2, 3)]
    assert not chosen.whole
    assert "no time for the others" in str(chosen)


def test_one_recording_leaves_nothing_out(lessons):
    with pytest.raises(ParameterError, match="2 recordings or more; got 1"):
        choose_states(lessons["leader"][:1])


def test_a_choice_does_not_depend_on_units_of_force(lessons):
    strong = [replace(x, signals={**x.signals, "force": 1000.0 * x.force}) for x in lessons["leader"][:3]]
    assert losses(strong, n_states=5) == pytest.approx(losses(lessons["leader"][:3], n_states=5), rel=0.05)


def test_a_bias_of_each_take_is_taken_off_and_none_is_left_alone(lessons):
    from comanip.evaluation.choosing import choose_tare

    clean = lessons["follower"][:4]
    biased = [replace(x, signals={**x.signals, "force": x.force + b}) for x, b in zip(clean, (-9.0, 7.0, 3.0, -5.0), strict=True)]
    found = choose_tare(biased, clean, n_states=6)
    assert found.tare
    assert "taken off" in str(found)
    assert not choose_tare(clean, clean, n_states=6).tare


def test_a_lesson_is_judged_by_models_that_have_not_seen_it(lessons, monkeypatch):
    learned_from, real = [], choosing.learn
    monkeypatch.setattr(choosing, "learn", lambda some, **k: learned_from.append({id(x) for x in some}) or real(some, **k))
    losses(lessons["leader"][:3], n_states=3)
    assert [[id(x) in some for some in learned_from].count(False) for x in lessons["leader"][:3]] == [1, 1, 1]


def test_one_lesson_in_which_next_to_nothing_moves_cannot_choose_for_all(lessons):
    still = lessons["leader"][3]
    signals = {**still.signals, "velocity": 1e-9 * still.velocity, "position": 1e-9 * still.position}
    found = losses([*lessons["leader"][:3], replace(still, signals=signals, signal_axes={})], n_states=4)
    assert found[3] == choosing.WORST
