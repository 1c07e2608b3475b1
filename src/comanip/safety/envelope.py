"""The safety envelope: a skill around a skill, which lets a command pass unchanged or makes it safer.

    clock -> sensors -> ledger (commanded position, energy) -> skill -> RUN | COMPLY | HOLD -> clip -> checker

One rule for walls and energy, per axis: never move at a speed from which you cannot brake inside what is left.

    cap(d) = max(0, sqrt(2 a d) - a T / 2)      d metres left, T the longest period allowed
    E_k    = min(E_max, E_(k-1) + F_k v_(k-1) e)   energy tank, e <= T the measured period; E / F_lim metres left in it
    v_k    = clip(clip(wanted, -down, up), v_(k-1) - a e, v_(k-1) + a e)

RUN      the skill's command
COMPLY   v = F / b, dissipative: on doubt about the situation (fades back), when blocked or let go (until re-armed); the harder
         it is shaken, the larger b
HOLD     brakes at a_max to 0 and stays stiff; the first reason is kept until the user re-arms

Good engineering, not a certified safety function; what it promises and what not: docs/safety.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import copysign, inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Skill
from ..signals.vectors import dot, length
from .checker import Checker
from .compiled_tick import LENT, MOST_AXES, Ordinary
from .detectors import Jump, LetGo, Shaking

RUN, COMPLY, HOLD = 0, 1, 2
NAMES = ("RUN", "COMPLY", "HOLD")
GONE = "let go: the hand carries the whole object"
ABSURD = 1e6  # no sensor of a robot says such a number, in any unit


@dataclass(frozen=True)
class Limits:
    """Numbers of the envelope, each per axis. Defaults leave the default law's runs with living partners unchanged."""

    v_max_m_per_s: float = 0.8
    a_max_m_per_s2: float = 10.0
    force_limit_n: float = 60.0
    workspace_m: tuple[tuple[float, float], ...] | None = None  # (lowest, highest) of each axis; None: no walls
    energy_j: float = 3.0  # E_0 = E_max: what the robot may give in one task; only the person or re-arming refills it
    comply_damping_ns_per_m: float = 150.0  # more than 50 ms of delay times the 2.4 kN/m of wall, object and wrist
    fade_s: float = 0.5  # from COMPLY back to RUN; the other way is at once
    late_s: float | None = None  # T, longest period allowed; None: 3 periods, at least 30 ms
    stale_s: float | None = None  # age of a sample to coast on; None: 5 periods, at least 50 ms
    stuck_s: float = 0.2  # the same force reading, bit by bit, while moving
    moving_m_per_s: float = 0.01
    position_jump_m: float = 0.02  # beyond what 2 v_max explains
    drift_m: float = 0.05  # between where the hand was sent and where it is
    rest_m_per_s: float = 0.02  # measured speed up to which re-arming counts as at rest
    blocked_n: float = 20.0  # against the motion
    blocked_s: float = 0.03  # sooner by as much as it is more: a hand at 0.5 m/s presses 12 N more into a wall with every 10 ms
    impact_s: float = 0.2  # so long after, the force may pass its limit while it gives way: a HOLD would keep pressing
    impact_n: float = 180.0
    alone_n: float = 2.2  # within this of carrying the whole object alone, the partner's end is free
    alone_s: float = 0.15
    sudden_s: float = 0.15  # within this his pull is gone: who pulls down harder and harder has not let go
    steady_n_s: float = 45.0  # and nothing answers the hand's motion, as a wall does, against which the hand stands:
    stands_m_per_s: float = 0.06
    feel_s: float = 0.25  # a hand that stands gives way so long first: a wall lets it, and is then no more felt
    let_go_n: float = 0.3  # less than this is nobody, where the object weighs nothing along the axes
    let_go_s: float = 0.4
    held_n: float = 2.0  # more than this, in this motion, was somebody
    let_go_m_per_s: float = 0.08
    shake_n: float = 6.0  # amplitude above 1 Hz from which shaking is said
    tare_n: float = 1.5  # mean force at rest from which tare is doubted
    jump_n: float = 0.8  # and 6 times the usual change: from one sample to the next, at rest for `jump_rest_s`, and
    jump_rest_s: float = 0.3
    jump_stays_s: float = 0.05  # still there so long after

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name == "workspace_m":
                if value is not None:
                    walls = tuple((float(low), float(high)) for low, high in value)
                    object.__setattr__(self, name, walls)
                    if not all(low < high and isfinite(high - low) for low, high in walls):
                        raise ParameterError(f"workspace_m needs lowest < highest on each axis; got {walls}")
            elif value is not None and not (value > 0 and isfinite(value)):
                raise ParameterError(f"{name} must be positive and finite; got {value}")


