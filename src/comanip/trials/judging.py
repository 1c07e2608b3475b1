"""What happened in a run, in numbers, and whether it was good: the criteria, stated once, of vectors in d axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..evaluation.metrics import effort, effort_share, internal_force, log_dimensionless_jerk, vibration, widest, work
from ..interfaces import STANDARD_GRAVITY, Array
from ..recording import Recording
from ..safety.envelope import Limits
from ..signals.filters import smooth
from ..tasks import usual, way
from .cases import AUTO_PATIENCE_S, Case
from .following import Followed, followed

FORCE_CUTOFF_HZ = 15.0  # what a hand can feel, and what the skill's force estimator passes
FELL_M = 0.1  # from where it was when the partner began to let go
NOTICED_S = 0.5  # within which letting go must have been noticed
ROLE_WITHIN_S = 0.3  # after 1 cm of motion the role must be known
MOVED_M = 0.01  # from here on the hand has moved
ARRIVED_M = 0.02  # of the end: who is asked there whether to go on, and stays, has arrived all the same
MOVING_M_PER_S = 0.02  # faster than this, the hand is in motion
MISBEHAVING_N = 10.0  # so much more force is borne with who misbehaves
OWN_WAY_M = 0.03  # so much nearer to an obstacle than a leading partner means to go, the hand may be pulled


class Verdict(NamedTuple):
    """What happened, in numbers, and why it failed (empty: it did not). Of vectors: their lengths."""

    failures: tuple[str, ...]
    effort_n2s: float  # the partner's: integral of F^2
    work_j: float  # done by the partner on the hand
    peak_force_n: float
    residual_force_n: float
    end_error_m: float  # distance from the goal that counts for this partner; NaN where none does
    tilt_deg: float
    ripple_m_per_s: float
    smoothness: float  # log dimensionless jerk, higher is smoother
    duration_s: float  # from 1 cm after the start until 1 cm before the end
    internal_force_n: float  # mean force that the two exert against each other and that moves nothing
    effort_share: float  # of the robot, 0 to 1
    role_right: float  # 1: the role was known in time, 0: it was not, NaN: nobody asked
    vibration_n: float = nan  # rms of the force above 2.5 Hz while the hand moves
    clearance_m: float = inf  # smallest distance to an obstacle, negative inside; inf without one
    visited: float = 1.0  # share of the places on the way that the hand was at, in order
    cycles: float = nan  # strokes or turns done; NaN for a task that is done once
    rest_error_s: float = 0.0  # by how much a rest on the way was longer or shorter than meant
    slowness: float = nan  # duration over what was meant: the leading partner's, or the usual one
    arrived_s: float = nan  # from 1 cm after the start until the hand is within 2 cm of its end for good

    @property
    def success(self) -> bool:
        return not self.failures


DIVERGED = Verdict(("diverged",), *[inf] * 8, nan, inf, nan, 0.0)  # type: ignore[call-arg]


@dataclass(frozen=True)
class Bounds:
    """What counts as success with one partner. A bound of infinity is not asked for.

    goal       "partner's": ends within `end_m` of where the partner wants to be; "taught": within `end_m` of where lessons ended;
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
    """The criteria for a case; the numbers of a task are its own (`Task.success`), here in brackets those of "lift".

    Robot told to follow: the partner's goal within [3 cm], no start before the partner's. Told to lead: starts within 2 s, a
    taught end within [2 cm]. Told nothing: the one or the other by what the partner does; at rest nothing tells a late leader
    from a follower, so where the partner follows its 2 s begin when its stated patience is over (6.5 s, the latest onset drawn).
    Hesitating partners: the same, with a peak force 10 N higher, as for all who misbehave but walls, and

    reverses       ends with the partner, wherever that is
    changes role   leading partner who stops and follows: rests where that was (told nothing: finishes the task as taught);
                   following partner who takes the lead: ends where this partner wants to be
    blocks         the impact stays below the envelope's force limit (60 N), and it does not press on
    lets go        within 0.05 to 2 s: noticed (COMPLY or HOLD) 0.5 s later, has not sunk more than 10 cm, holds the object there
    """
    own = case.task.success
    held: dict[str, Any] = {"residual_n": own.residual_n, "ripple_m_per_s": own.ripple_m_per_s, "tilt_deg": own.tilt_deg}
    if case.behaviour == "lets go":
        return Bounds(peak_n=inf, notices=True, **{**held, "residual_n": inf})
    if case.behaviour == "blocks":
        return Bounds(peak_n=Limits().force_limit_n, **held)
    taught = not case.leads
    if case.behaviour == "changes role":
        taught = case.leads and case.role == "auto"
    if case.behaviour == "reverses":
        taught = False
    return Bounds(
        goal="taught" if taught else "partner's",
        end_m=own.taught_goal_m if taught else own.goal_m,
        peak_n=own.peak_n if case.behaviour == "steady" else own.peak_n + MISBEHAVING_N,
        starts_by_s=inf if case.leads else 2.0 + (AUTO_PATIENCE_S if case.role == "auto" else 0.0),
        waits=case.leads,
        **held,
    )


