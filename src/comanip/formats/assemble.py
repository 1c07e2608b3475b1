"""From columns of numbers to a Recording: signs, units, stamps and axes, each choice written into the notes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..errors import ChannelError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording, axis_units
from .columns import (
    KINDS,
    NAME,
    UNUSED,
    Columns,
    axes_of,
    is_angle,
    joined,
    note,
    recognise,
    recognise_time,
    sign_and_name,
    to_si,
    units_of_axes,
    unknown,
    with_units,
)
from .looking import Look, Looked

_EPOCH = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_SINCE_S, _UNTIL_S = 9.4e8, 4.2e9  # stamps between 1999 and 2103 count from 1970, in the only unit in which they do


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
    if isinstance(columns, Look):
        raise Looked(source)
    notes: list[str] = list(source.notes)
    columns = _completed(source, with_units(columns, source.names, str(source.path)), notes)
    wanted = _wanted(source.path, columns)
    found = {name: [source.find(e) for e in exprs] for name, exprs in wanted.items()}
    stamps = source.find(columns.time) if columns.time else []
    notes += [n for n in source.notes if n not in notes]  # what was noticed in reading these columns
    counts = {len(arrays) for several in found.values() for arrays in several} | ({len(stamps)} if stamps else set())
    total = max(counts)
    if counts - {1, total}:
        raise ChannelError(f"{source.path}: the columns hold {sorted(counts)} recordings; allowed: one number for all")
    name = title_of(source.path)
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


def _say_unmapped(source: Source, columns: Columns, notes: list[str]) -> None:
    """Where something is mapped nothing else is guessed: what the file has besides is said."""
    used = {columns.time, *(e.lstrip("-") for exprs in columns.mapped.values() for e in exprs)}
    if left := [n for n in source.names if n not in used][:20]:
        notes.append(f"columns {', '.join(left)} {UNUSED}")


def _wanted(path: Path, columns: Columns) -> dict[str, tuple[str, ...]]:
    """Channel -> expressions; an extra channel may not take the place of a signal."""
    signals = {NAME[kind]: exprs for kind, exprs in columns.mapped.items()}
    for name in columns.extra:
        if name in NAME or name in NAME.values():
            raise ChannelError(f"{path}: an extra channel is called {name!r}, as one of the signals; give it another name")
    return signals | dict(columns.extra)


def title_of(path: Path) -> str:
    """The name of a recording: the file's, without its extensions (lift.csv.gz is "lift")."""
    name = path.with_suffix("").name if path.suffix.lower() in (".gz", ".bz2", ".xz", ".zst") else path.name
    return Path(name).stem or path.name


def _completed(source: Source, columns: Columns, notes: list[str]) -> Columns:
    """`columns` with the time column, and, when nothing is mapped, the signals that are obvious."""
    if columns.time is None:
        time = recognise_time(source.names) or getattr(source, "stamps", None)
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
        _say_unmapped(source, columns, notes)
        return columns
    obvious = recognise(source.names) or _by_last_name(source.names)
    axes = _common_axes(obvious, notes)
    if not obvious and not columns.extra:
        raise ChannelError(
            f"{source.path}: no column is obviously a position, velocity or force; there are: "
            f"{', '.join(source.names[:40]) or 'none'}; say which, for example position=z velocity=vz force=Fz"
        )
    used = {columns.time} | {c for by_axis in obvious.values() for a, c in by_axis.items() if a in axes}
    if left := [n for n in source.names if n not in used][:20]:
        notes.append(f"columns {', '.join(left)} {UNUSED}")
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
    array = np.asarray(stamps, dtype=np.float64)
    if array.size != max(array.shape, default=1):
        raise ChannelError(f"{source.path}: time {columns.time!r} has shape {stamps.shape}; allowed: one column")
    array, said = array.reshape(-1), source.unit(columns.time or "")
    _overruled(notes, "time", said, columns.time_unit)
    unit = columns.time_unit or said or _since_1970(array, notes) or "s"
    factor = to_si(unit, "time")[1]
    if factor != 1.0:
        notes.append(f"time converted from {unit} to s")
    # Division keeps 20 ms at exactly 0.02 s, where a product with 0.001 would not.
    return array / round(1.0 / factor) if factor < 1.0 else array * factor if factor > 1.0 else array


