"""The loop with one partner of a draw, and many of them at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..interaction import TaringInteractionForce, TurningInteractionForce
from ..interfaces import Array, Partner, Plant, Skill, Tap
from ..learned.skill import LearnedSkill
from ..loop import Clock, run, unbroken
from ..parallel import each
from ..parts import PLANTS, known
from ..plants.beam import Beam, WristSensor
from ..plants.rigid import TurningObject
from ..recording import Recording
from ..tasks import named, usual, way
from .cases import TASK, Case, partner_of
from .contestants import contestant
from .foreign import stated_by
from .judging import Verdict, judge

START_M = float(named(TASK).start[0])  # of the hand in the usual task
EXPECTED_DELAY_S = 0.010  # of the force sensor behind the velocity: 0 to 20 ms in the draw, and the robot knows no better
POLICY_FAULT = "HOLD: policy: "  # how the envelope says so
PLAN_S = 0.05  # between two points of a plan that pictures show
MakePartner = Callable[[Case, np.random.Generator], Partner]


def run_case(
    case: Case,
    skill: Skill,
    *,
    plant: str = "beam",
    dt: float = 0.01,
    start_m: float | Sequence[float] | Array | None = None,
    clock: Clock | None = None,
    taps: Sequence[Tap] = (),
    metadata: Mapping[str, Any] | None = None,
    partner: MakePartner = partner_of,
) -> Recording:
    """The skill with this partner, from rest until some seconds after the partner means to stop (`Case.run_s`).

    plant     of `parts.PLANTS`: "beam" (exact, fast), "humanoid" (MuJoCo) ...
    start_m   (d,) where the hand starts; default: where the case says
    partner   makes the person from the case; default: the human models of `people.partners`
    """
    case.task.runnable()
    case = case.starting(start_m)
    rng = np.random.default_rng(case.seed)
    person = partner(case, rng)
    world = plant_for(plant, person, case, dt, rng)
    estimator = estimator_for(case, dt)
    about = {
        "role": case.role,
        "task": case.task.name,
        "partner": case.about(),
        "load_mass_kg": case.beam_mass_kg,
        "plant": plant,
        **({"plan": _plan(case)} if case.leads else {}),
        **(metadata or {}),
    }
    about |= {"stated": stated} if (stated := stated_by(person)) else {}
    return run(world, skill, duration_s=case.run_s, estimator=estimator, clock=clock, taps=taps, metadata=about)


def estimator_for(case: Case, dt: float) -> TaringInteractionForce | TurningInteractionForce:
    """What a robot knows of the force: eq. (3) on line, for the task's object as stated."""
    if case.turning is not None:
        what = case.task.carried
        held = TurningObject(what.mass_kg, what.length_m, what.width_m)
        return TurningInteractionForce(
            dt,
            case.turning.load(held, what.share, case.task.gravity.tolist()),
            cutoff_hz=min(40.0, 0.4 / dt),
            force_delay_s=EXPECTED_DELAY_S,
        )
    return TaringInteractionForce(
        dt,
        gravity=case.task.gravity.tolist(),
        mass_kg=case.task.carried.mass_kg,
        load_share=case.task.carried.share,
        force_delay_s=EXPECTED_DELAY_S + 0.5 * dt,  # the sensors of these plants average over a tick
    )


def _plan(case: Case) -> dict[str, Any]:
    """Where a leading partner means to be, for pictures: times [s] and displacements (T, d) [m]."""
    course = case.course
    times = np.arange(course.start_s, course.stop_s + PLAN_S, PLAN_S)
    return {"time_s": times.tolist(), "displacement_m": course.sampled(times).tolist()}


def plant_for(name: str, person: Partner, case: Case, dt: float, rng: np.random.Generator) -> Plant:
    """The plant of `parts.PLANTS` with this person and this day's object and sensor."""
    sensor = WristSensor(case.force_noise_n, case.force_bias_n, case.sensor_delay_s)
    beam = Beam(mass_kg=case.beam_mass_kg, length_m=case.task.carried.length_m)
    made: Plant = known("plant", name, PLANTS).load()(
        person, beam=beam, sensor=sensor, dt=dt, start_position=case.start_m, rng=rng, task=case.task
    )
    return made


def run_cases(
    cases: Sequence[Case],
    learned: Mapping[str, LearnedSkill],
    law: str,
    *,
    plant: str = "beam",
    workers: int = 1,
    dt: float = 0.01,
    partner: MakePartner = partner_of,
    progress: Callable[[int, int], None] | None = None,
) -> list[Verdict]:
    """One verdict a case, in order, by any number of processes (0: one a core): the same numbers for the same cases.

    Inside `comanip.backend("dask", ...)` the workers of that cluster do it.

    learned   skills by role; a case whose role is "auto" needs leader and follower
    law       one of `parts.LAWS`
    """
    verdicts: list[Verdict] = []
    work = [(case, learned, law, plant, dt, partner) for case in cases]
    for verdict in each(one_verdict, work, n_jobs=workers or -1):
        verdicts.append(verdict)
        if progress is not None:
            progress(len(verdicts), len(cases))
    return verdicts


def one_verdict(*work: Any) -> Verdict:
    """What `one_run` of the same arguments comes to: what travels to a worker, and back without the recording."""
    return one_run(*work)[1]


def one_run(
    case: Case,
    learned: Mapping[str, LearnedSkill],
    law: str,
    plant: str = "beam",
    dt: float = 0.01,
    partner: MakePartner = partner_of,
) -> tuple[Recording, Verdict]:
    """The recording of one case, and the verdict on it."""
    skill = contestant(law, case.role, learned, dt=dt, goal=told_goal(case), task=case.task)
    with np.errstate(all="ignore"):  # a law that diverges is a verdict, not a warning
        recording = unbroken(run_case(case, skill, plant=plant, dt=dt, partner=partner, metadata={"law": law}))
        ends = learned["leader" if "leader" in learned else case.role].ends
        verdict = judge(case, recording, taught_ends_m=ends, lessons_clearance_m=clearance(learned))
        return recording, verdict._replace(failures=verdict.failures + policy_fault(recording))


def policy_fault(recording: Recording) -> tuple[str, ...]:
    """Why the envelope stopped what it is around, where that failed: an exception, a number that is not finite, a wrong shape."""
    said = str(recording.metadata.get("notice", ""))
    return (f"policy: {said.removeprefix(POLICY_FAULT)}",) if said.startswith(POLICY_FAULT) else ()


def told_goal(case: Case) -> Array | None:
    """(d,) [m] where a robot that leads is told to lead to, of a task with several goals; None: not told, or no need."""
    if case.role != "leader" or len(case.task.goals) < 2:
        return None
    return np.asarray(case.task.start + way(case.task, usual(case.task, case.drawn.goal)).course.end)


def clearance(learned: Mapping[str, LearnedSkill]) -> float | None:
    """Smallest distance [m] to an obstacle in the lessons of any role, where the skills know it."""
    known = [one.provenance["clearance_m"] for one in learned.values() if "clearance_m" in one.provenance]
    return min(known) if known else None