def partners_goal(case: Case) -> Array:
    """Where the partner wants to be in the end, (d,) from the start [m]."""
    if case.leads:
        return case.course.end
    return np.zeros(len(case.axes)) if case.behaviour == "reverses" else case.way.course.end


@dataclass(frozen=True)
class _Run:
    """A recording as the judge reads it: times (T,) from 0, place from the start and velocity (T, d), force (T, d) as felt."""

    t: Array
    x: Array
    v: Array
    force: Array

    @property
    def dt(self) -> float:
        return float(self.t[1] - self.t[0])

    @property
    def moved(self) -> NDArray[np.intp]:
        """Ticks in which the hand is more than 1 cm from the start."""
        return np.flatnonzero(_length(self.x) > MOVED_M)

    @property
    def came_to_rest_s(self) -> float:
        return self._last_away_s(MOVED_M)

    def _last_away_s(self, far_m: float) -> float:
        moving = np.flatnonzero(_length(self.x - self.x[-1]) > far_m)
        return float(self.t[moving[-1]]) if len(moving) else 0.0

    def lasting_s(self, within_m: float) -> float:
        """From 1 cm after the start until it is within so much of its end for good."""
        gone = np.flatnonzero(_length(self.x - self.x[0]) > MOVED_M)
        return self._last_away_s(within_m) - float(self.t[gone[0]]) if len(gone) else 0.0


def _length(vectors: Array) -> Array:
    """(T,) of (T, d). Of one axis exactly the absolute value."""
    return np.abs(vectors[:, 0]) if vectors.shape[1] == 1 else np.sqrt((vectors**2).sum(axis=1))


