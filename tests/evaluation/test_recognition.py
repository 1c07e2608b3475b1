"""Recognition: which skill, and a confidence that can be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ChannelError, ParameterError
from comanip.evaluation import recognition
from comanip.evaluation.recognition import Recognition, calibration, classify, recognise
from comanip.learned.held_out import held_out_scores, score
from comanip.learned.skill import learn
from comanip.models.hmm import Hmm

ROLES = ("leader", "follower")


@pytest.fixture(scope="module")
def both(skills):
    return [skills[role] for role in ROLES]


def test_lessons_are_recognised_by_the_skill_of_their_role(both, lessons):
    for n, role in enumerate(ROLES):
        found = recognise(both, lessons[role][5])
        assert found.posterior.sum() + found.none == pytest.approx(1.0)
        assert found.best == n
        assert found.posterior[n] > 0.9
        assert (classify(both, lessons[role][5]) == found.posterior).all()


def test_half_of_a_lesson_is_enough_and_nothing_after_it_is_seen(both, lessons):
    for n, role in enumerate(ROLES):
        lesson = lessons[role][5]
        assert recognise(both, lesson, after_s=2.0).best == n
        spoiled = {name: np.array(v) for name, v in lesson.signals.items()}
        for values in spoiled.values():
            values[201:] += 7.0
        assert recognise(both, replace(lesson, signals=spoiled), after_s=2.0).scores == pytest.approx(
            recognise(both, lesson, after_s=2.0).scores
        )
    with pytest.raises(ParameterError, match="after_s"):
        recognise(both, lessons["leader"][5], after_s=0.0)


def test_more_frames_of_the_same_motion_make_nobody_surer(both, lessons):
    """A posterior that takes frames for independent witnesses would square its odds."""
    lesson = replace(lessons["follower"][5], signals={n: v[:120] for n, v in lessons["follower"][5].signals.items()})
    twice = replace(lesson, dt=lesson.dt / 2, signals={n: np.repeat(v, 2, axis=0) for n, v in lesson.signals.items()})
    once, often = (recognise(both, x) for x in (lesson, twice))
    assert once.posterior.min() > 0.01  # some doubt, for the test to say anything
    assert often.posterior == pytest.approx(once.posterior, abs=0.05)


def test_a_wrong_answer_is_never_infinitely_sure(lessons):
    """Leave-one-out on three roles, of which natural lessons resemble both others: mean -log p(truth) at most 0.6."""
    found = recognition.leave_one_out([lessons[r] for r in ROLES])
    assert calibration(found).surprise < 0.6
    assert calibration(found).right >= len(found) - 1


def test_a_recording_of_neither_is_of_neither(both, lessons):
    lesson, t = lessons["leader"][5], 0.01 * np.arange(400)[:, None]
    stirred = {"position": 0.3 + 0.1 * np.sin(6.0 * t), "force": 3.0 * np.sin(7.0 * t), "velocity": 0.6 * np.cos(6.0 * t)}
    found = recognise(both, replace(lesson, signals=stirred))
    assert found.best is None
    assert found.none > 0.5


def test_what_a_skill_stores_are_scores_of_lessons_it_has_not_seen(lessons, skills):
    kept = skills["leader"].provenance["held_out"]
    model = skills["leader"].model
    seen = [score(model, x.array(model.channels)) for x in lessons["leader"][:5]]
    assert len(kept) == 5
    assert np.mean(kept) < np.mean(seen)
    afresh = [learn([x for x in lessons["leader"][:5] if x is not out]).model for out in lessons["leader"][:5]]
    truly = [score(m, x.array(m.channels)) for m, x in zip(afresh, lessons["leader"][:5], strict=True)]
    assert kept == pytest.approx(truly, abs=0.5)


def test_of_two_lessons_none_can_be_left_out(lessons):
    assert held_out_scores(learn(lessons["leader"][:2], n_states=3).model, []) == []
    assert learn(lessons["leader"][:2], n_states=3).provenance["held_out"] == []


def test_skills_without_stored_scores_are_compared_with_a_stated_doubt(both, lessons):
    older = [replace(s, provenance={k: v for k, v in s.provenance.items() if k != "held_out"}) for s in both]
    found = recognise(older, lessons["follower"][5])
    assert (found.best, found.learned, found.unit) == (1, False, recognition.STATED_UNIT)
    assert recognise(both, lessons["follower"][5]).learned


@pytest.mark.filterwarnings("ignore:channels repeat")
def test_turned_axes_and_other_units_of_force_change_no_probability(lessons):
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]

    def spread(lesson, turn, newton):
        three = {
            n: np.column_stack([v[:, 0], 0.1 * v[:, 0] + 1e-2 * np.cos(np.arange(len(v)) / 40), 0.5 * v[:, 0] ** 2])
            for n, v in lesson.signals.items()
        }
        signals = {n: (newton if n == "force" else 1.0) * v @ turn for n, v in three.items()}
        return replace(lesson, axes=("x", "y", "z"), signals=signals, signal_axes={})

    def posterior(turn, newton):
        learned = [learn([spread(x, turn, newton) for x in lessons[role][:5]]) for role in ROLES]
        return recognise(learned, spread(lessons["follower"][5], turn, newton)).posterior

    assert posterior(turn, 1e3) == pytest.approx(posterior(np.eye(3), 1.0), abs=1e-4)


def test_a_score_is_the_log_density_where_one_state_explains_all():
    """One state, one channel: log N(x; 0, 1 + 0.04) and the whole task's, 3 nats down, by hand."""
    model = Hmm([1.0], [[1.0]], [[0.0]], [[[1.0]]], ("position.z",))
    x = np.array([[0.3], [-1.2]])

    def log_n(variance):
        return -0.5 * (np.log(2.0 * np.pi * variance) + x[:, 0] ** 2 / variance)

    assert score(model, x) == pytest.approx(np.logaddexp(log_n(1.04), log_n(1.0) - 3.0).mean())


def test_skills_without_a_shared_channel_are_not_compared(skills, lessons):
    other = replace(skills["leader"].model, channels=("position.x", "force.x", "velocity.x"))
    with pytest.raises(ChannelError, match="share no channel"):
        recognise([skills["leader"], replace(skills["leader"], model=other, axes=("x",))], lessons["leader"][5])


def test_calibration_counts_what_was_said_and_what_held():
    def said(p, none):
        return Recognition(np.array(p), none, np.zeros(2), 1.0, True)

    found = [(said([0.9, 0.05], 0.05), 0), (said([0.9, 0.1], 0.0), 1), (said([0.2, 0.2], 0.6), 0)]
    k = calibration(found)
    assert (k.right, k.none, k.of) == (1, 1, 3)
    assert k.surprise == pytest.approx(-np.log([0.9, 0.1, 0.2]).mean())
    assert k.stated == pytest.approx([0.6, 0.9])
    assert k.held == pytest.approx([0.0, 0.5])
    assert k.counts.tolist() == [1, 2]
