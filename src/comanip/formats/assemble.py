"""From columns of numbers to a Recording: signs, units, stamps and axes, each choice written into the notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .columns import (
    KINDS,
    NAME,
    Columns,
    axes_of,
    note,
    recognise,
    recognise_time,
    sign_and_name,
    to_si,
    unknown,
)


class Source(Protocol):
    """What a foreign file offers: columns by expression, one array per recording it holds."""

    path: Path
    notes: list[str]

    @property
    def names(self) -> tuple[str, ...]: ...

    def find(self, expression: str) -> list[Array]:
        """Arrays (T, k), or (k, T) where the file keeps time last; one a recording. ChannelError lists the names."""
        ...

    def unit(self, expression: str) -> str:
        """The unit that the file itself states for a column ("z [mm]"), "" when it states none."""
        ...


def assemble(source: Source, columns: Columns) -> tuple[Recording, ...]:
    """Every recording in `source`, its mapped or recognised columns as hand.position, hand.velocity, hand.force ..."""
    notes: list[str] = list(source.notes)
    columns = _completed(source, columns, notes)
    wanted = {NAME[kind]: exprs for kind, exprs in columns.mapped.items()} | dict(columns.extra)
    found = {name: [source.find(e) for e in exprs] for name, exprs in wanted.items()}
    stamps = source.find(columns.time) if columns.time else []
    counts = {len(arrays) for several in found.values() for arrays in several} | ({len(stamps)} if stamps else set())
    total = max(counts)
    if counts - {1, total}:
        raise ChannelError(f"{source.path}: the columns hold {sorted(counts)} recordings; allowed: one number for all")
    name = source.path.stem or source.path.name
    return tuple(
        _recording(
            source,
            columns,
            {n: [a[i if len(a) > 1 else 0] for a in several] for n, several in found.items()},
            stamps[i if len(stamps) > 1 else 0] if stamps else None,
            notes,
            f"{name}[{i}]" if total > 1 else name,
        )
        for i in range(total)
    )


def _completed(source: Source, columns: Columns, notes: list[str]) -> Columns:
    """`columns` with the time column, and, when nothing is mapped, the signals that are obvious."""
    if columns.time is None:
        time = recognise_time(source.names)
        columns = replace(columns, time=time)
        if time:
            notes.append(f"column {time!r} taken as time")
    elif columns.time == "none":
        columns = replace(columns, time=None)
        notes.append("the file's stamps are ignored, as asked")
    if columns.time is None and columns.rate_hz is None:
        raise RecordingError(
            f"{source.path}: no time column among {', '.join(source.names[:20]) or 'unnamed columns'}; "
            "name it (time=...) or state the rate (rate_hz=...)"
        )
    if columns.mapped:
        return columns
    obvious = recognise(source.names) or _by_last_name(source.names)
    axes = _common_axes(obvious, notes)
    if not obvious and not columns.extra:
        raise ChannelError(
            f"{source.path}: no column is obviously a position, velocity or force; there are: "
            f"{', '.join(source.names[:40]) or 'none'}; say which, for example position=z velocity=vz force=Fz"
        )
    for kind, by_axis in obvious.items():
        chosen = tuple(by_axis[a] for a in axes if a in by_axis)
        if chosen:
            changes: dict[str, Any] = {kind: chosen}
            columns = replace(columns, **changes)
            notes.append(f"columns {', '.join(chosen)} taken as {kind}")
    return columns if columns.axes or axes == ("",) else replace(columns, axes=axes)


def _by_last_name(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Recognises "symbol_data[i].pos" by its "pos", when no two columns end alike."""
    leaves = {n.rsplit(".", 1)[-1]: n.replace("[i]", "") for n in names}
    if len(leaves) != len(names):
        return {}
    return {kind: {axis: leaves[n] for axis, n in by.items()} for kind, by in recognise(leaves).items()}


def _common_axes(obvious: Mapping[str, Mapping[str, str]], notes: list[str]) -> tuple[str, ...]:
    """The axes that every recognised kind has; a file with x, y, z and Fz alone is taken as a vertical task."""
    axes = [set(by_axis) for by_axis in obvious.values()]
    common = set.intersection(*axes) if axes else set()
    if axes and not common:
        listed = "; ".join(f"{kind}: {', '.join(by.values())}" for kind, by in obvious.items())
        raise ChannelError(f"the columns share no axis ({listed}); say which belong together, e.g. position=z force=Fz")
    if len(common) < max((len(a) for a in axes), default=0):
        notes.append(f"only axes {', '.join(sorted(common))} are in every signal: the others are left out")
    return tuple(sorted(common))


