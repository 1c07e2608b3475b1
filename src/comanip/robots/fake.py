"""A robot that is none: a node that speaks the wire of a real one, with the exact beam and a person behind it.

For tests, for lessons over the wire, and to try `comanip run` before there is an arm. The person waits, holding, until the first
command comes; when commands end for a second everybody goes back to where they began, and the next person takes hold.
"""

from __future__ import annotations

import heapq
import threading
import time as _time
from collections.abc import Callable
from math import cos, pi, sin

import numpy as np

from ..interfaces import Array, Command, Observation, Plant
from .hand import HandPlant
from .messages import JOINTS, Heard, Reader, Writer, packed
from .settings import Settings, Topic
from .turns import Quaternion, Vector, back, turned
from .wire import Hears, Wire

HELD: Quaternion = (
    cos(pi / 5),
    0.6 * sin(pi / 5),
    0.0,
    0.8 * sin(pi / 5),
)  # how the hand is turned: its sensor's z is not the base's
VALID_S = 0.06  # a command is good for so long; then the node brakes by itself, as an arm's low level does
FOLLOW_S = 0.04  # within which a pose that is commanded is reached
HAND_KG = 4.0  # that a commanded wrench moves
OVER_S = 1.0  # without commands: the run is over


class Rests:
    """A person who holds their end where it is, and carries their share."""

    def __init__(self, carried: Array, stiffness_n_per_m: float = 300.0, damping_ns_per_m: float = 60.0) -> None:
        self._carried, self._k, self._b = carried, stiffness_n_per_m, damping_ns_per_m

    def reset(self, position: Array) -> None:
        self._at = position.copy()

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        out[:] = self._carried + self._k * (self._at - position) - self._b * velocity


