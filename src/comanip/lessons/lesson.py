"""One lesson, as a value: signals at one rate, read-only."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ..errors import ChannelError
from ..formats.columns import UNUSED
from ..interfaces import Array
from ..recording import Passed, axis_units, expand, frozen

ORDER = ("position", "force", "velocity")  # the paper's order of the datapoint


@dataclass(frozen=True, eq=False)
class Demonstration(Passed):
    """One lesson: signals of T frames at one rate, read-only.

    dt        [s] between frames
    signals   "position", "velocity", "force" (interaction force F, if there is one) and extras -> (T, d)
    axes      (d,) names of the task axes
    role      what the hand did: "leader", "follower"; "" when nobody said
    source    the file it came from; sha256 of dt and signals; units per signal; notes on everything done to it
    """

    name: str
    dt: float
    signals: Mapping[str, Array]
    axes: tuple[str, ...]
    role: str = ""
    source: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    signal_axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        signals = {name: frozen(values) for name, values in self.signals.items()}
        shapes = {name: values.shape for name, values in signals.items()}
        if len({shape[0] for shape in shapes.values()}) != 1 or any(len(shape) != 2 for shape in shapes.values()):
            raise ChannelError(f"demonstration {self.name!r}: signals need one (T, d) each with one T; got {shapes}")
        axes = {n: tuple(self.signal_axes.get(n, self.axes)) for n in signals}
        for name, names in axes.items():
            if len(names) != shapes[name][1]:
                raise ChannelError(f"demonstration {self.name!r}: {name} {shapes[name]} for the axes {names}")
        object.__setattr__(self, "signals", MappingProxyType(signals))
        object.__setattr__(self, "units", MappingProxyType(dict(self.units)))
        object.__setattr__(self, "signal_axes", MappingProxyType(axes))
        object.__setattr__(self, "notes", tuple(self.notes))

    def __len__(self) -> int:
        return len(next(iter(self.signals.values())))

    def __repr__(self) -> str:
        role = f", {self.role}" if self.role else ""
        return f"Demonstration({self.name!r}, {len(self)} frames at {1.0 / self.dt:g} Hz of {', '.join(self.channels)}{role})"

    @property
    def duration_s(self) -> float:
        """From the first frame to the last [s]."""
        return (len(self) - 1) * self.dt

    @property
    def sha256(self) -> str:
        """Of the data alone: the same lesson under two names has one hash."""
        digest = hashlib.sha256(repr(self.dt).encode())
        for name in sorted(self.signals):
            digest.update(name.encode() + np.ascontiguousarray(self.signals[name]).tobytes())
        return digest.hexdigest()

    @property
    def channels(self) -> tuple[str, ...]:
        """Scalar names, "position.z", "force.z", "velocity.z", then extras: the columns of `array`."""
        names = [n for n in ORDER if n in self.signals] + [n for n in self.signals if n not in ORDER]
        return tuple(f"{n}.{axis}" for n in names for axis in self.signal_axes[n])

    def array(self, names: str | Iterable[str]) -> Array:
        """Chosen channels side by side, (T, D): "force" stands for all its axes."""
        columns = {f"{n}.{a}": v[:, i] for n, v in self.signals.items() for i, a in enumerate(self.signal_axes[n])}
        return np.stack([columns[name] for name in expand(names, self.channels)], axis=1)

    def unit_of(self, channel: str) -> str:
        """The unit of one scalar channel: "rad" for "position.yaw" where the units are "m, m, rad"; "" when nobody said."""
        name = max((n for n in self.signals if channel == n or channel.startswith(n + ".")), key=len, default="")
        if channel not in self.channels:
            raise ChannelError(f"no channel {channel!r}; there are: {', '.join(self.channels)}")
        axes = self.signal_axes[name]
        return axis_units(self.units.get(name, ""), len(axes))[axes.index(channel[len(name) + 1 :])]

    def __getitem__(self, name: str) -> Array:
        if name not in self.signals:
            raise ChannelError(missing(name, self.signals, self.source or self.name, self.notes))
        return self.signals[name]

    @property
    def position(self) -> Array:
        """(T, d) [m]"""
        return self["position"]

    @property
    def velocity(self) -> Array:
        """(T, d) [m/s]"""
        return self["velocity"]

    @property
    def force(self) -> Array:
        """(T, d) interaction force F, partner on hand [N]."""
        return self["force"]


def missing(name: str, signals: Iterable[str], where: str, notes: Iterable[str] = ()) -> str:
    """`notes` of the lesson: what its file has besides may be what is missing under a name of its own."""
    hint = "; learn without force: position and velocity only" if name == "force" else ""
    return f"{where}: no {name!r}; found {', '.join(signals) or 'nothing'}{unused(notes)}{hint}"


def unused(notes: Iterable[str]) -> str:
    """The note of the columns that a file has besides, as the end of a message; "" where there are none."""
    return next((f"; {note}" for note in map(str, notes) if note.endswith(UNUSED)), "")
