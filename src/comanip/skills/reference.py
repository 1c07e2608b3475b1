"""What the lessons lead us to expect along the task: position, velocity and force over phase."""

from __future__ import annotations

from bisect import bisect_right
from copy import copy

import numpy as np

from ..errors import TrainingError
from ..interfaces import Array
from ..models.clock import PHASE
from ..models.gmm import Gmm
from ..models.gmr import regress
from ..models.taught_path import MOVING, POINTS_PER_S, TaughtPath
from ..signals.vectors import length

SMOOTHING_S = 0.5  # a few Gaussians over phase make a staircase of speeds; nobody lifts in steps
RESTING = 0.05  # share of the top speed below which the task rests
INTERVENES_M_PER_S = 0.06  # V0: what it costs to correct by so much is what it costs to be one spread off
LEAST_SPREAD_M = 0.003  # a few lessons agree by chance
GAINS_PER_S = (2.0, 10.0)  # a delay of 50 ms bears no more, and less would not come to the end
AT_START = 0.08  # share of the extent: who begins so near to where lessons began, begins where they did
AS_NEAR = 0.15  # share of the extent: parts of the path that lie so near to the nearest one are as near
PLACE_M, PLACE, PLACES = 0.04, 0.25, 200  # so near, or this share of the extent, is the same place; so many are looked at


