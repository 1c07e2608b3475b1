"""CSV and its relatives: comma, semicolon, tab or blanks; comments, byte order marks, any line ending.

Ours carry a first line "# comanip recording {json}" with units, frames, axes and metadata, a second one with a checksum of all
the others, and come back exactly.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..errors import ChannelError, RecordingError, plain
from ..interfaces import Array
from ..recording import Channel, Recording
from ..whole_file import write_whole
from .cells import NOTHING, Style, is_moment, is_number, moments, numbers, style_of
from .columns import sign_and_name, unit_in, unknown
from .files import header_of
from .layout import (
    MOST_ABOVE,
    Lines,
    counts,
    cut,
    is_data,
    is_units,
    like_numbers,
    lines_of,
    separator_of,
    stated_separator,
)

SIGNATURE = "# comanip recording "
VERSION = 2  # 1 had no checksum
_CHECKSUM = re.compile(r"# sha256=([0-9a-f]{64})")


class CsvTable:
    """The lines of one file; a column becomes numbers when it is asked for, so text columns do no harm."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.notes: list[str] = []
        self.moments: set[int] = set()  # columns that turned out to hold dates or times of day
        found = lines_of(path, text)
        self._lines, self._numbers = found.lines, found.numbers
        if found.blank:
            self.notes.append(f"{found.blank} rows without any value left out")
        self._separator = stated_separator(found)
        if not self._lines:
            raise RecordingError(f"{path}: no frames: the file holds no line of numbers")
        width = self._find_separator()
        sample = self._sample()
        self._numeric = like_numbers(sample)
        width = self._leave_out_what_stands_above(width, sample)
        self._names = self._header(found, width)
        self._check_widths()
        self._style = self._find_style('"' in text)
        if not self._lines:
            raise RecordingError(f"{path}: no frames: the file holds a header and nothing else")
        self.stamps = self._unnamed_stamps()

    def __len__(self) -> int:
        return len(self._lines)

    def _cells(self, start: int = 0, stop: int | None = None) -> Iterator[list[str]]:
        if start or stop is not None:
            return cut(self.path, self._lines[start:stop], self._numbers[start:stop], self._separator)
        return cut(self.path, self._lines, self._numbers, self._separator)

    def _sample(self) -> list[list[str]]:
        """Twenty rows from the middle of the file, where neither headers nor a cut disturb."""
        middle = max(1, len(self._lines) // 2)
        return list(self._cells(middle, middle + 20))

    def _find_separator(self) -> int:
        """How many cells a line has, 0 when lines differ; the middle of the file decides where its beginning is uneven."""
        if self._separator:
            return 0
        self._separator, width = separator_of(self.path, self._lines[:20])
        if not width and len(self._lines) > 4:
            middle = max(1, len(self._lines) // 2)
            separator, inside = separator_of(self.path, self._lines[middle : middle + 20])
            self._separator = separator if inside else self._separator
        return width

    def _leave_out_what_stands_above(self, width: int, sample: Sequence[Sequence[str]]) -> int:
        """Takes a preamble (LabVIEW, instruments) off the lines, and says so; gives the width of the table."""
        widths = {len(row) for row in sample}
        if width or len(widths) != 1 or not self._numeric:
            return width
        width = widths.pop()
        rows = list(self._cells(0, MOST_ABOVE))
        first = next((i for i, row in enumerate(rows) if is_data(row, self._numeric, width)), 0)
        two = first > 1 and is_units(rows[first - 1]) and len(rows[first - 2]) == len(rows[first - 1])
        head = first - (2 if two else 1)
        if head < 0 or len([*rows[head][:-1], *filter(str.strip, rows[head][-1:])]) not in (width, width - 1):
            head = first  # nothing there has a name for each column
        above = rows[:head]
        for number, row in zip(self._numbers, above, strict=False):
            if len(row) > 1 and all(map(is_number, row)):
                raise RecordingError(f"{self.path}: line {number} has {len(row)} cells, want {width}: ragged table")
        if above:
            self.notes.append(f"{len(above)} lines above the table left out, the first {plain(self._lines[0], 60)!r}")
            del self._lines[:head], self._numbers[:head]
        return width

    def _header(self, found: Lines, width: int) -> list[str]:
        """Column names, taken off the lines or from the comment just above them (numpy.savetxt writes it so)."""
        first, *second = self._cells(0, 3)
        if self._unnamed(first, second) or not (all(map(is_number, first)) or is_data(first, self._numeric, len(first))):
            return self._named(first, second)
        above = [text for number, text in found.comments if number == self._numbers[0] - 1]
        if above:
            for separator in (self._separator, "", ",", ";"):
                names = [cell.strip() for cell in next(cut(self.path, [above[0].lstrip("#% \t")], [1], separator), [])]
                if len(names) == len(first) and not all(map(is_number, names)):
                    return names
        return [str(i) for i in range(len(first))]

    def _unnamed(self, first: Sequence[str], second: Sequence[Sequence[str]]) -> bool:
        """Whether the first row is pandas' 0, 1, 2 ... above columns without names, and no frame that happens to begin so."""
        if not (second and counts(first)):
            return False
        leading = [row[0].strip() for row in (first, *second)]
        if leading == [str(i) for i in range(len(leading))] or (len(first) == 1 and not all("." in row[0] for row in second)):
            return False
        self.notes.append(f"first line {', '.join(c.strip() for c in first[:4])} ... read as a header: it counts the columns")
        return True

    def _named(self, first: Sequence[str], second: Sequence[Sequence[str]]) -> list[str]:
        names, units = [cell.strip() for cell in first], is_units(second[0]) if second else []
        if units:
            names = [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=False)]
            self.notes.append("second line read as units")
        del self._lines[: 2 if units else 1], self._numbers[: 2 if units else 1]
        rows = list(self._cells(0, 3))
        if len(rows) > 1 and all(len(row) == len(names) + 1 for row in rows) and _row_names([row[0] for row in rows]):
            self.notes.append("the first column has no name: it holds row names")
            names.insert(0, "")
        if rows and len(rows[0]) == len(names) - 1 and not names[-1]:
            names.pop()
        return names

    def _check_widths(self) -> None:
        """Every row has a cell for each name; a separator at the end of a line adds an empty one, which is nothing."""
        width, trailing = len(self._names), 0
        for number, row in zip(self._numbers, self._cells(), strict=False):
            if len(row) == width + 1 and not row[-1].strip():
                trailing += 1
            elif len(row) != width:
                raise RecordingError(f"{self.path}: line {number} has {len(row)} cells, want {width}: ragged table")
        if trailing:
            self.notes.append(f"{trailing} rows end with a separator: the empty cell behind it is left out")

    def _find_style(self, quoted: bool) -> Style:
        """Whether numbers have decimal commas, from all cells of the file; a file with both commas and points is refused."""
        if (self._separator == "," and not quoted) or not any("," in line for line in self._lines):
            return Style()
        style = style_of(cell for row in self._cells() for cell in row)
        if not isinstance(style, Style):
            raise RecordingError(
                f"{self.path}: {style[0]!r} has a decimal comma, {style[1]!r} a decimal point: which is the decimal sign? "
                "write the whole file with one"
            )
        if style.decimal == ",":
            self.notes.append("decimal commas read as points")
        if style.grouped:
            self.notes.append(f"thousands set apart, as in {style.grouped!r}, read as one number")
        return style

    def _unnamed_stamps(self) -> str | None:
        """The first column's new name, when it has none and holds stamps: the index of a pandas table."""
        cell = next(self._cells(0, 1))[0]
        if self._names[0] or len(self._names) < 2 or "index" in self._names or not (is_number(cell) or is_moment(cell)):
            return None
        self._names[0] = "index"
        time = self.column("index")
        counter = np.array_equal(time, np.arange(len(time))) or np.array_equal(time, np.arange(1, len(time) + 1))
        if counter or len(time) < 2 or not (np.diff(time) > 0.0).all():
            self._names[0] = ""
            return None
        return "index"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(n for n in self._names if n)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self._names)
        return [sign * self.column(name)[:, None]]

    def unit(self, expression: str) -> str:
        at = self._index(sign_and_name(expression, self._names)[1])
        return "s" if at in self.moments else unit_in(self._names[at])[1]

    def column(self, name: str) -> Array:
        """Numbers of a column by header, header without its unit, or index; cells without a value are NaN."""
        at = self._index(name)
        cells = [row[at] for row in self._cells()]
        if self._style == Style() and not any("_" in cell for cell in cells):  # Python reads 1_000 as a number
            try:
                return np.array([*map(float, cells)])
            except ValueError:
                pass
        if is_moment(next((c for c in cells if c.strip().lower() not in NOTHING), "")):
            return self._moments(name, at, cells)
        values, wrong = numbers(cells, self._style)
        if wrong >= 0:
            raise RecordingError(self._no_number(name, wrong, cells[wrong]))
        if words := {c.strip() for c in cells if c.strip() and c.strip().lower() in NOTHING - {"nan"}}:
            self.notes.append(f"column {name!r}: {', '.join(sorted(words))} read as nothing (NaN)")
        return values

    def words(self, name: str) -> list[str]:
        """Cells of a column as they are written."""
        at = self._index(name)
        return [row[at].strip() for row in self._cells()]

    def _moments(self, name: str, at: int, cells: Sequence[str]) -> Array:
        seconds, start, wrong = moments(cells)
        if wrong >= 0:
            raise RecordingError(
                f"{self._no_number(name, wrong, cells[wrong])}, nor a date and time like {start!r} of one day; write ISO dates "
                "(2024-05-01 12:00:00.000) or seconds"
            )
        self.moments.add(at)
        self.notes.append(f"column {name!r} holds dates or times: read as seconds, the first is {start}")
        return seconds

    def _no_number(self, name: str, frame: int, cell: str) -> str:
        at = f"column {name!r}, frame {frame} (line {self._numbers[frame]})"
        return f"{self.path}: {at}: {plain(cell, 60)!r} is not a number"

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


