"""ROS 2 messages of any type: from the text of a definition and bytes (CDR) to columns of numbers.

A message is walked once for each shape it comes in (lengths of its strings and sequences); all messages of one shape are then
read as the rows of one table. Nothing in the bytes is trusted: every length is held against what is there.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from .ros2_types import DEFINITIONS

MAX_NUMBERS = 1024  # of one array: more is a scan or an image, not a channel
MAX_STRUCTS = 64  # of one array of structs
MAX_DEPTH = 16
MAX_SHAPES = 256  # of one topic: beyond that its messages have no layout to speak of
_CODES = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4",
    "uint32": "u4", "float32": "f4", "int64": "i8", "uint64": "u8", "float64": "f8",
}  # fmt: skip
_BLOB = ("u1", "i1")  # sequences of bytes are pictures and files, never signals
_FIELD = re.compile(r"^([A-Za-z][\w/]*)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+([A-Za-z]\w*)(?=\s|$)(?!\s*=)")
TIME, HEADER = "builtin_interfaces/Time", "std_msgs/Header"
_NO_SIGNALS = (HEADER, TIME, "builtin_interfaces/Duration", "std_msgs/MultiArrayLayout", "std_msgs/MultiArrayDimension")


class Field(NamedTuple):
    """One line of a definition; `length` is None for a single value, -1 for a sequence, else the length of an array."""

    name: str
    type: str
    length: int | None


class Block(NamedTuple):
    """Numbers that lie side by side in a message; `of` is the type of the struct that holds them."""

    path: str
    offset: int
    code: str
    length: int | None
    of: str


class Shape(NamedTuple):
    """Where everything lies in messages whose strings and sequences have the same lengths and texts."""

    size: int
    blocks: tuple[Block, ...]
    texts: Mapping[str, str]
    types: Mapping[str, str]
    fixed: tuple[tuple[int, bytes], ...]

    def fits(self, message: bytes) -> bool:
        return all(message[at : at + len(text)] == text for at, text in self.fixed)

    def stamp_at(self, path: str) -> tuple[Block, Block] | None:
        found = {b.path: b for b in self.blocks}
        pair = found.get(f"{path}.sec"), found.get(f"{path}.nanosec")
        return (pair[0], pair[1]) if pair[0] and pair[1] else None


def plain(name: str) -> str:
    """ "geometry_msgs/Pose" from "geometry_msgs/msg/Pose"."""
    return name.replace("/msg/", "/")


def parsed(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Fields of a message type and of all that it is made of; types that the text leaves out are taken from the common ones."""
    sections = re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)
    found = {plain(name): _fields(plain(name), sections[0])}
    for section in sections[1:]:
        head, _, body = section.strip().partition("\n")
        if head.startswith("MSG:"):
            inner = plain(head[4:].strip())
            found[inner] = _fields(inner, body)
    wanted = [f.type for fields in found.values() for f in fields]
    while wanted:
        kind = wanted.pop()
        if kind not in found and kind in DEFINITIONS:
            found[kind] = _fields(kind, DEFINITIONS[kind])
            wanted += [f.type for f in found[kind]]
    return found


def definition(name: str) -> str | None:
    """The text of a common type, for bags that were written without any."""
    return DEFINITIONS.get(plain(name))


def _fields(owner: str, text: str) -> tuple[Field, ...]:
    fields = []
    for line in text.splitlines():
        match = _FIELD.match(line.split("#", 1)[0].strip())
        if match:
            kind, brackets, length, name = match.groups()
            bounded = brackets is not None and "<=" in brackets
            count = None if brackets is None else int(length) if length and not bounded else -1
            fields.append(Field(name, _full(owner, kind), count))
    return tuple(fields)


def _full(owner: str, kind: str) -> str:
    if kind in _CODES or kind in ("string", "wstring"):
        return kind
    if kind in ("time", "Time") and owner == HEADER:
        return TIME
    if kind == "Header":
        return HEADER
    return plain(kind) if "/" in kind else f"{owner.split('/')[0]}/{kind}"


