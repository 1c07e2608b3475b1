"""From a LearnedSkill to a running Skill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import MismatchError, ParameterError
from .interfaces import Skill
from .learned.skill import LearnedSkill, check_fits
from .models.frames import carried
from .parts import Law, check_settings, known, learned_laws, wanted

if TYPE_CHECKING:
    from .interfaces import Array
    from .safety.limits import Limits
    from .skills.collaborate import CollaborativeLaw
    from .skills.reference import PhaseReference
    from .skills.roles import RolePolicy


RUNS = ("default", "lqt", "even", "paper")


def make_skill(
    learned: LearnedSkill,
    *,
    axes: tuple[str, ...],
    dt: float,
    law: str | None = None,
    role: str | None = None,
    envelope: bool | Limits = True,
    gives_way: bool = True,
    start: Array | None = None,
    goal: int | Array | None = None,
    **settings: Any,
) -> Skill:
    """The skill that runs `learned` on a robot with these axes and control period [s].

    law       "default", firm where lessons agreed and compliant where they differed; "lqt", the same, but refuses lessons that do
              not say how far they differ; "even", the same, but everywhere alike; "paper"; or another of `parts.learned_laws()`.
              None takes the skill's own, with its stored settings
    role      only for a skill that states none; another role than the stated is a MismatchError
    envelope  the safety envelope around it (docs/safety.md): on, with walls and speed as taught; off; or on with these Limits,
              with walls as taught where they state none
    gives_way whether a leader under the default law gives way to a partner who insists; False only where nobody is: recorded
              force that is played back cannot answer
    start     (d,) [m] where the task now begins, None: as taught
    goal      where the lessons had several: its number as `learn` says it, from 1; or a position (d,) [m], to which the path of
              the nearest goal is carried (`models.frames`); None: a follower infers it, a leader takes the one of most lessons
    settings  of the law, on top of the stored ones
    """
    name = law or learned.law
    part = known("law", name, learned_laws())
    check_fits(learned, axes=axes, dt=dt, role=role)
    if name == "paper" and (start is not None or goal is not None):
        raise ParameterError(f"law 'paper' has no {'goals' if goal is not None else 'frames'}: law 'default' has")
    learned, which = carried_to(learned, start, goal)
    role, settings = role or learned.role, {**stored_settings(learned, name), **settings}
    check_settings(name, settings)
    asked = _told(name, part, goal=None if which is None else which + 1, gives_way=gives_way)
    skill = part.load()(role, {role: learned}, dt, **asked, **settings)
    return _made_for(skill, axes, dt) if envelope is False else _within([learned], skill, part, envelope, axes, dt)


def make_auto(
    learned: Mapping[str, LearnedSkill],
    *,
    axes: tuple[str, ...],
    dt: float,
    law: str | None = None,
    envelope: bool | Limits = True,
    policy: RolePolicy | None = None,
    goal: int | Array | None = None,
) -> Skill:
    """A skill that finds out by itself whether to lead or to follow. Settings stored with the skills count, each for its role.

    learned   by role: "leader" and "follower", and "natural" if there are such lessons
    law       one that can do without being told (`parts.LAWS`): "default", "lqt", "even"; None takes the skills' own, and refuses
              "paper"
    policy    when it takes over and gives way; default: `skills.roles.RolePolicy.taught`, as patient as lessons ask
    goal      as for `make_skill`
    """
    if missing := [role for role in ("leader", "follower") if role not in learned]:
        raise ParameterError(f"role 'auto' needs skills of both roles; missing: {', '.join(missing)}")
    for one in learned.values():
        check_fits(one, axes=axes, dt=dt)
    name = _untold(law, learned)
    part = learned_laws()[name]
    lead, which = carried_to(learned["leader"], None, goal)
    asked = _told(name, part, goal=None if which is None else which + 1, policy=policy)
    skill = part.load()("auto", {**learned, "leader": lead}, dt, **asked)
    return (
        _made_for(skill, axes, dt) if envelope is False else _within([lead, *learned.values()], skill, part, envelope, axes, dt)
    )


def _untold(law: str | None, learned: Mapping[str, LearnedSkill]) -> str:
    """Name of the law for a robot that is told nothing: `law`, or that which both skills were learned for."""
    able = {name for name, part in learned_laws().items() if part.untold}
    chosen = {role: law or learned[role].law for role in ("leader", "follower")}
    for role, name in chosen.items():
        known("law", name, learned_laws())
        if name not in able:
            whose = "" if law else f" (the {role}'s skill was learned for it)"
            raise ParameterError(f"law {name!r} has to be told its role{whose}; role 'auto' works with law {_quoted(able)}")
    if len(set(chosen.values())) > 1:
        said = " and ".join(f"the {role}'s for {name!r}" for role, name in chosen.items())
        raise ParameterError(f"the skills were learned for two laws, {said}; say which one runs: law {_quoted(able)}")
    return chosen["leader"]


def _quoted(names: set[str]) -> str:
    return " or ".join(repr(name) for name in sorted(names))


def _told(name: str, part: Law, **asked: Any) -> dict[str, Any]:
    """What the law's maker takes of goal, gives_way and policy; a goal or a policy that it does not take is refused."""
    taken = wanted(part.load(), asked)
    for what in ("goal", "policy"):
        if asked.get(what) is not None and what not in taken:
            raise ParameterError(f"law {name!r} takes no {what}; leave it out")
    return taken


