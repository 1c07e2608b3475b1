"""A skill that leads or follows, as the partner leaves it to do.

`RoleSkill` begins as it is told, or as a follower when it is told nothing: it follows whoever moves, takes over when nobody
does, and gives way to a partner who insists. Between the two it is one law all the time, with one compliance state, so a change
of role is a change of numbers and never a jump:

    M(a) dc/dt = dz(F - a F_r) - D(a) c        v = a (s' v_r(s) + lambda (x_r - x)) + c        |da/dt| <= 1 / blend_s
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import isfinite, nan

import numpy as np

from ..interfaces import Array, Command, Observation
from ..kernels import layouts
from ..kernels.copies import Copied
from ..signals.vectors import dot, length
from .collaborate import (
    LED_S,
    SAID_M,
    CollaborativeLaw,
    Compliance,
    Pace,
    Watch,
    believable,
    compiled,
    goals_shown,
    memory,
    off_path,
)
from .compliance import command_velocity, untaught
from .evidence import RoleEvidence
from .foresight import Foresight, anticipated
from .kept import FOLLOWS, LEADS, PROBES, Kept
from .reference import PhaseReference
from .whereabouts import Whereabouts

LATER = 1.5  # other people rest longer than those of the lessons
AROUND_S = 1.0  # so much of the path around where it is thought to be may be where it is
BIAS_S = 1.5  # how fast a force at rest, before the first motion, is taken for the sensor's
STIRS_S = 0.15  # a tremor of 2 N at 4 Hz stirs for less than this at a time, who sets out for longer
PULL_S = 0.08  # smoothing of the force that decisions are made on


@dataclass(frozen=True)
class RolePolicy:
    """When a robot that was told nothing leads and when it follows."""

    start_patience_s: float = 6.5  # nobody has moved yet: a partner who means to lead gets this long
    midway_patience_s: float = 2.0  # at rest short of where lessons ended: so long is a pause, longer is handing over
    resting_m_per_s: float = 0.02
    resting_n: float = 1.2
    finished_m: float = 0.02  # less of the way to the shortest lesson's end, and the task is done; so is one that was put back
    probe_n: float = 1.2  # taking over begins with a push that grows to this,
    probe_at_start_n: float = 1.8  # to this where nobody has moved yet,
    probe_most_n: float = 4.5  # and there, until something moves, to this;
    probe_n_per_s: float = 2.5  # so fast
    nudge_m: float = 0.007  # so much is a motion
    settles_s: float = 0.7  # then a spring has been stretched, and a person has felt it
    probe_s: float = 1.2  # in so long who gives way goes on
    progress_m: float = 0.006  # by this much at least; who keeps the place does not, but for the unrest of the arm
    probe_damping_ns_per_m: float = 8.0  # a hand that does not hold itself
    elsewhere_m: float = 0.05  # so far from an answered offer is another place
    held_m_per_s: float = 0.01  # leading, but slower than this against a pull: the partner holds
    held_s: float = 0.6
    elsewhere_n: float = 2.2  # told nothing, and at the end of the way: who pulls more for so long wants to be elsewhere
    offers_at_start: int = 2  # who was not ready is asked again; anywhere else, who keeps the place is asked once
    insist_n: float = 3.0  # resistance that is more than the other's inertia ...
    insist_ns_per_m: float = 40.0  # ... and damping is a will of its own;
    stiff_ns_per_m: float = 70.0  # against the hand's own motion a stiff shoulder resists so much
    ahead_n: float = 3.0  # pull in the direction of motion: the partner wants to lead
    insist_s: float = 0.3
    blend_s: float = 0.5

    @staticmethod
    def taught(references: Sequence[PhaseReference], onsets_s: Array) -> RolePolicy:
        """The defaults, but as patient as the lessons ask: with late beginners, and where the task itself rests on the way.

        onsets_s   (lessons,) how long those who led the robot rested before they began [s]; empty: not known
        """
        usual, latest = RolePolicy(), float(np.max(onsets_s, initial=0.0))
        pause = max(r.longest_rest_s for r in references)
        return replace(
            usual,
            start_patience_s=max(usual.start_patience_s, LATER * latest),
            midway_patience_s=max(usual.midway_patience_s, LATER * pause),
        )


class RoleSkill(Copied, Kept):
    """Leads or follows, as the partner leaves it to do; both from lessons of those roles.

    watch        shows where in the leader's task this is
    references   the path to each goal; `goal` is the number of the one to lead to, None: the one that the partner seems to mean,
                 and before anybody has moved the first
    leads        begins as the leader, as it was told to; else as a follower
    evidence   who leads, from the models; None where the role was told

    Diagnostics: weights (K,) of the leader's states, role (n,) probabilities of `evidence.names` if there is evidence, blend a
    in [0, 1] (1 leads), phase [s], clock rate, expected force, compliance velocity. `notice` says what it does when that is not
    what it was told: "follows", "offers to lead", "leads". All that is asked of the way, how much of it remains and where it goes
    next, is measured along the path.
    """

    stop_reason = ""
    ANEW = ("_compiled", "_tick")

    def __init__(
        self,
        watch: Watch,
        references: PhaseReference | Sequence[PhaseReference],
        *,
        leading: CollaborativeLaw,
        following: CollaborativeLaw,
        axes: tuple[str, ...],
        dt: float,
        leads: bool = False,
        evidence: RoleEvidence | None = None,
        policy: RolePolicy = RolePolicy(),
        goal: int | None = None,
    ) -> None:
        self._watch, self._told_to_lead, self._told = watch, leads, goal
        self.evidence, self.policy = evidence, policy
        self.axes, self.dt, self._dt, d = tuple(axes), dt, dt, len(axes)
        self._laws = [_between(following, leading, n / 50.0) for n in range(51)]
        # an offer must not be held up by what keeps a resting hand still
        self._asking = replace(leading, resting_damping_ns_per_m=leading.moving_damping_ns_per_m, dead_zone_n=0.0)
        # and what is moved by it must show by itself whether it goes on; a wall would shake such a hand
        given = policy.probe_damping_ns_per_m
        self._offering = replace(following, resting_damping_ns_per_m=given, moving_damping_ns_per_m=given, dead_zone_n=0.0)
        self._pace = Pace(references, leading, dt)
        self._where = Whereabouts(self._pace.references, dt)
        self._compliance = Compliance(d, dt)
        self._foresight = None if leads else Foresight(dt, d, self._pace.references)
        self._memory = memory(d)
        self._expected, self._velocity, self._position, self._start, *others = self._memory[: 8 * d].reshape(8, d)
        self._reference, self._pull, self._bias, self.taught = others
        numbers = self._memory[8 * d :].reshape(7, 1)
        self._phase, self._rate, self._rest_s, self._moved, self._against_s, self._held_s, told = numbers
        told[0] = -1.0 if goal is None else goal
        self._nothing, self._seen = np.zeros(d), np.zeros(3 * d)
        self._keep(d)
        self.leading = self._blend  # for the envelope
        self._begun = False
        self._link()

    def _link(self) -> None:
        shared = [getattr(self.policy, name) for name in layouts.BLOCKS["policy"]]
        self._compiled = compiled(
            self._watch, self._pace, self._compliance, self._where, self._memory, self._dt, following=self._laws[0],
            policy=shared, pull_s=PULL_S, bias_s=BIAS_S, bank=self.evidence and self.evidence.bank, foresight=self._foresight,
            role=self.kept,
        )  # fmt: skip
        self._tick: Callable[..., bool] | None = self._compiled.by_role if self._compiled is not None and self._begun else None

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        role = {} if self.evidence is None else {"role": self.evidence.probabilities}
        return {
            **role,
            "weights": self._watch.weights,
            "blend": self._blend,
            "phase": self._phase,
            "clock_rate": self._rate,
            "expected_force": self._expected,
            "compliance": self._compliance.velocity,
            **goals_shown(self._where),
        }

    @property
    def reference(self) -> PhaseReference:
        """The path of the goal that it leads to, or takes the partner to mean."""
        return self._pace.references[self._goal]

    @property
    def _goal(self) -> int:
        return self._where.goal if self._told is None else self._told

    @property
    def notice(self) -> str:
        off = off_path(self._outside, self._complies_only, self._state == LEADS and self._pace.off_m > SAID_M)
        return off or ("" if self._state == LEADS and self._told_to_lead else self._state)

    def reset(self, obs: Observation) -> None:
        self._enter(obs, None)

    def resume(self, obs: Observation) -> None:
        """As `reset`, from rest where the hand is, but in the part of the task in which it was."""
        self._enter(obs, float(self._phase[0]))

    def _enter(self, obs: Observation, last_s: float | None) -> None:
        goal = self._goal if last_s is not None else self._told or 0
        led = last_s is not None and self._state == LEADS  # who led goes on leading
        self._watch.reset()
        if self.evidence is not None:
            self.evidence.reset()
        position = believable(obs.position)
        if self._compiled is not None:
            self._outside = self._compiled.enter(position, goal, nan if last_s is None else last_s)
        else:
            self._outside = self._from_rest(position, goal, last_s)
        self._state = LEADS if self._told_to_lead or led else FOLLOWS
        self._gives, self._answers = False, 0
        self._place = None
        self._gave_way = self._put_back = False
        self._reached = self._push = 0.0
        self._complies_only = self._outside > self._pace.law.reach_m
        if self._complies_only:
            self._state = FOLLOWS
        self._meant = self._blend[0] = float(self._state == LEADS)
        self._begun = True
        self._tick = None if self._compiled is None else self._compiled.by_role

    def _from_rest(self, position: Array, goal: int, last_s: float | None) -> float:
        """At `position` on the way to `goal`; how far outside of what was taught that is [m]."""
        self._memory[:-1] = 0.0
        self._position[:] = self._start[:] = position
        self._compliance.reset()
        entry_s = [r.entry(position, last_s) for r in self._pace.references]
        if self._foresight is not None:
            self._foresight.reset(position.tolist(), begins=entry_s[goal] <= 0.0)
        self._where.reset(position, goal, entry_s)
        self._pace.start(entry_s[goal], position, goal=goal, waits_s=self._pace.law.start_delay_s)
        self._phase[0] = entry_s[goal]
        return min(r.outside_m(position) for r in self._pace.references)

    def step(self, obs: Observation, command: Command) -> None:
        tick = self._tick
        if tick is None or not tick(obs.position, obs.force, command.position, command.velocity, command.acceleration):
            self._step(obs, command)

    def _step(self, obs: Observation, command: Command) -> None:
        """The tick to read; the compiled one leaves it what is missing."""
        x = obs.position if isfinite(obs.position.sum()) else np.where(np.isfinite(obs.position), obs.position, self._position)
        force = obs.force if isfinite(obs.force.sum()) else np.where(np.isfinite(obs.force), obs.force, 0.0)
        self._position[:] = x
        self._watch.step(x, obs.force)
        if self.evidence is not None:
            np.concatenate([obs.position, self._asked(obs.force - self._bias), self._velocity], out=self._seen)
            self.evidence.step(self._seen, self._dt)
        force = force - self._bias
        self._pull += min(self._dt / PULL_S, 1.0) * (force - self._pull)
        if not self._complies_only:
            {FOLLOWS: self._take_over_if_nobody_leads, PROBES: self._probe, LEADS: self._give_way_to_who_insists}[self._state](x)
        if self._state != LEADS:
            self._where.step(x.tolist(), self._velocity.tolist())
            self._phase[0] = self._where.phase
            self.taught[:] = self._pace.references[self._where.goal].that_way(x, self._velocity)
        a, reference = self._blended(), self._nothing
        if a > 0.0:
            reference = self._led(x, force)
        asks = self._offering if self._gives else self._asking
        law = asks if self._state == PROBES else self._laws[round(50 * a)]
        going = self._meant * self._pace.going if self._state == LEADS else None
        follows, ahead, departs = self._state == FOLLOWS and not self._complies_only, self._nothing, 0.0
        astray = untaught(self._compliance.velocity, self.taught) if follows else 0.0
        if follows and a == 0.0:
            whole = isfinite(obs.position.sum()) and isfinite(obs.force.sum())
            ahead, departs = self._ahead(law, x.tolist(), force.tolist(), whole)
        self._compliance.step(law, force - self._expected, reference, ahead, departs, going, astray)
        command_velocity(law, self._dt, x, reference + self._compliance.velocity, self._velocity, command)

    def _asked(self, force: Array) -> Array:
        """(d,) [N] What the partner would have to pull if nothing were foreseen: teachers felt that, and models know it."""
        seen, law = self._foresight, self._laws[0]
        if seen is None or not seen.awake:
            return force
        return np.asarray(force + law.virtual_mass_kg * np.array(seen.foreseen(law, force.tolist())))

    def _ahead(self, law: CollaborativeLaw, x: list[float], force: list[float], whole: bool) -> tuple[Array, float]:
        """What a follower does by itself: acceleration (d,), and how fast a resting hand counts as moving. Of a sample from which
        something is missing nothing is heard."""
        seen, where, velocity = self._foresight, self._where, self._compliance.velocity.tolist()
        reference, departs = self._pace.references[where.goal], 0.0
        if seen is not None and law.foresight > 0.0:
            if whole:
                seen.hears(x, velocity, force, reference, where.phase)
            if seen.awake:
                seen.step(x, velocity)
            departs = seen.departs * law.moving_speed_m_per_s
            if seen.awake:
                return np.array(seen.foreseen(law, force)), departs
        return np.array(anticipated(law, reference, where.phase, velocity, force)), departs

    def _blended(self) -> float:
        """a moves toward its role's end no faster than 1 / blend_s."""
        most = self._dt / self.policy.blend_s
        self._blend[0] += min(max(float(self._state != FOLLOWS) - self._blend[0], -most), most)
        return float(self._blend[0])

    def _led(self, x: Array, force: Array) -> Array:
        """Velocity (d,) that leading adds; sets the force that it expects. A probe is a push: it expects to be resisted."""
        a = float(self._blend[0])
        if self._state == LEADS:
            self._pace.step(x, force)
            self._phase[0], self._rate[0] = self._pace.phase, self._pace.rate
            self._meant = min(self._meant + self._dt / self.policy.blend_s, 1.0)
            self.taught[:] = self._pace.velocity
            self._reference[:] = self._meant * self._pace.velocity
            self._expected[:] = self._meant * self._pace.expected - (1.0 - self._meant) * self._push * self._way
            return self._reference
        if self._state == PROBES:
            self._expected[:] = -self._push * self._way
            return self._nothing
        keep = max(a - self._dt / self.policy.blend_s, 0.0) / a  # what was meant fades with the blend
        self._expected *= keep
        self._reference *= keep
        return self._reference

    def _take_over_if_nobody_leads(self, x: Array) -> None:
        policy = self.policy
        speed, pull = _length(self._velocity), _length(self._pull)
        resting = speed < policy.resting_m_per_s and pull < policy.resting_n
        self._rest_s[0] = 0.0 if self._answered(not resting, STIRS_S) else self._rest_s[0] + self._dt
        if self._place is not None and _length(x - self._place) > policy.elsewhere_m:
            self._answers, self._place = 0, None
        if self._place is None:  # beside an offer the robot's own push has moved the hand
            self._moved[0] = self._moved[0] or _length(x - self._start) > 0.02
        if resting and not self._moved[0]:  # nobody means what is felt before anybody has moved
            self._bias += self._dt / BIAS_S * self._pull
        patience = policy.midway_patience_s if self._moved[0] else policy.start_patience_s
        offers = policy.offers_at_start if _length(x - self._start) <= policy.elsewhere_m else 1
        waited = resting and self._rest_s[0] >= patience
        if waited and self._unfinished() and self._answers < offers and not self._was_put_back(x):
            self._place = x.copy()
            self._way[:] = self.reference.heading(self._where.phase)
            self._reached = self._push = self._meant = self._held_s[0] = 0.0
            self._gives = False
            self._begin(PROBES)

    def _unfinished(self) -> bool:
        reference = self.reference
        return reference.remaining_m(self._where.phase) - reference.slack_m > self.policy.finished_m

    def _was_put_back(self, x: Array) -> bool:
        """After the robot gave way, the partner brought it back to where it began, and does not want the task done."""
        self._put_back = self._put_back or (self._gave_way and _length(x - self._start) < self.policy.finished_m)
        return self._put_back

    def _probe(self, x: Array) -> None:
        """Pushes a little harder all the time until something moves, and sees whether it goes on.

        Who keeps the place is a spring around it, which is stretched and stands; who gives way comes after, if late.
        """
        policy = self.policy
        assert self._place is not None
        far, along = _dot(x - self._place, self._way), _dot(self._pull, self._way)
        self._gives = self._gives or far > 0.5 * policy.nudge_m
        if self._rest_s[0] == 0.0 and self._push < self._most_push(far):
            self._push += policy.probe_n_per_s * self._dt
        else:
            self._rest_s[0] += self._dt
        if self._rest_s[0] < policy.settles_s:
            self._reached = far
        gives = far - self._reached > policy.progress_m or far > policy.elsewhere_m
        if gives:
            s = self.reference.closest(x, self._where.phase, AROUND_S)
            self._pace.start(s, x, goal=self._goal, eases=False)  # what it means grows anyway
            self._begin(LEADS)
        elif self._rest_s[0] >= policy.settles_s + policy.probe_s or along > policy.ahead_n:
            self._place = x.copy()
            self._answers += 1
            self._begin(FOLLOWS)

    def _most_push(self, far: float) -> float:
        policy = self.policy
        if self._moved[0]:  # who stopped at a place of their own is not to be moved away from it
            return policy.probe_n
        return policy.probe_at_start_n if far > policy.nudge_m else policy.probe_most_n

    def _give_way_to_who_insists(self, x: Array) -> None:
        """A will of its own: a pull ahead, resistance that neither speed nor the lessons explain, or a place that is kept."""
        policy, wanted = self.policy, self._pace.velocity
        along, speed = _dot(self._pull, wanted) / max(_length(wanted), 1e-3), _length(self._velocity)
        damper = policy.stiff_ns_per_m if _dot(self._pull, self._velocity) < 0.0 else policy.insist_ns_per_m
        pushed = -along > policy.insist_n + damper * speed
        going = self._pace.going > policy.resting_m_per_s
        # at the end of the way, a few mm off is no place that is held
        asks = policy.resting_m_per_s if going else self._pace.law.attraction_per_s * policy.finished_m
        under_way = self._pace.clock[LED_S] > policy.insist_s and self._meant >= 1.0 and _length(wanted) > asks
        held = under_way and speed < policy.held_m_per_s and _length(self._pull) > policy.resting_n
        # a sensor's offset is known only of a start at rest: who was told to lead stands by its end
        held = held or (self._foresight is not None and not going and self._ended() and _length(self._pull) > policy.elsewhere_n)
        self._held_s[0] = max(self._held_s[0] + (self._dt if held else -self._dt), 0.0)
        if self._answered(pushed or along > policy.ahead_n, policy.insist_s) or self._held_s[0] >= policy.held_s:
            self._place, self._answers, self._gave_way = None, 0, True
            self._begin(FOLLOWS)

    def _ended(self) -> bool:
        return self.reference.remaining_m(self._pace.phase) <= 0.0

    def _answered(self, against: bool, after_s: float) -> bool:
        self._against_s[0] = self._against_s[0] + self._dt if against else 0.0
        return bool(self._against_s[0] >= after_s)

    def _begin(self, state: str) -> None:
        self._state, self._rest_s[0], self._against_s[0] = state, 0.0, 0.0
        if state == FOLLOWS and self._foresight is not None:
            self._foresight.reset(self._position.tolist(), begins=False)


def _length(vector: Array) -> float:
    return length(vector.tolist())


def _dot(one: Array, other: Array) -> float:
    return dot(one.tolist(), other.tolist())


def _between(follow: CollaborativeLaw, lead: CollaborativeLaw, share: float) -> CollaborativeLaw:
    """The law of a robot that leads by `share`: every number on the straight line between the two."""
    return CollaborativeLaw(
        **{f.name: (1.0 - share) * getattr(follow, f.name) + share * getattr(lead, f.name) for f in fields(lead)}
    )