def _recording(
    source: Source,
    columns: Columns,
    found: Mapping[str, list[Array]],
    stamps: Array | None,
    notes: list[str],
    name: str,
) -> Recording:
    notes = list(notes)
    metadata: dict[str, object] = {"name": name, "source": str(source.path)}
    if columns.role is not None:
        metadata["role"] = columns.role
    time = _time(source, columns, stamps, notes)
    if time is not None and columns.rate_hz is not None:
        metadata["rate_hz"] = float(columns.rate_hz)  # the rate that `demonstration` resamples to
    values: dict[str, Array] = {}
    for channel, arrays in found.items():
        values[channel] = _stacked(f"{source.path}: {channel}", arrays, None if time is None else len(time), notes)
    if time is None:
        assert columns.rate_hz is not None
        time = np.arange(max(len(v) for v in values.values())) / columns.rate_hz
        notes.append(f"no stamps: frame i is taken to be at i / {columns.rate_hz:g} s")
    kinds = {NAME[kind]: kind for kind in NAME}
    channels = {
        channel: _channel(source, kinds.get(channel, ""), time, array, columns, channel, notes)
        for channel, array in values.items()
    }
    if columns.extra:
        metadata["extra"] = list(columns.extra)
    return Recording(channels, {**metadata, "notes": note(metadata, *dict.fromkeys(notes))})


def _time(source: Source, columns: Columns, stamps: Array | None, notes: list[str]) -> Array | None:
    if stamps is None:
        return None
    array = np.asarray(stamps, dtype=np.float64).squeeze()
    if array.ndim != 1:
        raise ChannelError(f"{source.path}: time {columns.time!r} has shape {stamps.shape}; allowed: one column")
    unit = columns.time_unit or source.unit(columns.time or "") or "s"
    factor = to_si(unit, "time")[1]
    if factor != 1.0:
        notes.append(f"time converted from {unit} to s")
    # Division keeps 20 ms at exactly 0.02 s, where a product with 0.001 would not.
    return array / round(1.0 / factor) if factor < 1.0 else array


def _stacked(where: str, arrays: list[Array], frames: int | None, notes: list[str]) -> Array:
    """One (T, d) array from columns; where a file keeps time last, the rule is explicit: time is the
    dimension as long as the stamps, else the longer one."""
    upright = []
    for array in arrays:
        array = np.asarray(array, dtype=np.float64)
        array = array.reshape(-1, 1) if array.ndim <= 1 else array
        if array.ndim != 2:
            raise ChannelError(f"{where}: got shape {array.shape}, want (T, d); pick a part, for example [:, 0]")
        turn = array.shape[1] == frames != array.shape[0] if frames else array.shape[1] > array.shape[0]
        if turn:
            rule = "as many as there are stamps" if frames else "the longer dimension is time"
            notes.append(f"{array.shape} read as {array.shape[1]} frames of {array.shape[0]} axes: {rule}")
        upright.append(array.T if turn else array)
    lengths = [len(a) for a in upright]
    if len({*lengths, *([frames] if frames is not None else [])}) > 1:
        want = frames if frames is not None else max(lengths)
        got = next(a.shape for a in upright if len(a) != want)
        raise ChannelError(f"{where}: got {got}, want ({want}, d): as many frames as the other columns have")
    return np.concatenate(upright, axis=1)


def _channel(source: Source, kind: str, time: Array, values: Array, columns: Columns, channel: str, notes: list[str]) -> Channel:
    where = f"{source.path}: {channel}"
    expressions = getattr(columns, kind) if kind else columns.extra[channel]
    base = "force" if kind == "sensor_force" else kind
    if len(time) != len(values):
        raise ChannelError(f"{where}: got {values.shape}, want ({len(time)}, d): as many frames as the other columns")
    axes = columns.axes or axes_of([*columns.position, *columns.velocity, *columns.force][: values.shape[1]], values.shape[1])
    if len(axes) != values.shape[1] and kind:
        raise ChannelError(f"{where}: {values.shape[1]} columns for the axes {', '.join(axes)}; map one column an axis")
    if not kind:
        axes = axes if len(axes) == values.shape[1] else ()
        return Channel(time, values, _said_unit(source, expressions), "task", axes)
    said = columns.unit(kind) or _said_unit(source, expressions)
    unit, factor = to_si(said, base) if said else (_default_unit(base, columns), 1.0)
    if factor != 1.0:
        notes.append(f"{channel} converted from {said} to {unit}")
    elif not said:
        notes.append(f"{channel} is taken to be in {unit}: the file states no unit")
    return Channel(time, values * factor if factor != 1.0 else values, unit, "task", axes)


