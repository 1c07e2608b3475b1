"""Events of a recording (who leads, start, stop, marks of the user's) as a channel: one code an event, its words in the metadata.

The channel "events" holds a number for each event at its stamp; metadata["events"] is the list that the numbers point into. So
every format that keeps channels and metadata keeps events.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..recording import Channel, Recording

EVENTS = "events"


class Event(NamedTuple):
    time_s: float
    label: str


def coded(marks: Sequence[tuple[float, str]]) -> tuple[Channel, list[str]]:
    """The channel and the labels of events in order of time."""
    labels = list(dict.fromkeys(label for _, label in marks))
    number = {label: i for i, label in enumerate(labels)}
    times, codes = np.array([t for t, _ in marks]), np.array([[float(number[label])] for _, label in marks])
    return Channel(times, codes.reshape(-1, 1), "", "", ("code",)), labels


def with_events(recording: Recording, marks: Iterable[tuple[float, str]]) -> Recording:
    """The recording with these events, besides those that it has: (stamp [s] on the recording's clock, label)."""
    every = sorted([*events(recording), *marks], key=lambda mark: mark[0])
    if not every:
        return recording
    channel, labels = coded([(float(t), str(label)) for t, label in every])
    return recording.with_channels({EVENTS: channel}).with_metadata(events=labels)


def events(recording: Recording) -> tuple[Event, ...]:
    """Events in order of time; none when the recording has none. RecordingError for a code without a label."""
    if EVENTS not in recording:
        return ()
    channel, labels = recording[EVENTS], list(recording.metadata.get("events", ()))
    found = []
    for i, (t, code) in enumerate(zip(channel.time.tolist(), channel.values[:, 0].tolist(), strict=True)):
        if not (np.isfinite(code) and 0 <= code < len(labels) and code == int(code)):
            raise RecordingError(f"events: event {i} (t = {t:.6f} s) has the code {code:g}; there are {len(labels)} labels")
        found.append(Event(t, str(labels[int(code)])))
    return tuple(found)
