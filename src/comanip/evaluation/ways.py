"""Ways to foresee where a hand goes from its first position and the force that it feels, each learned on the same lessons.

the skill's               eq. (5) of the skill's model, weights from position and force
the leak's                the same with the force of the last tenths of a second as one more input
mean lesson               the lessons' mean way, from the onset of force or by the time since they began, from where the hand is
                          or where the lessons were
pushed                    place from the force, its leaks of 0.1 to 3 s and its integral: a ridge, one slope for all axes or not
answering                 velocity from the one before and the force of the last 0.12 s, as of a mass in a damper, or on a spring

Which is near the truth differs from set to set; `foreseeing` weighs them by lessons left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..interfaces import Array
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.filtering import ForwardFilter
from ..models.gmr import Regression
from ..models.hmm import Hmm
from ..skills.paper import blurred, taught_range
from .doubt import INPUT_DOUBT, WEIGHT_DOUBT, doubt
from .following import free_run
from .heads import EVERY_S, PENALTIES, axes_of, fitted
from .yardsticks import REST_S, MeanLesson, force_onset

Way = Callable[[Demonstration], Array]  # (T, d) positions, the first of them the lesson's own or near it
Ways = Mapping[str, Way]

LEAK_S = 0.3
LEAKS_S = (0.1, 0.3, 1.0, 3.0)
RIDGES = (0.0, 0.05, 0.2)  # of each state's own variance, added to that of every input: few frames a state make steep lines
ANSWERED_S = (0.0, 0.02, 0.06, 0.12)  # the force of so long ago that velocity answers
LIGHT = 10.0 ** np.arange(-8.0, 1.0, 2.0)  # penalties of what answers: velocity hardly changes in a frame, slopes matter to 1e-4
KEPT_MOST = 0.9999  # of the velocity a frame: more would run away
BEYOND = 10.0  # times what the lessons went: further nothing is foreseen
LEADS_S = 1.0  # a force that begins a lesson comes at most so long before the motion, and not behind it
MOVES = 0.05  # of the longest way: the hand has begun to move

SKILLS, LEAKS = "the skill's", "the leak's"
ONSET, START = "mean lesson from the onset of force", "mean lesson from the start"
IN_PLACE = " in its place"


def leaked(lesson: Demonstration) -> Demonstration:
    """With one more signal, "leak": what is left of the force of the last tenths of a second; at first it is the first force."""
    felt = _leak(lesson.force, lesson.dt, LEAK_S)
    return replace(
        lesson, signals={**lesson.signals, "leak": felt}, signal_axes={**lesson.signal_axes, "leak": lesson.axes},
        units={**lesson.units, "leak": lesson.units.get("force", "")},
    )  # fmt: skip


def velocities_of(model: Hmm, lesson: Demonstration, learned: LearnedSkill, ridges: Sequence[float]) -> list[Array]:
    """v_hat (T, d) of eq. (5) by `model` for each ridge, by which its inputs' variance is raised in every state."""
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    columns = [model.channels.index(c) for c in inputs]
    moving = [i for i, c in enumerate(model.channels) if c.startswith("velocity.")]
    frames = lesson.array(model.channels)
    seen = frames.copy()
    seen[1:, moving], seen[0, moving] = frames[:-1, moving], np.nan
    weigher = ForwardFilter(blurred(model, doubt(learned, WEIGHT_DOUBT)))
    h = np.array([weigher.step(xi).copy() for xi in seen])
    found = []
    for ridge in ridges:
        regression = Regression(_raised(model, columns, ridge), inputs, "velocity", input_noise=doubt(learned, INPUT_DOUBT))
        known = np.clip(frames[:, columns], *taught_range(model, regression.inputs))
        mean = np.einsum("tk,tko->to", h, regression.means_per_state(known))
        found.append(np.clip(mean, *taught_range(model, regression.outputs)))
    return found


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
        v = regression.mean(weigher.step(felt), np.minimum(np.maximum(felt, bottom), top))  # np.clip takes ten times as long
        x = x + lesson.dt * np.minimum(np.maximum(v, low), high)
    return np.array(found)


def the_skills(learned: LearnedSkill) -> Ways:
    known: dict[int, tuple[Demonstration, Array]] = {}  # the lesson beside its path keeps its id its own

    def path(lesson: Demonstration) -> Array:
        if id(lesson) not in known:
            known[id(lesson)] = lesson, free_run(learned, lesson)
        return known[id(lesson)][1]

    return {SKILLS: path}