class PhaseReference:
    """A table over the MOVING part of the task; rest before and after is left out, so phase 0 is where motion begins.

    duration_s   of the usual motion [s]
    position, velocity, force   (N, d) at N equal steps of phase; velocity is d position / d phase
    way          (N,) length of the path up to each row [m]; extent_m, how far from its start it ever leads
    spread       (N,) how far lessons lay from it [m]
    gain         (N,) how firmly it is tracked there, beside the law's attraction; 1 unless `tracked` says more
    slack_m      how much earlier than this the shortest lesson ended, along the last of the way
    """

    def __init__(
        self, position: Array, force: Array, step_s: float, *, spread: Array | None = None, ends: Array | None = None
    ) -> None:
        self.position, self.force, self.step_s = np.ascontiguousarray(position), np.ascontiguousarray(force), step_s
        self.duration_s = step_s * (len(position) - 1)
        self.velocity = np.gradient(self.position, step_s, axis=0)
        self.velocity[[0, -1]] = 0.0
        self.way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.position, axis=0), axis=1))])
        self.length_m = float(self.way[-1])
        self.extent_m = float(np.linalg.norm(self.position - self.position[0], axis=1).max())
        self.place_m = max(PLACE_M, PLACE * self.extent_m)
        self.top_speed = float(np.linalg.norm(self.velocity, axis=1).max())
        self.spread = np.zeros(len(position)) if spread is None else spread
        self.gain = np.ones(len(position))
        self._last = len(position) - 1
        # the same tables as floats: of one or two axes Python's own arithmetic takes a fifth of numpy's time
        self._rows = {"position": self.position.tolist(), "velocity": self.velocity.tolist(), "force": self.force.tolist()}
        self._way, self._gain = self.way.tolist(), self.gain.tolist()
        self.slack_m = (
            0.0 if ends is None else max(0.0, float(((self.position[-1] - ends) @ self.heading(self.duration_s)).max()))
        )

    @classmethod
    def taught(cls, path: TaughtPath) -> PhaseReference:
        """The path that the lessons share."""
        return cls(path.position, path.force, path.step_s, spread=path.spread, ends=path.ends)

    @classmethod
    def learned(cls, clock: Gmm, end: Array | None = None) -> PhaseReference:
        """What GMR from the clock's phase expects, for skills that store no path; `end` (d,) [m] is lessons' mean end.

        A few Gaussians over phase: good for one way there, smoother than was taught at corners, and without cycles.
        """
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
        if end is not None:  # by an addition along the way: a factor on net displacement has no meaning where a path returns
            way = np.cumsum(speed[part])
            path += (way / way[-1])[:, None] * (end - path[-1])
        # F is what the partner does beyond carrying a share: at rest nothing, so offsets of a sensor are not expected again
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

    def tracked(self, attraction_per_s: float) -> PhaseReference:
        """The same path under minimal intervention (LQT): firm where lessons agreed, compliant where they differed.

        The tracking error e of a hand that is sent at velocity u, de/dt = -u, is to cost the least of

            J = integral of e^2 / spread(s)^2 + u^2 / V0^2 ds        u = lambda(s) e,   lambda = V0^2 P
            -dP/ds = 1 / spread^2 - V0^2 P^2                         (Riccati, backward from where it rests at the end)

        Raises TrainingError where lessons do not say how far they differ.
        """
        if not self.spread.any():
            raise TrainingError("law 'lqt' needs lessons that differ, and the skill does not say how far: learn it from several")
        other = copy(self)
        other.gain = _riccati(np.maximum(self.spread, LEAST_SPREAD_M), self.step_s) / attraction_per_s
        other._gain = other.gain.tolist()
        return other

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

    def gone_m(self, phase_s: float) -> float:
        """Length of the path up to `phase_s` [s], [m]."""
        place = min(max(phase_s / self.step_s, 0.0), float(self._last))
        n = min(int(place), self._last - 1)
        share = place - n
        return (1.0 - share) * self._way[n] + share * self._way[n + 1]

    def remaining_m(self, phase_s: float) -> float:
        """Length of the path from `phase_s` [s] to its end [m]."""
        return self.length_m - self.gone_m(phase_s)

    def gain_at(self, phase_s: float) -> float:
        """`gain` between the table's points."""
        place = min(max(phase_s / self.step_s, 0.0), float(self._last))
        n = min(int(place), self._last - 1)
        share = place - n
        return (1.0 - share) * self._gain[n] + share * self._gain[n + 1]

    def heading(self, phase_s: float, ahead_m: float | None = None) -> Array:
        """Direction (d,) of the path over the `ahead_m` after `phase_s` (default: a tenth of the extent); at its end its last."""
        ahead_m = 0.1 * self.extent_m if ahead_m is None else ahead_m
        now = min(self.gone_m(phase_s), self.length_m - ahead_m)
        way = [there - here for here, there in zip(self._along(now), self._along(now + ahead_m), strict=True)]
        size = max(length(way), 1e-300)
        return np.array([part / size for part in way])

    def _along(self, way_m: float) -> list[float]:
        """Where the path is (d,) after `way_m` [m] of it; held outside."""
        rows, way = self._rows["position"], self._way
        if way_m >= way[-1]:
            return rows[-1]
        if way_m <= way[0]:
            return rows[0]
        n = bisect_right(way, way_m) - 1
        share = (way_m - way[n]) / (way[n + 1] - way[n])
        return [(1.0 - share) * a + share * b for a, b in zip(rows[n], rows[n + 1], strict=True)]

    def _distances(self, position: Array, low: int = 0, high: int | None = None) -> Array:
        """Squared, of the rows from `low` to `high`; axis by axis, as the compiled tick adds them."""
        apart = self.position[low:high] - position
        apart *= apart
        total = apart[:, 0]
        for n in range(1, apart.shape[1]):
            total += apart[:, n]
        return total

    def closest(self, position: Array, near_s: float, reach_s: float = 0.15) -> float:
        """Phase [s] whose expected position is closest to `position` (d,), searched within `reach_s` of `near_s`."""
        low = max(int((near_s - reach_s) / self.step_s), 0)
        high = min(int((near_s + reach_s) / self.step_s) + 2, self._last + 1)
        low = min(low, high - 1)
        return (low + int(self._distances(position, low, high).argmin())) * self.step_s

    def that_way(self, position: Array, velocity: Array) -> Array:
        """(d,) [m/s] Along `velocity`, as fast as lessons went that way within `place_m` of `position`, at any time."""
        every, speed = 1 + len(self.way) // PLACES, length(velocity.tolist())
        if speed < 1e-6:
            return np.zeros(len(position))
        far, along = np.zeros(-(-len(self.way) // every)), np.zeros(-(-len(self.way) // every))
        for i, v in enumerate(velocity.tolist()):
            off = self.position[::every, i] - position[i]
            far, along = far + off * off, along + self.velocity[::every, i] * v
        fastest = max(float(np.max(along, where=far < self.place_m * self.place_m, initial=0.0)), 0.0)
        return velocity * (fastest / (speed * speed))

    @property
    def longest_rest_s(self) -> float:
        """The longest rest in the middle [s]."""
        still = np.linalg.norm(self.velocity, axis=1)[1:-1] < RESTING * self.top_speed
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int))).reshape(-1, 2)
        inside = [high - low for low, high in edges if low > 0 and high < len(still)]
        return float(max(inside, default=0) * self.step_s)

    def outside_m(self, position: Array) -> float:
        """How far `position` (d,) lies from the nearest point of the path [m]."""
        return float(np.sqrt(self._distances(position)).min())

    @property
    def begins_m(self) -> float:
        """Who begins so near to where lessons began, begins where they did."""
        return max(AT_START * self.extent_m, 3.0 * float(self.spread[0]))

    def entry(self, position: Array, last_s: float | None = None) -> float:
        """Phase [s] at which to enter from rest at `position` (d,): the nearest point of the path.

        Of parts that are as near (a path that returns, crosses itself or repeats) the first, or, to go on after an interruption,
        the one nearest along the way to the phase `last_s` [s] where it was.
        """
        apart = np.sqrt(self._distances(position))
        if last_s is None and apart[0] <= self.begins_m:
            return 0.0
        near = apart <= apart.min() + AS_NEAR * self.extent_m
        edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
        parts = [low + int(apart[low:high].argmin()) for low, high in edges.reshape(-1, 2)]
        if last_s is None:
            return parts[0] * self.step_s
        was = self.length_m - self.remaining_m(last_s)
        return float(min(parts, key=lambda n: abs(self._way[n] - was)) * self.step_s)


def _riccati(spread: Array, step_s: float) -> Array:
    """lambda (N,) [1/s] of `PhaseReference.tracked`: implicit, so that a firm part needs no finer steps."""
    firm = INTERVENES_M_PER_S / spread  # what it comes to where the spread does not change
    gain = np.empty(len(spread))
    gain[-1] = firm[-1]
    for n in range(len(spread) - 2, -1, -1):  # lambda_n + h lambda_n^2 = lambda_(n + 1) + h firm^2
        known = gain[n + 1] + step_s * firm[n] ** 2
        gain[n] = 2.0 * known / (1.0 + np.sqrt(1.0 + 4.0 * step_s * known))
    return np.clip(gain, *GAINS_PER_S)


def _smoothed(table: Array, step_s: float) -> Array:
    """Moving average (N, d) under a Hann window of SMOOTHING_S; what lies beyond the ends continues them."""
    half = max(int(0.5 * SMOOTHING_S / step_s), 1)
    window = np.hanning(2 * half + 3)[1:-1]
    window /= window.sum()
    padded = np.concatenate([np.repeat(table[:1], half, axis=0), table, np.repeat(table[-1:], half, axis=0)])
    return np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=1)