def _since_1970(stamps: Array, notes: list[str]) -> str:
    """The unit of stamps that count from 1970: only one makes them a date of our time. "" when they do not count from there."""
    known = stamps[np.isfinite(stamps)]
    for unit, factor in _EPOCH.items():
        if len(known) and _SINCE_S * factor < known.min() and known.max() < _UNTIL_S * factor:
            if unit != "s":
                notes.append(f"stamps of {known[0]:.6g} are taken to be {unit} since 1970: no unit is stated")
            return unit
    return ""


def _overruled(notes: list[str], what: str, said: str, stated: str | None) -> None:
    """Notes where the caller's unit goes before another that the file states."""
    if stated and said and stated != said:
        notes.append(f"{what}: the file says {said}, {stated} is used, as stated")


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
    if len(time) != len(values):
        raise ChannelError(f"{where}: got {values.shape}, want ({len(time)}, d): as many frames as the other columns")
    n_axes = values.shape[1]
    named = next((e for e in (columns.position, columns.velocity, columns.force, columns.sensor_force) if e), ())
    axes, assumed = (columns.axes, False) if columns.axes else axes_of(named, n_axes)
    if assumed and kind and (text := f"axes taken to be {', '.join(axes)}, z up: nothing names them") not in notes:
        notes.append(text)
    if len(axes) != n_axes and kind:
        raise ChannelError(f"{where}: {n_axes} columns for the axes {', '.join(axes)}; map one column an axis")
    if not kind:
        axes = axes if len(axes) == n_axes else ()
        return Channel(time, values, joined(_said_units(source, expressions, n_axes)), "task", axes)
    return _in_si(source, kind, Channel(time, values, "", "task", axes), expressions, columns, channel, notes)


def _in_si(
    source: Source, kind: str, raw: Channel, expressions: tuple[str, ...], columns: Columns, name: str, notes: list[str]
) -> Channel:
    """The channel in SI, axis by axis: the caller's unit goes before the file's, and that before what a name tells."""
    base, n_axes = "force" if kind == "sensor_force" else kind, len(raw.axes)
    said = _said_units(source, expressions, n_axes)
    stated = columns.unit(kind)
    _overruled(notes, name, joined(said), stated)
    if stated:
        units = units_of_axes(stated, base, n_axes)
    else:
        default = _default_units(source, base, raw.axes, columns)
        units = tuple(to_si(s, base) if s else d for s, d in zip(said, default, strict=True))
    unit, factors = joined(u for u, _ in units), np.array([f for _, f in units])
    if (factors != 1.0).any():
        notes.append(f"{name} converted from {stated or joined(s or u for s, (u, _) in zip(said, units, strict=True))} to {unit}")
    elif not (stated or all(said)):
        notes.append(f"{name} is taken to be in {unit}: the file states no unit")
    return replace(raw, values=raw.values * factors if (factors != 1.0).any() else raw.values, unit=unit)


def _default_units(source: Source, kind: str, axes: Sequence[str], columns: Columns) -> tuple[tuple[str, float], ...]:
    """SI for each axis, when nobody states a unit: rad where the position is an angle by its unit or its name."""
    linear, angular = KINDS[kind]
    named = columns.position or columns.velocity or columns.force or columns.sensor_force
    units = _said_units(source, columns.position, len(axes)) if columns.position else ("",) * len(axes)
    if columns.position_unit:
        units = tuple(u for u, _ in units_of_axes(columns.position_unit, "position", len(axes)))
    turns = [
        to_si(unit, "position")[0] == "rad" if unit else is_angle(axis) or (len(named) == len(axes) and is_angle(named[i]))
        for i, (axis, unit) in enumerate(zip(axes, units, strict=True))
    ]
    return tuple((angular if turn else linear, 1.0) for turn in turns)


