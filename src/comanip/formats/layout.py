"""Where the table in a text file begins: lines, separators, headers, and what stands above them."""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import RecordingError, plain
from .cells import NOTHING, is_moment, is_number
from .columns import UNITS

_STATED = re.compile(r'"?sep=(.|\\t)"?', re.IGNORECASE)
MOST_ABOVE = 300  # lines above a table; more is not a preamble


class Lines(NamedTuple):
    """The lines of a file that hold something, their numbers (from 1), numbered comments, and rows of separators alone."""

    lines: list[str]
    numbers: array[int]
    comments: list[tuple[int, str]]
    blank: int


def lines_of(path: Path, text: str) -> Lines:
    """Lines of `text`; a line break inside quotes belongs to its cell (RFC 4180). RecordingError for an open quote."""
    found = Lines([], array("L"), [], 0)
    blank = 0
    physical = enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1)
    quoted = '"' in text
    for number, line in physical:
        if line.lstrip().startswith(("#", "%")):
            found.comments.append((number, line.strip()))
        elif line.strip(" \t,;"):
            found.lines.append(_closed(path, number, line, physical) if quoted and line.count('"') % 2 else line)
            found.numbers.append(number)
        else:
            blank += bool(line.strip())
    return found._replace(blank=blank)


def _closed(path: Path, number: int, line: str, rest: Iterator[tuple[int, str]]) -> str:
    """The line with those that its open quote reaches over."""
    parts = [line]
    for _, more in rest:
        parts.append(more)
        if more.count('"') % 2:
            return "\n".join(parts)
    raise RecordingError(f"{path}: line {number} opens a quote that is never closed: {plain(line, 60)!r}; close it, or drop it")


def cut(path: Path, lines: Sequence[str], numbers: Sequence[int], separator: str) -> Iterator[list[str]]:
    """Cells of each line; "" separates by blanks."""
    if not separator and not any('"' in line for line in lines):
        return (line.split() for line in lines)
    return _cells(path, lines, numbers, separator)


def _cells(path: Path, lines: Sequence[str], numbers: Sequence[int], separator: str) -> Iterator[list[str]]:
    rows = lines if separator else (line.strip() for line in lines)
    reader, done = csv.reader(rows, delimiter=separator or " ", skipinitialspace=True), 0
    try:
        for row in reader:
            yield row
            done += 1
    except csv.Error as error:
        raise RecordingError(f"{path}: line {numbers[min(done, len(numbers) - 1)]} is no row of a table: {error}") from None


def stated_separator(lines: Lines) -> str:
    """The separator of Excel's first line "sep=;", which is taken off; "" when there is none."""
    match = _STATED.fullmatch(lines.lines[0].strip(" ")) if lines.lines else None
    if match is None:
        return ""
    del lines.lines[0], lines.numbers[0]
    return "\t" if match[1] == "\\t" else match[1]


def separator_of(path: Path, lines: Sequence[str]) -> tuple[str, int]:
    """(separator, cells a line) that cuts all lines into the same number (> 1) of cells; 0 cells when none does."""
    for separator in (";", "\t", ",", "", "|"):
        try:
            widths = {len(row) for row in cut(path, lines, range(1, len(lines) + 1), separator)}
        except RecordingError:  # quotes that fit another separator
            continue
        if len(widths) == 1 and (width := widths.pop()) > 1:
            return separator, width
    present = next((s for s in (";", "\t", ",") if s in lines[0]), "" if " " in lines[0].strip() else ",")
    return present, 0


def like_numbers(rows: Sequence[Sequence[str]]) -> list[int]:
    """Columns that hold numbers, dates or nothing in every row, and a number or date in one."""
    width = min((len(row) for row in rows), default=0)
    columns = [[row[i] for row in rows] for i in range(width)]
    return [
        i
        for i, column in enumerate(columns)
        if all(is_number(cell) or is_moment(cell) for cell in column)
        and any(cell.strip().lower() not in NOTHING for cell in column)
    ]


def is_data(row: Sequence[str], columns: Sequence[int], width: int) -> bool:
    """Whether a row of `width` cells holds numbers wherever the table does."""
    fits = bool(columns) and len(row) in (width, width + 1) and columns[-1] < len(row)
    return fits and all(is_number(row[i]) or is_moment(row[i]) for i in columns)


def is_units(row: Sequence[str]) -> list[str]:
    """The cells' units when a row holds nothing but units, else nothing."""
    units = [cell.strip().strip("[]()").strip() for cell in row]
    return units if any(units) and all(u in UNITS or u in ("", "-") for u in units) else []


def counts(row: Sequence[str]) -> bool:
    """Whether a row is 0, 1, 2 ..., perhaps behind a blank cell: what pandas writes above columns without names."""
    cells = [cell.strip() for cell in (row[1:] if row and not row[0].strip() else row)]
    return bool(cells) and cells == [str(i) for i in range(len(cells))]
