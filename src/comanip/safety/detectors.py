"""What the envelope watches in the force while its skill runs: each a small memory that answers one question, per tick.

`LetGo` is the partner's hand gone?  `Missing` and where the object weighs nothing along the axes?  `Sinking` how far down with a
partner who carries too little?  `Pushed` for how much work with more force than anybody leads with?  `Stuck` does the sensor
repeat itself?  `Jump` did its zero move?  `Shaking` how strongly does the force oscillate?  Forces are vectors: no answer depends
on how the axes are turned.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from math import inf, isfinite, nan, pi

from ..interfaces import STANDARD_GRAVITY
from ..signals.exponential import exponential
from ..signals.vectors import apart, dot, length

WEIGHED_TICKS = 25
STILL_S = 0.15  # what nobody pulls stays the same over this; a person who pulls down goes on to more or to less
SWING_S = 0.1  # an object that is let go swings on the wrist, at 10 Hz: the mean of one swing is its weight;
SLOW_SWING_S = 0.16  # on a softer wrist at 6 Hz
QUIET_S = 0.5  # over which a force's ordinary change from sample to sample is known
SAME = (0.7, 1.3)  # a zero that moved stays where it is: so much of the jump is still there afterwards
ANSWER_N = 0.7  # by which the softest arm's pull changes within the 1.6 cm that a hand gives way, 60 N/m
LIGHT_N = 1.25  # a share that weighs less is none: where nothing weighs along the axes, this is a sensor's bias, up to 1 N
HANGS_N = 4.0  # below this a partner's arm, dragged along at 0.1 m/s, pulls as much as the object weighs: only what sinks tells
ALONE_SHARE = 0.35  # of its share: within this of carrying all alone, where that is less than `alone_n`
LACKS = (0.02, 0.12)  # of the partner's share: who carries less by so much begins to count as letting go, and counts wholly;
TURNS = (0.15, 0.3)  # so long after the hand went up as fast as this, the partner may be turning back
TURNS_S, LED_UP_M_S = 2.0, 0.05
LED_DOWN = 2.0  # times as fast as taught, at most, while the partner lacks no more than
HELPS, LETS = 0.5, 0.9  # of that share; from the second on it is no leading down
PULLS, LACK_PEAK_S = 0.3, 4.0  # so much of that share was a pull, and is remembered so long
YIELDS, PEAK_S = 0.8, 0.5  # of a push's peak, which is forgotten within so long
ZERO_TICKS = 50  # of rest, over which a bias is known
PULL_S = 0.06  # over which a pull is averaged: sensors are as noisy as 0.5 N
LED_ALONE_N, LED_ALONE_S = 0.6, 0.25  # a hand that leads and meets less for so long leads nobody: an arm gives 1.2 N at 0.08 m/s
AGAIN_S = 0.1  # somebody carries again, for so long: what was sunk is forgotten
DRAGGED_M_S, DIFFERS_M_S = 0.02, 0.01  # slower than this friction says little; a spread of speeds from which a damper is known
FORGOTTEN_S = 1.5  # a resistance longer ago tells nothing of now
TOLD_N, TOLD_S, UNTOLD_N = 0.8, 0.1, 2.0  # so near, over so long, is told; before anything is known it is not
RUBS = 0.5  # of the weight: friction is less
LIVELY = 8  # changes of a reading before it is known as one that never repeats itself:
FINE = 0.25  # its smallest change is less than this of the mean one; steps of a coarse sensor are all as large


def _mean(rows: Iterable[Sequence[float]]) -> list[float]:
    return [dot(values, [1.0] * len(values)) / len(values) for values in zip(*rows, strict=True)]


AGAIN = (1.0, 3.0, 20.0)  # times as long, with a partner whose pull was taken for nobody's never, once, more often before


class Drag:
    """What resists the hand as if by friction and a damper, -F along the motion = c + b |v|: fitted as it goes, and forgotten.

    An arm led up at 0.1 m/s by a stiff shoulder pulls as much as the object weighs, but by how fast it goes; of nobody the weight
    stays the same. The fit `explains` what is felt where it had told it all of the last tenth of a second, and tells of a hand
    that hardly moves less than most of the weight.
    """

    def __init__(self) -> None:
        self.ticks, self.speeds, self.squares, self.pulls, self.products = 0.0, 0.0, 0.0, 0.0, 0.0  # sums that fade
        self.error = UNTOLD_N

    def step(self, force: Sequence[float], velocity: Sequence[float], period: float) -> None:
        """Of one tick's F [N] and v [m/s]."""
        speed = length(velocity)
        if speed < DRAGGED_M_S:
            return
        told = self.at(speed)
        beside = length([f + told * (v / speed) for f, v in zip(force, velocity, strict=True)])
        self.error += min(period / TOLD_S, 1.0) * (beside - self.error)
        against, keep = -dot(force, velocity) / speed, max(1.0 - period / FORGOTTEN_S, 0.0)
        self.ticks = keep * self.ticks + 1.0
        self.speeds = keep * self.speeds + speed
        self.squares = keep * self.squares + speed * speed
        self.pulls = keep * self.pulls + against
        self.products = keep * self.products + speed * against

    def at(self, speed: float) -> float:
        """The resistance [N] at `speed` [m/s]: the mean one, whatever the speed, as long as speeds hardly differed."""
        if self.ticks == 0.0:
            return 0.0
        mean, pull = self.speeds / self.ticks, self.pulls / self.ticks
        varies = self.squares / self.ticks - mean * mean
        if varies < DIFFERS_M_S * DIFFERS_M_S:
            return pull
        return pull + (self.products / self.ticks - mean * pull) / varies * (speed - mean)

    def explains(self, load: float) -> bool:
        """Whether what is felt is this, with an object that weighs `load` [N] on the hand."""
        return self.error < TOLD_N and self.at(0.0) < RUBS * load


