"""MATLAB's .mat files of version 7.3: HDF5, transposed, with structs as groups and cells as references.

Their library can be crashed by a damaged file, so it reads them in a process that may die (`outside`), where `contents` takes the
tree apart into arrays and a description of how they hang together, and `read_mat73` puts it together again here.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from . import outside
from .array_file import ArrayTree
from .hdf5_inside import Budget
from .mat_file import LeftOut

_DEPTH = 24
_NUMBERS = "numbers"  # the name under which arrays come over


def read_mat73(path: Path) -> ArrayTree:
    """A MATLAB 7.3 file; RecordingError that says what to install or how to save it otherwise."""
    if find_spec("h5py") is None:
        raise RecordingError(
            f"{path}: MATLAB 7.3 (HDF5): save it with -v7 or as CSV, or install h5py: pip install 'comanip[hdf5]'"
        )
    try:
        parts, facts = outside.ask("mat73_file:contents", path)
    except RecordingError as error:
        raise RecordingError(f"{path}: not readable as MATLAB 7.3: {str(error).removeprefix(f'{path}: ')}") from None
    arrays = iter(parts.get(_NUMBERS, ()))
    return ArrayTree(path, {name: _together(one, arrays) for name, one in facts["variables"].items()})


def _together(one: dict[str, Any], arrays: Any) -> Any:
    """A value out of its description; the arrays come in the order in which `_apart` found them."""
    if "left_out" in one:
        return LeftOut(one["left_out"])
    if "fields" in one:
        return {name: _together(field, arrays) for name, field in one["fields"].items()}
    if "cells" in one:
        found = np.empty(len(one["cells"]), dtype=object)
        for i, cell in enumerate(one["cells"]):
            found[i] = _together(cell, arrays)
        return found.reshape(one["shape"])
    return next(arrays)


def contents(path: Path) -> tuple[outside.Parts, dict[str, Any]]:
    """(arrays, facts) of a file, in the process that may die: `facts["variables"]` says where each array belongs."""
    import h5py

    parts: outside.Parts = {_NUMBERS: []}
    budget = Budget()
    with h5py.File(path, "r") as file:
        variables = {n: _apart(_value(file, file[n], 0, budget), parts[_NUMBERS]) for n in file if not n.startswith("#")}
    return parts, {"variables": variables}


def _apart(value: Any, arrays: list[Any]) -> dict[str, Any]:
    if isinstance(value, LeftOut):
        return {"left_out": value.why}
    if isinstance(value, dict):
        return {"fields": {name: _apart(field, arrays) for name, field in value.items()}}
    if isinstance(value, np.ndarray) and value.dtype == object:
        return {"cells": [_apart(cell, arrays) for cell in value.ravel()], "shape": value.shape}
    arrays.append(np.asarray(value))
    return {}


def _value(file: Any, item: Any, depth: int, budget: Budget) -> Any:
    """An array, a dict for a struct, an object array for a struct array or cell."""
    import h5py

    budget.take(0)
    if depth > _DEPTH:
        return LeftOut(f"a struct in structs, deeper than {_DEPTH}")
    if isinstance(item, h5py.Group):
        members = {n: _value(file, item[n], depth + 1, budget) for n in item}
        return _struct_array(members) if all(isinstance(item[n], h5py.Dataset) and _refers(item[n]) for n in item) else members
    if not isinstance(item, h5py.Dataset):
        return LeftOut("a type and no numbers")
    if item.external or item.is_virtual:
        return LeftOut("stored in another file")
    if _refers(item):
        budget.take(8 * item.size, 0)
        found = np.empty(item.shape, dtype=object)
        for at, reference in np.ndenumerate(item[()]):
            found[at] = _value(file, file[reference], depth + 1, budget) if reference else np.empty(0)
        found = found.T.squeeze()
        return found.item() if found.ndim == 0 else found
    if item.dtype.kind not in "fiub" or item.dtype.itemsize > 8 or item.attrs.get("MATLAB_class") in (b"char",):
        return LeftOut("a text, or numbers that are not real")
    if item.attrs.get("MATLAB_empty"):
        return np.empty(0)
    budget.take(item.dtype.itemsize * item.size, 0)
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
