"""What is in an HDF5 file, read by its library in a process that may die of it; see `outside`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from .outside import Parts

MAX_BYTES = 256 << 20
MAX_DATASETS = 20_000
OURS = "comanip"


class Budget:
    """Bytes and datasets that may still be read."""

    def __init__(self) -> None:
        self.bytes, self.datasets = MAX_BYTES, MAX_DATASETS

    def take(self, size: int, datasets: int = 1) -> None:
        self.bytes -= size
        self.datasets -= datasets
        if self.bytes < 0:
            raise RecordingError(f"its arrays take more than {MAX_BYTES >> 20} MB, the limit: cut it into takes")
        if self.datasets < 0:
            raise RecordingError(f"it holds more than {MAX_DATASETS} arrays, the limit")


def contents(path: Path) -> tuple[Parts, dict[str, Any]]:
    """(numeric datasets by path, facts): notes, lengths that demonstrations state, the rate of their environment, our own
    header."""
    import h5py

    parts: Parts = {}
    facts: dict[str, Any] = {"notes": [], "lengths": {}}
    budget = Budget()
    with h5py.File(path, "r") as file:
        ours = file.get(OURS, getclass=True) is h5py.Dataset and file[OURS].dtype == np.uint8
        matlab = (not ours and "#refs#" in file) or any(
            "MATLAB_class" in item.attrs for item in file.values() if item is not None
        )
        _walk(h5py, file, "", parts, facts, budget, matlab, 0)
        if ours:
            budget.take(file[OURS].size)
            facts[OURS] = bytes(file[OURS][()]).decode("utf-8", "replace")
        if "data" in file and isinstance(file["data"], h5py.Group):
            _facts_of(h5py, file["data"], facts)
    parts.pop(OURS, None)
    return parts, facts


def _walk(
    h5py: Any, group: Any, path: str, parts: Parts, facts: dict[str, Any], budget: Budget, matlab: bool, depth: int
) -> None:
    if depth > 16:
        raise RecordingError("groups are nested deeper than 16")
    for key in group:
        name = f"{path}/{key}".lstrip("/")
        if key in ("#refs#", "#subsystem#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue  # MATLAB's own store; links elsewhere are not followed
        item = group[key]
        if isinstance(item, h5py.Group):
            _walk(h5py, item, name, parts, facts, budget, matlab, depth + 1)
        elif isinstance(item, h5py.Dataset):
            arrays = _arrays(h5py, item, budget, matlab)
            if arrays is None:
                facts["notes"].append(f"{name} left out: {item.dtype} is not numbers")
            elif arrays:
                parts[name] = arrays


def _arrays(h5py: Any, item: Any, budget: Budget, matlab: bool) -> list[Array] | None:
    """The numbers of a dataset: one array, or, of MATLAB's cells and struct arrays, one for each that they refer to."""
    if item.external or item.is_virtual:
        return None  # its numbers lie in other files
    if item.dtype == h5py.ref_dtype:
        budget.take(8 * item.size)
        found = []
        for reference in np.ravel(item[()], order="C"):
            target = item.file[reference] if reference else None
            if not isinstance(target, h5py.Dataset) or target.dtype.kind not in "fiub":
                return None
            found += _arrays(h5py, target, budget, matlab) or []
        return found
    if item.dtype.kind not in "fiub" or item.dtype.itemsize > 8:
        return None
    budget.take(8 * item.size)
    values = np.asarray(item[()], dtype=np.float64)
    return [values.T if matlab else values]


def _facts_of(h5py: Any, data: Any, facts: dict[str, Any]) -> None:
    for key in data:
        number = key.removeprefix("demo").removeprefix("_")
        if number.isdigit() and "num_samples" in data[key].attrs:
            facts["lengths"][str(int(number))] = int(data[key].attrs["num_samples"])
    try:
        environment = json.loads(data.attrs["env_args"])
        rate = float(environment["env_kwargs"]["control_freq"])
        if 0.0 < rate < 1e5:
            facts["rate_hz"] = rate
    except (KeyError, ValueError, TypeError):
        pass
