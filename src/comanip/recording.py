"""Recording: named channels with their own time, unit, frame and axes; frozen.

Every run yields a Recording and every file is read into one, so a reproduction can be learned from like a lesson.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from . import kernels
from .errors import ChannelError, ParameterError
from .interfaces import Array

ROLES = ("leader", "follower", "natural")  # natural: nobody was told one


def check_role(role: str | None) -> None:
    """A role that is asked for or stated must be one that exists: "folower" would fit nothing, for ever."""
    if role and role not in ROLES:
        close = difflib.get_close_matches(str(role).lower(), ROLES, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise ParameterError(f"role is {role!r}; allowed: {', '.join(ROLES)}{hint}")


def axis_units(unit: str, n_axes: int) -> tuple[str, ...]:
    """The unit of each axis: "m" is that of all, "m, m, rad" states one an axis."""
    units = tuple(u.strip() for u in unit.split(","))
    return units if len(units) == n_axes else (unit,) * n_axes


def frozen(values: Any) -> Array:
    """A read-only float64 copy."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Channel:
    """One signal over its own time.

    time    (T,) [s], seconds of the recording's clock
    values  (T, d), one column an axis
    unit    SI symbol ("m", "m/s", "N", "rad", ...); "" when the file did not say
    frame   the frame the values are expressed in; "" when unknown
    axes    (d,) names of the columns, for example ("z",)
    """

    time: Array
    values: Array
    unit: str = ""
    frame: str = ""
    axes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time, values = frozen(self.time), frozen(self.values)
        if values.ndim == 1:
            values = frozen(values[:, None])
        if time.ndim != 1 or values.ndim != 2 or len(time) != len(values):
            hint = ": transpose them" if values.ndim == 2 and len(time) == values.shape[1] else ""
            raise ChannelError(
                f"a channel needs time (T,) and values (T, d); got {time.shape} and {values.shape}, "
                f"want ({len(time) if time.ndim == 1 else 'T'}, d){hint}"
            )
        axes = tuple(self.axes) or tuple(str(i) for i in range(values.shape[1]))
        if len(axes) != values.shape[1]:
            raise ChannelError(f"{values.shape[1]} columns need as many axis names; got {axes}")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "axes", axes)

    def __repr__(self) -> str:
        span = f", {self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else ""
        frame = f" in {self.frame!r}" if self.frame else ""
        return f"Channel({len(self.time)} frames of {', '.join(self.axes)} [{self.unit or '?'}]{frame}{span})"


class Passed:
    """A frozen value that goes to other processes as its fields: read-only mappings do not pickle."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __reduce__(self) -> tuple[Any, ...]:
        values = (getattr(self, name) for name in self.__dataclass_fields__)
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


@dataclass(frozen=True, eq=False)
class Recording(Passed):
    """Channels by name, and metadata that survives as JSON (role, operator, seed, provenance ...)."""

    channels: Mapping[str, Channel]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", MappingProxyType(dict(self.channels)))
        object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))

    def __getitem__(self, name: str) -> Channel:
        try:
            return self.channels[name]
        except KeyError:
            has = ", ".join(sorted(self.channels)) or "no channel at all"
            raise ChannelError(f"channel {name!r} is not in this recording; it has: {has}") from None

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def __repr__(self) -> str:
        return f"Recording({self.duration_s:g} s of {', '.join(self.channels) or 'nothing'})"

    @property
    def duration_s(self) -> float:
        """From the first to the last stamp of any channel [s]."""
        stamps = [c.time for c in self.channels.values() if len(c.time)]
        return float(max(t[-1] for t in stamps) - min(t[0] for t in stamps)) if stamps else 0.0

    def with_channels(self, more: Mapping[str, Channel]) -> Recording:
        """The same with `more` channels by name; one of a name that is there already takes its place."""
        return Recording({**self.channels, **more}, self.metadata)

    def with_metadata(self, **more: Any) -> Recording:
        """The same with `more` metadata; a key that is there already gets the new value."""
        return Recording(self.channels, {**self.metadata, **more})


class Recorder:
    """Collects rows during a run without slowing it; `recording()` freezes them.

    Rows are copied into blocks that double in size, so that a tick allocates nothing most of the time.
    """

    def __init__(self, layout: Mapping[str, tuple[int, str, tuple[str, ...]]], frame: str = "task") -> None:
        """`layout`: channel name -> (number of columns, unit, axis names)."""
        self.layout, self.frame = dict(layout), frame
        self._offsets: dict[str, slice] = {}
        width = 1
        for name, (columns, _, _) in self.layout.items():
            self._offsets[name] = slice(width, width + columns)
            width += columns
        self._rows = np.empty((1024, width))
        self._count = 0
        self._compiled = kernels.native and kernels.native.Rows(len(self.layout))

    @property
    def row(self) -> Array:
        """The latest row: time, then the channels in the order of `layout`. Do not keep it: copy it."""
        return self._rows[max(self._count - 1, 0)]

    def add(self, time: float, values: Sequence[Any]) -> None:
        """One row: arrays or numbers in the order of `layout`."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        if not (self._compiled and self._compiled.lay(self._rows, self._count, time, values)):
            row = self._rows[self._count]
            row[0] = time
            np.concatenate(values, axis=None, out=row[1:])
        self._count += 1

    def recording(self, metadata: Mapping[str, Any]) -> Recording:
        rows = self._rows[: self._count]
        channels = {
            name: Channel(rows[:, 0], rows[:, self._offsets[name]], unit, self.frame, axes)
            for name, (_, unit, axes) in self.layout.items()
        }
        return Recording(channels, metadata)


def expand(names: str | Iterable[str], available: Iterable[str]) -> tuple[str, ...]:
    """Scalar channel names for a choice by name: "force" stands for "force.x", "force.z", ... in their order.

    Raises ChannelError that lists what there is.
    """
    available = tuple(available)
    wanted = (names,) if isinstance(names, str) else tuple(names)
    found: list[str] = []
    for name in wanted:
        hits = [a for a in available if a == name or a.startswith(name + ".")]
        if not hits:
            raise ChannelError(f"channel {name!r} is not here; there are: {', '.join(available)}")
        found.extend(h for h in hits if h not in found)
    return tuple(found)
