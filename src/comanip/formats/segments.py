"""One file that holds many takes: cut where a label in it changes (task, target, trial, episode ...)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..errors import ParameterError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .columns import Columns

LABELS = "segment labels"  # the channel in which labels are read; it is no part of the result


def with_labels(columns: Columns) -> Columns:
    """The mapping with one more channel, the labels."""
    names = tuple(name for name, _ in _parts(columns.segment_by))
    return replace(columns, segment_by=(), extra={**columns.extra, LABELS: names})


def _parts(segment_by: Sequence[str]) -> list[tuple[str, float | None]]:
    """(column, the only value that is wanted, or None) of each "column" or "column=value"."""
    found: list[tuple[str, float | None]] = []
    for part in segment_by:
        name, chosen, value = part.partition("=")
        try:
            found.append((name.strip(), float(value) if chosen else None))
        except ValueError:
            raise ParameterError(f"segment_by {part!r}: {value!r} is no number; allowed: a column, = and a number") from None
    return found


def segments(recording: Recording, segment_by: Sequence[str]) -> list[Recording]:
    """Pieces of the recording in which all labels stay as they are, in order, of the values that are wanted.

    A piece lasts up to the first frame with another label. Channels with the stamps of the labels are cut at the same frames, so
    that each take may begin at 0; others at the same times.
    """
    parts = _parts(segment_by)
    labels, rest = recording[LABELS], {n: c for n, c in recording.channels.items() if n != LABELS}
    values, time = np.nan_to_num(labels.values, nan=np.inf), labels.time
    cuts = [0, *(np.flatnonzero((values[1:] != values[:-1]).any(axis=1)) + 1).tolist(), len(time)]
    beside = {name for name, channel in rest.items() if np.array_equal(channel.time, time)}
    found: list[Recording] = []
    for low, high in pairwise(cuts):
        if any(want is not None and value != want for (_, want), value in zip(parts, values[low], strict=True)):
            continue
        until = time[high] if high < len(time) else np.inf
        pieces = {
            name: _within(channel, slice(low, high) if name in beside else _between(channel, time[low], until))
            for name, channel in rest.items()
        }
        told = " ".join(f"{name}={value:g}" for (name, _), value in zip(parts, values[low], strict=True))
        found.append(_piece(recording, {n: c for n, c in pieces.items() if len(c.time)}, f"[{len(found)}] {told}"))
    if not found:
        seen = ", ".join(f"{name} {_few(values[:, i])}" for i, (name, _) in enumerate(parts))
        raise RecordingError(f"{recording.metadata['source']}: nothing has {', '.join(segment_by)}; there are {seen}")
    return found


def _few(values: Array) -> str:
    shown = [f"{v:g}" for v in np.unique(values)]
    return ", ".join(shown[:12]) + (" ..." if len(shown) > 12 else "")


def _between(channel: Channel, begin: float, until: float) -> np.ndarray:
    return np.asarray((channel.time >= begin) & (channel.time < until))


def _within(channel: Channel, rows: np.ndarray | slice) -> Channel:
    return replace(channel, time=channel.time[rows], values=channel.values[rows])


def _piece(recording: Recording, channels: dict[str, Channel], title: str) -> Recording:
    metadata = dict(recording.metadata)
    extra = [name for name in metadata.get("extra", ()) if name != LABELS]
    metadata = {**{k: v for k, v in metadata.items() if k != "extra"}, **({"extra": extra} if extra else {})}
    return Recording(channels, {**metadata, "name": f"{metadata.get('name', '')}{title}"})
