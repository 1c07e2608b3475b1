"""How well a skill's model predicts recordings: the numbers of `comanip evaluate`.

one step   v_hat of eq. (5) from this frame's position and force; the state weights of eq. (4) have seen position and force up to
           this frame and velocity up to the frame BEFORE it, so nothing that is predicted is given
free run   from the first frame on only the recorded force is given; position and velocity are the model's own. Weights come from
           position and force alone: a model that listens to its own velocity locks itself into one state
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..learned.skill import LearnedSkill, learn
from ..lessons.demonstration import Demonstration
from ..loop import run, unbroken
from ..models.filtering import ForwardFilter
from ..models.gmr import Regression
from ..models.hmm import log_likelihood
from ..plants.replay import ReplayPlant
from ..skills.paper import PaperLaw, PaperSkill, blurred, law_from, taught_range
from .yardsticks import MeanLesson, last_velocity, persistence_log_likelihood, standing_still

# chosen on simulated lessons of three kinds (follower, leader, hand-guided admittance), ten sets, leave-one-out; docs/results.md
FREE_RUN = PaperLaw(
    weight_channels=("position", "force"),
    attraction_per_s=1.0,
    gain="constant",
    target_position="force",
    bounded=True,
    integrator="exact",
    transition_floor=1e-6,
    gate=20.0,
)


# doubt in position, shares of the range that the lessons cover: a state at rest is a millimetre wide, and other recordings start
# a centimetre beside it. As evidence for the state position is worth little; as input of the regression nearly all
WEIGHT_DOUBT, INPUT_DOUBT = 0.13, 0.033


class Prediction(NamedTuple):
    """One file. Velocity figures per axis and over all axes; positions in m."""

    name: str
    frames: int
    log_likelihood_per_frame: float
    one_step_velocity_r2: float
    one_step_velocity_r2_per_axis: list[float]
    one_step_velocity_rmse: float
    one_step_velocity_rmse_per_axis: list[float]
    free_run_position_rmse_m: float
    free_run_end_error_m: float
    free_run_position_rmse_per_axis: list[float]
    # beside them, of rules that know nothing of the task (`yardsticks`); nan where lessons to take them from are not at hand
    last_velocity_r2: float = float("nan")
    standing_still_rmse_m: float = float("nan")
    mean_lesson_rmse_m: float = float("nan")
    persistence_log_likelihood_per_frame: float = float("nan")


PER_AXIS = ("one_step_velocity_r2_per_axis", "one_step_velocity_rmse_per_axis", "free_run_position_rmse_per_axis")
OVERALL = (
    "one_step_velocity_r2",
    "one_step_velocity_rmse",
    "free_run_position_rmse_m",
    "free_run_end_error_m",
    "log_likelihood_per_frame",
)
BESIDE = ("last_velocity_r2", "standing_still_rmse_m", "mean_lesson_rmse_m", "persistence_log_likelihood_per_frame")


def predict(learned: LearnedSkill, lesson: Demonstration, others: Sequence[Demonstration] = ()) -> Prediction:
    """All figures for one lesson at the skill's own rate; `others`: the lessons it was learned from, for rules that need some."""
    frames = _frames(learned, lesson)
    likelihood = float(log_likelihood(learned.model, [frames])[0])
    r2, r2_axes, rmse, rmse_axes = _fit_of(one_step_velocity(learned, lesson), lesson.velocity)
    path = free_run(learned, lesson)
    apart = path - lesson.position
    return Prediction(
        name=lesson.name,
        frames=len(lesson),
        log_likelihood_per_frame=likelihood / len(lesson),
        one_step_velocity_r2=r2,
        one_step_velocity_r2_per_axis=r2_axes,
        one_step_velocity_rmse=rmse,
        one_step_velocity_rmse_per_axis=rmse_axes,
        free_run_position_rmse_m=float(np.sqrt((apart**2).sum(axis=1).mean())),
        free_run_end_error_m=float(np.linalg.norm(apart[-1])),
        free_run_position_rmse_per_axis=np.sqrt((apart**2).mean(axis=0)).tolist(),
        last_velocity_r2=_fit_of(last_velocity(lesson), lesson.velocity)[0],
        standing_still_rmse_m=_rmse(standing_still(lesson), lesson),
        **_from_lessons(learned, lesson, others),
    )


def _from_lessons(learned: LearnedSkill, lesson: Demonstration, others: Sequence[Demonstration]) -> dict[str, float]:
    if not others:
        return {}
    frames = [x.array(learned.model.channels) for x in others]
    found = {"persistence_log_likelihood_per_frame": persistence_log_likelihood(_frames(learned, lesson), frames)}
    if all("force" in x.signals for x in (*others, lesson)):
        found["mean_lesson_rmse_m"] = _rmse(MeanLesson.of(others).path(lesson), lesson)
    return found


def _rmse(path: Array, lesson: Demonstration) -> float:
    return float(np.sqrt(((path - lesson.position) ** 2).sum(axis=1).mean()))


def overall(predictions: Sequence[Prediction]) -> dict[str, float]:
    """Means over the files; a file in which nothing moves has no R², and is no part of its mean."""
    return _over(predictions, np.nanmean)


def medians(predictions: Sequence[Prediction]) -> dict[str, float]:
    """As `overall`: what one odd file cannot move."""
    return _over(predictions, np.nanmedian)