def judge(
    case: Case,
    recording: Recording,
    *,
    start_m: float | Sequence[float] | Array | None = None,
    taught_ends_m: Array | None = None,
    lessons_clearance_m: float | None = None,
    within: Bounds | None = None,
) -> Verdict:
    """The verdict on one run. F is the plant's truth, low-passed at 15 Hz like everything a hand can feel.

    start_m              (d,) where the hand started; default: where the case says
    taught_ends_m        (lessons, d) where the lessons ended; a leader's goal
    lessons_clearance_m  smallest distance to an obstacle in any lesson; None: not known, and only being inside one counts
    within               other criteria than `bounds(case)`

    What the partner stated (recording.metadata["stated"]: goal_m, onset_s, stop_s) counts before the draw.
    """
    case = case.starting(start_m)
    stated = {
        "goal_m": partners_goal(case),
        "onset_s": case.onset_s,
        "stop_s": case.stop_s,
        **recording.metadata.get("stated", {}),
    }
    hand, true = recording["hand.position"], recording["hand.true_force"].values
    if not (np.isfinite(true).all() and np.isfinite(hand.values).all() and np.abs(true).max() < 1e9):
        return DIVERGED
    t = hand.time - hand.time[0]
    force = smooth(true, float(t[1] - t[0]), FORCE_CUTOFF_HZ)
    run = _Run(t, hand.values - case.start_m, recording["hand.velocity"].values, force)
    bound = within or bounds(case)
    stop = run.came_to_rest_s if bound.goal == "taught" else stated["stop_s"]  # who leads says when it is over
    late, last = t >= min(stop + 1.5, t[-1] - 0.3), t > t[-1] - 0.5
    mine, theirs = _beyond_the_load(case, recording)
    along = followed(case, run.t, run.x, run.v)
    verdict = Verdict(
        failures=(),
        effort_n2s=effort(force, run.dt),
        work_j=work(force, run.v, run.dt),
        peak_force_n=float(_length(force).max()),
        residual_force_n=float(_length(force[late]).max()),
        end_error_m=end_error(case, bound, stated["goal_m"], run.x[-1], taught_ends_m),
        tilt_deg=float(np.degrees(_length(recording["beam.tilt"].values).max())),
        ripple_m_per_s=widest(run.v[last]) / 2.0,
        smoothness=log_dimensionless_jerk(run.v, run.dt),
        duration_s=run.lasting_s(MOVED_M),
        internal_force_n=float(_length(internal_force(mine, theirs)).mean()),
        effort_share=effort_share(mine, theirs),
        role_right=_role_right(case, recording, run),
        vibration_n=vibration(force, run.dt, _length(run.v) > MOVING_M_PER_S),
        clearance_m=along.clearance_m,
        visited=along.visited,
        cycles=along.cycles,
        rest_error_s=along.rest_error_s,
        slowness=run.lasting_s(MOVED_M) / along.meant_s,
        arrived_s=run.lasting_s(ARRIVED_M),
    )
    failures = _failures(case, bound, stated["onset_s"], verdict, recording, run)
    failures += _off_the_way(case, verdict, along, lessons_clearance_m)
    return verdict._replace(failures=failures)


def _beyond_the_load(case: Case, recording: Recording) -> tuple[Array, Array]:
    """Forces of the robot's and of the partner's hand on the object (T, d) [N], each without its share of the weight."""
    half = 0.5 * case.beam_mass_kg
    true = recording["hand.true_force"].values
    weight = half * np.array([axis.up for axis in case.task.axes_]) * STANDARD_GRAVITY
    return half * recording["hand.acceleration"].values - true, recording["partner.force"].values - weight


def end_error(case: Case, bound: Bounds, goal_m: Any, end: Array, taught_ends_m: Array | None) -> float:
    """How far `end`, (d,) from the start, is from the goal that counts; NaN where none does."""
    if bound.goal == "partner's":
        return float(_length((end - np.atleast_1d(goal_m))[None])[0])
    if bound.goal != "taught":
        return nan
    if taught_ends_m is None:
        return float(_length((end - case.way.course.end)[None])[0])
    ends = np.asarray(taught_ends_m, dtype=float)
    return min(_from_segments(end + case.start_m, some) for some in _by_goal(case, ends))


def _by_goal(case: Case, ends: Array) -> list[Array]:
    """Ends of lessons (n, d) apart by the goal that they are nearest to: between two goals nobody was taught to stop."""
    if len(case.task.goals) < 2:
        return [ends]
    aims = np.array([case.task.start + way(case.task, usual(case.task, goal)).course.end for goal in case.task.goals])
    nearest = ((ends[:, None] - aims) ** 2).sum(axis=2).argmin(axis=1)
    return [ends[nearest == n] for n in range(len(aims)) if (nearest == n).any()]


