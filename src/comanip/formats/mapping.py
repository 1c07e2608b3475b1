"""Which channels of a bag are the hand's: named by path, or recognised where only one can be meant; turned into one frame; one
clock."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from ..recording import Channel, Recording
from .assemble import remapped, scalars_in
from .columns import NAME, Columns, recognise, sign_and_name, with_units
from .events import EVENTS
from .frames import turned
from .looking import Look, Looked
from .messages import CLOCKS, Transforms

ORIENTATION, TORQUE = "hand.orientation", "hand.torque"
_LEAVES = {"position": ("position", "translation", "point"), "velocity": ("linear",), "force": ("force",)}
_UNITS = {"position": "m", "velocity": "m/s", "force": "N"}
_STILL = 1e-9  # [m] an axis along which nothing moves is no part of the task


def mapped(path: Path, recording: Recording, columns: Columns, turns: Sequence[Transforms] = ()) -> Recording:
    """The recording with hand.position, hand.velocity, hand.force ... as `columns` says, or as is obvious."""
    if isinstance(columns, Look) and not any(name in recording for name in NAME.values()):
        raise Looked(recording)
    notes: list[str] = []
    columns = _named(path, recording, with_units(columns, scalars_in(recording), str(path)))
    ours = any(name in recording for name in NAME.values())
    if columns.mapped or (ours and columns.frames):
        recording = _one_frame(path, recording, columns, turns, notes)
    elif not ours:
        recording, columns = _obvious(path, recording, columns, turns, notes)
    recording = recording.with_channels(_beside(recording, columns, notes))
    if notes:
        recording = recording.with_metadata(notes=[*recording.metadata.get("notes", ()), *notes])
    return finished(path, recording, columns)


def _obvious(
    path: Path, recording: Recording, columns: Columns, turns: Sequence[Transforms], notes: list[str]
) -> tuple[Recording, Columns]:
    """The recording in one frame and what was recognised; where the user must decide, nothing is, and metadata["hint"] says
    why."""
    said: list[str] = []
    found, hint = _recognised(recording, columns, said)
    try:
        framed = recording if hint else _one_frame(path, recording, found, turns, said)
    except ChannelError as error:
        hint = str(error).removeprefix(f"{path}: ")
    if hint:
        notes.append(hint)
        return recording.with_metadata(hint=hint), columns
    notes += said
    return framed, found


def scalars_of(recording: Recording) -> dict[str, str]:
    """ "/ft.wrench.force.z" -> the channel "/ft.wrench.force" that holds it."""
    return {f"{n}.{axis}": n for n, c in recording.channels.items() for axis in c.axes}


def _named(path: Path, recording: Recording, columns: Columns) -> Columns:
    """`columns` with every expression as the full name of a channel or scalar, indices and short names resolved."""
    scalars = scalars_of(recording)
    names = [*recording.channels, *scalars]

    def full(expressions: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(found for e in expressions for found in _resolved(path, e, recording, names))

    changes: dict[str, object] = {kind: full(expressions) for kind, expressions in columns.mapped.items()}
    extra = {name: full(expressions) for name, expressions in columns.extra.items()}
    return replace(columns, **changes, extra=extra)  # type: ignore[arg-type]


def _resolved(path: Path, expression: str, recording: Recording, names: Sequence[str]) -> list[str]:
    sign, name = sign_and_name(expression, names)
    minus = "-" if sign < 0 else ""
    found: list[str] = []
    for part in _indexed(name):
        exact = next((n for n in (part, "/" + part.lstrip("/")) if n in names), None)
        short = part.lstrip("/")
        hits = [exact] if exact else [n for n in names if n.endswith((f".{short}", f"/{short}"))]
        hits = [n for n in hits if n in recording.channels] or hits  # a channel rather than what is within one
        if len(hits) > 1:
            raise ChannelError(f"{path}: {name!r} may be {' or '.join(hits[:8])}; say which")
        found.append(minus + (hits[0] if hits else part))
    return found


def _indexed(name: str) -> list[str]:
    """ "a[14]" -> "a.14", "a[12:15]" -> "a.12", "a.13", "a.14", "a[0,5]" -> "a.0", "a.5"."""
    match = re.fullmatch(r"(.+)\[([\d:, ]+)\]", name)
    if not match:
        return [name]
    numbers: list[int] = []
    for part in match[2].split(","):
        low, colon, high = part.strip().partition(":")
        if not low.isdigit() or (colon and not high.isdigit()):
            return [name]
        numbers += range(int(low), min(int(high), int(low) + 1024)) if colon else [int(low)]
    return [f"{match[1]}.{i}" for i in numbers]


Candidate = dict[str, str]  # axis -> channel or scalar


def _recognised(recording: Recording, columns: Columns, notes: list[str]) -> tuple[Columns, str]:
    """(columns with what only one channel can be, what must be said by the user)."""
    candidates = {kind: [*_vectors(recording, kind), *_plain(recording, kind)] for kind in _LEAVES}
    doubts = [
        f"{' and '.join(next(iter(c.values())) for c in found)} could both be the {kind}"
        for kind, found in candidates.items()
        if len(found) > 1
    ]
    if doubts:
        first = next(iter(candidates["position"][0].values())) if candidates["position"] else "..."
        return columns, f"{'; '.join(doubts)}; say which, for example position={first}"
    chosen = {kind: found[0] for kind, found in candidates.items() if found}
    common = [a for a in ("x", "y", "z", "") if all(a in c for c in chosen.values())]
    if not chosen or ("position" not in chosen and "velocity" not in chosen):
        return columns, ""
    if not common:
        return columns, "; ".join(
            f"{kind}: {', '.join(c.values())}" for kind, c in chosen.items()
        ) + " share no axis; say which belong together"
    axes = _moving(recording, {a: chosen["position"][a] for a in common} if "position" in chosen else {}, common, columns, notes)
    for kind, by in chosen.items():
        columns = replace(columns, **{kind: tuple(by[a] for a in axes)})  # type: ignore[arg-type]
    return (columns if columns.axes or axes == ("",) else replace(columns, axes=axes)), ""


def _vectors(recording: Recording, kind: str) -> list[Candidate]:
    """Vectors whose name says what they are: "/ft.wrench.force"."""
    return [
        {a: f"{n}.{a}" for a in "xyz"}
        for n, c in recording.channels.items()
        if n.rsplit(".", 1)[-1] in _LEAVES[kind] and c.unit in (_UNITS[kind], "") and set(c.axes) == set("xyz") and len(c.time)
    ]


def _plain(recording: Recording, kind: str) -> list[Candidate]:
    """Single numbers whose names say what they are, a file or a namespace at a time: topics "/z", "/Fz"; columns "lift.x",
    "lift.Fx"."""
    places: dict[str, dict[str, str]] = {}
    for name, channel in recording.channels.items():
        if len(channel.axes) == 1 and len(channel.time) and name not in NAME.values():
            place, _, leaf = name.rpartition("/" if name.startswith("/") else ".")
            places.setdefault(place, {})[leaf] = name
    found = []
    for leaves in places.values():
        try:
            by = recognise(leaves).get(kind, {})
        except ChannelError:
            continue
        if by:
            found.append({axis: leaves[column] for axis, column in by.items()})
    return found


def _moving(
    recording: Recording, positions: Mapping[str, str], common: Sequence[str], columns: Columns, notes: list[str]
) -> tuple[str, ...]:
    """The axes asked for, or those along which the hand moves at all."""
    if columns.axes:
        if set(columns.axes) <= set(common):
            return columns.axes
        raise ParameterError(
            f"axes {', '.join(columns.axes)}: the signals that were recognised have {', '.join(a or '-' for a in common)}"
        )
    spans = {a: float(np.ptp(_values(recording, name))) for a, name in positions.items()}
    moving = tuple(
        a for a in common if not spans.get(a, 1.0) <= _STILL
    )  # a span that is not finite counts as motion, and is refused later
    if 0 < len(moving) < len(common):
        still = [a for a in common if a not in moving]
        notes.append(f"axis {', '.join(still)} left out: {', '.join(positions[a] for a in still)} does not move")
    return moving or tuple(common)


def _values(recording: Recording, name: str) -> Array:
    if name in recording.channels:
        return recording[name].values[:, 0]
    channel = recording[scalars_of(recording)[name]]
    return channel.values[:, channel.axes.index(name.rsplit(".", 1)[-1])]


def _channel_of(recording: Recording, expressions: Iterable[str]) -> str | None:
    """The one channel that all expressions are of."""
    scalars = scalars_of(recording)
    found = set()
    for expression in expressions:
        name = sign_and_name(expression, [*recording.channels, *scalars])[1]
        found.add(name if name in recording.channels else scalars.get(name))
    return found.pop() if len(found) == 1 else None


def _sources(recording: Recording, columns: Columns) -> dict[str, str]:
    """Kind -> the channel that is, or becomes, the hand's."""
    found = {kind: _channel_of(recording, expressions) for kind, expressions in columns.mapped.items()}
    found |= {kind: name for kind, name in NAME.items() if kind not in found and name in recording}
    return {kind: name for kind, name in found.items() if name}


