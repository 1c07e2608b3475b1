"""Demonstrations made ready for learning: checked, and brought to coordinates without units.

Learning happens in z = (x − mean) / spread over all demonstrations together, with one spread a channel group: position, velocity,
force. Then a change of unit, of world frame or of how axes are turned changes nothing but the last digits, and one relative floor
serves metres and newtons alike.
"""

from __future__ import annotations

import sys
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .. import kernels
from ..errors import ChannelError, ComanipWarning, ParameterError, TrainingError
from ..interfaces import Array
from ..models.gaussian import channel_names
from ..recording import expand

COLLINEAR = 1e6  # condition number of the channels' correlation above which one channel repeats others
BEYOND_ANY_SENSOR = 1e100
FEW = 10  # frames that may be outliers together; more than that is a signal


class Notes(list[str]):
    """What was suspicious or changed: each is warned of once and kept for the Fit."""

    def say(self, text: str) -> None:
        self.append(text)
        level, frame = 2, sys._getframe(1)
        while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("comanip."):
            level, frame = level + 1, frame.f_back  # so that the warning shows the caller's line, not ours
        warnings.warn(text, ComanipWarning, stacklevel=level)


class Coordinates(ABC):
    """What has a way between the channels' units and z: x = offset + scale·z."""

    offset: Array
    scale: Array
    channels: tuple[str, ...]
    notes: Notes

    @property
    @abstractmethod
    def n_frames(self) -> int: ...

    @property
    def log_volume(self) -> float:
        """Σ log scale over all frames: subtract it from a log-likelihood in z to have the one in x."""
        return float(self.n_frames * np.log(self.scale).sum())

    def standardised(self, means: Array, covariances: Array) -> tuple[Array, Array]:
        return (means - self.offset) / self.scale, covariances / np.outer(self.scale, self.scale)

    def original(self, means: Array, covariances: Array) -> tuple[Array, Array]:
        return self.offset + self.scale * means, covariances * np.outer(self.scale, self.scale)


@dataclass(frozen=True, eq=False)
class Lessons(Coordinates):
    """z (N, D) standardised frames of S demonstrations stacked, lengths (S,); the way back is x = offset + scale·z."""

    z: Array
    lengths: np.ndarray
    offset: Array
    scale: Array
    channels: tuple[str, ...]
    notes: Notes = field(default_factory=Notes)

    @property
    def n_frames(self) -> int:
        return len(self.z)

    @cached_property
    def groups(self) -> kernels.Seating:
        """Which lessons the compiled E-step takes side by side."""
        return kernels.planned(self.lengths)

    @cached_property
    def narrow_groups(self) -> kernels.Seating:
        """The same for float32."""
        return kernels.planned(self.lengths, single=True)

    def normalised_time(self) -> Array:
        """(N,) in [0, 1): how far through its own demonstration each frame is."""
        return np.concatenate([(np.arange(n) + 0.5) / n for n in self.lengths])

    def first_frames(self) -> np.ndarray:
        return np.concatenate([[0], np.cumsum(self.lengths)[:-1]])


def prepare(
    sequences: Iterable[Any],
    channels: Iterable[str],
    *,
    n_states: int,
    least_frames: int,
    covariance_floor: float,
    allow_constant: float | Mapping[str, float] | None,
    outlier_ratio: float,
) -> Lessons:
    """Checks the demonstrations and standardises them; raises TrainingError with sequence, frame, channel and value."""
    names = channel_names(channels)
    if int(n_states) != n_states or n_states < 1:
        raise ParameterError(f"n_states must be a whole number of at least 1; got {n_states!r}")
    if not 0.0 < covariance_floor < 1.0:
        raise ParameterError(f"covariance_floor is a ratio of variances between 0 and 1; got {covariance_floor!r}")
    arrays = [checked(x, s, names) for s, x in enumerate(sequences)]
    notes = Notes()
    arrays = _long_enough(arrays, n_states, least_frames, notes)
    x = np.concatenate(arrays)
    lengths = np.array([len(a) for a in arrays])
    _refuse_outliers(x, lengths, names, outlier_ratio)
    offset = x.mean(axis=0)
    scale = _spread(x, offset, names, len(arrays), covariance_floor, allow_constant, notes)
    z = np.ascontiguousarray((x - offset) / scale)
    _look_for_repeats(arrays, scale, notes)
    _look_for_collinearity(z, names, notes)
    return Lessons(z, lengths, offset, scale, names, notes)


def checked(values: Any, sequence: int, names: tuple[str, ...]) -> Array:
    try:
        x = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise TrainingError(f"demonstration {sequence} is not an array of numbers (T, {len(names)})") from None
    if x.ndim != 2 or x.shape[1] != len(names):
        hint = "; put a single demonstration into a list" if x.ndim == 1 else ""
        raise ChannelError(f"demonstration {sequence} has shape {x.shape}; channels {names} want (T, {len(names)}){hint}")
    with np.errstate(invalid="ignore"):
        fine = np.abs(x) < BEYOND_ANY_SENSOR
    if not fine.all():
        bad = np.argwhere(~fine)
        frame, column = bad[0]
        raise TrainingError(
            f"demonstration {sequence}, frame {frame}: {names[column]} is {x[frame, column]:g}"
            f" ({len(bad)} such values in this demonstration); cut these frames or leave the demonstration out"
        )
    return x


