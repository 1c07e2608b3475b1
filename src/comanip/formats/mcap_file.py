"""MCAP: one recording a file, ROS 2 messages, each channel at its own rate.

Values are exact. Stamps are whole nanoseconds: a float stamp comes back within 0.5 ns. Chunks are small (1 KiB, some
ten messages) and checked, so that a file cut anywhere loses milliseconds, and a flipped bit is found. What the messages
cannot say (unit, axes, the recording's own metadata) is in the channels' metadata and in one metadata record, as JSON.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ComanipWarning, RecordingError
from ..recording import Channel, Recording
from . import cdr

CHUNK_BYTES = 1024
MAX_CHUNK = 16 << 20  # bytes a chunk may unpack to
RECORD = "comanip"
VERSION = 1
_MAGIC = b"\x89MCAP0\r\n"
_DATA_END, _CHUNK, _METADATA, _SCHEMA, _CHANNEL, _MESSAGE, _FOOTER = 0x0F, 0x06, 0x0C, 0x03, 0x04, 0x05, 0x02


def write_mcap(recording: Recording, path: Path) -> None:
    """Writes the file beside its place and moves it there whole: a crash leaves the old file or the new one."""
    from mcap.writer import CompressionType, Writer

    channels = recording.channels
    stamps, shift = _nanoseconds(path, recording)
    part = path.with_name(f".{os.getpid()}-{hashlib.sha256(path.name.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}")
    try:
        with part.open("wb") as out:
            writer = Writer(out, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(profile="ros2", library="comanip")
            writer.add_metadata(RECORD, _summary(path, recording, shift))
            ids = _register(writer, channels)
            messages = {n: cdr.encode(c, stamps[n]) for n, c in channels.items()}
            for name, i in _in_time(stamps):
                ns = stamps[name][i]
                writer.add_message(ids[name], log_time=ns, publish_time=ns, sequence=i, data=messages[name][i])
            writer.finish()
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _nanoseconds(path: Path, recording: Recording) -> tuple[dict[str, list[int]], int]:
    """Stamps [ns] per channel, not negative, and what must be added to them to get the recording's own."""
    for name, channel in recording.channels.items():
        bad = np.flatnonzero(~(np.abs(channel.time) < 2.0**31))
        if len(bad):
            raise RecordingError(
                f"{path}: {name}: stamp {channel.time[bad[0]]} at frame {bad[0]}; allowed: finite seconds below 2^31"
            )
    stamps = {n: [round(t * 1e9) for t in c.time.tolist()] for n, c in recording.channels.items()}
    shift = min((min(s) for s in stamps.values() if s), default=0)
    shift = min(shift, 0)
    return {n: [ns - shift for ns in s] for n, s in stamps.items()}, shift


def _summary(path: Path, recording: Recording, shift: int) -> dict[str, str]:
    layout = {n: [c.unit, c.frame, list(c.axes), len(c.time)] for n, c in recording.channels.items()}
    ends = [[float(c.time[0]), float(c.time[-1])] for c in recording.channels.values() if len(c.time)]
    try:
        texts = {
            "version": str(VERSION),
            "recording": json.dumps(dict(recording.metadata)),
            "channels": json.dumps(layout),
            "clock": json.dumps([shift, min(e[0] for e in ends), max(e[1] for e in ends)] if ends else [shift, 0.0, 0.0]),
        }
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: the metadata must be plain JSON values: {error}") from None
    return {**texts, "sha256": _digest(texts)}


def _digest(texts: dict[str, str]) -> str:
    """Metadata records carry no checksum of their own, so ours brings one."""
    return hashlib.sha256("\0".join(f"{k}={texts[k]}" for k in sorted(texts) if k != "sha256").encode()).hexdigest()


def _register(writer: Any, channels: Any) -> dict[str, int]:
    schemas: dict[str, int] = {}
    topics: set[str] = set()
    ids = {}
    for name, channel in channels.items():
        schema = cdr.schema_of(channel)
        if schema not in schemas:
            schemas[schema] = writer.register_schema(schema, "ros2msg", cdr.SCHEMAS[schema].encode())
        topic = "/" + name.replace(".", "/")
        topic += "_" * sum(topic.rstrip("_") == t.rstrip("_") for t in topics)  # "a.b" and "a/b" stay apart
        topics.add(topic)
        meta = {RECORD: json.dumps([name, channel.unit, channel.frame, list(channel.axes)]), "offered_qos_profiles": ""}
        ids[name] = writer.register_channel(topic, "cdr", schemas[schema], meta)
    return ids


def _in_time(stamps: dict[str, list[int]]) -> list[tuple[str, int]]:
    """(channel, frame) in order of time, frames of a channel never swapped even when its clock jumps back."""
    keys = []
    for order, (name, several) in enumerate(stamps.items()):
        latest = -1
        for i, ns in enumerate(several):
            latest = max(latest, ns)
            keys.append((latest, order, i, name))
    return [(name, i) for _, _, i, name in sorted(keys)]


