"""A walk over the bytes of an MCAP file that trusts none of them: lengths, checksums and sizes are held before use."""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import RecordingError

MAX_CHUNK = 16 << 20  # bytes a chunk may unpack to
OURS = "comanip"  # the name of our metadata record, and the key of our channels' metadata
_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_DATA_END, _CHUNK, _METADATA, _SCHEMA, _CHANNEL, _MESSAGE, _FOOTER = 0x0F, 0x06, 0x0C, 0x03, 0x04, 0x05, 0x02


@dataclass
class Walk:
    """What a pass over the bytes of a file found."""

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    messages: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)  # channel -> (log time [ns], data)
    complete: bool = False
    faults: list[str] = field(default_factory=list)


def walk_through(path: Path, data: bytes, recover: bool) -> Walk:
    """All records, each held against the bytes that are there; stops at the end of the data section or at the cut."""
    walk, at, crc_at, chunks = Walk(), len(_MAGIC), 0, 0
    whole = data[-8:] == _MAGIC and len(data) > 16
    crc = 0
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
            crc = zlib.crc32(data[crc_at:at], crc)
            walk.complete = True
            _check_end(path, walk, data, body, length, crc, recover)
            break
        chunks += opcode == _CHUNK
        try:
            _take(walk, opcode, data[body : body + length])
        except RecordingError as error:
            fault(path, walk, f"chunk {chunks - 1}, {error}", recover)
        except Exception as error:  # the mcap package raises its own kinds, and struct's, on damaged records
            text = " ".join(str(error).split()) or type(error).__name__
            fault(path, walk, f"record at byte {at} (kind {opcode}): {text}", recover)
        at = body + length
    return walk


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
    start, summary_crc = int.from_bytes(data[footer + 9 : footer + 17], "little"), data[-12:-8]
    found = zlib.crc32(data[start : len(data) - 12]) if body <= start <= footer else -1
    if summary_crc != b"\0\0\0\0" and int.from_bytes(summary_crc, "little") != found:
        walk.faults.append("the index at the end is damaged; the data before it is whole")


def _take(walk: Walk, opcode: int, body: bytes) -> None:
    if opcode == _MESSAGE:  # by far the most frequent: parsed here
        channel_id, _, log_time, _ = _MESSAGE_HEAD.unpack_from(body)
        walk.messages.setdefault(channel_id, []).append((log_time, body[_MESSAGE_HEAD.size :]))
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
        walk.channels[channel.id] = channel
        walk.messages.setdefault(channel.id, [])
    elif opcode == _CHUNK:
        chunk = Chunk.read(stream)
        inner = _unpacked(chunk)
        at = 0
        found = Walk()
        while at + 9 <= len(inner):
            length = int.from_bytes(inner[at + 1 : at + 9], "little")
            if at + 9 + length > len(inner):
                raise RecordingError("a record inside is longer than the chunk")
            _take(found, min(inner[at], 0x7F) if inner[at] != _CHUNK else 0, inner[at + 9 : at + 9 + length])
            at += 9 + length
        walk.schemas.update(found.schemas)
        walk.channels.update(found.channels)
        for channel_id, messages in found.messages.items():
            walk.messages.setdefault(channel_id, []).extend(messages)


def _stream(body: bytes) -> Any:
    from mcap.data_stream import ReadDataStream

    return ReadDataStream(io.BytesIO(body))


def _unpacked(chunk: Any) -> bytes:
    """The chunk's records, never more than 16 MiB of them, checksum held."""
    span = f"t = {chunk.message_start_time / 1e9:.3f}-{chunk.message_end_time / 1e9:.3f} s"
    declared = chunk.uncompressed_size
    inner = b""
    try:
        if chunk.compression == "zstd":
            import zstandard

            declared = max(declared, zstandard.frame_content_size(chunk.data))
            if declared <= MAX_CHUNK:
                inner = zstandard.decompress(chunk.data, max_output_size=MAX_CHUNK)
        elif chunk.compression == "lz4":
            import lz4.frame

            if declared <= MAX_CHUNK:
                inner = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=MAX_CHUNK + 1)
        elif chunk.compression == "":
            inner = chunk.data
        else:
            raise RecordingError(f"{span}: compression {chunk.compression!r} is not known; allowed: zstd, lz4, none")
    except RecordingError:
        raise
    except Exception as error:  # each library raises its own kinds on damaged input
        raise RecordingError(f"{span}: cannot be unpacked ({' '.join(str(error).split())})") from None
    if max(declared, len(inner)) > MAX_CHUNK:
        size = max(declared, len(inner)) / 2**20
        raise RecordingError(f"{span}: chunk declares {size:.4g} MB > {MAX_CHUNK >> 20} MB")
    if chunk.uncompressed_crc and zlib.crc32(inner) != chunk.uncompressed_crc:
        raise RecordingError(f"{span}: checksum does not match")
    return inner