def _within(
    learned: Sequence[LearnedSkill], skill: Skill, part: Law, envelope: bool | Limits, axes: tuple[str, ...], dt: float
) -> Skill:
    return enveloped(skill, learned, axes=axes, dt=dt, limits=_stated(envelope), yields=part.yields)


def references_of(learned: LearnedSkill) -> tuple[PhaseReference, ...]:
    """The path to each goal, as a law runs it; of a skill of an older version the one that its clock expects."""
    from .skills.reference import PhaseReference

    if learned.paths:
        return tuple(PhaseReference.taught(path) for path in learned.paths)
    if learned.clock is None:
        raise MismatchError("the default law needs states in order of time: learn with topology left-right")
    return (PhaseReference.learned(learned.clock, learned.ends.mean(axis=0)),)


def carried_to(learned: LearnedSkill, start: Array | None, goal: int | Array | None) -> tuple[LearnedSkill, int | None]:
    """The skill with its paths from `start` and to `goal`, as for `make_skill`, and the index of the path that is meant."""
    which = goal_of(learned, goal)
    place = np.asarray(goal, dtype=float) if which is not None and learned.paths else None
    place = None if place is None or place.ndim == 0 else place  # a number carries nothing
    begins = None if start is None else _start_of(learned, start)
    if place is None and begins is None:
        return learned, which
    if place is None:
        paths = tuple(carried(path, begins) for path in learned.paths)
    else:  # one goal was said: there is no other
        assert which is not None
        paths, which = (carried(learned.paths[which], begins, place),), 0
    met = np.vstack([path.position for path in paths])
    box = np.column_stack([np.minimum(learned.workspace[:, 0], met.min(0)), np.maximum(learned.workspace[:, 1], met.max(0))])
    return replace(learned, paths=paths, ends=np.vstack([path.ends for path in paths]), workspace=box), which


def _start_of(learned: LearnedSkill, start: Array) -> Array:
    place = np.asarray(start, dtype=float)
    if place.shape != (len(learned.axes),) or not np.isfinite(place).all():
        raise ParameterError(f"a start is a position on the axes {', '.join(learned.axes)} [m]; got {start!r}")
    if not learned.paths:
        raise MismatchError("this skill is of a version that stores no path to carry to another start: learn it again")
    return place


def goal_of(learned: LearnedSkill, goal: int | Array | None) -> int | None:
    """Index of the path that `goal`, a number from 1 or a position (d,) [m], means."""
    if goal is None:
        return None
    n = max(len(learned.paths), 1)
    place = np.asarray(goal, dtype=float)
    if place.ndim == 0:
        if float(place) not in range(1, n + 1):
            raise ParameterError(f"goal {goal} is unknown; the lessons have {n}: give a number from 1 to {n}, or a position")
        return int(place) - 1
    if place.shape != (len(learned.axes),) or not np.isfinite(place).all():
        raise ParameterError(f"a goal is a number or a position on the axes {', '.join(learned.axes)} [m]; got {goal!r}")
    return int(np.argmin([np.linalg.norm(path.ends.mean(axis=0) - place) for path in learned.paths])) if learned.paths else 0


