"""What a body does besides what it means to: sways, walks, coughs, tires, loses its grip. Joined to any mind.

A habit rewrites, each sub-step, what it adds: `hold` (share of the grip), `strength` (share of the pull toward where somebody
means to be), `push` (d,) [N] on the hand, `moved` and `moving` (d,) [m], [m/s]: how far the whole body has moved, `against`
(d,) [N]: what something else does to the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, exp, log, pi, sin, sqrt

import numpy as np

from .body import Body

HELD_S = 0.5  # robots weigh the object in the first 0.3 s


class Habit:
    """Nothing at all; those below differ. `event_s` is when what happens once happens; None draws it.

    Somebody who leads has it at a share of the course, drawn by whoever makes the person; somebody who follows cannot know when
    the other starts, so there it begins once the hand has been led so far.
    """

    hold, strength = 1.0, 1.0
    push: Sequence[float] | None = None
    moved: Sequence[float] | None = None
    moving: Sequence[float] | None = None
    against: Sequence[float] | None = None

    def __init__(self, body: Body, n_axes: int, event_s: float | None, rng: np.random.Generator) -> None:
        self.body, self.d, self.rng, self._stated_s = body, n_axes, rng, event_s
        self._after_m = float(rng.uniform(0.05, 0.12))
        self.draw()

    def draw(self) -> None:
        """What this person's habit is like, once and for all."""

    def reset(self) -> None:
        self.event_s = self._stated_s
        self.begin()

    def begin(self) -> None:
        """Forgets what was."""

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        """At `time` [s], object's end displaced by `x` (d,) [m] and moving at `v` (d,) [m/s]."""

    def since(self, time: float, x: Sequence[float]) -> float:
        """Time since the event [s]; negative before."""
        if self.event_s is None:
            if max(map(abs, x)) < self._after_m:
                return -1.0
            self.event_s = time
        return time - self.event_s

    def somewhere(self, upward: float = 0.0) -> list[float]:
        """(d,) unit vector drawn at random, or along the weight with probability `upward`."""
        if self.rng.uniform() < upward:
            return list(self.body.upward)
        direction = self.rng.standard_normal(self.d)
        return list((direction / np.linalg.norm(direction)).tolist())


class ReGrasps(Habit):
    """Opens the hand for 0.1-0.5 s, sometimes not wholly, and takes hold again where the object then is."""

    def draw(self) -> None:
        self.open_s, self.least = float(self.rng.uniform(0.1, 0.5)), float(max(0.0, self.rng.uniform(-0.3, 0.3)))

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        since = self.since(time, x)
        opening, closing = since / 0.06, (self.open_s - since) / 0.10 + 1.0
        share = min(max(min(opening, closing), 0.0), 1.0)
        self.hold = 1.0 - (1.0 - self.least) * share


class Releases(Habit):
    """Lets go for good, within 0.2-2 s. `event_s` is when the hand is open; somebody led begins to open it on the way.

    Nobody begins before `HELD_S`: while the object is weighed both hold it.
    """

    within = (0.2, 2.0)

    def draw(self) -> None:
        self.within_s = float(self.rng.uniform(*self.within))

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        if self.event_s is None and self.since(time, x) >= 0.0:
            self.event_s = time + self.within_s
        left = 1.0 if self.event_s is None else (self.event_s - time) / min(self.within_s, max(self.event_s - HELD_S, 0.05))
        self.hold = min(max(left, 0.0), 1.0)


class HandsOver(Habit):
    """Stops wanting: the pull toward the own goal fades within 0.8 s, and from then on the arm only carries and damps."""

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        since = self.since(time, x)
        self.strength = 1.0 - min(max(since / 0.8, 0.0), 1.0)
        damping = 10.0 * (1.0 - self.strength)
        self.push = [-damping * one for one in v]


class Tires(Habit):
    """Carries less and less of the weight, by up to a fifth, and trembles more: 0.2 to 0.8 N at 8 Hz after 10 s."""

    def draw(self) -> None:
        self.share, self.phase = float(self.rng.uniform(0.08, 0.2)), float(self.rng.uniform(0.0, 2.0 * pi))

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        tired = min(time / 10.0, 1.0)
        swing = tired * 0.5 * sin(2.0 * pi * 8.0 * time + self.phase)
        self.push = [c * -self.share * tired + u * swing for c, u in zip(self.body.carried_n, self.body.upward, strict=True)]