def _over(predictions: Sequence[Prediction], typical: Callable[[Array], Any]) -> dict[str, float]:
    values = {name: np.array([getattr(p, name) for p in predictions], dtype=float) for name in (*OVERALL, *BESIDE)}
    return {name: float("nan") if np.isnan(v).all() else float(typical(v)) for name, v in values.items()}


def one_step_velocity(learned: LearnedSkill, lesson: Demonstration) -> Array:
    """(T, d) v_hat of eq. (5)."""
    frames, model = _frames(learned, lesson), learned.model
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    literal = learned.law == "paper"
    regression = Regression(model, inputs, "velocity", input_noise={} if literal else _doubt(learned, INPUT_DOUBT))
    given = [model.channels.index(c) for c in regression.inputs]
    moving = [i for i, c in enumerate(model.channels) if c.startswith("velocity.")]
    seen = frames.copy()
    seen[1:, moving] = frames[:-1, moving]
    seen[0, moving] = np.nan
    forward = ForwardFilter(model if literal else blurred(model, _doubt(learned, WEIGHT_DOUBT)))
    known = frames[:, given]
    low, high = np.array(-np.inf), np.array(np.inf)
    if not literal:
        known = np.clip(known, *taught_range(model, regression.inputs))
        low, high = taught_range(model, regression.outputs)
    return np.array([np.clip(regression.mean(forward.step(xi), x), low, high) for xi, x in zip(seen, known, strict=True)])


def free_run(learned: LearnedSkill, lesson: Demonstration) -> Array:
    """(T, d) the path from the lesson's first position under its recorded force. A skill of law "paper" runs that law."""
    if learned.law == "paper":
        law = law_from(learned.settings)
    else:
        channels = FREE_RUN.weight_channels if learned.has_force else ("position",)
        law = replace(FREE_RUN, weight_channels=channels, weight_noise=tuple(_doubt(learned, WEIGHT_DOUBT).items()))
    force = lesson.force if learned.has_force else np.zeros_like(lesson.position)
    plant = ReplayPlant(force, dt=lesson.dt, start_position=lesson.position[0], axes=learned.axes)
    skill = PaperSkill(
        learned.model,
        axes=learned.axes,
        dt=lesson.dt,
        model_dt=learned.dt,
        workspace=learned.workspace,
        law=law,
    )
    return np.array(unbroken(run(plant, skill, duration_s=len(lesson) * lesson.dt))["hand.position"].values)


def leave_one_out(
    lessons: Sequence[Demonstration],
    *,
    progress: Callable[[int, int], None] | None = None,
    **learning: Any,
) -> list[Prediction]:
    """Each lesson predicted by a skill learned from all the others. `learning` goes to `learn`.

    Fragments of one recording (cut at gaps: name#0, name#1) are left out together: one would teach what is asked of the other.
    """
    takes = takes_of(lessons)
    if len(set(takes)) < 2:
        fragments = f", in {len(lessons)} fragments" if len(lessons) > 1 else ""
        raise ParameterError(f"leave-one-out needs at least 2 recordings; got {len(set(takes))}{fragments}")
    found = []
    for i, lesson in enumerate(lessons):
        others = [other for other, take in zip(lessons, takes, strict=True) if take != takes[i]]
        found.append(predict(learn(others, **learning), lesson, others))
        if progress is not None:
            progress(i + 1, len(lessons))
    return found


def takes_of(lessons: Sequence[Demonstration]) -> list[tuple[str, str]]:
    """Which recording each lesson is of: pieces of one that was cut at gaps share theirs."""
    return [_take(lesson, i) for i, lesson in enumerate(lessons)]


def _take(lesson: Demonstration, number: int) -> tuple[str, str]:
    """Which recording a lesson is: its own, unless it is a fragment."""
    name, cut, _ = lesson.name.rpartition("#")
    return (lesson.source, name) if cut else (f"lesson {number}", "")


def _doubt(learned: LearnedSkill, share: float) -> dict[str, float]:
    """Variance by position channel: `share` of the range that the lessons cover, squared. (W is that range, twice as wide.)"""
    ranges = 0.5 * (learned.workspace[:, 1] - learned.workspace[:, 0])
    return {f"position.{axis}": float((share * r) ** 2) for axis, r in zip(learned.axes, ranges, strict=True)}


def _frames(learned: LearnedSkill, lesson: Demonstration) -> Array:
    if abs(lesson.dt / learned.dt - 1.0) > 0.01:
        raise ParameterError(
            f"{lesson.name} has {1 / lesson.dt:g} Hz and the skill was learned at {1 / learned.dt:g} Hz; resample with --rate-hz"
        )
    return lesson.array(learned.model.channels)


def _fit_of(predicted: Array, actual: Array) -> tuple[float, list[float], float, list[float]]:
    """R^2 over all axes and per axis, RMSE over all axes and per axis. An axis that never moves has no R^2 (nan)."""
    wrong = ((predicted - actual) ** 2).sum(axis=0)
    spread = ((actual - actual.mean(axis=0)) ** 2).sum(axis=0)
    per_axis = [float(1.0 - w / s) if s > 0 else float("nan") for w, s in zip(wrong, spread, strict=True)]
    total = float(1.0 - wrong.sum() / spread.sum()) if spread.sum() > 0 else float("nan")
    rmse_axes = np.sqrt(wrong / len(actual))
    return total, per_axis, float(np.sqrt(wrong.sum() / len(actual))), [float(v) for v in rmse_axes]
