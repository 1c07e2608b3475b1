"""LeRobot data sets, read (v2.0, v2.1, v3.0) and written (v3.0): one recording an episode.

Read: frames are held against what the set says of itself (rate, lengths, order) before any of them is used.
Written: hand.position, hand.velocity and hand.force are "observation.state", the commanded (else its own) velocity is "action",
every other channel is a column of its own. What a data set has no place for is in meta/comanip.json, so that it comes back
exactly.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import ChannelError, ParameterError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .assemble import assemble
from .columns import NAME, Columns
from .lerobot_write import SIDECAR, Features, digest, write_parts
from .parquet_file import EPISODE, INDEX, STAMP, Episodes, numeric, obvious, read_table

VERSIONS = ("v2.0", "v2.1", "v3.0")
RATE_OFF = 0.01  # stamps and the stated rate may differ by this share
MAX_JSON = 64 << 20
_FLOAT32 = 2.0**-22  # relative: two units in the last place of a stamp


class Facts(NamedTuple):
    """meta/info.json, as far as it is used."""

    fps: float | None
    episodes: int | None
    frames: int | None
    names: dict[str, tuple[str, ...]]


def facts_of(folder: Path) -> Facts:
    """RecordingError for a rate that is none, or a version that is not read."""
    path = folder / "meta" / "info.json"
    info = _json(path) if path.exists() else {}
    version = str(info.get("codebase_version", "v3.0"))
    if version not in VERSIONS:
        raise RecordingError(f"{path}: codebase_version {version!r}; read are {', '.join(VERSIONS)}: convert it with lerobot")
    features = info.get("features")
    names = {str(n): _entries(f) for n, f in features.items()} if isinstance(features, dict) else {}
    return Facts(
        checked_fps(path, info.get("fps")), _count(path, info, "total_episodes"), _count(path, info, "total_frames"),
        {n: e for n, e in names.items() if e},
    )  # fmt: skip


def checked_fps(path: Path, fps: Any) -> float | None:
    """The stated rate [Hz]; None when nothing is stated."""
    if fps is None:
        return None
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not 1.0 <= fps <= 50_000.0:
        raise RecordingError(f"{path}: fps is {fps!r}; allowed: 1 to 50000 frames a second")
    return float(fps)


def _count(path: Path, info: Mapping[str, Any], name: str) -> int | None:
    value = info.get(name)
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 0):
        raise RecordingError(f"{path}: {name} is {value!r}; allowed: a number >= 0")
    return value


def _entries(feature: Any) -> tuple[str, ...]:
    """Names of the entries of a feature: a list, or {"motors": [...]} and the like; () when they are not usable."""
    found = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(found, dict):
        found = next((v for v in found.values() if isinstance(v, list)), None) or list(found)
    shape = feature.get("shape") if isinstance(feature, dict) else None
    if not isinstance(found, list) or len({str(n) for n in found}) != len(found):
        return ()
    return tuple(str(n) for n in found) if not isinstance(shape, list) or shape == [len(found)] else ()


def _json(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MAX_JSON:
        raise RecordingError(f"{path}: {path.stat().st_size >> 20} MB; the limit is {MAX_JSON >> 20} MB")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: not JSON: {' '.join(str(error).split())}") from None
    if not isinstance(found, dict):
        raise RecordingError(f"{path}: holds {type(found).__name__}; allowed: an object")
    return found


def open_folder(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    facts = facts_of(path)
    table, notes = _table(path)
    lengths = _lengths(path, table, facts)
    check_order(str(path), table, lengths)
    table = {**table, STAMP: _stamps(path, table, lengths, facts, columns)}
    if columns.time is None:
        notes.append(f"stamps: {INDEX} / {facts.fps:g} Hz" if facts.fps else f"stamps: the column {STAMP!r}")
    names = {n: e for n, e in facts.names.items() if n in table and table[n].ndim == 2 and table[n].shape[1] == len(e)}
    found = _tasks(path, table, lengths)
    if (path / SIDECAR).exists():
        return _own(path, table, lengths, columns, found)
    chosen = obvious(table, names, columns if columns.time else _timed(columns), notes)
    recordings = assemble(Episodes(path, table, lengths, names, notes), chosen)
    return [
        r.with_metadata(episode=i, **({"task": t} if t else {})) for i, (r, t) in enumerate(zip(recordings, found, strict=True))
    ]


def _timed(columns: Columns) -> Columns:
    from dataclasses import replace

    return replace(columns, time=STAMP)


def _table(path: Path) -> tuple[dict[str, Array], list[str]]:
    """All frames of all files, columns joined; the files in the order of their names."""
    files = sorted(path.glob("data/**/*.parquet"))
    files = [f for f in files if not f.name.startswith(".")]
    if not files:
        raise RecordingError(f"{path}: no data/**/*.parquet: the data set holds no frames")
    parts, notes = [], [f"{len(files)} files"] if len(files) > 1 else []
    for file in files:
        numbers, left_out = numeric(file, read_table(file)[0])
        parts.append(numbers)
        notes += left_out
    common = [n for n in parts[0] if all(n in p and p[n].shape[1:] == parts[0][n].shape[1:] for p in parts)]
    notes += [f"column {n!r} left out: it is not alike in all files" for n in parts[0] if n not in common]
    return {n: np.concatenate([p[n] for p in parts]) for n in common}, list(dict.fromkeys(notes))


def _lengths(path: Path, table: Mapping[str, Array], facts: Facts) -> list[int]:
    """Frames of each episode; held against meta/info.json and meta/episodes."""
    from .parquet_file import episode_lengths

    lengths = episode_lengths(path, table)
    frames = len(next(iter(table.values())))
    for what, said, has in (("episodes", facts.episodes, len(lengths)), ("frames", facts.frames, frames)):
        if said is not None and said != has:
            raise RecordingError(f"{path}: meta/info.json says {said} {what}, the files hold {has}: is a file missing or cut?")
    stated = _stated_lengths(path)
    for i, (index, length) in enumerate(zip(_indices(table, lengths), lengths, strict=True)):
        if stated and stated.get(index, length) != length:
            raise RecordingError(
                f"{path}: episode {index} has {length} frames, meta/episodes says {stated[index]} (row {sum(lengths[:i])})"
            )
    return lengths


def _indices(table: Mapping[str, Array], lengths: Sequence[int]) -> list[int]:
    if EPISODE not in table:
        return list(range(len(lengths)))
    return [int(v) for v in table[EPISODE][np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(int)]]


def _stated_lengths(path: Path) -> dict[int, int]:
    rows = [*_rows(path / "meta" / "episodes.jsonl")]
    for file in sorted(path.glob("meta/episodes/**/*.parquet")):
        table = read_table(file)[0]
        if {"episode_index", "length"} <= set(table.column_names):
            rows += table.select(["episode_index", "length"]).to_pylist()
    return {
        r["episode_index"]: r["length"]
        for r in rows
        if isinstance(r.get("episode_index"), int) and isinstance(r.get("length"), int)
    }


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    """Objects of a .jsonl file; none when there is no file."""
    if not path.exists():
        return
    if path.stat().st_size > MAX_JSON:
        raise RecordingError(f"{path}: {path.stat().st_size >> 20} MB; the limit is {MAX_JSON >> 20} MB")
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        try:
            row = json.loads(line) if line.strip() else {}
        except (ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: line {number} is not JSON: {' '.join(str(error).split())}") from None
        if isinstance(row, dict):
            yield row


def _tasks(path: Path, table: Mapping[str, Array], lengths: Sequence[int]) -> list[str]:
    """The task of each episode in words, "" where none is said."""
    words = {r["task_index"]: str(r["task"]) for r in _rows(path / "meta" / "tasks.jsonl") if "task_index" in r and "task" in r}
    file = path / "meta" / "tasks.parquet"
    if file.exists():
        found = read_table(file)[0]
        text = next((n for n in ("task", "__index_level_0__") if n in found.column_names), None)
        if text and "task_index" in found.column_names:
            words |= dict(zip(found.column("task_index").to_pylist(), map(str, found.column(text).to_pylist()), strict=True))
    if "task_index" not in table or table["task_index"].ndim != 1:
        return [""] * len(lengths)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(int)
    return [words.get(int(v), "") if np.isfinite(v) else "" for v in table["task_index"][starts]]


def check_order(where: str, table: Mapping[str, Array], lengths: Sequence[int], *, row: int = 0) -> None:
    """frame_index counts 0, 1, 2 ... within each episode; a count that runs back or starts again is named with its row."""
    if INDEX not in table or table[INDEX].ndim != 1:
        return
    at = 0
    for episode, length in zip(_indices(table, lengths), lengths, strict=True):
        index = table[INDEX][at : at + length]
        step = np.diff(index)
        wrong = np.flatnonzero(step != 1.0)
        if len(wrong):
            k = int(wrong[0])
            before, after = index[k], index[k + 1]
            here = f"{where}: episode {episode}: {INDEX} goes from {before:g} to {after:g} at row {row + at + k + 1}"
            if after == index[0] and step[k] < -1.0:
                raise RecordingError(f"{here}: several episodes under one number? renumber {EPISODE}")
            if step[k] > 1.0 and not ((index > before) & (index < after)).any():  # else they are there, elsewhere
                raise RecordingError(
                    f"{here}: {after - before - 1:g} frames are missing; cut the episode there, or number them anew"
                )
            raise RecordingError(f"{here}: the frames are not in order; sort them")
        at += length


def _stamps(path: Path, table: Mapping[str, Array], lengths: Sequence[int], facts: Facts, columns: Columns) -> Array:
    """(T,) [s]: frame / fps where the stamps agree with it, as they do to the precision of their float32."""
    frame = np.concatenate([np.arange(n) for n in lengths]).astype(np.float64)
    stamps = table.get(STAMP)
    if facts.fps is None or columns.time == STAMP:
        if stamps is None and facts.fps is None:
            if columns.rate_hz is None:
                raise RecordingError(
                    f"{path}: neither fps in meta/info.json nor a column {STAMP!r}; state the rate (rate_hz=...)"
                )
            return frame / columns.rate_hz
        return frame / facts.fps if stamps is None and facts.fps else np.asarray(stamps)
    exact = frame / facts.fps
    if stamps is None or stamps.ndim != 1:
        return exact
    check_rate(str(path / "meta" / "info.json"), stamps, lengths, facts.fps)
    starts = np.repeat(stamps[np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(int)], lengths)
    near = np.abs(stamps - starts - exact) <= np.maximum(_FLOAT32 * np.abs(stamps), 1e-9) * 2.0
    return exact if near.all() else np.asarray(stamps)


def check_rate(where: str, stamps: Array, lengths: Sequence[int], fps: float) -> None:
    """The stated rate against the stamps: one of them is wrong when they differ, and a model learned by it moves at a wrong
    speed."""
    inside = np.ones(max(len(stamps) - 1, 0), dtype=bool)
    inside[np.cumsum(lengths)[:-1] - 1] = False
    steps = np.diff(stamps)[inside]
    usual = float(np.median(steps)) if len(steps) else 0.0
    if usual > 0.0 and abs(usual * fps - 1.0) > RATE_OFF:
        raise RecordingError(
            f"{where}: fps is {fps:g}, the column {STAMP!r} steps by {usual:.4g} s ({1.0 / usual:.4g} Hz); correct one of them, "
            f"or take "
            f"the stamps (time={STAMP!r}), or the rate alone (time='none', rate_hz=...)"
        )


# Writing ------------------------------------------------------------------------------------------------------------------


def write_dataset(recordings: Sequence[Recording], path: Path) -> None:
    """A data set of version 3.0 in the folder `path`, which must not be there yet; float64, one task a recording.

    Every channel needs one rate for all recordings, a whole number of frames a second: RecordingError names what differs.
    """
    if not recordings:
        raise ParameterError(f"{path}: no recordings to write; give at least one")
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise RecordingError(f"{path}: is there already; give the name of a new folder")
    fps, dense = _one_grid(path, recordings)
    features = _features(path, recordings, dense)
    import shutil

    part = path.with_name(f".{path.name[:40]}.tmp")
    shutil.rmtree(part, ignore_errors=True)
    try:
        write_parts(part, recordings, dense, features, fps)
        if path.exists():
            path.rmdir()
        part.replace(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _one_grid(path: Path, recordings: Sequence[Recording]) -> tuple[int, list[str]]:
    """(frames a second, names of the channels that are frames of it). Events keep their own stamps, beside the frames."""
    first = recordings[0]
    dense = [n for n, c in first.channels.items() if n != "events"]
    rates = set()
    for i, recording in enumerate(recordings):
        name = str(recording.metadata.get("name", i))
        for channel in dense:
            if channel not in recording or recording[channel].axes != first[channel].axes:
                raise ChannelError(f"{path}: {channel} of {name} is not as in the first recording; a data set has one layout")
        stray = [n for n in recording.channels if n not in dense and n != "events"]
        if stray:
            raise ChannelError(f"{path}: {name} has {stray[0]}, the first recording has not; a data set has one layout")
        rates.add(_rate(f"{path}: {name}", recording, dense))
    if len(rates) != 1:
        raise RecordingError(
            f"{path}: recordings at {', '.join(f'{r} Hz' for r in sorted(rates))}; a data set has one rate: resample them"
        )
    return rates.pop(), dense


def _rate(where: str, recording: Recording, dense: Sequence[str]) -> int:
    reference = recording[dense[0]].time
    for name in dense:
        time = recording[name].time
        if len(time) != len(reference) or not np.array_equal(time, reference):
            raise RecordingError(
                f"{where}: {name} and {dense[0]} have different stamps; a data set has one rate for all channels: resample first "
                "(convert --resample-hz), or write .mcap, .parquet or .hdf5"
            )
    if len(reference) < 2:
        raise RecordingError(f"{where}: {len(reference)} frames; an episode needs two")
    fps = round((len(reference) - 1) / float(reference[-1] - reference[0])) if reference[-1] > reference[0] else 0
    off = np.abs(reference - reference[0] - np.arange(len(reference)) / max(fps, 1)).max()
    if fps < 1 or not off < 1e-6 + 1e-3 / fps:
        raise RecordingError(
            f"{where}: its stamps are no whole number of frames a second; resample first (convert --resample-hz)"
        )
    return fps


def _features(path: Path, recordings: Sequence[Recording], dense: Sequence[str]) -> Features:
    first = recordings[0]
    state = [n for n in (NAME["position"], NAME["velocity"], NAME["force"], NAME["sensor_force"]) if n in dense]
    groups: dict[str, list[str]] = {"observation.state": state} if state else {}
    action = next((n for n in ("command.velocity", NAME["velocity"], NAME["position"]) if n in dense), None)
    if action:
        groups["action"] = [action]
    groups |= {f"observation.{n}".replace("/", "_"): [n] for n in dense if n not in state}
    sources = {c: tuple((n, i) for n in several for i in range(len(first[n].axes))) for c, several in groups.items()}
    names = {c: tuple(f"{n}.{first[n].axes[i]}" for n, i in entries) for c, entries in sources.items()}
    return Features(sources, names)


def _own(
    path: Path, table: Mapping[str, Array], lengths: Sequence[int], columns: Columns, tasks: Sequence[str]
) -> list[Recording]:
    """What `write_dataset` wrote, channel by channel, with the stamps, units, frames and metadata it had."""
    from .mapping import finished

    side = _json(path / SIDECAR)
    try:
        features, episodes = dict(side["features"]), list(side["episodes"])
        if int(side["version"]) > 1:
            raise RecordingError(
                f"{path / SIDECAR}: written as version {side['version']}; this comanip reads up to 1: update comanip"
            )
        if len(episodes) != len(lengths):
            raise ValueError(f"{len(episodes)} episodes, the frames have {len(lengths)}")
        found, at = [], 0
        for episode, length in zip(episodes, lengths, strict=True):
            part = {n: v[at : at + length] for n, v in table.items()}
            found.append(_episode(part, features, episode))
            at += length
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, ChannelError) as error:
        raise RecordingError(
            f"{path / SIDECAR}: does not fit the frames ({error}); without it the frames are read as anybody's"
        ) from None
    if side.get("sha256") != digest(side, found):
        raise RecordingError(f"{path}: the sha256 in {SIDECAR} does not match: some byte was changed")
    return [finished(path, r, columns) for r in found]


def _episode(table: Mapping[str, Array], features: Mapping[str, Any], episode: Mapping[str, Any]) -> Recording:
    columns: dict[str, dict[int, Array]] = {}
    for column, entries in features.items():
        values = table[column] if table[column].ndim == 2 else table[column][:, None]
        for i, (channel, axis) in enumerate(entries):
            columns.setdefault(channel, {})[int(axis)] = values[:, i]
    start, fps = float(episode["start_s"]), float(episode["fps"])
    time = np.array(episode["time"]) if "time" in episode else start + np.arange(len(next(iter(table.values())))) / fps
    channels = {
        name: Channel(time, np.column_stack([columns[name][i] for i in range(len(columns[name]))]), unit, frame, tuple(axes))
        for name, (unit, frame, axes) in episode["channels"].items()
        if name in columns
    }
    for name, (stamps, values, unit, frame, axes) in episode["beside"].items():
        channels[name] = Channel(stamps, np.array(values, dtype=np.float64).reshape(len(stamps), -1), unit, frame, tuple(axes))
    return Recording({n: channels[n] for n in episode["order"]}, episode["metadata"])