def ways_of(learned: LearnedSkill, leak: Hmm | None, lessons: Sequence[Demonstration]) -> Ways:
    """All ways, learned on these lessons; `leak` is the model with the leak where one could be learned."""
    ways = dict(the_skills(learned))
    if leak is not None:
        ways[LEAKS] = lambda lesson: path_of(leak, leaked(lesson), learned)
    for name, mean in ((ONSET, MeanLesson.of(lessons)), (START, MeanLesson.of(lessons, onset=False))):
        ways[name] = mean.path
        ways[name + IN_PLACE] = lambda lesson, mean=mean: mean.path(lesson, in_place=True)  # type: ignore[misc]
    for shared in (True, False):
        ways["pushed" + (", one slope for all axes" if shared else "")] = pushed(lessons, shared)
    for spring in (False, True):
        ways["answering" + (", on a spring" if spring else "")] = answering(lessons, spring)
    return ways


def begins(lessons: Sequence[Demonstration]) -> str:
    """Which mean lesson to believe where nothing can be left out: the one from the onset of force, if motion follows that onset
    at once; if force comes after the motion, or long before it (a hand that carries from the first frame on), by time."""
    found = MeanLesson.of(lessons)
    leads = []
    for x in lessons:
        onset = force_onset(x.force, x.dt, x.units.get("force", ""), found.peaks)
        way = np.linalg.norm(x.position - x.position[0], axis=1)
        leads.append((int(np.argmax(way > MOVES * way.max())) - onset) * x.dt)
    return ONSET if 0.0 <= float(np.median(leads)) <= LEADS_S else START


def _tared(lesson: Demonstration) -> Array:
    """(T, d) the force without what it is in the first 0.1 s."""
    return np.asarray(lesson.force - lesson.force[: max(1, round(REST_S / lesson.dt))].mean(axis=0))


def _leak(values: Array, dt: float, time_s: float) -> Array:
    """(T, d) low-pass from the first value on."""
    from scipy.signal import lfilter  # slow to import

    kept = math.exp(-dt / time_s)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], values, axis=0, zi=kept * values[:1])[0])


def pushed(lessons: Sequence[Demonstration], shared: bool) -> Way:
    """Displacement from the force, low-passed and summed up: what leaning for long does."""

    def seen(lesson: Demonstration) -> Array:
        force = _tared(lesson)
        leaks = [_leak(force, lesson.dt, time_s) for time_s in LEAKS_S]
        return np.stack([force, *leaks, np.cumsum(force, axis=0) * lesson.dt], axis=1)

    rows = [slice(None, None, max(1, round(EVERY_S / x.dt))) for x in lessons]
    inputs = [seen(x)[r] for x, r in zip(lessons, rows, strict=True)]
    truth = [(x.position - x.position[0])[r] for x, r in zip(lessons, rows, strict=True)]
    head, _ = fitted(shared, inputs, truth, axes_of(lessons[0]), [1] * (2 + len(LEAKS_S)), PENALTIES)
    return lambda lesson: np.asarray(lesson.position[0] + head(seen(lesson)))


def answering(lessons: Sequence[Demonstration], spring: bool) -> Way:
    """Velocity from the velocity before and the force, the same on all axes of a unit; on a `spring` from the way, too."""

    def seen(lesson: Demonstration) -> Array:
        back = np.rint(np.array(ANSWERED_S) / lesson.dt).astype(int)
        felt = lesson.force[np.maximum(np.arange(len(lesson))[:, None] - back, 0)]
        before = np.concatenate([np.zeros_like(lesson.velocity[:1]), lesson.velocity[:-1]])
        away = [(lesson.position - lesson.position[0])[:, None]] if spring else []
        return np.concatenate([before[:, None], felt, *away], axis=1)

    size = [1] * (1 + len(ANSWERED_S) + spring)
    head, _ = fitted(True, [seen(x) for x in lessons], [x.velocity for x in lessons], axes_of(lessons[0]), size, LIGHT)
    slopes = np.array(head.gains / head.spread)  # (L, d)
    slopes[0] = np.clip(slopes[0], -KEPT_MOST, KEPT_MOST)
    reach = BEYOND * np.max([np.abs(x.position - x.position[0]).max(axis=0) for x in lessons], axis=0)
    reach = np.full_like(reach, reach.max())

    def path(lesson: Demonstration) -> Array:
        driven = np.einsum("tld,ld->td", seen(lesson)[:, 1 : 1 + len(ANSWERED_S)], slopes[1 : 1 + len(ANSWERED_S)])
        back = slopes[-1] if spring else np.zeros(driven.shape[1])
        away, velocity, found = np.zeros(driven.shape[1]), np.zeros(driven.shape[1]), np.empty_like(driven)
        for t, push in enumerate(driven):
            found[t] = away
            velocity = slopes[0] * velocity + push + back * away
            away = np.minimum(np.maximum(away + lesson.dt * velocity, -reach), reach)
        return np.asarray(lesson.position[0] + found)

    return path
