"""robot.toml: what a robot is, in numbers. Every error is one line with file and key.

A file may begin from a preset (`preset = "crisp"`) and state only what differs. What nobody states and nobody can guess (the
walls of this arm, its speed, how its sensor's frame lies) has no default: a robot without it is refused.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import ParameterError
from ..interfaces import STANDARD_GRAVITY
from . import turns
from .messages import known
from .turns import Turn, Vector

HOME = Path(__file__).parent / "presets"
SIMULATED = ("beam", "humanoid")
ADAPTERS = ("ros2", "franky", "panda-py", *SIMULATED)
TRANSPORTS = ("zenoh", "dds", "rclpy")
SIGNALS = {  # topic -> the message types it may have, the first by default
    "pose": ("geometry_msgs/PoseStamped", "geometry_msgs/Pose"),
    "twist": ("geometry_msgs/TwistStamped", "geometry_msgs/Twist"),
    "wrench": ("geometry_msgs/WrenchStamped", "geometry_msgs/Wrench"),
    "joints": ("sensor_msgs/JointState",),
}
COMMANDS = {
    "twist": ("geometry_msgs/TwistStamped", "geometry_msgs/Twist"),
    "pose": ("geometry_msgs/PoseStamped", "geometry_msgs/Pose"),
    "wrench": ("geometry_msgs/WrenchStamped", "geometry_msgs/Wrench"),
}
_ORTHOGONAL = 1e-3


@dataclass(frozen=True)
class Topic:
    """One topic of ROS: its name and its message type ("geometry_msgs/PoseStamped")."""

    name: str
    type: str


@dataclass(frozen=True)
class Commanding:
    """What the arm takes.

    kind      "twist" (m/s), "pose" (a target that runs ahead of the hand by at most `leash_m`) or "wrench" (a force that pulls
              the hand to the velocity: `damping_ns_per_m` times what it lacks, `force_max_n` at most)
    frame     of the header; "" is the pose's. A frame with a turn in [frames.turns] is turned into
    """

    topic: Topic | None = None
    kind: str = "twist"
    frame: str = ""
    leash_m: float = 0.03
    damping_ns_per_m: float = 200.0
    force_max_n: float = 30.0


@dataclass(frozen=True)
class Wiring:
    """How the messages travel; `connect` and `listen` are zenoh's endpoints ("tcp/127.0.0.1:7447")."""

    transport: str = "zenoh"
    domain: int = 0
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()


@dataclass(frozen=True)
class Settings:
    """One robot.

    axes        task axis -> its direction in the frame of the pose, orthogonal to each other; tasks' z need not be the arm's
    gravity     in the frame of the pose [m/s^2]
    turns       frame -> how it lies to the pose's; one that is neither here nor the pose's is refused
    sign        1: the sensor says the force of the object on the hand; -1: that of the hand on the object
    walls_m     task axis -> (lowest, highest) of the hand [m] that this arm may reach
    pose_hz, wrench_hz  least rates of the samples
    late_s      longest period allowed; None: the envelope's
    """

    source: str
    name: str
    adapter: str
    rate_hz: float
    axes: Mapping[str, Vector]
    walls_m: Mapping[str, tuple[float, float]]
    speed_m_per_s: float
    acceleration_m_per_s2: float = 10.0
    force_n: float = 60.0
    gravity: Vector = (0.0, 0.0, -STANDARD_GRAVITY)
    mass_kg: float | None = None
    share: float = 0.5
    host: str = ""
    wire: Wiring = Wiring()
    topics: Mapping[str, Topic] = field(default_factory=dict)
    command: Commanding = Commanding()
    pose_frame: str = ""
    turns: Mapping[str, Turn] = field(default_factory=dict)
    sign: float = 1.0
    force_delay_s: float = 0.0
    cutoff_hz: float = 40.0
    pose_hz: float = 0.0
    wrench_hz: float = 0.0
    late_s: float | None = None

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return 1.0 / self.rate_hz

    @property
    def real(self) -> bool:
        """Whether something may be hit."""
        return self.adapter not in SIMULATED


