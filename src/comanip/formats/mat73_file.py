"""MATLAB's .mat files of version 7.3: HDF5, transposed, with structs as groups and cells as references."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from .array_file import ArrayTree
from .mat_file import LeftOut

_DEPTH = 24


def read_mat73(path: Path) -> ArrayTree:
    """A MATLAB 7.3 file; RecordingError that says what to install or how to save it otherwise."""
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path}: MATLAB 7.3 (HDF5): save it with -v7 or as CSV, or install h5py: pip install 'comanip[hdf5]'"
        ) from None
    try:
        with h5py.File(path, "r") as file:
            return ArrayTree(path, {n: _value(file, file[n], 0) for n in file if not n.startswith("#")})
    except RecordingError:
        raise
    except Exception as error:  # h5py raises a dozen kinds on damaged input
        raise RecordingError(f"{path}: not readable as MATLAB 7.3: {' '.join(str(error).split())}") from None


def _value(file: Any, item: Any, depth: int) -> Any:
    """An array, a dict for a struct, an object array for a struct array or cell."""
    import h5py

    if depth > _DEPTH:
        return LeftOut(f"a struct in structs, deeper than {_DEPTH}")
    if isinstance(item, h5py.Group):
        members = {n: _value(file, item[n], depth + 1) for n in item}
        return _struct_array(members) if all(isinstance(item[n], h5py.Dataset) and _refers(item[n]) for n in item) else members
    if _refers(item):
        found = np.empty(item.shape, dtype=object)
        for at, reference in np.ndenumerate(item[()]):
            found[at] = _value(file, file[reference], depth + 1) if reference else np.empty(0)
        found = found.T.squeeze()
        return found.item() if found.ndim == 0 else found
    if item.dtype.kind not in "fiub" or item.attrs.get("MATLAB_class") in (b"char",):
        return LeftOut("a text, or numbers that are not real")
    if item.attrs.get("MATLAB_empty"):
        return np.empty(0)
    return item[()].T.squeeze()


def _refers(item: Any) -> bool:
    return item.dtype.kind == "O" if hasattr(item, "dtype") else False


def _struct_array(members: dict[str, Any]) -> Any:
    """Fields that are references, one an element, are an array of structs: [{field: value}, ...]."""
    counts = {value.size if isinstance(value, np.ndarray) and value.dtype == object else 1 for value in members.values()}
    if len(counts) != 1 or not members or (count := counts.pop()) == 1:
        return members
    flat = {name: value.ravel() for name, value in members.items()}
    found = np.empty(count, dtype=object)
    for i in range(count):
        found[i] = {name: values[i] for name, values in flat.items()}
    return found
