"""CSV and its relatives: comma, semicolon, tab or blanks; comments, byte order marks, any line ending.

Ours carry a first line "# comanip recording {json}" with units, frames, axes and metadata, and come back exactly.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .columns import UNITS, sign_and_name, unit_in, unknown

SIGNATURE = "# comanip recording "
_NUMBER = re.compile(r"^\s*[-+]?(?:\d+[.,]?\d*(?:[eEdD][-+]?\d+)?|[.,]\d+(?:[eE][-+]?\d+)?|nan|inf(?:inity)?)?\s*$", re.I)


class CsvTable:
    """The cells of one file; a column becomes numbers when it is asked for, so text columns do no harm."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.notes: list[str] = []
        lines, comments = _lines(text)
        if not lines:
            raise RecordingError(f"{path}: no frames: the file holds no line of numbers")
        separator = _separator([line for _, line in lines[:20]])
        rows = [(number, _cells(line, separator)) for number, line in lines]
        self._names = self._header(rows, comments, separator)
        self._decimal_comma = separator != "," and any("," in c for _, r in rows[:20] for c in r if _NUMBER.match(c))
        if self._decimal_comma:
            self.notes.append("decimal commas read as points")
        width = len(self._names)
        for number, row in rows:
            if len(row) != width:
                raise RecordingError(f"{path}: line {number} has {len(row)} cells, want {width}: ragged table")
        self._rows = rows
        if not rows:
            raise RecordingError(f"{path}: no frames: the file holds a header and nothing else")

    def __len__(self) -> int:
        return len(self._rows)

    def _header(self, rows: list[tuple[int, list[str]]], comments: Sequence[tuple[int, str]], separator: str) -> list[str]:
        """Column names, taken off `rows` or from the comment just above them (numpy.savetxt writes it so)."""
        first_line, first = rows[0]
        if not all(_NUMBER.match(cell) for cell in first):
            rows.pop(0)
            names = [cell.strip() for cell in first]
            if rows and (units := _units_row(rows[0][1])):
                names = [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=False)]
                rows.pop(0)
                self.notes.append("second line read as units")
            return names
        above = [text for number, text in comments if number == first_line - 1]
        if above:
            names = [cell.strip() for cell in _cells(above[0].lstrip("#% \t"), separator)]
            if len(names) == len(first) and not all(_NUMBER.match(n) for n in names):
                return names
        return [str(i) for i in range(len(first))]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(n for n in self._names if n)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self._names)
        return [sign * self.column(name)[:, None]]

    def column(self, name: str) -> Array:
        """Numbers of a column by header, header without its unit, or index; blank cells are NaN."""
        at = self._index(name)
        values = np.empty(len(self._rows))
        for i, (number, row) in enumerate(self._rows):
            cell = row[at].strip()
            try:
                values[i] = float(cell.replace(",", ".") if self._decimal_comma else cell) if cell else np.nan
            except ValueError:
                raise RecordingError(
                    f"{self.path}: column {name!r}, frame {i} (line {number}): {cell!r} is not a number"
                ) from None
        return values

    def _index(self, name: str) -> int:
        bare = [unit_in(n)[0] for n in self._names]
        for names in (self._names, bare, [n.lower() for n in self._names], [n.lower() for n in bare]):
            hits = [i for i, n in enumerate(names) if n == (name if names is self._names or names is bare else name.lower())]
            if len(hits) > 1:
                raise ChannelError(f"{self.path}: {len(hits)} columns are called {name!r}; use the index: {hits}")
            if hits:
                return hits[0]
        if name.isdigit() and int(name) < len(self._names):
            return int(name)
        raise unknown(str(self.path), name, self._names)


