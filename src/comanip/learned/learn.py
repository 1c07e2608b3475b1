"""From demonstrations to a LearnedSkill."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import __version__
from ..errors import ChannelError, check_generator
from ..fitting.climb import Fit
from ..fitting.hmm import fit_hmm
from ..interfaces import Array
from ..lessons.agreement import few_frames, lessons_only, to_the_goal
from ..lessons.demonstration import Demonstration, check_set, require
from ..models.clock import learn_clock
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..models.stability import stability, warnings_of
from ..models.taught_path import TaughtPath, taught_paths
from ..parts import check_settings, known, learned_laws
from ..recording import check_role
from .held_out import held_out_scores
from .skill import LearnedSkill

SHAKING_N = 2.0  # an oscillation of this amplitude above the law's threshold is as much as one may ask a person to bear


def learn(
    demonstrations: Sequence[Demonstration],
    *,
    n_states: int | None = None,
    law: str = "default",
    role: str | None = None,
    with_force: bool = True,
    topology: str = "left-right",
    initial_guess: str = "time",
    restarts: int = 1,
    rng: np.random.Generator | None = None,
    covariance_floor: float = 1e-4,
    settings: Mapping[str, Any] | None = None,
    allow_constant: float | Mapping[str, float] | None = None,
) -> LearnedSkill:
    """A skill from several lessons of one role; milliseconds for five lessons of a few seconds.

    n_states   default 10 (law "default") or 5 (law "paper"); `fitting.selection.select_states` chooses by data
    role       "leader", "follower" or "natural": what lessons that state none are of; must agree with those that do; None takes
               their word
    allow_constant  standard deviation of channels that never change, one number or by channel; they are refused otherwise
    with_force False learns position and velocity only (the paper's footnote 3)

    Raises TrainingError, ChannelError or RecordingError that name the lesson and what to do.
    """
    check_role(role)
    given = lessons_only(demonstrations)
    lessons = [replace(one, role=role) if role and not one.role else one for one in given]
    n_states = states_of(law, n_states, settings or {})
    if rng is not None:
        check_generator(rng)
    groups = ("position", "force", "velocity") if with_force else ("position", "velocity")
    require(lessons, groups)
    notes = list(check_set(given, role=role))  # of the lessons as they came: a role that they do not state is said
    channels = _channels(lessons, groups)
    frames = [lesson.array(channels) for lesson in lessons]
    fit = fit_hmm(
        frames,
        n_states,
        channels=channels,
        topology=topology,
        initial_guess=initial_guess,
        restarts=restarts,
        rng=rng,
        covariance_floor=covariance_floor,
        allow_constant=allow_constant,
    )
    positions = [lesson.position for lesson in lessons]
    whole = to_the_goal(lessons, notes)
    ways = [lesson.position for lesson in whole]
    forces = [lesson.force if with_force else np.zeros_like(lesson.position) for lesson in whole]
    dt, ordered = lessons[0].dt, in_order(fit.model, topology)
    return assembled(
        fit,
        law=law,
        settings=settings or {},
        role=role or _role(lessons),
        axes=lessons[0].axes,
        dt=dt,
        topology=topology,
        clock=learn_clock(fit.model, frames, dt, covariance_floor=covariance_floor) if ordered else None,
        taught=taught_paths(ways, forces, dt) if ordered else NO_PATHS,
        starts=np.array([p[0] for p in ways]),
        ends=np.array([p[-1] for p in ways]),
        workspace=workspace_around(positions),
        units={g: lessons[0].units.get(g, "") for g in groups},
        lessons=[{"name": x.name, "source": x.source, "sha256": x.sha256, "frames": len(x)} for x in lessons],
        notes=[*dict.fromkeys(note for lesson in lessons for note in lesson.notes), *notes],
        held_out=held_out_scores(
            fit.model, frames, topology=topology, covariance_floor=covariance_floor, allow_constant=allow_constant
        ),
    )


NO_PATHS: tuple[tuple[TaughtPath, ...], Array] = ((), np.zeros(0))


def states_of(law: str, n_states: int | None, settings: Mapping[str, Any]) -> int:
    """K for this law, `n_states` or what is usual. ParameterError for an unknown law, or one that lacks one of the settings."""
    usual = known("law", law, learned_laws()).states
    check_settings(law, settings)
    assert usual is not None
    return usual if n_states is None else n_states


def in_order(model: Hmm, topology: str) -> bool:
    """Whether its states come one after another, so that there is a clock and a path."""
    return topology == "left-right" and model.n_states > 1


def assembled(
    fit: Fit,
    *,
    law: str,
    settings: Mapping[str, Any],
    role: str,
    axes: tuple[str, ...],
    dt: float,
    topology: str,
    clock: Gmm | None,
    taught: tuple[tuple[TaughtPath, ...], Array],
    starts: Array,
    ends: Array,
    workspace: Array,
    units: Mapping[str, str],
    lessons: Sequence[Mapping[str, Any]],
    notes: Sequence[str],
    held_out: Sequence[float] = (),
) -> LearnedSkill:
    """The skill that a fit comes to, in which every way of learning ends.

    taught    paths and onsets (lessons,) [s], as `taught_paths` gives them
    lessons   what is told of each: its name, where it is from ...
    held_out  scores of lessons left out, where they were taken
    notes     what was said of the lessons; notes of the fit, of stability and of goals come behind
    """
    paths, onsets_s = taught
    few = few_frames(fit.n_frames, fit.model.n_states, len(fit.model.channels))
    said = [*notes, *fit.notes, *few, *stability_notes(fit.model, law, role, settings), *goal_notes(paths, axes)]
    return LearnedSkill(
        model=fit.model,
        clock=clock,
        role=role,
        axes=axes,
        dt=dt,
        workspace=workspace,
        ends=ends,
        law=law,
        settings=settings,
        units=units,
        provenance={
            "comanip": __version__,
            "lessons": [dict(one) for one in lessons],
            "notes": said,
            "log_likelihood": [float(v) for v in fit.log_likelihood],
            "converged": fit.converged,
            "bic": fit.bic,
            "n_frames": fit.n_frames,
            "topology": topology,
            "held_out": list(held_out),
        },
        paths=paths,
        onsets_s=onsets_s,
        starts=starts,
    )


def goal_notes(paths: Sequence[TaughtPath], axes: Sequence[str]) -> list[str]:
    """One line where the lessons have several goals: how many lead to each, and where it is."""
    if len(paths) < 2:
        return []
    at = ["; ".join(f"{a} {x:.3g}" for a, x in zip(axes, path.ends.mean(axis=0), strict=True)) for path in paths]
    each = [
        f"goal {n + 1} of {len(p.ends)} lessons, ending at {where} m" for n, (p, where) in enumerate(zip(paths, at, strict=True))
    ]
    return [f"the lessons lead to {len(paths)} goals, and none is the mean of others: {', '.join(each)}"]


def stability_notes(model: Hmm, law: str, role: str, settings: Mapping[str, Any]) -> list[str]:
    """What is known of stability before anybody holds the other end, one warning a line; see `models.stability`."""
    from ..skills.collaborate import CollaborativeLaw

    compliant = CollaborativeLaw.for_role(role, **({} if law == "paper" else settings))
    shaking = compliant.moving_damping_ns_per_m + SHAKING_N * compliant.shake_damping_ns_per_m_per_n
    return warnings_of(stability(model), law, (compliant.virtual_mass_kg, shaking))


def workspace_around(positions: Sequence[Array], margin: float = 0.5) -> Array:
    """(d, 2) the box of all positions (T, d), each side moved out by `margin` of its range; never of zero width."""
    low = np.min([p.min(axis=0) for p in positions], axis=0)
    high = np.max([p.max(axis=0) for p in positions], axis=0)
    room = np.maximum(margin * (high - low), 1e-3)
    return np.column_stack([low - room, high + room])


def _channels(lessons: Sequence[Demonstration], groups: Sequence[str]) -> tuple[str, ...]:
    channels = tuple(c for c in lessons[0].channels if c.split(".")[0] in groups)
    for lesson in lessons:
        others = tuple(c for c in lesson.channels if c.split(".")[0] in groups)
        if others != channels:
            raise ChannelError(f"{lesson.name} has channels {others}, {lessons[0].name} has {channels}")
    return channels


def _role(lessons: Sequence[Demonstration]) -> str:
    roles = {lesson.role for lesson in lessons}
    if len(roles) > 1:
        warnings.warn(f"lessons of several roles {sorted(roles)}: the skill states none", stacklevel=3)
        return ""
    return roles.pop()
