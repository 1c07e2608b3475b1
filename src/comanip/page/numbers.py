"""All numbers of a robot's skill in one block of float64, as page/robot.h reads them; app/prepare.js makes the same of files.

The header's numbers stand in the order of `HEADER`; behind it come arrays in the order in which `numbers` puts them, each as
long as the header says.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict
from math import nan
from typing import Any

import numpy as np

from ..errors import MismatchError
from ..interaction import felt_cutoff_hz
from ..interfaces import Array
from ..kernels import layouts
from ..learned.skill import LearnedSkill
from ..reproduction import make_auto, make_skill
from ..safety import detectors
from ..safety import limits as taught
from ..safety.compiled_tick import numbers_of
from ..safety.limits import Limits
from ..signals.exponential import exponential
from ..signals.filters import lowpass_coefficients
from ..skills import foresight, reference, whereabouts
from ..skills.collaborate import CollaborativeLaw, CollaborativeSkill, tables_of
from ..skills.evidence import GAINS, Doubts
from ..skills.roles import BIAS_S, LATER, PULL_S, RolePolicy, RoleSkill
from ..tasks import Task

VERSION = 1
HEADER = (
    "version", "d", "dt", "changes", "leads", "goals", "states", "heard", "filters", "strengths", "stations", "plans", "alike",
    "keep", "model_dt", "pull_s", "bias_s", "told", "most_pulls", "most_before", "swing", "beside", "late", "blend", "average",
    "ticks", "mass", "share", "moving", "b0", "b1", "b2", "a1", "a2", "gate", "patience",
)  # fmt: skip
TARE_S, MOVING_M_PER_S = 0.25, 0.01
FLOOR, GATE, PATIENCE = 1e-6, 20.0, 3  # of models.filtering.StateFilter where nobody says another
EXPECTED_DELAY_S = 0.010  # of the force behind the velocity, as trials.running has it; half a period of averaging comes on top


def robot(skills: Mapping[str, LearnedSkill], role: str, *, dt: float, law: str | None = None) -> Any:
    """The skill that the page runs, within its envelope: `role` is leader, follower or auto; `law` None: the skills' own."""
    if role == "auto":
        return make_auto(skills, axes=skills["leader"].axes, dt=dt, law=law)
    return make_skill(skills[role], axes=skills[role].axes, dt=dt, role=role, law=law)


def roles(skills: Mapping[str, LearnedSkill]) -> tuple[str, ...]:
    """What the page can be told with these skills."""
    told = tuple(role for role in ("leader", "follower") if role in skills)
    return (*told, "auto") if len(told) == 2 else told


def numbers(skill: Any, task: Task, *, expected_delay_s: float = EXPECTED_DELAY_S) -> Array:
    """The block for `skill`, an envelope around the default law, with the force estimate for the task's object.

    Raises MismatchError for another law.
    """
    inner = skill.skill
    if not isinstance(inner, RoleSkill | CollaborativeSkill):
        raise MismatchError(
            f"the page runs the default law alone; this skill is a {type(inner).__name__}: learn it with --law default"
        )
    weighing = _weighing(skill.dt, task, expected_delay_s)
    header = {**_sizes(skill), **weighing}
    parts = [np.array([float(header[name]) for name in HEADER]), *_laws(inner), *_limits(skill), task.gravity, *_paths(inner)]
    return np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in (*parts, *_filters(inner))])


def encoded(numbers: Array) -> str:
    """float64, little endian, in base64."""
    return base64.b64encode(np.asarray(numbers, dtype="<f8").tobytes()).decode()


def _weighing(dt: float, task: Task, expected_delay_s: float) -> dict[str, float]:
    """interaction.TaringInteractionForce and CausalInteractionForce."""
    delay_s = expected_delay_s + 0.5 * dt
    average = delay_s < 0.5 * dt
    wait = (delay_s if average else delay_s - 0.5 * dt) / dt
    section = lowpass_coefficients(felt_cutoff_hz(dt), dt)
    return {
        "late": int(wait), "blend": wait - int(wait), "average": average, "ticks": round(TARE_S / dt),
        "mass": task.carried.mass_kg, "share": task.carried.share, "moving": MOVING_M_PER_S,
        **dict(zip(("b0", "b1", "b2", "a1", "a2"), section, strict=True)),
    }  # fmt: skip


def _sizes(skill: Any) -> dict[str, float]:
    inner, watch = skill.skill, skill.skill._watch
    changes = isinstance(inner, RoleSkill)
    evidence = inner.evidence if changes else None
    foresight = inner._foresight
    told = inner._told
    return {
        "version": VERSION, "d": len(skill.axes), "dt": skill.dt, "changes": changes,
        "leads": inner._told_to_lead if changes else inner.role == "leader",
        "goals": len(inner._pace.references), "states": watch.filter.n_states, "heard": len(watch.filter.channels),
        "filters": 0 if evidence is None else len(evidence._filters), "strengths": len(GAINS),
        "stations": len(inner._where.stations), "plans": 0 if foresight is None else foresight.shared()[3].shape[1],
        "alike": 0 if foresight is None else foresight.shared()[6], "keep": 0.0 if foresight is None else foresight.shared()[7],
        "model_dt": watch.model_dt, "pull_s": PULL_S, "bias_s": BIAS_S, "told": -1 if told is None else told,
        "most_pulls": skill._let_go._pulls.maxlen, "most_before": skill._let_go._before.maxlen, "swing": skill._let_go._swing,
        "beside": nan if skill.limits.begins_beside_m is None else skill.limits.begins_beside_m,
        "gate": watch.filter.gate, "patience": watch.filter.patience,
    }  # fmt: skip


