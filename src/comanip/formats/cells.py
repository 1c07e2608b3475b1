"""Cells of a text table as people and programs write them: numbers, gaps, thousands, dates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..interfaces import Array

_EXPONENT = r"(?:[eEdD][-+]?\d+)?"
_PLAIN = re.compile(rf"[-+]?(?:\d+[.,]?\d*|[.,]\d+){_EXPONENT}")
_COMMA_GROUPS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
_POINT_GROUPS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")
_BLANK_GROUPS = re.compile(r"[-+]?\d{1,3}(?:['’  \u00a0\u202f\u2009]\d{3})+(?:[.,]\d*)?")
NOTHING = frozenset(
    "na n/a #n/a #n/a!n/a #na nan -nan +nan null none nil <na> nat missing - -- ? . #nv #wert! #value! #div/0! #num! "
    "1.#qnan -1.#ind 1.#ind -1.#qnan".split()
) | {"#n/a n/a", ""}
_INFINITE = re.compile(r"[-+]?(?:inf(?:inity)?|1\.#inf)", re.IGNORECASE)
_MOMENT = re.compile(
    r"(?:(?P<date>\d{4}-\d\d?-\d\d?|\d{4}/\d\d?/\d\d?|\d\d?[./-]\d\d?[./-]\d{2,4})[ T_]+)?"
    r"(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,:]\d+)?)\s*(?P<half>[AaPp][Mm])?"
    r"\s*(?P<zone>Z|UTC|[-+]\d\d:?\d\d)?"
)


class Style(NamedTuple):
    """How a file writes its numbers: its decimal sign, and an example of thousands that were set apart, "" if there is none."""

    decimal: str = "."
    grouped: str = ""


def is_number(cell: str) -> bool:
    """Whether a cell is a number in any style, or nothing."""
    cell = cell.strip()
    return (
        cell.lower() in NOTHING
        or _PLAIN.fullmatch(cell) is not None
        or any(p.fullmatch(cell) for p in (_COMMA_GROUPS, _POINT_GROUPS, _BLANK_GROUPS, _INFINITE))
    )


def is_moment(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day."""
    return _MOMENT.fullmatch(cell.strip()) is not None


def style_of(cells: Iterable[str]) -> Style | tuple[str, str]:
    """The style of all cells that hold a comma or a point; two cells that contradict each other when there is none."""
    comma = point = comma_groups = point_groups = either = ""
    for cell in cells:
        cell = cell.strip()
        if "," in cell and _COMMA_GROUPS.fullmatch(cell):
            if "." in cell or cell.count(",") > 1:
                comma_groups = comma_groups or cell
            else:
                either = either or cell
        elif "." in cell and _POINT_GROUPS.fullmatch(cell):
            if "," in cell or cell.count(".") > 1:
                point_groups = point_groups or cell
        elif _PLAIN.fullmatch(cell):
            if "," in cell:
                comma = comma or cell
            elif "." in cell:
                point = point or cell
    if comma or point_groups:
        against = point or comma_groups
        return (comma or point_groups, against) if against else Style(",", point_groups)
    if comma_groups or (either and point):
        return Style(".", comma_groups or either)
    return Style("," if either else ".")


def numbers(cells: Sequence[str], style: Style) -> tuple[Array, int]:
    """(values, index of the first cell that is no number or -1); a cell with nothing in it is NaN."""
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        value = number(cell, style)
        if value is None:
            return values, i
        values[i] = value
    return values, -1


def number(cell: str, style: Style) -> float | None:
    """One number, NaN for nothing, None for what is neither. Fortran writes 1.0D-3 for 1.0E-3."""
    text = cell.strip().replace("\u2212", "-")
    if text.lower() in NOTHING:
        return np.nan
    if _BLANK_GROUPS.fullmatch(text):
        text = re.sub(r"['’\s]", "", text)
    if style.decimal == ",":
        text = (text.replace(".", "") if _POINT_GROUPS.fullmatch(text) else text).replace(",", ".")
    elif _COMMA_GROUPS.fullmatch(text):
        text = text.replace(",", "")
    if _PLAIN.fullmatch(text) and "," not in text:
        return float(text.replace("D", "E").replace("d", "e"))
    return float(text.lower().replace("1.#", "")) if _INFINITE.fullmatch(text) else None


class Moments(NamedTuple):
    """Dates or times of day as seconds [s] since `start`; `wrong` is the first cell that is none, or -1."""

    seconds: Array
    start: str
    wrong: int


def moments(cells: Sequence[str]) -> Moments:
    """Stamps "2024-05-01 12:00:00.010", "12:00:00,010", "05/01/2024 12:00:00 PM", "00:01.2" (minutes and seconds).

    Dates other than ISO's are not told apart by day and month: they must be one day throughout.
    """
    seconds, dates = np.full(len(cells), np.nan), np.zeros(len(cells))
    first: dict[str, float] = {}
    start = next((cell.strip() for cell in cells if cell.strip().lower() not in NOTHING), "")
    for i, cell in enumerate(cells):
        if cell.strip().lower() in NOTHING:
            continue
        match = _MOMENT.fullmatch(cell.strip())
        if match is None or (day := _day(match["date"] or "", first)) is None:
            return Moments(seconds, start, i)
        seconds[i], dates[i] = _of_day(match), day
    known = np.flatnonzero(np.isfinite(seconds))
    if len(known):  # subtracted by parts: days since 1970 in seconds would cost the microseconds
        seconds = (seconds - np.floor(seconds[known[0]])) + 86400.0 * (dates - dates[known[0]])
    return Moments(seconds, start, -1)


def _of_day(match: re.Match[str]) -> float:
    """Seconds of the day, in UTC where the zone is stated."""
    hours = int(match["h"] or 0)
    if match["half"]:
        hours = hours % 12 + (12 if match["half"].lower() == "pm" else 0)
    zone, offset = match["zone"] or "", 0.0
    if zone[:1] in ("+", "-"):
        offset = (1 if zone[0] == "+" else -1) * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))
    second, fraction = _SECOND.fullmatch(match["s"]).groups()  # type: ignore[union-attr]
    return 3600.0 * hours + 60.0 * int(match["m"]) + int(second) - offset + float(f"0.{fraction or 0}")


_SECOND = re.compile(r"(\d+)(?:[.,:](\d+))?")


def _day(date: str, first: dict[str, float]) -> float | None:
    """Days since 1970 of an ISO date, 0 for any other, which must not change; None for no date at all."""
    if date not in first:
        parts = re.split(r"[-/.]", date)
        if len(parts[0]) == 4:
            try:
                first[date] = float(np.datetime64("-".join(p.zfill(2) for p in parts), "D").astype(int))
            except ValueError:
                return None
        elif first:
            return None
        else:
            first[date] = 0.0
    return first[date]
