"""The best foresight that the lessons themselves vouch for: which inputs, which regression, which path, chosen by leaving out.

A skill's model answers the force of the moment. Arms and robots under admittance control answer what they felt for some tenths of
a second: there the force through a leak (a low-pass of 0.3 s) is a better input, and elsewhere a worse one. Lessons say
which: each is left out of a refit of the model, and what foresees it best is taken. So is the way of a free run, among the
skill's own, one by leak, the mean lesson from the onset of force, and standing still.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Array
from ..learned.held_out import fitted, refitted
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.filtering import ForwardFilter
from ..models.gmr import Regression
from ..models.hmm import Hmm
from ..skills.paper import blurred, taught_range
from .doubt import INPUT_DOUBT, WEIGHT_DOUBT, doubt
from .following import free_run
from .yardsticks import MeanLesson, standing_still

LEAK_S = 0.3
RIDGES = (0.0, 0.05, 0.2)  # of each state's own variance, added to that of every input: few frames a state make steep lines
FOLDS = 6
Paths = Mapping[str, Callable[[Demonstration], Array]]


class Rule(NamedTuple):
    """How velocity is foreseen: by force as it is or through the leak, too, and with which ridge."""

    leak: bool
    ridge: float

    def __str__(self) -> str:
        return ("with force through a leak of 0.3 s" if self.leak else "by force as it is") + f", ridge {self.ridge:g}"


# where one lesson leaves nothing to choose by: what was better on most sets that were tried (docs/results.md)
UNCHOSEN, UNCHOSEN_WAY = Rule(True, 0.05), ("mean lesson",)


def leaked(lesson: Demonstration) -> Demonstration:
    """With one more signal, "leak": what is left of the force of the last tenths of a second; at first it is the first force."""
    kept = math.exp(-lesson.dt / LEAK_S)
    felt = np.array(lesson.force)
    for t in range(1, len(felt)):
        felt[t] = kept * felt[t - 1] + (1.0 - kept) * lesson.force[t]
    return replace(
        lesson, signals={**lesson.signals, "leak": felt}, signal_axes={**lesson.signal_axes, "leak": lesson.axes},
        units={**lesson.units, "leak": lesson.units.get("force", "")},
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Foreseer:
    """Foresight of one skill: its model, the one with the leak (None where there is no force), and what was chosen of them."""

    learned: LearnedSkill
    leak: Hmm | None
    rule: Rule
    way: tuple[str, ...]
    mean: MeanLesson | None

    @property
    def chosen(self) -> str:
        return f"velocity {self.rule}; free run: {' and '.join(self.way)}"

    def velocity(self, lesson: Demonstration) -> Array:
        """(T, d) from each frame's position and force, states from what was before."""
        model = self.leak if self.rule.leak and self.leak is not None else self.learned.model
        return velocity_of(
            model, leaked(lesson) if self.rule.leak and self.leak is not None else lesson, self.learned, self.rule.ridge
        )

    def path(self, lesson: Demonstration) -> Array:
        """(T, d) from the first position and the recorded force."""
        ways = _ways(self.learned, self.leak, self.mean)
        return np.mean([ways[name](lesson) for name in self.way], axis=0)


def velocity_of(model: Hmm, lesson: Demonstration, learned: LearnedSkill, ridge: float) -> Array:
    """v_hat (T, d) of eq. (5) by `model`, its inputs' variance raised by `ridge` in every state."""
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    columns = [model.channels.index(c) for c in inputs]
    moving = [i for i, c in enumerate(model.channels) if c.startswith("velocity.")]
    regression = Regression(_raised(model, columns, ridge), inputs, "velocity", input_noise=doubt(learned, INPUT_DOUBT))
    frames = lesson.array(model.channels)
    seen = frames.copy()
    seen[1:, moving], seen[0, moving] = frames[:-1, moving], np.nan
    weigher = ForwardFilter(blurred(model, doubt(learned, WEIGHT_DOUBT)))
    known = np.clip(frames[:, columns], *taught_range(model, regression.inputs))
    low, high = taught_range(model, regression.outputs)
    return np.array([np.clip(regression.mean(weigher.step(xi), x), low, high) for xi, x in zip(seen, known, strict=True)])


def _raised(model: Hmm, columns: Sequence[int], ridge: float) -> Hmm:
    covariances = np.array(model.covariances)
    covariances[:, columns, columns] *= 1.0 + ridge
    return replace(model, covariances=covariances)


