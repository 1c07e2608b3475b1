"""Data in many files, read a piece at a time: Parquet tables, LeRobot data sets, and every format of `comanip.formats`.

A reader is called with a path and yields pieces, lists of whole sequences (T, D); it pickles, so that workers can. `checked`
holds every episode against what a lesson in memory is held against, once, before the passes begin.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..errors import ChannelError, ComanipWarning, RecordingError
from ..formats import Columns, read
from ..interfaces import Array
from ..recording import Channel, Recording
from .demonstration import Demonstration, Preparation, demonstration, demonstrations

PIECE = 65_536  # frames read at once: some megabytes, and enough for the E-step to fill its lanes
MOST_NOTES = 200
UNITS = {"position": "m", "velocity": "m/s", "force": "N"}


def files_of(paths: Sequence[str | Path]) -> list[str]:
    """The files behind paths, in order: a LeRobot folder (v2 or v3) stands for its data/**/*.parquet. RecordingError if none."""
    found: list[str] = []
    for path in map(Path, paths):
        inside = sorted(f for f in (path / "data").glob("**/*.parquet") if not f.name.startswith("."))
        if not path.exists() or (path.is_dir() and not inside):
            raise RecordingError(f"{path}: no such file; give files, or a LeRobot folder with data/**/*.parquet")
        found += map(str, inside or [path])
    return found


def rate_of(folder: str | Path) -> float | None:
    """Frames a second of a LeRobot data set, from its meta/info.json; None for anything else. RecordingError for a rate that is
    none."""
    if not (Path(folder) / "meta" / "info.json").exists():
        return None
    from ..formats.lerobot import facts_of

    return facts_of(Path(folder)).fps


class Checked(NamedTuple):
    """What the checks of one file found: notes, suspicions to be said aloud, and whether its numbers are used as they are."""

    notes: tuple[str, ...]
    suspicions: tuple[str, ...]
    untouched: bool


R = TypeVar("R")


class Reader(Protocol):
    """What `checked` asks of a reader, besides `prepared`, which gives a reader of its own kind."""

    def check(self, path: str, dt: float, role: str) -> Checked: ...


def check_file(reader: Reader, path: str, dt: float, role: str) -> Checked:
    """`reader.check`, for workers."""
    return reader.check(path, dt, role)


def checked(reader: R, paths: Sequence[str], found: Iterable[Checked], dt: float, role: str) -> tuple[R, list[str]]:
    """(the reader to use, notes) from what `check_file` found of each path. Says each suspicion once."""
    notes: dict[str, None] = {}
    touched = []
    for path, result in zip(paths, found, strict=True):
        for text in result.suspicions:
            if text not in notes:
                warnings.warn(text, ComanipWarning, stacklevel=3)
        notes |= dict.fromkeys([*result.suspicions, *result.notes])
        touched += [] if result.untouched else [path]
    listed = list(notes)
    if len(listed) > MOST_NOTES:
        listed = [*listed[:MOST_NOTES], f"and {len(listed) - MOST_NOTES} more notes of this kind"]
    return (reader.prepared(touched, dt, role) if touched else reader), listed  # type: ignore[attr-defined]


def _listened(make: Iterable[Demonstration]) -> tuple[list[Demonstration], list[str]]:
    """Lessons, and what was suspected while they were made, instead of warnings that a worker would lose."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", ComanipWarning)
        lessons = list(make)
    return lessons, [str(w.message) for w in said if issubclass(w.category, ComanipWarning)]


