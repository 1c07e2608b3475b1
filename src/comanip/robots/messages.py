"""ROS 2 messages of a running robot: bytes of one topic to numbers and back, a few microseconds each.

Reading is the files' own decoder (`formats.ros2`), so whatever a bag may hold can be heard; writing is its counterpart. The
hashes are those of Iron and later (REP 2011), which stand in zenoh's keys; Humble has none.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..errors import ParameterError, RecordingError
from ..formats.ros2 import Decoder, Field, Shape, definition, parsed, plain

POSE = ("position.x", "position.y", "position.z", "orientation.w", "orientation.x", "orientation.y", "orientation.z")
TWIST = ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")
WRENCH = ("force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z")
PATHS: dict[str, tuple[str, ...]] = {  # type -> where its numbers are, in the order in which they are handed on
    "geometry_msgs/Pose": POSE,
    "geometry_msgs/PoseStamped": tuple(f"pose.{p}" for p in POSE),
    "geometry_msgs/Twist": TWIST,
    "geometry_msgs/TwistStamped": tuple(f"twist.{p}" for p in TWIST),
    "geometry_msgs/Wrench": WRENCH,
    "geometry_msgs/WrenchStamped": tuple(f"wrench.{p}" for p in WRENCH),
}
JOINTS = "sensor_msgs/JointState"
HASHES = {
    "geometry_msgs/Pose": "RIHS01_d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa",
    "geometry_msgs/PoseStamped": "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "geometry_msgs/Twist": "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/TwistStamped": "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    "geometry_msgs/Wrench": "RIHS01_018e8519d57c16adbe97c9fe1460ef21fec7e31bc541de3d653a35895677ce52",
    "geometry_msgs/WrenchStamped": "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    "sensor_msgs/JointState": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}
_STRUCT = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "float32": "f", "int64": "q", "uint64": "Q", "float64": "d",
}  # fmt: skip
_START = b"\x00\x01\x00\x00"  # plain CDR, little endian
BILLION = 1_000_000_000


class Heard(NamedTuple):
    """One message: stamp [s] of its header (NaN: it has none, or zero), frame, numbers in the order of `PATHS`."""

    stamp: float
    frame: str
    numbers: tuple[float, ...]


def dds_name(kind: str) -> str:
    """geometry_msgs/PoseStamped -> geometry_msgs::msg::dds_::PoseStamped_, as on the wire."""
    package, name = plain(kind).split("/")
    return f"{package}::msg::dds_::{name}_"


def known(kind: str, allowed: Sequence[str] = tuple(HASHES)) -> str:
    """`kind` with or without "/msg/", if it is one that can be sent and heard."""
    if plain(kind) not in allowed:
        raise ParameterError(f"message type {kind!r} is not known here; allowed: {', '.join(allowed)}")
    return plain(kind)


def packed(kind: str, content: Mapping[str, Any]) -> bytes:
    """`content` (nested by field names; what is left out is zero or empty) as one message of this common type."""
    kind = plain(kind)
    types = parsed(kind, definition(kind) or "")
    out = bytearray(_START)
    _struct(types, kind, content, out)
    return bytes(out)


def _struct(types: Mapping[str, tuple[Field, ...]], kind: str, content: Mapping[str, Any], out: bytearray) -> None:
    for name, of, length in types[kind]:
        value = content.get(name)
        if length is None:
            _one(types, of, value, out)
            continue
        items = list(value if value is not None else [None] * max(length, 0))
        if length == -1:
            _aligned(out, "I", len(items))
        for item in items:
            _one(types, of, item, out)


def _one(types: Mapping[str, tuple[Field, ...]], of: str, value: Any, out: bytearray) -> None:
    if of in _STRUCT:
        _aligned(out, _STRUCT[of], 0 if value is None else value)
    elif of == "string":
        text = (value or "").encode() + b"\0"
        _aligned(out, "I", len(text))
        out += text
    else:
        _struct(types, of, value or {}, out)


def _aligned(out: bytearray, code: str, value: Any) -> None:
    out += b"\0" * (-(len(out) - 4) % struct.calcsize(code))
    out += struct.pack("<" + code, value)


def nested(paths: Sequence[str], numbers: Sequence[float]) -> dict[str, Any]:
    """{"pose": {"position": {"x": ...}}} from "pose.position.x" and its number."""
    tree: dict[str, Any] = {}
    for path, number in zip(paths, numbers, strict=True):
        *parents, leaf = path.split(".")
        at = tree
        for parent in parents:
            at = at.setdefault(parent, {})
        at[leaf] = number
    return tree


class Reader:
    """What one topic says. A shape of message is walked once; after that only its numbers are looked at."""

    def __init__(self, kind: str) -> None:
        self.kind = plain(kind)
        self._decoder = Decoder(self.kind, definition(self.kind) or "")
        self._paths = PATHS.get(self.kind, ())
        self._known: dict[int, tuple[Shape, list[tuple[struct.Struct, int]], tuple[struct.Struct, int] | None, str]] = {}

    def read(self, message: bytes) -> Heard:
        """RecordingError where the bytes are no message of this type."""
        shape = self._decoder.shape(message)
        found = self._known.get(id(shape))
        if found is None:
            found = self._known[id(shape)] = self._located(shape)
        _, places, stamp, frame = found
        numbers = tuple(one.unpack_from(message, at)[0] for one, at in places)
        return Heard(self._stamp(message, stamp), frame, numbers)

    @staticmethod
    def _stamp(message: bytes, place: tuple[struct.Struct, int] | None) -> float:
        if place is None:
            return math.nan
        seconds, nano = place[0].unpack_from(message, place[1])
        return float(seconds + nano / BILLION) if seconds or nano else math.nan

    def _located(self, shape: Shape) -> Any:
        blocks = {b.path: b for b in shape.blocks}
        places = []
        for path in self._paths:
            if path not in blocks:
                raise RecordingError(f"{self.kind} has no {path}")
            block = blocks[path]
            places.append((struct.Struct(block.code[0] + {"f8": "d", "f4": "f"}[block.code[1:]]), block.offset))
        stamp = shape.stamp_at("header.stamp")
        at = (struct.Struct(stamp[0].code[0] + "iI"), stamp[0].offset) if stamp else None
        return shape, places, at, shape.texts.get("header.frame_id", "")

    def arrays(self, message: bytes) -> tuple[Heard, dict[str, tuple[float, ...]], tuple[str, ...]]:
        """The same of a message with arrays (JointState): (stamp and frame, numbers by field, names)."""
        shape, heard = self._decoder.shape(message), self.read(message)
        numbers = {
            b.path: struct.unpack_from(f"{b.code[0]}{b.length}d", message, b.offset)
            for b in shape.blocks
            if b.length is not None and b.code.endswith("f8")
        }
        names = tuple(text for path, text in shape.texts.items() if path.startswith("name["))
        return heard, numbers, names


class Writer:
    """Messages of one type and frame: one template, in which stamp and numbers are put in place."""

    def __init__(self, kind: str, frame: str = "") -> None:
        self.kind = plain(kind)
        paths = PATHS[self.kind]
        self._template = packed(self.kind, {"header": {"frame_id": frame}} | nested(paths, [0.0] * len(paths)))
        shape = Decoder(self.kind, definition(self.kind) or "").shape(self._template)
        at = {b.path: b.offset for b in shape.blocks}
        self._places = [at[path] for path in paths]
        self._stamp = at.get("header.stamp.sec")
        self._number = struct.Struct("<d")

    def write(self, nanoseconds: int, numbers: Sequence[float]) -> bytes:
        """One message stamped so [ns since 1970], of `numbers` in the order of `PATHS`."""
        out = bytearray(self._template)
        if self._stamp is not None:
            struct.pack_into("<iI", out, self._stamp, *divmod(nanoseconds, BILLION))
        for place, number in zip(self._places, numbers, strict=True):
            self._number.pack_into(out, place, number)
        return bytes(out)
