"""The default law: one law for both roles, a reference that was learned, compliance around the force that was learned.

    M dc/dt = dz(F - F_r) - D c + M a_ff      compliance: a mass-damper around the EXPECTED force
    v       = s' v_r(s) + lambda (x_r(s) - x) + c

Leader and follower differ in who drives the phase s of the reference (x_r, v_r, F_r):

leader    time drives s, and resistance beyond what was taught slows it down; the partner can always push the hand away from
          the reference, because the compliance c is passive (F > 0 never moves the hand down)
follower  evidence drives s: where the hand is. The reference contributes no motion of its own, only what reflexes cannot
          know: a_ff, how speed will change next if the partner goes on as taught, as long as the force agrees

Why not eq. (5) alone: in a leader's lessons force is the EFFECT of motion, and regressing velocity on it closes a positive
feedback through the partner; see docs/laws.md. At rest the damping rises and a dead zone opens, so noise moves nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from math import copysign, exp, isfinite, pi
from typing import Any

import numpy as np

from .. import kernels
from ..errors import MismatchError, ParameterError
from ..interfaces import Array, Command, Observation
from ..models.filtering import ForwardFilter
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..signals.vectors import dot, length
from .reference import PhaseReference

ROLES = ("leader", "follower")


@dataclass(frozen=True)
class CollaborativeLaw:
    """Numbers of the law. Defaults were chosen on partners drawn for tuning, never on those that results are reported on."""

    virtual_mass_kg: float = 3.0
    moving_damping_ns_per_m: float = 3.0
    resting_damping_ns_per_m: float = 80.0
    moving_speed_m_per_s: float = 0.05  # from here on the hand counts as fully in motion
    dead_zone_n: float = 0.4  # at rest only
    anticipation: float = 0.3  # share of the foreseen acceleration that the follower adds by itself
    anticipation_s: float = 0.05
    attraction_per_s: float = 2.0  # lambda, leader
    start_delay_s: float = 0.5  # leader: stands still this long before it starts
    comfortable_n: float = 0.5  # leader: resistance of the partner from which it slows its clock
    yield_gain_per_n: float = 0.4
    slowest_clock: float = 0.4
    patience_s: float = 0.6  # how long resistance must last to count
    reach_m: float = 0.10  # starts farther than this outside the taught positions: comply only
    max_acceleration_m_per_s2: float = 5.0
    shake_hz: float = 2.5  # faster than people move a load together: what oscillates above is instability or shaking
    shake_n: float = 1.0  # amplitude from which it is damped
    shake_damping_ns_per_m_per_n: float = 20.0
    shake_memory_s: float = 3.0  # what goes on oscillating is damped more and more, and as slowly less
    shake_growth_per_s: float = 0.3
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
            law = replace(law, virtual_mass_kg=6.0, moving_damping_ns_per_m=30.0, dead_zone_n=0.5)
        return replace(law, **settings)


class Compliance:
    """The mass-damper c of the law, in d axes; `velocity` (d,) [m/s] is rewritten by `step`.

    Here and below a tick is written in plain floats: on one to three axes numpy's calls cost five times the arithmetic. What is
    remembered lies in `memory`, which kernels/_law.h shares: there the same tick is written once more, for speed.
    """

    def __init__(self, n_axes: int, dt: float) -> None:
        self._dt = dt
        self.memory = np.zeros(2 * n_axes + 2)
        self.velocity, self._slow = self.memory[:-2].reshape(2, n_axes)
        self._shaking = self.memory[-2:]  # its mean size, and how long it has gone on

    def reset(self) -> None:
        self.memory[:] = 0.0

    def step(self, law: CollaborativeLaw, excess: Array, reference: Array, feedforward: Array) -> None:
        """Damping is implicit, so any value is stable by itself at any dt."""
        c, off = self.velocity.tolist(), excess.tolist()
        speed = max(_largest(c), _largest(reference.tolist()))
        rest = 1.0 - min(speed / law.moving_speed_m_per_s, 1.0)
        damping = law.moving_damping_ns_per_m + rest * rest * (law.resting_damping_ns_per_m - law.moving_damping_ns_per_m)
        damping += self._against_shaking(law, off)
        dead = law.dead_zone_n * rest
        share = self._dt / law.virtual_mass_kg
        for i, (f, a) in enumerate(zip(off, feedforward.tolist(), strict=True)):
            push = copysign(max(abs(f) - dead, 0.0), f)
            self.velocity[i] = (c[i] + share * push + self._dt * a) / (1.0 + share * damping)

    def _against_shaking(self, law: CollaborativeLaw, excess: list[float]) -> float:
        """Damping [N s/m] to add while force oscillates faster than people lift together.

        Around a partner of stiffness K and damping B, a delay tau takes tau K from the loop's damping, whatever the virtual mass:
        stable if B + D > tau K. So a stiff partner needs D, and only he does.
        """
        keep = 1.0 - exp(-2.0 * pi * law.shake_hz * self._dt)
        slow = [slow + keep * (f - slow) for f, slow in zip(excess, self._slow.tolist(), strict=True)]
        fast = _largest([f - s for f, s in zip(excess, slow, strict=True)])
        shake, went_on = self._shaking.tolist()
        shake += min(self._dt / 0.3, 1.0) * (fast - shake)
        amplitude = max(1.57 * shake - law.shake_n, 0.0)  # mean |sin| = amplitude / 1.57
        went_on += self._dt * (law.shake_growth_per_s * amplitude - went_on / law.shake_memory_s)
        self._slow[:], self._shaking[:] = slow, (shake, went_on)
        return law.shake_damping_ns_per_m_per_n * (amplitude + went_on)


class Pace:
    """The leader's clock along a reference: time drives it, and resistance of the partner slows it down.

    phase, rate       [s], 1: where in the reference, and how fast the clock runs
    expected          (d,) [N] F_r, what the lessons lead to expect here
    velocity          (d,) [m/s] s' v_r + lambda (x_r - x)
    """

    def __init__(self, reference: PhaseReference, law: CollaborativeLaw, dt: float) -> None:
        self.reference, self.law, self._dt = reference, law, dt
        d = reference.position.shape[1]
        self.top_speed = float(np.linalg.norm(reference.velocity, axis=1).max())
        self.memory = np.zeros(3 * d + 3)
        self.expected, self.velocity, self._start = self.memory[:-3].reshape(3, d)
        self.clock = self.memory[-3:]  # phase, rate, resistance

    def start(self, phase: float, position: Array) -> None:
        """From `phase` [s] on; before 0 the hand stays at `position` (d,)."""
        self.memory[:] = 0.0
        self.clock[0] = phase
        self._start[:] = position

    @property
    def phase(self) -> float:
        return float(self.clock[0])

    @property
    def rate(self) -> float:
        return float(self.clock[1])

    @property
    def ended(self) -> bool:
        return self.phase >= self.reference.duration_s

    def step(self, x: Array, force: Array) -> None:
        law, reference, (s, rate, resistance) = self.law, self.reference, self.clock.tolist()
        moving = 0.0 <= s < reference.duration_s
        target = reference.floats_at("position", s) if s >= 0.0 else self._start.tolist()
        velocity = reference.floats_at("velocity", s) if moving else [0.0] * len(target)
        speed = length(velocity)
        along = dot(force.tolist(), velocity) / speed if speed > 1e-6 else 0.0
        excess = min(along + law.comfortable_n, 0.0)
        resistance += min(self._dt / law.patience_s, 1.0) * (excess - resistance)
        rate = max(1.0 + law.yield_gain_per_n * resistance, law.slowest_clock) if moving else 1.0
        # a person's resistance grows with speed, so at a slower pace less of it is to be expected
        felt = reference.floats_at("force", s) if s >= 0.0 else [0.0] * len(target)
        self.clock[:] = min(s + self._dt * rate, reference.duration_s), rate, resistance
        error = [t - p for t, p in zip(target, x.tolist(), strict=True)]
        share = self._bound(error)
        for i, v in enumerate(velocity):
            self.expected[i] = rate * felt[i]
            self.velocity[i] = rate * v + law.attraction_per_s * (error[i] * share)

    def _bound(self, error: list[float]) -> float:
        """The attractor never asks for more than the taught top speed, however far away it starts."""
        asked = length(error) * self.law.attraction_per_s
        return min(1.0, self.top_speed / asked) if asked > 1e-9 else 1.0


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


class CollaborativeSkill:
    """Carries an object with a partner, as leader or as follower, from what lessons of that role taught.

    Diagnostics: weights (K,) of the model's states from position and force, phase [s], clock speed, expected force, compliance
    velocity. `notice` says when it does less than asked ("outside what was taught: complies only").
    """

    stop_reason = ""

    def __init__(
        self,
        model: Hmm,
        clock: Gmm | None,
        *,
        role: str,
        axes: tuple[str, ...],
        dt: float,
        model_dt: float,
        law: CollaborativeLaw | None = None,
        end: Array | None = None,
        reference: PhaseReference | None = None,
    ) -> None:
        if role not in ROLES:
            raise MismatchError(
                f"the default law needs a role, leader or follower; the skill states {role or 'none'!r}: pass --role"
            )
        if clock is None:
            raise MismatchError("the default law needs states in order of time: learn with topology left-right")
        self.role, self.law = role, law or CollaborativeLaw.for_role(role)
        self.reference = reference or PhaseReference.learned(clock, end)
        self._dt, d = dt, len(axes)
        self._watch = Watch(model, model_dt, dt)
        self._nothing, self._foreseen = np.zeros(d), np.zeros(d)
        self._nothing.setflags(write=False)
        self._compliance = Compliance(d, dt)
        self._pace = Pace(self.reference, self.law, dt)
        self._memory = memory(d)
        self._expected, self._velocity, self._position, self._start, *_ = self._memory[: 7 * d].reshape(7, d)
        self._phase, self._rate, *_ = self._memory[7 * d :].reshape(6, 1)
        self._compiled = compiled(self._watch, self._pace, self._compliance, self._memory, dt)
        self._tick: Callable[..., bool] | None = None

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {
            "weights": self._watch.weights,
            "phase": self._phase,
            "clock_rate": self._rate,
            "expected_force": self._expected,
            "compliance": self._compliance.velocity,
        }

    def reset(self, obs: Observation) -> None:
        self._watch.reset()
        self._memory[:] = 0.0
        self._position[:] = self._start[:] = np.nan_to_num(obs.position)
        self._compliance.reset()
        self._phase[0] = -self.law.start_delay_s if self.role == "leader" else 0.0
        self._pace.start(float(self._phase[0]), self._position)
        outside = outside_taught(self.reference, self._position)
        self._complies_only = bool(outside > self.law.reach_m)
        self.notice = f"outside what was taught by {outside:.2f} m: complies only" if self._complies_only else ""
        if self._compiled is not None:
            how = "comply" if self._complies_only else "lead" if self.role == "leader" else "follow"
            self._tick = getattr(self._compiled, how)

    def step(self, obs: Observation, command: Command) -> None:
        tick = self._tick
        if tick is None or not tick(obs.position, obs.force, command.position, command.velocity, command.acceleration):
            self._step(obs, command)

    def _step(self, obs: Observation, command: Command) -> None:
        """The tick to read; the compiled one leaves it what is missing."""
        x = obs.position if _finite(obs.position) else np.where(np.isfinite(obs.position), obs.position, self._position)
        # a missing force is taken as none: the compliance then only dies away
        force = obs.force if _finite(obs.force) else np.where(np.isfinite(obs.force), obs.force, 0.0)
        self._position[:] = x
        self._watch.step(x, obs.force)
        if self._complies_only:
            feedforward, reference = self._nothing, self._nothing
        elif self.role == "leader":
            feedforward, reference = self._nothing, self._lead(x, force)
        else:
            feedforward, reference = self._anticipate(x, force), self._nothing
        self._compliance.step(self.law, force - self._expected, reference, feedforward)
        command_velocity(self.law, self._dt, x, reference + self._compliance.velocity, self._velocity, command)

    def _lead(self, x: Array, force: Array) -> Array:
        pace = self._pace
        pace.step(x, force)
        self._phase[0], self._rate[0] = pace.phase, pace.rate
        self._expected[:] = pace.expected
        return pace.velocity

    def _anticipate(self, x: Array, force: Array) -> Array:
        """Acceleration to expect next: the taught change of speed ahead, scaled to the partner's present speed."""
        law, reference, velocity = self.law, self.reference, self._compliance.velocity.tolist()
        taught = x - self._start + reference.position[0]
        s = reference.closest(taught, float(self._phase[0]))
        self._rate[0] = (s - float(self._phase[0])) / self._dt
        self._phase[0] = s
        speed = length(velocity)
        if speed < 0.02:
            return self._nothing
        now = reference.floats_at("velocity", s)
        usual = max(length(now), 0.03)
        ahead = reference.floats_at("velocity", s + law.anticipation_s * min(speed / usual, 2.0))
        along = dot(force.tolist(), [v / speed for v in velocity])
        agreement = min(max((along + 1.0) / 2.0, 0.0), 1.0)  # a partner who brakes switches it off
        agreement *= min(speed / law.moving_speed_m_per_s, 1.0)
        scale = min(speed / usual, 1.5)
        for i, (a, n) in enumerate(zip(ahead, now, strict=True)):
            self._foreseen[i] = law.anticipation * agreement * min(max((a - n) / law.anticipation_s * scale, -1.0), 1.0)
        return self._foreseen


