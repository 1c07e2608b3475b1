"""Trials with people of many kinds (`comanip.people`): the usual draw, whoever it is, and the criteria of the kind.

Each kind meets the robot with the same draws of strength, delay, load and sensor, and with the same bounds, but for those that
the kind itself cannot keep: `Kind.criteria` states them. Two more count for all: the force vibrates above 2.5 Hz by no more than
0.8 N rms while the hand moves, and the motion ends in time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import exp, inf, log, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import STANDARD_GRAVITY, Partner, Skill
from ..learned.skill import LearnedSkill
from ..parallel import each
from ..people.body import Body, draw_body
from ..people.intent import Course
from ..people.kinds import FOLLOWING, LEADING, kind_of, make, planned
from ..people.plans import lasting
from ..people.robot import Gripper, RobotPartner
from ..recording import Recording
from ..tasks import Task
from .cases import HAND_KG, ROLES, SHORT_S, TASK, Case, draw_case, partner_of
from .contestants import contestant
from .judging import DIVERGED, Bounds, Verdict, bounds, judge, success_interval
from .running import clearance, estimator_for, policy_fault, run_case

VIBRATION_N = 0.8  # rms above 2.5 Hz, in motion
IN_TIME_S = 1.5  # after a leading partner has come to the end
LED_S = 6.0  # longest motion of somebody who is led in a lift, which is taught to take 2.2 s
USUAL = "usual"  # the people of `draw_case`, without an arm of their own, some of whom misbehave


@dataclass(frozen=True)
class PersonCase(Case):
    """A case whose partner is of a kind; what the kind makes of the plan counts for the judge and for how long the run lasts."""

    @cached_property
    def course(self) -> Course:
        """What a leading partner means."""
        return planned(self.kind, self.way.course, np.random.default_rng([self.seed, 4]))

    @property
    def event_s(self) -> float:
        return self.course.start_s + self.event * lasting(self.course) if self.leads else super().event_s

    @property
    def stop_s(self) -> float:
        if self.behaviour in ("blocks", "lets go"):
            return self.event_s
        if self.leads:
            return self.event_s + 0.8 if self.behaviour == "changes role" else self.course.stop_s
        return 0.0


class Criteria(NamedTuple):
    """Of one case: the judge's bounds, the most that the force may vibrate [N rms], and the longest motion in time [s]."""

    within: Bounds
    vibration_n: float
    time_s: float


def criteria_of(case: Case) -> Criteria:
    """Those of the kind in place of the usual ones."""
    usual, own = bounds(case), dict(kind_of(case.kind).criteria) if case.kind else {}
    steady = case.behaviour == "steady"
    lasts = lasting(case.course) + IN_TIME_S if case.leads else LED_S * case.task.moving_s / SHORT_S + case.task.rests_s
    vibrates = own.pop("vibration_n", min(case.task.success.vibration_n, VIBRATION_N) if steady else inf)
    in_time = own.pop("time_s", lasts if steady else inf)
    if usual.goal == "taught":
        own.pop("end_m", None)  # where the task ends is not the partner's
    changed: dict[str, Any] = own
    return Criteria(replace(usual, **changed), vibrates, in_time)


class Met(NamedTuple):
    """What came of one partner. `failures` are those of the verdict, and "vibration" and "too slow"."""

    verdict: Verdict
    failures: tuple[str, ...]
    vibration_n: float
    time_s: float

    @property
    def success(self) -> bool:
        return not self.failures


def draw_people(
    role: str, kind: str, n: int, seed: int, *, task: str | Path | Task = TASK, misbehaving: float = 0.0
) -> list[Case]:
    """`n` partners of `kind` for a robot in `role`, the same draws for each kind; none where it cannot play the other role.

    misbehaving   share of those of the kind "usual" who misbehave; the others have habits of their own
    """
    if kind == USUAL:
        rng = np.random.default_rng([seed, ROLES.index(role)])
        return [draw_case(role, rng, task=task, misbehaving=misbehaving) for _ in range(n)]
    part = kind_of(kind)
    plays = {"follower": (LEADING,), "leader": (FOLLOWING,)}.get(role, (LEADING, FOLLOWING))
    if not set(plays) & set(part.roles):
        return []
    rng = np.random.default_rng([seed, ROLES.index(role)])
    found: list[Case] = []
    while len(found) < n:
        case = draw_case(role, rng, task=task)
        if case.partner in part.roles:
            given = {f.name: getattr(case, f.name) for f in fields(case)}
            found.append(PersonCase(**{**given, "behaviour": part.behaviour, "kind": kind}))
    return found


def body_of(case: Case) -> Body:
    """The drawn person of a case, and the arm and the grip that the case does not tell."""
    share = case.carried_n / STANDARD_GRAVITY
    return draw_body(
        np.random.default_rng([case.seed, 2]),
        load_kg=2.0 * share,
        axes_gravity=case.task.gravity,
        carried_n=tuple(case.carried.tolist()),
        stiffness_n_per_m=case.stiffness_n_per_m,
        ratio=case.damping_ns_per_m / (2.0 * sqrt(case.stiffness_n_per_m * (HAND_KG + 0.5 * case.beam_mass_kg))),
        yielding_ns_per_m=case.yielding_ns_per_m,
        delay_s=case.delay_s,
        tremor_n=case.tremor_n,
    )