class Envelope:
    """Wraps `skill`; has its socket. `rearm` is for the user alone.

    tells     optional confidence in [0, 1] that the observation is like what was taught: below 1 the command fades to COMPLY
    timer     optional seconds, for example time.perf_counter: a skill that takes longer than a period is a fault. Without it
              such a skill is noticed one tick later, as a late tick, and runs replay identically

    Diagnostics: the skill's, and mode (0 RUN, 1 COMPLY, 2 HOLD), tank (d,) [J], confidence.
    """

    def __init__(
        self,
        skill: Skill,
        *,
        axes: tuple[str, ...],
        dt: float,
        limits: Limits = Limits(),
        tells: Callable[[Observation], float] | None = None,
        timer: Callable[[], float] | None = None,
    ) -> None:
        if not (dt > 0 and isfinite(dt)):
            raise ParameterError(f"control period dt must be positive and finite; got {dt}")
        self.skill, self.limits, self._dt, self._tells, self._timer = skill, limits, dt, tells, timer
        self._d = d = len(axes)
        self._late = limits.late_s or max(0.030, 3.0 * dt)
        self._stale = limits.stale_s or max(0.050, 5.0 * dt)
        if self._late < 2.0 * dt:
            raise ParameterError(f"late_s must be at least two periods, {2.0 * dt} s; got {self._late}")
        self._walls = limits.workspace_m or ((-inf, inf),) * d
        if len(self._walls) != d:
            raise ParameterError(f"workspace_m needs {d} rows for axes {axes}; got {len(self._walls)}")
        self._checker = Checker(limits.v_max_m_per_s, limits.a_max_m_per_s2, self._walls, dt)
        self._mode, self._tank, self._confidence = np.zeros(1), np.full(d, limits.energy_j), np.ones(1)
        self._inner = Command(d)
        self._frozen: dict[str, Array] | None = None
        self._ordinary: Any = None  # Ordinary, where it was compiled
        self._is_lent = False
        self._restart(0.0, [0.0] * d)
        self._fault("not started")
        if kernels.native is not None and d <= MOST_AXES:
            self._ordinary = Ordinary(self)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """What the compiled tick has borrowed comes back as soon as anybody asks."""
            if name in LENT and self._is_lent:
                self._take_back()
                return getattr(self, name)
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @property
    def mode(self) -> str:
        """ "RUN", "COMPLY" or "HOLD"."""
        return NAMES[self._state]

    @property
    def reason(self) -> str:
        """Why it is not in RUN; empty in RUN."""
        return self._reason

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        own = {"mode": self._mode, "tank": self._tank, "confidence": self._confidence}
        return {**(self.skill.diagnostics if self._frozen is None else self._frozen), **own}

    @property
    def stop_reason(self) -> str:
        return self.skill.stop_reason

    @property
    def notice(self) -> str:
        if self._state != RUN:
            return f"{self.mode}: {self._reason}"
        if self._confidence[0] < 1.0:
            return "COMPLY: unlike what was taught"
        said = [self.skill.notice, *self._flags()]
        return "; ".join(s for s in said if s)

    def _flags(self) -> list[str]:
        flags, limits = [], self.limits
        if self._shaking.amplitude > limits.shake_n:
            flags.append(f"shaking, {self._shaking.amplitude:.0f} N")
        felt = self._felt if self._rest_s > 2.0 else 0.0
        at_rest = max(felt, self._at_first, key=abs)
        if abs(at_rest) > limits.tare_n:
            flags.append(f"felt {at_rest:.1f} N at rest: wrong mass? tare")
        if min(self._energy) / limits.force_limit_n <= self.limits.a_max_m_per_s2 * self._late**2 / 8.0:
            flags.append("energy budget used up: re-arm")
        return flags

    # starting, and starting again

    def reset(self, obs: Observation) -> None:
        """As the loop's start: like re-arming, but what refuses it is a HOLD."""
        refused = self._begin(obs)
        if refused:
            self._fault(refused)

    def rearm(self, obs: Observation) -> str:
        """Runs again from where the arm is; returns why it does not (empty: it does). Only the user calls this, at rest."""
        try:
            problem = self._problem(obs)
            measured = 0.0 if problem else max(abs(v) for v in [0.0, *obs.velocity.tolist()] if v == v)
        except Exception as error:
            return f"sensors: {error!r}"
        fastest = max(abs(v) for v in self._v)
        if measured > self.limits.rest_m_per_s or fastest > (self.limits.moving_m_per_s if self._state == RUN else 0.0):
            return f"in motion: {max(measured, fastest):.2g} m/s"
        return problem or self._begin(obs)

    def change_skill(self, skill: Skill, obs: Observation) -> str:
        """Another skill from now on (roles exchanged): starts in COMPLY and fades. Returns why it did not (empty: it did)."""
        try:
            shown = {name: array for name, array in self.diagnostics.items() if name not in ("mode", "tank", "confidence")}
            skill.reset(obs)
        except Exception as error:
            return f"policy: {error!r}"
        self._take_back()
        self._frozen = {name: array.copy() for name, array in shown.items()}
        self.skill = skill
        self._confidence[0] = 0.0
        return ""

    def _begin(self, obs: Observation) -> str:
        try:
            time, position = float(obs.time), [float(x) for x in obs.position]
            problem = self._problem(obs)
        except Exception as error:
            return f"sensors: {error!r}"
        if problem:
            place = [x if abs(x) < ABSURD else 0.0 for x in (*position, *[0.0] * self._d)]
            self._restart(time if isfinite(time) else 0.0, place[: self._d])
            return problem
        self._restart(time, position)
        try:
            self.skill.reset(obs)
        except Exception as error:
            self._fault(f"policy: {error!r}")
        return self._reason

    def _restart(self, time: float, position: list[float]) -> None:
        self._take_back()
        d = self._d
        self._state, self._reason = RUN, ""
        self._time = self._stamp = time
        self._age = self._elapsed = 0.0
        self._first = True
        self._x, self._sent = list(position), list(position)
        self._at, self._v, self._force = list(position), [0.0] * d, [0.0] * d
        self._wanted, self._asked, self._period = [0.0] * d, [0.0] * d, 0.0
        self._known = True
        self._raw, self._same_s = [inf] * d, [0.0] * d
        self._energy = [self.limits.energy_j] * d
        self._blocked_ns = self._impact_s = self._alone_s = self._rest_s = self._felt = 0.0
        self._held, self._feels_s = False, 0.0
        self._ticks, self._at_first, self._rate = 0, 0.0, [0.0] * d
        limits = self.limits
        self._let_go = LetGo(
            d, self._dt, alone_n=limits.alone_n, alone_s=limits.alone_s, sudden_s=limits.sudden_s,
            steady_n_s=limits.steady_n_s, stands_m_s=limits.stands_m_per_s, least_n=limits.held_n,
        )  # fmt: skip
        self._jump = Jump(d, limits.jump_n, limits.jump_rest_s, limits.jump_stays_s)
        self._shaking = Shaking()
        self._checker.start(position)
        self._mode[0], self._confidence[0], self._tank[:] = RUN, 1.0, self.limits.energy_j

    def _problem(self, obs: Observation) -> str:
        """What is wrong with one observation by itself."""
        if not isfinite(obs.time):
            return "clock"
        d = self._d
        for name in ("position", "force", "velocity"):
            n = np.shape(getattr(obs, name))
            if n != (d,):
                return f"{name} has shape {n} instead of ({d},)"
        for i, (low, high) in enumerate(self._walls):
            x, f, v = float(obs.position[i]), float(obs.force[i]), float(obs.velocity[i])
            if not abs(x) < ABSURD:
                return "position not finite"
            if not low <= x <= high:
                return f"{max(low - x, x - high):.2g} m outside the workspace"
            if problem := self._wrong(f, v, self.limits.force_limit_n):
                return problem
        return ""

    def _wrong(self, force: float, velocity: float, limit: float) -> str:
        if not abs(force) < ABSURD:
            return "force not finite"
        if abs(force) > limit:
            return f"force {abs(force):.0f} N > {limit:g} N"
        if abs(velocity) > 10.0 * self.limits.v_max_m_per_s:  # NaN is a velocity nobody measures, and allowed
            return "velocity not plausible"
        return ""

    def _fault(self, reason: str) -> None:
        """HOLD, with the first reason."""
        if self._state != HOLD:
            self._state, self._reason = HOLD, reason

    def _comply(self, reason: str) -> None:
        if self._state == RUN:
            self._state, self._reason = COMPLY, reason

    # one tick

    def step(self, obs: Observation, command: Command) -> None:
        try:
            self._step(obs, command)
        except Exception as error:  # nothing foreseen: still brakes
            self._fault(f"envelope: {error!r}")
            self._v = [self._braked(v, self._dt) for v in self._v]
            self._checker.last = list(self._v)
            self._write(command, self._v, False)

    def _step(self, obs: Observation, command: Command) -> None:
        """An ordinary tick is compiled, but for the skill's own; where there is anything to say, it is said here."""
        ordinary, inner = self._ordinary, self._inner
        plain = self._is_lent and self._tells is None and self._timer is None
        if plain and ordinary.sense(obs.time, obs.position, obs.force, obs.velocity, obs.sensor_force):
            try:
                self.skill.step(obs, inner)
                if self._is_lent and ordinary.act(  # not lent any more: the skill has looked at its envelope
                    inner.position, inner.velocity, inner.acceleration, command.position, command.velocity, command.acceleration
                ):
                    return
                problem = self._unfit()
            except Exception as error:
                problem = repr(error)
            self._take_back()
            self._heed(problem, 1.0)
            self._send(command, self._period, True, False)
            return
        self._take_back()
        period, fresh, late = self._clock(obs)
        self._impact_s -= period
        if fresh:
            self._sense(obs, period)
        self._known = fresh and self._known
        self._book(period, late)
        if self._state == RUN and fresh:
            self._look(period)
        elif self._state == COMPLY and fresh:
            self._feel(period)
        if self._state == RUN:
            self._think(obs, period, fresh)
        self._send(command, period, fresh, late)

    def _lend(self) -> None:
        """To the compiled tick, while nothing is under way that only the Python knows."""
        if self._ordinary is None or self._state != RUN or self._frozen is not None or self._confidence[0] < 1.0:
            return
        if not self._first and self._ticks >= 5 and self._jump.last and self._jump.pending is None:
            self._ordinary.lend(self)
            self._is_lent = True

    def _take_back(self) -> None:
        if self._is_lent and self._ordinary is not None:
            self._is_lent = False
            self._ordinary.take_back(self)

    def _send(self, command: Command, period: float, fresh: bool, late: bool) -> None:
        velocity = self._clip(period)
        verdict = self._checker.judge(period, velocity, late)
        if verdict:
            self._fault(f"checker: {verdict}")
        passed = self._state == RUN and fresh and velocity == self._asked
        if period > 0.0:
            self._rate = [(new - old) / period for new, old in zip(velocity, self._v, strict=True)]
        self._v = velocity
        self._write(command, velocity, passed)
        self._lend()

    def _clock(self, obs: Observation) -> tuple[float, bool, bool]:
        """(period [s], a new sample came, the period was too long)."""
        dt, t = self._dt, float(obs.time)
        if not isfinite(t):
            self._fault("clock")
            return dt, False, False
        step = t - self._stamp
        if step < 0.0:
            self._fault("clock")
            self._time = self._stamp = t
            return dt, False, False
        if self._first:  # from rest, so nothing was under way meanwhile; the loop steps on the observation it began with
            self._first, self._elapsed = False, step
            self._time = self._stamp = t
            return dt, True, False
        if step < 0.1 * dt:  # the same sample again: coast
            self._age += dt
            self._time += dt
            if self._age > self._stale + 1e-9:
                self._fault(f"force {1000.0 * self._age:.0f} ms old")
            return dt, False, False
        period = max(t - self._time, 0.0)
        self._elapsed = step
        self._stamp, self._time, self._age = t, max(t, self._time), 0.0
        late = period > self._late + 1e-9
        if late:
            self._fault(f"late {1000.0 * period:.0f} ms")
        return period, True, late

    def _sense(self, obs: Observation, period: float) -> None:
        limits, d = self.limits, self._d
        position, force = obs.position.tolist(), obs.force.tolist()
        velocity = obs.velocity.tolist()
        raw = [f if abs(f) < ABSURD else nan for f in obs.sensor_force.tolist()]
        self._known = False
        if not len(position) == len(force) == len(velocity) == len(raw) == d:
            self._fault(f"sensors: shapes are not ({d},)")
            return
        good = True
        for i in range(d):
            x, f = position[i], force[i]
            if not abs(x) < ABSURD:
                self._fault("position not finite")
            else:
                jump = abs(x - self._at[i])
                if jump > limits.position_jump_m + 2.0 * limits.v_max_m_per_s * self._elapsed:
                    self._fault(f"position jump {jump:.2g} m")
                self._at[i] = x
            problem = self._wrong(f, velocity[i], limits.force_limit_n if self._impact_s <= 0.0 else limits.impact_n)
            if problem:
                self._fault(problem)
                good = False
            reading = raw[i] if isfinite(raw[i]) else f
            if reading == self._raw[i] and abs(self._v[i]) > limits.moving_m_per_s:
                self._same_s[i] += period
                if self._same_s[i] > limits.stuck_s + 1e-9:
                    self._fault("force stuck")
            else:
                self._same_s[i] = 0.0
            self._raw[i] = reading
        self._known = good
        if good:
            self._force = force
            at_rest = max(map(abs, self._v)) < limits.moving_m_per_s
            self._let_go.weigh(raw, force, self._rate, at_rest and max(map(abs, force)) < limits.tare_n)
            if jump := self._jump.step(raw, at_rest, period):
                self._fault(f"force jumped {jump:.1f} N at rest: sensor? tare, then re-arm")

    def _book(self, period: float, late: bool) -> None:
        """Where the last command led, and what it cost at worst."""
        limits, dt = self.limits, self._dt
        for i, v in enumerate(self._v):
            way = v * period
            if late:  # a command is valid for one period; then the low level brakes
                braking = min(period - dt, abs(v) / limits.a_max_m_per_s2)
                way = copysign(abs(v) * (dt + braking) - 0.5 * limits.a_max_m_per_s2 * braking * braking, v)
            self._x[i] += way
            gain = self._force[i] * way if self._known and not late else -limits.force_limit_n * abs(way)
            self._energy[i] = min(limits.energy_j, max(0.0, self._energy[i] + gain))
            if abs(self._x[i] - self._at[i]) > limits.drift_m and self._state != HOLD:
                self._fault(f"does not follow: {abs(self._x[i] - self._at[i]):.2g} m off")

    def _look(self, period: float) -> None:
        """Blocked, let go, shaken, wrongly tared."""
        limits = self.limits
        speed, size = length(self._v), length(self._force)
        if self._let_go.step(speed, period):
            if speed > limits.stands_m_per_s:
                self._fault(GONE)
            else:  # or it presses on a wall with just that force
                self._comply(GONE)
                self._feels_s = limits.feel_s
        against = -dot(self._force, self._v) / max(speed, 1e-6)
        self._blocked_ns = self._blocked_ns + against * period if against > limits.blocked_n else 0.0
        if self._blocked_ns > limits.blocked_n * limits.blocked_s:
            self._comply("blocked")
            self._impact_s = limits.impact_s
        if speed < limits.moving_m_per_s:
            self._held = False
        self._held = self._held or size > limits.held_n
        self._alone_s = self._alone_s + period if self._held and size < limits.let_go_n and speed > limits.let_go_m_per_s else 0.0
        if self._alone_s > limits.let_go_s:
            self._comply("let go")
        signed = max(self._force, key=abs)
        self._shaking.step(signed, period)
        if self._ticks < 5:  # before anybody can have moved; later the hand leans on the partner until F is 0 again
            self._ticks += 1
            self._at_first += (signed - self._at_first) / self._ticks
        self._rest_s = self._rest_s + period if speed < 0.05 else 0.0
        self._felt += min(period, 1.0) * (signed - self._felt)

    def _feel(self, period: float) -> None:
        """Complying; after a moment of it a wall is left behind, and an object that nobody holds is not."""
        self._shaking.step(max(self._force, key=abs), period)
        if self._feels_s <= 0.0:
            return
        self._feels_s -= period
        if self._feels_s <= 0.0 and self._let_go.nobody_pulls():
            self._fault(GONE)
        elif self._feels_s <= 0.0:
            self._reason = "blocked"

    def _think(self, obs: Observation, period: float, fresh: bool) -> None:
        """The skill's wish, faded by confidence; on an old sample the last one."""
        if not fresh:
            return
        trust = 1.0
        if self._tells is not None:
            try:
                trust = float(self._tells(obs))
            except Exception as error:
                self._fault(f"tells: {error!r}")
                return
            trust = min(max(trust, 0.0), 1.0) if isfinite(trust) else 0.0
        share = min(trust, float(self._confidence[0]) + period / self.limits.fade_s)
        self._confidence[0] = share
        started = self._timer() if self._timer is not None else 0.0
        try:
            self.skill.step(obs, self._inner)
            problem = self._unfit()
        except Exception as error:
            problem = repr(error)
        if self._timer is not None and not problem and (took := self._timer() - started) > self._dt:
            problem = f"took {1000.0 * took:.0f} ms"
        self._heed(problem, share)

    def _heed(self, problem: str, share: float) -> None:
        """What the skill commanded is wanted, unless there is a problem with it."""
        if problem:
            self._inner = Command(self._d)
            self._fault(f"policy: {problem}")
            return
        wanted = self._inner.velocity.tolist()
        if share < 1.0:
            b = self.limits.comply_damping_ns_per_m
            wanted = [share * w + (1.0 - share) * f / b for w, f in zip(wanted, self._force, strict=True)]
        self._wanted = wanted
        if self._frozen is not None:
            self._show()

    def _unfit(self) -> str:
        inner = self._inner
        for name in ("velocity", "position", "acceleration"):
            array = getattr(inner, name)
            if np.shape(array) != (self._d,):
                return f"{name} has shape {np.shape(array)} instead of ({self._d},)"
            for value in array.tolist():
                if not isfinite(value):
                    return f"{name} is {value}"
        return ""

    def _show(self) -> None:
        """Under the names and sizes that the recorder knows from the first skill."""
        assert self._frozen is not None
        new = self.skill.diagnostics
        for name, array in self._frozen.items():
            fits = name in new and new[name].shape == array.shape
            array[...] = new[name] if fits else np.nan

    def _braked(self, v: float, period: float) -> float:
        left = abs(v) - self.limits.a_max_m_per_s2 * max(period, self._dt)
        return copysign(left, v) if left > 0.0 else 0.0

    def _cap(self, room: float) -> float:
        """Fastest speed [m/s] from which one can brake inside `room` [m]."""
        a = self.limits.a_max_m_per_s2
        return max(0.0, sqrt(2.0 * a * room) - 0.5 * a * self._late) if room > 0.0 else 0.0

    def _clip(self, period: float) -> list[float]:
        """What is brakeable AND reachable, whatever was wanted. The two intervals always meet (docs/safety.md)."""
        limits, velocity = self.limits, []
        self._asked = self._wanted
        if self._state == COMPLY:
            b = limits.comply_damping_ns_per_m * max(self._shaking.amplitude / limits.shake_n, 1.0)  # harder where it is shaken
            self._asked = [f / b for f in self._force]
        change = limits.a_max_m_per_s2 * period
        for i, old in enumerate(self._v):
            if self._state == HOLD:
                velocity.append(self._braked(old, period))
                continue
            low, high = self._walls[i]
            x, at, tank = self._x[i], self._at[i], self._energy[i] / limits.force_limit_n
            up = min(limits.v_max_m_per_s, self._cap(min(high - max(x, at), tank)))
            down = min(limits.v_max_m_per_s, self._cap(min(min(x, at) - low, tank)))
            v = min(max(self._asked[i], -down), up)
            velocity.append(min(max(v, old - change), old + change))
        return velocity

    def _write(self, command: Command, velocity: list[float], passed: bool) -> None:
        """Position and acceleration go with the velocity; the skill's own pass where its velocity did and they are near."""
        limits, inner, near = self.limits, self._inner, self.limits.v_max_m_per_s * self._late
        for i, v in enumerate(velocity):
            low, high = self._walls[i]
            if self._state == HOLD:
                position = self._sent[i] + v * self._dt
            else:
                position = self._at[i] + v * self._dt
                if passed:
                    position = min(max(float(inner.position[i]), self._at[i] - near), self._at[i] + near)
            self._sent[i] = min(max(position, low), high) if v != 0.0 or self._state != HOLD else position
            command.position[i] = self._sent[i]
            command.velocity[i] = v
            a = float(inner.acceleration[i]) if passed else 0.0
            command.acceleration[i] = min(max(a, -limits.a_max_m_per_s2), limits.a_max_m_per_s2)
            self._tank[i] = self._energy[i]
        self._mode[0] = self._state
