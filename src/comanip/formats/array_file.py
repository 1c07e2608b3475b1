"""Arrays: .npy, .npz and MATLAB's .mat. Nothing in them is ever executed: pickled objects are refused when asked for."""

from __future__ import annotations

import ast
import io
import re
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from .columns import sign_and_name, unknown
from .mat_file import MAX_UNPACKED, Damaged, LeftOut, mat_variables

_HEADER = 65_536  # bytes of a .npy's header; structured arrays of a thousand fields fit
_TOKEN = re.compile(r"\[([^\]]*)\]|\.?([^.\[\]]+)")


class ArrayTree:
    """Named arrays, possibly in structs; a path that meets a struct array without an index means one recording each."""

    def __init__(self, path: Path, tree: dict[str, Any]) -> None:
        self.path = path
        self.notes: list[str] = []
        self._tree = tree
        self._dated: set[str] = set()  # what turned out to hold dates: seconds, whatever their own unit

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(n for key, value in self._tree.items() for n in _leaves(key, value))

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self._tree)
        tokens = [(index, key) for index, key in _TOKEN.findall(name)]
        if list(self._tree) == ["array"] and not (tokens and tokens[0][1] == "array"):
            # A bare .npy has no names: "2" and "[:,2]" both mean its third column.
            tokens = [
                ("", "array"),
                (f":,{name}", "") if name.isdigit() else tokens[0] if tokens else ("", ""),
                *tokens[1:],
            ]
        return [sign * self._numeric(name, found) for found in self._walk(name, tokens)]

    def unit(self, expression: str) -> str:
        return "s" if sign_and_name(expression, self._tree)[1] in self._dated else ""  # other arrays carry none

    def _walk(self, name: str, tokens: list[tuple[str, str]]) -> list[Any]:
        here: list[Any] = [self._tree]
        for index, key in tokens:
            if index:
                here = [self._indexed(name, value, index) for value in here]
                continue
            here = [e for value in here for e in (value.ravel() if _is_structs(value) else [value])]
            here = [self._member(name, value, key) for value in here]
        return [e for value in here for e in (value.ravel() if _is_structs(value) else [value])]

    def _member(self, name: str, value: Any, key: str) -> Any:
        if not isinstance(value, dict) or key not in value:
            raise unknown(str(self.path), name, self.names)
        return value[key]

    def _indexed(self, name: str, value: Any, text: str) -> Any:
        try:
            parts = tuple(_index(part) for part in text.split(","))
            return np.asarray(value)[parts if len(parts) > 1 else parts[0]]
        except (ValueError, IndexError, TypeError):
            shape = np.asarray(value).shape
            raise ChannelError(f"{self.path}: {name!r}: no part [{text}] in shape {shape}; use 0-based indices") from None

    def _numeric(self, name: str, value: Any) -> Array:
        if isinstance(value, LeftOut):
            raise ChannelError(f"{self.path}: {name!r} is not read: it is {value.why}")
        if isinstance(value, np.ndarray) and value.dtype.kind in "mM":
            return self._seconds(name, value)
        if isinstance(value, dict) or np.asarray(value).dtype.kind not in "fiub":
            below = ", ".join(_leaves(name, value)) or "none"
            raise ChannelError(f"{self.path}: {name!r} is no array of numbers; below it there are: {below}")
        return np.asarray(value).astype(np.float64)

    def _seconds(self, name: str, value: np.ndarray) -> Array:
        """Dates as seconds since the first one, durations as seconds; what is no time is NaN."""
        known = value.ravel()[~np.isnat(value.ravel())]
        first = known[0] if len(known) and value.dtype.kind == "M" else None
        since = value - first if first is not None else value.astype("timedelta64[ns]")
        self._dated.add(name)
        text = f"{name!r} holds times: read as seconds" + ("" if first is None else f", the first is {first}")
        if text not in self.notes:
            self.notes.append(text)
        seconds = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
        return np.asarray(np.where(np.isnat(value), np.nan, seconds))