def _said_units(source: Source, expressions: tuple[str, ...], n_axes: int) -> tuple[str, ...]:
    """The units that the file states, one an axis, "" where it states none; a column of several axes has one for all."""
    units = [source.unit(e) for e in expressions]
    if len(units) == n_axes:
        return tuple(units)
    if len(set(units)) > 1:
        raise ChannelError(
            f"{source.path}: {', '.join(expressions)} are in different units ({', '.join(sorted(set(units)))}); "
            "map one column an axis"
        )
    return (units[0] if units else "",) * n_axes


def remapped(path: Path, recording: Recording, columns: Columns) -> Recording:
    """One of our own recordings under a mapping: channels renamed, units, role and rate stated, stamps ignored."""
    metadata = {"name": title_of(path), **recording.metadata, "source": str(path)}
    notes: list[str] = []
    columns = with_units(columns, scalars_in(recording), str(path))
    recording = _restamped(path, recording, columns, notes)
    if columns.role is not None:
        written = metadata.get("role")
        if written and written != columns.role:
            raise RecordingError(f"{path}: its role is {written!r}, you said {columns.role!r}; leave the role out")
        metadata["role"] = columns.role
    if columns.rate_hz is not None:
        metadata["rate_hz"] = float(columns.rate_hz)
    channels = dict(recording.channels)
    for name, expressions in _wanted(path, columns).items():
        channels[name] = _picked(path, recording, expressions, columns.axes)
        instead = f", instead of the file's own {name}" if name in recording and expressions != (name,) else ""
        notes.append(f"{', '.join(expressions)} taken as {name}{instead}")
    if columns.mapped and not columns.axes:
        channels |= _named_alike(channels, columns, notes)
    for kind, name in NAME.items():
        if name in channels:
            channels[name] = _stated(name, kind, channels[name], columns, kind in columns.mapped, notes)
    if columns.extra:
        metadata["extra"] = list(columns.extra)
    if notes:
        metadata["notes"] = note(metadata, *notes)
    return Recording(channels, metadata)


def _named_alike(channels: Mapping[str, Channel], columns: Columns, notes: list[str]) -> dict[str, Channel]:
    """The hand's signals with one set of axes, where entries of arrays (12, 13, 14 of a pose, 0, 1, 2 of a force) name none.

    Where all of them are called x, y, z and differ, nothing is renamed: a z beside an x is a mistake.
    """
    signals = {name: channels[name] for name in NAME.values() if name in channels}
    several = {c.axes for c in signals.values()}
    counts = {len(axes) for axes in several}
    if len(several) < 2 or len(counts) > 1 or all(set(axes) <= set("xyz") for axes in several):
        return {}
    named = next((e for e in (columns.position, columns.velocity, columns.force, columns.sensor_force) if e), ())
    axes, assumed = axes_of(named, counts.pop())
    notes.append(f"axes taken to be {', '.join(axes)}" + (", z up: nothing names them" if assumed else ""))
    return {name: replace(c, axes=axes) for name, c in signals.items()}