def memory(n_axes: int) -> Array:
    """What a skill of this law remembers, as kernels/_law.h shares it: seven vectors and six numbers.

    Expected force, commanded velocity, position, start; where roles change reference, pull, bias; then phase and clock rate; and
    where roles change for how long it has rested [s], whether anybody has moved, and for how long the partner has spoken against
    being led and has held it [s].
    """
    return np.zeros(7 * n_axes + 6)


def compiled(
    watch: Watch,
    pace: Pace,
    compliance: Compliance,
    memory: Array,
    dt: float,
    *,
    following: CollaborativeLaw | None = None,
    policy: Sequence[float] = (0.0,) * 11,
    task: Array | None = None,
    pull_s: float = 1.0,
    bias_s: float = 1.0,
    bank: Any = None,
) -> Any:
    """The tick of a skill made of these parts, in C and over their arrays; None where nothing could be compiled.

    following, policy, task, pull_s, bias_s, bank   of a skill that changes its role, see `skills.roles`
    """
    d, table = pace.reference.position.shape[1], pace.reference
    if watch.filter.compiled is None or d > 6 or len(watch.seen) not in (d, 2 * d):
        return None
    return kernels.native.Law(
        watch.filter.compiled, np.array(astuple(pace.law)), np.array(astuple(following or pace.law)), np.array(policy),
        np.zeros(2 * d) if task is None else task,
        table.position, table.velocity, table.force, compliance.memory, pace.memory, memory, watch.until, watch.seen,
        d, dt, watch.model_dt, table.step_s, pace.top_speed, pull_s, bias_s, bank,
    )  # fmt: skip


def outside_taught(reference: PhaseReference, position: Array) -> float:
    """How far `position` (d,) lies outside the box of the reference's positions [m]; negative inside."""
    low, high = reference.position.min(axis=0), reference.position.max(axis=0)
    return float(np.maximum(low - position, position - high).max())


def command_velocity(law: CollaborativeLaw, dt: float, x: Array, wanted: Array, velocity: Array, command: Command) -> None:
    """Moves `velocity` (d,) toward `wanted` no faster than the law's acceleration, and fills `command` from it."""
    limit = law.max_acceleration_m_per_s2 * dt
    for i, (p, w, v) in enumerate(zip(x.tolist(), wanted.tolist(), velocity.tolist(), strict=True)):
        change = min(max(w - v, -limit), limit)
        v += change
        velocity[i] = v
        command.velocity[i] = v + law.lead_s / dt * change
        command.position[i] = p + dt * v
        command.acceleration[i] = change / dt


def _largest(values: list[float]) -> float:
    return max(map(abs, values))


def _finite(values: Array) -> bool:
    return all(map(isfinite, values.tolist()))