def person_of(case: Case, rng: np.random.Generator, learned: Mapping[str, LearnedSkill], dt: float) -> Partner:
    """The partner of the case; `rng` is what makes it unsteady."""
    if kind_of(case.kind).robot:
        return _robot(case, rng, learned, dt)
    course = case.at_grip(case.course) if case.leads else None
    once = case.event_s if case.behaviour != "steady" else None
    return make(case.kind, role=case.partner, course=course, body=body_of(case), axes=case.axes, rng=rng, event_s=once)


def _robot(case: Case, rng: np.random.Generator, learned: Mapping[str, LearnedSkill], dt: float) -> Partner:
    own = np.random.default_rng([case.seed, 3])
    stiffness = exp(own.uniform(log(300.0), log(4000.0)))
    gripper = Gripper(
        stiffness, 2.0 * own.uniform(0.2, 0.6) * sqrt(stiffness), delay_s=own.uniform(0.0, 0.020), noise_n=own.uniform(0.05, 0.5)
    )
    told = "leader" if case.leads else "follower"
    skill = contestant("default", told if kind_of(case.kind).robot == "told" else "auto", learned, dt=dt)
    about: dict[str, Any] = {"gripper": gripper, "dt": dt, "rng": rng}
    if case.leads:  # a robot goes as it was taught, and at once
        goal = learned["leader"].ends.mean(axis=0) - case.start_m
        about |= {"goal": goal, "onset_s": 0.0, "stop_s": 2.0 + 1.5 * (case.task.moving_s + case.task.rests_s)}
    return RobotPartner(skill, estimator_for(case, dt), carried_n=tuple(case.carried.tolist()), **about)


def meet(
    case: Case,
    learned: Mapping[str, LearnedSkill],
    law: str,
    plant: str = "beam",
    dt: float = 0.01,
    skill: Skill | None = None,
) -> tuple[Recording, Met]:
    """The recording of one partner, and what came of it. `skill`: another than `law` makes from what was learned."""
    skill = skill or contestant(law, case.role, learned, dt=dt, task=case.task)

    def partner(_: Case, rng: np.random.Generator) -> Partner:
        return person_of(case, rng, learned, dt) if case.kind else partner_of(case, rng)

    with np.errstate(all="ignore"):  # a law that diverges is a verdict, not a warning
        recording = run_case(case, skill, plant=plant, dt=dt, partner=partner, metadata={"law": law, "kind": kind_name(case)})
        ends = learned["leader" if "leader" in learned else case.role].ends
        met = judged(case, recording, taught_ends_m=ends, lessons_clearance_m=clearance(learned))
        return recording, met._replace(failures=met.failures + policy_fault(recording))


def kind_name(case: Case) -> str:
    return case.kind or USUAL


def judged(case: Case, recording: Recording, **about: Any) -> Met:
    """The verdict by the kind's criteria; `about` goes to the judge. Vibration and time are asked as the kind has them."""
    criteria = criteria_of(case)
    verdict = judge(case, recording, within=criteria.within, **about)
    if verdict.failures == DIVERGED.failures:
        return Met(verdict, verdict.failures, inf, inf)
    usual = tuple(reason for reason in verdict.failures if reason not in ("vibration", "too slow"))
    shakes, took = verdict.vibration_n, max(verdict.arrived_s, 0.0)
    asked = ((shakes, criteria.vibration_n, "vibration"), (took, criteria.time_s, "too slow"))
    return Met(verdict, usual + tuple(text for value, most, text in asked if value > most), shakes, took)


def _met(*work: Any) -> Met:
    """What `meet` comes to, without the recording."""
    return meet(*work)[1]


def meet_all(
    cases: Sequence[Case],
    learned: Mapping[str, LearnedSkill],
    law: str,
    *,
    plant: str = "beam",
    workers: int = 1,
    dt: float = 0.01,
    progress: Callable[[int, int], None] | None = None,
) -> list[Met]:
    """In order, by any number of processes (0: one a core)."""
    found: list[Met] = []
    for met in each(_met, [(case, learned, law, plant, dt) for case in cases], n_jobs=workers or -1):
        found.append(met)
        if progress is not None:
            progress(len(found), len(cases))
    return found


def summary(cases: Sequence[Case], met: Sequence[Met]) -> dict[str, Any]:
    """Over all partners, and under "kinds" over those of each: success with its 95 % interval, medians, reasons of failures."""
    by: dict[str, list[Met]] = {}
    for case, one in zip(cases, met, strict=True):
        by.setdefault(kind_name(case), []).append(one)
    return {**_row(met), "kinds": {kind: _row(some) for kind, some in by.items()}}


def _row(met: Sequence[Met]) -> dict[str, Any]:
    good, n = sum(one.success for one in met), len(met)
    told = [one.verdict.role_right for one in met if one.verdict.role_right == one.verdict.role_right]
    return {
        "success": good / max(n, 1),
        "interval": list(success_interval(good, n)),
        "partners": n,
        "effort": _median([one.verdict.effort_n2s for one in met]),
        "vibration_n": _median([one.vibration_n for one in met]),
        "time_s": _median([one.time_s for one in met]),
        "peak_force_n": max((one.verdict.peak_force_n for one in met), default=None),
        "role_right": float(np.mean(told)) if told else None,
        "failures": dict(Counter(reason for one in met for reason in one.failures)),
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None
