"""Where a recording is cut: holes of its channels, what lies between two of them, and rest at its ends."""

from __future__ import annotations

from dataclasses import replace

from ..interfaces import Array
from ..recording import Channel
from .forces import rest_frames


def merged(cuts: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Holes of several channels that overlap count as one."""
    merged: list[tuple[float, float]] = []
    for before, after in cuts:
        if merged and before < merged[-1][1]:
            merged[-1] = (merged[-1][0], max(after, merged[-1][1]))
        else:
            merged.append((before, after))
    return merged


def between(channel: Channel, start: float, stop: float) -> Channel:
    """The samples from `start` to `stop` [s], both included."""
    keep = (channel.time >= start) & (channel.time <= stop)
    return replace(channel, time=channel.time[keep], values=channel.values[keep])


def trimmed(signals: dict[str, Array], dt: float, keep_s: float | None, unit: str, notes: list[str]) -> dict[str, Array]:
    """Without the rest at start and end beyond `keep_s` [s] of each; None keeps all, and so does one that rests throughout."""
    if keep_s is None:
        return signals
    start, end = rest_frames(signals["velocity"], dt, unit)
    frames, keep = len(signals["velocity"]), round(keep_s / dt)
    first, last = max(0, start - keep), frames - max(0, end - keep)
    if start == frames or (first, last) == (0, frames):
        return signals
    notes.append(f"trimmed rest: {first * dt:.3g} s at the start, {(frames - last) * dt:.3g} s at the end")
    return {n: v[first:last] for n, v in signals.items()}
