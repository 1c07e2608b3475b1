"""Whom an episode is with: the partners of `comanip trial`, one after the other or the very same list."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import ParameterError
from ..parts import unknown
from ..people.kinds import FOLLOWING, GROUPS, LEADING, kind_of, names_of
from ..tasks import Task
from ..trials.cases import ROLES, TASK, Case
from ..trials.people import USUAL, draw_people
from .asked import number, whole

MISBEHAVING = 0.2  # share of the usual people who do, as in `comanip trial`


def kinds(people: str | Sequence[str], role: str) -> tuple[str, ...]:
    """Names of the kinds of people that can be the partner of a robot in `role`; "usual" is one of them.

    people   "usual", "tuning", "judging", "all", a kind's name, or several of them
    """
    if role not in ROLES:
        raise unknown("role", role, ROLES)
    asked = [people] if isinstance(people, str) else list(people) if isinstance(people, Sequence) else []
    if not asked or not all(isinstance(one, str) for one in asked):
        raise ParameterError(f"people is {people!r}; allowed: {', '.join(GROUPS)}, or names of kinds (comanip people)")
    usual = [USUAL] if USUAL in asked or "all" in asked else []
    plays = {"follower": {LEADING}, "leader": {FOLLOWING}}.get(role, {LEADING, FOLLOWING})
    found = [name for name in names_of([one for one in asked if one != USUAL]) if plays & set(kind_of(name).roles)]
    if not usual and not found:
        raise ParameterError(f"people {people!r}: none of them can be the partner of a robot as {role}")
    return (*usual, *found)


def trial_cases(
    role: str,
    partners: int,
    seed: int = 7,
    *,
    task: str | Path | Task = TASK,
    people: str | Sequence[str] = USUAL,
    misbehaving: float = MISBEHAVING,
) -> list[Case]:
    """The partners whom `comanip trial --role ROLE --partners N --seed SEED` meets, `partners` of each kind.

    Each is an episode: `env.reset(options={"case": case})`.
    """
    partners, seed = whole("partners", partners, 1), whole("seed", seed, 0)
    misbehaving = number("misbehaving", misbehaving, "a share of the partners, 0 to 1", 0.0, 1.0)
    return [
        case
        for kind in kinds(people, role)
        for case in draw_people(role, kind, partners, seed, task=task, misbehaving=misbehaving)
    ]


def next_case(role: str, among: Sequence[str], rng: np.random.Generator, *, task: Task, misbehaving: float) -> Case:
    """One more partner, of a kind drawn evenly."""
    kind = among[int(rng.integers(len(among)))]
    return draw_people(role, kind, 1, int(rng.integers(2**31)), task=task, misbehaving=misbehaving)[0]