class CsvDirectory:
    """CSV files of one length in one directory: columns "<file stem>.<column>"."""

    def __init__(self, path: Path, tables: dict[str, CsvTable]) -> None:
        self.path = path
        self.tables = tables
        self.notes = [f"{len(tables)} files read as one recording: {', '.join(tables)}"]
        self.notes += [f"{stem}: {n}" for stem, table in tables.items() for n in table.notes]
        lengths = {stem: len(table) for stem, table in tables.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{stem} {n}" for stem, n in lengths.items())
            raise RecordingError(f"{path}: the files have different numbers of frames ({listed}); read them one by one")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{stem}.{name}" for stem, table in self.tables.items() for name in table.names)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self.names)
        stem = next((s for s in sorted(self.tables, key=len, reverse=True) if name.startswith(s + ".")), None)
        if stem is None:
            raise unknown(str(self.path), name, self.names)
        return [sign * self.tables[stem].column(name[len(stem) + 1 :])[:, None]]


def _lines(text: str) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """(numbered lines with content, numbered comments)."""
    lines, comments = [], []
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        line = line.rstrip("\n")
        if line.lstrip().startswith(("#", "%")):
            comments.append((number, line.strip()))
        elif line.strip(" \t,;"):
            lines.append((number, line))
    return lines, comments


def _separator(lines: Sequence[str]) -> str:
    """The separator that cuts all lines into the same number (> 1) of cells; "" means blanks."""
    for separator in (";", "\t", ",", ""):
        widths = {len(_cells(line, separator)) for line in lines}
        if len(widths) == 1 and widths.pop() > 1:
            return separator
    return next((s for s in (";", "\t", ",") if s in lines[0]), "" if " " in lines[0].strip() else ",")


def _cells(line: str, separator: str) -> list[str]:
    return line.split() if not separator else next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _units_row(row: Sequence[str]) -> list[str]:
    """The cells' units when a row holds nothing but units, else nothing."""
    units = [cell.strip().strip("[]()").strip() for cell in row]
    return units if any(units) and all(u in UNITS or u in ("", "-") for u in units) else []


def write_csv(recording: Recording, path: Path) -> None:
    """Writes every channel as columns "<channel>.<axis>"; floats in full, stamps of all channels in one time column."""
    for name, channel in recording.channels.items():
        if not (np.isfinite(channel.time).all() and (np.diff(channel.time) > 0).all()):
            raise RecordingError(f"{path}: channel {name!r} has stamps that do not increase; write it as .mcap")
    layout = {n: {"unit": c.unit, "frame": c.frame, "axes": list(c.axes)} for n, c in recording.channels.items()}
    try:
        head = json.dumps({"version": 1, "channels": layout, "metadata": dict(recording.metadata)})
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: the metadata must be plain JSON values: {error}") from None
    channels = recording.channels.values()
    time = np.unique(np.concatenate([c.time for c in channels])) if recording.channels else np.empty(0)
    columns = [[repr(t) for t in time.tolist()]]
    for channel in channels:
        at = np.searchsorted(time, channel.time)
        for values in channel.values.T:
            column = [""] * len(time)
            for i, value in zip(at.tolist(), values.tolist(), strict=True):
                column[i] = repr(value)
            columns.append(column)
    with path.open("w", encoding="utf-8", newline="") as out:
        out.write(f"{SIGNATURE}{head}\n")
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["time", *(f"{n}.{a}" for n, c in recording.channels.items() for a in c.axes)])
        writer.writerows(zip(*columns, strict=True))


def read_own_csv(path: Path, text: str) -> Recording:
    """A recording that `write_csv` wrote."""
    first, _, rest = text.partition("\n")
    try:
        head = json.loads(first[len(SIGNATURE) :])
        layout = {n: (str(c["unit"]), str(c["frame"]), tuple(c["axes"])) for n, c in head["channels"].items()}
        metadata = dict(head["metadata"])
        version = int(head["version"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path}: line 1 is a damaged comanip header ({error}); delete it to read plain CSV") from None
    if version > 1:
        raise RecordingError(f"{path}: written as version {version}; this comanip reads up to 1: update comanip")
    rows = list(csv.reader(io.StringIO(rest, newline="")))[1:]
    width = 1 + sum(len(axes) for _, _, axes in layout.values())
    for i, row in enumerate(rows):
        if len(row) != width:
            raise RecordingError(f"{path}: frame {i} (line {i + 3}) has {len(row)} cells, want {width}: cut or ragged")
    channels, start = {}, 1
    for name, (unit, frame, axes) in layout.items():
        stop = start + len(axes)
        try:
            kept = [(row[0], *row[start:stop]) for row in rows if all(row[start:stop])]
            table = np.array(kept, dtype=np.float64).reshape(-1, 1 + len(axes))
        except ValueError as error:
            raise RecordingError(f"{path}: channel {name!r}: {error}") from None
        channels[name] = Channel(table[:, 0], table[:, 1:], unit, frame, axes)
        start = stop
    return Recording(channels, metadata)
