"""Columns: which columns of a foreign file are position, velocity, force and time; their units and signs."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ..errors import ChannelError, ParameterError, given
from ..interfaces import STANDARD_GRAVITY
from ..recording import check_role

# unit -> (SI symbol, factor)
UNITS: dict[str, tuple[str, float]] = {
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6), "in": ("m", 0.0254),
    "rad": ("rad", 1.0), "deg": ("rad", 0.017453292519943295),
    "m/s": ("m/s", 1.0), "cm/s": ("m/s", 1e-2), "mm/s": ("m/s", 1e-3),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", 0.017453292519943295), "rpm": ("rad/s", 0.10471975511965977),
    "N": ("N", 1.0), "mN": ("N", 1e-3), "kN": ("N", 1e3),
    "gf": ("N", 1e-3 * STANDARD_GRAVITY), "kgf": ("N", STANDARD_GRAVITY), "lbf": ("N", 4.4482216152605),
    "N m": ("N m", 1.0), "mN m": ("N m", 1e-3),
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "ns": ("s", 1e-9),
    "min": ("s", 60.0), "h": ("s", 3600.0), "d": ("s", 86400.0),
}  # fmt: skip
ALIASES = {
    "nm": "N m", "n·m": "N m", "n*m": "N m", "n m": "N m", "mnm": "mN m", "newton": "N", "newtons": "N", "n": "N",
    "metre": "m", "meter": "m", "metres": "m", "meters": "m", "g": "gf", "kg": "kgf", "°": "deg", "degrees": "deg",
    "radians": "rad", "µm": "um", "µs": "us", "sec": "s", "seconds": "s", "°/s": "deg/s", "m·s-1": "m/s",
}  # fmt: skip
KINDS = {  # what a signal of each kind may be measured in, the default first
    "time": ("s",),
    "position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "force": ("N", "N m"),
}
NAME = {
    "position": "hand.position",
    "velocity": "hand.velocity",
    "force": "hand.force",
    "sensor_force": "hand.sensor_force",
}


UNUSED = "are not used: name them to use them"  # ends the note that lists columns which nobody asked for


def to_si(unit: str, kind: str) -> tuple[str, float]:
    """(SI symbol, factor) of a unit; ParameterError names the units that a `kind` of signal may have."""
    found = UNITS.get(unit) or UNITS.get(ALIASES.get(unit.strip().lower(), ""))
    if found is None or found[0] not in KINDS[kind]:
        allowed = [u for u, (si, _) in UNITS.items() if si in KINDS[kind]]
        raise ParameterError(f"{kind} unit {unit!r} is not known; allowed: {', '.join(allowed)}")
    return found


def units_of_axes(unit: str, kind: str, n_axes: int) -> tuple[tuple[str, float], ...]:
    """(SI symbol, factor) of each axis, from one unit for all, "mm", or one an axis, "m, m, deg"; ParameterError."""
    parts = [part.strip() for part in unit.split(",")]
    if len(parts) not in (1, n_axes):
        raise ParameterError(f"{kind} unit {unit!r} states {len(parts)} units for {n_axes} axes; allowed: one, or one an axis")
    return tuple(to_si(part, kind) for part in (parts if len(parts) > 1 else parts * n_axes))


def joined(units: Iterable[str]) -> str:
    """The units of several axes as one text: "m" when they are alike, else "m, m, rad"."""
    units = tuple(units)
    return units[0] if len(set(units)) == 1 else ", ".join(units)


def split_columns(text: str | Iterable[str]) -> tuple[str, ...]:
    """Column expressions from "z", "x,y,z" or several of them; commas inside [...] do not split."""
    items = (text,) if isinstance(text, str | int) else tuple(text)
    return tuple(part.strip() for item in items for part in re.split(r",(?![^\[]*\])", str(item)) if part.strip())


@dataclass(frozen=True)
class Columns:
    """The mapping every command offers as flags. Empty means: recognise what is obvious, and say it.

    position, velocity, force   column expressions, one an axis; `force` is the interaction force F of eq. (3)
    sensor_force                columns of the raw F_s (object on hand); eq. (3) is applied by `demonstration`
    time, time_unit             column of the stamps; "none" ignores the file's stamps; default: t, time or timestamp
    rate_hz                     without stamps: frame i is at i / rate_hz; with stamps: the rate to resample to
    role                        "leader", "follower" ...: what the hand's teacher did
    extra                       further channels: name -> columns
    axes                        names of the axes; default: the last letters of the columns when they are x, y, z
    frames                      how another frame lies in the position's: frame_id -> "same", "hand" (it turns as the recorded
                                orientation does) or a quaternion "w,x,y,z"; see `frames`
    segment_by                  columns of labels (trial, task, target ...): a file is cut into one recording wherever one of them
                                changes; "task=1" keeps only what has that value
    ..._unit                    the file's unit when it is not SI (mm, deg, gf ...): converted, and said; one for all axes, or
                                one an axis ("m, m, deg")

    An expression is a CSV header, a 0-based column index, or, in .mat and .npz, a path with indices such as
    `scope.signals[1].values[:,0]`; a leading "-" flips the sign; a unit may stand behind it, "yaw [deg]".
    Naming any of position, velocity, force or sensor_force turns recognition off.
    """

    position: tuple[str, ...] = ()
    velocity: tuple[str, ...] = ()
    force: tuple[str, ...] = ()
    sensor_force: tuple[str, ...] = ()
    time: str | None = None
    rate_hz: float | None = None
    role: str | None = None
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    axes: tuple[str, ...] = ()
    position_unit: str | None = None
    velocity_unit: str | None = None
    force_unit: str | None = None
    time_unit: str | None = None
    frames: Mapping[str, str] = field(default_factory=dict)
    segment_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "force", "sensor_force", "axes", "segment_by"):
            object.__setattr__(self, name, split_columns(getattr(self, name)))
        extra = {str(name): split_columns(columns) for name, columns in dict(self.extra).items()}
        object.__setattr__(self, "extra", MappingProxyType(extra))
        object.__setattr__(self, "frames", MappingProxyType({str(k): str(v) for k, v in dict(self.frames).items()}))
        if self.rate_hz is not None and not (isinstance(self.rate_hz, int | float) and 0.0 < self.rate_hz < 1e6):
            raise ParameterError(f"rate_hz is {given(self.rate_hz)}; allowed: 0 < rate_hz < 1e6 Hz")
        for kind in KINDS:
            if (unit := getattr(self, f"{kind}_unit")) is not None:
                for part in str(unit).split(","):
                    to_si(part.strip(), kind)
        check_role(self.role)
        if len(set(self.axes)) != len(self.axes):
            raise ParameterError(f"axes {self.axes} repeat a name")

    @property
    def mapped(self) -> dict[str, tuple[str, ...]]:
        """Kind -> expressions, of the canonical signals that were named."""
        return {kind: getattr(self, kind) for kind in NAME if getattr(self, kind)}

    def unit(self, kind: str) -> str | None:
        """The unit that was stated for a kind of signal ("position", "force", ...); None where none was."""
        return getattr(self, f"{'force' if kind == 'sensor_force' else kind}_unit", None)


def sign_and_name(expression: str, available: Iterable[str]) -> tuple[float, str]:
    """A leading "-" flips the sign, unless a column is really called so."""
    if expression.startswith("-") and expression not in set(available):
        return -1.0, expression[1:].strip()
    return 1.0, expression


_UNIT_AFTER = re.compile(r"(.*\S)\s*\[([^\]\d:]+)\]")


def with_units(columns: Columns, available: Iterable[str], where: str) -> Columns:
    """`columns` with the units that stand behind its expressions, "yaw_pos [deg]", taken off them and stated.

    A column that is really called "z [mm]" keeps its name. Raises ChannelError where only some of the columns of a signal have
    one, or the signal's unit is stated besides.
    """
    names = set(available)
    changes: dict[str, Any] = {}
    for kind, expressions in columns.mapped.items():
        cut = [_unit_after(expression, kind, names) for expression in expressions]
        units = [unit for _, unit in cut]
        if not any(units):
            continue
        stated = columns.unit(kind)
        if stated or not all(units):
            what = f"and {kind}_unit says {stated}" if stated else "and others have none"
            raise ChannelError(
                f"{where}: {kind} {', '.join(expressions)}: a unit stands behind a column, {what}; state each once"
            )
        changes |= {kind: tuple(name for name, _ in cut)}
        changes[f"{'force' if kind == 'sensor_force' else kind}_unit"] = units[0] if len(set(units)) == 1 else ", ".join(units)
    return replace(columns, **changes)


def has_unit(expressions: str) -> bool:
    """Whether a unit stands behind any of the expressions, "x [mm],y [mm]"."""
    return any(_UNIT_AFTER.fullmatch(one) for one in split_columns(expressions))


def _unit_after(expression: str, kind: str, names: set[str]) -> tuple[str, str]:
    match = _UNIT_AFTER.fullmatch(expression)
    if match is None or sign_and_name(expression, names)[1] in names:
        return expression, ""
    try:
        to_si(match[2].strip(), "force" if kind == "sensor_force" else kind)
    except ParameterError:
        return expression, ""
    return match[1], match[2].strip()


def unknown(what: str, name: str, available: Iterable[str]) -> ChannelError:
    """An error that lists what there is, the likely one first."""
    names = [n for n in dict.fromkeys(available) if n]
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    lowered = {n.lower(): n for n in names}
    close = close or [lowered[n] for n in difflib.get_close_matches(name.lower(), lowered, n=1, cutoff=0.5)]
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    shown = ", ".join(names[:40]) + (f" and {len(names) - 40} more" if len(names) > 40 else "")
    return ChannelError(f"{what}: no column {name!r}{hint} there are: {shown or 'none'}")


def unit_in(header: str) -> tuple[str, str]:
    """("z", "mm") from "z [mm]", "z (mm)" or "z_mm"; the unit is "" when the header states none."""
    for pattern in (
        r"^(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]$",
        r"^(.+?)_((?:mm|cm|m|deg|rad)_s|mm|cm|m|ms|us|ns|deg|rad|mn|kn|n|kgf|gf|lbf)$",
    ):
        match = re.match(pattern, header.strip(), re.IGNORECASE)
        if match:
            unit = match[2].strip().replace("_s", "/s")
            known = unit in UNITS or unit.lower() in ALIASES or unit.lower() in UNITS
            if known:
                return match[1].strip(), unit if unit in UNITS else ALIASES.get(unit.lower(), unit.lower())
    return header.strip(), ""


_PATTERNS = {
    "position": r"^(?:hand[._])?(?:(?:position|pos|p)[_. ]?)?([xyz])$|^(?:hand[._])?(?:position|pos|height)$",
    "velocity": r"^(?:hand[._])?(?:velocity|vel|v|d)[_. ]?([xyz])$|^([xyz])[_. ]?(?:dot|d)$"
    r"|^(?:hand[._])?(?:velocity|vel)$",
    "force": r"^(?:hand[._])?(?:force|f)[_. ]?([xyz])$|^(?:hand[._])?(?:force|f)$",
}
# without blanks and underlines: "time_s" is "times"
TIME_NAMES = ("t", "time", "timestamp", "timestamps", "stamp", "seconds", "sec", "times", "ts", "unixtime", "epoch")


def recognise_time(names: Iterable[str]) -> str | None:
    """The column that obviously holds the stamps; None when there is none, ChannelError when there are two."""
    hits = [n for n in names if re.sub(r"[ _\-]", "", unit_in(n)[0].lower()) in TIME_NAMES]
    if len(hits) > 1:
        raise ChannelError(f"columns {', '.join(hits)} could all be the time; say which with time=")
    return hits[0] if hits else None


def recognise(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Obvious columns: kind -> axis -> column ("" is the axis of a bare name such as "force")."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        bare = unit_in(name)[0].lower()
        for kind, pattern in _PATTERNS.items():
            match = re.match(pattern, bare)
            if match:
                axis = next((g for g in match.groups() if g), "")
                if axis in found.setdefault(kind, {}):
                    raise ChannelError(f"columns {found[kind][axis]!r} and {name!r} could both be the {kind}; say which")
                found[kind][axis] = name
    return found


_ANGLE = re.compile(
    r"(?:^|[^a-z])(?:yaw|pitch|roll|rpy|theta|phi|psi|angles?|angular|rot(?:ation)?|heading|hinge|joints?|q|eul(?:er)?|r[xyz]|w[xyz])"
    r"(?:$|[^a-z])"
)


def is_angle(column: str) -> bool:
    """Whether a column is by its name about turning: yaw, rz, theta_z, joint_3, wz."""
    return _ANGLE.search(unit_in(column.strip("'\" -"))[0].lower()) is not None


def axes_of(columns: Iterable[str], n_axes: int) -> tuple[tuple[str, ...], bool]:
    """(names of the axes, whether they were only assumed).

    The last letters of the columns when those are distinct among x, y, z; their own names where one of them turns (yaw);
    else, assumed, z, or x, y, or x, y, z.
    """
    names = [unit_in(c.strip("'\" -"))[0].lower() for c in columns]
    letters = ["" if is_angle(name) else name[-1:] for name in names]
    if len(names) == n_axes and len(set(letters)) == n_axes and set(letters) <= set("xyz"):
        return tuple(letters), False
    if len(names) == n_axes and any(is_angle(name) for name in names):
        own = [
            letter if letter in tuple("xyz") else re.split(r"[./ ]", name)[-1]
            for letter, name in zip(letters, names, strict=True)
        ]
        return (tuple(own) if len(set(own)) == n_axes else tuple(str(i) for i in range(n_axes))), False
    return {1: ("z",), 2: ("x", "y"), 3: ("x", "y", "z")}.get(n_axes, tuple(str(i) for i in range(n_axes))), True


def note(metadata: Mapping[str, Any], *more: str) -> list[str]:
    return [*metadata.get("notes", ()), *(m for m in more if m)]
