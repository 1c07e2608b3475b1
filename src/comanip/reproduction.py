"""From a LearnedSkill to a running Skill."""

from __future__ import annotations

from typing import Any

from .interfaces import Skill
from .learned import LearnedSkill, check_fits


def make_skill(
    learned: LearnedSkill, *, axes: tuple[str, ...], dt: float, law: str | None = None, role: str | None = None, **settings: Any
) -> Skill:
    """The skill that runs `learned` on a robot with these axes and control period [s].

    law       "default" or "paper"; None takes the skill's own, with its stored settings
    role      only for a skill that states none; another role than the stated is a MismatchError
    settings  of the law, on top of the stored ones
    """
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