class LetGo:
    """Whether this hand carries the whole object alone, however slowly the partner let go.

    It weighs its share at rest, while both hold. Where the partner has let go F = -s m (g + a): the hand then carries twice its
    share, and nothing else pulls. Nothing may answer the hand's motion: against a wall it stands, and is pushed by turns more
    and less. Who pulls down by just that much is not told from nobody here: the hand gives way and feels whether that is answered
    (`Envelope._feel`). After it was mistaken once, what a `Drag` explains is somebody.

    alone_n     within this of carrying it all, the partner's end is free
    alone_s     for so long
    steady_n_s  no faster than this does the pull of nobody change [N/s] while the hand stands,
    stands_m_s  slower than this
    """

    def __init__(self, n_axes: int, dt: float, *, alone_n: float, alone_s: float, steady_n_s: float, stands_m_s: float) -> None:
        self._alone_n, self._alone_s, self._stands_m_s = alone_n, alone_s, stands_m_s
        self._most_apart_n = STILL_S * steady_n_s
        self.weight, self._weighed = [0.0] * n_axes, 0
        self._swing = max(round(SWING_S / dt), 1)
        self._pulls: deque[list[float]] = deque(maxlen=max(round(SLOW_SWING_S / dt), 1))
        self._before: deque[list[float]] = deque(maxlen=1 + max(round(STILL_S / dt), 1))
        self._for_s, self.was_mistaken = 0.0, 0

    def weigh(self, sensed: list[float], force: list[float], acceleration: list[float], at_rest: bool) -> None:
        """One good sample of F_s, F [N] and a [m/s^2]: of the object's weight, and once that is known of the partner's pull."""
        if self._weighed < WEIGHED_TICKS:
            if at_rest and all(map(isfinite, sensed)):
                self._weighed += 1
                loads = [f_s - f for f_s, f in zip(sensed, force, strict=True)]
                self.weight = [w + (load - w) / self._weighed for w, load in zip(self.weight, loads, strict=True)]
            return
        held = zip(force, self.weight, acceleration, strict=True)
        self._pulls.append([f - w * (1.0 + a / STANDARD_GRAVITY) for f, w, a in held])

    @property
    def load(self) -> float:
        """What the hand's share weighs [N]; 0 before that is known."""
        return length(self.weight) if self._weighed >= WEIGHED_TICKS else 0.0

    @property
    def weighs(self) -> bool:
        """Whether the load is not known yet."""
        return self._weighed < WEIGHED_TICKS

    def step(self, speed: float, period: float, dragged: bool = False) -> bool:
        """`dragged`: it is known that somebody resists who pulls so much at this speed."""
        load = self.load
        alone = False
        if load > HANGS_N and len(self._pulls) == self._pulls.maxlen:
            pull, slow = _mean([*self._pulls][-self._swing :]), _mean(self._pulls)
            self._before.append(pull)
            near = min(self._alone_n, ALONE_SHARE * load)
            moves, still = speed > self._stands_m_s, apart(self._before[0], pull) < self._most_apart_n
            # on a softer wrist only the longer mean shows the weight; there a wall would show it too, so the hand must move
            alone = (length(pull) < near and still) or (length(slow) < near and moves and still)
        self._for_s = self._for_s + period if alone and not dragged else 0.0
        return self._for_s > AGAIN[min(self.was_mistaken, 2)] * self._alone_s

    def mistaken(self) -> None:
        """It was somebody who pulls down by about the weight, as an arm does that is led up with a light object: from now on this
        must last longer."""
        self.was_mistaken += 1

    def forget(self) -> None:
        """What was pulled so far; not the weight."""
        self._pulls.clear()
        self._before.clear()
        self._for_s = 0.0

    def pull(self) -> list[float]:
        """What the partner pulled of late, mean over one swing of the object [N]."""
        return _mean([*self._pulls][-self._swing :])

    def nobody_pulls(self, before: Sequence[float]) -> bool:
        """Still alone after the hand gave way from where the pull was `before`: a person's changes with the way. Who was still
        letting go has gone since, so what is nearer to nobody's pull is no answer."""
        pull, near = self.pull(), min(self._alone_n, ALONE_SHARE * self.load)
        return length(pull) < near and (apart(pull, before) < ANSWER_N or length(pull) < length(before))


