"""A recording as a force doctor looks at it: channels over time with rest and gaps marked, and their spectra."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..lessons.checkup import Stretch, stretches
from ..lessons.faults import period
from ..recording import Channel, Recording
from .drawing import blank, label, line, taste
from .shown import for_drawing

MOST = 4  # recordings side by side; more are counted in the caption
_SHOWN = ("hand.position", "hand.velocity", "hand.force", "hand.sensor_force")
_COLOURS = ("#2a6f97", "#c8553d", "#588157", "#7a5195", "#bc8a2c", "#444444")
_REST, _GAP = "#e6edf2", "#f2b8a8"


def checkup_picture(recordings: Sequence[Recording]) -> Any:
    """Figure: a column a recording, a row a channel, and below the spectrum of each channel's fastest axis."""
    shown = list(recordings)[:MOST]
    if not shown:
        raise ParameterError("no recordings to draw; give at least one")
    names = [n for n in _SHOWN if any(n in r for r in shown)]
    more = f" {len(recordings) - MOST} further recordings are not drawn." if len(recordings) > MOST else ""
    caption = (
        "Shaded: at rest (blue-grey); stamps missing (red). Spectra: amplitude by frequency of each axis, without the mean; "
        "a flat tail is noise, a single line above 20 Hz is a drive or the mains, a cliff is a filter." + more
    )
    with taste():
        axes_names = next((r[n].axes for n in names for r in shown if n in r), ())
        handles = [line(label=a, color=_COLOURS[i % len(_COLOURS)]) for i, a in enumerate(axes_names)]
        figure = blank(max(5.0, 3.4 * len(shown)), 1.5 * (len(names) + len(names)), legend=handles, caption=caption)
        grid = figure.subplots(2 * len(names), len(shown), squeeze=False)
        for c, recording in enumerate(shown):
            marks = stretches(recording)
            for r, name in enumerate(names):
                top, below = grid[r][c], grid[len(names) + r][c]
                if name not in recording:
                    top.set_axis_off(), below.set_axis_off()
                    continue
                _over_time(top, recording[name], marks, name)
                _spectrum(below, recording[name], name)
            grid[0][c].set_title(for_drawing(str(recording.metadata.get("name", "")) or f"recording {c + 1}"))
    return figure


def _over_time(ax: Any, channel: Channel, marks: Sequence[Stretch], name: str) -> None:
    for mark in marks:
        ax.axvspan(mark.start_s, mark.stop_s, color=_REST if mark.kind == "rest" else _GAP, lw=0.0, zorder=0)
    for i, column in enumerate(_with_holes(channel)):
        ax.plot(channel.time, column, color=_COLOURS[i % len(_COLOURS)], lw=0.9)
    label(ax, "time [s]", f"{name.removeprefix('hand.')} [{channel.unit or '?'}]")


def _with_holes(channel: Channel) -> list[Array]:
    """Columns that break where stamps are missing: a line across a gap would be a motion that nobody made."""
    values = np.array(channel.values)
    if len(channel.time) > 4:
        values[1:][np.diff(channel.time) > 3.0 * period(channel)] = np.nan
    return list(values.T)


def _spectrum(ax: Any, channel: Channel, name: str) -> None:
    if len(channel.time) < 16:
        ax.set_axis_off()
        return
    dt = period(channel)
    grid = np.arange(channel.time[0], channel.time[-1], dt)
    for i, column in enumerate(channel.values.T):
        even = np.interp(grid, channel.time, np.nan_to_num(column))
        amplitude = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)))) * 4.0 / len(even)
        frequency = np.fft.rfftfreq(len(even), dt)
        floor = max(float(amplitude.max()) * 1e-7, 1e-300)
        ax.loglog(frequency[1:], np.maximum(amplitude[1:], floor), color=_COLOURS[i % len(_COLOURS)], lw=0.8)
    label(ax, "frequency [Hz]", f"|{name.removeprefix('hand.')}| [{channel.unit or '?'}]")
