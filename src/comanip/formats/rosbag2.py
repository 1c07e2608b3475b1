"""Bags of ROS 2 as they lie on disk: a folder with metadata.yaml and its files (MCAP or SQLite), or one .db3 file alone."""

from __future__ import annotations

import re
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import RecordingError
from ..recording import Recording
from . import messages
from .columns import Columns
from .files import mapped_bytes
from .mapping import mapped
from .mcap_chunk import MAX_MESSAGE
from .mcap_walk import MAX_KEPT, Walk
from .messages import Message, Topic
from .ros2 import definition

MAX_METADATA = 4 << 20
MAX_FILE = 4 << 30  # of a packed file, unpacked
MAX_STEPS = 200_000  # thousands of steps of SQLite's machine: minutes, where a sound bag takes seconds
SQLITE = b"SQLite format 3\0"


class Facts(NamedTuple):
    """What metadata.yaml says of a bag."""

    files: tuple[str, ...]
    messages: int | None
    packed: str  # "", "file" or "message"


def open_folder(path: Path, data: Any, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    return (read_folder(path, columns, recover=recover),)


def open_file(path: Path, data: Any, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    return (read_sqlite(path, columns),)


@dataclass
class _Found:
    """What the files of a bag hold."""

    topics: list[Topic] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    seen: int = 0  # messages, also those that are not read


def read_folder(path: Path, columns: Columns, *, recover: bool = False) -> Recording:
    """One recording from all files of a bag, in the order of metadata.yaml. RecordingError for a file that is missing."""
    facts = facts_of(path / "metadata.yaml")
    found = _Found()
    for name in facts.files:
        with _unpacked(path, path / name) as file:
            _add(found, file, columns, recover)
    if facts.packed == "message":
        for topic in found.topics:
            topic.messages = [m._replace(data=_message(path, topic.name, m.data)) for m in topic.messages]
    if facts.messages is not None and found.seen < facts.messages:  # a loss that nothing else would show
        text = f"metadata.yaml says {facts.messages} messages, {found.seen} are in the files"
        if not (recover or found.faults):
            raise RecordingError(f"{path}: {text}; recover=True reads them")
        found.faults.append(text)
    return _finished(path, found, columns)


def read_sqlite(path: Path, columns: Columns) -> Recording:
    """One recording from a .db3 file without its metadata.yaml."""
    found = _Found()
    _add_sqlite(found, path)
    return _finished(path, found, columns)


def _finished(path: Path, found: _Found, columns: Columns) -> Recording:
    from .mcap_file import said

    recording, turns = messages.recording(path, found.topics, columns.time, found.notes)
    return mapped(path, said(path, recording, found.faults), columns, turns)


def facts_of(path: Path) -> Facts:
    """The few lines of metadata.yaml that matter; it is written by one program, so no YAML reader is needed."""
    data = path.read_bytes()[: MAX_METADATA + 1]
    if len(data) > MAX_METADATA:
        raise RecordingError(f"{path}: more than {MAX_METADATA >> 20} MB; a bag's metadata take a few kB")
    text = data.decode("utf-8", "replace")
    if "rosbag2_bagfile_information" not in text:
        raise RecordingError(f"{path}: not the metadata of a bag: no rosbag2_bagfile_information in it")
    listed = re.search(r"^ *relative_file_paths: *(\[[^\]]*\]|(?:\n *- *[^\n]*)*)", text, re.MULTILINE)
    items = re.findall(r"(?:^ *- *|[\[,] *)([^\n,\]]+)", listed[1], re.MULTILINE) if listed else []
    files = tuple(item.strip().strip("'\"") for item in items if item.strip())
    if not files:
        raise RecordingError(f"{path}: it lists no files (relative_file_paths)")
    for name in files:
        if Path(name).is_absolute() or ".." in Path(name).parts or "\\" in name:
            raise RecordingError(f"{path}: lists {name!r}; allowed: files beside it")
    mode = re.search(r"^ *compression_mode: *['\"]?(\w*)", text, re.MULTILINE)
    kind = re.search(r"^ *compression_format: *['\"]?(\w*)", text, re.MULTILINE)
    if kind and kind[1] not in ("", "none", "zstd"):
        raise RecordingError(f"{path}: compression {kind[1]!r} is not read; allowed: zstd, none")
    count = re.search(r"^  message_count: *(\d+)", text, re.MULTILINE)
    packed = mode[1].lower() if mode and mode[1].lower() in ("file", "message") else ""
    return Facts(files, int(count[1]) if count else None, packed)


def _message(path: Path, topic: str, data: bytes) -> bytes:
    import zstandard

    try:
        if zstandard.frame_content_size(data) > MAX_MESSAGE:
            raise RecordingError(f"{path}: {topic}: a message unpacks to more than {MAX_MESSAGE >> 10} kB")
        return zstandard.decompress(data, max_output_size=MAX_MESSAGE)
    except zstandard.ZstdError as error:
        raise RecordingError(f"{path}: {topic}: a message cannot be unpacked ({' '.join(str(error).split())})") from None


@contextmanager
def _unpacked(folder: Path, file: Path) -> Iterator[Path]:
    """The file, or, of a packed one (.zstd), a copy that is unpacked while it is read."""
    if not file.exists():
        raise RecordingError(f"{folder}: metadata.yaml lists {file.name}, which is not there; copy the whole folder")
    if file.suffix not in (".zstd", ".zst"):
        yield file
        return
    import zstandard

    with tempfile.TemporaryDirectory() as place, file.open("rb") as packed:
        copy, size = Path(place) / file.stem, 0
        try:
            with copy.open("wb") as out:
                for part in zstandard.ZstdDecompressor().read_to_iter(packed):
                    size += len(part)
                    if size > MAX_FILE:
                        raise RecordingError(f"{file}: unpacks to more than {MAX_FILE >> 30} GB: split the bag")
                    out.write(part)
        except zstandard.ZstdError as error:
            raise RecordingError(f"{file}: cannot be unpacked ({' '.join(str(error).split())})") from None
        yield copy


def _add(found: _Found, file: Path, columns: Columns, recover: bool) -> None:
    from .mcap_file import walk_wanted
    from .mcap_foreign import topics

    with file.open("rb") as stream:
        head = stream.read(16)
    if head == SQLITE:
        _add_sqlite(found, file)
        return
    with mapped_bytes(file) as data:
        walk: Walk = walk_wanted(file, data, columns, recover)
    found.topics += topics(file, walk, found.notes)
    found.faults += walk.faults
    found.seen += walk.seen


def _add_sqlite(found: _Found, path: Path) -> None:
    try:
        with closing(_opened(path)) as base:
            _add_tables(found, path, base)
    except (sqlite3.Error, UnicodeError, OverflowError) as error:  # names of columns that are no text raise the second
        raise RecordingError(f"{path}: not readable as a bag in SQLite: {' '.join(str(error).split())}") from None


def _opened(path: Path) -> sqlite3.Connection:
    """Read only; what a crashed recorder left in its journal (-wal) is read too, where the folder can be written to."""
    journal = path.with_name(path.name + "-wal")
    how = "mode=ro" if journal.exists() and journal.stat().st_size else "mode=ro&immutable=1"
    base = sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True)
    base.text_factory = lambda raw: raw.decode("utf-8", "replace")
    base.execute("PRAGMA trusted_schema = OFF")
    base.execute("PRAGMA cell_size_check = ON")
    steps = iter(range(MAX_STEPS))
    base.set_progress_handler(lambda: next(steps, None) is None, 1000)
    return base


def _add_tables(found: _Found, path: Path, base: sqlite3.Connection) -> None:
    tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"topics", "messages"} <= tables:
        raise RecordingError(
            f"{path}: a database without the tables of a bag (topics, messages); it has: {', '.join(sorted(tables))}"
        )
    damaged = base.execute("PRAGMA quick_check(1)").fetchone()
    if damaged and damaged[0] != "ok":
        raise RecordingError(f"{path}: damaged: {' '.join(str(damaged[0]).split())}")
    texts = _definitions(base) if "message_definitions" in tables else {}
    topics: dict[int, Topic] = {}
    for number, name, kind, coding in base.execute("SELECT id, name, type, serialization_format FROM topics"):
        text = texts.get(kind) or definition(str(kind))
        if coding != "cdr" or text is None:
            why = f"{coding!r} messages" if coding != "cdr" else f"messages of type {kind} without a definition"
            found.notes.append(f"{name} left out: {why} are not read")
            continue
        topics[number] = Topic(str(name), str(kind), text)
    found.seen += _fill(path, base, topics, found.notes)
    found.topics += topics.values()