def _laws(inner: Any) -> list[Array]:
    leading = inner._pace.law
    following = inner._laws[0] if isinstance(inner, RoleSkill) else leading
    policy = [getattr(inner.policy, name) for name in layouts.BLOCKS["policy"]] if isinstance(inner, RoleSkill) else None
    return [
        layouts.packed("law", asdict(leading)),
        layouts.packed("law", asdict(following)),
        np.array(policy if policy is not None else [0.0] * len(layouts.BLOCKS["policy"])),
    ]


def _limits(skill: Any) -> list[Array]:
    """The block "limits", then the walls (d, 2)."""
    return [numbers_of(skill), np.array(skill._walls)]


def _paths(inner: Any) -> list[Array]:
    references, where = inner._pace.references, inner._where
    *tables, about = tables_of(references)
    plans = [] if inner._foresight is None else list(inner._foresight.shared()[:5])
    return [about, *tables, *plans, where.stations, where.firsts]


def _filters(inner: Any) -> list[Array]:
    """Watch's filter; and where roles change by evidence its numbers, and each filter behind its number of states."""
    found = list(inner._watch.filter.numbers)
    evidence = inner.evidence if isinstance(inner, RoleSkill) else None
    if evidence is None:
        return found
    doubts, dt = evidence._doubts, evidence._dt
    about = np.array([dt, dt / doubts.switch_s, dt / doubts.memory_s, doubts.gate])
    found += [about, evidence._prior, evidence._centre, evidence._spread]
    for one in evidence._filters:
        found += [np.array([one.n_states]), *one.numbers]
    return found


def constants(task: Task, *, dt: float) -> dict[str, Any]:
    """All that app/prepare.js needs beside skill files to make the same block."""
    own = Limits()
    limits = {n: getattr(own, n) for n in layouts.BLOCKS["limits"] if not n.startswith("_")}
    limits |= {"_dt": dt, "_late": max(0.030, 3.0 * dt), "_stale": max(0.050, 5.0 * dt)}
    policy, doubts = RolePolicy(), Doubts()
    plans = foresight.GRID.shape[1]
    header = {
        "version": VERSION, "dt": dt, "strengths": len(GAINS), "plans": plans,
        "alike": len(foresight.PACES) * len(foresight.LATE_S),
        "keep": exponential(-dt / foresight.FELT_S), "pull_s": PULL_S, "bias_s": BIAS_S, "gate": GATE, "patience": PATIENCE,
        "most_pulls": max(round(detectors.SLOW_SWING_S / dt), 1), "most_before": 1 + max(round(detectors.STILL_S / dt), 1),
        "swing": max(round(detectors.SWING_S / dt), 1), "beside": taught.BESIDE_M, **_weighing(dt, task, EXPECTED_DELAY_S),
    }  # fmt: skip
    return {
        "header": {name: float(value) for name, value in header.items()},
        "header_names": HEADER,
        "law_names": layouts.BLOCKS["law"],
        "laws": {role: asdict(CollaborativeLaw.for_role(role)) for role in ("leader", "follower")},
        "known_laws": ["default", "lqt", "even"],
        "policy_names": layouts.BLOCKS["policy"],
        "policy": {name: float(getattr(policy, name)) for name in layouts.BLOCKS["policy"]},
        "limit_names": layouts.BLOCKS["limits"],
        "limits": limits,
        "gravity": task.gravity.tolist(),
        "grid": foresight.GRID.ravel().tolist(),
        "prior": foresight.PRIOR.tolist(),
        "constants": {
            **{n: getattr(reference, n) for n in ("AT_START", "LEAST_SPREAD_M", "INTERVENES_M_PER_S", "GAINS_PER_S", "PLACE_M")},
            "PLACE_SHARE": reference.PLACE,
            **{name: getattr(whereabouts, name) for name in ("STATIONS", "FINEST", "POSITION", "PACE", "SLOW_M_PER_S")},
            **{name: getattr(taught, name) for name in ("SPEED_MARGIN", "WALL_MARGIN_M", "LED_N", "LED_SHARE", "PULL_N")},
            "FLOOR": FLOOR, "LATER": LATER, "STRENGTHS": GAINS, "DOUBT_FORCE_N": doubts.force_n,
            "DOUBT_VELOCITY": doubts.velocity_m_per_s, "DOUBT_POSITION": doubts.position_share, "DOUBT_MEMORY_S": doubts.memory_s,
            "DOUBT_SWITCH_S": doubts.switch_s, "DOUBT_GATE": doubts.gate,
        },
    }  # fmt: skip