def _index(text: str) -> int | slice:
    if ":" not in text:
        return int(text)
    return slice(*(int(part) if part.strip() else None for part in text.split(":")))


def _is_structs(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object


def _leaves(name: str, value: Any) -> list[str]:
    """Paths of the numeric arrays below a value; of a struct array, those of its first element."""
    if _is_structs(value):
        return [leaf.replace(name, f"{name}[i]", 1) for leaf in _leaves(name, value.ravel()[0])] if value.size else []
    if isinstance(value, dict):
        return [leaf for field, member in value.items() for leaf in _leaves(f"{name}.{field}", member)]
    return [name] if isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "fiubmM" else []


def read_numpy(path: Path, data: bytes) -> ArrayTree:
    """A .npy (one array, its columns by index or its fields by name) or .npz (arrays by name)."""
    try:
        if data.startswith(b"\x93NUMPY"):
            array = _npy(data)
            if isinstance(array, LeftOut):
                raise RecordingError(f"{path}: it holds {array.why}")
            return ArrayTree(path, array if isinstance(array, dict) else {"array": array})
        arrays = _npz(path, data)
        if (left := [n for n, value in arrays.items() if isinstance(value, LeftOut)]) and len(left) == len(arrays):
            raise RecordingError(f"{path}: nothing in it is read: {left[0]!r} is {arrays[left[0]].why}")
        return ArrayTree(path, arrays)
    except RecordingError:
        raise
    except Exception as error:  # zipfile, zlib, ast and numpy raise their own kinds on damaged input
        raise RecordingError(f"{path}: not readable as numpy arrays: {_line(error)}") from None


def _npz(path: Path, data: bytes) -> dict[str, Any]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        declared = sum(entry.file_size for entry in entries)
        if declared > MAX_UNPACKED:
            raise RecordingError(
                f"{path}: unpacks to {declared >> 20} MB; the limit is {MAX_UNPACKED >> 20} MB: cut it into takes"
            )
        return {entry.filename.removesuffix(".npy"): _npy(archive.read(entry)) for entry in entries}


def _npy(data: bytes) -> Any:
    """One array, a dict of arrays for a structured one, LeftOut for objects; nothing is unpickled, and nothing is made of a
    header that declares more than there is."""
    if not data.startswith(b"\x93NUMPY") or len(data) < 12 or data[6] not in (1, 2, 3):
        raise Damaged("no .npy of version 1 to 3")
    width = 2 if data[6] == 1 else 4
    (length,) = struct.unpack_from("<H" if width == 2 else "<I", data, 8)
    start = 8 + width + length
    if length > _HEADER or start > len(data):
        raise Damaged(f"a header of {length} bytes: cut or damaged")
    header = ast.literal_eval(data[8 + width : start].decode("utf-8" if data[6] == 3 else "latin-1").strip())
    dtype, shape = np.lib.format.descr_to_dtype(header["descr"]), tuple(int(n) for n in header["shape"])
    if dtype.hasobject:
        return LeftOut("a pickled Python object, which is never run: save plain arrays, np.savez(path, t=t, z=z)")
    count = 1
    for n in shape:
        count *= n
    if min(shape, default=0) < 0 or count * dtype.itemsize > len(data) - start or dtype.itemsize == 0:
        raise Damaged(f"{dtype} of shape {shape} where {len(data) - start} bytes are left: cut or damaged")
    array = np.frombuffer(data, dtype, count, start).reshape(shape, order="F" if header["fortran_order"] else "C")
    return _fields(array)


def _fields(array: np.ndarray) -> Any:
    """A structured array as a dict of its fields."""
    return array if array.dtype.names is None else {name: _fields(array[name]) for name in array.dtype.names}


def read_mat(path: Path, data: bytes) -> ArrayTree:
    """A MATLAB file of version 4 to 7.2."""
    return ArrayTree(path, mat_variables(path, data))


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
