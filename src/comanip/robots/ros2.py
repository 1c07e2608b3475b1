"""An arm behind ROS 2 topics: pose, twist, wrench and joint states in; twist, pose or wrench out.

A wrench in the sensor's frame is turned by the pose, or by a stated turn; one in a frame that nobody stated is refused. Tried
against the fake robot of this room; NOT tried on an arm.
"""

from __future__ import annotations

import time as _time
from collections.abc import Callable
from itertools import pairwise
from math import inf, isfinite

from ..errors import RecordingError
from .arm import MISSING, Sensed
from .messages import JOINTS, Reader, Writer
from .settings import Settings, Topic
from .stamps import Arrivals
from .turns import NONE, Quaternion, Turn, Vector, back, is_turn, turned
from .wire import Wire

SAMPLES = 65536  # stamps that are kept of each signal, for the pre-flight's rates


class _Signal:
    """The latest of one topic. Written by the transport's thread as one tuple, so that a reader never sees half of it."""

    def __init__(self, topic: Topic, now: Callable[[], float]) -> None:
        self.topic = topic
        self.latest: tuple[float, str, tuple[float, ...]] | None = None
        self.problem = ""
        self.stamps: list[float] = []
        self._reader, self._arrivals, self._now = Reader(topic.type), Arrivals(), now

    def hear(self, message: bytes) -> None:
        now = self._now()
        try:
            stamp, frame, numbers = self._read(message)
        except (RecordingError, ValueError) as error:  # another node may send anything
            self.problem = f"{self.topic.name}: {error}"
            return
        made = self._arrivals.time(stamp, now)
        if made is None:
            return
        self.problem = ""
        if len(self.stamps) < SAMPLES:
            self.stamps.append(made)
        self.latest = (made, frame, numbers)

    def _read(self, message: bytes) -> tuple[float, str, tuple[float, ...]]:
        heard = self._reader.read(message)
        return heard.stamp, heard.frame, heard.numbers


class _Joints(_Signal):
    names: tuple[str, ...] = ()

    def _read(self, message: bytes) -> tuple[float, str, tuple[float, ...]]:
        heard, numbers, names = self._reader.arrays(message)
        positions = numbers.get("position", ())
        if len(names) != len(positions):
            raise RecordingError(f"{len(positions)} positions for {len(names)} joints")
        self.names = names
        return heard.stamp, heard.frame, positions


