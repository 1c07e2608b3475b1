"""What can be wrong with the force of a lesson: a bias, a sign, a sensor that repeats itself; and what rest is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError, RecordingError, given
from ..interfaces import Array
from ..recording import Channel, Recording, axis_units
from .faults import kinds_of_axes, period, suspect, white_noise

BIAS_WARNED = {"N": 1.5, "N m": 0.3}  # a hand-held sensor that was tared reads less
FROZEN_S = 0.2  # the envelope stops a robot for a force that stays exactly still for so long
CLIPPED_S = 0.05
COARSE = {"N": 0.05, "N m": 0.005}  # steps of a signal below this are rounding, above it a coarse sensor
REST_S = 0.15  # speed is judged by its mean over this time: hands move more slowly than most of a velocity's noise


def rest_frames(velocity: Array, dt: float, unit: str = "m/s") -> tuple[int, int]:
    """(frames of rest at the start, at the end) of (T, d): the speed of all axes of one unit below 3 % of its peak, below
    2 mm/s, or below four times what its noise leaves of a mean over 0.15 s."""
    moving = np.flatnonzero(_moving(velocity, dt, unit))
    if not len(moving):
        return len(velocity), 0
    return int(moving[0]), int(len(velocity) - 1 - moving[-1])


def _moving(velocity: Array, dt: float, unit: str) -> np.ndarray:
    """(T,) whether the axes of any unit move."""
    width = max(1, min(round(REST_S / dt), len(velocity)))
    box, count = np.ones(width), np.convolve(np.ones(len(velocity)), np.ones(width), "same")
    slow = np.stack([np.convolve(column, box, "same") / count for column in velocity.T], axis=1)
    noise = white_noise(velocity) / np.sqrt(0.5 * width)  # at the ends half of the window is missing
    moving = np.zeros(len(velocity), dtype=bool)
    for columns in kinds_of_axes(unit, velocity.shape[1]).values():
        speed = np.linalg.norm(slow[:, columns], axis=1)
        moving |= speed > max(0.03 * float(speed.max()), 2e-3, 4.0 * float(np.linalg.norm(noise[columns])))
    return moving


def at_rest(force: Array, velocity: Array, dt: float, unit: str) -> Array:
    """The window of `force` (T, d) before the motion. The partner pulls some tenths of a second before anything moves: that
    is no rest. Empty when it is shorter than 0.1 s."""
    start, _ = rest_frames(velocity, dt, unit)
    window = force[: max(start - round(0.3 / dt), start // 2)]
    return window if len(window) * dt >= 0.1 and len(window) >= 5 else force[:0]


class Bias(NamedTuple):
    """What is taken off a force (d,), the same for all pieces of a recording; None: nothing. `how` goes into the notes."""

    force: Array | None
    how: str = ""

    def taken_off(self, force: Array, notes: list[str]) -> Array:
        if self.force is None:
            return force
        notes.append(self.how)
        return force - self.force


def stated_bias(given_n: Any, tare: bool) -> tuple[float, ...]:
    """A bias as it was given, one number or one an axis; ParameterError."""
    if tare:
        raise ParameterError("tare and force_bias_n are both given; allowed: one of them")
    try:
        values = np.atleast_1d(np.asarray(given_n, dtype=np.float64))
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ParameterError(f"force_bias_n is {given(given_n)}; allowed: one finite number an axis [N]")
    return tuple(values.tolist())


def known_bias(where: str, bias_n: tuple[float, ...] | None, n_axes: int) -> Bias:
    if bias_n is None:
        return Bias(None)
    if len(bias_n) != n_axes:
        raise ParameterError(f"{where}: force_bias_n has {len(bias_n)} numbers; allowed: one an axis, {n_axes}")
    return Bias(np.array(bias_n), f"force: bias {_listed(bias_n)} subtracted, as stated")


def tared(where: str, force: Array, velocity: Array, dt: float, unit: str) -> Bias:
    """The mean force at rest before the motion; RecordingError where the lesson does not begin at rest."""
    window = at_rest(force, velocity, dt, unit)
    if not len(window):
        raise RecordingError(
            f"{where}: nothing to tare by: no rest of 0.1 s before the motion and the 0.3 s in which the partner may pull "
            "already; state force_bias_n"
        )
    bias = window.mean(axis=0)
    return Bias(bias, f"force: tared, as asked: {_listed(bias)}, the mean of {len(window) * dt:.2f} s of rest, subtracted")


def _listed(force: Iterable[float]) -> str:
    return ", ".join(f"{f:.3g}" for f in force) + " N"


def check_force(
    where: str, force: Array, velocity: Array, dt: float, role: str, notes: list[str], units: Sequence[str] = ("N", "m/s")
) -> None:
    """Warns of a bias at rest and of a sign that does not fit the role; (T, d) each, `units` of force and velocity."""
    window = at_rest(force, velocity, dt, units[1])
    bias = window.mean(axis=0) if len(window) else np.zeros(force.shape[1])
    for unit, columns in kinds_of_axes(units[0], force.shape[1]).items():
        if float(np.linalg.norm(bias[columns])) > BIAS_WARNED.get(unit, 1.5):
            listed = ", ".join(f"{b:.2f}" for b in bias[columns])
            suspect(
                notes,
                f"{where}: force at rest is {listed} {unit}: a bias, a wrong sign or the object's weight? take it "
                "off (tare, or force_bias_n)",
            )
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


class Still(NamedTuple):
    """A stretch in which no axis of the force changes by a bit: frames [first, last]."""

    first: int
    last: int


def check_sensor(where: str, force: Channel, position: Channel, notes: list[str]) -> None:
    """Warns, with times, of a force that is exactly frozen, dead or saturated for part of a recording, and of a coarse one.

    The channels are as they were recorded: after resampling nothing repeats itself any more.
    """
    values = force.values
    if len(values) < 8 or not np.ptp(values, axis=0).any():  # constant throughout: another fault
        return
    frozen = [still for still in _stills(values) if force.time[still.last] - force.time[still.first] >= FROZEN_S]
    moving = moving_at(force.time, position)
    noisy = _noisy_at_rest(values, moving, force.time, frozen)
    told = [s for s in frozen if moving[s.first : s.last + 1].mean() > 0.2 or (noisy and not moving[s.first : s.last + 1].all())]
    if told:
        longest = max(told, key=lambda s: force.time[s.last] - force.time[s.first])
        when, why = f"{_word(values, longest)} {_times(force.time, told)}", _why(values, longest)
        suspect(notes, f"{where}: {when}: {why}? cut it out")
    for axis, unit, column in zip(force.axes, axis_units(force.unit, len(force.axes)), values.T, strict=True):
        _check_clipped(f"{where}.{axis}", force.time, column, unit, told, notes)
        step = _quantum(column)
        if step > 0.999 * COARSE.get(unit, 0.05):
            notes.append(f"{where}.{axis}: measured in steps of {step:.3g} {unit}")


def _stills(values: Array) -> list[Still]:
    """Every stretch of at least three frames that are equal to the last bit."""
    same = np.concatenate([[False], (np.diff(values, axis=0) == 0.0).all(axis=1), [False]])
    edges = np.flatnonzero(np.diff(same.astype(np.int8)))
    return [Still(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= 2]


def moving_at(time: Array, position: Channel) -> np.ndarray:
    """(T,) whether the hand moves at stamps of another channel, from its position alone."""
    if len(position.time) < 8:
        return np.ones(len(time), dtype=bool)
    dt = period(position)
    velocity = np.gradient(position.values, dt, axis=0)  # not by the stamps, of which two may nearly coincide
    at = np.clip(np.searchsorted(position.time, time), 0, len(velocity) - 1)
    return np.asarray(_moving(velocity, dt, position.unit)[at])


def _noisy_at_rest(values: Array, moving: np.ndarray, time: Array, frozen: Sequence[Still]) -> bool:
    """Whether the sensor has noise: at rest, outside what is frozen, most frames differ from the one before."""
    resting = ~moving[1:]
    for still in frozen:
        resting[still.first : still.last] = False
    changed = (np.diff(values, axis=0) != 0.0).any(axis=1)[resting]
    return bool(len(changed) * float(np.median(np.diff(time))) >= FROZEN_S and changed.mean() > 0.5)


def _word(values: Array, still: Still) -> str:
    return "reads exactly 0" if not values[still.first].any() else "stays exactly still"


def _why(values: Array, still: Still) -> str:
    stuck = values[still.first]
    ends = ((stuck == values.max(axis=0)) | (stuck == values.min(axis=0))) & (stuck != 0.0)
    return (
        f"the end of the sensor's range ({stuck[ends][0]:g}, saturated)" if ends.any() else "a dead sensor or a lost connection"
    )


def _times(time: Array, stretches: Sequence[Still]) -> str:
    listed = ", ".join(f"t = {time[s.first]:.3f}-{time[s.last]:.3f} s" for s in stretches[:3])
    return listed + (f" and {len(stretches) - 3} times more" if len(stretches) > 3 else "")


def _check_clipped(where: str, time: Array, column: Array, unit: str, frozen: Sequence[Still], notes: list[str]) -> None:
    """A noisy force that stops at one value, its highest or lowest, is at the end of the sensor's range."""
    if _quantum(column) > 0.999 * COARSE.get(unit, 0.05):
        return  # in coarse steps any peak is a plateau
    for value in (float(column.max()), float(column.min())):
        stills = [s for s in _stills(column[:, None]) if column[s.first] == value and value != 0.0]
        stills = [s for s in stills if not any(f.first <= s.first and s.last <= f.last for f in frozen)]
        if sum(time[s.last] - time[s.first] for s in stills) >= CLIPPED_S:
            when = _times(time, stills)
            suspect(notes, f"{where}: stays at {value:g} {unit} {when}: the end of the sensor's range (saturated)?")


def _quantum(column: Array) -> float:
    """The step in which a signal is measured, 0 when it has none: all values are multiples of the smallest difference."""
    values = np.unique(column)
    if not 3 <= len(values) <= max(64, len(column) // 2):
        return 0.0
    step = float(np.diff(values).min())
    multiples = (values - values[0]) / step
    return step if np.abs(multiples - np.rint(multiples)).max() < 1e-3 * max(1.0, multiples[-1] * 1e-3) else 0.0


def stated_gravity(recording: Recording, where: str) -> tuple[float, ...]:
    """Of metadata gravity_m_per_s2. Raises RecordingError for what is not (d,) numbers."""
    stated = recording.metadata["gravity_m_per_s2"]
    try:
        gravity = tuple(float(g) for g in stated)
    except (TypeError, ValueError):
        gravity = (math.nan,)
    if not all(map(math.isfinite, gravity)):
        raise RecordingError(f"{where}: metadata gravity_m_per_s2 must be finite numbers; got {stated!r}")
    return gravity
