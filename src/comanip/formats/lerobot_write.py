"""The files of a LeRobot data set of version 3.0, as lerobot 0.4 and 0.6 read them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Recording

SIDECAR = "meta/comanip.json"
_SCALARS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class Features(NamedTuple):
    """Column of the data set -> (channel, axis number) of its entries; names of the entries."""

    sources: dict[str, tuple[tuple[str, int], ...]]
    names: dict[str, tuple[str, ...]]


def write_parts(folder: Path, recordings: Sequence[Recording], dense: Sequence[str], features: Features, fps: int) -> None:
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise RecordingError(f"{folder}: writing a LeRobot data set needs pyarrow: pip install 'comanip[parquet]'") from None
    for place in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / place).mkdir(parents=True)
    tasks = [str(r.metadata.get("task") or "handle an object together with a person") for r in recordings]
    words = list(dict.fromkeys(tasks))
    episodes: list[dict[str, Array]] = []
    before = 0
    for number, (recording, task) in enumerate(zip(recordings, tasks, strict=True)):
        episodes.append(_columns(recording, features, fps, number, words.index(task), before))
        before += len(episodes[-1]["index"])
    whole = {n: np.concatenate([e[n] for e in episodes]) for n in episodes[0]}
    table = arrow.table({n: _arrow(arrow, n, v) for n, v in whole.items()})
    parquet.write_table(table, folder / "data/chunk-000/file-000.parquet", write_page_checksum=True)
    parquet.write_table(_tasks(arrow, words), folder / "meta/tasks.parquet")
    stats = [{n: _stats(v) for n, v in e.items()} for e in episodes]
    parquet.write_table(_episodes(arrow, episodes, stats, tasks), folder / "meta/episodes/chunk-000/file-000.parquet")
    _json(folder / "meta/stats.json", {n: _stats(v) for n, v in whole.items()})
    _json(folder / "meta/info.json", _info(features, fps, len(recordings), len(whole["index"]), len(words)))
    _json(folder / SIDECAR, _sidecar(folder, recordings, dense, features, fps))


def _columns(recording: Recording, features: Features, fps: int, number: int, task: int, before: int) -> dict[str, Any]:
    """Column -> (T, k) or (T,) of one episode."""
    found = {c: np.column_stack([recording[n].values[:, i] for n, i in entries]) for c, entries in features.sources.items()}
    frames = len(next(iter(found.values())))
    index = np.arange(frames)
    return {
        **found,
        "timestamp": (index / fps).astype(np.float32),
        "frame_index": index,
        "episode_index": np.full(frames, number),
        "index": before + index,
        "task_index": np.full(frames, task),
    }


def _arrow(arrow: Any, name: str, values: Array) -> Any:
    if name in _SCALARS:
        return arrow.array(values, type=getattr(arrow, _SCALARS[name])())
    return arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel(), type=arrow.float64()), values.shape[1])


def _stats(values: Array) -> dict[str, list[float]]:
    """Per entry, of its finite numbers alone: a normaliser that divides by NaN trains nothing."""
    rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    columns = [_column_stats(column[np.isfinite(column)]) for column in rows.T]
    return {**{name: [c[name] for c in columns] for name in columns[0]}, "count": [len(rows)]}


def _column_stats(column: Array) -> dict[str, float]:
    column = column if len(column) else np.zeros(1)
    with np.errstate(all="ignore"):
        found = {"min": column.min(), "max": column.max(), "mean": column.mean(), "std": column.std()}
        found |= {name: np.quantile(column, q) for name, q in _QUANTILES.items()}
    return {name: float(np.nan_to_num(v)) for name, v in found.items()}


def _tasks(arrow: Any, words: Sequence[str]) -> Any:
    """task_index by task; lerobot reads it with pandas, whose index is stated in the schema's metadata."""
    table = arrow.table({"task_index": arrow.array(range(len(words)), type=arrow.int64()), "task": arrow.array(list(words))})
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [
            {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        ],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": None},
            {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
        ],
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _episodes(
    arrow: Any, episodes: Sequence[Mapping[str, Array]], stats: Sequence[Mapping[str, Any]], tasks: Sequence[str]
) -> Any:
    starts = [int(e["index"][0]) for e in episodes]
    lengths = [len(e["index"]) for e in episodes]
    zeros = [0] * len(episodes)
    columns: dict[str, Any] = {
        "episode_index": list(range(len(episodes))),
        "tasks": [[t] for t in tasks],
        "length": lengths,
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": starts,
        "dataset_to_index": [s + n for s, n in zip(starts, lengths, strict=True)],
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }
    for name, found in stats[0].items():
        for kind in found:
            columns[f"stats/{name}/{kind}"] = [s[name][kind] for s in stats]
    return arrow.table(columns)


def _info(features: Features, fps: int, episodes: int, frames: int, tasks: int) -> dict[str, Any]:
    described: dict[str, Any] = {
        c: {"dtype": "float64", "shape": [len(names)], "names": list(names)} for c, names in features.names.items()
    }
    described |= {n: {"dtype": kind, "shape": [1], "names": None} for n, kind in _SCALARS.items()}
    return {
        "codebase_version": "v3.0", "robot_type": "comanip", "total_episodes": episodes, "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": fps,
        "splits": {"train": f"0:{episodes}"}, "data_path": _DATA, "video_path": None, "features": described,
    }  # fmt: skip


def _sidecar(folder: Path, recordings: Sequence[Recording], dense: Sequence[str], features: Features, fps: int) -> dict[str, Any]:
    """What a data set has no place for: units, frames, stamps, events, metadata; and a checksum of everything."""
    sources = {c: [list(e) for e in entries] for c, entries in features.sources.items() if c != "action"}
    covered = {n for entries in sources.values() for n, _ in entries}
    assert covered == set(dense)
    side = {"version": 1, "features": sources, "episodes": [_beside(folder, r, dense, fps) for r in recordings]}
    return {**side, "sha256": digest(side, recordings)}


def _beside(folder: Path, recording: Recording, dense: Sequence[str], fps: int) -> dict[str, Any]:
    time = recording[dense[0]].time
    found: dict[str, Any] = {
        "fps": fps,
        "start_s": float(time[0]),
        "order": list(recording.channels),
        "channels": {n: [recording[n].unit, recording[n].frame, list(recording[n].axes)] for n in dense},
        "beside": {
            n: [c.time.tolist(), c.values.tolist(), c.unit, c.frame, list(c.axes)]
            for n, c in recording.channels.items()
            if n not in dense
        },
        "metadata": dict(recording.metadata),
    }
    if not np.array_equal(float(time[0]) + np.arange(len(time)) / fps, time):
        found["time"] = time.tolist()
    try:
        json.dumps(found["metadata"])
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{folder}: the metadata must be plain JSON values: {error}") from None
    return found


def digest(side: Mapping[str, Any], recordings: Sequence[Recording]) -> str:
    """sha256 of the sidecar and of every stamp and value."""
    text = json.dumps({k: v for k, v in side.items() if k != "sha256"}, sort_keys=True)
    found = hashlib.sha256(text.encode("utf-8", "surrogatepass"))
    for recording in recordings:
        for name, channel in recording.channels.items():
            found.update(
                name.encode("utf-8", "surrogatepass") + channel.time.tobytes() + np.ascontiguousarray(channel.values).tobytes()
            )
    return found.hexdigest()


def _json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")
