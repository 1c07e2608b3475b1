"""Folders of CSV files: one file a topic, each with its own stamps and number of rows (bagpy, rostopic, ros2 topic echo --csv),
as a bag; or files of one length side by side, as one table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .assemble import assemble
from .columns import ALIASES, TIME_NAMES, UNITS, Columns, recognise, to_si, unit_in
from .csv_file import CsvDirectory, CsvTable
from .events import EVENTS, coded
from .mapping import mapped
from .messages import CLOCKS

_LOG, _HEADER = ("time", "%time", "rosbagtimestamp", "timestamp", "t", *TIME_NAMES), ("header.stamp", "stamp")
_FIELD = re.compile(r"^(?:field\.|\.)")
_LABELS = ("event", "events", "label", "phase", "mark", "name", "state")
_UNITS = {"position": "m", "translation": "m", "force": "N", "torque": "N m", "linear": "m/s", "angular": "rad/s"}


def open_folder(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    files = sorted(
        p for p in path.iterdir() if p.name.lower().endswith((".csv", ".tsv", ".csv.gz")) and not p.name.startswith(".")
    )
    if not files:
        raise RecordingError(f"{path}: a directory without .csv files (names that begin with a dot are left out)")
    texts = {f.name.split(".csv")[0].removesuffix(".tsv"): _text(f) for f in files}
    notes: list[str] = []
    events = {stem: found for stem, text in texts.items() if (found := _events(text))}
    tables = {s: table for s, text in texts.items() if s not in events and (table := _table(path, s, files, text, notes))}
    if not tables:
        raise RecordingError(f"{path}: no file holds numbers; {'; '.join(notes)}")
    if len(tables) > 1 and len({t.names for t in tables.values()}) == 1 and not events:  # one layout: takes, not topics
        return [r for t in tables.values() for r in assemble(t, columns)]
    if columns.time in (None, *CLOCKS) and all(_stamps_of(t) for t in tables.values()) and (len(tables) > 1 or events):
        return [_recording(path, tables, events, columns, notes)]
    return assemble(CsvDirectory(path, tables), columns)


def _text(file: Path) -> str:
    from ..parts import FORMATS
    from .packed import packing, unpacked
    from .tables import text_of

    limit = next(form.limit_mb for form in FORMATS if "" in form.suffixes) << 20
    if file.stat().st_size > limit:
        raise RecordingError(f"{file}: {file.stat().st_size >> 20} MB; the limit for csv is {limit >> 20} MB: cut it into takes")
    data = file.read_bytes()
    return text_of(file, unpacked(file, data, limit) if packing(data) else data)


def _table(path: Path, stem: str, files: Sequence[Path], text: str, notes: list[str]) -> CsvTable | None:
    file = next(f for f in files if f.name.startswith(stem))
    return CsvTable(file, _topic_head(text))


def _topic_head(text: str) -> str:
    """rostopic's first line begins with "%time", which other tables use for remarks."""
    return text[1:] if text.lstrip("\ufeff").lower().startswith("%time,") else text


def _events(text: str) -> list[tuple[float, str]]:
    """(stamp, label) of a table of events: stamps, and a column of words; [] for any other table."""
    import csv
    import io

    try:
        rows = [r for r in csv.reader(io.StringIO(text[: 1 << 20], newline="")) if any(c.strip() for c in r)]
    except csv.Error:  # a quote that is never closed: whoever reads it as a table of samples says where
        return []
    head = [c.strip().lower() for c in rows[0]] if rows else []
    at = next((i for i, c in enumerate(head) if unit_in(c)[0] in TIME_NAMES), None)
    label = next((i for i, c in enumerate(head) if c in _LABELS), None)
    if at is None or label is None or len(head) > 6:
        return []
    factor = to_si(unit_in(head[at])[1] or "s", "time")[1]
    try:
        return [(float(r[at]) * factor, r[label].strip()) for r in rows[1:] if not _number(r[label])]
    except (ValueError, IndexError):
        return []


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _stamps_of(table: CsvTable) -> str | None:
    """The column with a table's own stamps."""
    plain = {_plain(n): n for n in table.names}
    return next((plain[n] for n in _LOG if n in plain), None)


def _plain(name: str) -> str:
    return _FIELD.sub("", unit_in(name)[0].strip().lower())


def _recording(
    path: Path, tables: dict[str, CsvTable], events: dict[str, list[tuple[float, str]]], columns: Columns, notes: list[str]
) -> Recording:
    notes.append(f"{len(tables)} files with stamps of their own, one a topic: {', '.join(tables)}")
    channels: dict[str, Channel] = {}
    for stem, table in tables.items():
        notes += [f"{stem}: {n}" for n in table.notes]
        time = _time(stem, table, columns, notes)
        for name, channel in _channels(stem, table, time, notes).items():
            channels[name] = channel
    metadata: dict[str, Any] = {"name": path.name, "notes": notes}
    marks = sorted((m for several in events.values() for m in several), key=lambda m: m[0])
    if marks:
        channels[EVENTS], metadata["events"] = coded(marks)
        notes.append(f"{', '.join(events)}: {len(marks)} events")
    return mapped(path, Recording(channels, metadata), columns)