def _long_enough(arrays: list[Array], n_states: int, least: int, notes: Notes) -> list[Array]:
    if not arrays:
        raise TrainingError("no demonstration was given; one is the least, five are a good start")
    longest = max(len(a) for a in arrays)
    if longest < least:
        raise TrainingError(
            f"{n_states} states need >= {least} frames in a demonstration; you gave {longest} at most: "
            "record longer, resample faster or ask for fewer states"
        )
    short = [s for s, a in enumerate(arrays) if len(a) < least]
    if short:
        which = ", ".join(f"{s} ({len(arrays[s])} frames)" for s in short)
        notes.say(f"skipped demonstrations too short for {n_states} states (>= {least} frames): {which}")
    kept = [a for a in arrays if len(a) >= least]
    if len(kept) == 1:
        notes.say("only one demonstration: its own noise is all the variability there is to learn")
    return kept


def _refuse_outliers(x: Array, lengths: np.ndarray, names: tuple[str, ...], ratio: float) -> None:
    """A handful of frames a thousand times farther from the median than all others is a broken sensor, not a lesson."""
    distance = np.abs(x - np.median(x, axis=0))
    few = min(FEW, len(x) // 3)
    reference = np.partition(distance, len(x) - 1 - few, axis=0)[len(x) - 1 - few]
    with np.errstate(over="ignore"):
        bad = np.argwhere((distance > ratio * reference) & (reference > 0.0))
    if len(bad):
        row, column = bad[0]
        sequence = int(np.searchsorted(np.cumsum(lengths), row, side="right"))
        frame = row - int(lengths[:sequence].sum())
        raise TrainingError(
            f"demonstration {sequence}, frame {frame}: {names[column]} is {x[row, column]:g}, more than {ratio:g} "
            f"times farther out than the rest (within {reference[column]:.3g} of the median); cut the frame, "
            "or raise outlier_ratio"
        )


def pooled(scale: Array, names: tuple[str, ...], chosen: np.ndarray) -> None:
    """One spread for the `chosen` channels (D,) of a group, "force.x" and "force.z": the root of their mean variance. With one
    each a task with turned axes would have other floors and distances, and teach another model."""
    groups = [name.rpartition(".")[0] or name for name in names]
    for group in set(groups):
        members = [i for i, g in enumerate(groups) if g == group and chosen[i]]
        if len(members) > 1:
            scale[members] = np.sqrt(np.mean(scale[members] ** 2))


def _spread(
    x: Array,
    offset: Array,
    names: tuple[str, ...],
    n_demonstrations: int,
    covariance_floor: float,
    allow_constant: float | Mapping[str, float] | None,
    notes: Notes,
) -> Array:
    """Standard deviation of each channel group over all demonstrations; a constant channel has none, so the caller states one."""
    scale = np.sqrt(np.mean((x - offset) ** 2, axis=0))
    stated_spread(scale, x.min(axis=0), x.max(axis=0), names, n_demonstrations, covariance_floor, allow_constant, notes)
    return scale


def stated_spread(
    scale: Array,
    low: Array,
    high: Array,
    names: tuple[str, ...],
    n_demonstrations: int,
    covariance_floor: float,
    allow_constant: float | Mapping[str, float] | None,
    notes: Notes,
) -> None:
    """One spread a channel group; that of channels that never change, `low` = `high`, is what the caller states, TrainingError if
    nothing."""
    # the mean of equal numbers is off by rounding, so compare extremes instead of asking for scale == 0
    constant = high - low <= 8.0 * np.finfo(float).eps * np.maximum(np.abs(low), np.abs(high))
    allowed = allow_constant if isinstance(allow_constant, Mapping) else {name: allow_constant for name in names}
    by_name = {column: value for name, value in allowed.items() for column in expand(name, names)}
    pooled(scale, names, ~constant)
    for column in np.flatnonzero(constant):
        name = names[column]
        stated = by_name.get(name)
        if stated is None:
            raise TrainingError(
                f"{name} is constant {low[column]:.3f} in all demonstrations ({n_demonstrations} of them): a dead "
                "sensor? Leave the channel out, or state its noise with allow_constant=<standard deviation>"
            )
        if not (np.isfinite(stated) and stated > 0.0):
            raise ParameterError(f"allow_constant is a standard deviation above 0 in the channel's unit; got {stated!r}")
        scale[column] = stated / np.sqrt(covariance_floor)  # so that the relative floor becomes the stated one
        notes.say(f"{name} is constant {low[column]:.3f}; trained with the stated standard deviation {stated:g}")


def _look_for_repeats(arrays: list[Array], scale: Array, notes: Notes) -> None:
    same = [
        (i, j)
        for j in range(1, len(arrays))
        for i in range(j)
        if len(arrays[i]) == len(arrays[j]) and (np.abs(arrays[i] - arrays[j]) <= 1e-9 * scale).all()
    ]
    if not same:
        return
    if len(same) == len(arrays) * (len(arrays) - 1) // 2:
        notes.say("all demonstrations are identical: there is no variability, so confidence is meaningless")
    else:
        pairs = ", ".join(f"{i} = {j}" for i, j in same)
        notes.say(f"some demonstrations are identical ({pairs}): they count double")


def _look_for_collinearity(z: Array, names: tuple[str, ...], notes: Notes) -> None:
    alive = np.flatnonzero(np.ptp(z, axis=0) > 0.0)  # a constant channel has its own note
    if len(alive) < 2:
        return
    own = z[:, alive] / np.sqrt(np.mean(z[:, alive] ** 2, axis=0))
    correlation = own.T @ own / len(z)
    values = np.linalg.eigvalsh(correlation)
    condition = values[-1] / max(values[0], 1e-300)
    if condition > COLLINEAR:
        pairs = np.triu(np.abs(correlation), 1)
        i, j = (int(alive[k]) for k in np.unravel_index(int(pairs.argmax()), pairs.shape))
        notes.say(
            f"channels repeat one another (condition number {condition:.1e} of their correlation, "
            f"closest {names[i]} and {names[j]}): the covariance floor decides what is learned between them"
        )
