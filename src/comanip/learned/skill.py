"""From demonstrations to a LearnedSkill: the value that a skill file stores and that skills are made from."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from .. import __version__
from ..errors import ChannelError, MismatchError, ParameterError, check_generator
from ..fitting.hmm import fit_hmm
from ..interfaces import Array
from ..lessons.agreement import lessons_only, to_the_goal
from ..lessons.demonstration import Demonstration, check_set, require
from ..models.clock import learn_clock
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..models.stability import stability, warnings_of
from ..models.taught_path import TaughtPath, taught_paths
from ..recording import Passed, check_role, frozen

LAWS = ("default", "paper")
STATES = {"default": 10, "paper": 5}  # 5 is the paper's; 10 predicts better on every set that was tried (docs/results.md)
SHAKING_N = 2.0  # an oscillation of this amplitude above the law's threshold is as much as one may ask a person to bear
ALLOWED_DT_S = (0.0002, 0.05)


@dataclass(frozen=True, eq=False)
class LearnedSkill(Passed):
    """What was learned, with everything needed to run it or to refuse to.

    model       Hmm over "position.*", "force.*", "velocity.*" (no force: learned without it)
    clock       Gmm over ("phase", the same channels); None when the topology has no order in time
    role, law   what the hand does ("leader", "follower", "" when nobody said) and the law that runs it by default
    settings    arguments of that law that differ from its defaults
    axes, dt    task axes, and the period of the lessons [s]
    units       of each channel group, SI
    workspace   (d, 2) the paper's W: positions met in the lessons, widened by half their range [m]
    ends        (lessons, d) where each lesson ended [m]
    paths       what the lessons of each goal have in common, most lessons first; empty in a skill of an older version
    onsets_s    (lessons,) rest before each lesson's motion [s]
    provenance  lessons with their hashes, notes, likelihood, version: what somebody needs to trust or repeat it
    """

    model: Hmm
    clock: Gmm | None
    role: str
    axes: tuple[str, ...]
    dt: float
    workspace: Array
    ends: Array
    law: str = "default"
    settings: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    paths: tuple[TaughtPath, ...] = ()
    onsets_s: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise ParameterError(f"law {self.law!r} is unknown; there are: {', '.join(LAWS)}")
        object.__setattr__(self, "axes", tuple(self.axes))
        object.__setattr__(self, "workspace", frozen(self.workspace))
        object.__setattr__(self, "ends", frozen(self.ends))
        object.__setattr__(self, "onsets_s", frozen(self.onsets_s))
        object.__setattr__(self, "paths", tuple(self.paths))
        for name in ("settings", "units", "provenance"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __repr__(self) -> str:
        lessons = len(self.provenance.get("lessons", ())) or len(self.ends)
        who = f"{self.role}, " if self.role else ""
        return (
            f"LearnedSkill({who}axes {', '.join(self.axes)}, {self.model.n_states} states, {lessons} lessons, law {self.law!r})"
        )

    @property
    def has_force(self) -> bool:
        """Whether the interaction force was learned, too."""
        return any(c.startswith("force.") for c in self.model.channels)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was derived, assumed, removed or suspicious on the way from file to skill, a sentence each."""
        return tuple(self.provenance.get("notes", ()))


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
    if law not in LAWS:
        raise ParameterError(f"law {law!r} is unknown; there are: {', '.join(LAWS)}")
    if rng is not None:
        check_generator(rng)
    groups = ("position", "force", "velocity") if with_force else ("position", "velocity")
    require(lessons, groups)
    notes = list(check_set(given, role=role))  # of the lessons as they came: a role that they do not state is said
    n_states = STATES[law] if n_states is None else n_states
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
    notes.extend(fit.notes)
    notes.extend(stability_notes(fit.model, law, role or lessons[0].role, settings or {}))
    dt = lessons[0].dt
    ordered = topology == "left-right" and fit.model.n_states > 1
    positions = [lesson.position for lesson in lessons]
    whole = to_the_goal(lessons, notes)
    ways = [lesson.position for lesson in whole]
    forces = [lesson.force if with_force else np.zeros_like(lesson.position) for lesson in whole]
    paths, onsets_s = taught_paths(ways, forces, dt) if ordered else ((), np.zeros(0))
    notes.extend(goal_notes(paths, lessons[0].axes))
    return LearnedSkill(
        model=fit.model,
        clock=learn_clock(fit.model, frames, dt, covariance_floor=covariance_floor) if ordered else None,
        role=role or _role(lessons),
        axes=lessons[0].axes,
        dt=dt,
        workspace=workspace_around(positions),
        ends=np.array([p[-1] for p in ways]),
        law=law,
        settings=settings or {},
        units={g: lessons[0].units.get(g, "") for g in groups},
        provenance={
            "comanip": __version__,
            "lessons": [{"name": x.name, "source": x.source, "sha256": x.sha256, "frames": len(x)} for x in lessons],
            "notes": list(dict.fromkeys(note for lesson in lessons for note in lesson.notes)) + notes,
            "log_likelihood": [float(v) for v in fit.log_likelihood],
            "converged": fit.converged,
            "bic": fit.bic,
            "n_frames": fit.n_frames,
            "topology": topology,
        },
        paths=paths,
        onsets_s=onsets_s,
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

    compliant = CollaborativeLaw.for_role(role, **(settings if law == "default" else {}))
    shaking = compliant.moving_damping_ns_per_m + SHAKING_N * compliant.shake_damping_ns_per_m_per_n
    return warnings_of(stability(model), law, (compliant.virtual_mass_kg, shaking))


def workspace_around(positions: Sequence[Array], margin: float = 0.5) -> Array:
    """(d, 2) the box of all positions (T, d), each side moved out by `margin` of its range; never of zero width."""
    low = np.min([p.min(axis=0) for p in positions], axis=0)
    high = np.max([p.max(axis=0) for p in positions], axis=0)
    room = np.maximum(margin * (high - low), 1e-3)
    return np.column_stack([low - room, high + room])


def check_fits(
    learned: LearnedSkill,
    *,
    axes: Sequence[str],
    dt: float,
    role: str | None = None,
    with_force: bool = True,
    units: Mapping[str, str] | None = None,
) -> None:
    """Refuses to arm a skill that was learned for another robot. Raises MismatchError that names both sides."""
    if tuple(axes) != learned.axes:
        raise MismatchError(f"the skill moves axes {learned.axes}; this robot's task has {tuple(axes)}")
    if not ALLOWED_DT_S[0] <= dt <= ALLOWED_DT_S[1]:
        raise MismatchError(
            f"control period {dt} s; a skill runs at {ALLOWED_DT_S[0]} to {ALLOWED_DT_S[1]} s (learned at {learned.dt} s)"
        )
    if not ALLOWED_DT_S[0] <= learned.dt <= ALLOWED_DT_S[1]:
        raise MismatchError(f"the skill's lessons have a period of {learned.dt} s; resample them to 20-5000 Hz")
    if role and learned.role and role != learned.role:
        raise MismatchError(f"the skill was learned as {learned.role!r}; {role!r} was asked for")
    if learned.has_force and not with_force:
        raise MismatchError("the skill needs the interaction force; this robot measures none")
    expected = [f"{g}.{a}" for g in ("position", "force", "velocity") for a in learned.axes]
    stray = [c for c in learned.model.channels if c not in expected]
    absent = [c for c in expected if c not in learned.model.channels and not c.startswith("force.")]
    if stray or absent:
        raise MismatchError(f"the skill's channels are {', '.join(learned.model.channels)}; a robot gives {', '.join(expected)}")
    for group, unit in (units or {"position": "m", "velocity": "m/s", "force": "N"}).items():
        has = learned.units.get(group, "")
        if has and has != unit:
            raise MismatchError(f"the skill's {group} is in {has!r}; this robot's is in {unit!r}")


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