def _definitions(base: sqlite3.Connection) -> dict[str, str]:
    rows = base.execute("SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'")
    return {str(kind): str(text) for kind, text in rows}


def _fill(path: Path, base: sqlite3.Connection, topics: dict[int, Topic], notes: list[str]) -> int:
    """The messages, in the order they were stored; pictures are counted and not held. How many there are."""
    kept, seen, large = 0, 0, dict.fromkeys(topics, 0)
    asked = "SELECT topic_id, timestamp, length(data), CASE WHEN length(data) <= ? THEN data END FROM messages ORDER BY id"
    for number, stamp, size, data in base.execute(asked, (MAX_MESSAGE,)):
        seen += 1
        if number not in topics:
            continue
        if not isinstance(stamp, int) or not 0 <= stamp < 1 << 63 or not isinstance(data, bytes | None):
            raise RecordingError(f"{path}: a message of {topics[number].name} at {stamp!r}: damaged")
        if data is None:
            large[number] = max(large[number], int(size or 0))
            continue
        kept += len(data) + 64
        if kept > MAX_KEPT:
            raise RecordingError(f"{path}: its messages take more than {MAX_KEPT >> 20} MB: cut it into takes")
        topic = topics[number]
        topic.messages.append(Message(stamp, stamp, len(topic.messages), data))
    for number, size in large.items():
        if size:
            notes.append(
                f"{topics[number].name}: messages of up to {size / 2**20:.3g} MB left out: pictures and clouds are not read"
            )
    return seen
