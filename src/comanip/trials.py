"""Partners a skill has never met, drawn wider than the lessons, and the judgement of what happened with them.

The distribution and the criteria are stated here once and used by `comanip demo`, `comanip trial` and the tests. Every claim
about collaboration is measured this way: in closed loop, with a living partner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import exp, log, sqrt
from typing import Any, NamedTuple

import numpy as np

from .errors import ParameterError
from .evaluation.metrics import effort, log_dimensionless_jerk, work
from .filters import smooth
from .interaction import TaringInteractionForce, gravity_along
from .interfaces import STANDARD_GRAVITY, Array, Partner, Skill
from .learned import LearnedSkill
from .loop import Clock, run
from .plants.beam import Beam, BeamPlant, WristSensor
from .plants.partners import Arm, HumanFollower, HumanLeader, Plan, Unsteadiness, Yielding
from .recording import Recording
from .reproduction import make_skill
from .skills.baselines import MassDamper
from .skills.collaborate import CollaborativeLaw, CollaborativeSkill
from .skills.reference import PhaseReference

HAND_KG = 1.0  # effective mass of a hand in a lift, for the damping ratio
FORCE_CUTOFF_HZ = 15.0  # on line; see CausalInteractionForce


@dataclass(frozen=True)
class Case:
    """One partner and one day: everything a closed-loop run needs, by value."""

    role: str  # of the ROBOT: "follower" meets a leading partner, "leader" a following one
    lift_m: float
    duration_s: float
    onset_s: float
    stiffness_n_per_m: float
    damping_ns_per_m: float
    yielding_ns_per_m: float
    delay_s: float
    beam_mass_kg: float
    force_bias_n: float
    force_noise_n: float
    sensor_delay_s: float
    tremor_n: float
    seed: int


def draw_case(role: str, rng: np.random.Generator) -> Case:
    """A partner for a robot in `role`, drawn wider than the lessons (lift 0.30 +- 0.025 m in 2.2 +- 0.25 s).

    lift 0.15-0.38 m, 1.6-4 s, onset 0.3-6 s, K 60-600 N/m (log-uniform), damping ratio 0.3-0.8, follower damping 15-60 N s/m,
    delays 0.10-0.25 s, beam mass +-30 %, force bias +-1 N, noise to 0.5 N, sensor delay to 20 ms, tremor to 0.1 N. A following
    partner is somebody who can hold a rail without shaking: his stiffness is capped where his own loop (stiffness, yielding,
    delay) would oscillate against a wall.
    """
    if role not in ("leader", "follower"):
        raise ParameterError(f"role {role!r} is unknown; roles are: leader, follower")
    mass = 2.0 * rng.uniform(0.7, 1.3)
    stiffness = exp(rng.uniform(log(60.0), log(600.0)))
    ratio, yielding, delay = rng.uniform(0.3, 0.8), rng.uniform(15.0, 60.0), rng.uniform(0.10, 0.25)
    if role == "leader":
        stiffness = min(stiffness, 0.9 * yielding / (delay + 0.13))
    return Case(
        role=role,
        lift_m=rng.uniform(0.15, 0.38),
        duration_s=rng.uniform(1.6, 4.0),
        onset_s=rng.uniform(0.3, 6.0),
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=2.0 * ratio * sqrt(stiffness * (HAND_KG + 0.5 * mass)),
        yielding_ns_per_m=yielding,
        delay_s=delay,
        beam_mass_kg=mass,
        force_bias_n=rng.uniform(-1.0, 1.0),
        force_noise_n=rng.uniform(0.05, 0.5),
        sensor_delay_s=rng.uniform(0.0, 0.020),
        tremor_n=rng.uniform(0.0, 0.1),
        seed=int(rng.integers(2**62)),
    )


def partner_of(case: Case, rng: np.random.Generator) -> Partner:
    share = 0.5 * case.beam_mass_kg
    arm = Arm(case.stiffness_n_per_m, case.damping_ns_per_m, share * STANDARD_GRAVITY, Unsteadiness(tremor_n=case.tremor_n))
    if case.role == "follower":
        return HumanLeader(Plan(case.lift_m, case.duration_s, case.onset_s, feedforward_kg=share), arm, rng=rng)
    return HumanFollower(Yielding(damping_ns_per_m=case.yielding_ns_per_m, delay_s=case.delay_s), arm, rng=rng)


def run_case(
    case: Case,
    skill: Skill,
    *,
    dt: float = 0.01,
    start_m: float = 0.85,
    clock: Clock | None = None,
    metadata: dict[str, Any] | None = None,
) -> Recording:
    """The skill with this partner on the beam, from rest until 2.5 s after the partner means to stop (8 s as leader)."""
    rng = np.random.default_rng(case.seed)
    plant = BeamPlant(
        partner_of(case, rng),
        beam=Beam(mass_kg=case.beam_mass_kg),
        sensor=WristSensor(case.force_noise_n, case.force_bias_n, case.sensor_delay_s),
        start_position=np.array([start_m]),
        dt=dt,
        rng=rng,
    )
    duration = case.onset_s + case.duration_s + 2.5 if case.role == "follower" else 8.0
    estimator = TaringInteractionForce(dt, gravity=gravity_along(plant.axes).tolist(), cutoff_hz=FORCE_CUTOFF_HZ)
    return run(
        plant,
        skill,
        duration_s=duration,
        estimator=estimator,
        clock=clock,
        metadata={"role": case.role, "partner": asdict(case), "load_mass_kg": case.beam_mass_kg, **(metadata or {})},
    )


class Verdict(NamedTuple):
    """What happened, in numbers, and why it failed (empty: it did not)."""

    failures: tuple[str, ...]
    effort_n2s: float  # the partner's: integral of F^2
    work_j: float  # done by the partner on the hand
    peak_force_n: float
    residual_force_n: float
    end_error_m: float
    tilt_deg: float
    ripple_m_per_s: float
    smoothness: float  # log dimensionless jerk, higher is smoother

    @property
    def success(self) -> bool:
        return not self.failures


def judge(case: Case, recording: Recording, *, start_m: float = 0.85, taught_ends_m: Array | None = None) -> Verdict:
    """Success as follower: ends within 3 cm of the partner's goal, residual |F| <= 3 N from 1.5 s after his stop on, peak |F| <=
    15 N, moves <= 1 cm before he does, ripple <= 1 cm/s in the last half second (half of peak to peak), beam within 3 deg.

    As leader: starts within 2 s, ends within 2 cm of a taught height (between the lowest and highest lesson), same bounds.
    F is the plant's truth, low-passed at 15 Hz like everything a hand can feel.
    """
    hand = recording["hand.position"]
    t, x, v = hand.time - hand.time[0], hand.values[:, 0], recording["hand.velocity"].values[:, 0]
    dt = float(t[1] - t[0])
    true = recording["hand.true_force"].values
    finite = bool(np.isfinite(true).all() and np.isfinite(x).all() and np.abs(true).max() < 1e9)
    if not finite:
        return Verdict(("diverged",), *[float("inf")] * 8)
    force = smooth(true, dt, FORCE_CUTOFF_HZ)[:, 0]
    if case.role == "follower":
        stop, end_error = case.onset_s + case.duration_s, float(x[-1] - start_m - case.lift_m)
    else:
        ends = np.array([start_m + case.lift_m]) if taught_ends_m is None else np.asarray(taught_ends_m)
        end_error = float(x[-1] - np.clip(x[-1], ends.min(), ends.max()))
        still_moving = np.flatnonzero(np.abs(x - x[-1]) > 0.01)
        stop = float(t[still_moving[-1]]) if len(still_moving) else 0.0
    late = t >= min(stop + 1.5, t[-1] - 0.3)
    last = t > t[-1] - 0.5
    verdict = Verdict(
        failures=(),
        effort_n2s=effort(force, dt),
        work_j=work(force, v, dt),
        peak_force_n=float(np.abs(force).max()),
        residual_force_n=float(np.abs(force[late]).max()),
        end_error_m=end_error,
        tilt_deg=float(np.degrees(np.abs(recording["beam.tilt"].values).max())),
        ripple_m_per_s=float(np.ptp(v[last]) / 2.0),
        smoothness=log_dimensionless_jerk(v, dt),
    )
    return verdict._replace(failures=_failures(case, verdict, t, x, start_m))


def _failures(case: Case, verdict: Verdict, t: Array, x: Array, start_m: float) -> tuple[str, ...]:
    failures = []
    moved = np.flatnonzero(np.abs(x - start_m) > 0.01)
    if case.role == "follower":
        if (t[moved] < case.onset_s).any():
            failures.append("moved before the partner")
        if abs(verdict.end_error_m) > 0.03:
            failures.append("missed the partner's goal")
    else:
        if not len(moved) or t[moved[0]] > 2.0:
            failures.append("did not start within 2 s")
        if abs(verdict.end_error_m) > 0.02:
            failures.append("missed the taught height")
    bounds = (
        (verdict.residual_force_n, 3.0, "residual force"),
        (verdict.peak_force_n, 15.0, "peak force"),
        (verdict.ripple_m_per_s, 0.01, "ripple at the end"),
        (verdict.tilt_deg, 3.0, "beam not level"),
    )
    failures.extend(text for value, bound, text in bounds if value > bound)
    return tuple(failures)


def success_interval(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % Wilson score interval of a success rate."""
    if trials == 0:
        return 0.0, 1.0
    p, n = successes / trials, trials
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