class Missing:
    """Whether nobody holds the other end any more, where the object weighs nothing along the axes.

    A hand that leads is resisted: F against the motion, by an arm's damping. Where the partner is gone nothing is left but the
    object's own inertia, F = -(1 - s) m a, and the sensor's bias. The bias is what is felt at rest, before anything has moved;
    s m a is F - F_s, whatever the mass: `pull` [N] is 2 F - F_s without the bias, mean over `PULL_S`.

    A hand that is led gently is pulled by as little as nobody pulls: there F itself must be next to nothing, and somebody must
    have been there in this motion. A hand that leads must have `met` somebody since it began.
    """

    def __init__(
        self, n_axes: int, *, nobody_n: float, nobody_s: float, held_n: float, fast_m_per_s: float, moving_m_per_s: float,
        bias_n: float,
    ) -> None:  # fmt: skip
        """`bias_n`: more than this at rest is somebody who pulls."""
        self._nobody_n, self._nobody_s, self._held_n, self._bias_n = nobody_n, nobody_s, held_n, bias_n
        self._fast_m_per_s, self._moving_m_per_s = fast_m_per_s, moving_m_per_s
        self.zero, self.pull, self.known = [0.0] * n_axes, [0.0] * n_axes, 0.0
        self.held, self.met, self.alone_s, self.mistakes = False, False, 0.0, 0.0

    def step(self, sensed: Sequence[float], force: Sequence[float], speed: float, leads: float, period: float) -> bool:
        """Of one tick's F_s, where it is a number, and F [N]; `leads`: 1 where the skill goes by itself, all of it."""
        size = length(force)
        felt = [2.0 * f - s if isfinite(s) else f for s, f in zip(sensed, force, strict=True)]
        if speed < self._moving_m_per_s:
            self.held = False
            if self.known < ZERO_TICKS and 0.0 < size < self._bias_n:  # 0: the force is not known yet
                self.known += 1.0
                self.zero = [z + (f - z) / self.known for z, f in zip(self.zero, felt, strict=True)]
        share = min(period / PULL_S, 1.0)
        self.pull = [p + share * (f - z - p) for p, f, z in zip(self.pull, felt, self.zero, strict=True)]
        if leads >= 1.0:
            nobody, lasts = length(self.pull) < LED_ALONE_N, LED_ALONE_S * AGAIN[min(int(self.mistakes), 2)]
        else:
            nobody, lasts = size < self._nobody_n, self._nobody_s
        self.held, self.met = self.held or size > self._held_n, self.met or size > self._held_n
        gone = nobody and (self.met if leads >= 1.0 else self.held)
        self.alone_s = self.alone_s + period if gone and speed > self._fast_m_per_s else 0.0
        return self.alone_s > lasts

    def mistaken(self) -> None:
        """Somebody answered the hand that stopped, as who goes along by themselves do: next time this must last longer."""
        self.held, self.met, self.alone_s, self.mistakes = False, False, 0.0, self.mistakes + 1.0