@dataclass
class Walk:
    """What a pass over the bytes of a file found."""

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    messages: dict[int, list[Any]] = field(default_factory=dict)
    complete: bool = False
    faults: list[str] = field(default_factory=list)


def read_mcap(path: Path, data: bytes, *, recover: bool = False) -> Recording:
    """A recording from our own file or another program's ROS 2 MCAP.

    A file cut short is read up to the cut, with a warning. Damage is a RecordingError; with `recover` the damaged
    chunks are left out, with a warning for each.
    """
    walk = _walk(path, data, recover)
    if not walk.channels and not walk.metadata:
        raise RecordingError(f"{path}: cut before the first channel: nothing to recover")
    if RECORD in walk.metadata or any(RECORD in c.metadata for c in walk.channels.values()):
        recording = _own(path, walk, recover)
    else:
        from .mcap_foreign import foreign

        recording = foreign(path, walk)
    for fault in walk.faults:
        warnings.warn(f"{path}: {fault}", ComanipWarning, stacklevel=5)
    if walk.faults:
        recording = recording.with_metadata(notes=[*recording.metadata.get("notes", ()), *walk.faults])
    return recording


def _walk(path: Path, data: bytes, recover: bool) -> Walk:
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
                _fault(path, walk, f"record at byte {at} declares {length} bytes: damaged", recover)
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
            _fault(path, walk, f"chunk {chunks - 1}, {error}", recover)
        except Exception as error:  # the mcap package raises its own kinds, and struct's, on damaged records
            text = " ".join(str(error).split()) or type(error).__name__
            _fault(path, walk, f"record at byte {at} (kind {opcode}): {text}", recover)
        at = body + length
    return walk


def _fault(path: Path, walk: Walk, text: str, recover: bool) -> None:
    if not recover:
        raise RecordingError(f"{path}: {text}; recover=True reads the rest")
    walk.faults.append(f"{text}; left out")


def _check_end(path: Path, walk: Walk, data: bytes, body: int, length: int, crc: int, recover: bool) -> None:
    """The checksums of everything before the data's end, and of the index behind it."""
    stored = int.from_bytes(data[body : body + 4], "little")
    if length != 4 or (stored not in (0, crc)) or (stored == 0 and RECORD in walk.metadata):
        if not walk.faults:  # else that damage is named already
            _fault(path, walk, "the checksum of the whole file does not match: some byte was changed", recover)
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
    from mcap.records import Channel as McapChannel
    from mcap.records import Chunk, Message, Metadata, Schema

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
    elif opcode == _MESSAGE:
        message = Message.read(stream, len(body))
        walk.messages.setdefault(message.channel_id, []).append(message)
    elif opcode == _CHUNK:
        chunk = Chunk.read(stream)
        inner = _unpacked(chunk)
        at = 0
        found = Walk()
        while at < len(inner):
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
    import io

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


def _own(path: Path, walk: Walk, recover: bool) -> Recording:
    """Our own file: values by the channels' metadata, the rest from the metadata record."""
    texts = walk.metadata.get(RECORD, {})
    if texts and texts.get("sha256") != _digest(texts):
        _fault(path, walk, "the metadata record is damaged (its sha256 does not match)", recover)
        texts = {}
    if int(texts.get("version", VERSION)) > VERSION:
        raise RecordingError(f"{path}: written as version {texts['version']}; this comanip reads up to {VERSION}: update it")
    shift, first, last = json.loads(texts.get("clock", "[0, 0.0, 0.0]"))
    layout = json.loads(texts.get("channels", "{}"))
    channels = {n: Channel(np.empty(0), np.empty((0, len(a))), u, f, tuple(a)) for n, (u, f, a, _) in layout.items()}
    for channel_id, mcap_channel in walk.channels.items():
        if RECORD not in mcap_channel.metadata:
            continue
        try:
            name, unit, frame, axes = json.loads(mcap_channel.metadata[RECORD])
            messages = walk.messages.get(channel_id, [])
            values = cdr.decode(walk.schemas[mcap_channel.schema_id].name, axes, [m.data for m in messages])
            time = np.array([(m.log_time + shift) / 1e9 for m in messages])
            channels[name] = Channel(time, values, unit, frame, tuple(axes))
        except (KeyError, ValueError, TypeError, RecordingError) as error:
            _fault(path, walk, f"channel {mcap_channel.topic!r}: {error}", recover)
    recording = Recording(channels, json.loads(texts.get("recording", "{}")))
    if not walk.complete:
        walk.faults.append(_cut(recording, first, last))
    return recording


def _cut(recording: Recording, first: float, last: float) -> str:
    stamps = [c.time[-1] for c in recording.channels.values() if len(c.time)]
    got, whole = (max(stamps) - first if stamps else 0.0), last - first
    if whole <= 0.0:
        return f"cut short: recovered {got:.1f} s; how much is lost is not known"
    return f"cut short: recovered {got:.1f} s of {whole:.1f} s (last {whole - got:.1f} s lost)"
