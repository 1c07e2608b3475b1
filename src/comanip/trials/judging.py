"""What happened in a run, in numbers, and whether it was good: the criteria, stated once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import NamedTuple

import numpy as np

from ..evaluation.metrics import effort, effort_share, internal_force, log_dimensionless_jerk, work
from ..interfaces import STANDARD_GRAVITY, Array
from ..recording import Recording
from ..safety.envelope import Limits
from ..signals.filters import smooth
from .cases import AUTO_PATIENCE_S, Case

FORCE_CUTOFF_HZ = 15.0  # what a hand can feel, and what the skill's force estimator passes
FELL_M = 0.1  # from where it was when the partner began to let go
NOTICED_S = 0.5  # within which letting go must have been noticed
ROLE_WITHIN_S = 0.3  # after 1 cm of motion the role must be known


class Verdict(NamedTuple):
    """What happened, in numbers, and why it failed (empty: it did not)."""

    failures: tuple[str, ...]
    effort_n2s: float  # the partner's: integral of F^2
    work_j: float  # done by the partner on the hand
    peak_force_n: float
    residual_force_n: float
    end_error_m: float  # from the goal that counts for this partner; NaN where none does
    tilt_deg: float
    ripple_m_per_s: float
    smoothness: float  # log dimensionless jerk, higher is smoother
    duration_s: float  # from 1 cm after the start until 1 cm before the end
    internal_force_n: float  # mean force that the two exert against each other and that moves nothing
    effort_share: float  # of the robot, 0 to 1
    role_right: float  # 1: the role was known in time, 0: it was not, NaN: nobody asked

    @property
    def success(self) -> bool:
        return not self.failures


DIVERGED = Verdict(("diverged",), *[inf] * 8, nan, inf, nan, 0.0)  # type: ignore[call-arg]


@dataclass(frozen=True)
class Bounds:
    """What counts as success with one partner. A bound of infinity is not asked for.

    goal       "partner's": ends within `end_m` of where he wants to be; "taught": within `end_m` of the range of taught ends;
               "": nowhere in particular
    """

    goal: str = ""
    end_m: float = 0.03
    peak_n: float = 15.0
    residual_n: float = 3.0  # from 1.5 s after the leading one's stop on
    ripple_m_per_s: float = 0.01  # in the last half second, half of peak to peak
    tilt_deg: float = 3.0
    starts_by_s: float = inf
    waits: bool = False  # moves no more than 1 cm before the partner does
    notices: bool = False  # is in COMPLY or HOLD within 0.5 s, and the hand then moves no more than 5 cm


def bounds(case: Case) -> Bounds:
    """The criteria for a case.

    Robot told to follow: the partner's goal within 3 cm, no start before he does. Told to lead: starts within 2 s, a taught
    height within 2 cm. Told nothing: the one or the other by what the partner does; at rest nothing tells a late leader from a
    follower, so where the partner follows its 2 s begin when its stated patience is over (6.5 s, the latest onset in the draw).
    Hesitating partners: the same, with a peak force of 25 N, as for all who misbehave but walls, and

    reverses       ends with the partner, wherever he turns to
    changes role   leading partner who stops and follows: rests where he stopped (told nothing: finishes the task as taught);
                   following partner who takes the lead: ends where he wants to be
    blocks         the impact stays below the envelope's force limit (60 N), and it does not press on
    lets go        within 0.05 to 2 s: noticed (COMPLY or HOLD) 0.5 s later, has not sunk more than 10 cm, holds the object there
    """
    if case.behaviour == "lets go":
        return Bounds(peak_n=inf, residual_n=inf, notices=True)
    if case.behaviour == "blocks":
        return Bounds(peak_n=Limits().force_limit_n)
    waits = case.leads
    starts = inf if case.leads else 2.0 + (AUTO_PATIENCE_S if case.role == "auto" else 0.0)
    taught = not case.leads
    if case.behaviour == "changes role":
        taught = case.leads and case.role == "auto"
    if case.behaviour == "reverses":
        taught = False
    peak = 15.0 if case.behaviour == "steady" else 25.0
    goal = "taught" if taught else "partner's"
    return Bounds(goal=goal, end_m=0.02 if taught else 0.03, peak_n=peak, starts_by_s=starts, waits=waits)


def partners_goal(case: Case) -> float:
    """Where the partner wants to be in the end, above the start [m]."""
    if case.leads:
        return sum(far for _, _, far in case.legs)
    return 0.0 if case.behaviour == "reverses" else case.lift_m


def judge(case: Case, recording: Recording, *, start_m: float = 0.85, taught_ends_m: Array | None = None) -> Verdict:
    """The verdict on one run. F is the plant's truth, low-passed at 15 Hz like everything a hand can feel.

    taught_ends_m   (lessons, 1) heights at which the lessons ended; a leader's goal

    What the partner stated of himself (recording.metadata["stated"]: goal_m, onset_s, stop_s) counts before the draw.
    """
    stated = {
        "goal_m": partners_goal(case),
        "onset_s": case.onset_s,
        "stop_s": case.stop_s,
        **recording.metadata.get("stated", {}),
    }
    hand = recording["hand.position"]
    t, x, v = hand.time - hand.time[0], hand.values[:, 0], recording["hand.velocity"].values[:, 0]
    dt = float(t[1] - t[0])
    true = recording["hand.true_force"].values
    if not (np.isfinite(true).all() and np.isfinite(x).all() and np.abs(true).max() < 1e9):
        return DIVERGED
    force = smooth(true, dt, FORCE_CUTOFF_HZ)[:, 0]
    bound = bounds(case)
    stop = _came_to_rest(t, x) if bound.goal == "taught" else stated["stop_s"]  # who leads says when it is over
    late = t >= min(stop + 1.5, t[-1] - 0.3)
    last = t > t[-1] - 0.5
    mine, his = _beyond_the_load(case, recording)
    verdict = Verdict(
        failures=(),
        effort_n2s=effort(force, dt),
        work_j=work(force, v, dt),
        peak_force_n=float(np.abs(force).max()),
        residual_force_n=float(np.abs(force[late]).max()),
        end_error_m=_end_error(case, bound, stated["goal_m"], float(x[-1]), start_m, taught_ends_m),
        tilt_deg=float(np.degrees(np.abs(recording["beam.tilt"].values).max())),
        ripple_m_per_s=float(np.ptp(v[last]) / 2.0),
        smoothness=log_dimensionless_jerk(v, dt),
        duration_s=_duration(t, x),
        internal_force_n=float(np.abs(internal_force(mine, his)).mean()),
        effort_share=effort_share(mine, his),
        role_right=_role_right(case, recording, t, x, start_m),
    )
    return verdict._replace(failures=_failures(case, bound, stated["onset_s"], verdict, recording, t, x, start_m))


def _came_to_rest(t: Array, x: Array) -> float:
    still_moving = np.flatnonzero(np.abs(x - x[-1]) > 0.01)
    return float(t[still_moving[-1]]) if len(still_moving) else 0.0


def _duration(t: Array, x: Array) -> float:
    gone = np.flatnonzero(np.abs(x - x[0]) > 0.01)
    return _came_to_rest(t, x) - float(t[gone[0]]) if len(gone) else 0.0


def _beyond_the_load(case: Case, recording: Recording) -> tuple[Array, Array]:
    """Forces of the robot's and of the partner's hand on the object (T,) [N], each without its share of the weight."""
    half = 0.5 * case.beam_mass_kg * STANDARD_GRAVITY
    true = recording["hand.true_force"].values[:, 0]
    his = recording["partner.force"].values[:, 0] - half
    acceleration = recording["hand.acceleration"].values[:, 0]
    return 0.5 * case.beam_mass_kg * acceleration - true, his


def _end_error(case: Case, bound: Bounds, goal_m: float, end: float, start_m: float, taught_ends_m: Array | None) -> float:
    if bound.goal == "partner's":
        return end - start_m - goal_m
    if bound.goal == "taught":
        ends = np.array([start_m + case.lift_m]) if taught_ends_m is None else np.asarray(taught_ends_m)
        return end - float(np.clip(end, ends.min(), ends.max()))
    return nan


def _role_right(case: Case, recording: Recording, t: Array, x: Array, start_m: float) -> float:
    """Whether the skill's opinion, 0.3 s after 1 cm of motion, is what the robot is: the leader or the follower."""
    if "skill.role" not in recording.channels:
        return nan
    moved = np.flatnonzero(np.abs(x - start_m) > 0.01)
    if not len(moved):
        return 0.0
    opinion = recording["skill.role"].values[
        np.searchsorted(t, t[moved[0]] + ROLE_WITHIN_S - 1e-9, side="left").clip(max=len(t) - 1)
    ]
    return float(int(opinion.argmax()) == (1 if case.leads else 0))


