"""Which skill does a recording show, and how sure may one be? The numbers of `comanip classify`.

Skills are compared by their score a frame (`learned.held_out.score`) in units of how far that score varies among lessons which a
model has not seen, learned by leave-one-out and stored with each skill. "None of these" takes part in the comparison as a class
that scores four such units below an ordinary unseen lesson of the best skill: of two skills one is always the likelier, also for
a recording of neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from ..learned.held_out import DOUBT, score
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.hmm import Hmm

# chosen by leave-one-out on nine sets (three simulated dyads, an exoskeleton's reaches and holds); docs/results.md
NONE_BELOW = 4.0  # units by which a recording of none of the skills scores below an unseen lesson of the best one
LEAST_UNIT = 0.5  # [nats a frame] a few lessons that happen to agree do not make anybody surer than this
STATED_UNIT, STATED_LESSONS = 2.0, 3  # for skills without stored numbers: an older file, a stream, fewer than 3 lessons


class Recognition(NamedTuple):
    """posterior (S,) of each skill and `none` of none of them, together 1; scores (S,) a frame, and the unit of their differences
    [nats]; whether that was learned with the skills, or is the stated one."""

    posterior: Array
    none: float
    scores: Array
    unit: float
    learned: bool

    @property
    def best(self) -> int | None:
        """The likeliest skill's number; None where none of them is likelier."""
        return int(self.posterior.argmax()) if self.posterior.max() >= self.none else None


def recognise(skills: Sequence[LearnedSkill], lesson: Demonstration, *, after_s: float | None = None) -> Recognition:
    """What the lesson shows, equal priors; of its first `after_s` seconds alone, where that is asked.

    Scores are compared over the channels that all skills share, so a skill with fewer channels gets no advantage.
    """
    if not skills:
        raise ParameterError("there is no skill; give at least one")
    shared = _shared_channels(skills)
    frames = lesson.array(shared)[: _frames_until(lesson, after_s)]
    scores = np.array([score(s.model, frames, [s.model.channels.index(c) for c in shared]) for s in skills])
    stored = [_stored(s, shared) for s in skills]
    unit, lessons, learned = _unit(stored)
    best = int(scores.argmax())
    ordinary = float(np.median(stored[best])) if len(stored[best]) else _expected(skills[best].model, shared)
    weights = _tails(-np.append(scores, ordinary - NONE_BELOW * unit) / unit, lessons)
    return Recognition(weights[:-1], float(weights[-1]), scores, unit, learned)


def classify(skills: Sequence[LearnedSkill], lesson: Demonstration) -> Array:
    """(S,) posterior of each skill given the whole lesson, equal priors; what is missing to 1 is "none of these"."""
    return recognise(skills, lesson).posterior


def _frames_until(lesson: Demonstration, after_s: float | None) -> int:
    if after_s is None:
        return len(lesson)
    if not after_s > 0.0:
        raise ParameterError(f"after_s is {after_s:g}; allowed: > 0 s, the part of the recording that has been seen")
    return max(2, min(len(lesson), round(after_s / lesson.dt)))


def _tails(behind: Array, lessons: int) -> Array:
    """Probabilities from distances [units]. The unit is itself learned from few lessons, so tails are Student's, not Gauss':
    three lessons never make one surer than a few per mille."""
    log_p = -lessons * np.log1p(np.maximum(behind - behind.min(), 0.0) / lessons)
    weights = np.exp(log_p)
    return np.asarray(weights / weights.sum())


def _stored(skill: LearnedSkill, shared: Sequence[str]) -> Array:
    """Scores of lessons left out, kept with the skill; none where other channels are compared than those it was learned with."""
    if len(shared) != skill.model.n_channels:
        return np.zeros(0)
    kept = skill.provenance.get("held_out") or ()
    return np.array([float(v) for v in kept], dtype=np.float64)


def _unit(stored: Sequence[Array]) -> tuple[float, int, bool]:
    """(unit [nats a frame], how many lessons stand behind it, whether they do), pooled over the skills."""
    known = [x for x in stored if len(x) >= 2]
    if not known:
        return STATED_UNIT, STATED_LESSONS, False
    typical = float(np.sqrt(np.mean([x.var(ddof=1) for x in known])))
    return max(typical, LEAST_UNIT), max(2, min(len(x) for x in known)), len(known) == len(stored)


def _expected(model: Hmm, shared: Sequence[str]) -> float:
    """The score that the model's own frames would have: minus the entropy of its states, which are equally long."""
    columns = [model.channels.index(c) for c in shared]
    covariances = model.covariances[:, columns][:, :, columns]
    wide = covariances + np.diag(DOUBT**2 * np.einsum("kii->ki", covariances).mean(axis=0))
    return float(np.mean(-0.5 * (len(columns) + np.linalg.slogdet(2.0 * np.pi * wide)[1])))


def _shared_channels(skills: Sequence[LearnedSkill]) -> list[str]:
    shared = [c for c in skills[0].model.channels if all(c in s.model.channels for s in skills)]
    if not shared:
        raise ChannelError("the skills share no channel, so their likelihoods cannot be compared")
    return shared


class Calibration(NamedTuple):
    """How far a recogniser's confidence can be believed, over recordings whose skill is known.

    surprise   mean −log p(truth) [nats]; a fair coin between two has 0.69
    right      how many of `of` were recognised; `none`: of how many it said that none of the skills shows
    stated     (B,) mean confidence of the likeliest answer in each bin, held (B,) the share of right ones, counts (B,)
    """

    surprise: float
    right: int
    none: int
    of: int
    stated: Array
    held: Array
    counts: np.ndarray


def calibration(found: Sequence[tuple[Recognition, int]], bins: int = 5) -> Calibration:
    """From (recognition, number of the skill that it truly shows) of each recording."""
    truth = np.array([max(r.posterior[i], 1e-300) for r, i in found])
    answers = np.array([-1 if r.best is None else r.best for r, _ in found])
    right = answers == np.array([i for _, i in found])
    confidence = np.array([max(r.posterior.max(), r.none) for r, _ in found])
    where = np.minimum((confidence * bins).astype(int), bins - 1)
    filled = [b for b in range(bins) if (where == b).any()]
    return Calibration(
        surprise=float(-np.log(truth).mean()),
        right=int(right.sum()),
        none=int((answers < 0).sum()),
        of=len(found),
        stated=np.array([confidence[where == b].mean() for b in filled]),
        held=np.array([right[where == b].mean() for b in filled]),
        counts=np.array([int((where == b).sum()) for b in filled]),
    )


def leave_one_out(groups: Sequence[Sequence[Demonstration]], **learning: object) -> list[tuple[Recognition, int]]:
    """Each lesson of each group recognised among skills of all groups, its own learned without it; (recognition, truth)."""
    from ..learned.skill import learn

    every = [learn(list(lessons), **learning) for lessons in groups]
    found = []
    for truth, lessons in enumerate(groups):
        for i, lesson in enumerate(lessons):
            own = learn([x for j, x in enumerate(lessons) if j != i], **learning)
            found.append((recognise([own if n == truth else s for n, s in enumerate(every)], replace(lesson, role="")), truth))
    return found
