"""The default law: one law for both roles, a reference that was learned, compliance around the force that was learned.

    M dc/dt = dz(F - F_r) - D c + M a_ff      compliance: a mass-damper around the EXPECTED force
    v       = s' v_r(s) + lambda (x_r(s) - x) + c

Leader and follower differ in who drives the phase s of the reference (x_r, v_r, F_r):

leader    time drives s, and resistance beyond what was taught slows it down; the partner can always push the hand away from
          the reference, because the compliance c is passive (F > 0 never moves the hand down)
follower  evidence drives s: where on the path the hand is (`skills.whereabouts`). The reference contributes no motion of its own,
          only what reflexes cannot know: a_ff, how speed will change next if the partner goes on as taught, as long as the force
          agrees

Why not eq. (5) alone: in a leader's lessons force is the EFFECT of motion, and regressing velocity on it closes a positive
feedback through the partner; see docs/laws.md. At rest the damping rises and a dead zone opens, so noise moves nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite, nan
from typing import Any

import numpy as np

from .. import kernels
from ..errors import MismatchError, ParameterError
from ..interfaces import Array, Command, Observation
from ..kernels import layouts
from ..kernels.copies import Copied
from ..models.filtering import ForwardFilter
from ..models.hmm import Hmm
from ..signals.vectors import dot, length
from .compliance import ABSURD, Compliance, command_velocity, untaught
from .foresight import Foresight, anticipated
from .reference import PhaseReference
from .whereabouts import Whereabouts

ROLES = ("leader", "follower")
FADES_S, FADES_BELOW = 1.0, 0.7  # an offset from the path fades in so long at least, and below this share of the taught top speed
EASES_S = 0.8  # who enters where lessons were in motion comes up to their speed in this time,
BEGINS_S = 0.3  # and where they began, in this: what counts as motion in a lesson begins at a few per cent of its speed, not at 0
MOST_AXES = 6  # of a compiled tick
SAID_M = 0.05  # an offset that is worth saying
LATEST = 1.8  # times as long as taught a leader may take: long motions at the slowest clock would outlast the partner's patience


@dataclass(frozen=True)
class CollaborativeLaw:
    """Numbers of the law. Defaults were chosen on partners drawn for tuning, never on those that results are reported on."""

    virtual_mass_kg: float = 3.3
    moving_damping_ns_per_m: float = 3.0
    resting_damping_ns_per_m: float = 80.0
    untaught_damping_ns_per_m: float = 20.0  # follower: where lessons never went that way; who has come to the end swings back
    moving_speed_m_per_s: float = 0.05  # from here on the hand counts as fully in motion
    dead_zone_n: float = 0.4  # at rest only
    anticipation: float = 0.45  # share of the foreseen acceleration that the follower adds by itself
    anticipation_s: float = 0.05
    foresight: float = 0.6  # share of what the plans expect that the follower does by itself
    attraction_per_s: float = 4.0  # lambda, leader
    start_delay_s: float = 0.5  # leader: stands still this long before it starts
    comfortable_n: float = 0.5  # leader: resistance of the partner from which it slows its clock
    yield_gain_per_n: float = 0.4
    slowest_clock: float = 0.38
    patience_s: float = 0.6  # how long resistance must last to count
    reach_m: float = 0.10  # starts farther than this from the taught path: comply only (a leader moves over from farther)
    max_acceleration_m_per_s2: float = 5.0
    shake_hz: float = 2.5  # faster than people move a load together: what oscillates above is instability or shaking
    shake_n: float = 1.0  # amplitude from which it is damped
    shake_damping_ns_per_m_per_n: float = 20.0
    shake_memory_s: float = 3.0  # what goes on oscillating is damped more and more, and as slowly less
    shake_growth_per_s: float = 0.3
    grip_hz: float = 8.0  # about as fast as two hands, or a hand and an arm, turn on a grip: more virtual mass holds that, while
    grip_n: float = 0.3  # people who are late, and shake at 2-4 Hz, need less of it
    grip_mass_kg_per_n: float = 20.0
    lead_s: float = 0.02  # the robot's actuator lag, anticipated in the command

    @staticmethod
    def for_role(role: str, **settings: Any) -> CollaborativeLaw:
        """The defaults of a role, with `settings` on top; unknown names list the known ones."""
        known = CollaborativeLaw.__dataclass_fields__
        unknown = sorted(set(settings) - set(known))
        if unknown:
            raise ParameterError(f"law 'default' has no setting {unknown[0]!r}; it has: {', '.join(known)}")
        law = CollaborativeLaw()
        if role == "leader":
            law = replace(law, virtual_mass_kg=6.0, moving_damping_ns_per_m=30.0, dead_zone_n=0.5, reach_m=0.30)
        return replace(law, **settings)


layouts.agree("law", CollaborativeLaw.__dataclass_fields__, "CollaborativeLaw")


PHASE_S, RATE, RESISTANCE, WAITS_S, FADED, FADING_S, LED_S, EASING_S, GOAL, GOING = range(10)  # Pace.clock


class Pace(Copied):
    """The leader's clock along a reference: time drives it, and resistance of the partner slows it down.

    It is entered anywhere, from rest: at the nearest phase, where the hand is. What the hand is off the path there fades along
    the way, no faster than was taught; nothing pulls it back to where it should have been.

    phase, rate       [s], 1: where in the reference, and how fast the clock runs
    expected          (d,) [N] F_r, what the lessons lead to expect here
    velocity          (d,) [m/s] s' (v_r + offset that fades) + lambda (x_r + offset - x)
    """

    def __init__(self, references: PhaseReference | Sequence[PhaseReference], law: CollaborativeLaw, dt: float) -> None:
        self.references = (references,) if isinstance(references, PhaseReference) else tuple(references)
        self.law, self._dt = law, dt
        d = self.references[0].position.shape[1]
        self.memory = np.zeros(3 * d + 10)
        self.expected, self.velocity, self._offset = self.memory[:-10].reshape(3, d)
        self.clock = self.memory[-10:]

    def start(self, phase: float, position: Array, *, goal: int = 0, waits_s: float = 0.0, eases: bool = True) -> None:
        """At `position` (d,); in `waits_s` [s] it goes on from `phase` [s] of the reference to `goal`; from rest it eases in."""
        reference = self.references[goal]
        offset = position - reference.at(reference.position, phase)
        off = length(offset.tolist())
        fading_s = max(FADES_S, 1.875 * off / (FADES_BELOW * max(reference.top_speed, 1e-9))) if off > 0.0 else 0.0
        self.memory[:] = 0.0
        self._offset[:] = offset
        easing_s = 0.0 if not eases else EASES_S if phase > 0.0 else BEGINS_S
        self.clock[:] = phase, 1.0 if waits_s > 0.0 else 0.0, 0.0, waits_s, 0.0, fading_s, 0.0, easing_s, goal, 0.0

    @property
    def reference(self) -> PhaseReference:
        return self.references[int(self.clock[GOAL])]

    @property
    def phase(self) -> float:
        return float(self.clock[PHASE_S])

    @property
    def rate(self) -> float:
        return float(self.clock[RATE])

    @property
    def going(self) -> float:
        """How fast the reference moves by itself [m/s], without what pulls to it."""
        return float(self.clock[GOING])

    @property
    def ended(self) -> bool:
        return self.phase >= self.reference.duration_s

    @property
    def off_m(self) -> float:
        """How far from the path it still leads [m]."""
        faded, fading_s = float(self.clock[FADED]), float(self.clock[FADING_S])
        return _left(faded / fading_s) * length(self._offset.tolist()) if faded < fading_s else 0.0

    def step(self, x: Array, force: Array) -> None:
        law, reference = self.law, self.reference
        s, rate, resistance, waits_s, faded, fading_s, led_s, easing_s, goal, _ = self.clock.tolist()
        begun = waits_s <= 0.0
        on_path, fades = begun and s < reference.duration_s, begun and faded < fading_s
        left = _left(faded / fading_s) if faded < fading_s else 0.0
        fading = _leaving(faded / fading_s) / fading_s if fades else 0.0
        off = self._offset.tolist()
        target = [p + left * o for p, o in zip(reference.floats_at("position", s), off, strict=True)]
        velocity = reference.floats_at("velocity", s) if on_path else [0.0] * len(target)
        velocity = [v + fading * o for v, o in zip(velocity, off, strict=True)]
        speed = length(velocity)
        along = dot(force.tolist(), velocity) / speed if speed > 1e-6 else 0.0
        excess = min(along + law.comfortable_n, 0.0)
        resistance += min(self._dt / law.patience_s, 1.0) * (excess - resistance)
        slowest = max(law.slowest_clock, self._in_time(s, faded, led_s))
        rate = max(1.0 + law.yield_gain_per_n * resistance, slowest) if on_path or fades else 1.0
        if led_s < easing_s:
            ease = led_s / easing_s
            rate *= ease * ease * (3.0 - 2.0 * ease)
        if speed > reference.top_speed:
            rate *= reference.top_speed / speed
        gain = reference.gain_at(s)
        error = [t - p for t, p in zip(target, x.tolist(), strict=True)]
        # a person's resistance grows with speed, so at a slower pace less of it is to be expected
        felt = reference.floats_at("force", s) if begun else [0.0] * len(target)
        on = self._dt * rate if begun else 0.0
        s, faded, led_s = min(s + on, reference.duration_s), faded + on, led_s + (self._dt if begun else 0.0)
        waits_s = max(waits_s - self._dt, 0.0)
        self.clock[:] = s, rate, resistance, waits_s, faded, fading_s, led_s, easing_s, goal, rate * speed
        pulls = law.attraction_per_s * gain
        share = self._bound(error, pulls)
        for i, v in enumerate(velocity):
            self.expected[i] = rate * felt[i]
            self.velocity[i] = rate * v + pulls * (error[i] * share)

    def _in_time(self, s: float, gone: float, led_s: float) -> float:
        """The clock that, kept from here on, ends the motion `LATEST` times as late as taught; kept from the start it stays."""
        left = self.reference.duration_s - s
        left_s = LATEST * (left + gone) - led_s
        return min(left / left_s, 1.0) if left_s > left else 1.0

    def _bound(self, error: list[float], pulls: float) -> float:
        """The attractor never asks for more than the taught top speed, however far away it starts."""
        asked = length(error) * pulls
        return min(1.0, self.reference.top_speed / asked) if asked > 1e-9 else 1.0


def _left(u: float) -> float:
    """What is left of an offset at `u` of its fading, in [0, 1]: minimum jerk."""
    return 1.0 - u * u * u * (10.0 + u * (-15.0 + 6.0 * u))


def _leaving(u: float) -> float:
    """Its derivative."""
    return -(u * u * (30.0 + u * (-60.0 + 30.0 * u)))


class Watch:
    """Eq. (4) from position and force on the model's own clock: which state of the task this is. `weights` (K,)."""

    def __init__(self, model: Hmm, model_dt: float, dt: float) -> None:
        groups = [g for g in ("position", "force") if any(c.startswith(g + ".") for c in model.channels)]
        self.filter = ForwardFilter(model, groups)
        self._dt, self.model_dt = dt, model_dt
        self.weights = self.filter.weights
        self.seen, self.until = np.zeros(len(self.filter.channels)), np.zeros(1)

    def reset(self) -> None:
        self.filter.reset()
        self.until[0] = 0.0

    def step(self, x: Array, force: Array) -> None:
        while self.until[0] <= 1e-9:
            self.until[0] += self.model_dt
            self.seen[: len(x)] = x
            if len(self.seen) > len(x):
                self.seen[len(x) :] = force
            self.filter.step(self.seen)
        self.until[0] -= self._dt


