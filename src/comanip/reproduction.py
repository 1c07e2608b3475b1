"""From a LearnedSkill to a running Skill."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .interfaces import Skill
from .learned import LearnedSkill, check_fits

if TYPE_CHECKING:
    from .skills.envelope import Limits


def make_skill(
    learned: LearnedSkill,
    *,
    axes: tuple[str, ...],
    dt: float,
    law: str | None = None,
    role: str | None = None,
    envelope: bool | Limits = False,
    **settings: Any,
) -> Skill:
    """The skill that runs `learned` on a robot with these axes and control period [s].

    law       "default" or "paper"; None takes the skill's own, with its stored settings
    role      only for a skill that states none; another role than the stated is a MismatchError
    envelope  True, or the Limits, puts the safety envelope around it (docs/safety.md)
    settings  of the law, on top of the stored ones
    """
    skill = _law(learned, axes=axes, dt=dt, law=law, role=role, settings=settings)
    if envelope is False:
        return skill
    from .skills.envelope import Envelope, Limits

    return Envelope(skill, axes=axes, dt=dt, limits=Limits() if envelope is True else envelope)


def _law(
    learned: LearnedSkill, *, axes: tuple[str, ...], dt: float, law: str | None, role: str | None, settings: dict[str, Any]
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
