"""MCAP files of other programs (rosbag2 and its kin): numbers out of whatever ROS 2 messages they hold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import RecordingError
from ..recording import Channel, Recording

if TYPE_CHECKING:
    from .mcap_file import Walk

_UNITS = {"position": "m", "point": "m", "translation": "m", "force": "N", "torque": "N m", "linear": "m/s"}


def foreign(path: Path, walk: Walk) -> Recording:
    """One channel per group of numbers in a message: "/ft.wrench.force" has the axes x, y, z.

    Units are stated for geometry_msgs alone (SI by REP 103). Stamps come from the headers where there are any.
    """
    from mcap_ros2.decoder import DecoderFactory

    factory = DecoderFactory()
    channels: dict[str, Channel] = {}
    notes: list[str] = []
    for channel_id, mcap_channel in walk.channels.items():
        schema = walk.schemas.get(mcap_channel.schema_id)
        decoder = factory.decoder_for(mcap_channel.message_encoding, schema) if schema else None
        messages = walk.messages.get(channel_id, [])
        if schema is None or decoder is None or not messages:
            what = "no messages" if decoder else f"{mcap_channel.message_encoding!r} messages are not read"
            notes.append(f"{mcap_channel.topic} left out: {what}")
            continue
        try:
            decoded = [decoder(m.data) for m in messages]
        except Exception as error:  # the decoder raises what its parsers raise
            raise RecordingError(f"{path}: {mcap_channel.topic}: cannot be decoded: {error}") from None
        stamps = [_stamp(d) for d in decoded]
        use_header = all(stamps)
        time = np.array([s if use_header else m.log_time / 1e9 for s, m in zip(stamps, messages, strict=True)])
        notes.append(f"{mcap_channel.topic}: stamps from the {'headers' if use_header else 'log'}")
        channels |= _channels(mcap_channel.topic, schema.name, time, decoded, notes)
    if not channels:
        raise RecordingError(f"{path}: no ROS 2 message with numbers in it; {'; '.join(notes) or 'no channels'}")
    if not walk.complete:
        walk.faults.append("cut short: how much is lost is not known")
    return Recording(channels, {"notes": notes})


def _stamp(message: Any) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return stamp.sec + stamp.nanosec / 1e9 if stamp is not None else 0.0


def _channels(topic: str, schema: str, time: np.ndarray, messages: list[Any], notes: list[str]) -> dict[str, Channel]:
    groups = [_groups(topic, m) for m in messages]
    channels = {}
    for name, first in groups[0].items():
        if any(name not in g or len(g[name]) != len(first) for g in groups):
            notes.append(f"{name} left out: its length changes from message to message")
            continue
        unit = _UNITS.get(name.rsplit(".", 1)[-1], "") if schema.startswith("geometry_msgs/") else ""
        values = np.array([list(g[name].values()) for g in groups], dtype=np.float64)
        channels[name] = Channel(time, values, unit, "", tuple(first))
    return channels


def _groups(name: str, message: Any) -> dict[str, dict[str, float]]:
    """Numbers by the struct or array that holds them: "/ft.wrench.force" -> {"x": ..., "y": ..., "z": ...}."""
    found: dict[str, dict[str, float]] = {}
    for key in message.__slots__:
        value = getattr(message, key)
        if isinstance(value, int | float):
            found.setdefault(name, {})[key] = float(value)
        elif hasattr(value, "__slots__") and key != "header":
            found |= _groups(f"{name}.{key}", value)
        elif not isinstance(value, str | bytes) and hasattr(value, "__len__") and len(value):
            numbers = {str(i): float(v) for i, v in enumerate(value) if isinstance(v, int | float)}
            found |= {f"{name}.{key}": numbers} if len(numbers) == len(value) else {}
    return found
