"""What is exported: a skill within its envelope, and the estimate of the force that it feels; or why it cannot be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interaction import TaringInteractionForce, gravity_along
from ..interfaces import Array
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..parts import LAWS
from ..reproduction import make_auto, make_skill
from ..safety.envelope import Envelope
from ..skills.collaborate import CollaborativeSkill
from ..skills.roles import RoleSkill

MOST_AXES = 6
MOST_DELAY_S = 0.1  # of a force behind the velocity: what is kept of the velocity until it comes is part of the state
MOST_ROWS = 1 << 16  # of all paths together: more than an hour of lessons


@dataclass(frozen=True, eq=False)
class Controller:
    """All that one robot runs at a tick.

    skill      the safety envelope around a skill of the default law
    estimator  eq. (3) on line, tared at the start
    role       "leader", "follower" or "auto"
    hashes     SHA-256 of each skill that it was made from
    """

    skill: Envelope
    estimator: TaringInteractionForce
    axes: tuple[str, ...]
    dt: float
    role: str
    law: str
    hashes: tuple[str, ...]


def controller(
    learned: Sequence[LearnedSkill],
    *,
    role: str | None = None,
    law: str | None = None,
    dt: float | None = None,
    goal: int | None = None,
    gravity: Array | None = None,
    mass_kg: float = 2.0,
    load_share: float = 0.5,
    tare_s: float = 0.25,
    force_delay_s: float = 0.0,
) -> Controller:
    """What is exported of one skill, or of those of both roles for role "auto".

    dt        control period [s]; default the lessons' own
    gravity   (d,) [m/s^2]; default along the axis named "z"
    mass_kg, load_share, tare_s, force_delay_s   as for TaringInteractionForce

    Raises ParameterError or MismatchError, one line that says why, for what cannot be exported.
    """
    if not learned:
        raise ParameterError("an export needs a skill")
    one = learned[0]
    period, acting = one.dt if dt is None else dt, role or one.role
    chosen = law or one.law
    if chosen in LAWS and not LAWS[chosen].yields:
        able = ", ".join(name for name, part in LAWS.items() if part.yields)
        raise ParameterError(f"law {chosen!r} cannot be exported: its tick is Python alone; laws that can: {able}")
    if not acting:
        raise ParameterError("the skill states no role: say leader or follower")
    if acting == "auto":
        by_role = {skill.role: skill for skill in learned}
        skill = make_auto(by_role, axes=one.axes, dt=period, law=law, goal=goal)
    elif acting in ("leader", "follower"):
        skill = make_skill(one, axes=one.axes, dt=period, law=law, role=acting, goal=goal)
    else:
        raise ParameterError(f"role {acting!r} cannot be exported: say leader, follower or auto")
    assert isinstance(skill, Envelope)
    _check(skill, one, gravity)
    _check_object(mass_kg, load_share, tare_s, force_delay_s)
    felt = TaringInteractionForce(
        period,
        gravity=(gravity_along(one.axes) if gravity is None else np.asarray(gravity, dtype=float)).tolist(),
        mass_kg=mass_kg,
        load_share=load_share,
        tare_s=tare_s,
        force_delay_s=force_delay_s,
    )
    hashes = tuple(str(skill_file.to_json(each)["sha256"]) for each in learned)
    return Controller(skill, felt, one.axes, period, acting, chosen, hashes)


def _check(skill: Envelope, learned: LearnedSkill, gravity: Array | None) -> None:
    inner: Any = skill.skill
    if not isinstance(inner, CollaborativeSkill | RoleSkill):
        raise ParameterError(f"a {type(inner).__name__} cannot be exported: its tick is Python alone")
    d = len(learned.axes)
    if d > MOST_AXES:
        raise ParameterError(f"{d} axes cannot be exported: the compiled tick has 1 to {MOST_AXES}")
    if (rows := sum(len(r.way) for r in inner._pace.references)) > MOST_ROWS:
        raise ParameterError(f"paths of {rows} rows cannot be exported: {MOST_ROWS} at most; learn from shorter lessons")
    if gravity is not None and (np.shape(gravity) != (d,) or not np.isfinite(gravity).all()):
        raise ParameterError(f"gravity has {np.size(gravity)} numbers; allowed: {d}, one an axis ({', '.join(learned.axes)})")


def _check_object(mass_kg: float, share: float, tare_s: float, delay_s: float) -> None:
    """The C has nobody to raise to: what its force estimate cannot be is refused here."""
    if not (isfinite(mass_kg) and mass_kg >= 0.0):
        raise ParameterError(f"mass_kg is {mass_kg:g} kg; allowed: 0 or more")
    if not 0.0 < share <= 1.0:
        raise ParameterError(f"load_share is {share:g}; allowed: above 0, to 1")
    if not (isfinite(tare_s) and tare_s >= 0.0):
        raise ParameterError(f"tare_s is {tare_s:g} s; allowed: 0 or more")
    if not 0.0 <= delay_s <= MOST_DELAY_S:
        raise ParameterError(f"the force comes {1e3 * delay_s:g} ms after the velocity; allowed: 0 to {1e3 * MOST_DELAY_S:g} ms")


def settings_of(controller: Controller) -> Mapping[str, Any]:
    """What was chosen, for the header comment and for who asks."""
    felt = controller.estimator
    return {
        "role": controller.role,
        "law": controller.law,
        "axes": list(controller.axes),
        "dt_s": controller.dt,
        "mass_kg": felt._stated,
        "load_share": felt._share,
        "gravity_m_s2": list(felt._gravity),
        "tare_s": felt._ticks * controller.dt,
    }
