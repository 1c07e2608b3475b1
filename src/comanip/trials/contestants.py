"""Who is tried: the laws of this package and the baselines of the field, by name, all within the same safety envelope.

"without-lessons" is the default law with nothing learned but where and how long: told to follow, its compliance alone; told to
lead, straight by minimum jerk between the lessons' ends in their time; told nothing, its evidence of roles frozen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from ..errors import ParameterError
from ..interfaces import Array, Skill
from ..learned.skill import LearnedSkill
from ..reproduction import enveloped, goal_of, make_auto, make_skill, references_of
from ..skills.baselines import ActivePassive, Homotopy, MassDamper, MinimumJerkFollower, RigidMinimumJerk, VariableDamping
from ..skills.collaborate import CollaborativeLaw, CollaborativeSkill, Watch
from ..skills.reference import PhaseReference
from ..skills.roles import RoleSkill

TUNED = {
    "mass_kg": 6.0,
    "damping_ns_per_m": 20.0,
}  # best by success, then effort, of a grid on training partners (docs/results.md)


def contestant(
    law: str,
    role: str,
    learned: Mapping[str, LearnedSkill],
    *,
    dt: float,
    envelope: bool = True,
    goal: Array | None = None,
) -> Skill:
    """The skill that `law` stands for, told `role` ("auto": told nothing). A baseline takes from the lessons only where they end.

    goal   (d,) [m] where the task is to end, for who leads: of several taught goals, baselines too take the nearest

    Raises ParameterError for a law that is unknown, or that cannot do without being told its role.
    """
    if law not in LAWS:
        raise ParameterError(f"law {law!r} is unknown; there are: {', '.join(LAWS)}")
    return LAWS[law](role, learned if goal is None else _told(learned, goal), dt, envelope)


def _told(learned: Mapping[str, LearnedSkill], goal: Array) -> Mapping[str, LearnedSkill]:
    """The skills with the path of the goal near this place first, which is the one that is led to."""

    def first(one: LearnedSkill) -> LearnedSkill:
        n = goal_of(one, goal) or 0
        return replace(one, paths=(*one.paths[n : n + 1], *one.paths[:n], *one.paths[n + 1 :]))

    return {role: first(one) for role, one in learned.items()}


def _own(law: str) -> Maker:
    def make(role: str, learned: Mapping[str, LearnedSkill], dt: float, envelope: bool) -> Skill:
        if role == "auto":
            if law == "paper":
                works = ", ".join(("default", "lqt", "even", *_UNTOLD))
                raise ParameterError(f"law {law!r} has to be told its role; auto works with: {works}")
            return make_auto(learned, axes=learned["leader"].axes, dt=dt, law=law, envelope=envelope)
        one = learned[role]
        return make_skill(one, axes=one.axes, dt=dt, law=law, role=role, envelope=envelope)

    return make


def _baseline(make: Callable[[str, Mapping[str, LearnedSkill], float], Skill]) -> Maker:
    def enclosed(role: str, learned: Mapping[str, LearnedSkill], dt: float, envelope: bool) -> Skill:
        skill = make(role, learned, dt)
        return enveloped(skill, axes=_any(learned).axes, dt=dt) if envelope else skill

    return enclosed


def _any(learned: Mapping[str, LearnedSkill]) -> LearnedSkill:
    return learned["leader"] if "leader" in learned else next(iter(learned.values()))


def _mass_damper(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    return MassDamper(n_axes=len(_any(learned).axes), dt=dt, **TUNED)


def _damping(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    return MassDamper(n_axes=len(_any(learned).axes), dt=dt, mass_kg=0.0, damping_ns_per_m=40.0)


def _variable_damping(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    return VariableDamping(n_axes=len(_any(learned).axes), dt=dt)


def _leading_by_minimum_jerk(learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """From the lessons' start to their mean end in their usual time, with the compliance of the default law's leader."""
    one = _any(learned)
    return CollaborativeSkill(
        one.model,
        PhaseReference.minimum_jerk(references_of(one)[0]),
        role="leader",
        axes=one.axes,
        dt=dt,
        model_dt=one.dt,
        law=CollaborativeLaw.for_role("leader", yield_gain_per_n=0.0),
    )


def _minimum_jerk(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    if role == "auto":
        raise ParameterError(f"law 'minimum-jerk' has to be told its role; auto works with: default, {', '.join(_UNTOLD)}")
    if role == "leader":
        return _leading_by_minimum_jerk(learned, dt)
    return MinimumJerkFollower(n_axes=len(_any(learned).axes), dt=dt)


def _straight(one: LearnedSkill) -> PhaseReference:
    """From where the lessons began to where they ended on average, in their usual time."""
    return PhaseReference.minimum_jerk(references_of(one)[0])


def _without_lessons(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """The default law with a straight minimum jerk for what was learned; told nothing it has the path, and no evidence."""
    if role == "follower":
        one = learned[role]
        return make_skill(one, axes=one.axes, dt=dt, law="default", role=role, envelope=False, anticipation=0.0)
    one = learned["leader"]
    return RoleSkill(
        Watch(one.model, one.dt, dt),
        references_of(one) if role == "auto" else _straight(one),
        leading=CollaborativeLaw.for_role("leader"),
        following=CollaborativeLaw.for_role("follower"),
        axes=one.axes,
        dt=dt,
        leads=role == "leader",
    )


def _rigid(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    """Goes its way whatever it is told and whatever it feels."""
    return RigidMinimumJerk(_straight(_any(learned)), dt=dt)


def _homotopy(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    return Homotopy(_leading_by_minimum_jerk(learned, dt), _mass_damper(role, learned, dt), n_axes=len(_any(learned).axes), dt=dt)


def _active_passive(role: str, learned: Mapping[str, LearnedSkill], dt: float) -> Skill:
    if not {"leader", "follower"} <= set(learned):
        raise ParameterError("law 'active-passive' needs skills of both roles: it compares their lessons")
    leader, follower = learned["leader"], learned["follower"]
    assert leader.clock is not None
    assert follower.clock is not None
    return ActivePassive(
        _leading_by_minimum_jerk(learned, dt),
        _mass_damper(role, learned, dt),
        passive=leader.clock,
        active=follower.clock,
        axis=leader.axes[0],
        n_axes=len(leader.axes),
        dt=dt,
    )


Maker = Callable[[str, Mapping[str, LearnedSkill], float, bool], Skill]
_UNTOLD = ("without-lessons", "rigid", "mass-damper", "damping", "variable-damping", "homotopy", "active-passive")
ABLATION = {  # role -> what the default law is compared with, the same law without lessons first
    "leader": ("without-lessons", "even", "rigid", "minimum-jerk", "mass-damper", "variable-damping", "homotopy"),
    "follower": ("without-lessons", "minimum-jerk", "mass-damper", "variable-damping", "homotopy"),
    "auto": ("without-lessons", "mass-damper", "variable-damping", "homotopy"),
}
LAWS: dict[str, Maker] = {
    "default": _own("default"),
    "lqt": _own("lqt"),
    "even": _own("even"),
    "paper": _own("paper"),
    "mass-damper": _baseline(_mass_damper),
    "damping": _baseline(_damping),
    "variable-damping": _baseline(_variable_damping),
    "minimum-jerk": _baseline(_minimum_jerk),
    "without-lessons": _baseline(_without_lessons),
    "rigid": _baseline(_rigid),
    "homotopy": _baseline(_homotopy),
    "active-passive": _baseline(_active_passive),
}
