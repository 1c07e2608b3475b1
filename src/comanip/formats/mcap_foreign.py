"""MCAP files of other programs (rosbag2 and its kin) as topics of messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .messages import Topic
from .ros2 import definition

if TYPE_CHECKING:
    from .mcap_walk import Walk


def topics(path: Path, walk: Walk, notes: list[str]) -> list[Topic]:
    """The topics whose messages can be read; the others are named in the notes."""
    found = []
    for channel_id, channel in walk.channels.items():
        schema = walk.schemas.get(channel.schema_id)
        if channel_id in walk.large:
            size = walk.large[channel_id]
            notes.append(f"{channel.topic}: messages of up to {size / 2**20:.3g} MB left out: pictures and clouds are not read")
            if not walk.messages.get(channel_id):
                continue
        text = schema.data.decode("utf-8", "replace") if schema and schema.encoding == "ros2msg" else None
        text = text or (definition(schema.name) if schema else None)
        if schema is None or text is None or channel.message_encoding != "cdr":
            kind = (
                f"{channel.message_encoding!r} messages with {schema.encoding!r} definitions"
                if schema
                else "messages without type"
            )
            notes.append(f"{channel.topic} left out: {kind} are not read")
            continue
        found.append(Topic(channel.topic, schema.name, text, walk.messages.get(channel_id, [])))
    if not walk.complete:
        walk.faults.append("cut short: how much is lost is not known")
    return found
