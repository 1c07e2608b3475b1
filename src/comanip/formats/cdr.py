"""ROS 2 messages as bytes (CDR, little endian): all frames of a channel packed or unpacked at once.

Every message of one channel has one layout (its strings never change), so a channel is one structured numpy array.
Positions travel as geometry_msgs/PointStamped, forces as WrenchStamped, other x, y, z vectors as Vector3Stamped, the
rest as std_msgs/Float64MultiArray: what Foxglove, PlotJuggler and `ros2 bag` draw without being told.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Channel

_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_VECTOR3 = f"{_RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
SCHEMAS = {
    "geometry_msgs/msg/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point\n"
    f"{_RULE}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n{_HEADER}",
    "geometry_msgs/msg/Vector3Stamped": f"std_msgs/Header header\ngeometry_msgs/Vector3 vector\n{_VECTOR3}{_HEADER}",
    "geometry_msgs/msg/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n"
    f"{_RULE}\nMSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"
    f"{_VECTOR3}{_HEADER}",
    "std_msgs/msg/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n"
    f"{_RULE}\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    f"{_RULE}\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n",
}
_STAMPED = {
    "geometry_msgs/msg/PointStamped": 3,
    "geometry_msgs/msg/Vector3Stamped": 3,
    "geometry_msgs/msg/WrenchStamped": 6,
}
_START = b"\x00\x01\x00\x00"  # plain CDR, little endian; alignment counts from behind it


def schema_of(channel: Channel) -> str:
    """The message type that shows this channel best."""
    if len(set(channel.axes)) == len(channel.axes) and set(channel.axes) <= {"x", "y", "z"}:
        by_unit = {"m": "geometry_msgs/msg/PointStamped", "N": "geometry_msgs/msg/WrenchStamped"}
        return by_unit.get(channel.unit, "geometry_msgs/msg/Vector3Stamped")
    return "std_msgs/msg/Float64MultiArray"


def encode(channel: Channel, nanoseconds: Sequence[int]) -> list[bytes]:
    """One message a frame; axes that a vector message has and the channel has not are NaN."""
    schema = schema_of(channel)
    width = _STAMPED.get(schema, len(channel.axes))
    values = np.full((len(channel.time), width), np.nan)
    at = ["xyz".index(a) for a in channel.axes] if schema in _STAMPED else list(range(width))
    values[:, at] = channel.values
    head = _stamped_head(channel.frame) if schema in _STAMPED else _array_head(channel.axes)
    rows = np.empty(len(values), dtype=[("head", f"V{len(head)}"), ("values", "<f8", (width,))])
    rows["head"] = np.void(head)
    rows["values"] = values
    size, data = rows.dtype.itemsize, bytearray(rows.tobytes())
    if schema in _STAMPED:
        for i, ns in enumerate(nanoseconds):
            struct.pack_into("<iI", data, i * size + 4, *divmod(ns, 1_000_000_000))
    return [bytes(data[i * size : (i + 1) * size]) for i in range(len(values))]


def decode(schema: str, axes: Sequence[str], messages: Sequence[bytes]) -> Array:
    """(T, d) values of the named axes, from messages that `encode` made; RecordingError for any other layout."""
    width = _STAMPED.get(schema, len(axes))
    sizes = {len(m) for m in messages}
    if len(sizes) > 1 or schema not in SCHEMAS or (sizes and min(sizes) < 8 * width + 4):
        raise RecordingError(f"{schema} messages of {sorted(sizes)} bytes for the axes {', '.join(axes)}: not written by us")
    if not messages:
        return np.empty((0, len(axes)))
    size = sizes.pop()
    rows = np.frombuffer(b"".join(messages), dtype=[("head", f"V{size - 8 * width}"), ("values", "<f8", (width,))])
    at = ["xyz".index(a) for a in axes] if schema in _STAMPED else list(range(width))
    return np.array(rows["values"][:, at], dtype=np.float64)


def _stamped_head(frame: str) -> bytes:
    return _START + _padded(struct.pack("<iI", 0, 0) + _string(frame), 8)


def _array_head(axes: Sequence[str]) -> bytes:
    """One dimension, labelled with the axes' names; then the length of the data."""
    layout = _padded(struct.pack("<I", 1) + _string(",".join(axes)), 4)
    layout += struct.pack("<III", len(axes), len(axes), 0)
    return _START + _padded(layout + struct.pack("<I", len(axes)), 8)


def _string(text: str) -> bytes:
    data = text.replace("\0", "").encode("utf-8", "replace") + b"\0"
    return struct.pack("<I", len(data)) + data


def _padded(data: bytes, multiple: int) -> bytes:
    return data + b"\0" * (-len(data) % multiple)
