"""MATLAB's .mat files of version 4 to 7.2, read here: other readers trust their lengths, and an altered file ends the process.

Every length is held against the bytes that are there before anything is made of it. Numbers, texts, cells and structs are read;
sparse matrices, function handles and objects of classes are named and left out.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import RecordingError

MAX_UNPACKED = 256 << 20
_DEPTH = 24  # structs in structs
_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
    18: "u4",
}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _LAST_NUMBER = 1, 2, 3, 4, 5, 15


class LeftOut:
    """Something in a file that is not read, and why."""

    def __init__(self, why: str) -> None:
        self.why = why


class Damaged(Exception):
    """What does not fit in a file."""


class _Element(NamedTuple):
    kind: int
    data: memoryview


def mat_variables(path: Path, data: bytes) -> dict[str, Any]:
    """Variable -> array (squeezed), text, dict (struct), object array (struct array, cell) or LeftOut. RecordingError."""
    try:
        if data[:10] in (b"MATLAB 5.0", b"MATLAB 7.0") or data[126:128] in (b"IM", b"MI"):
            return _version_5(data)
        return _version_4(data)
    except Damaged as error:
        raise RecordingError(f"{path}: not readable as a MATLAB file: {error}") from None


def _version_5(data: bytes) -> dict[str, Any]:
    if len(data) < 128:
        raise Damaged("it is cut in its header")
    order = ">" if data[126:128] == b"MI" else "<"
    variables: dict[str, Any] = {}
    room = MAX_UNPACKED
    for element in _elements(memoryview(data)[128:], order):
        if element.kind == _COMPRESSED:
            whole = _unpacked(element.data, room)
            room -= len(whole)
            element = next(_elements(memoryview(whole), order), _Element(0, memoryview(b"")))
        if element.kind != _MATRIX:
            raise Damaged(f"an element of kind {element.kind} where a variable should be")
        name, value = _matrix(element.data, order, 0)
        if name in variables:
            raise Damaged(f"two variables are called {name!r}")
        if name:  # what has no name is MATLAB's own store of objects
            variables[name] = value
    return variables


def _unpacked(data: memoryview, room: int) -> bytes:
    """Inflated, at most `room` bytes; the stream's checksum is verified."""
    stream = zlib.decompressobj()
    try:
        whole = stream.decompress(data, room + 1)
    except zlib.error as error:
        raise Damaged(f"a compressed variable is damaged ({error})") from None
    if len(whole) > room:
        raise Damaged(f"unpacks to more than {MAX_UNPACKED >> 20} MB: cut it into takes")
    if not stream.eof:
        raise Damaged("a compressed variable is cut")
    return whole