def _failures(
    case: Case, bound: Bounds, onset_s: float, verdict: Verdict, recording: Recording, t: Array, x: Array, start_m: float
) -> tuple[str, ...]:
    failures = []
    moved = np.flatnonzero(np.abs(x - start_m) > 0.01)
    if bound.waits and (t[moved] < onset_s).any():
        failures.append("moved before the partner")
    if bound.starts_by_s < inf and (not len(moved) or t[moved[0]] > bound.starts_by_s):
        failures.append("did not start in time")
    if abs(verdict.end_error_m) > bound.end_m:
        failures.append("missed the taught height" if bound.goal == "taught" else "missed the partner's goal")
    if bound.notices:
        failures.extend(_unnoticed(case, recording, t, x))
    checks = (
        (verdict.residual_force_n, bound.residual_n, "residual force"),
        (verdict.peak_force_n, bound.peak_n, "peak force"),
        (verdict.ripple_m_per_s, bound.ripple_m_per_s, "ripple at the end"),
        (verdict.tilt_deg, bound.tilt_deg, "beam not level"),
    )
    failures.extend(text for value, most, text in checks if value > most)
    return tuple(failures)


def _unnoticed(case: Case, recording: Recording, t: Array, x: Array) -> list[str]:
    after = t >= case.event_s + case.within_s + NOTICED_S
    if not after.any():
        return ["the run ended before the partner let go"]
    noticed = "skill.mode" in recording.channels and recording["skill.mode"].values[after][0, 0] > 0
    went_on = np.abs(x[after] - x[np.flatnonzero(after)[0]]).max() > 0.05
    fell = x[np.searchsorted(t, case.event_s)] - x[t >= case.event_s].min() > FELL_M
    found = ((not noticed, "letting go not noticed"), (bool(went_on), "went on alone"), (bool(fell), "fell"))
    return [text for wrong, text in found if wrong]


def success_interval(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % Wilson score interval of a success rate."""
    if trials == 0:
        return 0.0, 1.0
    p, n = successes / trials, trials
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)