class Sinking:
    """How far the hand went down [m], `sunk`, while the partner carried less than a fair share and did not pull down more than
    nobody would: who lets go slowly, or hangs something on the object, goes through here, and so does who leads down gently.
    A few centimetres tell them apart: the partner pulls harder, or carries again.

    Who turns back has just led up, and leads on with a little less than that share; from rest as much is counted more. Where
    lessons went down the hand goes down with a partner who carries half of it: `led` [m/s] is how fast, and does not count.
    """

    def __init__(self, alone_n: float) -> None:
        self._alone_n = alone_n
        self.sunk, self._peak, self._again_s, self._since_up_s, self.led = 0.0, 0.0, inf, inf, 0.0

    @property
    def hangs(self) -> bool:
        """Whether the partner carries too little just now, or did a moment ago."""
        return self._again_s < AGAIN_S

    def step(
        self,
        weight: Sequence[float],
        load: float,
        force: Sequence[float],
        velocity: Sequence[float],
        taught: Sequence[float],
        period: float,
    ) -> None:
        """`taught` [m/s]: how fast lessons went where the hand is."""
        if load <= LIGHT_N:
            return
        more, down = dot(force, weight) / (load * load), dot(velocity, weight) / load  # along gravity; more in shares
        self._since_up_s = 0.0 if down < -LED_UP_M_S else self._since_up_s + period
        least, whole = TURNS if self._since_up_s < TURNS_S else LACKS
        self._peak = max(more, self._peak - period / LACK_PEAK_S * self._peak)
        answers = self._peak > PULLS and more < YIELDS * self._peak  # a person's pull, which falls as the hand follows
        doubtful = more < 1.0 + self._alone_n / load and not answers
        counts = min(max((more - least) / (whole - least), 0.0), 1.0) if doubtful else 0.0
        self._again_s = 0.0 if counts > 0.0 else self._again_s + period
        self.led = LED_DOWN * max(dot(taught, weight) / load, 0.0) * min(max((LETS - more) / (LETS - HELPS), 0.0), 1.0)
        self.sunk = self.sunk + counts * max(down - self.led, 0.0) * period if self.hangs else 0.0


class Pushed:
    """Work [J] of a force along the motion that does not fall though the hand yields; `work` is the latest.

    Whoever leads a hand that yields pulls less as it follows. A sensor that lies, or a weight, does not.
    """

    def __init__(self, usual_n: float) -> None:
        self._usual_n = usual_n
        self.work, self._peak = 0.0, 0.0

    def step(self, force: Sequence[float], velocity: Sequence[float], period: float) -> None:
        speed = length(velocity)
        along = dot(force, velocity) / speed if speed > 0.0 else 0.0
        self._peak = max(along, self._peak - period / PEAK_S * self._peak)
        beyond = along - self._usual_n if along > YIELDS * self._peak else -self._usual_n
        self.work = max(self.work + beyond * speed * period, 0.0)


