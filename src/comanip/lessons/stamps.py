"""One clock for channels that were stamped by several: rates, jitter and missing frames, said as they are resolved."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Channel
from ..signals.filters import resample
from .faults import MAX_RATE_RATIO, jitters, period, suspect

Frames = NDArray[np.int64]
_ON_GRID = 1e-3  # of a period: stamps this close to a regular grid count as regular


def one_rate(
    channels: Mapping[str, Channel], asked: float | None, where: str, notes: list[str]
) -> tuple[float, dict[str, Array]]:
    """(dt, values of every channel on one grid). Values are untouched when the stamps are that grid already."""
    regular = {n: _regular(c) for n, c in channels.items()}
    rates = {n: 1.0 / dt for n, (dt, _) in regular.items()}
    slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
    if rates[fast] > MAX_RATE_RATIO * rates[slow] * 1.01:
        raise RecordingError(
            f"{where}: {fast} at {rates[fast]:.4g} Hz and {slow} at {rates[slow]:.4g} Hz: more than {MAX_RATE_RATIO:g} "
            "times apart; resample one of them first"
        )
    rate = float(asked) if asked else rates[slow]
    if rate > MAX_RATE_RATIO * rates[slow] * 1.01:
        raise RecordingError(
            f"{where}: {slow} has stamps at {rates[slow]:.4g} Hz, {rate:g} Hz was asked for: a frame counter? "
            'ignore the stamps with time="none", or state another rate'
        )
    dt = regular[slow][0] if not asked or abs(rate * regular[slow][0] - 1.0) < 1e-9 else 1.0 / rate
    first = next(iter(channels.values())).time
    if all(even and np.array_equal(channels[n].time, first) and own == dt for n, (own, even) in regular.items()):
        return dt, {n: np.array(c.values) for n, c in channels.items()}
    start, stop = max(c.time[0] for c in channels.values()), min(c.time[-1] for c in channels.values())
    if stop - start < 3.0 * dt:
        spans = ", ".join(f"{n} {c.time[0]:.3f}-{c.time[-1]:.3f} s" for n, c in channels.items())
        raise RecordingError(f"{where}: the channels hardly overlap in time ({spans}); they need one clock")
    grid = start + dt * np.arange(int((stop - start) / dt + 1e-6) + 1)
    signals = {}
    for n, c in channels.items():
        own, even = regular[n]
        cutoff = 0.4 * rate if rates[n] > 1.5 * rate else None
        signals[n] = resample(c.time, c.values, grid, cutoff_hz=cutoff)
        how = f"zero-phase low-pass {cutoff:.4g} Hz, then linear" if cutoff else "linear"
        lost = int((_steps(c) - 1).sum())
        off = _jitter(c, own)
        jitter = "" if even or off <= _ON_GRID * own else f" with stamps up to {off * 1e3:.2g} ms off"
        jitter += f" and {lost} frames missing" if lost else ""
        notes.append(f"{n}: resampled from {rates[n]:.6g} Hz{jitter} to {rate:.6g} Hz ({how})")
        if not even and off > 0.5 * own:
            suspect(notes, f"{where}: {n}: stamps are up to {off * 1e3:.3g} ms off a regular {rates[n]:.4g} Hz")
    return dt, signals


def _regular(channel: Channel) -> tuple[float, bool]:
    """(period [s], whether the stamps are a regular grid). A period that jitters is rounded to a rate people use."""
    steps = _steps(channel)
    dt = float(channel.time[-1] - channel.time[0]) / int(steps.sum())
    rate = round(1.0 / dt, 3)
    if rate > 0.0 and abs(rate * dt - 1.0) * len(steps) < _ON_GRID:
        dt = 1.0 / rate  # 0.01 and not 0.010000000000000002
    if (steps == 1).all() and _jitter(channel, dt) <= _ON_GRID * dt:
        return dt, True
    nice = round(1.0 / dt)
    return (1.0 / nice if nice and abs(nice * dt - 1.0) < 0.01 else dt), False


def _steps(channel: Channel) -> Frames:
    """Periods from each stamp to the next, more than one where frames are missing; (T - 1,).

    Each stamp is held against an estimate of the grid, not against its neighbour: two neighbours that jitter by 0.3 periods each,
    apart, would look like a missing frame.
    """
    between, dt = np.diff(channel.time), period(channel)
    return _shifts(channel.time, between, dt) if jitters(between) else _tracked(channel.time, dt)


def _tracked(time: Array, dt: float) -> Frames:
    """Steps against a running estimate of the grid."""
    if np.abs(time - time[0] - dt * np.arange(len(time))).max() < 0.25 * dt:
        return np.ones(len(time) - 1, dtype=np.int64)  # what the loop below comes to
    grid, steps = float(time[0]), []
    for stamp in time[1:].tolist():
        step = max(1, round((stamp - grid) / dt))
        grid += step * dt
        grid += 0.1 * (stamp - grid)  # follows drift, averages jitter
        steps.append(step)
    return np.array(steps, dtype=np.int64)


def _shifts(time: Array, between: Array, dt: float) -> Frames:
    """Steps of stamps that jitter: a missing frame shifts all that follow, jitter does not.

    A long step counts as several only as far as the median of forty stamps after it lies later than that of forty before.
    """
    steps = np.ones(len(between), dtype=np.int64)
    off = time - dt * np.arange(len(time))
    long = np.flatnonzero(between > 1.5 * dt)
    for k in long[np.argsort(-between[long], kind="stable")].tolist():  # the longest is the likeliest place
        later = np.median(off[k + 1 : k + 41]) - np.median(off[max(0, k - 39) : k + 1])
        missing = max(0, round(later / dt - 0.15))
        if missing:
            steps[k] += missing
            off[k + 1 :] -= missing * dt
    return steps


def _jitter(channel: Channel, dt: float) -> float:
    """How far stamps lie off a regular grid at most [s]."""
    off = channel.time - dt * np.concatenate([[0], np.cumsum(_steps(channel))])
    return float(np.abs(off - np.median(off)).max())