def _sister(name: str, *leaves: str) -> list[str]:
    return [f"{name.rsplit('.', 1)[0]}.{leaf}" for leaf in leaves]


def _orientation_of(recording: Recording, position: str) -> str | None:
    """The quaternion that lies beside a position: pose.orientation, transform.rotation."""
    names = [*_sister(position, "orientation", "rotation"), *([ORIENTATION] if position == NAME["position"] else [])]
    return next((n for n in names if n in recording and set(recording[n].axes) == set("wxyz")), None)


def _one_frame(path: Path, recording: Recording, columns: Columns, turns: Sequence[Transforms], notes: list[str]) -> Recording:
    """Every vector of the hand in the frame of its position."""
    sources = _sources(recording, columns)
    if "position" not in sources:
        return recording
    into = recording[sources["position"]]
    at = _orientation_of(recording, sources["position"])
    names = {kind: n for kind, n in sources.items() if kind != "position"}
    force = sources.get("force") or sources.get("sensor_force")
    names |= dict.fromkeys(("torque",), torque[0]) if force and (torque := _torque_of(recording, force)) else {}
    changed = {
        name: turned(
            path, recording[name], into, f"{kind} {name}", stated=columns.frames, turns=turns,
            orientation=recording[at] if at else None, notes=notes,
        )
        for kind, name in names.items()
    }  # fmt: skip
    return recording.with_channels(changed)