class CollaborativeSkill(Copied):
    """Carries an object with a partner, as leader or as follower, from what lessons of that role taught.

    goal   number of the reference that leads; None, which one the partner means is inferred (a leader takes the first)

    Diagnostics: weights (K,) of the model's states from position and force, phase [s], clock speed, expected force, compliance
    velocity; goal (G,), where lessons had several, the probability of each. `notice` says when it does less than asked ("outside
    what was taught: complies only") or begins off the path.
    """

    stop_reason = ""
    ANEW = ("_compiled", "_tick")

    def __init__(
        self,
        model: Hmm,
        references: PhaseReference | Sequence[PhaseReference] | None,
        *,
        role: str,
        axes: tuple[str, ...],
        dt: float,
        model_dt: float,
        law: CollaborativeLaw | None = None,
        goal: int | None = None,
    ) -> None:
        if role not in ROLES:
            raise MismatchError(
                f"the default law needs a role, leader or follower; the skill states {role or 'none'!r}: state it with role="
            )
        if references is None:
            raise MismatchError("the default law needs a path in order of time: learn with topology left-right")
        self.role, self.law, self._told = role, law or CollaborativeLaw.for_role(role), goal
        self.axes, self.dt, self._dt, d = tuple(axes), dt, dt, len(axes)
        self._pace = Pace(references, self.law, dt)
        self._watch = Watch(model, model_dt, dt)
        self._where = Whereabouts(self._pace.references, dt)
        self._nothing, self._foreseen = np.zeros(d), np.zeros(d)
        self._nothing.setflags(write=False)
        self._compliance = Compliance(d, dt)
        self._foresight = Foresight(dt, d, self._pace.references)
        self._memory = memory(d)
        self._expected, self._velocity, self._position, self._start, *_, self.taught = self._memory[: 8 * d].reshape(8, d)
        self._phase, self._rate, *_ = self._memory[8 * d :].reshape(7, 1)
        self._complies_only, self._outside, self._begun = False, 0.0, False
        self.leading = np.zeros(1)  # for the envelope: 1 while it goes by itself
        self._link()

    def _link(self) -> None:
        self._compiled = compiled(
            self._watch, self._pace, self._compliance, self._where, self._memory, self._dt, foresight=self._foresight
        )
        self._tick: Callable[..., bool] | None = None
        self._choose()

    def _choose(self) -> None:
        """The compiled tick of what it does since it began."""
        if self._compiled is not None and self._begun:
            how = "comply" if self._complies_only else "lead" if self.role == "leader" else "follow"
            self._tick = getattr(self._compiled, how)

    @property
    def reference(self) -> PhaseReference:
        """The path of the goal that it leads to, or takes the partner to mean."""
        return self._pace.references[self._where.goal if self.role == "follower" else int(self._pace.clock[GOAL])]

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {
            "weights": self._watch.weights,
            "phase": self._phase,
            "clock_rate": self._rate,
            "expected_force": self._expected,
            "compliance": self._compliance.velocity,
            **goals_shown(self._where),
        }

    @property
    def notice(self) -> str:
        return off_path(self._outside, self._complies_only, self.role == "leader" and self._pace.off_m > SAID_M)

    def reset(self, obs: Observation) -> None:
        self._enter(obs, None)

    def resume(self, obs: Observation) -> None:
        """As `reset`, from rest where the hand is, but in the part of the task in which it was."""
        self._enter(obs, self._phase[0])

    def _enter(self, obs: Observation, last_s: float | None) -> None:
        goal = self._where.goal if last_s is not None else self._told or 0
        self._watch.reset()
        position = believable(obs.position)
        if self._compiled is not None:
            self._outside = self._compiled.enter(position, goal, nan if last_s is None else last_s)
        else:
            self._outside = self._from_rest(position, goal, last_s)
        self._complies_only = bool(self._outside > self.law.reach_m)
        self.leading[0] = float(self.role == "leader" and not self._complies_only)
        self._begun = True
        self._choose()

    def _from_rest(self, position: Array, goal: int, last_s: float | None) -> float:
        """At `position` on the way to `goal`; how far outside of what was taught that is [m]."""
        self._memory[:] = 0.0
        self._position[:] = self._start[:] = position
        self._compliance.reset()
        entry_s = [r.entry(position, last_s) for r in self._pace.references]
        self._foresight.reset(position.tolist(), begins=entry_s[goal] <= 0.0)
        self._where.reset(position, goal, entry_s)
        self._pace.start(entry_s[goal], position, goal=goal, waits_s=self.law.start_delay_s)
        self._phase[0] = entry_s[goal]
        return min(r.outside_m(position) for r in self._pace.references)

    def step(self, obs: Observation, command: Command) -> None:
        tick = self._tick
        if tick is None or not tick(obs.position, obs.force, command.position, command.velocity, command.acceleration):
            self._step(obs, command)

    def _foresees(self, obs: Observation) -> None:
        """Whether the partner goes as foreseen; what is missing says nothing of that."""
        if self.role != "follower" or self._complies_only or self.law.foresight <= 0.0:
            return
        if _finite(obs.position) and _finite(obs.force):
            velocity, force = self._compliance.velocity.tolist(), obs.force.tolist()
            self._foresight.hears(obs.position.tolist(), velocity, force, self.reference, self._where.phase)

    def _step(self, obs: Observation, command: Command) -> None:
        """The tick to read; the compiled one leaves it what is missing."""
        self._foresees(obs)
        x = obs.position if _finite(obs.position) else np.where(np.isfinite(obs.position), obs.position, self._position)
        # a missing force is taken as none: the compliance then only dies away
        force = obs.force if _finite(obs.force) else np.where(np.isfinite(obs.force), obs.force, 0.0)
        self._position[:] = x
        self._watch.step(x, obs.force)
        going, astray = None, 0.0
        if self._complies_only:
            feedforward, reference = self._nothing, self._nothing
        elif self.role == "leader":
            feedforward, reference = self._nothing, self._lead(x, force)
            going = self._pace.going
        else:
            feedforward, reference = self._anticipate(x, force), self._nothing
            astray = untaught(self._compliance.velocity, self.taught)
        departs = self._foresight.departs * self.law.moving_speed_m_per_s
        self._compliance.step(self.law, force - self._expected, reference, feedforward, departs, going, astray)
        command_velocity(self.law, self._dt, x, reference + self._compliance.velocity, self._velocity, command)

    def _lead(self, x: Array, force: Array) -> Array:
        pace = self._pace
        pace.step(x, force)
        self._phase[0], self._rate[0] = pace.phase, pace.rate
        self._expected[:] = pace.expected
        self.taught[:] = pace.velocity
        return pace.velocity

    def _anticipate(self, x: Array, force: Array) -> Array:
        """Acceleration to expect next: the taught change of speed ahead, scaled to the partner's present speed."""
        law, velocity = self.law, self._compliance.velocity.tolist()
        self._where.step(x.tolist(), velocity)
        reference, s = self._pace.references[self._where.goal], self._where.phase
        self._rate[0] = (s - float(self._phase[0])) / self._dt
        self._phase[0] = s
        self.taught[:] = reference.that_way(x, self._compliance.velocity)
        if self._foresight.awake:
            self._foresight.step(x.tolist(), velocity)
        if self._foresight.awake:
            self._foreseen[:] = self._foresight.foreseen(law, force.tolist())
        else:
            self._foreseen[:] = anticipated(law, reference, s, velocity, force.tolist())
        return self._foreseen


