"""What the lessons lead us to expect along the task: position, velocity and force over phase."""

from __future__ import annotations

import numpy as np

from ..errors import TrainingError
from ..interfaces import Array
from ..models.clock import PHASE
from ..models.gmm import Gmm
from ..models.gmr import regress

MOVING = 0.03  # share of the top speed that counts as motion
POINTS_PER_S = 100
SMOOTHING_S = 0.5  # a few Gaussians over phase make a staircase of speeds; nobody lifts in steps


class PhaseReference:
    """A table over the MOVING part of the task; rest before and after is left out, so phase 0 is where motion begins.

    duration_s   of the usual motion [s]
    position, velocity, force   (N, d) at N equal steps of phase; velocity is d position / d phase
    """

    def __init__(self, position: Array, force: Array, step_s: float) -> None:
        self.position, self.force, self.step_s = np.ascontiguousarray(position), np.ascontiguousarray(force), step_s
        self.duration_s = step_s * (len(position) - 1)
        self.velocity = np.gradient(self.position, step_s, axis=0)
        self.velocity[[0, -1]] = 0.0
        self._last = len(position) - 1
        # the same tables as floats: of one or two axes Python's own arithmetic takes a fifth of numpy's time
        self._rows = {"position": position.tolist(), "velocity": self.velocity.tolist(), "force": force.tolist()}

    @classmethod
    def learned(cls, clock: Gmm, end: Array | None = None) -> PhaseReference:
        """What GMR from the clock's phase expects; `end` (d,) [m] is where the lessons ended on average, if known."""
        first = clock.channels.index(PHASE)
        centre, spread = clock.means[:, first], np.sqrt(clock.covariances[:, first, first])
        low, high = float((centre - 3 * spread).min()), float((centre + 3 * spread).max())
        phase = np.linspace(max(low, 0.0), high, max(int((high - low) * POINTS_PER_S), 50))
        step_s = float(phase[1] - phase[0])
        velocity = _smoothed(cls._expected(clock, "velocity", phase), step_s)
        force = cls._expected(clock, "force", phase) if cls._has(clock, "force") else np.zeros_like(velocity)
        speed = np.linalg.norm(velocity, axis=1)
        moving = np.flatnonzero(speed > MOVING * speed.max())
        if len(moving) < 5:
            raise TrainingError("the lessons show no motion to learn: the hand's expected speed is zero throughout")
        part = slice(moving[0], moving[-1] + 1)
        # the path is the integral of the expected VELOCITY: lessons end at different heights, and where the last states take
        # over from each other the expected position jumps between them although nothing moves
        position = cls._expected(clock, "position", phase)
        start = position[: max(moving[0], 1)].mean(axis=0)
        path = start + np.cumsum(velocity[part], axis=0) * step_s
        if end is not None:
            whole = path[-1] - start
            stretch = np.where(np.abs(whole) > 0.01, (end - start) / np.where(np.abs(whole) > 0.01, whole, 1.0), 1.0)
            path = start + (path - start) * np.clip(stretch, 0.5, 2.0)
        # F is what the partner does beyond carrying his share: at rest nothing, so offsets of a sensor are not expected again
        felt = _smoothed(force, step_s)[part]
        return cls(path, felt - np.linspace(felt[0], felt[-1], len(felt)), step_s)

    @classmethod
    def minimum_jerk(cls, like: PhaseReference) -> PhaseReference:
        """A baseline: from the same start to the same end in the same time, minimum jerk, no force expected."""
        s = np.linspace(0.0, 1.0, len(like.position))[:, None]
        shape = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
        path = like.position[0] + shape * (like.position[-1] - like.position[0])
        return cls(path, np.zeros_like(path), like.step_s)

    @staticmethod
    def _has(clock: Gmm, group: str) -> bool:
        return any(c.startswith(group + ".") for c in clock.channels)

    @staticmethod
    def _expected(clock: Gmm, group: str, phase: Array) -> Array:
        return regress(clock, PHASE, group, phase[:, None], weights="mixture-with-priors").mean

    def at(self, table: Array, phase_s: float) -> Array:
        """A row (d,) of `position`, `velocity` or `force` between the table's points; held outside."""
        place = min(max(phase_s / self.step_s, 0.0), float(self._last))
        n = min(int(place), self._last - 1)
        share = place - n
        return np.asarray((1.0 - share) * table[n] + share * table[n + 1])

    def floats_at(self, name: str, phase_s: float) -> list[float]:
        """As `at`, of the table "position", "velocity" or "force", in plain floats."""
        place = min(max(phase_s / self.step_s, 0.0), float(self._last))
        n = min(int(place), self._last - 1)
        share = place - n
        rows = self._rows[name]
        return [(1.0 - share) * a + share * b for a, b in zip(rows[n], rows[n + 1], strict=True)]

    def closest(self, position: Array, near_s: float, reach_s: float = 0.15) -> float:
        """Phase [s] whose expected position is closest to `position` (d,), searched within `reach_s` of `near_s`."""
        low = max(int((near_s - reach_s) / self.step_s), 0)
        high = min(int((near_s + reach_s) / self.step_s) + 2, self._last + 1)
        low = min(low, high - 1)
        apart = self.position[low:high] - position
        apart *= apart
        total = apart[:, 0]
        for n in range(1, apart.shape[1]):  # axis by axis, as the compiled tick adds them
            total += apart[:, n]
        return (low + int(total.argmin())) * self.step_s

    def nearest(self, position: Array) -> float:
        """Phase [s] whose expected position is closest to `position` (d,), wherever it is."""
        return self.closest(position, 0.5 * self.duration_s, self.duration_s)


def _smoothed(table: Array, step_s: float) -> Array:
    """Moving average (N, d) under a Hann window of SMOOTHING_S; what lies beyond the ends continues them."""
    half = max(int(0.5 * SMOOTHING_S / step_s), 1)
    window = np.hanning(2 * half + 3)[1:-1]
    window /= window.sum()
    padded = np.concatenate([np.repeat(table[:1], half, axis=0), table, np.repeat(table[-1:], half, axis=0)])
    return np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=1)
