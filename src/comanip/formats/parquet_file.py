"""Parquet: any table of numbers, one recording an episode; and our own, exact, with checksums.

A list column is named by its entries: "observation.state.z" where the data set names them, "observation.state[2]" always.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .assemble import assemble
from .columns import Columns, recognise, sign_and_name, unit_in, unknown
from .doors import only
from .files import header_of

OURS, SEAL = b"comanip", b"comanip.sha256"
VERSION = 1
MAX_CELLS = 64 << 20  # numbers held at once: half a gigabyte
EPISODE, INDEX, STAMP = "episode_index", "frame_index", "timestamp"
_PARTS = re.compile(r"^(.*)\[([\d:,]+)\]$")


class Episodes:
    """A table cut into episodes, as `assemble` wants its sources."""

    def __init__(
        self, path: Path, table: Mapping[str, Array], lengths: Sequence[int], names: Mapping[str, Sequence[str]], notes: list[str]
    ) -> None:
        """`table`: column -> (T,) or (T, k); `names` of the entries of list columns."""
        self.path, self.notes = path, notes
        self._table, self._cuts = table, np.cumsum(lengths)[:-1]
        self._entries = {f"{column}.{entry}": (column, i) for column, entries in names.items() for i, entry in enumerate(entries)}

    @property
    def names(self) -> tuple[str, ...]:
        found = []
        named = {column for column, _ in self._entries.values()}
        for name, values in self._table.items():
            if values.ndim == 1:
                found.append(name)
            elif name in named:
                found += [entry for entry, (column, _) in self._entries.items() if column == name]
            else:
                found += [f"{name}[{i}]" for i in range(values.shape[1])]
        return tuple(found)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, [*self._table, *self.names])
        return np.split(sign * self._column(name), self._cuts)

    def unit(self, expression: str) -> str:
        return unit_in(sign_and_name(expression, self.names)[1])[1]

    def _column(self, name: str) -> Array:
        if name in self._table:
            return self._table[name]
        if name in self._entries:
            column, i = self._entries[name]
            return self._table[column][:, i]
        match = _PARTS.match(name)
        if match and match[1] in self._table and self._table[match[1]].ndim == 2:
            width = self._table[match[1]].shape[1]
            low, colon, high = match[2].partition(":")
            if low.isdigit() and (not colon or high.isdigit()) and int(high if colon else low) <= width - (not colon):
                return self._table[match[1]][:, int(low) : int(high) if colon else int(low) + 1]
            raise ChannelError(f"{self.path}: {name}: column {match[1]!r} holds {width} numbers a frame")
        short = [n for n in self.names if n.endswith((f".{name}", f"/{name}"))]
        if len(short) == 1:
            return self._column(short[0])
        if len(short) > 1:
            raise ChannelError(f"{self.path}: {name!r} may be {' or '.join(short[:8])}; say which")
        raise unknown(str(self.path), name, self.names)


def open_parquet(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    table, metadata = read_table(path)
    if SEAL in metadata and OURS not in metadata:
        raise RecordingError(f"{path}: damaged: it is one of comanip's, and its header is not found under {OURS.decode()!r}")
    if OURS in metadata:
        from .mapping import finished

        return (finished(path, _own(path, table, metadata[OURS], recover), columns),)
    numbers, notes = numeric(path, table)
    lengths = episode_lengths(path, numbers)
    if len(lengths) > 1:
        notes.append(f"{EPISODE} cuts it into {len(lengths)} recordings")
    return assemble(Episodes(path, numbers, lengths, {}, notes), obvious(numbers, {}, columns, notes))


def read_table(path: Path) -> tuple[Any, Mapping[bytes, bytes]]:
    """(pyarrow table, metadata of its schema). RecordingError for anything that pyarrow does not read, or that is too much."""
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise RecordingError(f"{path}: reading Parquet needs pyarrow: pip install 'comanip[parquet]'") from None
    try:
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            head = file.metadata
            cells = head.num_rows * max(head.num_columns, 1)
            size = sum(head.row_group(i).total_byte_size for i in range(head.num_row_groups))
            if cells > MAX_CELLS or size > 8 * MAX_CELLS:
                raise RecordingError(
                    f"{path}: {head.num_rows} rows of {head.num_columns} columns: too much at once; learn with --stream"
                )
            table = file.read()
            table.validate(full=True)  # text that is no UTF-8, lists that end before they begin
            return table, dict(table.schema.metadata or {})
    except (arrow.ArrowException, OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise RecordingError(f"{path}: not a Parquet file that can be read: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


def numeric(path: Path, table: Any) -> tuple[dict[str, Array], list[str]]:
    """Columns of numbers, and of lists of numbers alike in length; what is left out is in the notes. A missing value is NaN."""
    found: dict[str, Array] = {}
    notes = []
    for name in table.column_names:
        values = _numbers(table.column(name).combine_chunks())
        if values is None:
            notes.append(f"column {name!r} left out: {table.schema.field(name).type} is not numbers")
        else:
            found[str(name)] = values
    if not found or not table.num_rows:
        raise RecordingError(f"{path}: no frames: it holds {table.num_rows} rows of {len(found)} columns of numbers")
    return found, notes


def _numbers(column: Any) -> Array | None:
    import pyarrow as arrow

    kind, types = column.type, arrow.types
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        inner = _numbers(column.flatten())
        whole = inner is not None and inner.ndim == 1 and len(column) and len(inner) % len(column) == 0
        width = len(inner) // len(column) if whole and inner is not None else 0
        if inner is None or not width or width > 4096 or column.null_count:
            return None
        if not types.is_fixed_size_list(kind) and (np.diff(column.offsets.to_numpy()) != width).any():
            return None
        return inner.reshape(-1, width)
    if types.is_timestamp(kind):
        per_second = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}[kind.unit]
        return np.asarray(column.cast("int64").to_numpy(zero_copy_only=False), dtype=np.float64) / per_second
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind):
        if types.is_boolean(kind):
            column = column.cast("uint8")
        return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
    return None


def episode_lengths(path: Path, numbers: Mapping[str, Array]) -> list[int]:
    """Frames of each episode, in their order. RecordingError for an episode whose rows are torn apart."""
    frames = len(next(iter(numbers.values())))
    if EPISODE not in numbers or numbers[EPISODE].ndim != 1:
        return [frames]
    index = numbers[EPISODE]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(index) != 0) + 1, [frames]])
    seen = index[starts[:-1]]
    if len(np.unique(seen)) != len(seen):
        again = next(v for i, v in enumerate(seen.tolist()) if v in seen[:i])
        raise RecordingError(
            f"{path}: rows of episode {again:g} stand apart from each other: sort the table by {EPISODE}, {INDEX}"
        )
    return np.diff(starts).tolist()


def obvious(numbers: Mapping[str, Array], names: Mapping[str, Sequence[str]], columns: Columns, notes: list[str]) -> Columns:
    """`columns` with the entries of a data set that are obvious ("observation.state" names x, vx, Fx); actions are none."""
    if columns.mapped or not names:
        return columns
    entries = {f"{c}.{e}": (c, i) for c, several in names.items() if not c.startswith("action") for i, e in enumerate(several)}
    leaves: dict[str, str] = {}
    for full in entries:
        for leaf in {full.rsplit(".", 1)[-1], full.split(".", 2)[-1]}:
            leaves[leaf] = "" if leaf in leaves else full
    try:
        found = recognise(leaf for leaf, full in leaves.items() if full)
    except ChannelError:
        return columns
    if "position" not in found and "velocity" not in found:
        return columns
    axes = sorted(set.intersection(*[set(by) for by in found.values()]))
    if columns.axes and set(columns.axes) <= set(axes):
        axes = list(columns.axes)
    elif "position" in found:
        axes = _moving(numbers, {a: entries[leaves[found["position"][a]]] for a in axes}, notes)
    notes += [f"{', '.join(leaves[by[a]] for a in axes)} taken as {kind}" for kind, by in found.items()]
    changes: dict[str, Any] = {kind: tuple(leaves[by[a]] for a in axes) for kind, by in found.items()}
    return _replaced(columns, changes, axes)


def _moving(numbers: Mapping[str, Array], columns: Mapping[str, tuple[str, int]], notes: list[str]) -> list[str]:
    """The axes along which anything moves, all of them when nothing does."""
    still = [a for a, (column, i) in columns.items() if np.ptp(numbers[column][:, i]) <= 1e-9]
    if not 0 < len(still) < len(columns):
        return list(columns)
    notes.append(f"axis {', '.join(still)} left out: no position moves along it")
    return [a for a in columns if a not in still]


def _replaced(columns: Columns, changes: dict[str, Any], axes: Sequence[str]) -> Columns:
    from dataclasses import replace

    return replace(columns, **changes, axes=columns.axes or (tuple(axes) if all(axes) else ()))


def write_parquet(recordings: Sequence[Recording], path: Path) -> None:
    """One table: a column "time" and one for each axis of each channel, empty where a channel has no frame at that stamp."""
    recording = only(recordings, path)
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise RecordingError(f"{path}: writing Parquet needs pyarrow: pip install 'comanip[parquet]'") from None
    head = header_of(recording, path, VERSION)
    time = np.unique(np.concatenate([np.empty(0), *[c.time for c in recording.channels.values()]]))
    arrays, names = [arrow.array(time)], ["time"]
    for name, channel in recording.channels.items():
        at = np.searchsorted(time, channel.time)
        absent = np.ones(len(time), dtype=bool)
        absent[at] = False
        for axis, values in zip(channel.axes, channel.values.T, strict=True):
            column = np.zeros(len(time))
            column[at] = values
            arrays.append(arrow.array(column, mask=absent, from_pandas=False))
            names.append(f"{name}.{axis}")
    metadata = {OURS: head.encode(), SEAL: digest(head, recording.channels).encode()}
    table = arrow.Table.from_arrays(
        arrays, schema=arrow.schema(list(zip(names, [a.type for a in arrays], strict=True)), metadata)
    )
    part = path.with_name(f".{path.name[:40]}.tmp")
    try:
        parquet.write_table(table, part, write_page_checksum=True, compression="zstd")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def digest(head: str, channels: Mapping[str, Channel]) -> str:
    """sha256 of the header and of every stamp and value: Parquet's own checksums do not cover its index."""
    found = hashlib.sha256(head.encode())
    for name in sorted(channels):
        found.update(name.encode("utf-8", "surrogatepass"))
        found.update(np.ascontiguousarray(channels[name].time).tobytes() + np.ascontiguousarray(channels[name].values).tobytes())
    return found.hexdigest()


