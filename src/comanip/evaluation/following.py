"""A skill's own model followed: its velocity one step ahead, and its way from a start under a recorded force.

one step   v_hat of eq. (5) from this frame's position and force; the state weights of eq. (4) have seen position and force up to
           this frame and velocity up to the frame BEFORE it, so nothing that is predicted is given
free run   from the first frame on only the recorded force is given; position and velocity are the model's own. Weights come from
           position and force alone: a model that listens to its own velocity locks itself into one state
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..loop import run, unbroken
from ..models.filtering import ForwardFilter
from ..models.gmr import Regression
from ..plants.replay import ReplayPlant
from ..skills.paper import PaperLaw, PaperSkill, blurred, law_from, taught_range
from .doubt import INPUT_DOUBT, WEIGHT_DOUBT, doubt

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


def one_step_velocity(learned: LearnedSkill, lesson: Demonstration) -> Array:
    """(T, d) v_hat of eq. (5)."""
    frames, model = frames_of(learned, lesson), learned.model
    inputs = [c for c in model.channels if not c.startswith("velocity.")]
    literal = learned.law == "paper"
    regression = Regression(model, inputs, "velocity", input_noise={} if literal else doubt(learned, INPUT_DOUBT))
    given = [model.channels.index(c) for c in regression.inputs]
    moving = [i for i, c in enumerate(model.channels) if c.startswith("velocity.")]
    seen = frames.copy()
    seen[1:, moving] = frames[:-1, moving]
    seen[0, moving] = np.nan
    forward = ForwardFilter(model if literal else blurred(model, doubt(learned, WEIGHT_DOUBT)))
    known = frames[:, given] if literal else np.clip(frames[:, given], *taught_range(model, regression.inputs))
    h = np.array([forward.step(xi).copy() for xi in seen])
    mean = np.einsum("tk,tko->to", h, regression.means_per_state(known))
    return np.asarray(mean if literal else np.clip(mean, *taught_range(model, regression.outputs)))


def free_run(learned: LearnedSkill, lesson: Demonstration) -> Array:
    """(T, d) the path from the lesson's first position under its recorded force. A skill of law "paper" runs that law."""
    if learned.law == "paper":
        law = law_from(learned.settings)
    else:
        channels = FREE_RUN.weight_channels if learned.has_force else ("position",)
        law = replace(FREE_RUN, weight_channels=channels, weight_noise=tuple(doubt(learned, WEIGHT_DOUBT).items()))
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


def frames_of(learned: LearnedSkill, lesson: Demonstration) -> Array:
    """The lesson in the model's channels; ParameterError at another rate."""
    if abs(lesson.dt / learned.dt - 1.0) > 0.01:
        raise ParameterError(
            f"{lesson.name} has {1 / lesson.dt:g} Hz and the skill was learned at {1 / learned.dt:g} Hz; resample with --rate-hz"
        )
    return lesson.array(learned.model.channels)
