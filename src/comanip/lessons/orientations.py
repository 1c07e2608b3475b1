"""Orientations of a recording, made fit to learn from: of length 1, of one sign, without jumps, and with their angular velocity.

Everywhere a quaternion is (w, x, y, z) and turns hand axes into task axes; angular velocity and torque are in the task frame, the
torque about the hand's origin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from ..signals import sphere
from ..signals.filters import smooth

QUATERNION, VECTOR = ("w", "x", "y", "z"), ("x", "y", "z")
LENGTH = 0.01  # off 1: float32, four digits of a text file; more is no quaternion
EXACT = 1e-6  # and below this nothing is worth a note
FASTEST = 15.0  # [rad/s] no hand that carries something turns faster
AT_ONCE = 0.5  # [rad] between two frames at that speed: a jump


def is_quaternion(channel: Channel) -> bool:
    """Whether the columns are called w, x, y, z, in any order."""
    return set(channel.axes) == set(QUATERNION) and len(channel.axes) == 4


def turning(recording: Recording, where: str) -> dict[str, Channel]:
    """hand.orientation, and hand.torque where there is one, under the names of signals; ChannelError where they are none."""
    if "hand.orientation" not in recording:
        raise ChannelError(f"{where}: no 'hand.orientation'; found {', '.join(recording.channels) or 'nothing'}")
    found = {"orientation": recording["hand.orientation"]}
    if not is_quaternion(found["orientation"]):
        raise ChannelError(f"{where}: orientation has columns {', '.join(found['orientation'].axes)}; allowed: w, x, y, z")
    if "hand.torque" not in recording:
        return found
    torque = recording["hand.torque"]
    if torque.axes != VECTOR or torque.unit != "N m":
        raise ChannelError(
            f"{where}: torque has columns {', '.join(torque.axes)} in {torque.unit or 'no unit'}; allowed: x, y, z in N m"
        )
    frames = {n: c.frame for n, c in {**found, "torque": torque}.items() if c.frame}
    if len(set(frames.values())) > 1:
        listed = "; ".join(f"{n}: {f}" for n, f in frames.items())
        raise ChannelError(f"{where}: the signals are in different frames ({listed}); turn the torque where the file is read")
    return {**found, "torque": torque}


def oriented(where: str, channel: Channel, notes: list[str]) -> Channel:
    """The quaternions in the order w, x, y, z, of length 1 and of continuous sign; RecordingError with the first bad frame."""
    if not is_quaternion(channel):
        raise ChannelError(f"{where}: columns are {', '.join(channel.axes)}; an orientation has {', '.join(QUATERNION)}")
    q = np.asarray(channel.values[:, [channel.axes.index(c) for c in QUATERNION]])
    size = np.sqrt((q * q).sum(axis=1))
    _check_length(where, channel.time, size)
    if np.abs(size - 1.0).max() > EXACT:
        notes.append(f"{where}: normalised; lengths were {size.min():.6g} to {size.max():.6g}")
    q = unit(q)
    same = sphere.continuous(q)
    if flips := int(((same * q).sum(axis=1) < 0.0).sum()):
        notes.append(f"{where}: the sign of {flips} quaternions turned, so that none jumps (q and -q are one orientation)")
    _check_jumps(where, channel.time, same)
    return replace(channel, values=same, axes=QUATERNION, unit="")


def _check_length(where: str, time: Array, size: Array) -> None:
    bad = np.flatnonzero(~(np.abs(size - 1.0) <= LENGTH))
    if len(bad):
        k = int(bad[0])
        why = "an empty quaternion? cut it out" if size[k] < LENGTH else "angles, or one column twice? map w, x, y, z"
        raise RecordingError(
            f"{where}: frame {k} (t = {time[k]:.6f} s) has length {size[k]:.6g}, and {len(bad) - 1} more are not unit "
            f"quaternions; allowed: 1 within {LENGTH:g}: {why}"
        )


def _check_jumps(where: str, time: Array, q: Array) -> None:
    if len(q) < 2:
        return
    step = sphere.distance(q[:-1], q[1:])
    jumps = np.flatnonzero((step > AT_ONCE) & (step > FASTEST * np.diff(time)))
    if len(jumps):
        k = int(jumps[0]) + 1
        raise RecordingError(
            f"{where} turns by {step[k - 1]:.3g} rad at frame {k} (t = {time[k]:.3f} s); plausible is up to {FASTEST:g} rad/s: "
            "a dropped frame, or columns in another order (x, y, z, w)? cut it, or map w, x, y, z"
        )


def unit(q: Array) -> Array:
    """Of length 1 again, (T, 4); what is that to the last digits keeps its bits."""
    size = np.sqrt((q * q).sum(axis=1, keepdims=True))
    return np.where(np.abs(size - 1.0) < 1e-14, q, q / size)


def angular_velocity(q: Array, dt: float, cutoff_hz: float) -> Array:
    """(T, 3) [rad/s] in the task frame, of quaternions (T, 4): zero-phase low-pass, then turns between neighbours.

    A step is the rotation vector between two frames, so a constant turn gives its speed exactly; central, and of second order at
    both ends.
    """
    smoothed = sphere.normalised(smooth(sphere.continuous(q), dt, cutoff_hz))
    steps = sphere.rotation_vector(sphere.product(smoothed[1:], sphere.inverse(smoothed[:-1]))) / dt
    inside = 0.5 * (steps[1:] + steps[:-1])
    first, last = 1.5 * steps[:1] - 0.5 * steps[1:2], 1.5 * steps[-1:] - 0.5 * steps[-2:-1]
    return np.concatenate([first, inside, last])