@dataclass(frozen=True)
class ParquetShards:
    """Reads frames of Parquet files; an episode must lie within one file, its frames in order.

    channels  model's channel -> column; "observation.state[2]" is one number of a list column
    episode   column whose change begins a new sequence ("episode_index", as LeRobot writes it); None: a file is one sequence
    changed   (files whose episodes are prepared anew in every pass because a check changed them, period [s], role)
    """

    channels: Mapping[str, str]
    episode: str | None = "episode_index"
    changed: tuple[frozenset[str], float, str] = (frozenset(), 1.0, "")

    def __call__(self, path: str) -> Iterator[list[Array]]:
        touched, dt, role = self.changed
        if path not in touched:
            yield from (list(piece.values()) for piece in self._episodes(path, tuple(self.channels.values())))
            return
        names = tuple(self.channels)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ComanipWarning)  # said once, by the checks
            for number, frames, stamps in self._stamped(path, dt):
                yield [self._lesson(path, number, frames, stamps, dt, role).array(names)]

    def check(self, path: str, dt: float, role: str) -> Checked:
        """Every episode of a file as a lesson: order, rate, gaps, units, signs, whatever `demonstration` looks at."""
        notes: dict[str, None] = {}
        suspicions: dict[str, None] = {}
        untouched = True
        for number, frames, stamps in self._stamped(path, dt):
            if len(frames) < Preparation().min_frames:
                continue  # too short to learn from: left out and counted by the learner
            (lesson,), said = _listened(self._lesson(path, n, f, s, dt, role) for n, f, s in [(number, frames, stamps)])
            suspicions |= dict.fromkeys(said)
            notes |= dict.fromkeys(note for note in lesson.notes if note not in said)
            untouched = untouched and np.array_equal(lesson.array(tuple(self.channels)), frames)
        return Checked(tuple(notes), tuple(suspicions), untouched)

    def prepared(self, paths: Sequence[str], dt: float, role: str) -> ParquetShards:
        """The reader that prepares the episodes of these files anew in every pass, as lessons in memory are."""
        return replace(self, changed=(frozenset(paths), dt, role))

    def _lesson(self, path: str, number: float, frames: Array, stamps: Array, dt: float, role: str) -> Demonstration:
        """One episode as everybody's lessons are made, at one rate, in SI units."""
        groups: dict[str, list[tuple[str, int]]] = {}
        for i, name in enumerate(self.channels):
            group, _, axis = name.partition(".")
            groups.setdefault(group, []).append((axis, i))
        channels = {
            f"hand.{g}": Channel(stamps, frames[:, [i for _, i in cs]], UNITS.get(g, ""), "task", tuple(a for a, _ in cs))
            for g, cs in groups.items()
        }
        where = f"{path}: episode {number:g}" if self.episode else path
        recording = Recording(channels, {"name": where, "source": where, **({"role": role} if role else {})})
        return demonstration(recording, Preparation(rate_hz=1.0 / dt, role=role or None))

    def _stamped(self, path: str, dt: float) -> Iterator[tuple[float, Array, Array]]:
        """(episode's number, frames, stamps [s]) of each episode, its order and rate checked."""
        from ..formats.lerobot import EPISODE, INDEX, STAMP, check_order, check_rate

        wanted = tuple(self.channels.values())
        at = 0
        for piece in self._episodes(path, wanted, (INDEX, STAMP)):
            for number, rows in piece.items():
                frames, index, stamps = rows[:, : len(wanted)], rows[:, len(wanted)], rows[:, len(wanted) + 1]
                exact: Array = np.arange(len(frames), dtype=np.float64) * dt
                if np.isfinite(index).any():
                    check_order(path, {INDEX: index, EPISODE: np.full(len(index), number)}, [len(index)], row=at)
                if np.isfinite(stamps).any():
                    check_rate(path, stamps, [len(stamps)], 1.0 / dt)
                    off = np.abs(stamps - stamps[0] - exact)
                    exact = exact if (off <= np.maximum(2.0**-21 * np.abs(stamps), 1e-9)).all() else stamps
                at += len(frames)
                yield number, frames, exact

    def _episodes(self, path: str, wanted: tuple[str, ...], more: tuple[str, ...] = ()) -> Iterator[dict[float, Array]]:
        """Pieces: episode's number -> (T, D); columns of `more` that the file has not are NaN."""
        try:
            import pyarrow.parquet as parquet
        except ImportError:
            raise RecordingError(f"{path}: reading Parquet needs pyarrow: pip install 'comanip[parquet]'") from None
        from pyarrow import ArrowException

        try:
            with parquet.ParquetFile(path, page_checksum_verification=True) as file:
                yield from self._pieces(path, file, wanted, more)
        except (ArrowException, OSError, UnicodeDecodeError, OverflowError) as error:
            raise RecordingError(f"{path}: not a Parquet file that can be read: {' '.join(str(error).split())[:300]}") from None

    def _pieces(self, path: str, file: Any, wanted: tuple[str, ...], more: tuple[str, ...]) -> Iterator[dict[float, Array]]:
        names = set(file.schema_arrow.names)
        columns = {re.sub(r"\[\d+\]$", "", column) for column in wanted} | ({self.episode} if self.episode else set())
        if absent := sorted(columns - names):
            raise ChannelError(f"{path}: no column {absent[0]!r}; it has: {', '.join(sorted(names))}")
        present = [c for c in more if c in names]
        rest, episode, seen = np.empty((0, len(wanted) + len(more))), None, set()
        for batch in file.iter_batches(batch_size=PIECE, columns=sorted(columns | set(present))):
            empty = np.full(batch.num_rows, np.nan)
            frames = np.column_stack(
                [_column(path, batch, c) if c not in more or c in present else empty for c in (*wanted, *more)]
            )
            numbers = _column(path, batch, self.episode) if self.episode else np.zeros(len(frames))
            before = numbers[0] if episode is None else episode
            cuts = np.flatnonzero(np.diff(numbers, prepend=before)) + len(rest)
            owners = [before, *numbers[cuts - len(rest)].tolist()]
            *whole, rest = np.split(np.concatenate([rest, frames]), cuts)
            episode = numbers[-1]
            piece: dict[float, Array] = {}
            for owner, sequence in zip(owners, whole, strict=False):
                if owner in seen:
                    raise RecordingError(
                        f"{path}: rows of episode {owner:g} stand apart from each other: sort the table by {self.episode}"
                    )
                seen.add(owner)
                piece |= {owner: sequence} if len(sequence) else {}
            if piece:
                yield piece
        if len(rest):
            if episode in seen:
                raise RecordingError(
                    f"{path}: rows of episode {episode:g} stand apart from each other: sort the table by {self.episode}"
                )
            yield {float(episode or 0.0): rest}


