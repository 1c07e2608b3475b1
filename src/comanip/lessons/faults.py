"""What can be wrong with a recording, each fault named in one line before anything is learned from it.

A check raises what cannot be used, warns of what is suspicious, and appends to `notes` whatever it changes.
`where` names file and channel in every message.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import ComanipWarning, RecordingError, plain
from ..interfaces import Array
from ..recording import Channel, axis_units
from ..signals.filters import differentiate, smooth

MAX_GAP = 3.0  # periods without a sample
BRIDGED_S, BRIDGED_PERIODS = 0.05, 2.0  # holes up to this, or up to these periods of the working rate, are bridged and said
SHORTEST_S, LONGEST_S = 2e-5, 0.4  # [s] between samples; whole milliseconds read as seconds would be 0.5 or more
JITTERY = 0.1  # of a step: where steps scatter by more, their median is no period (stamps that stay in order shorten it)
MAX_RATE_RATIO = 10.0
WRONG_FACTOR = 1.25  # velocity against d(position)/dt
LAG_WARNED, LAG_REFUSED = 0.03, 0.06  # [s]
BIAS_WARNED = 1.5  # [N] a hand-held sensor that was tared reads less
MOVED, MOVED_SPEED = 2e-3, 0.02  # [m, rad], [m/s, rad/s]: what moves less is at rest
DEAD = 1e-9  # below this a signal is constant, which is another fault (a dead sensor)


@dataclass(frozen=True)
class Plausible:
    """Ranges outside which a unit is wrong rather than a motion unusual; pass None instead to skip the check.

    position_span    smallest and largest extent of the motion [m]
    velocity_peak    smallest and largest peak speed [m/s]
    force_peak       smallest and largest peak force [N]
    workspace        (lower, upper) position per axis [m], when it is known
    """

    position_span: tuple[float, float] = (1e-3, 20.0)
    velocity_peak: tuple[float, float] = (1e-3, 10.0)
    force_peak: tuple[float, float] = (0.03, 500.0)
    workspace: tuple[tuple[float, float], ...] = ()


def suspect(notes: list[str], message: str) -> None:
    """Says a suspicion twice: as a warning now, and in the notes that travel with the data."""
    notes.append(message)
    warnings.warn(plain(message), ComanipWarning, stacklevel=4)


def kinds_of_axes(unit: str, n_axes: int) -> dict[str, list[int]]:
    """Unit -> axes measured in it: only what has one unit may be compared or added."""
    kinds: dict[str, list[int]] = {}
    for i, one in enumerate(axis_units(unit, n_axes)):
        kinds.setdefault(one, []).append(i)
    return kinds


def cleaned(where: str, channel: Channel, *, drop_bad: bool, min_frames: int, notes: list[str]) -> Channel:
    """The channel with finite values and strictly increasing stamps, or RecordingError with the first bad frame.

    `drop_bad` drops frames that are not finite; frames that repeat stamp AND values are dropped always.
    """
    _enough(where, len(channel.time), min_frames)
    bad = ~(np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time))
    if bad.any():
        if not drop_bad:
            raise RecordingError(_not_finite(where, channel, int(np.flatnonzero(bad)[0]), int(bad.sum())))
        channel = _kept(channel, ~bad)
        suspect(notes, f"{where}: dropped {int(bad.sum())} frames that are not finite")
    step = np.diff(channel.time)
    backwards = np.flatnonzero(step < 0.0)
    if len(backwards):
        k = int(backwards[0]) + 1
        raise RecordingError(
            f"{where}: time goes backwards at frame {k} (t = {channel.time[k]:.6f} s, dt = {step[k - 1]:.3f} s); "
            'sort or cut the file, or ignore its stamps with time="none" and a rate'
        )
    repeated = np.concatenate([[False], step == 0.0])
    if repeated.any():
        k = int(np.flatnonzero(repeated)[0])
        same = repeated & np.concatenate([[False], (np.diff(channel.values, axis=0) == 0.0).all(axis=1)])
        if not np.array_equal(same, repeated):
            k = int(np.flatnonzero(repeated & ~same)[0])
            raise RecordingError(
                f"{where}: frames {k - 1} and {k} have one stamp (t = {channel.time[k]:.6f} s) and different values; "
                'remove one, or ignore the stamps with time="none" and a rate'
            )
        channel = _kept(channel, ~repeated)
        suspect(notes, f"{where}: dropped {int(repeated.sum())} exact copies of frames, the first at frame {k}")
    _enough(where, len(channel.time), min_frames)
    return channel


def _kept(channel: Channel, keep: Array | np.ndarray) -> Channel:
    return replace(channel, time=channel.time[keep], values=channel.values[keep])


def _enough(where: str, frames: int, min_frames: int) -> None:
    if frames < min_frames:
        raise RecordingError(f"{where}: {frames} frames; needs >= {min_frames}: record longer or use fewer states")


def _not_finite(where: str, channel: Channel, frame: int, count: int) -> str:
    row = [channel.time[frame], *channel.values[frame]]
    value = next(float(v) for v in row if not np.isfinite(v))
    return (
        f"{where}: frame {frame} (t = {channel.time[frame]:.6f} s) is {value}, and {count - 1} more are not finite; "
        "allowed: finite numbers; drop such frames with drop_bad"
    )


def period(channel: Channel) -> float:
    """The usual time between samples [s]: the median of the steps, which gaps and lost frames do not move.

    Stamps that jitter have a median of some error, and where they must stay in order one that is too short (by 3 % at 0.3
    periods): there the period is the total time by the number of steps, gaps left out.
    """
    step = np.diff(channel.time)
    usual = float(np.median(step))
    return float(step[step <= 4.0 * usual].mean()) if jitters(step) else usual


def jitters(step: Array) -> bool:
    """Whether steps (T - 1,) between stamps scatter so much that their median is no period."""
    usual = float(np.median(step))
    return bool(np.median(np.abs(step - usual)) > JITTERY * usual)


def check_period(where: str, channel: Channel) -> None:
    """Refuses stamps that count in another unit than seconds, or that are times of arrival."""
    dt = period(channel)
    if dt > LONGEST_S:
        raise RecordingError(f"{where}: {dt:g} s between samples: {_longer(dt, np.diff(channel.time))}")
    if dt < SHORTEST_S:
        guess = "days" if SHORTEST_S <= dt * 86400.0 <= LONGEST_S else "hours or minutes"
        raise RecordingError(
            f"{where}: {dt:g} s between samples: stamps in {guess}? allowed: {SHORTEST_S:.5f}-{LONGEST_S:g} s; state time_unit"
        )
    _check_bursts(where, channel)


def _longer(dt: float, step: Array) -> str:
    """What stamps that are too far apart may be."""
    units = [u for u, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if SHORTEST_S <= dt * factor <= LONGEST_S]
    words = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
    counter = "a frame counter, or " if (step == 1.0).all() else ""
    ignore = '; or ignore the stamps with time="none" and state rate_hz' if counter else ""
    guess, unit = (words[units[0]], units[0]) if units else ("milliseconds or microseconds", "ms")
    return f"{counter}{guess}? allowed: {SHORTEST_S:.5f}-{LONGEST_S:g} s; state time_unit={unit!r}{ignore}"


def _check_bursts(where: str, channel: Channel) -> None:
    """Stamps in bursts (many steps far shorter than the mean, the others far longer) are times of arrival."""
    step = np.diff(channel.time)
    mean = float(step[step <= np.quantile(step, 0.98)].mean())  # single gaps are no bursts
    short = float((step < 0.25 * mean).mean())
    if len(step) < 20 or not 0.3 <= short <= 0.95:
        return
    raise RecordingError(
        f"{where}: stamps come in bursts (about {1.0 / (1.0 - short):.0f} frames at once, then {step.max():.3g} s without): "
        'frames were stamped when they arrived; ignore the stamps with time="none" and state rate_hz '
        f"({1.0 / mean:.4g} Hz on average)"
    )


def gaps(channel: Channel, working_dt: float = 0.0) -> list[tuple[int, float, float]]:
    """(frame before, stamp before, stamp after) of every hole too long to be bridged at a working period of `working_dt` [s].

    Bridged, linearly, are 3 periods, 50 ms, or 2 periods of the working rate, whichever is longest.
    """
    most = max(MAX_GAP * period(channel), BRIDGED_S, BRIDGED_PERIODS * working_dt)
    return holes(channel, most)


def holes(channel: Channel, longer_than_s: float) -> list[tuple[int, float, float]]:
    """(frame before, stamp before, stamp after) of every pause between stamps longer than `longer_than_s`."""
    found = np.flatnonzero(np.diff(channel.time) > longer_than_s * (1.0 + 1e-6))
    return [(int(k), float(channel.time[k]), float(channel.time[k + 1])) for k in found]


def say_bridged(where: str, channel: Channel, working_dt: float, notes: list[str]) -> None:
    """Holes that are bridged although frames are missing for longer than 3 periods, with times."""
    refused = {frame for frame, _, _ in gaps(channel, working_dt)}
    bridged = [hole for hole in holes(channel, MAX_GAP * period(channel)) if hole[0] not in refused]
    if bridged:
        frame, before, after = max(bridged, key=lambda hole: hole[2] - hole[1])
        suspect(
            notes,
            f"{where}: {len(bridged)} short gap{'s' if len(bridged) > 1 else ''} bridged linearly, the longest "
            f"{(after - before) * 1e3:.3g} ms after frame {frame} (t = {before:.3f} s)",
        )


def gap_message(where: str, gap: tuple[int, float, float], count: int) -> str:
    frame, before, after = gap
    more = f", and {count - 1} more" if count > 1 else ""
    return (
        f"{where}: gap {after - before:.3g} s after frame {frame} (t = {before:.3f} s){more}; allowed: {MAX_GAP:g} periods or "
        f"{BRIDGED_S * 1e3:g} ms; make a demonstration of each piece with split_gaps"
    )


def check_unit(where: str, kind: str, channel: Channel) -> None:
    """The unit must be stated, and be one that a `kind` of signal can have."""
    allowed = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "force": ("N", "N m")}[kind]
    if any(unit not in allowed for unit in axis_units(channel.unit, len(channel.axes))):
        what = f"unit {channel.unit!r} is not SI" if channel.unit else "no unit is stored"
        raise RecordingError(f"{where}: {what}; state units, for example {kind}_unit={allowed[0]!r}")


def check_plausible(where: str, kind: str, channel: Channel, plausible: Plausible) -> None:
    """Refuses magnitudes that only a wrong unit explains; axes of one unit are judged together."""
    if kind == "position" and plausible.workspace:
        _check_workspace(where, channel.values, plausible, channel.axes)
    sizes = np.abs(channel.values - channel.values[0]) if kind == "position" else np.abs(channel.values)
    extent = np.ptp(channel.values, axis=0) if kind == "position" else sizes.max(axis=0)
    low, high = {
        "position": plausible.position_span,
        "velocity": plausible.velocity_peak,
        "force": plausible.force_peak,
    }[kind]
    kinds = kinds_of_axes(channel.unit, len(channel.axes))
    largest = {unit: max(columns, key=lambda i: extent[i]) for unit, columns in kinds.items()}
    alive = {unit: axis for unit, axis in largest.items() if extent[axis] >= DEAD}
    wrong = [axis for axis in alive.values() if extent[axis] > high]
    if alive and all(extent[axis] < low for axis in alive.values()):  # an axis of another unit may well be at rest
        wrong.append(next(iter(alive.values())))
    for axis in wrong:
        unit, frame = axis_units(channel.unit, len(channel.axes))[axis], int(sizes[:, axis].argmax())
        measure = "spans" if kind == "position" else "peaks at"
        at = "" if kind == "position" else f" (frame {frame}, t = {channel.time[frame]:.3f} s)"
        raise RecordingError(
            f"{where}: {kind}.{channel.axes[axis]} {measure} {extent[axis]:.4g} {unit}{at}; "
            f"plausible: {low:g} to {high:g} {unit}: {_guess(kind, unit, extent[axis] > high)}? state "
            f"{kind}_unit, or widen the range (plausible=...)"
        )


def _guess(kind: str, unit: str, too_large: bool) -> str:
    if not too_large:
        slow = "another unit of length or time (stamps in milliseconds)"
        return {"N": "kilonewtons or kilograms", "N m": "another unit", "m/s": slow, "rad/s": slow}.get(
            unit, "kilometres, or nothing moves"
        )
    if unit.startswith("rad"):
        return "degrees"
    return {"position": "millimetres", "velocity": "millimetres per second", "force": "millinewtons or grams"}[kind]


def _check_workspace(where: str, values: Array, plausible: Plausible, axes: Sequence[str]) -> None:
    for axis, column, (lower, upper) in zip(axes, values.T, plausible.workspace, strict=False):
        low, high = float(column.min()), float(column.max())
        slack = upper - lower  # a motion may leave the box; a wrong unit leaves it far behind
        if low < lower - slack or high > upper + slack:
            guess = "millimetres" if max(abs(low), abs(high)) > 20.0 * max(abs(lower), abs(upper)) else "another frame"
            raise RecordingError(
                f"{where}: {axis} spans {low:.4g}-{high:.4g} m; workspace is {lower:g}-{upper:g} m: {guess}? "
                "state position_unit, or correct the workspace"
            )


def check_velocity(
    where: str,
    position: Array,
    velocity: Array,
    dt: float,
    *,
    cutoff_hz: float,
    axes: Sequence[str],
    notes: list[str],
    unit: str = "m",
) -> None:
    """Is velocity (T, d) the derivative of position (T, d)? Both are smoothed alike before they are compared.

    Raises on the wrong sign, a lag of 60 ms, no correlation, or a factor that only a unit explains; warns of a factor
    beyond 1.25 (stamps at a wrong rate) and of a lag of 30 ms. An axis that rests is not held to it: there it would be noise
    against noise.
    """
    if len(position) < 8:
        return
    # Smoothed first: a difference of raw positions at an end is noise by the period, and the filter would spread it.
    slope = differentiate(smooth(position, dt, cutoff_hz), dt)
    speed = smooth(velocity, dt, cutoff_hz)
    power: list[Array] = [np.sqrt((slope**2).mean(axis=0)), np.sqrt((speed**2).mean(axis=0))]
    moved = [_moved(position, power[0], dt, cutoff_hz, slope=True), _moved(velocity, power[1], dt, cutoff_hz, slope=False)]
    groups = kinds_of_axes(unit, len(axes))
    factors: dict[str, float] = {}
    for i, axis in enumerate(axes):
        alike = next(columns for columns in groups.values() if i in columns)
        if not (moved[0][i] or moved[1][i]) or any(p[i] < 0.1 * p[alike].max() for p in power):
            continue  # this axis hardly moves: noise against noise
        correlation, best, lag = _correlation(speed[:, i], slope[:, i], dt)
        line = f"{where}: velocity.{axis} against d(position.{axis})/dt: correlation {correlation:.2f}"
        remedy = "leave the velocity out (it is derived from position) or correct it"
        if correlation < -0.5:
            raise RecordingError(f"{line} at lag 0: its sign is flipped; map it with a leading '-', or {remedy}")
        if best < 0.5:
            raise RecordingError(f"{line}, at best {best:.2f}: it is not that derivative; {remedy}")
        # The lag counts only where shifting explains at least half of what is left unexplained.
        if abs(lag) >= max(LAG_WARNED, 2.0 * dt) and 1.0 - best**2 < 0.5 * (1.0 - correlation**2):
            late = f"{line}, {best:.2f} when shifted by {lag * 1e3:.0f} ms: velocity is {'late' if lag > 0 else 'early'}"
            if abs(lag) >= LAG_REFUSED:
                raise RecordingError(f"{late}; {remedy}")
            suspect(notes, late)
        factors[axis] = float(speed[:, i] @ slope[:, i] / (speed[:, i] @ speed[:, i]))
    _check_factors(where, factors, 1.0 / dt, notes)


def _moved(values: Array, power: Array, dt: float, cutoff_hz: float, *, slope: bool) -> np.ndarray:
    """(d,) which axes move by more than their noise explains; `power` is the RMS of the smoothed velocity."""
    noise = white_noise(values) * noise_gain(len(values), dt, cutoff_hz, slope=slope)
    if slope:
        return (power > 4.0 * noise) & (np.ptp(smooth(values, dt, cutoff_hz), axis=0) > MOVED) & (power >= 1e-5)
    return (power > 4.0 * noise) & (power > MOVED_SPEED)


def white_noise(values: Array) -> Array:
    """(d,) standard deviation of the white part of (T, d): second differences, of which motion has next to none."""
    if len(values) < 5:
        return np.zeros(values.shape[1])
    return np.asarray(np.median(np.abs(np.diff(values, 2, axis=0)), axis=0) / (0.6745 * math.sqrt(6.0)))


def noise_gain(frames: int, dt: float, cutoff_hz: float, *, slope: bool) -> float:
    """RMS of unit white noise behind the zero-phase low-pass, and behind d/dt after it when `slope`."""
    impulse = np.zeros(min(frames, max(64, math.ceil(8.0 / (cutoff_hz * dt)))))
    impulse[len(impulse) // 2] = 1.0
    answer = smooth(impulse, dt, cutoff_hz)
    return float(np.sqrt(((differentiate(answer, dt) if slope else answer) ** 2).sum()))


def _correlation(a: Array, b: Array, dt: float) -> tuple[float, float, float]:
    """(correlation at lag 0, best correlation within 0.3 s, that lag [s], positive when `a` comes later)."""
    n, reach = len(a), max(1, min(int(0.3 / dt), len(a) // 4))
    lags = np.arange(-reach, reach + 1)
    size = 1 << (n + reach).bit_length()  # all lags at once: by hand they take a second of a minute at 1 kHz
    products = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)[lags]
    powers_a, powers_b = (np.concatenate([[0.0], np.cumsum(x * x)]) for x in (a, b))
    later, earlier = np.maximum(lags, 0), np.maximum(-lags, 0)  # a[k:] meets b[:n - k], and the other way round
    power_a, power_b = powers_a[n - earlier] - powers_a[later], powers_b[n - later] - powers_b[earlier]
    values = products / np.maximum(np.sqrt(np.maximum(power_a * power_b, 0.0)), 1e-300)
    best = int(values.argmax())
    return float(values[reach]), float(values[best]), float(lags[best] * dt)


def _check_factors(where: str, factors: dict[str, float], rate_hz: float, notes: list[str]) -> None:
    wrong = {axis: f for axis, f in factors.items() if not 1.0 / WRONG_FACTOR < f < WRONG_FACTOR}
    if not wrong:
        return
    text = ", ".join(f"{axis} {f:.3g}x" for axis, f in wrong.items())
    if any(not 0.02 < f < 50.0 for f in wrong.values()):
        raise RecordingError(
            f"{where}: d(position)/dt is {text} the velocity: units, of length or of time (stamps in milliseconds, a frame "
            "counter)? state position_unit, velocity_unit or time_unit"
        )
    suspect(
        notes,
        f"{where}: velocity channel disagrees with d(position)/dt by {text}: "
        f"is the rate {rate_hz:.4g} Hz right ({rate_hz / float(np.median(list(wrong.values()))):.4g} Hz would agree)?",
    )
