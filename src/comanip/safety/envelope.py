"""The safety envelope: a skill around a skill, which lets a command pass unchanged or makes it safer.

    clock -> sensors -> ledger (commanded position, energy) -> skill -> RUN | COMPLY | HOLD -> clip -> checker

One rule for walls and energy: never move at a speed from which you cannot brake inside what is left along the motion.

    cap(d) = max(0, sqrt(2 a d) - a T / 2)      d metres left, T the longest period allowed
    E_k    = min(E_max, E_(k-1) + F_k . v_(k-1) e)   energy tank, e <= T the measured period; E / F_lim metres left in it
    v_k    = what is wanted, no longer than cap allows, and within a e of v_(k-1)

RUN      the skill's command
COMPLY   v = F / b, dissipative: on doubt about the situation (fades back), when blocked; the harder it is shaken, the larger b
HOLD     brakes at a_max to 0 and stays stiff. What may pass by itself (let go, sinking, pushed) goes on, faded in, when the
         force has been quiet; a fault of sensor, clock or skill keeps its first reason until the user re-arms

Good engineering, not a certified safety function; what it promises and what not: docs/safety.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Skill
from ..kernels.copies import Copied
from ..signals.vectors import apart, length
from .bounds import Bounds
from .checker import Checker
from .compiled_tick import LENT, MOST_AXES, CompiledTick, Lending
from .detectors import Drag, Jump, LetGo, Missing, Pushed, Shaking, Sinking, Stuck
from .limits import Limits
from .situation import ABSURD, BLOCKED, COMPLY, HOLD, RUN, STUCK, Situation, leading_of, taught_by

NAMES = ("RUN", "COMPLY", "HOLD")
SAME_SAMPLE = 1e-3  # of a period: a stamp that advances by less is the same sample again, and its clock is not believed


class Envelope(Copied, Situation, Bounds, Lending):
    """Wraps `skill`; has its socket. `rearm` is for the user alone.

    tells     optional confidence in [0, 1] that the observation is like what was taught: below 1 the command fades to COMPLY
    timer     optional seconds, for example time.perf_counter: a skill that takes longer than a period is a fault. Without it
              such a skill is noticed one tick later, as a late tick, and runs replay identically

    Diagnostics: the skill's, and mode (0 RUN, 1 COMPLY, 2 HOLD), tank (1,) [J], confidence.
    """

    ANEW = ("_compiled",)

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
        self._axes, self._d = tuple(axes), len(axes)
        d = self._d
        self._late = limits.late_s or max(0.030, 3.0 * dt)
        self._stale = limits.stale_s or max(0.050, 5.0 * dt)
        if self._late < 2.0 * dt:
            raise ParameterError(f"late_s must be at least two periods, {2.0 * dt} s; got {self._late}")
        self._walls = limits.workspace_m or ((-inf, inf),) * d
        if len(self._walls) != d:
            raise ParameterError(f"workspace_m needs {d} rows for axes {axes}; got {len(self._walls)}")
        self._checker = Checker(limits.v_max_m_per_s, limits.a_max_m_per_s2, self._walls, dt)
        self._mode, self._tank, self._confidence = np.zeros(1), np.full(1, limits.energy_j), np.ones(1)
        self._inner = Command(d)
        self._frozen: dict[str, Array] | None = None
        self._compiled: Any = None
        self._is_lent = self._ran = False
        self._taught, self._leading, self._leads = taught_by(skill, self._d), leading_of(skill), 0.0
        self._restart(0.0, [0.0] * d)
        self._fault("not started")
        self._link()

    def _link(self) -> None:
        """The tick, where it was compiled."""
        self._compiled = CompiledTick(self) if kernels.native is not None and self._d <= MOST_AXES else None

    def __getstate__(self) -> dict[str, Any]:
        self._take_back()
        return super().__getstate__()

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """What the compiled tick has borrowed comes back as soon as anybody asks."""
            if name in LENT and self._is_lent:
                self._take_back()
                return getattr(self, name)
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that it was made for; the loop compares them with the plant's."""
        return self._axes

    @property
    def dt(self) -> float:
        """The period that it was made for [s]; the loop compares it with the plant's."""
        return self._dt

    @property
    def mode(self) -> str:
        """ "RUN", "COMPLY" or "HOLD"."""
        return NAMES[self._compiled.state() if self._is_lent else self._state]

    @property
    def reason(self) -> str:
        """Why it is not in RUN; empty in RUN."""
        return self._compiled.reason() if self._is_lent else self._reason

    @property
    def passes(self) -> bool:
        """Whether what stopped it may pass, and it then goes on by itself; else only `rearm` ends it."""
        return self._compiled.passes() if self._is_lent else self._state != RUN and self._passes

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        own = {"mode": self._mode, "tank": self._tank, "confidence": self._confidence}
        return {**(self.skill.diagnostics if self._frozen is None else self._frozen), **own}

    @property
    def stop_reason(self) -> str:
        return self.skill.stop_reason

    @property
    def notice(self) -> str:
        if self.mode != NAMES[RUN]:
            return f"{self.mode}: {self.reason}"
        if self._confidence[0] < 1.0:
            return f"goes on by itself: {self._passed} has passed" if self._passed else "COMPLY: unlike what was taught"
        said = [self.skill.notice, *self._flags()]
        return "; ".join(s for s in said if s)

    # starting, and starting again

    def reset(self, obs: Observation) -> None:
        """As the loop's start: like re-arming, but what refuses it is a HOLD."""
        refused = self._begin(obs, resumes=False)
        if refused:
            self._fault(refused)

    def rearm(self, obs: Observation) -> str:
        """Runs again from where the arm is; returns why it does not (empty: it does). Only the user calls this, at rest."""
        try:
            problem = self._problem(obs)
            measured = 0.0 if problem else length([v for v in obs.velocity.tolist() if v == v])
            problem = problem or self._still_there(obs)
        except Exception as error:
            return f"sensors: {error!r}"
        fastest = length(self._v)
        if measured > self.limits.rest_m_per_s or fastest > (self.limits.moving_m_per_s if self._state == RUN else 0.0):
            return f"in motion: {max(measured, fastest):.2g} m/s"
        return problem or self._begin(obs, resumes=self._ran)

    def _still_there(self, obs: Observation) -> str:
        """What it must not start under: a hand that is pulled, a sensor that stands still yet."""
        pull = length(obs.force.tolist())
        if pull > self.limits.pull_n:
            return f"pulled with {pull:.0f} N > {self.limits.pull_n:g} N: let the object rest, or tare"
        if self._reason == STUCK and self._stuck.last == obs.sensor_force.tolist():
            return f"{STUCK} still: sensor?"
        return ""

    def change_skill(self, skill: Skill, obs: Observation) -> str:
        """Another skill from now on (roles exchanged): starts in COMPLY and fades. Returns why it did not (empty: it did)."""
        try:
            shown = {name: array for name, array in self.diagnostics.items() if name not in ("mode", "tank", "confidence")}
            skill.reset(obs)
        except Exception as error:
            return f"policy: {error!r}"
        self._take_back()
        self._frozen = {name: array.copy() for name, array in shown.items()}
        self.skill, self._taught, self._leading = skill, taught_by(skill, self._d), leading_of(skill)
        self._confidence[0] = 0.0
        return ""

    def _enter(self, obs: Observation, resumes: bool) -> None:
        """The skill from rest where the arm is; `resumes`: in the part of the task in which it was, if it knows how to."""
        begin = getattr(self.skill, "resume", self.skill.reset) if resumes else self.skill.reset
        begin(obs)
        self._ran = True

    def _begin(self, obs: Observation, *, resumes: bool) -> str:
        try:
            time, position = float(obs.time), [float(x) for x in obs.position]
            if not resumes:
                self._enclose(position)
            problem = self._problem(obs)
        except Exception as error:
            return f"sensors: {error!r}"
        if problem:
            place = [x if abs(x) < ABSURD else 0.0 for x in (*position, *[0.0] * self._d)]
            self._restart(time if isfinite(time) else 0.0, place[: self._d])
            return problem
        self._restart(time, position)
        try:
            self._enter(obs, resumes)
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
        self._senses = [0.0] * d
        self._energy = self.limits.energy_j
        self._blocked_ns = self._impact_s = self._rest_s = 0.0
        self._felt, self._at_first, self._rate, self._ticks = [0.0] * d, [0.0] * d, [0.0] * d, 0
        self._cause, self._bound, self._pulled = [0.0] * d, inf, [0.0] * d
        self._feels_s, self._sinks_s = 0.0, 0.0
        self._passes, self._passed, self._passed_s = False, "", 0.0
        self._wait_s = self._sinks_wait_s = self.limits.passed_s
        limits = self.limits
        self._let_go = LetGo(
            d, self._dt, alone_n=limits.alone_n, alone_s=limits.alone_s, steady_n_s=limits.steady_n_s,
            stands_m_s=limits.stands_m_per_s,
        )  # fmt: skip
        self._missing = Missing(
            d, nobody_n=limits.let_go_n, nobody_s=limits.let_go_s, held_n=limits.held_n,
            fast_m_per_s=limits.let_go_m_per_s, moving_m_per_s=limits.moving_m_per_s,
            bias_n=limits.tare_n,
        )  # fmt: skip
        self._drag, self._sinking, self._pushed = Drag(), Sinking(limits.alone_n), Pushed(limits.pushed_n)
        self._stuck = Stuck(d, limits.stuck_s, limits.stuck_m)
        self._jump = Jump(d, limits.jump_n, limits.jump_rest_s, limits.jump_stays_s)
        self._shaking = Shaking(d)
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
        for name, x, (low, high) in zip(self._axes, obs.position.tolist(), self._walls, strict=True):
            if not abs(x) < ABSURD:
                return "position not finite"
            if not low <= x <= high:
                off = max(low - x, x - high)
                return f"{off:.2g} m outside the workspace: {name} {x:.3g} m, allowed {low:.3g} to {high:.3g} m"
        return self._wrong(obs.force.tolist(), obs.velocity.tolist(), self.limits.force_limit_n)

    def _wrong(self, force: list[float], velocity: list[float], limit: float) -> str:
        if not all(abs(f) < ABSURD for f in force):
            return "force not finite"
        if (size := length(force)) > limit:
            return f"force {size:.0f} N > {limit:g} N"
        if length([v for v in velocity if v == v]) > 10.0 * self.limits.v_max_m_per_s:  # NaN: nobody measures it
            return "velocity not plausible"
        return ""

    def _fault(self, reason: str) -> None:
        """HOLD until the user re-arms, with the first reason that is not one that may pass."""
        if self._state != HOLD or self._passes:
            self._state, self._reason, self._passes = HOLD, reason, False

    def _pause(self, reason: str, bound_n: float = inf) -> None:
        """HOLD until what it is has passed: the force that stopped it is less than `bound_n`, and than a pull."""
        if self._state != HOLD:
            self._state, self._reason, self._passes, self._passed_s = HOLD, reason, True, 0.0
            self._cause, self._bound = list(self._force), bound_n

    def _comply(self, reason: str) -> None:
        if self._state == RUN:
            self._state, self._reason, self._passes, self._passed_s = COMPLY, reason, True, 0.0
            self._cause, self._bound = list(self._force), inf

    # one tick

    def step(self, obs: Observation, command: Command) -> None:
        try:
            self._step(obs, command)
        except Exception as error:  # nothing foreseen: still brakes
            self._fault(f"envelope: {error!r}")
            self._v = self._braked(self._dt)
            self._checker.last = list(self._v)
            self._write(command, self._v, False)

    def _step(self, obs: Observation, command: Command) -> None:
        """A tick is compiled, but for the skill's own; here is the same to read."""
        if self._lends() and self._step_compiled(obs, command):
            return
        self._take_back()
        self._leads = float(self._leading[0])
        period, fresh, late = self._clock(obs)
        self._impact_s -= period
        if fresh:
            self._sense(obs, period)
        self._known = fresh and self._known
        self._book(period, late)
        if fresh:
            self._watch(obs, period)
        if self._state == RUN:
            self._think(obs, period, fresh)
        self._send(command, period, fresh, late)

    def _send(self, command: Command, period: float, fresh: bool, late: bool) -> None:
        velocity = self._clip(period)
        verdict = self._checker.judge(period, velocity, late)
        if verdict:
            self._fault(f"checker: {verdict}")
        # a faded velocity does not go with the position that the skill wishes: who follows positions would go the whole way
        passed = self._state == RUN and fresh and velocity == self._inner.velocity.tolist()
        if period > 0.0:
            self._rate = [(new - old) / period for new, old in zip(velocity, self._v, strict=True)]
        self._v = velocity
        self._write(command, velocity, passed)

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
        if step < SAME_SAMPLE * dt:  # the same sample again: coast
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
        if not all(abs(x) < ABSURD for x in position):
            self._fault("position not finite")
        else:
            jump = apart(position, self._at)
            if jump > limits.position_jump_m + 2.0 * limits.v_max_m_per_s * self._elapsed:
                self._fault(f"position jump {jump:.2g} m")
            self._at = position
        problem = self._wrong(force, velocity, limits.force_limit_n if self._impact_s <= 0.0 else limits.impact_n)
        if not problem and obs.time - obs.force_time > self._stale + 1e-9:  # NaN: as old as the rest
            problem = f"force {1000.0 * (obs.time - obs.force_time):.0f} ms old"
        if problem:
            self._fault(problem)
        if self._stuck.step(self._readings(raw, force), length(self._v), period):
            self._fault(STUCK)
        self._known = not problem
        if self._known:
            self._force = force
            at_rest = length(self._v) < limits.moving_m_per_s
            self._let_go.weigh(raw, force, self._rate, at_rest and length(force) < limits.tare_n)
            if self._let_go.load > limits.load_n:
                self._fault(f"the object weighs {self._let_go.load:.0f} N on this hand > {limits.load_n:g} N: too heavy to carry")
            if jump := self._jump.step(raw, at_rest, period):
                self._pause(f"force jumped {jump:.1f} N at rest: sensor? tare, then re-arm", 0.5 * jump)

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
        over = self.limits.offer_s if self._passed == BLOCKED else self.limits.fade_s
        share = min(trust, float(self._confidence[0]) + period / over)
        self._confidence[0] = share
        if share >= 1.0 and self._passed:
            self._passed, self._wait_s = "", self.limits.passed_s
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

    def _show(self) -> None:
        """Under the names and sizes that the recorder knows from the first skill."""
        assert self._frozen is not None
        new = self.skill.diagnostics
        for name, array in self._frozen.items():
            fits = name in new and new[name].shape == array.shape
            array[...] = new[name] if fits else np.nan

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
        self._tank[0] = self._energy
        self._mode[0] = self._state
