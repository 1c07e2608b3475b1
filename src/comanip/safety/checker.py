"""The envelope's second opinion: other code, own memory, three rules. It shares no function with `safety.envelope`.

Each command must not be faster than v_max, must not change by more than a_max allows, and must leave room to stop before the
walls. A command that breaks a rule is replaced by the old one slowed down.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

SLACK = 1e-9


class Checker:
    """Remembers what was commanded and where that leads; knows nothing of force, skill or mode."""

    def __init__(self, v_max: float, a_max: float, walls: Sequence[tuple[float, float]], dt: float) -> None:
        self.v_max, self.a_max, self.walls, self.dt = v_max, a_max, tuple(walls), dt
        self.at = [0.0] * len(self.walls)
        self.last = [0.0] * len(self.walls)

    def start(self, position: Sequence[float]) -> None:
        """The arm is at `position` [m], at rest."""
        self.at = list(position)
        self.last = [0.0] * len(self.walls)

    def judge(self, period: float, velocity: list[float], late: bool) -> str:
        """Empty, or the rule that `velocity` breaks, and then `velocity` holds what to command instead.

        late   the last command ran out: it was held for dt, then the low level braked by itself
        """
        gain, was, now, change = self.a_max * period, 0.0, 0.0, 0.0
        for new, old in zip(velocity, self.last, strict=True):
            was, now, change = was + old * old, now + new * new, change + (new - old) * (new - old)
        was, now, change = sqrt(was), sqrt(now), sqrt(change)
        held = period
        if late and was > 0.0:
            coast = min(max(period - self.dt, 0.0), was / self.a_max)
            held = self.dt + coast - 0.5 * self.a_max * coast * coast / was
        self.at = [at + old * held for at, old in zip(self.at, self.last, strict=True)]
        verdict = ""
        if not now <= self.v_max + SLACK:  # also when it is not a number
            verdict = "speed"
        elif not change <= gain + SLACK:
            verdict = "acceleration"
        elif now > was - gain + SLACK and self._passes_a_wall(velocity, now):
            verdict = "room to stop"
        if verdict:
            left = max(was - gain, 0.0) / was if was > 0.0 else 0.0
            velocity[:] = [old * left for old in self.last]
        self.last = list(velocity)
        return verdict

    def _passes_a_wall(self, velocity: Sequence[float], speed: float) -> bool:
        """Where braking at once, straight on, from `velocity` would end."""
        for new, at, (low, high) in zip(velocity, self.at, self.walls, strict=True):
            stop = at + new * speed / (2.0 * self.a_max)
            if (stop > high + SLACK and new > 0.0) or (stop < low - SLACK and new < 0.0):
                return True
        return False