def _torque_of(recording: Recording, force: str) -> list[str]:
    names = [TORQUE] if force in NAME.values() else _sister(force, "torque")
    return [n for n in names if n in recording and recording[n].unit == "N m"]


def _beside(recording: Recording, columns: Columns, notes: list[str]) -> dict[str, Channel]:
    """hand.orientation and hand.torque where they lie beside the position and the force that were chosen."""
    found: dict[str, Channel] = {}
    sources = _sources(recording, columns)
    if ORIENTATION not in recording and "position" in sources and (name := _orientation_of(recording, sources["position"])):
        found[ORIENTATION] = recording[name]
        notes.append(f"{name} taken as {ORIENTATION}")
    force = sources.get("force") or sources.get("sensor_force")
    for name in _torque_of(recording, force) if force and TORQUE not in recording else ():
        found[TORQUE] = recording[name]
        notes.append(f"{name} taken as {TORQUE}")
    return found


def finished(path: Path, recording: Recording, columns: Columns) -> Recording:
    """The recording under its mapping, on the clock that was asked for."""
    return remapped(path, restamped(path, recording, columns), replace(columns, time=None))


def restamped(path: Path, recording: Recording, columns: Columns) -> Recording:
    """Frame i at i / rate, where time="none" asks for it. One rate cannot hold for channels of different numbers of frames."""
    if columns.time is None or columns.time in CLOCKS:
        return recording
    if columns.time != "none":
        raise ParameterError(
            f"{path}: time {columns.time!r}: its channels have stamps of their own; allowed: {', '.join(CLOCKS)} in a bag, "
            "or none with a rate (rate_hz=...)"
        )
    if columns.rate_hz is None:
        raise ParameterError(f'{path}: time="none" ignores the stamps: state the rate (rate_hz=...)')
    sources = list(_sources(recording, columns).values())
    sources += [n for e in columns.extra.values() if (n := _channel_of(recording, e))]
    counts = {n: len(recording[n].time) for n in sources}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{n} {count}" for n, count in counts.items())
        raise ChannelError(
            f'{path}: time="none" gives all channels one rate, and they have different numbers of frames ({listed})'
        )
    note = f"the file's stamps are ignored, as asked: frame i is taken to be at i / {columns.rate_hz:g} s"
    rate = columns.rate_hz
    again = {n: replace(c, time=np.arange(len(c.time)) / rate) for n, c in recording.channels.items() if n != EVENTS}
    return recording.with_channels(again).with_metadata(notes=[*recording.metadata.get("notes", ()), note])