def _column(path: str, batch: Any, column: str) -> Array:
    name, _, index = column.removesuffix("]").partition("[") if column.endswith("]") else (column, "", "")
    values = batch.column(name)
    if values.null_count:
        raise RecordingError(f"{path}: column {name!r} has {values.null_count} missing values; fill or cut them")
    if not index:
        if hasattr(values, "flatten") and values.type.num_fields:
            raise ChannelError(f"{path}: column {name!r} holds lists; say which number, for example {name}[0]")
        try:
            return np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)
        except (ValueError, TypeError):
            raise ChannelError(f"{path}: column {name!r} holds {values.type}, not numbers") from None
    flat = values.flatten().to_numpy(zero_copy_only=False) if values.type.num_fields else np.empty(0)
    width = len(flat) // max(len(values), 1)
    if int(index) >= width or width * len(values) != len(flat):
        raise ChannelError(f"{path}: {column}: column {name!r} holds {width} numbers a frame, all frames alike")
    return np.asarray(flat.reshape(-1, width)[:, int(index)], dtype=np.float64)


@dataclass(frozen=True)
class RecordingShards:
    """Reads the recordings of one file of any format (.mcap, .csv, .npz, .mat ...), each made a demonstration as usual."""

    channels: tuple[str, ...]
    columns: Columns
    preparation: Preparation
    recover: bool = False

    def __call__(self, path: str) -> Iterator[list[Array]]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ComanipWarning)  # said once, by the checks
            recordings = read(path, self.columns, recover=self.recover)
            yield [lesson.array(self.channels) for lesson in demonstrations(recordings, self.preparation)]

    def check(self, path: str, dt: float, role: str) -> Checked:
        """What reading and preparing say of a file; both happen again in every pass."""

        def made() -> Iterator[Demonstration]:
            yield from demonstrations(read(path, self.columns, recover=self.recover), self.preparation)

        lessons, said = _listened(made())
        other = [lesson for lesson in lessons if abs(lesson.dt / dt - 1.0) > 1e-6]
        if other:
            raise RecordingError(
                f"{path}: frames at {1 / other[0].dt:g} Hz, the other files at {1 / dt:g} Hz; state the rate to work at"
            )
        notes = dict.fromkeys(note for lesson in lessons for note in lesson.notes if note not in said)
        return Checked(tuple(notes), tuple(said), True)

    def prepared(self, paths: Sequence[str], dt: float, role: str) -> RecordingShards:
        """Itself: its recordings are prepared in every pass."""
        return self