def presets() -> tuple[str, ...]:
    """Names that `preset = ` and --robot know."""
    return tuple(sorted(path.stem for path in HOME.glob("*.toml")))


def load(where: str | Path) -> Settings:
    """A robot by the name of a preset, or from a file. ParameterError in one line."""
    path = HOME / f"{where}.toml" if str(where) in presets() else Path(where)
    named = str(where) if path.parent == HOME else str(path)
    if path.parent != HOME and path.suffix != ".toml":
        raise ParameterError(f"robot {named!r} is unknown; there are: {', '.join(presets())}, or a .toml of your own")
    return settings(_content(path, named), named)


def _content(path: Path, named: str) -> dict[str, Any]:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ParameterError(f"{named}: no such file; presets: {', '.join(presets())}") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ParameterError(f"{named}: {error}") from None
    preset = content.pop("preset", None)
    if preset is None:
        return content
    if preset not in presets():
        raise ParameterError(f"{named}: preset is {preset!r}; allowed: {', '.join(presets())}")
    return _over(_content(HOME / f"{preset}.toml", preset), content)


_WHOLE = ("axes", "walls")  # tables that are replaced whole: an axis of the preset is none of yours


def _over(below: dict[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(below)
    for key, value in above.items():
        joins = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping) and key not in _WHOLE
        merged[key] = _over(merged[key], value) if joins else value
    return merged


class _Table:
    """One table of the file: takes keys out one by one, and refuses what is left."""

    def __init__(self, source: str, name: str, content: Any) -> None:
        self.source, self.name = source, name
        if not isinstance(content, Mapping):
            raise ParameterError(f"{source}: [{name}] is {content!r}; allowed: a table")
        self._left, self._asked = dict(content), []  # type: dict[str, Any], list[str]

    def key(self, key: str) -> str:
        return f"{self.source}: {self.name}.{key}" if self.name else f"{self.source}: {key}"

    def take(self, key: str, default: Any, check: Callable[[Any], Any], allowed: str) -> Any:
        """The value of a key as `check` gives it; ValueError or TypeError of `check` names what is allowed."""
        self._asked.append(key)
        if key not in self._left:
            if default is _MUST:
                raise ParameterError(f"{self.key(key)} is missing; state {allowed}")
            return default
        value = self._left.pop(key)
        try:
            return check(value)
        except ParameterError as error:
            raise ParameterError(f"{self.key(key)}: {error}") from None
        except (TypeError, ValueError):
            raise ParameterError(f"{self.key(key)} is {value!r}; allowed: {allowed}") from None

    def table(self, key: str) -> _Table:
        self._asked.append(key)
        return _Table(self.source, f"{self.name}.{key}".lstrip("."), self._left.pop(key, {}))

    def items(self) -> list[tuple[str, Any]]:
        left, self._left = self._left, {}
        return list(left.items())

    def nothing_left(self) -> None:
        for key in self._left:
            close = difflib.get_close_matches(key, self._asked, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"allowed: {', '.join(self._asked)}"
            raise ParameterError(f"{self.key(key)} is no key of a robot; {hint}")


_MUST = object()


def settings(content: Mapping[str, Any], source: str) -> Settings:
    """`Settings` from what a robot.toml holds; `source` stands in the errors."""
    top = _Table(source, "", content)
    adapter = top.take("adapter", _MUST, _one_of(*ADAPTERS), ", ".join(ADAPTERS))
    limits, frames, rates, payload = top.table("limits"), top.table("frames"), top.table("rates"), top.table("payload")
    simulated = adapter in SIMULATED
    axes = _axes(top.table("axes"), simulated)
    pose_frame = frames.take("pose", "", _text, "a frame")
    found = Settings(
        source=source,
        name=top.take("name", Path(source).stem, _text, "a text"),
        adapter=adapter,
        rate_hz=top.take("rate_hz", 100.0, _between(20.0, 5000.0), "a number of 20 to 5000 [Hz]"),
        axes=axes,
        walls_m=_walls(limits.table("walls"), axes, simulated),
        speed_m_per_s=limits.take("speed_m_per_s", 0.8 if simulated else _MUST, _positive, "metres a second, above 0"),
        acceleration_m_per_s2=limits.take("acceleration_m_per_s2", 10.0, _positive, "m/s^2, above 0"),
        force_n=limits.take("force_n", 60.0, _positive, "newtons, above 0"),
        gravity=top.take("gravity_m_per_s2", (0.0, 0.0, -STANDARD_GRAVITY), _vector, "three numbers [m/s^2]"),
        mass_kg=payload.take("mass_kg", None, _between(0.0, 1000.0), "kilograms of the whole object"),
        share=payload.take("share", 0.5, _between(0.0, 1.0), "0 to 1: what of the object this hand carries"),
        host=top.take("host", "" if adapter not in ("franky", "panda-py") else _MUST, _text, "the arm's address"),
        wire=_wiring(top.table("wire")),
        topics=_topics(top.table("topics"), adapter),
        command=_command(top.table("command"), adapter),
        pose_frame=pose_frame,
        turns={name: _turn(frames, name, value) for name, value in frames.table("turns").items()},
        sign=top.take("force_sign", 1.0, _one_of(1, -1), "1 (force of the object on the hand) or -1 (the hand's on the object)"),
        force_delay_s=top.take("force_delay_s", 0.0, _between(0.0, 0.1), "0 to 0.1 s behind the pose"),
        cutoff_hz=top.take("force_cutoff_hz", 40.0, _between(1.0, 1000.0), "1 to 1000 Hz"),
        pose_hz=rates.take("pose_hz", 0.0, _between(0.0, 1e4), "a number [Hz]"),
        wrench_hz=rates.take("wrench_hz", 0.0, _between(0.0, 1e4), "a number [Hz]"),
        late_s=rates.take("late_s", None, _between(1e-3, 1.0), "0.001 to 1 s"),
    )
    for table in (limits, frames, rates, payload, top):
        table.nothing_left()
    _command_frame(found)
    return found


def _command_frame(found: Settings) -> None:
    frame = found.command.frame
    if frame and frame != found.pose_frame and frame not in found.turns:
        raise ParameterError(f"{found.source}: command.frame is {frame!r}; allowed: frames.pose, or a frame of [frames.turns]")
    if found.late_s is not None and found.late_s < 2.0 * found.dt:
        raise ParameterError(
            f"{found.source}: rates.late_s is {found.late_s}; allowed: at least two periods, {2.0 * found.dt:g} s"
        )


def _axes(table: _Table, simulated: bool) -> dict[str, Vector]:
    given = table.items()
    if not given and not simulated:
        raise ParameterError(f"{table.source}: [axes] is missing; state each task axis' direction, for example z = [0, 0, 1]")
    axes: dict[str, Vector] = {}
    for name, value in given:
        direction = _Table(table.source, "axes", {name: value}).take(name, _MUST, _vector, "a direction [x, y, z]")
        size = math.hypot(*direction)
        if not size > 0.0:
            raise ParameterError(f"{table.source}: axes.{name} is {value!r}; allowed: a direction, not zero")
        unit = (direction[0] / size, direction[1] / size, direction[2] / size)
        for other, already in axes.items():
            if abs(sum(a * b for a, b in zip(unit, already, strict=True))) > _ORTHOGONAL:
                raise ParameterError(f"{table.source}: axes.{name} is not orthogonal to axes.{other}; task axes are")
        axes[name] = unit
    return axes


def _walls(table: _Table, axes: Mapping[str, Vector], simulated: bool) -> dict[str, tuple[float, float]]:
    walls = {}
    for name in axes:
        must = None if simulated else _MUST
        walls[name] = table.take(name, must, _range, "[lowest, highest] of the hand [m], lowest < highest")
    if not axes:
        walls = {name: _Table(table.source, table.name, {name: v}).take(name, _MUST, _range, "[lowest, highest] [m]")
                 for name, v in table.items()}  # fmt: skip
    table.nothing_left()
    return {name: wall for name, wall in walls.items() if wall is not None}


def _wiring(table: _Table) -> Wiring:
    found = Wiring(
        transport=table.take("transport", "zenoh", _one_of(*TRANSPORTS), ", ".join(TRANSPORTS)),
        domain=int(table.take("domain", 0, _whole(0, 232), "a whole number, 0 to 232")),
        connect=table.take("connect", (), _texts, 'endpoints, for example ["tcp/192.168.1.5:7447"]'),
        listen=table.take("listen", (), _texts, 'endpoints, for example ["tcp/127.0.0.1:7447"]'),
    )
    table.nothing_left()
    return found


def _topics(table: _Table, adapter: str) -> dict[str, Topic]:
    found = {}
    for signal, types in SIGNALS.items():
        must = _MUST if adapter == "ros2" and signal in ("pose", "wrench") else None
        topic = table.take(signal, must, _topic(types), f'a topic, for example "/{signal}", or {{name = ..., type = ...}}')
        if topic is not None:
            found[signal] = topic
    table.nothing_left()
    return found


def _command(table: _Table, adapter: str) -> Commanding:
    kind = table.take("kind", "twist", _one_of(*COMMANDS), ", ".join(COMMANDS))
    types = COMMANDS[kind]
    of = table.take("type", types[0], lambda value: known(_text(value), types), ", ".join(types))
    name = table.take("topic", _MUST if adapter == "ros2" else "", _topic_name, "a topic that begins with /")
    found = Commanding(
        topic=Topic(name, of) if name else None,
        kind=kind,
        frame=table.take("frame", "", _text, "a frame"),
        leash_m=table.take("leash_m", Commanding.leash_m, _between(0.001, 0.2), "0.001 to 0.2 m"),
        damping_ns_per_m=table.take("damping_ns_per_m", Commanding.damping_ns_per_m, _positive, "N s/m, above 0"),
        force_max_n=table.take("force_max_n", Commanding.force_max_n, _positive, "newtons, above 0"),
    )
    table.nothing_left()
    return found


def _turn(frames: _Table, name: str, value: Any) -> Turn:
    try:
        return turns.parsed(value)
    except ParameterError as error:
        raise ParameterError(f"{frames.source}: frames.turns.{name}: {error}") from None


# what a value may be; ValueError where it is not


def _one_of(*allowed: Any) -> Callable[[Any], Any]:
    def check(value: Any) -> Any:
        if isinstance(value, bool) or value not in allowed:
            raise ValueError
        return value

    return check


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


def _between(low: float, high: float) -> Callable[[Any], float]:
    def check(value: Any) -> float:
        if not low <= _number(value) <= high:
            raise ValueError
        return float(value)

    return check


def _whole(low: int, high: int) -> Callable[[Any], int]:
    def check(value: Any) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise ValueError
        return value

    return check


def _positive(value: Any) -> float:
    if not _number(value) > 0.0:
        raise ValueError
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError
    return value


def _texts(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise ValueError
    return tuple(_text(one) for one in value)


def _vector(value: Any) -> Vector:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError
    return (_number(value[0]), _number(value[1]), _number(value[2]))


def _range(value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2 or not _number(value[0]) < _number(value[1]):
        raise ValueError
    return float(value[0]), float(value[1])


def _topic_name(value: Any) -> str:
    if not isinstance(value, str) or not value.startswith("/") or value.endswith("/") or any(c in value for c in " *$#?%"):
        raise ValueError
    return value


def _topic(types: tuple[str, ...]) -> Callable[[Any], Topic]:
    def check(value: Any) -> Topic:
        if isinstance(value, Mapping):
            if set(value) - {"name", "type"}:
                raise ValueError
            return Topic(_topic_name(value.get("name")), known(_text(value.get("type", types[0])), types))
        return Topic(_topic_name(value), types[0])

    return check