class Stuck:
    """Whether the readings of a force sensor stand still, axis by axis: each axis is a sensor of its own.

    One whose readings differ by ever new amounts never repeats itself, moving or at rest. One with coarse steps or a dead band
    does so rightly, but not over a whole motion.
    """

    def __init__(self, n_axes: int, stuck_s: float, stuck_m: float) -> None:
        self._stuck_s, self._stuck_m = stuck_s, stuck_m
        self.last = [inf] * n_axes
        self.same_s, self._same_m = [0.0] * n_axes, [0.0] * n_axes
        self._changes, self._least, self._usual = [0.0] * n_axes, [inf] * n_axes, [0.0] * n_axes
        self._dead = [nan] * n_axes  # what it said while it stood before: the middle of a dead band

    def step(self, readings: Sequence[float], speed: float, period: float) -> bool:
        """Of one tick's readings [N], at this speed [m/s]."""
        stuck = False
        for i, reading in enumerate(readings):
            change, self.last[i] = abs(reading - self.last[i]), reading
            if change == 0.0:
                self.same_s[i] += period
                self._same_m[i] += speed * period
                fine = self._changes[i] >= LIVELY and self._least[i] < FINE * self._usual[i] and reading != self._dead[i]
                stuck = stuck or self._same_m[i] > self._stuck_m or (fine and self.same_s[i] > self._stuck_s + 1e-9)
                if not fine and self.same_s[i] > 0.5 * self._stuck_s:
                    self._dead[i] = reading
                continue
            self.same_s[i] = self._same_m[i] = 0.0
            if isfinite(change):
                self._changes[i] += 1.0
                self._least[i] = min(self._least[i], change)
                self._usual[i] += (change - self._usual[i]) / min(self._changes[i], 100.0)
        return stuck


class Jump:
    """How far the zero of a force sensor moved at rest [N]: from one sample to the next, and for good. No person does that."""

    def __init__(self, n_axes: int, least_n: float, rest_s: float, stays_s: float) -> None:
        self._least_n, self._rest_s, self._stays_s = least_n, rest_s, stays_s
        self.last = [nan] * n_axes
        self._usual, self._heard_s, self._still_s = 0.0, 0.0, 0.0
        self.pending: tuple[list[float], list[float]] | None = None  # the reading before, and the jump
        self._sum: list[float] = []
        self._count, self._for_s = 0, 0.0

    def step(self, sensed: list[float], at_rest: bool, period: float) -> float:
        """Of one tick; a reading equal to the last one is the same sample, of a sensor slower than the ticks."""
        last = self.last
        if not all(map(isfinite, sensed)):
            return 0.0
        if not all(map(isfinite, last)):
            self.last = sensed
            return 0.0
        if self.pending is not None:
            self.last = sensed
            return self._confirmed(sensed, period)
        still, self._still_s = self._still_s, self._still_s + period if at_rest else 0.0
        change = apart(sensed, last)
        if change == 0.0:
            return 0.0
        self.last = sensed
        self._heard_s = min(self._heard_s + period, max(QUIET_S, period))
        if still > self._rest_s and change > self._least_n + 6.0 * self._usual:
            self.pending, self._sum = (last, [a - b for a, b in zip(sensed, last, strict=True)]), [0.0] * len(sensed)
            self._count, self._for_s = 0, 0.0
        share = period / self._heard_s if period > 0.0 else 0.0  # a mean at first, then one that forgets
        self._usual += share * (change - self._usual)
        return 0.0

    def _confirmed(self, sensed: list[float], period: float) -> float:
        assert self.pending is not None
        self._sum = [total + f for total, f in zip(self._sum, sensed, strict=True)]
        self._count, self._for_s = self._count + 1, self._for_s + period
        if self._for_s < self._stays_s:
            return 0.0
        before, jump = self.pending
        self.pending, self._still_s = None, 0.0
        moved = [total / self._count - b for total, b in zip(self._sum, before, strict=True)]
        size = length(jump)
        return size if SAME[0] < dot(moved, jump) / (size * size) < SAME[1] else 0.0


class Shaking:
    """Amplitude [N] of what oscillates above 1 Hz; `amplitude` is the latest."""

    def __init__(self, n_axes: int) -> None:
        self._slow, self._mean, self.amplitude = [0.0] * n_axes, 0.0, 0.0

    def step(self, force_n: Sequence[float], period: float) -> None:
        share = 1.0 - exponential(-2.0 * pi * period)
        self._slow = [slow + share * (f - slow) for f, slow in zip(force_n, self._slow, strict=True)]
        self._mean += min(period / 0.5, 1.0) * (apart(force_n, self._slow) - self._mean)
        self.amplitude = 1.57 * self._mean  # mean |sin| is amplitude / 1.57