def _from_segments(point: Array, ends: Array) -> float:
    """Distance of a point (d,) from the nearest straight line between two of `ends` (n, d): on one axis, from their range."""
    if len(point) == 1:
        return float(abs(point[0] - np.clip(point[0], ends.min(), ends.max())))
    one, other = np.triu_indices(len(ends))
    base, along = ends[one], ends[other] - ends[one]
    share = ((point - base) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    return float(_length(point - base - np.clip(share, 0.0, 1.0)[:, None] * along).min())


def _role_right(case: Case, recording: Recording, run: _Run) -> float:
    """Whether the skill's opinion, 0.3 s after 1 cm of motion, is what the robot is: the leader or the follower."""
    if "skill.role" not in recording.channels:
        return nan
    if not len(run.moved):
        return 0.0
    opinion = recording["skill.role"].values[
        np.searchsorted(run.t, run.t[run.moved[0]] + ROLE_WITHIN_S - 1e-9, side="left").clip(max=len(run.t) - 1)
    ]
    return float(int(opinion.argmax()) == (1 if case.leads else 0))


def _failures(case: Case, bound: Bounds, onset_s: float, verdict: Verdict, recording: Recording, run: _Run) -> tuple[str, ...]:
    failures = []
    moved = run.moved
    if bound.waits and (run.t[moved] < onset_s).any():
        failures.append("moved before the partner")
    if bound.starts_by_s < inf and (not len(moved) or run.t[moved[0]] > bound.starts_by_s):
        failures.append("did not start in time")
    if abs(verdict.end_error_m) > bound.end_m:
        failures.append(f"missed the taught {case.task.end_is}" if bound.goal == "taught" else "missed the partner's goal")
    if bound.notices:
        failures.extend(_unnoticed(case, recording, run))
    checks = (
        (verdict.residual_force_n, bound.residual_n, "residual force"),
        (verdict.peak_force_n, bound.peak_n, "peak force"),
        (verdict.ripple_m_per_s, bound.ripple_m_per_s, "ripple at the end"),
        (verdict.tilt_deg, bound.tilt_deg, "beam not level"),
    )
    failures.extend(text for value, most, text in checks if value > most)
    return tuple(failures)


def _off_the_way(case: Case, verdict: Verdict, along: Followed, lessons_clearance_m: float | None) -> tuple[str, ...]:
    """What went wrong between start and end: an obstacle comes first with everybody, the rest is asked of steady partners."""
    failures, own = [], case.task.success
    least = 0.0 if lessons_clearance_m is None else lessons_clearance_m
    if case.leads:  # a partner who leads past closer is followed
        least = min(least, along.partner_clearance_m - OWN_WAY_M)
    if verdict.clearance_m <= 0.0:
        failures.append("hit an obstacle")
    elif case.behaviour == "steady" and verdict.clearance_m < least:
        failures.append("nearer to an obstacle than any lesson")
    if case.behaviour != "steady":
        return tuple(failures)
    if verdict.cycles == verdict.cycles and abs(verdict.cycles - case.task.cycles) > 0.5:
        failures.append("other number of cycles")
    elif verdict.visited < 1.0:
        failures.append("left out a place on the way")
    if verdict.rest_error_s > own.rest_s:
        failures.append("rest not kept")
    checks = ((verdict.vibration_n, own.vibration_n, "vibration"), (verdict.slowness, own.slowest, "too slow"))
    return tuple(failures) + tuple(text for value, most, text in checks if value > most)


def _unnoticed(case: Case, recording: Recording, run: _Run) -> list[str]:
    """Counted from when the partner's hand is gone; the way down from when it began to go."""
    after = run.t >= case.event_s + case.within_s + NOTICED_S
    if not after.any():
        return ["the run ended before the partner let go"]
    noticed = "skill.mode" in recording.channels and recording["skill.mode"].values[after][0].max() > 0
    went_on = _length(run.x[after] - run.x[np.flatnonzero(after)[0]]).max() > 0.05
    height = run.x @ np.array([axis.up for axis in case.task.axes_])
    fell = height[np.searchsorted(run.t, case.event_s)] - height[run.t >= case.event_s].min() > FELL_M
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