class FakeRobot:
    """One node. `tick` is one period of its own.

    resting   the plant while nobody commands; living(n) that of the n-th run, which begins where the resting one is
    """

    def __init__(
        self,
        wire: Wire,
        settings: Settings,
        resting: Plant,
        living: Callable[[int], Plant],
        *,
        stamp_ns: Callable[[], int] = _time.time_ns,
    ) -> None:
        assert settings.command.topic is not None
        self.settings, self._living, self._stamp = settings, living, stamp_ns
        self.runs, self._silent_s = 0, 0.0
        self._directions = [settings.axes[name] for name in resting.axes]
        d = len(self._directions)
        self._obs, self._command, self._velocity = Observation(d), Command(d), np.zeros(d)
        self._resting, self.plant = resting, resting
        self._reader, self._heard = Reader(settings.command.topic.type), None  # type: Reader, Heard | None
        self._publish = {name: wire.advertise(topic) for name, topic in settings.topics.items()}
        base = settings.pose_frame or "base"
        sensor = next((name for name, turn in settings.turns.items() if turn.with_hand), base)
        self._frames = {"pose": base, "twist": base, "wrench": sensor}
        self._writers = {n: Writer(t.type, self._frames[n]) for n, t in settings.topics.items() if t.type != JOINTS}
        wire.subscribe(settings.command.topic, self._hear)
        resting.reset()
        self.plant.read(self._obs)

    @property
    def commanded(self) -> Array:
        """(d,) the velocity that the hand is asked for now [m/s]."""
        return self._velocity.copy()

    def _hear(self, message: bytes) -> None:
        self._heard = self._reader.read(message)

    def tick(self) -> None:
        """Says what it feels, does what it was asked, and lets one period pass."""
        self._say()
        heard, self._heard = self._heard, None
        self._live(heard is not None)
        self._obey(heard)
        self._command.velocity[:] = self._velocity
        self.plant.write(self._command)
        self.plant.advance()
        self.plant.read(self._obs)

    def _live(self, commanded: bool) -> None:
        self._silent_s = 0.0 if commanded else self._silent_s + self.plant.dt
        if commanded and self.plant is self._resting:
            self.plant = self._living(self.runs)
        elif self.plant is not self._resting and self._silent_s > OVER_S:
            self.runs, self.plant = self.runs + 1, self._resting
        else:
            return
        self._velocity[:] = 0.0
        self.plant.reset()
        self.plant.read(self._obs)

    def _obey(self, heard: Heard | None) -> None:
        dt, most = self.plant.dt, self.settings.acceleration_m_per_s2
        if heard is None:
            speed = float(np.linalg.norm(self._velocity))
            if self._silent_s > VALID_S and speed > 0.0:
                self._velocity *= max(0.0, speed - most * dt) / speed
            return
        kind, x, y, z = self.settings.command.kind, *heard.numbers[:3]
        along = np.array([a * x + b * y + c * z for a, b, c in self._directions])
        if kind == "twist":
            self._velocity[:] = along
        elif kind == "pose":
            self._velocity[:] = (along - self._obs.position) / FOLLOW_S
        else:
            self._velocity += along / HAND_KG * dt
        speed = float(np.linalg.norm(self._velocity))
        self._velocity *= min(1.0, self.settings.speed_m_per_s / speed) if speed > 0.0 else 1.0

    def _say(self) -> None:
        now, obs = self._stamp(), self._obs
        position, velocity = self._base(obs.position), self._base(obs.velocity)
        force = self._base(self.settings.sign * obs.sensor_force)
        if self._frames["wrench"] != self._frames["pose"]:
            force = turned(back(self.settings.turns[self._frames["wrench"]].now(HELD)), force)
        numbers = {"pose": (*position, *HELD), "twist": (*velocity, 0.0, 0.0, 0.0), "wrench": (*force, 0.0, 0.0, 0.0)}
        for name, writer in self._writers.items():
            self._publish[name](writer.write(now, numbers[name]))
        if "joints" in self._publish:
            self._publish["joints"](self._joints(now))

    def _joints(self, now: int) -> bytes:
        stamp = {"sec": now // 1_000_000_000, "nanosec": now % 1_000_000_000}
        names = [f"slide_{axis}" for axis in self.plant.axes]
        content = {"header": {"stamp": stamp}, "name": names, "position": self._obs.position.tolist()}
        return packed(JOINTS, content)

    def _base(self, along: Array) -> Vector:
        """The vector in the frame of the pose whose parts along the task axes these are."""
        numbers = along.tolist()
        x, y, z = (sum(d[i] * n for d, n in zip(self._directions, numbers, strict=True)) for i in range(3))
        return (x, y, z)


class Stepped(HandPlant):
    """A hand and the node behind it in one thread and one time: each period of the hand lets the node tick through it."""

    def __init__(self, node: FakeRobot, clock: SteppedTime, arm: object, settings: Settings) -> None:
        self._node, self._clock = node, clock
        node.tick()
        super().__init__(arm, settings, real=False, now=clock.now, sleep=self._pass)  # type: ignore[arg-type]

    def _pass(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / self._node.plant.dt))):
            self._clock.seconds += self._node.plant.dt
            self._node.tick()

    def advance(self) -> None:
        self._pass(self.dt)

    @property
    def channels(self):  # type: ignore[no-untyped-def]
        """The truths of the node's plant, too: what lessons and verdicts look at."""
        return {**self._node.plant.channels, **super().channels}


class SteppedTime:
    """A clock that stands still but for `seconds` being moved on."""

    def __init__(self) -> None:
        self.seconds = 1000.0

    def now(self) -> float:
        return self.seconds

    def now_ns(self) -> int:
        return round(self.seconds * 1e9)


class Lossy:
    """A wire that loses messages and brings others late, for trials of what happens then.

    loss      share of messages that never come; jitter_s: each is late by up to that, evenly drawn
    """

    def __init__(self, wire: Wire, loss: float, jitter_s: float, rng: np.random.Generator) -> None:
        self._wire, self._loss, self._jitter, self._rng = wire, loss, jitter_s, rng
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._count, self._more, self._open = 0, threading.Condition(), True
        threading.Thread(target=self._deliver, daemon=True).start()

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        self._wire.subscribe(topic, hears)

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        publish = self._wire.advertise(topic)

        def later(message: bytes) -> None:
            with self._more:
                if self._rng.random() < self._loss:
                    return
                self._count += 1
                due = _time.monotonic() + self._jitter * self._rng.random()
                heapq.heappush(self._due, (due, self._count, lambda: publish(message)))
                self._more.notify()

        return later

    def _deliver(self) -> None:
        while self._open:
            with self._more:
                wait = self._due[0][0] - _time.monotonic() if self._due else 0.1
                if wait > 0.0:
                    self._more.wait(wait)
                    continue
                publish = heapq.heappop(self._due)[2]
            publish()

    def readers(self, topic: Topic) -> int | None:
        return self._wire.readers(topic)

    def seen(self) -> list[str]:
        return self._wire.seen()

    def close(self) -> None:
        self._open = False
        self._wire.close()
