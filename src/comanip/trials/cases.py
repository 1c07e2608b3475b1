"""Whom a skill is tried with: partners it has never met, drawn wider than the lessons, some of whom misbehave.

What the partners of a task are drawn from is stated in the task's file (`tasks`); what they are like as people, here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import exp, log, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import STANDARD_GRAVITY, Array, Partner
from ..parts import unknown
from ..people.intent import Course
from ..people.misbehaving import Blocks, LetsGo, Switches
from ..people.partners import Arm, HumanFollower, HumanLeader, Unsteadiness, Yielding
from ..plants.rigid import Turning
from ..tasks import Drawn, Task, Way, draw_partner, named, retimed, way

ROLES = ("leader", "follower", "auto")
MISBEHAVIOURS = ("hesitates", "reverses", "blocks", "lets go", "changes role")
HAND_KG = 1.0  # effective mass of a hand in a lift, for the damping ratio
LEADER_STARTS_S = 0.5  # a robot told to lead begins about here, so a partner who follows misbehaves some time after
AUTO_PATIENCE_S = 6.5  # a robot told nothing gives a partner who leads all the time that the draw allows
SETTLING_S = 8.0  # a run with a partner who follows lasts so long, and longer by what its task is longer than
SHORT_S = 2.2  # this one
TASK = "lift"  # where no other is asked for


@dataclass(frozen=True)
class Case:
    """One partner and one day: everything a closed-loop run needs, by value.

    role        what the ROBOT is told: "leader", "follower", or "auto" when nobody tells it
    partner     what the person does: "leading" or "following"
    behaviour   "steady", or one of MISBEHAVIOURS, which begins `event` of the way through the motion
    lift_m      how far a leading partner goes, in the measure of `Task.size_m`; for a following one who changes role, where this
                person then wants to be
    duration_s  of that motion, rests on the way left out
    task        what is done; kind: which kind of person does it ("": those of `people.partners`)
    start       (d,) where the hand starts; None: as drawn around the task's own start
    """

    role: str
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
    partner: str = "leading"
    behaviour: str = "steady"
    event: float = 0.5
    pause_s: float = 1.0
    task: Task = field(default_factory=lambda: named(TASK), repr=False)
    kind: str = ""
    start: tuple[float, ...] | None = None

    @property
    def leads(self) -> bool:
        """Whether the person leads, at least at first."""
        return self.partner == "leading"

    @property
    def axes(self) -> tuple[str, ...]:
        return self.task.axes

    @property
    def carried_n(self) -> float:
        """The share of the weight that the partner carries [N], whichever axis it acts along."""
        return self._share_kg * STANDARD_GRAVITY

    @property
    def carried(self) -> Array:
        """(d,) [N] the same along each axis, as a force on the object."""
        return np.array([self._share_kg * -g for g in self.task.gravity.tolist()])

    @property
    def _share_kg(self) -> float:
        return (1.0 - self.task.carried.share) * self.beam_mass_kg

    @cached_property
    def drawn(self) -> Drawn:
        """What varies of the task in this case."""
        rng = np.random.default_rng([self.seed, 1])
        drawn = draw_partner(self.task, rng, self.lift_m, self.duration_s, self.onset_s)
        return drawn if self.start is None else replace(drawn, start=tuple((np.array(self.start) - self.task.start).tolist()))

    @property
    def start_m(self) -> Array:
        """(d,) where the hand starts."""
        if self.start is not None:
            return np.array(self.start)
        return self.task.start if self.drawn.start is None else self.task.start + np.array(self.drawn.start)

    def starting(self, start: float | Sequence[float] | Array | None) -> Case:
        """The same with the hand starting elsewhere, (d,); None changes nothing."""
        if start is None:
            return self
        place = np.atleast_1d(np.asarray(start, dtype=float))
        if place.shape != (len(self.axes),):
            raise ParameterError(f"start_m needs {len(self.axes)} values, {', '.join(self.axes)}; got {start!r}")
        return replace(self, start=tuple(place.tolist()))

    @cached_property
    def way(self) -> Way:
        """How a steady partner would go, and the places that the task visits in this case."""
        return way(self.task, self.drawn, self._share_kg)

    @property
    def event_s(self) -> float:
        """When the misbehaviour begins [s]."""
        if self.leads:
            return self.onset_s + self.event * self._whole_s
        begins = AUTO_PATIENCE_S if self.role == "auto" else LEADER_STARTS_S
        return begins + self.event * (self.task.moving_s + self.task.rests_s)

    @property
    def within_s(self) -> float:
        """Within which a partner who lets go has gone, 0.05 to 2 s [s]; out of the seed, so that it moves no other draw."""
        return 0.05 + 1.95 * (self.seed % 9973) / 9972

    @property
    def _whole_s(self) -> float:
        """Duration of the steady way, rests included [s]."""
        return self.duration_s + float(self.way.rests.sum())

    @property
    def _knots(self) -> tuple[tuple[float, float, float], ...]:
        """How a leading partner goes: (start [s], duration [s], which share of the way, negative: back)."""
        part, whole = self.event, self._whole_s
        first = (self.onset_s, max(0.8, 1.3 * self.event * whole), part)
        stop = first[0] + first[1]
        rest = max(0.8, 1.3 * (1.0 - self.event) * whole)
        if self.behaviour == "hesitates":
            return first, (stop + self.pause_s, rest, 1.0 - part)
        if self.behaviour == "reverses":
            return first, (stop, first[1], -part)
        return (first,) if self.behaviour == "changes role" else ((self.onset_s, whole, 1.0),)

    @cached_property
    def course(self) -> Course:
        """How a leading partner goes, misbehaviour included: one straight leg cut into legs, any other way at other times."""
        course, knots = self.way.course, self._knots
        if len(knots) == 1 and knots[0][2] == 1.0:
            return course
        if len(course.legs) == 1 and course.curve is None:
            far, turned_back = course.legs[0][2], self.behaviour == "hesitates"
            done = [self.event * x for x in far]
            shares = [done, [x - y for x, y in zip(far, done, strict=True)] if turned_back else [-x for x in done]]
            legs = tuple((start, duration, tuple(share)) for (start, duration, _), share in zip(knots, shares, strict=False))
            return Course(legs, feedforward_kg=course.feedforward_kg)
        whole = course.stop_s - course.start_s
        return retimed(course, [(start, duration, share * whole) for start, duration, share in knots])

    def at_grip(self, course: Course, gone: Array | None = None) -> Course:
        """How the partner's own hand goes when the robot's goes `course`: the same, but where the object turns.

        gone   (d,) how far the robot's hand has gone before
        """
        turning = self.turning
        return course if turning is None else turning.course(course, self.task.carried.length_m, gone)

    @cached_property
    def turning(self) -> Turning | None:
        """How the object turns; None where it does not."""
        return Turning(self.axes, self.task.levers_m, self.task.carried.along) if self.task.turns else None

    @property
    def legs(self) -> tuple[tuple[float, float, Any], ...]:
        """How a leading partner goes where that is minimum-jerk legs: (start [s], duration [s], how far [m]; (d,) in d axes)."""
        legs = self.course.legs
        return tuple((start, duration, far[0]) for start, duration, far in legs) if len(self.axes) == 1 else legs

    @property
    def stop_s(self) -> float:
        """When the partner's own plan, or misbehaviour, has come to its end [s]; 0 for one who only follows."""
        if self.behaviour in ("blocks", "lets go"):
            return self.event_s + (self.within_s if self.behaviour == "lets go" else 0.0)
        if self.leads:
            return self.course.stop_s
        return {"hesitates": self.event_s + self.pause_s, "steady": 0.0}.get(self.behaviour, self.event_s + 0.2 + self.duration_s)

    @property
    def run_s(self) -> float:
        """How long the run lasts [s]."""
        longer = 2.0 * (self.task.moving_s + self.task.rests_s - SHORT_S)
        if self.behaviour == "changes role" and self.leads and self.role == "auto":
            return self.stop_s + 10.0 + max(longer, 0.0)  # the robot has to notice and to finish the task
        # a robot that may lead might take a partner's end for a hand-over, and offers: watched until that is over
        insists = self.behaviour in ("reverses", "changes role")
        after = self.stop_s + (2.5 if self.role == "follower" else 14.0 if insists else 8.0)
        if self.leads:
            return after
        begins = AUTO_PATIENCE_S if self.role == "auto" else 0.0
        usual = SETTLING_S + max(longer, 0.0)
        return max(begins + usual + (self.pause_s + 8.0 if self.behaviour == "hesitates" else 0.0), after)

    def about(self) -> dict[str, Any]:
        """Every number, for the metadata of a recording; the task by its name."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"task": self.task.name}


def draw_case(role: str, rng: np.random.Generator, *, task: str | Path | Task = TASK, misbehaving: float = 0.0) -> Case:
    """A partner for a robot in `role`, drawn wider than the lessons.

    How far, how long and when is in the task's file (`Task.partners`; lift 0.15-0.38 m, 1.6-4 s, onset 0.3-6 s). All tasks:
    K 60-600 N/m (log-uniform), damping ratio 0.3-0.8, follower damping 15-60 N s/m, delays 0.10-0.25 s, mass of the object
    +-30 %, force bias +-1 N, noise to 0.5 N, sensor delay to 20 ms, tremor to 0.1 N. A following partner is somebody who can hold
    a rail without shaking: the stiffness is capped where that person's own loop (stiffness, yielding, delay) would oscillate
    against a wall. For "auto" one partner in two leads.

    misbehaving   share of partners who hesitate, reverse, block, let go or change role, each as often, at 0.3-0.7 of the motion
    """
    check_generator(rng)
    if role not in ROLES:
        raise unknown("role", role, ROLES)
    what = named(task).in_arcs()
    leads = role == "follower" or (role == "auto" and bool(rng.uniform() < 0.5))
    mass = what.carried.mass_kg * rng.uniform(0.7, 1.3)
    stiffness = exp(rng.uniform(log(60.0), log(600.0)))
    ratio, yielding, delay = rng.uniform(0.3, 0.8), rng.uniform(15.0, 60.0), rng.uniform(0.10, 0.25)
    if not leads:
        stiffness = min(stiffness, _steady_stiffness(yielding, delay))
    steady: dict[str, Any] = {
        "lift_m": rng.uniform(*what.partners.size_m),
        "duration_s": rng.uniform(*what.partners.duration_s),
        "onset_s": rng.uniform(*what.partners.onset_s),
        "force_bias_n": rng.uniform(-1.0, 1.0),
        "force_noise_n": rng.uniform(0.05, 0.5),
        "sensor_delay_s": rng.uniform(0.0, 0.020),
        "tremor_n": rng.uniform(0.0, 0.1),
        "seed": int(rng.integers(2**62)),
    }
    habit, which = rng.uniform(), int(rng.integers(len(MISBEHAVIOURS)))
    return Case(
        role=role,
        partner="leading" if leads else "following",
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=2.0 * ratio * sqrt(stiffness * (HAND_KG + 0.5 * mass)),
        yielding_ns_per_m=yielding,
        delay_s=delay,
        beam_mass_kg=mass,
        behaviour=MISBEHAVIOURS[which] if habit < misbehaving else "steady",
        event=rng.uniform(0.3, 0.7),
        pause_s=rng.uniform(0.8, 2.5),
        task=what,
        **steady,
    )


def _steady_stiffness(yielding_ns_per_m: float, delay_s: float) -> float:
    """Up to this stiffness [N/m] somebody who follows can hold a rail without shaking."""
    return 0.9 * yielding_ns_per_m / (delay_s + 0.13)


def partner_of(case: Case, rng: np.random.Generator) -> Partner:
    """The person of the case; `rng` is what makes a hand unsteady."""
    arm = Arm(case.stiffness_n_per_m, case.damping_ns_per_m, case.carried_n, Unsteadiness(tremor_n=case.tremor_n))
    softer = replace(arm, stiffness_n_per_m=min(case.stiffness_n_per_m, _steady_stiffness(case.yielding_ns_per_m, case.delay_s)))
    about: dict[str, Any] = {"axes": case.axes, "carried": case.carried.tolist(), "rng": rng}

    def leading(course: Course, gone: Array | None = None) -> Partner:
        return HumanLeader(case.at_grip(course, gone), arm, **about)

    def following(*_: Array) -> Partner:
        yielding = Yielding(damping_ns_per_m=case.yielding_ns_per_m, delay_s=case.delay_s)
        return HumanFollower(yielding, softer, moving=case.axes, **about)

    def insisting(start: Array, position: Array) -> Partner:
        gone = position - start
        if case.turning is not None:
            gone = case.turning.ungripped(gone, case.task.carried.length_m)
        return leading(_what_is_left(case, gone), gone)

    first = leading(case.course) if case.leads else following()
    if case.behaviour == "lets go":
        return LetsGo(first, case.event_s, case.within_s)
    if case.behaviour == "blocks":
        return Blocks(first, case.event_s, carried=case.carried)
    if case.leads:
        return Switches(first, [(case.stop_s, following)]) if case.behaviour == "changes role" else first
    if case.behaviour == "hesitates":
        holds = Course.still(len(case.axes), case.way.course.feedforward_kg)
        return Switches(first, [(case.event_s, lambda *_: leading(holds)), (case.event_s + case.pause_s, following)])
    return Switches(first, [(case.event_s, insisting)]) if case.behaviour != "steady" else first


def _what_is_left(case: Case, gone: Array) -> Course:
    """From where the hand is, (d,) from its start, on through the places that lie ahead; for who reverses, back to the start."""
    places = case.way.places
    if case.behaviour == "reverses":
        ahead = np.zeros((1, len(gone)))
    elif case.task.cycles:  # no place tells how many cycles are left
        ahead = places[-1:]
    else:
        ahead = places[min(int(((places - gone) ** 2).sum(axis=1).argmin()) + (len(places) > 1), len(places) - 1) :]
    steps = np.diff(np.vstack([gone, ahead]), axis=0)
    each = case.duration_s / len(steps)
    legs = tuple((0.2 + n * each, each, tuple(step)) for n, step in enumerate(steps.tolist()))
    return Course(legs, feedforward_kg=case.way.course.feedforward_kg)
