"""What the envelope watches in the force while its skill runs: each a small memory that answers one question, per tick.

`LetGo` is the partner's hand gone?  `Jump` did the sensor's zero move?  `Shaking` how strongly does the force oscillate?
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from math import exp, isfinite, pi

from ..interfaces import STANDARD_GRAVITY
from ..signals.vectors import apart, dot, length

WEIGHED_TICKS = 25
SWING_S = 0.1  # an object that is let go swings on the wrist, at 10 Hz: the mean of one swing is its weight;
SLOW_SWING_S = 0.16  # on a softer wrist at 6 Hz
QUIET_S = 0.5  # over which a force's ordinary change from sample to sample is known
SAME = (0.7, 1.3)  # a zero that moved stays where it is: so much of the jump is still there afterwards


def _mean(rows: Iterable[Sequence[float]]) -> list[float]:
    return [dot(values, [1.0] * len(values)) / len(values) for values in zip(*rows, strict=True)]


class LetGo:
    """Whether this hand carries the whole object alone.

    It weighs its share at rest, while both hold. Where the partner lets go F = -s m (g + a): the hand then carries twice its
    share, and nothing else pulls. He must be gone at once (who pulls down harder and harder passes through the same force), and
    nothing may answer the hand's motion: against a wall it stands, and is pushed by turns more and less.

    alone_n     within this of carrying it all, the partner's end is free
    alone_s     for so long
    sudden_s    within this his pull went
    steady_n_s  no faster than this does the pull of nobody change [N/s] while the hand stands,
    stands_m_s  slower than this
    least_n     an object whose share weighs less says nothing
    """

    def __init__(
        self,
        n_axes: int,
        dt: float,
        *,
        alone_n: float,
        alone_s: float,
        sudden_s: float,
        steady_n_s: float,
        stands_m_s: float,
        least_n: float,
    ) -> None:
        self._alone_n, self._alone_s, self._sudden_s, self._least_n = alone_n, alone_s, sudden_s, least_n
        self._stands_m_s = stands_m_s
        self._most_apart_n, self._apart = SWING_S / 2.0 * steady_n_s, max(round(SWING_S / 2.0 / dt), 1)
        self.weight, self._weighed = [0.0] * n_axes, 0
        self._swing = max(round(SWING_S / dt), 1)
        self._pulls: deque[list[float]] = deque(maxlen=max(round(SLOW_SWING_S / dt), 1))
        self._before: deque[list[float]] = deque(maxlen=max(round(sudden_s / dt), 1))
        self._for_s, self._since_s = 0.0, float("inf")

    def weigh(self, sensed: list[float], force: list[float], acceleration: list[float], at_rest: bool) -> None:
        """One good sample of F_s, F [N] and a [m/s^2]: of the object's weight, and once that is known of the partner's pull."""
        if self._weighed < WEIGHED_TICKS:
            if at_rest and all(map(isfinite, sensed)):
                self._weighed += 1
                self.weight = [w + (f - w) / self._weighed for w, f in zip(self.weight, sensed, strict=True)]
            return
        held = zip(force, self.weight, acceleration, strict=True)
        self._pulls.append([f - w * (1.0 + a / STANDARD_GRAVITY) for f, w, a in held])

    def step(self, speed: float, period: float) -> bool:
        load = length(self.weight)
        alone = False
        if load > self._least_n and len(self._pulls) == self._pulls.maxlen:
            pull, slow = _mean([*self._pulls][-self._swing :]), _mean(self._pulls)
            self._before.append(pull)
            self._since_s = 0.0 if apart(self._before[0], pull) > 0.5 * load else self._since_s + period
            earlier = self._before[-1 - min(self._apart, len(self._before) - 1)]
            moves, steady = speed > self._stands_m_s, apart(earlier, pull) < self._most_apart_n
            sudden = self._for_s > 0.0 or self._since_s < 4.0 * self._sudden_s
            # on a softer wrist only the longer mean shows the weight; there a wall would show it too, so the hand must move
            nobody = length(pull) < self._alone_n and (moves or steady)
            alone = sudden and (nobody or (length(slow) < self._alone_n and moves))
        self._for_s = self._for_s + period if alone else 0.0
        return self._for_s > self._alone_s

    def nobody_pulls(self) -> bool:
        """Of late, whatever came before: less than half of what a partner carries."""
        return length(_mean(self._pulls)) < 0.5 * length(self.weight)


class Jump:
    """How far the zero of a force sensor moved at rest [N]: from one sample to the next, and for good. No person does that."""

    def __init__(self, n_axes: int, least_n: float, rest_s: float, stays_s: float) -> None:
        self._least_n, self._rest_s, self._stays_s = least_n, rest_s, stays_s
        self.last: list[float] = []
        self._usual, self._heard_s, self._still_s = [0.0] * n_axes, 0.0, 0.0
        self.pending: tuple[int, float, float] | None = None  # axis, reading before, size
        self._sum, self._count, self._for_s = 0.0, 0, 0.0

    def step(self, sensed: list[float], at_rest: bool, period: float) -> float:
        last, self.last = self.last, sensed
        if not last or not all(map(isfinite, [*sensed, *last])):
            return 0.0
        if self.pending is not None:
            return self._confirmed(sensed, period)
        self._heard_s = min(self._heard_s + period, max(QUIET_S, period))
        share = period / self._heard_s if period > 0.0 else 0.0  # a mean at first, then one that forgets
        for i, (new, old) in enumerate(zip(sensed, last, strict=True)):
            change = abs(new - old)
            if self._still_s > self._rest_s and change > self._least_n + 6.0 * self._usual[i]:
                self.pending, self._sum, self._count, self._for_s = (i, old, new - old), 0.0, 0, 0.0
            self._usual[i] += share * (change - self._usual[i])
        self._still_s = self._still_s + period if at_rest else 0.0
        return 0.0

    def _confirmed(self, sensed: list[float], period: float) -> float:
        assert self.pending is not None
        axis, before, size = self.pending
        self._sum, self._count, self._for_s = self._sum + sensed[axis], self._count + 1, self._for_s + period
        if self._for_s < self._stays_s:
            return 0.0
        self.pending = None
        share = (self._sum / self._count - before) / size
        return abs(size) if SAME[0] < share < SAME[1] else 0.0


class Shaking:
    """Amplitude [N] of what oscillates above 1 Hz; `amplitude` is the latest."""

    def __init__(self) -> None:
        self._slow = self._mean = self.amplitude = 0.0

    def step(self, force_n: float, period: float) -> None:
        self._slow += (1.0 - exp(-2.0 * pi * period)) * (force_n - self._slow)
        self._mean += min(period / 0.5, 1.0) * (abs(force_n - self._slow) - self._mean)
        self.amplitude = 1.57 * self._mean  # mean |sin| is amplitude / 1.57