def _default_unit(kind: str, columns: Columns) -> str:
    """SI; a velocity follows its position (an angle gives rad/s)."""
    if kind == "velocity" and columns.position_unit and to_si(columns.position_unit, "position")[0] == "rad":
        return "rad/s"
    return KINDS[kind][0]


def _said_unit(source: Source, expressions: tuple[str, ...]) -> str:
    """The unit that the file states for all of these columns, "" when it states none."""
    units = {source.unit(e) for e in expressions}
    if len(units) > 1:
        raise ChannelError(
            f"{source.path}: {', '.join(expressions)} are in different units ({', '.join(sorted(units))}); "
            "bring them to one unit first"
        )
    return units.pop() if units else ""


def remapped(path: Path, recording: Recording, columns: Columns) -> Recording:
    """One of our own recordings under a mapping: channels renamed, units, role and rate stated."""
    metadata = {"name": path.stem or path.name, **recording.metadata, "source": str(path)}
    notes: list[str] = []
    if columns.role is not None:
        written = metadata.get("role")
        if written and written != columns.role:
            raise RecordingError(f"{path}: its role is {written!r}, you said {columns.role!r}; leave the role out")
        metadata["role"] = columns.role
    if columns.rate_hz is not None:
        metadata["rate_hz"] = float(columns.rate_hz)
    channels = dict(recording.channels)
    wanted = {NAME[kind]: exprs for kind, exprs in columns.mapped.items()} | dict(columns.extra)
    for name, expressions in wanted.items():
        channels[name] = _picked(path, recording, expressions, columns.axes)
        notes.append(f"{', '.join(expressions)} taken as {name}")
    for kind, name in NAME.items():
        if name in channels:
            channels[name] = _stated(name, kind, channels[name], columns, kind in columns.mapped, notes)
    if columns.extra:
        metadata["extra"] = list(columns.extra)
    if notes:
        metadata["notes"] = note(metadata, *notes)
    return Recording(channels, metadata)


def _picked(path: Path, recording: Recording, expressions: tuple[str, ...], axes: tuple[str, ...]) -> Channel:
    """Columns of channels ("hand.position" or "hand.position.z") side by side; they must share their stamps."""
    scalars = {f"{n}.{a}": (n, i) for n, c in recording.channels.items() for i, a in enumerate(c.axes)}
    picked: list[tuple[float, Channel, int]] = []
    for expression in expressions:
        sign, name = sign_and_name(expression, [*recording.channels, *scalars])
        if name in recording.channels:
            picked += [(sign, recording.channels[name], i) for i in range(len(recording.channels[name].axes))]
        elif name in scalars:
            picked.append((sign, recording.channels[scalars[name][0]], scalars[name][1]))
        else:
            raise unknown(str(path), name, [*recording.channels, *scalars])
    first = picked[0][1]
    if any(not np.array_equal(c.time, first.time) for _, c, _ in picked):
        raise ChannelError(f"{path}: {', '.join(expressions)} have different stamps; map channels of one clock together")
    values = np.stack([sign * c.values[:, i] for sign, c, i in picked], axis=1)
    return Channel(first.time, values, first.unit, first.frame, axes or tuple(c.axes[i] for _, c, i in picked))


def _stated(name: str, kind: str, channel: Channel, columns: Columns, mapped: bool, notes: list[str]) -> Channel:
    """The channel with the unit that the caller states; a mapping without any unit states SI, and says so."""
    said, base = columns.unit(kind), "force" if kind == "sensor_force" else kind
    if said and channel.unit:
        if to_si(said, base) != (channel.unit, 1.0):
            raise ChannelError(f"{name} is stored in {channel.unit}; you said {said}: leave the unit out")
        return channel
    if not said and (channel.unit or not mapped):
        return channel
    unit, factor = to_si(said, base) if said else (_default_unit(base, columns), 1.0)
    notes.append(f"{name} is taken to be in {said or unit}" + (f", converted to {unit}" if factor != 1.0 else ""))
    return replace(channel, values=channel.values * factor, unit=unit)
