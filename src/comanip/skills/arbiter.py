"""Who commands: one of two skills, policies or people, and a change from one to the other without a jump.

    Arbiter(a, b)          a commands until b takes over: on `request`, or by evidence
    Patience, Insistence   evidence from what is felt

Both step at every tick with the same observation, so both know where the hand is. When another takes over, the velocity goes
from what was sent last to what the new one wants, as a vector by no more than `takeover_m_per_s2` dt a tick; when it is
there, the command passes unchanged, to the bit. The start is a takeover from rest. Whoever commands, no tick changes the
velocity by more than `a_max_m_per_s2` dt. Each sees an observation of its own, so neither spoils what the other sees.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import inf, isfinite
from typing import Any, Protocol

import numpy as np

from ..errors import MismatchError, ParameterError, check_has
from ..interfaces import Array, Command, Observation, Skill
from ..signals.vectors import apart, length

A, B = "a", "b"
WHO = (A, B)
SEEN = ("position", "velocity", "sensor_force", "force")
SKILL = ("diagnostics", "stop_reason", "notice", "reset", "step")


class Evidence(Protocol):
    """How much speaks for b, in [0, 1]; it takes over above `Arbiter`'s `above`, and gives back below its `below`."""

    def reset(self, obs: Observation) -> None: ...

    def step(self, obs: Observation, sent: Array) -> float:
        """`sent` (d,) [m/s] is what was commanded last. NaN says nothing: who commands goes on."""
        ...