class Ros2Arm:
    """Hears and commands one arm over a `Wire`. The stamps are those of the messages, on this machine's clock."""

    joints: tuple[str, ...] = ()

    def __init__(self, wire: Wire, settings: Settings, now: Callable[[], float] = _time.monotonic) -> None:
        self._wire, self._settings = wire, settings
        self.signals = {
            name: (_Joints if topic.type == JOINTS else _Signal)(topic, now) for name, topic in settings.topics.items()
        }
        assert settings.command.topic is not None
        self._commands = settings.command.topic
        self._frame = settings.command.frame or settings.pose_frame
        self._writer: Writer | None = None
        self._publish = wire.advertise(self._commands)
        self._refused = ""
        self._orientation: Quaternion = NONE
        for signal in self.signals.values():
            wire.subscribe(signal.topic, signal.hear)

    @property
    def problem(self) -> str:
        return ""

    @property
    def notice(self) -> str:
        return self._refused or next((s.problem for s in self.signals.values() if s.problem), "")

    def missing(self) -> str:
        silent = [s.topic for name, s in self.signals.items() if s.latest is None and name != "joints"]
        if silent:
            wrong = [s.problem for s in self.signals.values() if s.problem]
            others = ", ".join(self._wire.seen()) or "nothing"
            return "; ".join([f"nothing came on {t.name} ({t.type})" for t in silent] + wrong) + f"; published are: {others}"
        if not self.joints and isinstance(joints := self.signals.get("joints"), _Joints):
            self.joints = joints.names
        sensed = Sensed()
        self.sense(sensed)
        return self._refused

    def sense(self, out: Sensed) -> None:
        self._refused = ""
        self._pose(out)
        self._twist(out)
        self._wrench(out)
        joints = self.signals.get("joints")
        if isinstance(joints, _Joints) and joints.latest is not None:
            out.joints = dict(zip(joints.names, joints.latest[2], strict=False))

    def _pose(self, out: Sensed) -> None:
        if (latest := self.signals["pose"].latest) is None:
            return
        made, frame, (x, y, z, *q) = latest
        wanted = self._settings.pose_frame
        if wanted and frame and frame.lstrip("/") != wanted.lstrip("/"):
            self._refuse("pose", frame, f"allowed: {wanted} (frames.pose)")
        elif not is_turn(q):
            self._refused = f"pose: orientation {q} is no quaternion of length 1"
        else:
            out.time, out.position, out.orientation = made, (x, y, z), (q[0], q[1], q[2], q[3])
            self._orientation = out.orientation
            return
        out.position = MISSING

    def _twist(self, out: Sensed) -> None:
        out.velocity = MISSING
        if "twist" in self.signals and (latest := self.signals["twist"].latest) is not None:
            _, frame, (x, y, z, *_) = latest
            out.velocity = self._into_base("twist", frame, (x, y, z))

    def _wrench(self, out: Sensed) -> None:
        if (latest := self.signals["wrench"].latest) is None:
            return
        made, frame, (x, y, z, *_) = latest
        s = self._settings.sign
        out.force_time, out.force = made, self._into_base("wrench", frame, (s * x, s * y, s * z))

    def _into_base(self, what: str, frame: str, v: Vector) -> Vector:
        """In the frame of the pose; NaN, and said, where nobody knows how the frames lie."""
        turn = self._turn(frame)
        if turn is None:
            known = ", ".join(self._settings.turns) or "none"
            self._refuse(what, frame, f"state its turn in [frames.turns] (there: {known})")
            return MISSING
        return v if turn == Turn() else turned(turn.now(self._orientation), v)

    def _turn(self, frame: str) -> Turn | None:
        """How a frame lies to the pose's; None where nobody said."""
        name = frame.lstrip("/")
        found = self._settings.turns.get(name) or self._settings.turns.get(frame)
        pose = self.signals["pose"].latest
        base = self._settings.pose_frame or (pose[1] if pose else "")
        return Turn() if found is None and name and name == base.lstrip("/") else found

    def _refuse(self, what: str, frame: str, allowed: str) -> None:
        self._refused = f"{what} is in frame {frame!r}; {allowed}"

    def send(self, velocity: Vector, target: Vector, orientation: Quaternion, measured: Vector) -> None:
        if self._writer is None:
            pose = self.signals["pose"].latest
            self._writer = Writer(self._commands.type, self._frame or (pose[1] if pose else ""))
        self._publish(self._writer.write(_time.time_ns(), self._numbers(velocity, target, orientation, measured)))

    def _numbers(self, velocity: Vector, target: Vector, orientation: Quaternion, measured: Vector) -> tuple[float, ...]:
        kind = self._settings.command.kind
        if kind == "pose":
            return (*target, *orientation)
        v = velocity if kind == "twist" else self._pulling(velocity, measured)
        turn = self._settings.turns.get(self._frame)
        if turn is not None and self._frame != self._settings.pose_frame:
            v = turned(back(turn.now(self._orientation)), v)
        return (*v, 0.0, 0.0, 0.0)

    def _pulling(self, velocity: Vector, measured: Vector) -> Vector:
        """The force that brings the hand to this velocity; none where its own is not known."""
        about = self._settings.command
        lacks = [v - now for v, now in zip(velocity, measured, strict=True)]
        if not all(map(isfinite, lacks)):
            return (0.0, 0.0, 0.0)
        force = [about.damping_ns_per_m * one for one in lacks]
        size = sum(f * f for f in force) ** 0.5
        share = min(1.0, about.force_max_n / size) if size > 0.0 else 1.0
        return (share * force[0], share * force[1], share * force[2])

    def rates(self) -> dict[str, tuple[float, float]]:
        """Of each signal since the last call: (samples a second, longest time between two [s])."""
        found = {}
        for name, signal in self.signals.items():
            stamps, signal.stamps = signal.stamps, []
            if len(stamps) > 1 and stamps[-1] > stamps[0]:
                gaps = [b - a for a, b in pairwise(stamps)]
                found[name] = ((len(stamps) - 1) / (stamps[-1] - stamps[0]), max(gaps))
            else:
                found[name] = (0.0, inf)
        return found

    def listener(self) -> str:
        n = self._wire.readers(self._commands)
        return f"nobody listens to {self._commands.name} ({self._commands.type})" if n == 0 else ""

    def close(self) -> None:
        self._wire.close()