def _time(stem: str, table: CsvTable, columns: Columns, notes: list[str]) -> Array:
    """Stamps [s]: the header's where there are some and they move, unless the log's are asked for."""
    log_name = _stamps_of(table)
    assert log_name is not None
    log = _seconds(table, log_name, columns)
    plain = {_plain(n): n for n in table.names}
    header = None
    if {"header.stamp.secs", "header.stamp.nsecs"} <= plain.keys():
        header = table.column(plain["header.stamp.secs"]) + table.column(plain["header.stamp.nsecs"]) / 1e9
    elif {"header.stamp.sec", "header.stamp.nanosec"} <= plain.keys():
        header = table.column(plain["header.stamp.sec"]) + table.column(plain["header.stamp.nanosec"]) / 1e9
    elif name := next((plain[n] for n in _HEADER if n in plain), None):
        header = _seconds(table, name, columns)
    moves = header is not None and bool((header > 0.0).all()) and len(np.unique(header)) > 1
    if header is None or columns.time == "log" or (not moves and columns.time != "header"):
        notes.append(
            f"{stem}: stamps from the column {log_name!r}"
            + ("; its headers stand still" if header is not None and not moves else "")
        )
        return log
    notes.append(f"{stem}: stamps from the headers")
    return header


def _seconds(table: CsvTable, name: str, columns: Columns) -> Array:
    """ROS writes whole nanoseconds since 1970 where it does not write seconds."""
    values = table.column(name)
    unit = columns.time_unit or unit_in(name)[1]
    if unit:
        return values * to_si(unit, "time")[1]
    finite = values[np.isfinite(values)]
    return values / 1e9 if len(finite) and finite.min() > 1e17 else values


def _channels(stem: str, table: CsvTable, time: Array, notes: list[str]) -> dict[str, Channel]:
    """Columns "pose.position.x" of a file "ee_pose" as the channel "ee_pose.pose.position", axis x; a name without dots is a
    channel."""
    groups: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in table.names:
        plain = _FIELD.sub("", unit_in(name)[0].strip())
        if name == _stamps_of(table) or plain.lower().startswith(("header", "unnamed", "frame_id")) or plain.lower() in _HEADER:
            continue
        group, _, axis = plain.rpartition(".")
        if not group:
            group, axis = plain, _axis(plain)
        groups.setdefault((group, unit_in(name)[1]), []).append((axis, name))
    found: dict[str, Channel] = {}
    frame = _frame(table)
    for (group, unit), pairs in groups.items():
        if not (columns := _numbers(stem, table, pairs, notes)):
            continue
        si, factor = UNITS.get(unit) or UNITS.get(ALIASES.get(unit, ""), ("", 1.0))
        si = si or (_UNITS.get(group.rsplit(".", 1)[-1], "") if "." in group else "")
        name = f"{stem}.{group}" if f"{stem}.{group}" not in found else f"{stem}.{group} [{unit}]"
        found[name] = _ordered(time, np.column_stack(columns) * factor, si, tuple(a for a, _ in pairs), frame)
    return found


def _axis(name: str) -> str:
    """The axis that a plain name says ("vx" -> "x"), else the name."""
    try:
        return next((axis for by in recognise([name]).values() for axis in by if axis), name)
    except ChannelError:
        return name


def _numbers(stem: str, table: CsvTable, pairs: Sequence[tuple[str, str]], notes: list[str]) -> list[Array]:
    try:
        return [table.column(n) for _, n in pairs]
    except (RecordingError, ChannelError) as error:
        notes.append(f"{stem}: {', '.join(n for _, n in pairs)} left out: {str(error).rsplit(': ', 1)[-1]}")
        return []


def _frame(table: CsvTable) -> str:
    """header.frame_id; several, joined by " | ", are no frame that anything else is in."""
    name = next((n for n in table.names if _plain(n) in ("header.frame_id", "frame_id")), None)
    return " | ".join(sorted({w for w in table.words(name) if w})) if name else ""


def _ordered(time: Array, values: Array, unit: str, axes: tuple[str, ...], frame: str) -> Channel:
    if set(axes) == set("wxyz"):
        order = [axes.index(a) for a in "wxyz"]
        return Channel(time, values[:, order], unit, frame, ("w", "x", "y", "z"))
    return Channel(time, values, unit, frame, axes)
