"""From a LearnedSkill to a running Skill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .errors import MismatchError, ParameterError
from .interfaces import Skill
from .learned.skill import LearnedSkill, check_fits

if TYPE_CHECKING:
    from .safety.limits import Limits
    from .skills.collaborate import CollaborativeLaw
    from .skills.roles import RolePolicy


def make_skill(
    learned: LearnedSkill,
    *,
    axes: tuple[str, ...],
    dt: float,
    law: str | None = None,
    role: str | None = None,
    envelope: bool | Limits = True,
    gives_way: bool = True,
    **settings: Any,
) -> Skill:
    """The skill that runs `learned` on a robot with these axes and control period [s].

    law       "default" or "paper"; None takes the skill's own, with its stored settings
    role      only for a skill that states none; another role than the stated is a MismatchError
    envelope  the safety envelope around it (docs/safety.md): on, with walls and speed as taught; off; or on with these Limits,
              with walls as taught where they state none
    gives_way whether a leader under the default law gives way to a partner who insists; False only where nobody is: recorded
              force that is played back cannot answer
    settings  of the law, on top of the stored ones
    """
    skill = _law(learned, axes=axes, dt=dt, law=law, role=role, gives_way=gives_way, settings=settings)
    if envelope is False:
        return skill
    yields = (law or learned.law) == "default"
    return enveloped(skill, [learned], axes=axes, dt=dt, limits=_stated(envelope), yields=yields)


def make_auto(
    learned: Mapping[str, LearnedSkill],
    *,
    axes: tuple[str, ...],
    dt: float,
    envelope: bool | Limits = True,
    policy: RolePolicy | None = None,
) -> Skill:
    """A skill that finds out by itself whether to lead or to follow.

    learned   by role: "leader" and "follower", and "natural" if there are such lessons
    policy    when it takes over and gives way; see `skills.roles.RolePolicy`
    """
    from .skills.collaborate import CollaborativeLaw
    from .skills.roles import RoleEvidence

    if missing := [role for role in ("leader", "follower") if role not in learned]:
        raise ParameterError(f"role 'auto' needs skills of both roles; missing: {', '.join(missing)}")
    for one in learned.values():
        check_fits(one, axes=axes, dt=dt)
    models = {role: learned[role].model for role in ("leader", "follower", "natural") if role in learned}
    evidence = RoleEvidence(models, dt=learned["leader"].dt)
    skill = _role_skill(learned["leader"], CollaborativeLaw.for_role("leader"), axes, dt, evidence=evidence, policy=policy)
    if envelope is False:
        return skill
    return enveloped(skill, list(learned.values()), axes=axes, dt=dt, limits=_stated(envelope), yields=True)


def _role_skill(learned: LearnedSkill, law: CollaborativeLaw, axes: tuple[str, ...], dt: float, **about: Any) -> Skill:
    from .skills.collaborate import CollaborativeLaw, Watch
    from .skills.reference import PhaseReference
    from .skills.roles import RolePolicy, RoleSkill

    if learned.clock is None:
        raise MismatchError("leading needs states in order of time: learn with topology left-right")
    policy = about.pop("policy", None) or RolePolicy()
    return RoleSkill(
        Watch(learned.model, learned.dt, dt),
        PhaseReference.learned(learned.clock, learned.ends.mean(axis=0)),
        learned.ends,
        leading=law,
        following=CollaborativeLaw.for_role("follower"),
        axes=axes,
        dt=dt,
        policy=policy,
        **about,
    )


def _stated(envelope: bool | Limits) -> Limits | None:
    return None if isinstance(envelope, bool) else envelope


def enveloped(
    skill: Skill,
    learned: Sequence[LearnedSkill] = (),
    *,
    axes: tuple[str, ...],
    dt: float,
    limits: Limits | None = None,
    yields: bool = False,
) -> Skill:
    """`skill` within the safety envelope; its walls, where `limits` state none, and its speed, where there are no `limits`, are
    those of what was `learned`."""
    from .safety.envelope import Envelope
    from .safety.limits import Limits, as_taught

    return Envelope(skill, axes=axes, dt=dt, limits=as_taught(learned, limits, yields=yields) if learned else limits or Limits())


def _law(
    learned: LearnedSkill,
    *,
    axes: tuple[str, ...],
    dt: float,
    law: str | None,
    role: str | None,
    gives_way: bool,
    settings: dict[str, Any],
) -> Skill:
    check_fits(learned, axes=axes, dt=dt, role=role)
    stored = dict(learned.settings) if law in (None, learned.law) else {}
    law, settings = law or learned.law, {**stored, **settings}
    if law == "paper":
        from .skills.paper import PaperSkill, law_from

        return PaperSkill(
            learned.model, axes=axes, dt=dt, model_dt=learned.dt, workspace=learned.workspace, law=law_from(settings)
        )
    from .skills.collaborate import CollaborativeLaw, CollaborativeSkill

    role = role or learned.role
    if role == "leader" and gives_way:
        return _role_skill(learned, CollaborativeLaw.for_role(role, **settings), axes, dt, leads=True)
    return CollaborativeSkill(
        learned.model,
        learned.clock,
        role=role,
        axes=axes,
        dt=dt,
        model_dt=learned.dt,
        law=CollaborativeLaw.for_role(role, **settings),
        end=learned.ends.mean(axis=0),
    )