class Arbiter:
    """A Skill made of two. `commander` is "a" or "b".

    evidence             who commands where nobody has asked: see `Evidence`; None: a, until somebody asks
    takeover_m_per_s2    the most that the velocity changes while another takes over [m/s^2]
    a_max_m_per_s2       the most that it ever changes [m/s^2]; the envelope's own, so that a law within it passes unchanged
    above, below, for_s  b takes over when the evidence has been above for so long, and gives back when below for so long
    longest_s            how long the step of one may take [s of `clock`]; inf: nobody looks

    One that raises, commands what is not finite, or takes longer, loses the command to the other, until it is well again; where
    both do, the hand brakes. `notice` says so. One that has `resume(obs)` is told by it that it commands again.

    Raises ParameterError for what is no Skill or out of range, MismatchError for parts made for another period or other axes.
    """

    def __init__(
        self,
        a: Skill,
        b: Skill,
        *,
        axes: tuple[str, ...],
        dt: float,
        evidence: Evidence | None = None,
        takeover_m_per_s2: float = 2.0,
        a_max_m_per_s2: float = 10.0,
        above: float = 0.7,
        below: float = 0.3,
        for_s: float = 0.1,
        longest_s: float = inf,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        for name, part in zip(WHO, (a, b), strict=True):
            check_has(part, f"skill {name}", SKILL, "comanip.interfaces.Skill")
            _check_made_for(name, part, axes, dt)
        if not (0.0 < takeover_m_per_s2 <= a_max_m_per_s2 and isfinite(a_max_m_per_s2)):
            raise ParameterError(
                f"takeover_m_per_s2 is {takeover_m_per_s2}, a_max_m_per_s2 {a_max_m_per_s2}; allowed: 0 < takeover <= a_max"
            )
        if not longest_s > 0.0:
            raise ParameterError(f"longest_s is {longest_s}; allowed: above 0, for example the control period {dt:g}")
        if not (0.0 <= below < above <= 1.0 and for_s >= 0.0 and dt > 0.0):
            raise ParameterError(
                f"below {below}, above {above}, for_s {for_s}, dt {dt}; allowed: 0 <= below < above <= 1, dt > 0"
            )
        self.axes, self.dt, self.evidence = tuple(axes), dt, evidence
        self.takeover_m_per_s2, self.a_max_m_per_s2 = takeover_m_per_s2, a_max_m_per_s2
        self._parts, self._above, self._below, self._for_s = (a, b), above, below, for_s
        self._longest_s, self._clock = longest_s, clock
        self._commands = tuple(Command(len(axes)) for _ in WHO)
        self._looks = tuple(Look(len(axes)) for _ in WHO)
        self._sent = np.zeros(len(axes))
        self._shown = {"arbiter.commander": np.zeros(1), "arbiter.joined": np.ones(1), "arbiter.evidence": np.zeros(1)}
        self._asked: str | None = None
        self._forget()

    def _forget(self) -> None:
        self._who, self._joined, self._since_s, self._wrong = 0, False, 0.0, ["", ""]

    @property
    def commander(self) -> str:
        """ "a" or "b"."""
        return WHO[self._who]

    @property
    def joined(self) -> bool:
        """Whether the commander's velocity is reached, and passes."""
        return self._joined

    def request(self, who: str | None) -> None:
        """From the next tick on `who` commands, "a" or "b", until another request; None leaves it to the evidence."""
        if who not in (*WHO, None):
            raise ParameterError(f"who is {who!r}; allowed: 'a', 'b', or None for the evidence")
        self._asked = who

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        """Who commands (0: a, 1: b), whether its command passes, the evidence for b; and those of both, as "a.name", "b.name"."""
        theirs: dict[str, Array] = {}
        for name, part in zip(WHO, self._parts, strict=True):
            theirs |= {f"{name}.{key}": one for key, one in asked(part, "diagnostics", {}).items()}
        return {**self._shown, **theirs}

    @property
    def stop_reason(self) -> str:
        return str(asked(self._parts[self._who], "stop_reason", ""))

    @property
    def notice(self) -> str:
        faults = [f"{name}: {why}" for name, why in zip(WHO, self._wrong, strict=True) if why]
        return "; ".join(said for said in (*faults, str(asked(self._parts[self._who], "notice", ""))) if said)

    def reset(self, obs: Observation) -> None:
        self._forget()
        for part, look in zip(self._parts, self._looks, strict=True):
            part.reset(look.at(obs))
        if self.evidence is not None:
            self.evidence.reset(obs)
        measured = np.where(np.isfinite(obs.velocity), obs.velocity, 0.0)
        self._sent[:] = measured
        if self._asked is not None:
            self._who = WHO.index(self._asked)

    def step(self, obs: Observation, command: Command) -> None:
        for n in range(len(WHO)):
            self._wrong[n] = self._step_of(n, obs)
        self._choose(obs)
        wanted = self._commands[self._who]
        if self._wrong[self._who]:  # both are lost: brake
            self._join(np.zeros_like(self._sent), False)
            self._fill(command, obs, None)
            return
        passes = self._join(wanted.velocity, True)
        self._fill(command, obs, wanted if passes else None)

    def _step_of(self, n: int, obs: Observation) -> str:
        """What is wrong with the command of one of them; empty where nothing is."""
        one, began = self._commands[n], self._clock() if self._longest_s < inf else 0.0
        try:
            self._parts[n].step(self._looks[n].at(obs), one)
            if self._longest_s < inf and (took := self._clock() - began) > self._longest_s:
                return f"its step took {took:.3g} s; allowed: {self._longest_s:g} s"
            values = (*one.velocity.tolist(), *one.position.tolist(), *one.acceleration.tolist())
            fits = len(one.velocity) == len(one.position) == len(one.acceleration) == len(self._sent)
            return "" if fits and all(map(isfinite, values)) else "its command is not finite, or of another shape"
        except Exception as error:
            self._commands = tuple(Command(len(self.axes)) if k == n else c for k, c in enumerate(self._commands))
            return repr(error)

    def _choose(self, obs: Observation) -> None:
        """Who commands now."""
        found = self._wanted(obs)
        if self._wrong[found] and not self._wrong[1 - found]:
            found = 1 - found
        if found != self._who:
            self._who, self._joined, self._since_s = found, False, 0.0
            self._wake(obs)
        self._shown["arbiter.commander"][0] = found

    def _wanted(self, obs: Observation) -> int:
        """By request, or by evidence that has lasted."""
        if self._asked is not None:
            return WHO.index(self._asked)
        if self.evidence is None:
            return 0 if not self._wrong[0] else self._who
        share = self._heard(obs)
        self._shown["arbiter.evidence"][0] = share
        otherwise = share > self._above if self._who == 0 else share < self._below
        self._since_s = self._since_s + self.dt if otherwise else 0.0
        return 1 - self._who if otherwise and self._since_s > self._for_s else self._who

    def _heard(self, obs: Observation) -> float:
        assert self.evidence is not None
        try:
            return float(self.evidence.step(obs, self._sent))
        except Exception as error:
            self._wrong[self._who] = self._wrong[self._who] or f"evidence: {error!r}"
            return float("nan")

    def _wake(self, obs: Observation) -> None:
        """The one that commands again is told, if it wants to know."""
        resume: Any = getattr(self._parts[self._who], "resume", None)
        if resume is None:
            return
        try:
            resume(self._looks[self._who].at(obs))
            self._wrong[self._who] = self._step_of(self._who, obs)
        except Exception as error:
            self._wrong[self._who] = repr(error)

    def _join(self, wanted: Array, finite: bool) -> bool:
        """`_sent` goes towards what is wanted, as far as it may; whether it is there."""
        may = (self.a_max_m_per_s2 if self._joined and finite else self.takeover_m_per_s2) * self.dt
        far = apart(wanted.tolist(), self._sent.tolist())
        if far <= may:
            self._sent[:] = wanted
            self._joined = finite
        else:
            self._sent += (wanted - self._sent) * (may / far)
        self._shown["arbiter.joined"][0] = self._joined
        return self._joined and far <= may

    def _fill(self, command: Command, obs: Observation, passes: Command | None) -> None:
        command.velocity[:] = self._sent
        if passes is not None:
            command.position[:], command.acceleration[:] = passes.position, passes.acceleration
            return
        here = np.where(np.isfinite(obs.position), obs.position, command.position)
        command.position[:] = here + self.dt * self._sent
        command.acceleration[:] = 0.0


class Look:
    """An observation of one's own, as fresh as the loop's: whoever writes into it harms nobody else."""

    def __init__(self, n_axes: int) -> None:
        self._own, self._arrays = Observation(n_axes), tuple(np.zeros(n_axes) for _ in SEEN)

    def at(self, obs: Observation) -> Observation:
        """What is seen now; of other lengths it is taken as it is."""
        own = self._own
        own.time, own.force_time = obs.time, obs.force_time
        for name, kept in zip(SEEN, self._arrays, strict=True):
            seen = getattr(obs, name)
            if seen.shape == kept.shape:
                kept[:] = seen
            setattr(own, name, kept if seen.shape == kept.shape else seen.copy())
        return own


def asked(part: Any, name: str, otherwise: Any) -> Any:
    """What a part says of itself, or `otherwise` where that raises: nothing raises inside a tick."""
    try:
        return getattr(part, name)
    except Exception:
        return otherwise


def _check_made_for(name: str, part: Any, axes: tuple[str, ...], dt: float) -> None:
    own = getattr(part, "dt", None)
    if own is not None and abs(own - dt) > 1e-6 * dt:
        raise MismatchError(f"skill {name} is made for a control period dt of {own:g} s, the arbiter for {dt:g} s")
    theirs = getattr(part, "axes", None)
    if theirs is not None and tuple(theirs) != tuple(axes):
        raise MismatchError(f"skill {name} is made for the axes {', '.join(theirs)}, the arbiter for {', '.join(axes)}")


class Patience:
    """b leads where nobody else does: evidence 1 after `patience_s` in which the hand has neither moved nor been pulled.

    moved_m, pulled_n   from here on somebody leads, and the evidence stays 0
    """

    def __init__(self, dt: float, *, patience_s: float = 6.5, moved_m: float = 0.005, pulled_n: float = 3.0) -> None:
        self._dt, self._patience_s, self._moved_m, self._pulled_n = dt, patience_s, moved_m, pulled_n

    def reset(self, obs: Observation) -> None:
        self._quiet_s, self._led = 0.0, False
        self._start = np.nan_to_num(obs.position).tolist()

    def step(self, obs: Observation, sent: Array) -> float:
        self._quiet_s += self._dt
        if self._quiet_s >= self._patience_s:
            return 0.0 if self._led else 1.0
        gone = apart(np.nan_to_num(obs.position).tolist(), self._start)
        self._led = self._led or gone > self._moved_m or length(np.nan_to_num(obs.force).tolist()) > self._pulled_n
        return 0.0


class Insistence:
    """The partner pulls across or against the motion harder than `pulled_n`, for `for_s`: b gives way.

    0 again when the pull has been less than half of that for as long.
    """

    def __init__(self, dt: float, *, pulled_n: float = 6.0, for_s: float = 0.2) -> None:
        if not (pulled_n > 0.0 and for_s >= 0.0):
            raise ParameterError(f"pulled_n {pulled_n}, for_s {for_s}; allowed: pulled_n > 0, for_s >= 0")
        self._dt, self._pulled_n, self._for_s = dt, pulled_n, for_s
        self._since_s, self._insists = 0.0, False

    def reset(self, obs: Observation) -> None:
        self._since_s, self._insists = 0.0, False

    def step(self, obs: Observation, sent: Array) -> float:
        force, speed = np.nan_to_num(obs.force), float(np.linalg.norm(sent))
        along = max(float(force @ sent) / speed, 0.0) if speed > 1e-6 else 0.0
        pull = float(np.linalg.norm(force - (along / speed * sent if along else 0.0)))
        changes = pull < 0.5 * self._pulled_n if self._insists else pull > self._pulled_n
        self._since_s = self._since_s + self._dt if changes else 0.0
        if self._since_s > self._for_s:
            self._insists, self._since_s = not self._insists, 0.0
        return float(self._insists)
