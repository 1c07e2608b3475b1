"""Positions that no hand goes through: angles that wrap, dropped frames, logical columns."""

from __future__ import annotations

import math

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from ..recording import Channel, axis_units
from .faults import Plausible, period

OVER_S = 0.02  # a position that is held between samples goes in steps: speed is judged over this time
JUMP, JUMP_SPEED, JUMP_RATIO = 0.02, 1.0, 10.0  # [m, rad], [m/s, rad/s], against the speed of its neighbours


def check_jumps(where: str, position: Channel, plausible: Plausible) -> None:
    """Refuses a position that changes faster than a hand can, whether or not there is a velocity to hold it against."""
    if len(position.time) < 8:
        return
    for axis, unit, column in zip(position.axes, axis_units(position.unit, len(position.axes)), position.values.T, strict=True):
        values = np.unique(column)
        if len(values) in (2, 3) and float(np.diff(values).min()) > JUMP:
            listed = ", ".join(f"{v:g}" for v in values)
            raise RecordingError(f"{where}.{axis} takes only the values {listed} {unit}: a logical column? map the position")
        frame = _too_fast(position, column, plausible.velocity_peak[1])
        frame = _out_of_line(position, column) if frame is None else frame
        if frame is not None:
            raise RecordingError(_message(f"{where}.{axis}", position.time, column, frame, unit, plausible))


def _too_fast(position: Channel, column: Array, most: float) -> int | None:
    """The frame after the steepest step, where a distance over 20 ms says a speed above `most`."""
    dt = period(position)
    w = min(max(1, round(OVER_S / dt)), len(column) - 1)
    over = np.maximum(position.time[w:] - position.time[:-w], w * dt)  # stamps that jitter may nearly coincide
    speed = np.abs(column[w:] - column[:-w]) / over
    k = int(speed.argmax())
    if speed[k] <= most:
        return None
    first = max(0, k - w)
    step = np.abs(np.diff(column[first : k + w + 1]))
    return first + 1 + int(np.flatnonzero(step >= 0.5 * step.max())[0])  # a dropped frame is a step there and one back


def _out_of_line(position: Channel, column: Array) -> int | None:
    """The first frame reached ten times faster than those around it; a held value counts as one frame."""
    at = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    if len(at) < 12:
        return None
    step = np.abs(np.diff(column[at]))
    speed = step / np.maximum(np.diff(position.time[at]), period(position))
    around = np.zeros_like(speed)
    for shift in (-5, -4, -3, -2, 2, 3, 4, 5):  # not the next one: a dropped frame comes back at once
        moved = np.roll(speed, shift)
        if shift < 0:
            moved[shift:] = 0.0
        else:
            moved[:shift] = 0.0
        around = np.maximum(around, moved)
    found = np.flatnonzero((step > JUMP) & (speed > JUMP_SPEED) & (speed > JUMP_RATIO * around))
    return int(at[found[0] + 1]) if len(found) else None


def _message(where: str, time: Array, column: Array, frame: int, unit: str, plausible: Plausible) -> str:
    before, after = float(column[frame - 1]), float(column[frame])
    speed = abs(after - before) / float(time[frame] - time[frame - 1])
    turns = (after - before) / (2.0 * math.pi)
    if unit == "rad" and abs(turns) > 0.5 and abs(turns - round(turns)) < 0.1:
        why = "an angle that wraps? unwrap it (numpy.unwrap)"
    elif after == 0.0 or before == 0.0:
        why = "a dropped frame? cut it, or leave it empty and read with drop_bad"
    else:
        why = "a dropped frame, or another unit? cut it, or state position_unit or time_unit"
    return (
        f"{where} jumps from {before:.4g} to {after:.4g} {unit} at frame {frame} (t = {time[frame]:.3f} s): {speed:.3g} "
        f"{unit}/s, plausible is steady motion up to {plausible.velocity_peak[1]:g} {unit}/s: {why}"
    )
