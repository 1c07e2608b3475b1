"""HDF5: robomimic's demonstrations, MATLAB's .mat of version 7.3, any file of plain arrays; and our own, exact.

Names are paths: "obs/robot0_eef_pos[2]" is the third column of a dataset. A file with groups data/demo_0, data/demo_1 ...
(or episode_0, trial_1 ...) holds one recording each, and names begin below them.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from ..whole_file import write_whole
from .assemble import assemble
from .columns import Columns, sign_and_name, unknown
from .outside import Parts, ask

MAX_BYTES = 256 << 20
MAX_DATASETS = 20_000
VERSION = 1
OURS = "comanip"
_DEMO = re.compile(r"^(?:data/)?(?:demo|episode|traj(?:ectory)?|trial|take|run)_?(\d+)/(.+)$")
_PART = re.compile(r"^(.*?)\[([^\]]+)\]$")
# robosuite's and robomimic's names for what a hand does; its quaternions are x, y, z, w
_HAND = {
    "position": r"(?:robot\d+_)?(?:eef|ee|hand|tcp)_pos(?:ition)?",
    "velocity": r"(?:robot\d+_)?(?:eef|ee|hand|tcp)_(?:vel(?:_lin|ocity)?|lin_vel)",
    "force": r"(?:robot\d+_)?(?:eef|ee|hand|tcp)_force",
}


class Tree:
    """Datasets by path, one list of arrays each, as `assemble` wants its sources."""

    def __init__(self, path: Path, parts: Mapping[str, list[Array]], notes: list[str]) -> None:
        self.path, self.parts, self.notes = path, parts, notes

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.parts)

    def find(self, expression: str) -> list[Array]:
        sign, name = sign_and_name(expression, self.parts)
        match = None if name in self.parts else _PART.match(name)
        base, part = (match[1], match[2]) if match else (name, "")
        return [sign * _cut(self.path, name, array, part) for array in self.parts[self._full(base, name)]]

    def unit(self, expression: str) -> str:
        return ""

    def _full(self, base: str, name: str) -> str:
        for spelt in (base, base.replace(".", "/")):
            if spelt in self.parts:
                return spelt
        ends = [n for n in self.parts if n.endswith("/" + base.replace(".", "/"))]
        if len(ends) == 1:
            return ends[0]
        if ends:
            raise ChannelError(f"{self.path}: {name!r} may be {' or '.join(ends[:8])}; say which")
        raise unknown(str(self.path), name, self.names)


def _cut(path: Path, name: str, array: Array, part: str) -> Array:
    """A column by "[2]", or any part by numpy's "[:,2]"."""
    if not part:
        return array
    try:
        pieces = [slice(*(int(v) if v.strip() else None for v in p.split(":"))) if ":" in p else int(p) for p in part.split(",")]
        if len(pieces) == 1 and array.ndim == 2:
            pieces = [slice(None), *pieces]
        return np.asarray(array[tuple(pieces)])
    except (ValueError, IndexError):
        raise ChannelError(f"{path}: {name!r}: no part [{part}] in shape {array.shape}; use 0-based indices") from None