def _row_names(cells: Sequence[str]) -> bool:
    """Whether the first cells of rows are words, or count from 0 or 1 (R writes them without a header)."""
    cells = [cell.strip() for cell in cells]
    counted = any(cells == [str(start + i) for i in range(len(cells))] for start in (0, 1))
    return counted or not any(is_number(cell) or is_moment(cell) for cell in cells)


def write_csv(recording: Recording, path: Path) -> None:
    """Writes every channel as columns "<channel>.<axis>"; floats in full, stamps of all channels in one time column."""
    head = header_of(recording, path, VERSION)
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
    table = io.StringIO(newline="")
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["time", *(f"{n}.{a}" for n, c in recording.channels.items() for a in c.axes)])
    writer.writerows(zip(*columns, strict=True))
    first, body = f"{SIGNATURE}{head}", table.getvalue()
    write_whole(path, f"{first}\n# sha256={_digest(first, body)}\n{body}")


def _digest(first: str, body: str) -> str:
    """Of everything but the line that holds it; line endings do not count, a mail program may change them."""
    digest = hashlib.sha256(first.encode("utf-8", "surrogatepass"))
    digest.update(b"\n" + body.replace("\r\n", "\n").encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def is_own(text: str) -> bool:
    """Whether a text is a recording of ours, also where its first letters are damaged: then the second line tells."""
    second = text[text.find("\n") + 1 :][:75].rstrip("\r\n").partition("\n")[0]
    return text.startswith(SIGNATURE) or _CHECKSUM.fullmatch(second.rstrip("\r")) is not None


def _unchanged(path: Path, first: str, rest: str) -> tuple[str, str]:
    """(the table below the header, a note); RecordingError where the checksum says that something was changed."""
    line, _, body = rest.partition("\n")
    if not line.startswith("#"):
        return rest, ""
    match = _CHECKSUM.fullmatch(line.rstrip("\r"))
    if match is None or match[1] != _digest(first, body):
        raise RecordingError(
            f"{path}: its checksum (line 2) does not fit: a digit was changed, or lines are missing; take an intact copy, or "
            "delete line 2 to accept the file as it is"
        )
    return body, match[1]


def read_own_csv(path: Path, text: str) -> Recording:
    """A recording that `write_csv` wrote."""
    first, _, rest = text.partition("\n")
    first = first.rstrip("\r")
    try:
        head = json.loads(first[len(SIGNATURE) :])
        layout = {n: (str(c["unit"]), str(c["frame"]), tuple(c["axes"])) for n, c in head["channels"].items()}
        metadata = dict(head["metadata"])
        version = int(head["version"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(f"{path}: line 1 is a damaged comanip header ({error}); delete it to read plain CSV") from None
    if version > VERSION:
        raise RecordingError(f"{path}: written as version {version}; this comanip reads up to {VERSION}: update comanip")
    rest, checked = _unchanged(path, first, rest)
    if version > 1 and not checked:
        metadata["notes"] = [*metadata.get("notes", ()), "its checksum was taken out: changes of the file cannot be seen"]
    try:
        rows = list(csv.reader(io.StringIO(rest, newline="")))[1:]
    except csv.Error as error:
        raise RecordingError(f"{path}: damaged: {error}") from None
    below = 4 if checked else 3  # the line of frame 0
    width = 1 + sum(len(axes) for _, _, axes in layout.values())
    for i, row in enumerate(rows):
        if len(row) != width:
            raise RecordingError(f"{path}: frame {i} (line {i + below}) has {len(row)} cells, want {width}: cut or ragged")
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
