"""What a policy sees and says: the same numbers in the gym (`comanip.gym`) and behind `comanip trial --law-from`.

A policy sees position [m], velocity [m/s] and interaction force [N] of the hand, (3 d,), of the last `history` ticks, the oldest
first; one that leads a task of several goals sees behind them where it is to lead to, (d,) [m]. It says a velocity (d,) [m/s], or
an acceleration (d,) [m/s^2] that is summed up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from ..errors import ParameterError, plain
from ..interfaces import Array, Command, Observation
from ..parts import known
from ..safety.limits import Limits

ACTIONS = {"velocity": Limits.v_max_m_per_s, "acceleration": Limits.a_max_m_per_s2}  # and the most of each along an axis
MOST_HISTORY = 100


@dataclass(frozen=True)
class Seen:
    """The layout of what is seen, and what is said.

    history   of how many ticks; goal: whether it is told where to lead to
    action    of ACTIONS
    """

    n_axes: int
    history: int = 1
    goal: bool = False
    action: str = "velocity"

    def __post_init__(self) -> None:
        known("action", self.action, ACTIONS)
        if not (isinstance(self.history, int) and not isinstance(self.history, bool) and 1 <= self.history <= MOST_HISTORY):
            raise ParameterError(f"history is {self.history!r}; allowed: a whole number of ticks, 1 to {MOST_HISTORY}")

    @property
    def size(self) -> int:
        """How many numbers are seen."""
        return (3 * self.history + self.goal) * self.n_axes

    @property
    def most(self) -> float:
        """The largest that may be said along an axis [m/s], [m/s^2]."""
        return ACTIONS[self.action]


class Sight:
    """Rewrites `values` (size,) with what is seen. A channel that is missing (NaN) keeps its last value, at first 0."""

    def __init__(self, seen: Seen, goal: Array | None = None) -> None:
        self.seen, self.values = seen, np.zeros(seen.size)
        self._width = 3 * seen.n_axes
        self._past, self._last = self.values[: self._width * seen.history], np.zeros(self._width)
        if seen.goal:
            self.values[self._width * seen.history :] = 0.0 if goal is None else goal

    def move_to(self, values: Array) -> None:
        """Writes there (size,) from now on."""
        values[:] = self.values
        self.values, self._past = values, values[: self._width * self.seen.history]

    def begin(self, obs: Observation) -> Array:
        """At rest for ever before `obs`."""
        self._last[:] = 0.0
        self.look(obs)
        self._past[:] = np.tile(self._past[-self._width :], self.seen.history)
        return self.values

    def look(self, obs: Observation) -> Array:
        """One tick later."""
        width, past = self._width, self._past
        if self.seen.history > 1:
            past[:-width] = past[width:].copy()
        d, now = self.seen.n_axes, past[-width:]
        now[:d], now[d : 2 * d], now[2 * d :] = obs.position, obs.velocity, obs.force
        if not isfinite(sum(now.tolist())):
            now[:] = np.where(np.isfinite(now), now, self._last)
        self._last[:] = now
        return self.values


class Told:
    """The skill whose brain is outside: does what `say` was told last.

    Within the envelope like every other; a velocity that was summed up from accelerations stays within the envelope's own.
    """

    stop_reason = ""
    notice = ""

    def __init__(self, seen: Seen, *, dt: float) -> None:
        self.dt, self._sums, self._may = dt, seen.action == "acceleration", seen.most
        self._said, self._velocity, self._most = np.zeros(seen.n_axes), np.zeros(seen.n_axes), Limits.v_max_m_per_s

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {}

    def reset(self, obs: Observation) -> None:
        self._said[:] = 0.0
        self._velocity[:] = 0.0

    def say(self, action: Array) -> None:
        """(d,) [m/s], or [m/s^2], until the next; beyond what may be said it is clipped, axis by axis."""
        np.clip(action, -self._may, self._may, out=self._said)

    def step(self, obs: Observation, command: Command) -> None:
        v = self._velocity
        if self._sums:
            v += self.dt * self._said
            np.clip(v, -self._most, self._most, out=v)
        else:
            v[:] = self._said
        command.velocity[:] = v
        command.position[:] = obs.position + self.dt * v
        command.acceleration[:] = 0.0


def real(values: Any) -> Array:
    """Numbers as float64. Raises for text, truth values, complex numbers and what is masked, of which numpy would make some."""
    found = np.asarray(values)
    if found.dtype.kind not in "fiu" or np.ma.is_masked(values):
        raise TypeError
    return found.astype(np.float64, copy=False)


def checked(action: Any, seen: Seen) -> Array:
    """(d,) finite numbers within what may be said. Raises ParameterError that says what is wrong, before anything moved."""
    d, unit = seen.n_axes, "m/s" if seen.action == "velocity" else "m/s^2"
    allowed = f"allowed: ({d},) finite numbers of a {seen.action} [{unit}]"
    try:
        values = real(action)
    except Exception:  # whatever an array-like of somebody's raises
        raise ParameterError(f"action is {plain(repr(action), 80)}; {allowed}") from None
    if values.shape != (d,):
        raise ParameterError(f"action has shape {values.shape}; {allowed}")
    if not np.isfinite(values).all():
        raise ParameterError(f"action is {values.tolist()}; {allowed}")
    return values
