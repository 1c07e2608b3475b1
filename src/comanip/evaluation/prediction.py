"""How well a skill's model predicts recordings: the numbers of `comanip evaluate`.

one step   v_hat of eq. (5) from this frame's position and force; the state weights of eq. (4) have seen position and force up to
           this frame and velocity up to the frame BEFORE it, so nothing that is predicted is given
free run   from the first frame on only the recorded force is given; position and velocity are the model's own. Weights come from
           position and force alone: a model that listens to its own velocity locks itself into one state
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..learned.learn import learn
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.hmm import log_likelihood
from .following import FREE_RUN as FREE_RUN
from .following import frames_of, free_run, one_step_velocity
from .foreseeing import Foreseer, foreseer
from .takes import takes_of as takes_of
from .ways import SKILLS
from .yardsticks import MeanLesson, last_velocity, persistence_log_likelihood, standing_still


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
    # where the figures above are of what was `chosen` on the lessons (`foreseeing`): those of the skill's own model
    skill_velocity_r2: float = float("nan")
    skill_path_rmse_m: float = float("nan")
    chosen: str = ""


PER_AXIS = ("one_step_velocity_r2_per_axis", "one_step_velocity_rmse_per_axis", "free_run_position_rmse_per_axis")
OVERALL = (
    "one_step_velocity_r2",
    "one_step_velocity_rmse",
    "free_run_position_rmse_m",
    "free_run_end_error_m",
    "log_likelihood_per_frame",
)
BESIDE = ("last_velocity_r2", "standing_still_rmse_m", "mean_lesson_rmse_m", "persistence_log_likelihood_per_frame",
          "skill_velocity_r2", "skill_path_rmse_m")  # fmt: skip


def predict(
    learned: LearnedSkill, lesson: Demonstration, others: Sequence[Demonstration] = (), foresight: Foreseer | None = None
) -> Prediction:
    """All figures for one lesson at the skill's own rate.

    others     the lessons it was learned from, for rules that need some
    foresight  what was chosen on these lessons: velocity and path are its, and the skill's own figures stand beside
    """
    frames = frames_of(learned, lesson)
    velocity = one_step_velocity(learned, lesson)
    path = free_run(learned, lesson) if foresight is None else foresight.ways[SKILLS](lesson)
    beside: dict[str, Any] = {}
    if foresight is not None:
        beside = {
            "skill_velocity_r2": _fit_of(velocity, lesson.velocity)[0],
            "skill_path_rmse_m": _rmse(path, lesson),
            "chosen": foresight.chosen,
        }
        velocity, path = foresight.velocity(lesson), foresight.path(lesson)
    r2, r2_axes, rmse, rmse_axes = _fit_of(velocity, lesson.velocity)
    apart = path - lesson.position
    return Prediction(
        name=lesson.name,
        frames=len(lesson),
        log_likelihood_per_frame=float(log_likelihood(learned.model, [frames])[0]) / len(lesson),
        one_step_velocity_r2=r2,
        one_step_velocity_r2_per_axis=r2_axes,
        one_step_velocity_rmse=rmse,
        one_step_velocity_rmse_per_axis=rmse_axes,
        free_run_position_rmse_m=_rmse(path, lesson),
        free_run_end_error_m=float(np.linalg.norm(apart[-1])),
        free_run_position_rmse_per_axis=np.sqrt((apart**2).mean(axis=0)).tolist(),
        **beside,
        last_velocity_r2=_fit_of(last_velocity(lesson), lesson.velocity)[0],
        standing_still_rmse_m=_rmse(standing_still(lesson), lesson),
        **_from_lessons(learned, lesson, others),
    )


def _from_lessons(learned: LearnedSkill, lesson: Demonstration, others: Sequence[Demonstration]) -> dict[str, Any]:
    if not others:
        return {}
    frames = [x.array(learned.model.channels) for x in others]
    found = {"persistence_log_likelihood_per_frame": persistence_log_likelihood(frames_of(learned, lesson), frames)}
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


def leave_one_out(
    lessons: Sequence[Demonstration],
    *,
    progress: Callable[[int, int], None] | None = None,
    choose: bool = False,
    learn_on: Callable[[list[Demonstration]], LearnedSkill] | None = None,
    **learning: Any,
) -> list[Prediction]:
    """Each lesson predicted by a skill learned from all the others. `learning` goes to `learn`, or to what stands for it.

    `learn_on` learns from the others instead. `choose` foresees with what the others vouch for when they are left out in turn
    (`foreseeing`): other inputs, a ridge, several ways; the skill's own figures stand beside.

    Fragments of one recording (cut at gaps: name#0, name#1) are left out together: one would teach what is asked of the other.
    """
    takes = takes_of(lessons)
    if len(set(takes)) < 2:
        fragments = f", in {len(lessons)} fragments" if len(lessons) > 1 else ""
        raise ParameterError(f"leave-one-out needs at least 2 recordings; got {len(set(takes))}{fragments}")
    found = []
    for i, lesson in enumerate(lessons):
        others = [other for other, take in zip(lessons, takes, strict=True) if take != takes[i]]
        learned = learn(others, **learning) if learn_on is None else learn_on(others)
        fitting = {name: learning[name] for name in ("topology", "covariance_floor", "allow_constant") if name in learning}
        foresight = foreseer(learned, others, **fitting) if choose and learned.law != "paper" else None
        found.append(predict(learned, lesson, others, foresight))
        if progress is not None:
            progress(i + 1, len(lessons))
    return found


def _fit_of(predicted: Array, actual: Array) -> tuple[float, list[float], float, list[float]]:
    """R^2 over all axes and per axis, RMSE over all axes and per axis. An axis that never moves has no R^2 (nan)."""
    wrong = ((predicted - actual) ** 2).sum(axis=0)
    spread = ((actual - actual.mean(axis=0)) ** 2).sum(axis=0)
    per_axis = [float(1.0 - w / s) if s > 0 else float("nan") for w, s in zip(wrong, spread, strict=True)]
    total = float(1.0 - wrong.sum() / spread.sum()) if spread.sum() > 0 else float("nan")
    rmse_axes = np.sqrt(wrong / len(actual))
    return total, per_axis, float(np.sqrt(wrong.sum() / len(actual))), [float(v) for v in rmse_axes]