class _Swings(Habit):
    """The body moves to and fro, and the hand with it as far as the arm is stiff."""

    hertz, metres, upward = (0.3, 0.5), (0.003, 0.008), 0.0

    def draw(self) -> None:
        self.omega, self.size = 2.0 * pi * float(self.rng.uniform(*self.hertz)), float(self.rng.uniform(*self.metres))
        self.way, self.phase = self.somewhere(self.upward), float(self.rng.uniform(0.0, 2.0 * pi))

    def amplitude(self, time: float, x: Sequence[float], v: Sequence[float]) -> float:
        return min(time / 1.0, 1.0)

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        size, angle = self.size * self.amplitude(time, x, v), self.omega * time + self.phase
        self.moved = [w * size * sin(angle) for w in self.way]
        self.moving = [w * size * self.omega * cos(angle) for w in self.way]


class Sways(_Swings):
    """0.3-0.5 Hz, 3-8 mm at the hand, as people do who stand."""


class Walks(_Swings):
    """Carries while walking: the trunk bobs 4-10 mm at 1.7-2.2 Hz, mostly along the weight."""

    hertz, metres, upward = (1.7, 2.2), (0.004, 0.010), 0.8

    def amplitude(self, time: float, x: Sequence[float], v: Sequence[float]) -> float:
        """Bobs as it goes, and 0.4 s more."""
        going = 1.0 if max(map(abs, v)) > 0.03 else 0.0
        self.bob += 0.001 / 0.4 * (going - self.bob)
        return self.bob

    def begin(self) -> None:
        self.bob = 0.0


class Steps(Walks):
    """Shifts from foot to foot on the spot for 1.5-3 s: 3-6 mm at 1.3-1.8 Hz."""

    hertz, metres, upward = (1.3, 1.8), (0.003, 0.006), 0.3

    def draw(self) -> None:
        super().draw()
        self.lasts_s = float(self.rng.uniform(1.5, 3.0))

    def amplitude(self, time: float, x: Sequence[float], v: Sequence[float]) -> float:
        since = self.since(time, x)
        return min(max(min(since / 0.3, (self.lasts_s - since) / 0.3), 0.0), 1.0)


class _Jerks(Habit):
    """Half a sine of force, some times, 0.5 s apart."""

    times, newtons, lasts, upward = (1, 3), (4.0, 9.0), (0.15, 0.30), 0.5

    def draw(self) -> None:
        self.n = int(self.rng.integers(self.times[0], self.times[1] + 1))
        self.size, self.lasts_s = float(self.rng.uniform(*self.newtons)), float(self.rng.uniform(*self.lasts))
        self.way = self.somewhere(self.upward)

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        nth, within = divmod(self.since(time, x), self.lasts_s + 0.5)
        on = 0 <= nth < self.n and within < self.lasts_s
        size = self.size * sin(pi * within / self.lasts_s) if on else 0.0
        self.push = [w * size for w in self.way]


class Coughs(_Jerks):
    """One to three jerks of 4-9 N for 0.15-0.3 s."""


class Knocks(_Jerks):
    """Bumps against something: 8-16 N for 30-60 ms, once or twice."""

    times, newtons, lasts, upward = (1, 2), (8.0, 16.0), (0.03, 0.06), 0.2


class MeetsWall(Habit):
    """From the event on its end stands against something that is from as soft as a cushion to as hard as a table: 1-30 kN/m."""

    def draw(self) -> None:
        stiffness = exp(self.rng.uniform(log(1e3), log(3e4)))
        self.stiffness, self.damping = stiffness, 2.0 * float(self.rng.uniform(0.3, 1.0)) * sqrt(stiffness)

    def begin(self) -> None:
        self.against = None
        self._stands: list[float] | None = None

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        if self.since(time, x) < 0.0:
            return
        if self._stands is None:
            self._stands = list(x)
        self.against = [self.stiffness * (s - p) - self.damping * q for s, p, q in zip(self._stands, x, v, strict=True)]


class RestsElbow(Habit):
    """The forearm lies on the object while it moves: 1-2.5 N of it weigh on it, and it damps."""

    def draw(self) -> None:
        self.newtons = float(self.rng.uniform(1.0, 2.5))

    def begin(self) -> None:
        self.lies = 0.0

    def step(self, time: float, x: Sequence[float], v: Sequence[float]) -> None:
        going = 1.0 if max(map(abs, v)) > 0.02 else 0.0
        self.lies += 0.001 / 0.3 * (going - self.lies)
        weight, damping = self.newtons * self.lies, 8.0 * self.lies
        self.push = [-u * weight - damping * one for u, one in zip(self.body.upward, v, strict=True)]