def path_of(model: Hmm, lesson: Demonstration, learned: LearnedSkill) -> Array:
    """(T, d) Euler's steps along eq. (5) by a model with the leak; weights from position, force and leak."""
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    columns = [model.channels.index(c) for c in inputs]
    regression = Regression(_raised(model, columns, RIDGES[1]), inputs, "velocity", input_noise=doubt(learned, INPUT_DOUBT))
    weigher = ForwardFilter(blurred(model, doubt(learned, WEIGHT_DOUBT)), inputs)
    bottom, top = taught_range(model, inputs)
    low, high = taught_range(model, regression.outputs)
    known = lesson.array(inputs)
    d, x, found = len(learned.axes), np.array(lesson.position[0]), []
    for row in known:
        felt = np.concatenate([x, row[d:]])
        found.append(x.copy())
        v = regression.mean(weigher.step(felt), np.clip(felt, bottom, top))
        x = x + lesson.dt * np.clip(v, low, high)
    return np.array(found)


def _ways(learned: LearnedSkill, leak: Hmm | None, mean: MeanLesson | None) -> Paths:
    ways: dict[str, Callable[[Demonstration], Array]] = {
        "the skill's": lambda lesson: free_run(learned, lesson),
        "standing still": standing_still,
    }
    if leak is not None:
        ways["the leak's"] = lambda lesson: path_of(leak, leaked(lesson), learned)
    if mean is not None:
        ways["mean lesson"] = mean.path
    return ways


def foreseer(learned: LearnedSkill, lessons: Sequence[Demonstration], **fitting: Any) -> Foreseer:
    """Chosen on the skill's own lessons, which `learned` was learned from; `fitting` as for `fit_hmm`."""
    if not learned.has_force or any("force" not in x.signals for x in lessons):
        return Foreseer(learned, None, Rule(False, 0.0), ("the skill's",), None)
    with_leak = [leaked(x) for x in lessons]
    channels = [c for g in ("position", "force", "leak", "velocity") for c in with_leak[0].channels if c.split(".")[0] == g]
    leak = fitted([x.array(channels) for x in with_leak], learned.model.n_states, channels, fitting)
    mean = MeanLesson.of(lessons)
    if len(lessons) < 2:
        return Foreseer(learned, leak, UNCHOSEN if leak is not None else Rule(False, 0.0), UNCHOSEN_WAY, mean)
    rules = {Rule(of_leak, r): 0.0 for of_leak in (False, True) for r in RIDGES if leak is not None or not of_leak}
    ways: dict[tuple[str, ...], float] = {}
    folds = min(FOLDS, len(lessons))
    for fold in range(folds):
        out = list(range(fold, len(lessons), folds))
        rest = [i for i in range(len(lessons)) if i not in out]
        part = replace(learned, model=_again(learned.model, [lessons[i].array(learned.model.channels) for i in rest], fitting))
        part_leak = None if leak is None else _again(leak, [with_leak[i].array(channels) for i in rest], fitting)
        for i in out:
            for rule in rules:
                model = part.model if not rule.leak or part_leak is None else part_leak
                apart = velocity_of(model, with_leak[i], part, rule.ridge) - lessons[i].velocity
                rules[rule] += _share(apart, lessons[i].velocity)
            _add_ways(ways, _ways(part, part_leak, MeanLesson.of([lessons[j] for j in rest])), lessons[i])
    return Foreseer(learned, leak, min(rules, key=rules.__getitem__), min(ways, key=ways.__getitem__), mean)


def _share(apart: Array, velocity: Array) -> float:
    """1 − R², bounded: one lesson in which nothing moves must not choose for all."""
    spread = float(((velocity - velocity.mean(axis=0)) ** 2).sum())
    return min(2.0, float((apart**2).sum()) / spread) if spread > 0.0 else 0.0


def _add_ways(ways: dict[tuple[str, ...], float], found: Paths, lesson: Demonstration) -> None:
    """RMSE of each way and of the mean of any two, summed over lessons."""
    paths = {name: way(lesson) for name, way in found.items()}
    for names in [*((name,) for name in paths), *combinations(paths, 2)]:
        apart = np.mean([paths[name] for name in names], axis=0) - lesson.position
        ways[names] = ways.get(names, 0.0) + float(np.sqrt((apart**2).sum(axis=1).mean()))


def _again(model: Hmm, others: Sequence[Array], fitting: Mapping[str, Any]) -> Hmm:
    return refitted(model, others, dict(fitting)) or model
