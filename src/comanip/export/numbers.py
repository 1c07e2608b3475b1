"""The numbers of a controller in the order in which the kernels' headers have them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import nan
from typing import Any

import numpy as np

from ..interaction import CausalInteractionForce
from ..interfaces import Array
from ..kernels import layouts
from ..safety.compiled_tick import numbers_of as limits_of
from ..safety.envelope import Envelope
from ..skills.collaborate import CollaborativeLaw, CollaborativeSkill, tables_of
from ..skills.foresight import GRID, LATE_S, PACES, PRIOR
from ..skills.roles import BIAS_S, PULL_S, RolePolicy
from .controller import Controller


@dataclass(frozen=True, eq=False)
class Numbers:
    """Blocks as 1-D arrays, sizes as whole numbers, and what is chosen as such.

    laws     leading (or the only one), following
    tables   rows of all goals: path, velocity, force, way, gain; goals (G, 6)
    plans    of who may follow: table, way, heading, grid, prior; empty where nothing is foreseen
    filter   origin, factors, centres, peak, initial, chain
    """

    changes: bool
    leads: bool
    told: int  # the goal that it was told, -1 for none
    laws: tuple[Array, Array]
    policy: Array
    tables: tuple[Array, ...]
    stations: Array
    firsts: Array
    plans: tuple[Array, ...]
    alike: int
    keep: float
    filter: tuple[Array, ...]
    heard: int
    patience: int
    gate: float
    model_dt: float
    shares: tuple[float, float, float]  # of shaking, of the pull, of the bias
    limits: Array
    walls: Array
    rules: Array
    beside: float  # [m] outside of the walls that it may begin, NaN for none
    sizes: tuple[int, int, int]  # most pulls, most before, swing
    weighing: tuple[Any, ...]
    late: int

    @property
    def n_goals(self) -> int:
        return len(self.firsts) - 1


def numbers_of(controller: Controller) -> Numbers:
    envelope, inner = controller.skill, controller.skill.skill
    alone = isinstance(inner, CollaborativeSkill)
    skill: Any = inner
    pace, where, watch, dt = skill._pace, skill._where, skill._watch, controller.dt
    told = -1 if skill._told is None else int(skill._told)
    follows = pace.law if alone else skill._laws[0]
    foresees = skill._foresight is not None and not (alone and skill.role == "leader")
    plans, alike, keep = _plans(skill) if foresees else ((), 1, 0.0)
    limits, rules, sizes = _envelope(envelope)
    weighing, late = _weighing(controller)
    return Numbers(
        changes=not alone,
        leads=skill.role == "leader" if alone else skill._told_to_lead,
        told=told,
        laws=(_law(pace.law), _law(follows)),
        policy=np.array([getattr(RolePolicy() if alone else skill.policy, name) for name in layouts.BLOCKS["policy"]], float),
        tables=tables_of(pace.references),
        stations=where.stations,
        firsts=where.firsts,
        plans=plans,
        alike=alike,
        keep=keep,
        filter=watch.filter.numbers,
        heard=len(watch.seen),
        patience=watch.filter.patience,
        gate=watch.filter.gate,
        model_dt=watch.model_dt,
        shares=(min(dt / 0.3, 1.0), min(dt / PULL_S, 1.0), dt / BIAS_S),
        limits=limits,
        walls=np.array(envelope._walls, dtype=float),
        rules=rules,
        beside=nan if envelope.limits.begins_beside_m is None else envelope.limits.begins_beside_m,
        sizes=sizes,
        weighing=weighing,
        late=late,
    )


def _law(law: CollaborativeLaw) -> Array:
    return layouts.packed("law", asdict(law))


def _plans(skill: Any) -> tuple[tuple[Array, ...], int, float]:
    seen = skill._foresight
    tables, ways = (np.concatenate([getattr(one, name) for one in seen.plans]) for name in ("table", "way"))
    return (tables, ways, np.array([one.heading for one in seen.plans]), GRID, PRIOR), len(PACES) * len(LATE_S), seen._keep


def _envelope(envelope: Envelope) -> tuple[Array, Array, tuple[int, int, int]]:
    checker, let_go = envelope._checker, envelope._let_go
    rules = [checker.v_max, checker.a_max, checker.dt]
    pulls, before = let_go._pulls.maxlen, let_go._before.maxlen
    assert pulls is not None
    assert before is not None
    return limits_of(envelope), np.array(rules, dtype=float), (pulls, before, let_go._swing)


def _weighing(controller: Controller) -> tuple[tuple[Any, ...], int]:
    """In the order of C's Weighing, and the wait in whole ticks."""
    felt = controller.estimator
    force = CausalInteractionForce(felt._dt, mass_kg=1.0, gravity=felt._gravity, load_share=felt._share, **felt._filtering)
    section = force._filters[0]
    lowpass = (section._b0, section._b1, section._b2, section._a1, section._a2)
    gravity = [*felt._gravity, *[0.0] * (6 - len(felt._gravity))]
    numbers = (felt._dt, float(felt._stated), felt._share, felt._moving, *lowpass, force._blend, gravity)
    return (*numbers, len(felt._gravity), felt._ticks, force._late, int(force._average)), force._late
