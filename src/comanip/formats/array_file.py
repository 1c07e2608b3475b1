"""Arrays: .npy, .npz and MATLAB's .mat (up to 7.2). Nothing in them is ever executed: pickled objects are refused."""

from __future__ import annotations

import re
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from .columns import sign_and_name, unknown

MAX_UNPACKED = 256 << 20
_TOKEN = re.compile(r"\[([^\]]*)\]|\.?([^.\[\]]+)")


class ArrayTree:
    """Named arrays, possibly in structs; a path that meets a struct array without an index means one recording each."""

    def __init__(self, path: Path, tree: dict[str, Any]) -> None:
        self.path = path
        self.notes: list[str] = []
        self._tree = tree

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
        return ""  # arrays carry none

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
        members = value if isinstance(value, dict) else getattr(value, "__dict__", {})
        if key not in members:
            raise unknown(str(self.path), name, self.names)
        return members[key]

    def _indexed(self, name: str, value: Any, text: str) -> Any:
        try:
            parts = tuple(_index(part) for part in text.split(","))
            return np.asarray(value)[parts if len(parts) > 1 else parts[0]]
        except (ValueError, IndexError, TypeError):
            shape = np.asarray(value).shape
            raise ChannelError(f"{self.path}: {name!r}: no part [{text}] in shape {shape}; use 0-based indices") from None

    def _numeric(self, name: str, value: Any) -> Array:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            below = ", ".join(_leaves(name, value)) or "none"
            raise ChannelError(f"{self.path}: {name!r} is no array of numbers; below it there are: {below}")
        return array.astype(np.float64)


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
    if hasattr(value, "_fieldnames"):
        return [leaf for field in value._fieldnames for leaf in _leaves(f"{name}.{field}", getattr(value, field))]
    return [name] if isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "fiub" else []


def read_numpy(path: Path) -> ArrayTree:
    """A .npy (one array, its columns by index) or .npz (arrays by name)."""
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                declared = sum(entry.file_size for entry in archive.infolist())
            if declared > MAX_UNPACKED:
                raise RecordingError(
                    f"{path}: unpacks to {declared >> 20} MB; the limit is {MAX_UNPACKED >> 20} MB: cut it into takes"
                )
        loaded = np.load(path, allow_pickle=False)
        tree = {"array": loaded} if isinstance(loaded, np.ndarray) else {key: loaded[key] for key in loaded.files}
    except RecordingError:
        raise
    except Exception as error:  # numpy, zipfile and zlib raise their own kinds on damaged input
        raise RecordingError(f"{path}: not readable as numpy arrays: {_line(error)}") from None
    return ArrayTree(path, tree)


def read_mat(path: Path) -> ArrayTree:
    """A MATLAB file of version 5 to 7.2."""
    from scipy.io import loadmat  # slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # duplicate names of unreadable MATLAB objects
            loaded = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # scipy raises a dozen kinds on damaged input
        raise RecordingError(f"{path}: not readable as a MATLAB file: {_line(error)}") from None
    return ArrayTree(path, {k: v for k, v in loaded.items() if not k.startswith("__") and k != "None"})


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
