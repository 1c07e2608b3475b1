"""What columns a foreign file or folder has, with ranges: to choose a mapping by, or to guess at one (`guessing`)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ChannelError, ComanipError
from ..interfaces import Array
from ..recording import Recording, axis_units
from .assemble import Source
from .columns import recognise, recognise_time
from .doors import read
from .looking import Look, Looked

_WIDEST = 64  # numbers a frame: a wider array is a picture or a cloud, and is listed whole
_MOST = 400  # columns
_STRUCT = re.compile(r"[A-Za-z_]\w*\.(?:\w+|\w+\[\d+\]\..*)$")  # a path of MATLAB's, and no "tool.position.x"
_EACH = re.compile(r"\[i\]")


_LIKE = {"position": "--position", "velocity": "--velocity", "force": "--force"}


class Column(NamedTuple):
    """One column of numbers: what names it on the line, the unit that the file states, its numbers (T,), and what shares its
    clock; `group` and `place` say which entry of a vector it is ("state", 3), place -1 where it is a column of its own.

    `problem` instead of numbers where it holds none; `stamped` where its channel has stamps of its own (bags).
    """

    name: str
    unit: str
    values: Array
    clock: str = ""
    group: str = ""
    place: int = -1
    problem: str = ""
    stamped: bool = False


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


def listed(columns: Sequence[Column]) -> tuple[Listed, ...]:
    """Every column that `looking.look` found, with its range."""
    like = _like([c.name for c in columns])
    return tuple(_one(column, like.get(column.name, "")) for column in columns)


def _like(names: Sequence[str]) -> dict[str, str]:
    """Column -> the flag that its name suggests, where that is obvious."""
    try:
        like = {column: _LIKE[kind] for kind, axes in recognise(names).items() if kind in _LIKE for column in axes.values()}
        time = recognise_time(names)
    except ChannelError:  # two that could be the same: reading says which
        return {}
    return like | ({time: "--time"} if time else {})


def _one(column: Column, suggests: str) -> Listed:
    fine = column.values[np.isfinite(column.values)]
    low, high = (float(fine.min()), float(fine.max())) if len(fine) else (np.nan, np.nan)
    bad = len(column.values) - len(fine)
    return Listed(column.name, column.unit, len(column.values), low, high, bad, suggests, column.problem)


def look(path: Path) -> tuple[Column, ...]:
    """Every column of a foreign file or folder, of its first recording; () for our own files, and for what is not read."""
    try:
        read(path, Look())
    except Looked as looked:
        found = looked.found
        columns = _of_recording(found) if isinstance(found, Recording) else _of_source(found)
        return tuple(column for _, column in zip(range(_MOST), columns, strict=False))
    except ComanipError:  # reading says what is wrong with the file
        return ()
    return ()


def _of_recording(recording: Recording) -> Iterator[Column]:
    for name, channel in recording.channels.items():
        units, clock = axis_units(channel.unit, len(channel.axes)), _clock(channel.time)
        if len(channel.axes) == 1:
            yield Column(name, channel.unit, channel.values[:, 0], clock, stamped=True)
            continue
        for i, axis in enumerate(channel.axes):
            yield Column(f"{name}.{axis}", units[i], channel.values[:, i], clock, name, i, stamped=True)


def _clock(time: Array) -> str:
    return f"{len(time)} {time[0]:.9g} {time[-1]:.9g}" if len(time) else "0"


def _of_source(source: Source) -> Iterator[Column]:
    for name in _expressions(source):
        try:
            values = np.asarray(source.find(name)[0], dtype=np.float64)
            yield from _parts(name, source.unit(name), np.squeeze(values))
        except (ComanipError, ValueError, TypeError) as refused:
            yield Column(name, "", np.zeros(0), problem=str(refused).rsplit(": ", 1)[-1])


def _expressions(source: Source) -> Iterator[str]:
    """Names as the mapping takes them: of a struct array "a[i].b" either each element ("a[0].b"), where the elements are
    channels of one scope, or all at once ("a.b"), where each is a recording."""
    names = source.names
    for name in names:
        if not _EACH.search(name):
            yield name
            continue
        head, whole = _EACH.split(name)[0], _EACH.sub("", name)
        try:
            several = source.find(whole)
        except ComanipError:
            yield whole
            continue
        alike = len({max(np.shape(a), default=0) for a in several}) == 1 and len(several) <= _WIDEST
        if alike and sum(n.startswith(f"{head}[i]") and not n.endswith("plotStyle") for n in names) == 1:
            yield from (_EACH.sub(f"[{i}]", name, count=1) for i in range(len(several)))
        else:
            yield whole


def _parts(name: str, unit: str, values: Array) -> Iterator[Column]:
    """The columns of one array; time is its longer dimension. What lies in one struct goes together."""
    clock = f"{name.partition('.')[0] if _STRUCT.match(name) else ''} {max(values.shape, default=0)}"
    if values.ndim == 3 and values.shape[2] <= _WIDEST < values.shape[1]:  # takes side by side: the first
        for i in range(values.shape[2]):
            yield Column(f"{name}[0,:,{i}]", unit, values[0, :, i], str(values.shape[1]), name, i)
        return
    if values.ndim <= 1 or min(values.shape) > _WIDEST or values.ndim > 2:
        yield Column(name, unit, values.reshape(-1), clock)
        return
    upright = values.shape[0] >= values.shape[1]
    for i in range(min(values.shape)):
        part = f"{name}[:,{i}]" if upright else f"{name}[{i},:]"
        yield Column(part, unit, values[:, i] if upright else values[i], clock, name, i)