def run_cases(
    cases: Sequence[Case],
    learned: LearnedSkill,
    law: str,
    *,
    workers: int = 1,
    dt: float = 0.01,
    progress: Callable[[int, int], None] | None = None,
) -> list[Verdict]:
    """One verdict a case, in order, by any number of processes (0: one a core): the same numbers for the same cases.

    law   "default", "paper", or a baseline: "mass-damper", which learned nothing, or "minimum-jerk", which knows only start, end
          and duration of the lessons and has the default law's compliance
    """
    from joblib import Parallel, cpu_count, delayed

    n_jobs = cpu_count() if workers == 0 else workers
    if n_jobs == 1:
        results: Any = (_one_verdict(case, learned, law, dt) for case in cases)
    else:
        jobs = (delayed(_one_verdict)(case, learned, law, dt) for case in cases)
        results = Parallel(n_jobs=n_jobs, return_as="generator")(jobs)
    verdicts = []
    for verdict in results:
        verdicts.append(verdict)
        if progress is not None:
            progress(len(verdicts), len(cases))
    return verdicts


def _one_verdict(case: Case, learned: LearnedSkill, law: str, dt: float) -> Verdict:
    axes = learned.axes
    skill: Skill
    if law == "mass-damper":
        skill = MassDamper(n_axes=len(axes), dt=dt)
    elif law == "minimum-jerk":
        skill = _minimum_jerk(case.role, learned, dt)
    else:
        skill = make_skill(learned, axes=axes, dt=dt, law=law, role=case.role)
    with np.errstate(all="ignore"):  # a law that diverges is a verdict, not a warning
        return judge(case, run_case(case, skill, dt=dt), taught_ends_m=learned.ends)


def _minimum_jerk(role: str, learned: LearnedSkill, dt: float) -> Skill:
    assert learned.clock is not None
    return CollaborativeSkill(
        learned.model,
        learned.clock,
        role=role,
        axes=learned.axes,
        dt=dt,
        model_dt=learned.dt,
        law=CollaborativeLaw.for_role(role, yield_gain_per_n=0.0),
        reference=PhaseReference.minimum_jerk(PhaseReference.learned(learned.clock, learned.ends.mean(axis=0))),
    )
