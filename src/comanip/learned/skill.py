"""LearnedSkill: the value that learning gives, that a skill file stores and that skills are made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import MismatchError, ParameterError
from ..interfaces import Array
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..models.taught_path import TaughtPath
from ..parts import MODELS, known, learned_laws
from ..recording import Passed, frozen

ALLOWED_DT_S = (0.0002, 0.05)
ABSURD = 1e6  # no robot is so far away, in any unit, nor is any lesson so long


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
    starts      (lessons, d) where each lesson began [m]; empty in a skill of an older version
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
    starts: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        known("law", self.law, learned_laws())
        object.__setattr__(self, "axes", tuple(self.axes))
        object.__setattr__(self, "workspace", frozen(self.workspace))
        object.__setattr__(self, "ends", frozen(self.ends))
        object.__setattr__(self, "onsets_s", frozen(self.onsets_s))
        object.__setattr__(self, "starts", frozen(self.starts))
        object.__setattr__(self, "paths", tuple(self.paths))
        for name in ("settings", "units", "provenance"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        _check_shapes(self)

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


def _check_shapes(learned: LearnedSkill) -> None:
    """ParameterError for numbers that no lessons give: a skill file may be signed and wrong all the same."""
    axes, d = ", ".join(learned.axes), len(learned.axes)
    if not d or len(set(learned.axes)) < d or not all(isinstance(name, str) for name in learned.axes):
        raise ParameterError(f"a skill has one name for each axis, each once; got {learned.axes!r}")
    for name, step_s in (
        ("the period dt of its lessons", learned.dt),
        *(("step_s of its path", p.step_s) for p in learned.paths),
    ):
        if not 0.0 < step_s < ABSURD:
            raise ParameterError(f"{name} must be above 0 s and below {ABSURD:g} s; got {step_s}")
    numbers = {
        "workspace": (learned.workspace, (d, 2)),
        "ends": (learned.ends, (learned.ends.size // d, d)),
        "onsets_s": (learned.onsets_s, (learned.onsets_s.size,)),
        "starts": (learned.starts, (learned.starts.size // d, d)),
        **{
            f"{name} of path {n}": (values := getattr(path, name), (values.size // d, d))
            for n, path in enumerate(learned.paths, start=1)
            for name in ("position", "force", "ends")
        },
    }
    for name, (values, shape) in numbers.items():
        if values.shape != shape and (values.size or name == "workspace"):
            raise ParameterError(f"{name} of a skill with axes {axes} has the shape {shape}; got {values.shape}")
        if not (np.abs(values) < ABSURD).all():
            raise ParameterError(f"{name} holds a value that is no number below {ABSURD:g}")
    if (learned.workspace[:, 0] > learned.workspace[:, 1]).any():
        raise ParameterError(f"workspace is (low, high) of each axis [m]; got {learned.workspace.tolist()}")


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
    if (kind := type(learned.model).__name__) not in (able := [part.object for part in MODELS.values() if part.runs]):
        raise MismatchError(f"the skill's model is {kind!r}, which no law runs; laws run: {', '.join(able)}")
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


def __getattr__(name: str) -> Any:
    """What stood here until it was split: `learn` and what belongs to it."""
    if name in ("learn", "goal_notes", "stability_notes", "workspace_around"):
        return getattr(import_module("comanip.learned.learn"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