def believable(position: Array) -> Array:
    """Where the hand begins: a missing coordinate is 0, and none is so large that its square is no number."""
    return np.clip(np.nan_to_num(position), -ABSURD, ABSURD)


def goals_shown(where: Whereabouts) -> Mapping[str, Array]:
    """The probability of each goal, where there are several."""
    return {"goal": where.goals} if len(where.goals) > 1 else {}


def off_path(outside_m: float, complies_only: bool, moves_over: bool) -> str:
    """What there is to say about a start beside the path."""
    if complies_only:
        return f"outside what was taught by {outside_m:.2f} m: complies only"
    return f"outside what was taught by {outside_m:.2f} m: moves over to it" if moves_over else ""


def memory(n_axes: int) -> Array:
    """What a skill of this law remembers, as kernels/_law.h shares it: eight vectors and seven numbers.

    Expected force, commanded velocity, position, start and, where roles change, reference, pull, bias; how fast lessons went that
    way; then phase and clock rate; and where roles change for how long it has rested [s], whether anybody has moved, for how long
    the partner has spoken against being led and has held it [s], and the goal that it was told, negative for none.
    """
    return np.zeros(8 * n_axes + 7)


def compiled(
    watch: Watch,
    pace: Pace,
    compliance: Compliance,
    where: Whereabouts,
    memory: Array,
    dt: float,
    *,
    following: CollaborativeLaw | None = None,
    policy: Sequence[float] = (0.0,) * len(layouts.BLOCKS["policy"]),
    pull_s: float = 1.0,
    bias_s: float = 1.0,
    bank: Any = None,
    foresight: Foresight | None = None,
    role: Array | None = None,
) -> Any:
    """The tick of a skill made of these parts, in C and over their arrays; None where nothing could be compiled.

    following, policy, pull_s, bias_s, bank, role   of a skill that changes its role, see `skills.roles`
    """
    d = len(pace.expected)
    if watch.filter.compiled is None or d > MOST_AXES or len(watch.seen) not in (d, 2 * d):
        return None

    def by_name(law: CollaborativeLaw) -> Array:
        return layouts.packed("law", asdict(law))

    return kernels.native.Law(
        watch.filter.compiled, by_name(pace.law), by_name(following or pace.law), np.array(policy),
        tables_of(pace.references), compliance.memory, pace.memory, memory, watch.until, watch.seen,
        (where.stations, where.firsts, where.memory, where.goals), d, dt, watch.model_dt, pull_s, bias_s, bank,
        foresight and foresight.shared(), role,
    )  # fmt: skip


def tables_of(references: Sequence[PhaseReference]) -> tuple[Array, ...]:
    """Rows of all goals' position, velocity, force, way and gain, and of each goal what else kernels/_path.h knows of it."""
    tables = tuple(
        np.concatenate([getattr(r, name) for r in references]) for name in ("position", "velocity", "force", "way", "gain")
    )
    goals = [(len(r.way), r.step_s, r.top_speed, r.slack_m, r.place_m, r.extent_m, r.begins_m) for r in references]
    return *tables, np.array(goals)


def _finite(values: Array) -> bool:
    return all(map(isfinite, values.tolist()))
