"""A recording on one grid of stamps, for formats that have one rate for all channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..recording import Recording
from .faults import cleaned
from .stamps import one_rate


def regridded(recording: Recording, rate_hz: float) -> Recording:
    """Every channel but the events at `rate_hz`, over the time in which all of them have values; said in the notes."""
    if not 0.0 < rate_hz <= 50_000.0:
        raise ParameterError(f"resample_hz is {rate_hz:g}; allowed: 0 < resample_hz <= 50000 Hz")
    where = str(recording.metadata.get("source") or recording.metadata.get("name") or "recording")
    notes: list[str] = []
    steady = {n: c for n, c in recording.channels.items() if n != "events" and len(c.time)}
    steady = {n: cleaned(f"{where}: {n}", c, drop_bad=False, min_frames=4, notes=notes) for n, c in steady.items()}
    dt, signals = one_rate(steady, rate_hz, where, notes)
    start = max(float(c.time[0]) for c in steady.values())
    time: Array = start + dt * np.arange(len(next(iter(signals.values()))), dtype=np.float64)
    channels = {n: replace(c, time=time, values=signals[n]) for n, c in steady.items()}
    return recording.with_channels(channels).with_metadata(notes=[*recording.metadata.get("notes", ()), *notes])