def _restamped(path: Path, recording: Recording, columns: Columns, notes: list[str]) -> Recording:
    """The recording with frame i at i / rate_hz, where its stamps are to be ignored; our recordings bring their own stamps."""
    if columns.time in (None, "time") and columns.time_unit in (None, "s"):
        return recording
    if columns.time != "none":
        wrong = f"time={columns.time!r}" if columns.time not in (None, "time") else f"time_unit={columns.time_unit!r}"
        raise ChannelError(
            f'{path}: {wrong}: every channel has its own stamps [s]; leave it out, or ignore them with time="none"'
        )
    if columns.rate_hz is None:
        raise RecordingError(f'{path}: time="none" ignores the stamps; state the rate (rate_hz=...)')
    lengths = {name: len(channel.time) for name, channel in recording.channels.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise RecordingError(f"{path}: the channels have different numbers of frames ({listed}): without stamps they fit nowhere")
    notes.append(f"the file's stamps are ignored, as asked: frame i is taken to be at i / {columns.rate_hz:g} s")
    channels = {n: replace(c, time=np.arange(len(c.time)) / columns.rate_hz) for n, c in recording.channels.items()}
    return Recording(channels, recording.metadata)


def scalars_in(recording: Recording) -> list[str]:
    """Every name that a mapping may use: of channels, and of their axes."""
    return [*recording.channels, *(f"{n}.{a}" for n, c in recording.channels.items() for a in c.axes)]


def _picked(path: Path, recording: Recording, expressions: tuple[str, ...], axes: tuple[str, ...]) -> Channel:
    """Columns of channels ("hand.position" or "hand.position.z") side by side; they must share their stamps."""
    every = [(f"{n}.{a}", (n, i)) for n, c in recording.channels.items() for i, a in enumerate(c.axes)]
    scalars = dict(every)
    twice = {name for name, k in Counter(name for name, _ in every).items() if k > 1}
    picked: list[tuple[float, Channel, int]] = []
    for expression in expressions:
        sign, name = sign_and_name(expression, [*recording.channels, *scalars])
        if name in twice:
            raise ChannelError(
                f"{path}: two columns are called {name!r}: of the channels {', '.join(recording.channels)}; rename one"
            )
        if name in recording.channels:
            picked += [(sign, recording.channels[name], i) for i in range(len(recording.channels[name].axes))]
        elif name in scalars:
            picked.append((sign, recording.channels[scalars[name][0]], scalars[name][1]))
        else:
            raise unknown(str(path), name, [*recording.channels, *scalars])
    first = picked[0][1]
    if len({c.frame for _, c, _ in picked}) > 1:
        raise ChannelError(f"{path}: {', '.join(expressions)} are in different frames; map channels of one frame together")
    if any(not np.array_equal(c.time, first.time) for _, c, _ in picked):
        raise ChannelError(f"{path}: {', '.join(expressions)} have different stamps; map channels of one clock together")
    values = np.stack([sign * c.values[:, i] for sign, c, i in picked], axis=1)
    unit = joined(axis_units(c.unit, len(c.axes))[i] for _, c, i in picked)
    return Channel(first.time, values, unit, first.frame, axes or tuple(c.axes[i] for _, c, i in picked))


def _stated(name: str, kind: str, channel: Channel, columns: Columns, mapped: bool, notes: list[str]) -> Channel:
    """The channel with the unit that the caller states; a mapping without any unit states SI, and says so."""
    said, base, n_axes = columns.unit(kind), "force" if kind == "sensor_force" else kind, len(channel.axes)
    if said and channel.unit:
        units = units_of_axes(said, base, n_axes)
        if joined(u for u, _ in units) != channel.unit or any(f != 1.0 for _, f in units):
            raise ChannelError(f"{name} is stored in {channel.unit}; you said {said}: leave the unit out")
        return channel
    if not said and (channel.unit or not mapped):
        return channel
    linear, angular = KINDS[base]
    default = tuple((angular if is_angle(axis) else linear, 1.0) for axis in channel.axes)
    if not said and columns.position_unit:
        turns = [u == "rad" for u, _ in units_of_axes(columns.position_unit, "position", n_axes)]
        default = tuple((angular if turn else linear, 1.0) for turn in turns)
    units = units_of_axes(said, base, n_axes) if said else default
    unit, factors = joined(u for u, _ in units), np.array([f for _, f in units])
    notes.append(f"{name} is taken to be in {said or unit}" + (f", converted to {unit}" if (factors != 1.0).any() else ""))
    return replace(channel, values=channel.values * factors, unit=unit)