def _own(path: Path, table: Any, head: bytes, recover: bool) -> Recording:
    text = head.decode("utf-8", "replace")
    try:
        stated = json.loads(text)
        version, layout, metadata = int(stated["version"]), dict(stated["channels"]), dict(stated["metadata"])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise RecordingError(f"{path}: a damaged comanip header ({error})") from None
    if version > VERSION:
        raise RecordingError(f"{path}: written as version {version}; this comanip reads up to {VERSION}: update comanip")
    channels = {}
    try:
        time = table.column(0).combine_chunks().to_numpy(zero_copy_only=False)
        at = 1
        for name, c in layout.items():
            axes = tuple(c["axes"])
            columns = [table.column(at + i).combine_chunks() for i in range(len(axes))]
            at += len(axes)
            kept = columns[0].is_valid().to_numpy(zero_copy_only=False)
            values = np.column_stack([column.drop_null().to_numpy(zero_copy_only=False) for column in columns])
            channels[name] = Channel(time[kept], values, str(c["unit"]), str(c["frame"]), axes)
    except (KeyError, ValueError, TypeError, IndexError, ChannelError, ArithmeticError) as error:
        raise RecordingError(f"{path}: damaged: its columns are not what its header says ({_line(error)})") from None
    if (table.schema.metadata or {}).get(SEAL, b"").decode("latin-1") != digest(text, channels):
        raise RecordingError(f"{path}: its sha256 does not match: some byte was changed")
    return Recording(channels, metadata)
