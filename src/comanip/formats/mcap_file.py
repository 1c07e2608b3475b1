"""MCAP: one recording a file, ROS 2 messages, each channel at its own rate.

Values are exact. Stamps are whole nanoseconds: a float stamp comes back within 0.5 ns. Chunks are small (10 ms of a run,
between 1 and 64 KiB) and checked, so that a file cut anywhere loses milliseconds, and a flipped bit is found. What the
messages cannot say (unit, axes, the recording's own metadata) is in the channels' metadata and in one metadata record, as JSON.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ComanipWarning, RecordingError
from ..recording import Channel, Recording
from . import cdr, messages
from .columns import Columns
from .doors import only
from .files import mapped_bytes
from .mapping import mapped
from .mcap_foreign import topics
from .mcap_walk import OURS, TooMuch, Walk, fault, walk_through

CHUNK_BYTES, LARGEST_CHUNK_BYTES, CHUNK_S = 1024, 65536, 0.01
RECORD = OURS
VERSION = 1


def open_mcap(path: Path, data: Any, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    with mapped_bytes(path) as contents:
        return (read_mcap(path, contents, columns, recover=recover),)


def write_one(recordings: Sequence[Recording], path: Path) -> None:
    write_mcap(only(recordings, path), path)


def write_mcap(recording: Recording, path: Path) -> None:
    """Writes the file beside its place and moves it there whole: a crash leaves the old file or the new one."""
    from mcap.writer import CompressionType, Writer

    channels = recording.channels
    stamps, shift = _nanoseconds(path, recording)
    encoded = {n: cdr.encode(c, stamps[n]) for n, c in channels.items()}
    part = path.with_name(f".{os.getpid()}-{hashlib.sha256(path.name.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}")
    try:
        with part.open("wb") as out:
            size = _chunk_bytes(encoded, recording.duration_s)
            writer = Writer(out, chunk_size=size, compression=CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(profile="ros2", library="comanip")
            writer.add_metadata(RECORD, summary(path, recording, shift))
            ids = register(writer, channels)
            for name, i in _in_time(stamps):
                ns = stamps[name][i]
                writer.add_message(ids[name], log_time=ns, publish_time=ns, sequence=i, data=encoded[name][i])
            writer.finish()
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _chunk_bytes(encoded: dict[str, list[bytes]], duration_s: float) -> int:
    """Size of the messages that an average `CHUNK_S` of the run holds, within the limits."""
    total = sum(len(message) for several in encoded.values() for message in several)
    wanted = total * CHUNK_S / duration_s if duration_s > 0.0 else 0.0
    return round(min(max(wanted, CHUNK_BYTES), LARGEST_CHUNK_BYTES))


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


def summary(path: Path, recording: Recording, shift: int) -> dict[str, str]:
    """The metadata record: layout, clock and the recording's own metadata as JSON, with a checksum."""
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


def register(writer: Any, channels: Any) -> dict[str, int]:
    """Announces schemas and topics; the writer's channel ids by name."""
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


def add(writer: Any, ids: dict[str, int], channels: Any, counts: dict[str, int]) -> None:
    """Appends channels of one common clock, frame by frame; `counts` are the frames written so far, and are brought up."""
    stamps = {name: [round(t * 1e9) for t in channel.time.tolist()] for name, channel in channels.items()}
    encoded = {name: cdr.encode(channel, stamps[name]) for name, channel in channels.items()}
    for i in range(min(map(len, stamps.values()), default=0)):
        for name, ns in stamps.items():
            writer.add_message(ids[name], log_time=ns[i], publish_time=ns[i], sequence=counts[name], data=encoded[name][i])
            counts[name] += 1


def _in_time(stamps: dict[str, list[int]]) -> list[tuple[str, int]]:
    """(channel, frame) in order of time, frames of a channel never swapped even when its clock jumps back."""
    keys = []
    for order, (name, several) in enumerate(stamps.items()):
        latest = -1
        for i, ns in enumerate(several):
            latest = max(latest, ns)
            keys.append((latest, order, i, name))
    return [(name, i) for _, _, i, name in sorted(keys)]


def read_mcap(path: Path, data: Any, columns: Columns | None = None, *, recover: bool = False) -> Recording:
    """A recording from our own file or another program's ROS 2 MCAP, mapped by `columns`.

    A file cut short is read up to the cut, with a warning. Damage is a RecordingError; with `recover` the damaged
    chunks are left out, with a warning for each.
    """
    columns = columns or Columns()
    turns: list[messages.Transforms] = []
    walk = walk_wanted(path, data, columns, recover)
    if RECORD in walk.metadata or any(RECORD in c.metadata for c in walk.channels.values()):
        recording = _own(path, walk, recover)
    elif not walk.channels and walk.faults:
        raise RecordingError(f"{path}: {walk.faults[0]}: nothing else is in it")
    elif not walk.channels and not walk.complete:
        raise RecordingError(f"{path}: cut before the first channel: nothing to recover")
    else:
        notes: list[str] = []
        recording, turns = messages.recording(path, topics(path, walk, notes), columns.time, notes)
    recording = said(path, recording, walk.faults)
    return mapped(path, recording, columns, turns)


def said(path: Path, recording: Recording, faults: list[str]) -> Recording:
    """Damage that was read around: warned of now, and in the notes that travel with the data."""
    for text in faults:
        warnings.warn(f"{path}: {text}", ComanipWarning, stacklevel=6)
    return recording.with_metadata(notes=[*recording.metadata.get("notes", ()), *faults]) if faults else recording


def walk_wanted(path: Path, data: Any, columns: Columns, recover: bool) -> Walk:
    """All topics, or, where these are too much to hold, those that are mapped alone."""
    try:
        return walk_through(path, data, recover)
    except TooMuch:
        named = [e.lstrip("-") for es in (*columns.mapped.values(), *columns.extra.values()) for e in es]
        if not named:
            raise
        wanted = tuple(e if e.startswith("/") else f"/{e}" for e in named)
        return walk_through(path, data, recover, lambda topic: topic in ("/tf", "/tf_static") or _leads(topic, wanted))


def _leads(topic: str, expressions: tuple[str, ...]) -> bool:
    return any(e == topic or e.startswith((f"{topic}.", f"{topic}[")) for e in expressions)


def _own(path: Path, walk: Walk, recover: bool) -> Recording:
    """Our own file; its metadata record may be whole and say what cannot be."""
    try:
        return _assembled(path, walk, recover)
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise RecordingError(f"{path}: damaged: its metadata record does not fit ({' '.join(str(error).split())})") from None


def _assembled(path: Path, walk: Walk, recover: bool) -> Recording:
    """Values by the channels' metadata, the rest from the metadata record."""
    texts = walk.metadata.get(RECORD, {})
    if texts and texts.get("sha256") != _digest(texts):
        fault(path, walk, "the metadata record is damaged (its sha256 does not match)", recover)
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
            rows = walk.messages.get(channel_id, [])
            values = cdr.decode(walk.schemas[mcap_channel.schema_id].name, axes, [m.data for m in rows])
            time = np.array([(m.log + shift) / 1e9 for m in rows])
            if name in channels and len(channels[name].time):
                raise RecordingError(f"{name} is written twice: two takes merged into one file? split them")
            channels[name] = Channel(time, values, unit, frame, tuple(axes))
        except (KeyError, ValueError, TypeError, RecordingError) as error:
            fault(path, walk, f"channel {mcap_channel.topic!r}: {error}", recover)
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