def _elements(data: memoryview, order: str) -> Any:
    """Every element of a run of bytes; a length beyond the end is damage."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        start, step = at + 8, size
        if kind >> 16:  # a small one: its length beside its kind, its data in the other half
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 4
            if size > 4:
                raise Damaged(f"a small element of {size} bytes")
        if start + size > len(data):
            raise Damaged(f"an element of {size} bytes where {len(data) - start} are left: cut or damaged")
        yield _Element(kind, data[start : start + size])
        at = start + step + (0 if kind == _COMPRESSED else -step % 8 if start == at + 8 else 0)


def _numbers(element: _Element, order: str) -> np.ndarray:
    if element.kind not in _TYPES:
        raise Damaged(f"numbers of kind {element.kind}")
    dtype = np.dtype(order + _TYPES[element.kind])
    if len(element.data) % dtype.itemsize:
        raise Damaged(f"{len(element.data)} bytes of {dtype.itemsize}-byte numbers")
    return np.frombuffer(element.data, dtype)


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """(name, value) of one variable, field or cell."""
    if depth > _DEPTH:
        raise Damaged(f"structs in structs, deeper than {_DEPTH}")
    parts = _elements(data, order)
    if not len(data):
        return "", np.empty(0)
    flags = _numbers(_next(parts), order)
    if not len(flags):
        raise Damaged("a variable without a class")
    kind = int(flags[0]) & 0xFF
    if not _CELL <= kind <= _LAST_NUMBER:  # function handles, objects of classes: their layout is MATLAB's own
        return _opaque_name(parts), LeftOut("a function handle or an object of a class")
    shape = tuple(int(n) for n in _numbers(_next(parts), order))
    name = bytes(_next(parts).data).decode("latin-1")
    count = _count(shape)
    if kind == _SPARSE:
        return name, LeftOut("a sparse matrix: store full(...) of it")
    if kind == _CELL:
        return name, _squeezed([_child(parts, order, depth) for _ in _counted(count, data)], shape)
    if kind in (_STRUCT, _OBJECT):
        return name, _structs(parts, shape, order, depth, data, named=kind == _OBJECT)
    values = _numbers(_next(parts, optional=count == 0), order)
    if len(values) != count:
        raise Damaged(f"{name!r} has {len(values)} values for the shape {shape}")
    if kind == _CHAR:
        return name, "".join(map(chr, np.minimum(values.astype(np.uint32), 0x10FFFF).tolist()))
    if int(flags[0]) & 0x0800:
        return name, LeftOut("complex numbers")
    return name, values.reshape(shape, order="F").squeeze()


def _next(parts: Any, *, optional: bool = False) -> _Element:
    element = next(parts, None)
    if element is None:
        if optional:
            return _Element(9, memoryview(b""))
        raise Damaged("a variable is cut")
    return element


def _opaque_name(parts: Any) -> str:
    try:
        return bytes(_next(parts).data).decode("latin-1")
    except Damaged:
        return ""


def _count(shape: tuple[int, ...]) -> int:
    count = 1
    for n in shape:
        if n < 0 or len(shape) > 32:
            raise Damaged(f"the shape {shape[:8]}")
        count *= n
    return count


def _counted(count: int, data: memoryview) -> range:
    """As many elements as are declared, if there can be so many: each takes 8 bytes at least."""
    if count * 8 > len(data):
        raise Damaged(f"{count} elements declared in {len(data)} bytes")
    return range(count)


def _child(parts: Any, order: str, depth: int) -> Any:
    element = _next(parts)
    if element.kind != _MATRIX:
        raise Damaged(f"an element of kind {element.kind} in a cell or struct")
    return _matrix(element.data, order, depth + 1)[1]


def _structs(parts: Any, shape: tuple[int, ...], order: str, depth: int, data: memoryview, *, named: bool) -> Any:
    if named:
        _next(parts)  # the name of the class
    width = _numbers(_next(parts), order)
    names = bytes(_next(parts).data)
    if not len(width) or width[0] < 1 or len(names) % int(width[0]):
        raise Damaged("the names of a struct's fields")
    step = int(width[0])
    fields = [names[i : i + step].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), step)]
    count = _count(shape)
    _counted(count * max(len(fields), 1), data)
    return _squeezed([{field: _child(parts, order, depth) for field in fields} for _ in range(count)], shape)


def _squeezed(values: list[Any], shape: tuple[int, ...]) -> Any:
    """An object array without dimensions of length 1; the value itself when there is but one."""
    if len(values) == 1:
        return values[0]
    array = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):
        array[i] = value
    return array.reshape(shape, order="F").squeeze()


def _version_4(data: bytes) -> dict[str, Any]:
    """Variables of MATLAB 4 (save -v4): a header of five integers each."""
    variables: dict[str, Any] = {}
    at = 0
    while at < len(data):
        if at + 20 > len(data):
            raise Damaged("unknown kind of file, or cut")
        order = "<" if 0 <= struct.unpack_from("<i", data, at)[0] < 5000 else ">"
        kind, rows, columns, imaginary, length = struct.unpack_from(order + "5i", data, at)
        machine, zero, number, full = kind // 1000, kind // 100 % 10, kind // 10 % 10, kind % 10
        if (
            not 0 <= kind < 5000
            or machine > 1
            or zero
            or number > 5
            or full > 2
            or min(rows, columns, length) < 0
            or length > 256
        ):
            raise Damaged("unknown kind of file")
        dtype = np.dtype(order + ("f8", "f4", "i4", "i2", "u2", "u1")[number])
        start, size = at + 20 + length, rows * columns * dtype.itemsize * (2 if imaginary else 1)
        if start + size > len(data):
            raise Damaged(f"a variable of {size} bytes where {max(len(data) - start, 0)} are left: cut or damaged")
        name = data[at + 20 : start].split(b"\0")[0].decode("latin-1")
        values = np.frombuffer(data, dtype, rows * columns, start).reshape((rows, columns), order="F")
        variables[name] = values.squeeze() if full == 0 and not imaginary else LeftOut("a text, or complex or sparse numbers")
        at = start + size
    return variables
