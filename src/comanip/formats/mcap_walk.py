"""A walk over the bytes of an MCAP file that trusts none of them: lengths, checksums and sizes are held before use."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import RecordingError
from .mcap_chunk import MAX_MESSAGE, records_of
from .messages import Message

MAX_KEPT = 160 << 20  # bytes of messages held at once
OURS = "comanip"  # the name of our metadata record, and the key of our channels' metadata
_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_DATA_END, _CHUNK, _METADATA, _SCHEMA, _CHANNEL, _MESSAGE, _FOOTER = 0x0F, 0x06, 0x0C, 0x03, 0x04, 0x05, 0x02

Wanted = Callable[[str], bool] | None


@dataclass
class Walk:
    """What a pass over the bytes of a file found."""

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    messages: dict[int, list[Message]] = field(default_factory=dict)  # by channel
    large: dict[int, int] = field(default_factory=dict)  # channel -> bytes of its largest message that was not kept
    kept: int = 0  # bytes
    seen: int = 0  # messages, also those that are not kept
    complete: bool = False
    faults: list[str] = field(default_factory=list)
    wanted: Wanted = None

    def ours(self, channel_id: int) -> bool:
        return channel_id in self.channels and OURS in self.channels[channel_id].metadata

    def skip(self, channel_id: int, size: int) -> None:
        self.large[channel_id] = max(size, self.large.get(channel_id, 0))


def walk_through(path: Path, data: Any, recover: bool, wanted: Wanted = None) -> Walk:
    """All records, each held against the bytes that are there; stops at the end of the data section or at the cut.

    `data` is bytes or a memoryview of a mapped file; messages of topics that are not `wanted` (None: all) are not kept.
    """
    walk, at, chunks = Walk(wanted=wanted), len(_MAGIC), 0
    data = memoryview(data)
    whole = data[-8:] == _MAGIC and len(data) > 16
    if data[:8] != _MAGIC:
        raise RecordingError(f"{path}: cut after {len(data)} bytes, before the first record: nothing to recover")
    while at + 9 <= len(data):
        opcode, length = data[at], int.from_bytes(data[at + 1 : at + 9], "little")
        body = at + 9
        if opcode == 0 or body + length > len(data):
            if whole:
                fault(path, walk, f"record at byte {at} declares {length} bytes: damaged", recover)
                walk.complete = True
            break
        if opcode == _DATA_END:
            walk.complete = True
            _check_end(path, walk, data, body, length, zlib.crc32(data[:at]), recover)
            break
        chunks += opcode == _CHUNK
        try:
            _take(walk, opcode, data[body : body + length])
        except TooMuch as error:
            raise TooMuch(f"{path}: {error}") from None
        except RecordingError as error:
            fault(path, walk, f"chunk {chunks - 1}, {error}", recover)
        except Exception as error:  # the mcap package raises its own kinds, and struct's, on damaged records
            text = " ".join(str(error).split()) or type(error).__name__
            fault(path, walk, f"record at byte {at} (kind {opcode}): {text}", recover)
        at = body + length
    for stray in walk.messages.keys() - walk.channels.keys():
        fault(path, walk, f"{len(walk.messages[stray])} messages of a channel {stray} that is never announced", recover)
    return walk


class TooMuch(RecordingError):
    """More bytes of messages than are held at once."""


def fault(path: Path, walk: Walk, text: str, recover: bool) -> None:
    if not recover:
        raise RecordingError(f"{path}: {text}; recover=True reads the rest")
    walk.faults.append(f"{text}; left out")


def _check_end(path: Path, walk: Walk, data: bytes, body: int, length: int, crc: int, recover: bool) -> None:
    """The checksums of everything before the data's end, and of the index behind it."""
    stored = int.from_bytes(data[body : body + 4], "little")
    if length != 4 or (stored not in (0, crc)) or (stored == 0 and OURS in walk.metadata):
        if not walk.faults:  # else that damage is named already
            fault(path, walk, "the checksum of the whole file does not match: some byte was changed", recover)
        return
    footer = len(data) - 8 - 29
    if data[-8:] != _MAGIC or footer < body or data[footer] != _FOOTER:
        walk.faults.append("the index at the end is damaged; the data before it is whole")
        return
    start, summary_crc = int.from_bytes(data[footer + 9 : footer + 17], "little"), bytes(data[-12:-8])
    if start == 0 and footer == body + length:
        return  # a legal file without an index: nothing behind the data that could be damaged
    found = zlib.crc32(data[start : len(data) - 12]) if body <= start <= footer else -1
    if summary_crc != b"\0\0\0\0" and int.from_bytes(summary_crc, "little") != found:
        walk.faults.append("the index at the end is damaged; the data before it is whole")


def _take(walk: Walk, opcode: int, body: Any) -> None:
    if opcode == _MESSAGE:  # by far the most frequent: parsed here
        channel_id, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(body)
        _keep(walk, channel_id, log_time, publish_time, sequence, body[_MESSAGE_HEAD.size :])
        return
    if opcode not in (_METADATA, _SCHEMA, _CHANNEL, _CHUNK):
        return
    from mcap.records import Channel as McapChannel
    from mcap.records import Chunk, Metadata, Schema

    stream = _stream(body)
    if opcode == _METADATA:
        record = Metadata.read(stream)
        walk.metadata[record.name] = dict(record.metadata)
    elif opcode == _SCHEMA:
        schema = Schema.read(stream)
        walk.schemas[schema.id] = schema
    elif opcode == _CHANNEL:
        channel = McapChannel.read(stream)
        if walk.channels.setdefault(channel.id, channel) != channel:
            raise RecordingError(
                f"channel {channel.id} is announced twice, as {walk.channels[channel.id].topic!r} and {channel.topic!r}"
            )
        walk.messages.setdefault(channel.id, [])
    elif opcode == _CHUNK:
        _take_chunk(walk, Chunk.read(stream))


def _take_chunk(walk: Walk, chunk: Any) -> None:
    """Its records, once all of them are read and the checksum holds."""
    found = Walk(wanted=walk.wanted, channels=dict(walk.channels), kept=walk.kept, seen=walk.seen)
    for opcode, body in records_of(chunk, found):
        _take(found, min(opcode, 0x7F) if opcode != _CHUNK else 0, body)
    walk.schemas.update(found.schemas)
    walk.channels.update(found.channels)
    walk.kept, walk.seen = found.kept, found.seen
    for channel_id, size in found.large.items():
        walk.skip(channel_id, size)
    for channel_id, messages in found.messages.items():
        walk.messages.setdefault(channel_id, []).extend(messages)


def _keep(walk: Walk, channel_id: int, log: int, publish: int, sequence: int, data: Any) -> None:
    """A message is held unless nobody wants its topic, or it is no signal for its size."""
    channel = walk.channels.get(channel_id)
    ours = walk.ours(channel_id)
    walk.seen += 1
    if not ours and len(data) > MAX_MESSAGE:
        walk.skip(channel_id, len(data))
        return
    if channel is not None and walk.wanted is not None and not (ours or walk.wanted(channel.topic)):
        return
    walk.kept += len(data) + 64
    if walk.kept > MAX_KEPT:
        raise TooMuch(f"its messages take more than {MAX_KEPT >> 20} MB: name the topics (position=...), or cut it into takes")
    walk.messages.setdefault(channel_id, []).append(Message(log, publish, sequence, bytes(data)))


def _stream(body: Any) -> Any:
    from mcap.data_stream import ReadDataStream

    return ReadDataStream(io.BytesIO(bytes(body)))
