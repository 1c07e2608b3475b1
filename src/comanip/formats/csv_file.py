"""CSV and its relatives: comma, semicolon, tab or blanks; comments, byte order marks, any line ending.

Ours carry a first line "# comanip recording {json}" with units, frames, axes and metadata, and come back exactly.
"""

from __future__ import annotations

import csv
import io
import json
import re
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .columns import UNITS, sign_and_name, unit_in, unknown

SIGNATURE = "# comanip recording "
_NUMBER = re.compile(r"^\s*[-+]?(?:\d+[.,]?\d*(?:[eEdD][-+]?\d+)?|[.,]\d+(?:[eE][-+]?\d+)?|nan|inf(?:inity)?)?\s*$", re.I)


class CsvTable:
    """The lines of one file; a column becomes numbers when it is asked for, so text columns do no harm."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.notes: list[str] = []
        self._lines, self._numbers, comments, blank = _lines(text)
        if blank:
            self.notes.append(f"{blank} rows without any value left out")
        if not self._lines:
            raise RecordingError(f"{path}: no frames: the file holds no line of numbers")
        self._separator = _separator(self._lines[:20])
        self._names = self._header(comments)
        sample = [cell for row in self._cells(20) for cell in row]
        self._decimal_comma = self._separator != "," and any("," in cell and _NUMBER.match(cell) for cell in sample)
        if self._decimal_comma:
            self.notes.append("decimal commas read as points")
        width = len(self._names)
        for number, row in zip(self._numbers, self._cells(), strict=True):
            if len(row) != width:
                raise RecordingError(f"{path}: line {number} has {len(row)} cells, want {width}: ragged table")
        if not self._lines:
            raise RecordingError(f"{path}: no frames: the file holds a header and nothing else")

    def __len__(self) -> int:
        return len(self._lines)

    def _cells(self, count: int | None = None) -> Iterator[list[str]]:
        return _cut(self._lines[:count] if count is not None else self._lines, self._separator)

    def _header(self, comments: Sequence[tuple[int, str]]) -> list[str]:
        """Column names, taken off the lines or from the comment just above them (numpy.savetxt writes it so)."""
        first, *second = self._cells(2)
        if not all(_NUMBER.match(cell) for cell in first):
            names, units = [cell.strip() for cell in first], _units_row(second[0]) if second else []
            if units:
                names = [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=False)]
                self.notes.append("second line read as units")
            del self._lines[: 2 if units else 1], self._numbers[: 2 if units else 1]
            return names
        above = [text for number, text in comments if number == self._numbers[0] - 1]
        if above:
            for separator in (self._separator, "", ",", ";"):
                names = [cell.strip() for cell in next(_cut([above[0].lstrip("#% \t")], separator), [])]
                if len(names) == len(first) and not all(_NUMBER.match(n) for n in names):
                    return names
        return [str(i) for i in range(len(first))]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(n for n in self._names if n)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self._names)
        return [sign * self.column(name)[:, None]]

    def unit(self, expression: str) -> str:
        return unit_in(self._names[self._index(sign_and_name(expression, self._names)[1])])[1]

    def column(self, name: str) -> Array:
        """Numbers of a column by header, header without its unit, or index; blank cells are NaN."""
        at = self._index(name)
        values = np.empty(len(self._lines))
        for i, row in enumerate(self._cells()):
            cell = row[at].strip()
            try:
                values[i] = float(cell.replace(",", ".") if self._decimal_comma else cell) if cell else np.nan
            except ValueError:
                raise RecordingError(
                    f"{self.path}: column {name!r}, frame {i} (line {self._numbers[i]}): {cell!r} is not a number"
                ) from None
        return values

    def words(self, name: str) -> list[str]:
        """Cells of a column as they are written."""
        at = self._index(name)
        return [row[at].strip() for row in self._cells()]

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
        sign, table, name = self._split(expression)
        return [sign * table.column(name)[:, None]]

    def unit(self, expression: str) -> str:
        _, table, name = self._split(expression)
        return table.unit(name)

    def _split(self, expression: str) -> tuple[float, CsvTable, str]:
        sign, name = sign_and_name(expression, self.names)
        stem = next((s for s in sorted(self.tables, key=len, reverse=True) if name.startswith(s + ".")), None)
        if stem is None:
            raise unknown(str(self.path), name, self.names)
        return sign, self.tables[stem], name[len(stem) + 1 :]


def _lines(text: str) -> tuple[list[str], array[int], list[tuple[int, str]], int]:
    """(lines with content, their numbers, numbered comments, how many rows hold separators alone)."""
    lines, numbers, comments, blank = [], array("L"), [], 0
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        if line.lstrip().startswith(("#", "%")):
            comments.append((number, line.strip()))
        elif line.strip(" \t,;"):
            lines.append(line)
            numbers.append(number)
        else:
            blank += bool(line.strip())
    return lines, numbers, comments, blank


def _separator(lines: Sequence[str]) -> str:
    """The separator that cuts all lines into the same number (> 1) of cells; "" means blanks."""
    for separator in (";", "\t", ",", ""):
        widths = {len(row) for row in _cut(lines, separator)}
        if len(widths) == 1 and widths.pop() > 1:
            return separator
    return next((s for s in (";", "\t", ",") if s in lines[0]), "" if " " in lines[0].strip() else ",")


def _cut(lines: Sequence[str], separator: str) -> Iterator[list[str]]:
    """Cells of each line."""
    if not separator:
        return (line.split() for line in lines)
    return iter(csv.reader(lines, delimiter=separator, skipinitialspace=True))


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
