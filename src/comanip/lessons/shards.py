"""Data in many files, read a piece at a time: Parquet tables, LeRobot data sets, and every format of `comanip.formats`.

A reader is called with a path and yields pieces, lists of whole sequences (T, D); it pickles, so that workers can.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..formats import Columns, read
from ..interfaces import Array
from .demonstration import Preparation, demonstrations

PIECE = 65_536  # frames read at once: some megabytes, and enough for the E-step to fill its lanes


def files_of(paths: Sequence[str | Path]) -> list[str]:
    """The files behind paths, in order: a LeRobot folder (v2 or v3) stands for its data/**/*.parquet. RecordingError if none."""
    found: list[str] = []
    for path in map(Path, paths):
        inside = sorted((path / "data").glob("**/*.parquet"))
        if not path.exists() or (path.is_dir() and not inside):
            raise RecordingError(f"{path}: no such file; give files, or a LeRobot folder with data/**/*.parquet")
        found += map(str, inside or [path])
    return found


def rate_of(folder: str | Path) -> float | None:
    """Frames a second of a LeRobot data set, from its meta/info.json; None for anything else."""
    try:
        return float(json.loads((Path(folder) / "meta" / "info.json").read_text(encoding="utf-8"))["fps"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


@dataclass(frozen=True)
class ParquetShards:
    """Reads frames of Parquet files; an episode must lie within one file, its frames in order.

    channels  model's channel -> column; "observation.state[2]" is one number of a list column
    episode   column whose change begins a new sequence ("episode_index", as LeRobot writes it); None: a file is one sequence
    """

    channels: Mapping[str, str]
    episode: str | None = "episode_index"

    def __call__(self, path: str) -> Iterator[list[Array]]:
        try:
            import pyarrow.parquet as parquet
        except ImportError:
            raise RecordingError(f"{path}: reading Parquet needs pyarrow: pip install 'comanip[parquet]'") from None
        from pyarrow import ArrowException

        try:
            with parquet.ParquetFile(path) as file:
                yield from self._pieces(path, file)
        except (ArrowException, OSError) as error:
            raise RecordingError(f"{path}: not a Parquet file that can be read: {str(error).splitlines()[0]}") from None

    def _pieces(self, path: str, file: Any) -> Iterator[list[Array]]:
        names = set(file.schema_arrow.names)
        wanted = {re.sub(r"\[\d+\]$", "", column) for column in self.channels.values()}
        wanted |= {self.episode} if self.episode else set()
        if absent := sorted(wanted - names):
            raise ChannelError(f"{path}: no column {absent[0]!r}; it has: {', '.join(sorted(names))}")
        rest, episode = np.empty((0, len(self.channels))), None
        for batch in file.iter_batches(batch_size=PIECE, columns=sorted(wanted)):
            frames = np.column_stack([_column(path, batch, column) for column in self.channels.values()])
            numbers = batch.column(self.episode).to_numpy(zero_copy_only=False) if self.episode else np.zeros(len(frames))
            before = numbers[0] if episode is None else episode
            cuts = np.flatnonzero(np.diff(numbers, prepend=before)) + len(rest)
            *whole, rest = np.split(np.concatenate([rest, frames]), cuts)
            episode = numbers[-1]
            if whole := [sequence for sequence in whole if len(sequence)]:
                yield whole
        if len(rest):
            yield [rest]


def _column(path: str, batch: Any, column: str) -> Array:
    name, _, index = column.removesuffix("]").partition("[") if column.endswith("]") else (column, "", "")
    values = batch.column(name)
    if values.null_count:
        raise RecordingError(f"{path}: column {name!r} has {values.null_count} missing values; fill or cut them")
    if not index:
        if hasattr(values, "flatten") and values.type.num_fields:
            raise ChannelError(f"{path}: column {name!r} holds lists; say which number, for example {name}[0]")
        return np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)
    flat = values.flatten().to_numpy(zero_copy_only=False) if values.type.num_fields else np.empty(0)
    width = len(flat) // max(len(values), 1)
    if int(index) >= width or width * len(values) != len(flat):
        raise ChannelError(f"{path}: {column}: column {name!r} holds {width} numbers a frame, all frames alike")
    return np.asarray(flat.reshape(-1, width)[:, int(index)], dtype=np.float64)


@dataclass(frozen=True)
class RecordingShards:
    """Reads the recordings of one file of any format (.mcap, .csv, .npz, .mat), each made a demonstration as usual."""

    channels: tuple[str, ...]
    columns: Columns
    preparation: Preparation
    recover: bool = False

    def __call__(self, path: str) -> Iterator[list[Array]]:
        recordings = read(path, self.columns, recover=self.recover)
        yield [lesson.array(self.channels) for lesson in demonstrations(recordings, self.preparation)]