class Decoder:
    """Reads all messages of one topic. RecordingError names the field in which a message ends too early."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self._types = plain(name), parsed(name, text)
        self._shapes: dict[int, list[Shape]] = {}

    def shape(self, message: bytes) -> Shape:
        """The shape of a message, walked unless one like it was seen."""
        known = self._shapes.setdefault(len(message), [])
        for i, shape in enumerate(known):
            if shape.fits(message):
                if i:
                    known.insert(0, known.pop(i))  # the frequent one first
                return shape
        if sum(map(len, self._shapes.values())) >= MAX_SHAPES:
            raise RecordingError(f"{self.name}: more than {MAX_SHAPES} layouts: no channel can be made of it")
        shape = _Walker(self._types, message).walk(self.name)
        known.insert(0, shape)
        return shape

    def grouped(self, messages: Sequence[bytes]) -> list[tuple[Shape, list[int]]]:
        """Messages by shape: (shape, their numbers)."""
        groups: dict[int, tuple[Shape, list[int]]] = {}
        for i, message in enumerate(messages):
            shape = self.shape(message)
            groups.setdefault(id(shape), (shape, []))[1].append(i)
        return list(groups.values())


def table(shape: Shape, messages: Sequence[bytes]) -> np.ndarray:
    """(n, size) bytes of messages of one shape."""
    return np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(len(messages), -1)


def values(rows: np.ndarray, block: Block) -> Array:
    """(n, count) numbers of a block; 64-bit integers beyond 2^53 are rounded."""
    count = 1 if block.length is None else block.length
    dtype = np.dtype(block.code)
    part = np.ascontiguousarray(rows[:, block.offset : block.offset + count * dtype.itemsize])
    return part.view(dtype).reshape(len(rows), count).astype(np.float64)


class _Walker:
    """One pass over the bytes of one message."""

    def __init__(self, types: Mapping[str, tuple[Field, ...]], message: bytes) -> None:
        if len(message) < 4 or message[0] != 0 or message[1] > 1:
            raise RecordingError(f"a message begins with {message[:4].hex() or 'nothing'}: not plain CDR (0000 or 0001)")
        self._types, self._message, self._order = types, message, "<" if message[1] else ">"
        self._at = 4
        self._blocks: list[Block] = []
        self._texts: dict[str, str] = {}
        self._held: dict[str, str] = {}
        self._fixed: list[tuple[int, bytes]] = [(0, message[:4])]

    def walk(self, name: str) -> Shape:
        self._struct(name, "", 0, True)
        left = len(self._message) - self._at
        if left > 7:
            raise RecordingError(f"{left} bytes are left behind the last field of {name}: the definition does not fit")
        return Shape(len(self._message), tuple(self._blocks), self._texts, self._held, tuple(self._fixed))

    def _struct(self, name: str, path: str, depth: int, kept: bool) -> None:
        if name not in self._types:
            raise RecordingError(f"type {name!r} is not defined in the file")
        if depth > MAX_DEPTH:
            raise RecordingError(f"{name}: nested deeper than {MAX_DEPTH}")
        self._held[path] = name
        fields = self._types[name]
        for field in fields:
            self._field(name, field, f"{path}.{field.name}".lstrip("."), depth, kept)
        if not fields:
            self._skip(path, 1, 1)  # a struct without fields travels as one byte

    def _field(self, owner: str, field: Field, path: str, depth: int, kept: bool) -> None:
        count = field.length
        if count == -1:
            at = self._align(4)
            count = self._length(path)
            self._fixed.append((at, self._message[at : at + 4]))
        if field.type in _CODES:
            self._numbers(owner, field, path, count, kept)
        elif field.type in ("string", "wstring"):
            for i in range(1 if count is None else count):
                self._text(path if count is None else f"{path}[{i}]", field.type == "wstring")
        else:
            for i in range(1 if count is None else count):
                inner = path if count is None else f"{path}[{i}]"
                self._struct(field.type, inner, depth + 1, kept and i < MAX_STRUCTS)

    def _numbers(self, owner: str, field: Field, path: str, count: int | None, kept: bool) -> None:
        code = _CODES[field.type]
        size, many = int(code[1]), 1 if count is None else count
        if not many:
            return
        at = self._align(size)
        self._skip(path, size, many)
        if kept and many <= MAX_NUMBERS and not (field.length == -1 and code in _BLOB):
            self._blocks.append(Block(path, at, self._order + code, count, owner))

    def _text(self, path: str, wide: bool) -> None:
        at = self._align(4)
        length = self._length(path)
        start = self._at
        self._skip(path, 2 if wide else 1, length)
        raw = self._message[start : self._at]
        self._fixed.append((at, self._message[at : self._at]))
        self._texts[path] = raw.decode("utf-16-le" if wide else "utf-8", "replace").rstrip("\0")

    def _align(self, size: int) -> int:
        self._at += -(self._at - 4) % size
        return self._at

    def _length(self, path: str) -> int:
        at = self._at
        self._skip(path, 4, 1)
        length = int(struct.unpack_from(self._order + "I", self._message, at)[0])
        if length > len(self._message):
            raise RecordingError(f"{path}: declares {length} entries in a message of {len(self._message)} bytes")
        return length

    def _skip(self, path: str, size: int, count: int) -> None:
        self._at += size * count
        if self._at > len(self._message):
            raise RecordingError(f"a message of {len(self._message)} bytes ends within {path or 'its first field'}")


def leaves(shape: Shape) -> Iterator[tuple[str, str, Block]]:
    """(group, axis, block) of single numbers, and (path, "", block) of arrays; stamps and headers are no signals."""
    for block in shape.blocks:
        parents = _parents(block.path)
        if any(shape.types.get(p) in _NO_SIGNALS for p in parents):
            continue
        if block.length is None:
            group, _, axis = block.path.rpartition(".")
            yield group, axis, block
        else:
            yield block.path, "", block


def frame_of(shape: Shape, group: str) -> str:
    """frame_id of the innermost header around a group, "" when there is none; Odometry keeps its twist in the child's frame."""
    if shape.types.get("") == "nav_msgs/Odometry" and group.startswith("twist"):
        return shape.texts.get("child_frame_id") or f"child of {shape.texts.get('header.frame_id', '')}"
    for path in [group, *_parents(group)]:
        text = shape.texts.get(f"{path}.header.frame_id".lstrip("."))
        if text is not None:
            return text
    return ""


def _parents(path: str) -> list[str]:
    """Paths of the structs around a field, the innermost first; the message itself is ""."""
    parts = path.split(".")
    return [".".join(parts[:n]) for n in range(len(parts) - 1, -1, -1)]
