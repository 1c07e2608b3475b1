"""Who is tried: the laws of this package and the baselines of the field, by name (`parts.LAWS`), all within the same
safety envelope.

"without-lessons" is the default law with nothing learned but where and how long: told to follow, its compliance alone; told to
lead, straight by minimum jerk between the lessons' ends in their time; told nothing, nothing foreseen and its evidence of roles
frozen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..errors import ParameterError
from ..interfaces import Array, Skill
from ..learned.skill import LearnedSkill
from ..parts import LAWS, known
from ..reproduction import enveloped, goal_of, make_auto, make_skill, references_of
from ..skills.baselines import ActivePassive, Homotopy, MassDamper, MinimumJerkFollower, RigidMinimumJerk, VariableDamping
from ..skills.collaborate import CollaborativeLaw, CollaborativeSkill, Watch
from ..skills.reference import PhaseReference
from ..skills.roles import RoleSkill
from ..tasks import Task
from .policies import is_policy, policy_skill

TUNED = {
    "mass_kg": 6.0,
    "damping_ns_per_m": 20.0,
}  # best by success, then effort, of a grid on training partners (docs/results.md)


def told(learned: Mapping[str, LearnedSkill], goal: Array) -> Mapping[str, LearnedSkill]:
    """The skills with the path of the goal near this place first, which is the one that is led to."""

    def first(one: LearnedSkill) -> LearnedSkill:
        n = goal_of(one, goal) or 0
        return replace(one, paths=(*one.paths[n : n + 1], *one.paths[:n], *one.paths[n + 1 :]))

    return {role: first(one) for role, one in learned.items()}


def contestant(
    law: str,
    role: str,
    learned: Mapping[str, LearnedSkill],
    *,
    dt: float,
    envelope: bool = True,
    goal: Array | None = None,
    task: Task | None = None,
) -> Skill:
    """The skill that `law`, of `parts.LAWS` or a policy's file (`trials.policies`), stands for.

    Told `role` ("auto": told nothing). A baseline takes from the lessons only where they end.

    goal   (d,) [m] where the task is to end, for who leads: of several taught goals, baselines too take the nearest

    Raises ParameterError for a law that is unknown, that cannot do without being told its role, or without skills of both roles.
    """
    learned = learned if goal is None else told(learned, goal)
    axes = any_of(learned).axes
    if is_policy(law):
        policy = policy_skill(law, role, learned, axes=axes, dt=dt, goal=goal, task=task)
        return enveloped(policy, axes=axes, dt=dt) if envelope else policy
    part = known("law", law, LAWS)
    if role == "auto" and not part.untold:
        able = ", ".join(name for name, other in LAWS.items() if other.untold)
        raise ParameterError(f"law {law!r} has to be told its role; auto works with: {able}")
    if part.both and not {"leader", "follower"} <= set(learned):
        raise ParameterError(f"law {law!r} needs skills of both roles; got: {', '.join(learned)}")
    if part.states is not None and role == "auto":
        return make_auto(learned, axes=axes, dt=dt, law=law, envelope=envelope)
    if part.states is not None:
        one = learned[role]
        return make_skill(one, axes=one.axes, dt=dt, law=law, role=role, envelope=envelope)
    skill: Skill = part.load()(role, learned, dt)
    return enveloped(skill, axes=axes, dt=dt) if envelope else skill


def any_of(learned: Mapping[str, LearnedSkill]) -> LearnedSkill:
    return learned["leader"] if "leader" in learned else next(iter(learned.values()))


def mass_damper(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """A mass and a damper of the best constants that were found."""
    return MassDamper(n_axes=len(any_of(learned).axes), dt=dt, **TUNED)


def damping(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """A damper alone."""
    return MassDamper(n_axes=len(any_of(learned).axes), dt=dt, mass_kg=0.0, damping_ns_per_m=40.0)


def variable_damping(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """A mass with damping that falls when the partner speeds up."""
    return VariableDamping(n_axes=len(any_of(learned).axes), dt=dt)


def _leading_by_minimum_jerk(learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """From the lessons' start to their mean end in their usual time, with the compliance of the default law's leader."""
    one = any_of(learned)
    return CollaborativeSkill(
        one.model,
        PhaseReference.minimum_jerk(references_of(one)[0]),
        role="leader",
        axes=one.axes,
        dt=dt,
        model_dt=one.dt,
        law=CollaborativeLaw.for_role("leader", yield_gain_per_n=0.0),
    )


def minimum_jerk(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """Told to lead, straight between the lessons' ends; told to follow, with the partner's foreseen minimum jerk."""
    if role == "leader":
        return _leading_by_minimum_jerk(learned, dt)
    return MinimumJerkFollower(n_axes=len(any_of(learned).axes), dt=dt)


def _straight(one: LearnedSkill) -> PhaseReference:
    """From where the lessons began to where they ended on average, in their usual time."""
    return PhaseReference.minimum_jerk(references_of(one)[0])


# Of a follower: compliance alone.
UNTAUGHT: dict[str, Any] = {"anticipation": 0.0, "foresight": 0.0, "untaught_damping_ns_per_m": 0.0}


def without_lessons(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """The default law with a straight minimum jerk for what was learned; told nothing it has the path to lead, no evidence, and
    foresees nothing."""
    if role == "follower":
        one = learned[role]
        return make_skill(one, axes=one.axes, dt=dt, law="default", role=role, envelope=False, **UNTAUGHT)
    one = learned["leader"]
    return RoleSkill(
        Watch(one.model, one.dt, dt),
        references_of(one) if role == "auto" else _straight(one),
        leading=CollaborativeLaw.for_role("leader"),
        following=CollaborativeLaw.for_role("follower", **UNTAUGHT),
        axes=one.axes,
        dt=dt,
        leads=role == "leader",
    )


def rigid(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """Goes its way whatever it is told and whatever it feels."""
    return RigidMinimumJerk(_straight(any_of(learned)), dt=dt)


def homotopy(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """Between leading by minimum jerk and the mass-damper, by what it feels."""
    return Homotopy(
        _leading_by_minimum_jerk(learned, dt), mass_damper(role, learned, dt), n_axes=len(any_of(learned).axes), dt=dt
    )


def active_passive(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """As the densities of both roles' lessons tell, one of the two."""
    leader, follower = learned["leader"], learned["follower"]
    assert leader.clock is not None
    assert follower.clock is not None
    return ActivePassive(
        _leading_by_minimum_jerk(learned, dt),
        mass_damper(role, learned, dt),
        passive=leader.clock,
        active=follower.clock,
        axis=leader.axes[0],
        n_axes=len(leader.axes),
        dt=dt,
    )


ABLATION = {  # role -> what the default law is compared with, the same law without lessons first
    "leader": ("without-lessons", "even", "rigid", "minimum-jerk", "mass-damper", "variable-damping", "homotopy"),
    "follower": ("without-lessons", "minimum-jerk", "mass-damper", "variable-damping", "homotopy"),
    "auto": ("without-lessons", "mass-damper", "variable-damping", "homotopy"),
}
