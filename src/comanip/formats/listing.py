"""What columns a foreign file has, with ranges: to choose a mapping by."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ComanipError
from .array_file import read_mat, read_numpy
from .assemble import Source
from .columns import recognise, recognise_time
from .csv_file import CsvTable, is_own
from .doors import format_of
from .packed import packing, unpacked
from .tables import text_of

_MB = 48
_LIKE = {"position": "--position", "velocity": "--velocity", "force": "--force"}


class Listed(NamedTuple):
    """One column: unit as the file states it, frames, lowest and highest value, how many are not finite, and the flag that its
    name suggests; `problem` instead where it holds no numbers."""

    name: str
    unit: str
    frames: int
    low: float
    high: float
    bad: int
    suggests: str
    problem: str = ""


def listed(path: Path) -> tuple[Listed, ...]:
    """Every column of a foreign table or array file; () for formats that name their channels themselves, and our own."""
    source = _source(path)
    if source is None:
        return ()
    names = source.names
    like = {column: _LIKE[kind] for kind, axes in recognise(names).items() if kind in _LIKE for column in axes.values()}
    if time := recognise_time(names):
        like[time] = "--time"
    return tuple(_one(source, name, like.get(name, "")) for name in names)


def _source(path: Path) -> Source | None:
    if path.is_dir():
        return None
    data = path.read_bytes()
    if packing(data[:512]):
        data = unpacked(path, data, _MB << 20)
    try:
        form = format_of(path, data[:512]).name
        if form == "numpy":
            return read_numpy(path, data)
        if form == "matlab" and data[512:520] != b"\x89HDF\r\n\x1a\n":
            return read_mat(path, data)
        if form == "csv" and not is_own(text := text_of(path, data)):
            return CsvTable(path, text)
    except ComanipError:  # reading says what is wrong with the file
        return None
    return None


def _one(source: Source, name: str, suggests: str) -> Listed:
    try:
        values = np.concatenate([np.ravel(a) for a in source.find(name)])
        fine = values[np.isfinite(values)]
        low, high = (float(fine.min()), float(fine.max())) if len(fine) else (np.nan, np.nan)
        return Listed(name, source.unit(name), len(values), low, high, len(values) - len(fine), suggests)
    except (ComanipError, ValueError, TypeError) as refused:
        return Listed(name, "", 0, np.nan, np.nan, 0, "", str(refused).rsplit(": ", 1)[-1])
