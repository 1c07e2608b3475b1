"""What the envelope makes of the force while its skill runs: what stops the hand, and whether that has passed."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np

from ..interfaces import Array, Observation, Skill
from ..signals.vectors import dot, length
from .detectors import HANGS_N, LIGHT_N, Pushed, Sinking

RUN, COMPLY, HOLD = 0, 1, 2
GONE = "let go: the hand carries the whole object"
SINKS = "let go or loaded: more hangs on the hand than its share"
STUCK = "force stuck"
PUSHED = "pushed along with {:.0f} N: sensor, or a weight on it?"
BLOCKED, LOST = "blocked", "let go"
HANGING, HANGING_N = 0.12, 0.6  # within this share of the object, or so many newtons, of the whole it hangs
EDGE_M = 0.01  # nearer than this to a wall it is said
SUNK = 0.9  # of what it may sink; nearer to its end it only creeps
ANSWERS_N, ANSWERS_S = 0.9, 0.2  # a hand that stopped because nobody held is answered by so much, so long; a swing is shorter
SINKS_S = 0.6  # it creeps at the end of what it may sink, and nobody answers, carries or pulls harder
ABSURD = 1e6  # no sensor of a robot says such a number, in any unit
AGAIN_S = 8.0  # the longest wait before it tries again whether what blocked it has gone


def taught_by(skill: Skill, n_axes: int) -> Array:
    """(d,) [m/s] How fast lessons went where the hand is, as the skill says each tick; 0 of one that does not know."""
    taught = getattr(skill, "taught", None)
    return taught if isinstance(taught, np.ndarray) and taught.shape == (n_axes,) else np.zeros(n_axes)


def leading_of(skill: Skill) -> Array:
    """(1,) How much of the motion the skill means by itself, 0 to 1, as it says each tick; 0 of one that does not say."""
    leading = getattr(skill, "leading", None)
    return leading if isinstance(leading, np.ndarray) and leading.shape == (1,) else np.zeros(1)


class Situation:
    """A part of `Envelope`."""

    def _watch(self: Any, obs: Observation, period: float) -> None:
        """What the force says about the situation; and whether what stopped the hand has passed."""
        if self._state == RUN:
            self._look(obs, period)
        elif self._state == COMPLY:
            self._feel(obs, period)
        if self._state != RUN and self._passes:
            self._recover(obs, period)

    def _look(self: Any, obs: Observation, period: float) -> None:
        """Blocked, let go, sinking, pushed, shaken, wrongly tared."""
        limits = self.limits
        speed, size = length(self._v), length(self._force)
        self._drag.step(self._force, self._v, period)
        # or it presses on a wall with just that force, or somebody leans on it
        if self._let_go.step(speed, period, self._is_dragged()):
            self._comply(GONE)
            self._feels_s, self._pulled = limits.feel_s, self._let_go.pull()
        self._sink(period)
        self._pushed.step(self._force, self._v, period)
        if self._pushed.work > limits.pushed_j:
            self._comply(PUSHED.format(size))
            self._pushed = Pushed(limits.pushed_n)
        self._press(speed, period)
        if self._let_go.load <= LIGHT_N:
            self._miss(obs, speed, period)
        self._shaking.step(self._force, period)
        if self._ticks < 5:  # before anybody can have moved; later the hand leans on the partner until F is 0 again
            self._ticks += 1
            self._at_first = [a + (f - a) / self._ticks for a, f in zip(self._at_first, self._force, strict=True)]
        self._rest_s = self._rest_s + period if speed < 0.05 else 0.0
        self._felt = [a + min(period, 1.0) * (f - a) for a, f in zip(self._felt, self._force, strict=True)]

    def _is_dragged(self: Any) -> bool:
        """Whether it is somebody who was taken for nobody before, and resists as then."""
        return self._let_go.was_mistaken > 0 and self._drag.explains(self._let_go.load)

    def _sink(self: Any, period: float) -> None:
        """Down with a partner who carries too little: a few centimetres, and then no farther."""
        taught = self._taught.tolist()
        self._sinking.step(self._let_go.weight, self._let_go.load, self._force, self._v, taught, period)
        ends = self._sinking.hangs and self._sinking.sunk > SUNK * self.limits.sink_m
        self._sinks_s = self._sinks_s + period if ends else 0.0
        if self._sinks_s > SINKS_S:
            self._pause(SINKS)

    def _press(self: Any, speed: float, period: float) -> None:
        """Against something that does not give way; sooner while it only tries whether that has gone."""
        limits = self.limits
        against = -dot(self._force, self._v) / max(speed, 1e-6)
        self._blocked_ns = self._blocked_ns + against * period if against > limits.blocked_n else 0.0
        if self._blocked_ns > limits.blocked_n * limits.blocked_s:
            self._comply(BLOCKED)
            self._impact_s = limits.impact_s
        wish = self._inner.velocity.tolist()
        most = 1.2 * self._let_go.load if self._let_go.was_mistaken else limits.offer_n  # an arm is led up by about the weight
        against = 0.0 if self._is_dragged() else -dot(self._force, wish)
        if self._passed == BLOCKED and against > max(most, limits.offer_n) * length(wish):
            self._wait_s = min(2.0 * self._wait_s, AGAIN_S)
            self._comply(BLOCKED)

    def _miss(self: Any, obs: Observation, speed: float, period: float) -> None:
        """Somebody who was there and is no more, where the object weighs nothing along the axes."""
        sensed = [f if abs(f) < ABSURD else nan for f in obs.sensor_force.tolist()]
        if self._missing.step(sensed, self._force, speed, self._leads, period):
            self._comply(LOST)

    def _feel(self: Any, obs: Observation, period: float) -> None:
        """Complying; after a moment of it a wall is left behind, and an object that nobody holds is not."""
        self._shaking.step(self._force, period)
        if self._reason == LOST:
            self._miss(obs, length(self._v), period)
        self._sink(period)
        self._pushed.step(self._force, self._v, period)
        if self._pushed.work > self.limits.pushed_j and self._reason != BLOCKED:  # from a wall it is pushed indeed
            self._pause(PUSHED.format(length(self._force)))
        if self._feels_s <= 0.0:
            if self._let_go.step(length(self._v), period, self._is_dragged()):
                self._pause(GONE)
            return
        self._feels_s -= period
        if self._feels_s > 0.0:
            return
        if self._let_go.nobody_pulls(self._pulled):
            self._pause(GONE)
        elif length(self._force) < 0.5 * self._let_go.load:
            self._reason = BLOCKED
            self._let_go.mistaken()
        else:  # somebody answers, and is followed
            self._let_go.forget()
            self._let_go.mistaken()
            self._goes_on(GONE)

    def _recover(self: Any, obs: Observation, period: float) -> None:
        """Goes on by itself, faded in, when the force that stopped it is over for a while."""
        limits, load = self.limits, self._let_go.load
        still = dot(self._force, self._cause) / max(length(self._cause), 1e-9)  # of the force that stopped it
        weighs = load > (LIGHT_N if self._reason in (GONE, SINKS) else HANGS_N)
        over = still < min(limits.pull_n, self._bound, 0.5 * load if weighs else limits.pull_n)
        if self._reason == LOST:
            over = length(self._missing.pull) > ANSWERS_N
        wait_s = ANSWERS_S if self._reason == LOST and self._leads >= 1.0 else limits.passed_s
        wait_s = self._wait_s if self._reason == BLOCKED else wait_s
        if self._reason in (GONE, SINKS) and not over:
            # of nobody the whole object weighs on a hand that stands; less or more is somebody, who carries or leads down
            off = abs(dot(self._force, self._let_go.weight) / load - load)
            over, wait_s = off > max(HANGING * load, HANGING_N), self._sinks_wait_s
        self._passed_s = self._passed_s + period if over and self._known and self._feels_s <= 0.0 else 0.0
        if self._passed_s <= wait_s:
            return
        if (self._state == HOLD and length(self._v) > 0.0) or self._problem(obs):
            return
        if problem := self._resumes(obs):
            self._fault(problem)
        else:
            self._recovered()

    def _resumes(self: Any, obs: Observation) -> str:
        """The skill begins again from where the arm is; why it does not (empty: it does)."""
        try:
            self._enter(obs, True)
        except Exception as error:
            return f"policy: {error!r}"
        return ""

    def _recovered(self: Any) -> None:
        """What stopped it has passed, and the skill has begun again."""
        reason = self._reason
        if self._state == HOLD:  # from where the arm is
            self._x, self._sent = list(self._at), list(self._at)
            self._checker.start(self._at)
        if reason in (GONE, SINKS):
            self._sinks_wait_s = min(2.0 * self._sinks_wait_s, AGAIN_S)
        if reason == LOST:
            self._missing.mistaken()
        self._let_go.forget()
        self._sinking = Sinking(self.limits.alone_n)
        self._goes_on(reason)

    def _goes_on(self: Any, reason: str) -> None:
        """In RUN, faded in; `reason` has passed."""
        self._state, self._reason, self._passes, self._passed, self._confidence[0] = RUN, "", False, reason, 0.0
        self._pushed = Pushed(self.limits.pushed_n)
        self._sinks_s = self._blocked_ns = 0.0
        self._wanted = [0.0] * self._d

    def _flags(self: Any) -> list[str]:
        """What the person should know while all goes on."""
        flags, limits = [], self.limits
        if self._shaking.amplitude > limits.shake_n:
            flags.append(f"shaking, {self._shaking.amplitude:.0f} N")
        felt = [length(self._felt) if self._rest_s > 2.0 else 0.0, length(self._at_first)]
        if max(felt) > limits.tare_n:
            flags.append(f"felt {max(felt):.1f} N at rest: wrong mass? tare")
        for name, x, (low, high) in zip(self._axes, self._at, self._walls, strict=True):
            if min(x - low, high - x) < EDGE_M:
                flags.append(f"at the edge of the workspace: {name} {x:.2f} m of {low:.2f} to {high:.2f} m")
        if self._energy / limits.force_limit_n <= self.limits.a_max_m_per_s2 * self._late**2 / 8.0:
            flags.append("energy budget used up: re-arm")
        return flags

    def _readings(self: Any, raw: list[float], force: list[float]) -> list[float]:
        """What the sensor says; where it never says anything, the force. A reading that is missing is the last one again."""
        readings = []
        for i, (reading, f) in enumerate(zip(raw, force, strict=True)):
            if reading == reading:
                self._senses[i] = 1.0
            readings.append(reading if reading == reading else self._stuck.last[i] if self._senses[i] else f)
        return readings