def stored_settings(learned: LearnedSkill, law: str) -> dict[str, Any]:
    """Settings that were stored with the skill, if they are of this law."""
    return dict(learned.settings) if learned.law == law else {}


def _made_for(skill: Skill, axes: tuple[str, ...], dt: float) -> Skill:
    """`skill` with the axes and the period that it was made for, which the loop compares with the plant's."""
    skill.axes, skill.dt = tuple(axes), dt  # type: ignore[attr-defined]
    return skill


def _tracked(learned: LearnedSkill, law: str, attraction_per_s: float) -> tuple[PhaseReference, ...]:
    """`references_of`, and how firmly each is tracked where: law "even" everywhere alike, as does who knows of no spread."""
    references = references_of(learned)
    if law == "even" or (law == "default" and not all(r.spread.any() for r in references)):
        return references
    return tuple(r.tracked(attraction_per_s) for r in references)


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


def paper_law(role: str, learned: Mapping[str, LearnedSkill], dt: float, **settings: Any) -> Skill:
    """Eq. (5) of the paper."""
    from .skills.paper import PaperSkill, law_from

    one = learned[role]
    return PaperSkill(one.model, axes=one.axes, dt=dt, model_dt=one.dt, workspace=one.workspace, law=law_from(settings))


def default_law(
    role: str,
    learned: Mapping[str, LearnedSkill],
    dt: float,
    *,
    goal: int | Array | None = None,
    gives_way: bool = True,
    policy: RolePolicy | None = None,
    tracking: str = "default",
    **settings: Any,
) -> Skill:
    """The law of docs/laws.md; a leader who `gives_way`, and a robot that is told nothing, may change its role."""
    from .skills.collaborate import CollaborativeLaw, CollaborativeSkill

    if role == "auto":
        return _told_nothing(learned, tracking, dt, goal, policy)
    one = learned[role]
    law = CollaborativeLaw.for_role(role, **settings)
    if role == "leader" and gives_way:
        return _role_skill(one, tracking, law, dt, goal=goal, leads=True)
    return CollaborativeSkill(
        one.model,
        _tracked(one, tracking, law.attraction_per_s),
        role=role,
        axes=one.axes,
        dt=dt,
        model_dt=one.dt,
        law=law,
        goal=goal_of(one, goal),
    )


lqt_law = partial(default_law, tracking="lqt")  # the default law, of lessons that say how far they differ
even_law = partial(default_law, tracking="even")  # the default law, as firm everywhere


def _told_nothing(
    learned: Mapping[str, LearnedSkill], tracking: str, dt: float, goal: int | Array | None, policy: RolePolicy | None
) -> Skill:
    from .skills.collaborate import CollaborativeLaw
    from .skills.evidence import RoleEvidence
    from .skills.roles import RolePolicy

    leader, follower = (
        CollaborativeLaw.for_role(role, **stored_settings(learned[role], tracking)) for role in ("leader", "follower")
    )
    models = {role: learned[role].model for role in ("leader", "follower", "natural") if role in learned}
    evidence = RoleEvidence(models, dt=learned["leader"].dt)
    policy = policy or RolePolicy.taught(references_of(learned["leader"]), learned["follower"].onsets_s)
    return _role_skill(learned["leader"], tracking, leader, dt, following=follower, evidence=evidence, policy=policy, goal=goal)


def _role_skill(
    learned: LearnedSkill,
    tracking: str,
    law: CollaborativeLaw,
    dt: float,
    *,
    goal: int | Array | None,
    following: CollaborativeLaw | None = None,
    policy: RolePolicy | None = None,
    **about: Any,
) -> Skill:
    from .skills.collaborate import CollaborativeLaw, Watch
    from .skills.roles import RolePolicy, RoleSkill

    references = _tracked(learned, tracking, law.attraction_per_s)
    return RoleSkill(
        Watch(learned.model, learned.dt, dt),
        references,
        leading=law,
        following=following or CollaborativeLaw.for_role("follower"),
        axes=learned.axes,
        dt=dt,
        policy=policy or RolePolicy.taught(references, learned.onsets_s),
        goal=goal_of(learned, goal),
        **about,
    )
