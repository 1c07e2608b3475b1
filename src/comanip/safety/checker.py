"""The envelope's second opinion: other code, own memory, three rules. It shares no function with `safety.envelope`.

Each command must not be faster than v_max, must not change by more than a_max allows, and must leave room to stop before the
walls. A command that breaks a rule is replaced by the old one slowed down.
"""

from __future__ import annotations

from collections.abc import Sequence

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
        verdict = ""
        gain = self.a_max * (self.dt if period < self.dt else period)
        for n, (low, high) in enumerate(self.walls):
            new, old = velocity[n], self.last[n]
            if late:
                coast = min(max(period - self.dt, 0.0), abs(old) / self.a_max)
                travelled = abs(old) * (self.dt + coast) - 0.5 * self.a_max * coast * coast
                self.at[n] += travelled if old > 0.0 else -travelled
            else:
                self.at[n] += old * period
            if not -self.v_max - SLACK <= new <= self.v_max + SLACK:  # also when it is not a number
                verdict = "speed"
            elif not old - gain - SLACK <= new <= old + gain + SLACK:
                verdict = "acceleration"
            else:
                stop = self.at[n] + new * abs(new) / (2.0 * self.a_max)
                if (stop > high + SLACK and new > 0.0 and new > old - gain + SLACK) or (
                    stop < low - SLACK and new < 0.0 and new < old + gain - SLACK
                ):
                    verdict = "room to stop"
        if verdict:
            for n, old in enumerate(self.last):
                velocity[n] = max(old - gain, 0.0) if old > 0.0 else min(old + gain, 0.0)
        self.last = list(velocity)
        return verdict
