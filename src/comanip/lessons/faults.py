"""What can be wrong with a recording, each fault named in one line before anything is learned from it.

A check raises what cannot be used, warns of what is suspicious, and appends to `notes` whatever it changes.
`where` names file and channel in every message.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import ComanipWarning, RecordingError
from ..interfaces import Array
from ..recording import Channel
from ..signals.filters import differentiate, smooth

MAX_GAP = 3.0  # periods without a sample
MAX_RATE_RATIO = 10.0
WRONG_FACTOR = 1.25  # velocity against d(position)/dt
LAG_WARNED, LAG_REFUSED = 0.03, 0.06  # [s]
BIAS_WARNED = 1.5  # [N] a hand-held sensor that was tared reads less
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
    warnings.warn(message, ComanipWarning, stacklevel=4)


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
    """The usual time between samples [s]: the median, which gaps and jitter do not move."""
    return float(np.median(np.diff(channel.time)))


def check_period(where: str, dt: float) -> None:
    if not 2e-5 <= dt <= 1.0:
        guess = "milliseconds or microseconds" if dt > 1.0 else "stamps in another unit"
        raise RecordingError(f"{where}: {dt:g} s between samples: {guess}? allowed: 0.00002-1 s; state time_unit")


def gaps(channel: Channel) -> list[tuple[int, float, float]]:
    """(frame before, stamp before, stamp after) of every hole longer than three periods."""
    step = np.diff(channel.time)
    found = np.flatnonzero(step > MAX_GAP * period(channel) * (1.0 + 1e-6))
    return [(int(k), float(channel.time[k]), float(channel.time[k + 1])) for k in found]


def gap_message(where: str, gap: tuple[int, float, float], count: int) -> str:
    frame, before, after = gap
    more = f", and {count - 1} more" if count > 1 else ""
    return (
        f"{where}: gap {after - before:.3g} s after frame {frame} (t = {before:.3f} s){more}; allowed: {MAX_GAP:g} "
        "periods; make a demonstration of each piece with split_gaps"
    )


def check_unit(where: str, kind: str, channel: Channel) -> None:
    """The unit must be stated, and be one that a `kind` of signal can have."""
    allowed = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "force": ("N", "N m")}[kind]
    if channel.unit not in allowed:
        what = f"unit {channel.unit!r} is not SI" if channel.unit else "no unit is stored"
        raise RecordingError(f"{where}: {what}; state units, for example {kind}_unit={allowed[0]!r}")


def check_plausible(where: str, kind: str, values: Array, unit: str, plausible: Plausible, axes: Sequence[str]) -> None:
    """Refuses magnitudes that only a wrong unit explains; (T, d) `values` of one kind."""
    if kind == "position" and plausible.workspace:
        _check_workspace(where, values, plausible, axes)
    extent = np.ptp(values, axis=0) if kind == "position" else np.abs(values).max(axis=0)
    size = float(extent.max())
    low, high = {
        "position": plausible.position_span,
        "velocity": plausible.velocity_peak,
        "force": plausible.force_peak,
    }[kind]
    if low <= size <= high or size < DEAD:
        return
    axis = int(extent.argmax())
    measure = "spans" if kind == "position" else "peaks at"
    raise RecordingError(
        f"{where}: {kind}.{axes[axis]} {measure} {size:.4g} {unit}; plausible: {low:g} to {high:g} {unit}: "
        f"{_guess(kind, unit, size > high)}? state {kind}_unit, or widen the range (plausible=...)"
    )


def _guess(kind: str, unit: str, too_large: bool) -> str:
    if not too_large:
        return {"N": "kilonewtons or kilograms", "N m": "another unit"}.get(unit, "kilometres, or nothing moves")
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
    where: str, position: Array, velocity: Array, dt: float, *, cutoff_hz: float, axes: Sequence[str], notes: list[str]
) -> None:
    """Is velocity (T, d) the derivative of position (T, d)? Both are smoothed alike before they are compared.

    Raises on the wrong sign, a lag of 60 ms, no correlation, or a factor that only a unit explains; warns of a factor
    beyond 1.25 (stamps at a wrong rate) and of a lag of 30 ms.
    """
    if len(position) < 8:
        return
    slope = smooth(differentiate(position, dt), dt, cutoff_hz)
    speed = smooth(velocity, dt, cutoff_hz)
    power: list[Array] = [np.sqrt((slope**2).mean(axis=0)), np.sqrt((speed**2).mean(axis=0))]
    factors: dict[str, float] = {}
    for i, axis in enumerate(axes):
        if min(float(p[i]) / max(float(p.max()), DEAD) for p in power) < 0.1 or power[0][i] < 1e-3:
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


def _correlation(a: Array, b: Array, dt: float) -> tuple[float, float, float]:
    """(correlation at lag 0, best correlation within 0.3 s, that lag [s], positive when `a` comes later)."""
    reach = max(1, min(int(0.3 / dt), len(a) // 4))

    def at(k: int) -> float:
        x, y = (a[k:], b[: len(b) - k]) if k >= 0 else (a[:k], b[-k:])
        return float(x @ y) / max(float(np.sqrt((x @ x) * (y @ y))), 1e-300)

    values = {k: at(k) for k in range(-reach, reach + 1)}
    best = max(values, key=lambda k: values[k])
    return values[0], values[best], best * dt


def _check_factors(where: str, factors: dict[str, float], rate_hz: float, notes: list[str]) -> None:
    wrong = {axis: f for axis, f in factors.items() if not 1.0 / WRONG_FACTOR < f < WRONG_FACTOR}
    if not wrong:
        return
    text = ", ".join(f"{axis} {f:.3g}x" for axis, f in wrong.items())
    if any(not 0.02 < f < 50.0 for f in wrong.values()):
        raise RecordingError(f"{where}: d(position)/dt is {text} the velocity: units? state position_unit, velocity_unit")
    suspect(
        notes,
        f"{where}: velocity channel disagrees with d(position)/dt by {text}: "
        f"is the rate {rate_hz:.4g} Hz right ({rate_hz / float(np.median(list(wrong.values()))):.4g} Hz would agree)?",
    )


def rest_frames(velocity: Array, dt: float) -> tuple[int, int]:
    """(frames of rest at the start, at the end) of (T, d): speed below 3 % of its peak, or below 2 mm/s."""
    speed = np.abs(velocity).max(axis=1)
    moving = np.flatnonzero(speed > max(0.03 * float(speed.max()), 2e-3))
    if not len(moving):
        return len(speed), 0
    return int(moving[0]), int(len(speed) - 1 - moving[-1])


def check_force(where: str, force: Array, velocity: Array, dt: float, role: str, notes: list[str]) -> None:
    """Warns of a bias at rest and of a sign that does not fit the role; (T, d) each."""
    start, _ = rest_frames(velocity, dt)
    # The partner pulls some tenths of a second before anything moves: that is no bias.
    window = force[: max(start - round(0.3 / dt), start // 2)]
    bias = np.zeros(force.shape[1])
    if len(window) * dt >= 0.1 and len(window) >= 5:
        bias = window.mean(axis=0)
        if np.abs(bias).max() > BIAS_WARNED:
            listed = ", ".join(f"{b:.2f}" for b in bias)
            suspect(notes, f"{where}: force at rest is {listed} N: a bias, a wrong sign or the object's weight? tare it")
    moved, pushed = velocity.ravel(), (force - bias).ravel()
    if role == "natural":  # each may be ahead of the other: neither sign is wrong
        return
    norm = float(np.sqrt((moved @ moved) * (pushed @ pushed)))
    along = float(moved @ pushed) / norm if norm > 0.0 else 0.0
    if along < (-0.5 if role != "follower" else -0.3) and role != "leader":
        suspect(
            notes,
            f"{where}: the partner pushes against the motion (correlation {along:.2f}), as when the hand leads; "
            f"role is {role or 'not stated'}: is the force's sign flipped?",
        )
    elif along > 0.7 and role == "leader":
        suspect(
            notes,
            f"{where}: the partner pushes along the motion (correlation {along:.2f}), as when the hand follows; "
            "role is leader: is the force's sign flipped?",
        )
