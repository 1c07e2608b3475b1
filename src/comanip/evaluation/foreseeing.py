"""The best foresight that the lessons themselves vouch for: which inputs, which regression, which path, chosen by leaving out.

A skill's model answers the force of the moment. Arms and robots under admittance control answer what they felt for some tenths of
a second: there the force through a leak (a low-pass of 0.3 s) is a better input, and elsewhere a worse one. Lessons say
which: each is left out of a refit of the model. What is foreseen is a weighted mean, of several rules for velocity and of several
`ways` for a free run, its weights learned where they had not seen the lesson (`stacking`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Array
from ..learned.held_out import fitted, refitted
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.hmm import Hmm
from .heads import axes_of
from .stacking import weights
from .takes import folds_of
from .ways import RIDGES, SKILLS, Ways, begins, leaked, the_skills, velocities_of, ways_of

FOLDS = 6
DOUBT = 3.0  # [squared errors of a lesson] weights of a free run, of which a lesson is one witness, however many frames it has


class Rule(NamedTuple):
    """How velocity is foreseen: by force as it is or through the leak, too, and with which ridge."""

    leak: bool
    ridge: float

    def __str__(self) -> str:
        return ("with a leak of 0.3 s" if self.leak else "by force as it is") + f", ridge {self.ridge:g}"


# where one lesson leaves nothing to choose by: what was better on most sets that were tried (docs/results.md)
UNCHOSEN = Rule(True, 0.05)


@dataclass(frozen=True, eq=False)
class Foreseer:
    """Foresight of one skill: its model, the one with the leak (None where there is no force), and how much of what is believed.

    rules  rule for velocity -> (d,) its weight on each axis; weights  name of a way -> (d,) its weight on each axis
    """

    learned: LearnedSkill
    leak: Hmm | None
    rules: Mapping[Rule, Array]
    ways: Ways
    weights: Mapping[str, Array]

    @property
    def chosen(self) -> str:
        return f"velocity {_told(self.rules) or 'zero'}; free run: {_told(self.weights) or 'stands still'}"

    def velocity(self, lesson: Demonstration) -> Array:
        """(T, d) from each frame's position and force, states from what was before."""
        used = [rule for rule, w in self.rules.items() if w.any()]
        said = _by_rules(used, self.learned, self.leak, lesson)
        return np.sum([self.rules[rule] * v for rule, v in zip(used, said, strict=True)], axis=0) + np.zeros_like(lesson.velocity)

    def path(self, lesson: Demonstration) -> Array:
        """(T, d) from the first position and the recorded force, which is not heard before its time."""
        said = [w * (self.ways[name](lesson) - lesson.position[0]) for name, w in self.weights.items() if w.any()]
        return np.asarray(lesson.position[0] + (np.sum(said, axis=0) if said else np.zeros_like(lesson.position)))


def _told(shares: Mapping[Any, Array]) -> str:
    ranked = sorted(((float(w.mean()), str(name)) for name, w in shares.items()), reverse=True)
    return " + ".join(f"{share:.2f} {name}" for share, name in ranked if share >= 0.05)


def _by_rules(rules: Sequence[Rule], learned: LearnedSkill, leak: Hmm | None, lesson: Demonstration) -> list[Array]:
    """(T, d) of each rule; those of one model share its states."""
    found: dict[Rule, Array] = {}
    for of_leak in (False, True):
        some = [rule for rule in rules if (rule.leak and leak is not None) == of_leak]
        if some:
            model, heard = (leak, leaked(lesson)) if of_leak and leak is not None else (learned.model, lesson)
            found |= zip(some, velocities_of(model, heard, learned, [rule.ridge for rule in some]), strict=True)
    return [found[rule] for rule in rules]


def foreseer(learned: LearnedSkill, lessons: Sequence[Demonstration], **fitting: Any) -> Foreseer:
    """Weighed on the skill's own lessons, which `learned` was learned from; `fitting` as for `fit_hmm`."""
    one = np.ones(len(learned.axes))
    if not learned.has_force or any("force" not in x.signals for x in lessons):
        return Foreseer(learned, None, {Rule(False, 0.0): one}, the_skills(learned), {SKILLS: one})
    with_leak = [leaked(x) for x in lessons]
    channels = [c for g in ("position", "force", "leak", "velocity") for c in with_leak[0].channels if c.split(".")[0] == g]
    leak = fitted([x.array(channels) for x in with_leak], learned.model.n_states, channels, fitting)
    ways, folds = ways_of(learned, leak, lessons), folds_of(lessons, FOLDS)
    if len(folds) < 2:
        return Foreseer(learned, leak, {UNCHOSEN if leak is not None else Rule(False, 0.0): one}, ways, {begins(lessons): one})
    rules = [Rule(of_leak, r) for of_leak in (False, True) for r in RIDGES if leak is not None or not of_leak]
    speeds: dict[int, Array] = {}
    paths: dict[int, Array] = {}
    for out in folds:
        rest = [i for i in range(len(lessons)) if i not in out]
        part = replace(learned, model=_again(learned.model, [lessons[i].array(learned.model.channels) for i in rest], fitting))
        part_leak = None if leak is None else _again(leak, [with_leak[i].array(channels) for i in rest], fitting)
        unseen = ways_of(part, part_leak, [lessons[i] for i in rest])
        for i in out:
            speeds[i] = np.stack(_by_rules(rules, part, part_leak, lessons[i]))
            paths[i] = np.stack([way(lessons[i]) - lessons[i].position[0] for way in unseen.values()])
    by_rule = _weighed(rules, speeds, [x.velocity for x in lessons], axes_of(lessons[0]), 0.0)
    by_way = _weighed(list(ways), paths, [x.position - x.position[0] for x in lessons], axes_of(lessons[0]), DOUBT)
    return Foreseer(learned, leak, by_rule, ways, by_way)


def _weighed(
    names: Sequence[Any], said: Mapping[int, Array], truth: Sequence[Array], kinds: Sequence[Sequence[int]], doubt: float
) -> dict[Any, Array]:
    """Name -> (d,) weights; axes of one unit have theirs together, so that turned axes have the same."""
    found = np.zeros((len(names), truth[0].shape[1]))
    for axes in kinds:
        parts = [said[i][:, :, axes] for i in range(len(truth))]
        found[:, axes] = weights(parts, [y[:, axes] for y in truth], doubt)[:, None]
    return dict(zip(names, found, strict=True))


def _again(model: Hmm, others: Sequence[Array], fitting: Mapping[str, Any]) -> Hmm:
    return refitted(model, others, dict(fitting)) or model