def open_hdf5(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    parts, facts = ask("hdf5_inside:contents", path)
    if OURS in facts:
        from .mapping import finished

        return [finished(path, r, columns) for r in _own(path, parts, facts[OURS])]
    notes = list(facts["notes"])
    if not parts:
        raise RecordingError(f"{path}: no frames: it holds no array of numbers{'; ' + '; '.join(notes[:8]) if notes else ''}")
    demos = _demonstrations(path, parts, facts, notes)
    columns = _rated(columns, facts, notes)
    return assemble(Tree(path, demos or parts, notes), _recognised(demos or parts, columns, notes))


def _demonstrations(path: Path, parts: Parts, facts: Mapping[str, Any], notes: list[str]) -> Parts:
    """Names below data/demo_i -> one array a demonstration, in the order of their numbers; those that all have."""
    demos: dict[int, dict[str, Array]] = {}
    for name, arrays in parts.items():
        if match := _DEMO.match(name):
            demos.setdefault(int(match[1]), {})[match[2]] = arrays[0]
    for number, said in facts["lengths"].items():
        has = max((len(a) for a in demos.get(int(number), {}).values() if a.ndim), default=0)
        if has != said:
            raise RecordingError(f"{path}: data/demo_{number} says {said} samples and holds {has}: cut, or edited")
    if not demos:
        return {}
    every = [demos[number] for number in sorted(demos)]
    common = [n for n in every[0] if all(n in d and d[n].shape[1:] == every[0][n].shape[1:] for d in every)]
    missing = sorted({n for d in every for n in d} - set(common))
    notes += [f"{n} left out: it is not alike in all demonstrations" for n in missing[:20]]
    return {n: [d[n] for d in every] for n in common}


def _rated(columns: Columns, facts: Mapping[str, Any], notes: list[str]) -> Columns:
    """The rate of the environment that a robomimic file was recorded in, where nothing else is said."""
    if columns.rate_hz is None and columns.time is None and facts.get("rate_hz"):
        notes.append(f"rate: control_freq {facts['rate_hz']:g} Hz of the file's env_args")
        return replace(columns, rate_hz=facts["rate_hz"])
    return columns


def _recognised(parts: Mapping[str, list[Array]], columns: Columns, notes: list[str]) -> Columns:
    """The hand of robosuite's data sets, when nothing is mapped and one name alone fits each kind."""
    if columns.mapped:
        return columns
    chosen: dict[str, str] = {}
    for kind, pattern in _HAND.items():
        hits = [
            n
            for n in parts
            if re.fullmatch(pattern, n.rsplit("/", 1)[-1]) and parts[n][0].ndim == 2 and parts[n][0].shape[1] == 3
        ]
        if len(hits) == 1:
            chosen[kind] = hits[0]
    if "position" not in chosen:
        return columns
    moved = [max(float(np.ptp(a[:, i])) if len(a) else 0.0 for a in parts[chosen["position"]]) for i in range(3)]
    axes = [i for i, span in enumerate(moved) if not span <= 1e-9]
    axes = axes if axes and not columns.axes else ["xyz".index(a) for a in columns.axes or "xyz" if a in "xyz"]
    if len(axes) < 3:
        notes.append(
            f"axis {', '.join(a for i, a in enumerate('xyz') if i not in axes)} left out: "
            f"{chosen['position']} does not move along it"
        )
    changes: dict[str, Any] = {kind: tuple(f"{name}[:,{i}]" for i in axes) for kind, name in chosen.items()}
    notes += [f"{name} taken as {kind}" for kind, name in chosen.items()]
    return replace(columns, **changes, axes=columns.axes or tuple("xyz"[i] for i in axes))


def write_hdf5(recordings: Sequence[Recording], path: Path) -> None:
    """One group data/demo_i a recording, as robomimic has them: obs/<channel> (T, d), time/<channel> (T,), all float64."""
    try:
        import h5py
    except ImportError:
        raise RecordingError(f"{path}: writing HDF5 needs h5py: pip install 'comanip[hdf5]'") from None
    try:
        head = json.dumps({"version": VERSION, "recordings": [_layout(r) for r in recordings], "sha256": digest(recordings)})
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: the metadata must be plain JSON values: {error}") from None
    built = io.BytesIO()  # in memory: where the disk is full, the library ends the process that writes to it
    with h5py.File(built, "w") as file:
        file.create_dataset(OURS, data=np.frombuffer(head.encode(), dtype=np.uint8))
        data = file.create_group("data")
        data.attrs["total"] = sum(_frames(r) for r in recordings)
        for i, recording in enumerate(recordings):
            _write_demonstration(data.create_group(f"demo_{i}"), recording)
    write_whole(path, built.getvalue())


def _frames(recording: Recording) -> int:
    return max((len(c.time) for c in recording.channels.values()), default=0)


def _write_demonstration(group: Any, recording: Recording) -> None:
    group.attrs["num_samples"] = _frames(recording)
    for name, channel in recording.channels.items():
        safe = name.replace("/", "\N{DIVISION SLASH}") or "\N{DIVISION SLASH}"
        for place, values in (("obs", channel.values), ("time", channel.time)):
            group.create_dataset(f"{place}/{safe}", data=values, dtype="f8")


def _layout(recording: Recording) -> dict[str, Any]:
    channels = {n: [c.unit, c.frame, list(c.axes)] for n, c in recording.channels.items()}
    return {"channels": channels, "metadata": dict(recording.metadata)}


def digest(recordings: Sequence[Recording]) -> str:
    """sha256 of layout, metadata, stamps and values."""
    found = hashlib.sha256()
    for recording in recordings:
        found.update(json.dumps(_layout(recording), sort_keys=True).encode("utf-8", "surrogatepass"))
        for channel in recording.channels.values():
            found.update(channel.time.tobytes() + np.ascontiguousarray(channel.values).tobytes())
    return found.hexdigest()


def _own(path: Path, parts: Parts, text: str) -> list[Recording]:
    try:
        head = json.loads(text)
        if int(head["version"]) > VERSION:
            raise RecordingError(
                f"{path}: written as version {head['version']}; this comanip reads up to {VERSION}: update comanip"
            )
        found = [_one(parts, i, layout) for i, layout in enumerate(head["recordings"])]
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError, ChannelError) as error:
        raise RecordingError(
            f"{path}: damaged: its arrays are not what its header says ({' '.join(str(error).split())})"
        ) from None
    if head.get("sha256") != digest(found):
        raise RecordingError(f"{path}: its sha256 does not match: some byte was changed")
    return found


def _one(parts: Parts, number: int, layout: Mapping[str, Any]) -> Recording:
    channels = {}
    for name, (unit, frame, axes) in layout["channels"].items():
        safe = name.replace("/", "\N{DIVISION SLASH}") or "\N{DIVISION SLASH}"
        values, time = (parts[f"data/demo_{number}/{place}/{safe}"][0] for place in ("obs", "time"))
        channels[name] = Channel(time, values.reshape(len(time), len(axes)), unit, frame, tuple(axes))
    return Recording(channels, layout["metadata"])
