"""From a Recording to a Demonstration: one rate, interaction force, nothing missing, every step in the notes."""

from __future__ import annotations

import warnings
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..errors import ChannelError, ParameterError, RecordingError, given
from ..interaction import Payload, gravity_along, interaction_force
from ..interfaces import Array
from ..recording import Channel, Recording, check_role
from ..signals.filters import MAX_CUTOFF, differentiate, integrate, smooth
from .agreement import check_set, listed, noted, require
from .cuts import between, merged, trimmed
from .faults import (
    MAX_RATE_RATIO,
    Plausible,
    check_period,
    check_plausible,
    check_unit,
    check_velocity,
    cleaned,
    gap_message,
    gaps,
    say_bridged,
    suspect,
)
from .forces import Bias, check_force, check_sensor, known_bias, stated_bias, stated_gravity, tared
from .jumps import check_jumps
from .lesson import ORDER, Demonstration, unused
from .orientations import VECTOR, angular_velocity, is_quaternion, oriented, turning, unit
from .stamps import one_rate

__all__ = ["Demonstration", "Preparation", "check_set", "demonstration", "demonstrations", "require"]

DERIVED = "velocity derived from position"  # begins the note of a lesson whose velocity was not recorded
_KIND = {"position": "position", "velocity": "velocity", "force": "force", "sensor_force": "force"}


@dataclass(frozen=True)
class Preparation:
    """How recordings become demonstrations; every choice has a default that changes nothing unasked.

    rate_hz             the one rate; default: the rate that the mapping stated, else the slowest channel's own
    cutoff_hz           low-pass for derivatives and for F_s and a in eq. (3) [Hz]
    trim_rest_s         keep at most this much rest at start and end [s]; None keeps all
    payload, load_share eq. (3) for recordings of the raw F_s: the object, and this hand's share of it; default: what
                        the recording states (metadata load_mass_kg or payload, load_share), else a share of 1/2
    gravity             (d,) [m/s^2]; default: what the recording states (metadata gravity_m_per_s2), else down along "z"
    force_bias_n        (d,) what the sensor reads when nothing pulls [N]: subtracted from the force, and said
    tare                take that bias from the rest before the motion instead, for each recording
    drop_bad            drop frames that are not finite instead of refusing the file
    split_gaps          one demonstration for each piece between gaps (see `demonstrations`)
    integrate_position  make up a missing position from the velocity, starting at 0
    role                "leader", "follower" or "natural": what recordings that state none are of; must agree with the others' own
    extra               further channels to carry along; columns w, x, y, z are quaternions and treated as such
    orientation         carry hand.orientation along: "orientation" (T, 4: w, x, y, z, of length 1, one sign), its
                        "angular_velocity" (T, 3) [rad/s, task frame], and "torque" (T, 3) [N m] where there is hand.torque
    min_frames          shortest use: K + 1 for K states
    plausible           ranges that reveal wrong units; None skips them
    """

    rate_hz: float | None = None
    cutoff_hz: float = 10.0
    trim_rest_s: float | None = None
    payload: Payload | None = None
    load_share: float | None = None
    gravity: tuple[float, ...] | None = None
    force_bias_n: tuple[float, ...] | None = None
    tare: bool = False
    drop_bad: bool = False
    split_gaps: bool = False
    integrate_position: bool = False
    role: str | None = None
    extra: tuple[str, ...] | None = None
    orientation: bool = False
    min_frames: int = 4
    plausible: Plausible | None = field(default_factory=Plausible)

    def __post_init__(self) -> None:
        check_role(self.role)
        if self.force_bias_n is not None:
            object.__setattr__(self, "force_bias_n", stated_bias(self.force_bias_n, self.tare))
        if self.rate_hz is not None and not 0.0 < self.rate_hz <= 50_000.0:
            raise ParameterError(f"rate_hz is {self.rate_hz:g}; allowed: 0 < rate_hz <= 50000 Hz")
        if not self.cutoff_hz > 0.0:
            raise ParameterError(f"cutoff_hz is {self.cutoff_hz:g}; allowed: > 0 Hz")
        if self.trim_rest_s is not None and not self.trim_rest_s >= 0.0:
            raise ParameterError(f"trim_rest_s is {self.trim_rest_s:g}; allowed: >= 0 s, or None to keep all rest")
        if self.load_share is not None and not 0.0 <= self.load_share <= 1.0:
            raise ParameterError(f"load_share is {self.load_share:g}; allowed: 0 to 1")


def demonstration(recording: Recording, preparation: Preparation | None = None, **changes: Any) -> Demonstration:
    """One lesson from one recording, checked and prepared as `Preparation` (or single fields of it) says.

    Raises RecordingError for data that cannot be used as it is, ChannelError for what is missing.
    """
    (recording,) = listed([recording], Recording, "a recording, as read(path)[0] gives it")
    pieces = _pieces(recording, _changed(preparation, changes))
    if len(pieces) > 1:
        raise RecordingError(f"{_where(recording)}: split_gaps makes {len(pieces)} demonstrations of it; call demonstrations()")
    return pieces[0]


def demonstrations(
    recordings: Iterable[Recording], preparation: Preparation | None = None, **changes: Any
) -> tuple[Demonstration, ...]:
    """Lessons that fit together: prepared at one rate (the slowest one's, unless stated) and checked as a set."""
    recordings = listed(recordings, Recording, "a list of recordings, as read(path) gives it")
    chosen = _changed(preparation, changes)
    if not recordings:
        raise RecordingError("no recordings; give at least one")
    lessons = [lesson for recording in recordings for lesson in _pieces(recording, chosen)]
    slowest = max(lesson.dt for lesson in lessons)
    fastest = min(lesson.dt for lesson in lessons)
    if slowest > fastest * MAX_RATE_RATIO * (1 + 1e-9):
        raise RecordingError(
            f"lessons at {1 / fastest:g} Hz and {1 / slowest:g} Hz: more than {MAX_RATE_RATIO:g} times apart; "
            "leave one out or state rate_hz"
        )
    if slowest != fastest:
        common = replace(chosen, rate_hz=1.0 / slowest)
        lessons = _again(recordings, common, {note for lesson in lessons for note in lesson.notes})
    return noted(lessons, check_set(lessons, role=chosen.role))


def _again(recordings: Sequence[Recording], common: Preparation, said: Container[str]) -> list[Demonstration]:
    """Lessons prepared a second time, at one rate: what was `said` the first time is not said again."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lessons = [lesson for recording in recordings for lesson in _pieces(recording, common)]
    for warning in caught:
        if str(warning.message) not in said:
            warnings.warn(warning.message, stacklevel=3)
    return lessons


def _changed(preparation: Preparation | None, changes: Mapping[str, Any]) -> Preparation:
    known = [f.name for f in fields(Preparation)]
    for name in changes:
        if name not in known:
            raise ParameterError(f"no option {name!r} of a preparation; there are: {', '.join(known)}")
    if preparation is not None and not isinstance(preparation, Preparation):
        raise ParameterError(f"the preparation is {given(preparation)}; allowed: a Preparation, or its fields by name")
    return replace(preparation or Preparation(), **changes)


def _where(recording: Recording) -> str:
    source, name = (" ".join(str(recording.metadata.get(k, "")).splitlines()) for k in ("source", "name"))
    return f"{source} ({name})" if source and name.endswith("]") else source or name or "recording"


def _pieces(recording: Recording, chosen: Preparation) -> list[Demonstration]:
    where, notes = _where(recording), [str(n) for n in recording.metadata.get("notes", ())]
    role = _role(recording, where, chosen.role, notes)
    if reason := recording.metadata.get("incomplete"):
        suspect(notes, f"{where}: the take is incomplete ({reason}): leave it out, or be sure that it holds the whole task")
    if chosen.payload is None and "hand.force" not in recording:
        chosen = replace(chosen, payload=_stored_payload(recording))
    if chosen.load_share is None:
        chosen = replace(chosen, load_share=float(recording.metadata.get("load_share", 0.5)))
    if chosen.gravity is None and "gravity_m_per_s2" in recording.metadata:
        chosen = replace(chosen, gravity=stated_gravity(recording, _where(recording)))
    channels = _channels(recording, where, chosen, notes)
    asked = chosen.rate_hz or recording.metadata.get("rate_hz")
    holes = {name: gaps(channel, 1.0 / asked if asked else 0.0) for name, channel in channels.items()}
    for name, found in holes.items():
        if found and not chosen.split_gaps:
            raise RecordingError(gap_message(f"{where}: {name}", found[0], len(found)))
        say_bridged(f"{where}: {name}", channels[name], 1.0 / asked if asked else 0.0, notes)
    cuts = merged(sorted((before, after) for found in holes.values() for _, before, after in found))
    starts, stops = [-np.inf, *(after for _, after in cuts)], [*(before for before, _ in cuts), np.inf]
    pieces: list[Demonstration] = []
    bias: Bias | None = None
    title = str(recording.metadata.get("name", "")) or "recording"
    for i, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        part = {n: between(c, start, stop) for n, c in channels.items()}
        if cuts and min(len(c.time) for c in part.values()) < max(chosen.min_frames, 8):
            suspect(notes, f"{where}: piece {i} between gaps is too short and left out")
            continue
        told = [*notes]
        dt, signals, units, axes = _signals(recording, part, chosen, told, where)
        if "force" in signals:
            bias = bias or _bias_of(where, signals, dt, units, chosen)
            signals["force"] = bias.taken_off(signals["force"], told)
            check_force(where, signals["force"], signals["velocity"], dt, role, told, (units["force"], units["velocity"]))
        name = f"{title}#{i}" if cuts else title
        pieces.append(_finished(recording, part, name, role, dt, signals, units, axes, chosen, told, where))
    if not pieces:
        raise RecordingError(f"{where}: no piece between the {len(cuts)} gaps is long enough")
    if "velocity" not in channels:
        _check_derived(where, pieces, chosen)
    return pieces


def _bias_of(where: str, signals: Mapping[str, Array], dt: float, units: Mapping[str, str], chosen: Preparation) -> Bias:
    """What is to be taken off the force: the stated bias, or the one at rest."""
    if chosen.force_bias_n is not None and chosen.payload is not None and any(chosen.payload.force_bias_n):
        raise ParameterError(f"{where}: the payload states a bias, and force_bias_n another; allowed: one of them")
    if chosen.tare:
        return tared(where, signals["force"], signals["velocity"], dt, units["velocity"])
    return known_bias(where, chosen.force_bias_n, signals["force"].shape[1])


def _check_derived(where: str, pieces: Sequence[Demonstration], chosen: Preparation) -> None:
    """A velocity that was derived is held against what is plausible, like one that was given, over all pieces together."""
    if chosen.plausible is None:
        return
    unit, axes = pieces[0].units["velocity"], pieces[0].axes
    time = np.concatenate([piece.dt * np.arange(len(piece)) for piece in pieces])
    whole = Channel(time, np.concatenate([piece.velocity for piece in pieces]), unit, "task", axes)
    check_plausible(f"{where}: derived from position", "velocity", whole, chosen.plausible)


def _stored_payload(recording: Recording) -> Payload | None:
    """The payload that the recording states: metadata load_mass_kg, or payload {"mass_kg", "force_bias_n"}."""
    stored = recording.metadata.get("payload", {"mass_kg": recording.metadata.get("load_mass_kg")})
    if not isinstance(stored, Mapping) or stored.get("mass_kg") is None:
        return None
    bias = tuple(float(b) for b in stored.get("force_bias_n", ()))
    return Payload(float(stored["mass_kg"]), force_bias_n=bias)


def _role(recording: Recording, where: str, asked: str | None, notes: list[str]) -> str:
    written = str(recording.metadata.get("role") or "")
    if asked and written and asked != written:
        raise RecordingError(f"{where}: its role is {written!r}, {asked!r} was asked for; use lessons of that role")
    if not (asked or written):
        notes.append("the role is not stated")
    elif not written:
        notes.append(f"the role is taken to be {asked!r}: the recording states none")
    return written or asked or ""


def _channels(recording: Recording, where: str, chosen: Preparation, notes: list[str]) -> dict[str, Channel]:
    """The canonical channels and extras that are there, each checked by itself."""
    found = {n: recording[f"hand.{n}"] for n in _KIND if f"hand.{n}" in recording}
    if "force" in found and chosen.payload is not None and "sensor_force" not in found:
        raise ChannelError(
            f"{where}: a payload is given, but hand.force is the interaction force F already; map the raw F_s as sensor_force"
        )
    if "force" in found and chosen.payload is None:
        found.pop("sensor_force", None)
    extra = chosen.extra if chosen.extra is not None else tuple(recording.metadata.get("extra", ()))
    for name in extra:
        if name in _KIND:
            raise ChannelError(f"{where}: an extra channel is called {name!r}, as one of the signals; give it another name")
        found[name] = recording[name]
    if chosen.orientation:
        found |= turning(recording, where)
    if (chosen.tare or chosen.force_bias_n is not None) and not {"force", "sensor_force"} & set(found):
        there = ", ".join(recording.channels) or "nothing"
        raise ChannelError(f"{where}: there is no force to take a bias off; found {there}{unused(notes)}")
    if "position" not in found and not ("velocity" in found and chosen.integrate_position):
        ask = "; integrate_position makes one from the velocity" if "velocity" in found else ""
        ask += f"; {recording.metadata['hint']}" if recording.metadata.get("hint") else unused(notes)
        raise ChannelError(f"{where}: no 'hand.position'; found {', '.join(recording.channels) or 'nothing'}{ask}")
    for name, channel in found.items():
        at = f"{where}: {name}"
        if name in _KIND:
            check_unit(at, _KIND[name], channel)
            if not channel.frame:
                notes.append(f"{name}: no frame is stored; taken as the task frame")
        found[name] = cleaned(at, channel, drop_bad=chosen.drop_bad, min_frames=chosen.min_frames, notes=notes)
        if is_quaternion(channel):
            found[name] = oriented(at, found[name], notes)
        check_period(at, found[name])
        if name in _KIND and chosen.plausible is not None:
            check_plausible(at, _KIND[name], found[name], chosen.plausible)
    frames = {n: c.frame for n, c in found.items() if n in _KIND and c.frame}
    if len(set(frames.values())) > 1:
        listed = "; ".join(f"{n}: {f}" for n, f in frames.items())
        raise ChannelError(
            f"{where}: the signals are in different frames ({listed}); state how they lie to each other where the file is read, "
            "for example frames={'sensor': 'hand'} (--frame sensor=hand)"
        )
    axes = {n: c.axes for n, c in found.items() if n in _KIND}
    if len(set(axes.values())) > 1:
        listed = "; ".join(f"{n}: {', '.join(a)}" for n, a in axes.items())
        raise ChannelError(f"{where}: the signals have different axes ({listed}); map one column an axis in each")
    if "position" in found:
        if chosen.plausible is not None:
            check_jumps(f"{where}: position", found["position"], chosen.plausible)
        for name in ("force", "sensor_force"):
            if name in found:
                check_sensor(f"{where}: {name}", found[name], found["position"], notes)
    return found


def _signals(
    recording: Recording, channels: Mapping[str, Channel], chosen: Preparation, notes: list[str], where: str
) -> tuple[float, dict[str, Array], dict[str, str], tuple[str, ...]]:
    """(dt, signals, units, axes) at one rate, nothing missing, F from eq. (3) where it was raw."""
    dt, signals = one_rate(channels, chosen.rate_hz or recording.metadata.get("rate_hz"), where, notes)
    axes = channels["position" if "position" in channels else "velocity"].axes
    units = {n: c.unit for n, c in channels.items()}
    cutoff = _cutoff(chosen.cutoff_hz, dt, notes)
    for name in (n for n, c in channels.items() if is_quaternion(c)):
        signals[name] = unit(signals[name])
    if chosen.orientation:
        signals["angular_velocity"] = angular_velocity(signals["orientation"], dt, cutoff)
        units["angular_velocity"] = "rad/s"
        notes.append(f"angular_velocity derived from orientation: zero-phase low-pass {cutoff:.4g} Hz, turns between frames")
    _complete(signals, units, dt, cutoff, where, axes, notes)
    if "sensor_force" in signals:
        signals["force"] = _interaction(signals, dt, cutoff, chosen, axes, where, notes)
        units["force"] = units.pop("sensor_force")
        del signals["sensor_force"]
    return dt, signals, units, axes


def _finished(
    recording: Recording,
    channels: Mapping[str, Channel],
    name: str,
    role: str,
    dt: float,
    signals: dict[str, Array],
    units: Mapping[str, str],
    axes: tuple[str, ...],
    chosen: Preparation,
    notes: list[str],
    where: str,
) -> Demonstration:
    signals = trimmed(signals, dt, chosen.trim_rest_s, units["velocity"], notes)
    frames = len(signals["position"])
    if frames < chosen.min_frames:
        raise RecordingError(f"{where}: {frames} frames at {1 / dt:g} Hz; needs >= {chosen.min_frames}: record longer")
    ordered = {n: signals[n] for n in (*ORDER, *(s for s in signals if s not in ORDER)) if n in signals}
    extra_axes = {n: c.axes for n, c in channels.items() if n in ordered and n not in _KIND}
    extra_axes |= {"angular_velocity": VECTOR} if "angular_velocity" in ordered else {}
    source = str(recording.metadata.get("source", ""))
    return Demonstration(name, dt, ordered, axes, role, source, units, tuple(notes), extra_axes)


def _cutoff(cutoff_hz: float, dt: float, notes: list[str]) -> float:
    limit = 0.8 * MAX_CUTOFF / dt
    if cutoff_hz > limit:
        notes.append(f"cutoff lowered from {cutoff_hz:g} to {limit:.4g} Hz: the rate is {1 / dt:.4g} Hz")
    return min(cutoff_hz, limit)


def _complete(
    signals: dict[str, Array],
    units: dict[str, str],
    dt: float,
    cutoff: float,
    where: str,
    axes: Sequence[str],
    notes: list[str],
) -> None:
    """Derives what is missing, says so, and compares what is there."""
    if "position" not in signals:
        signals["position"] = integrate(signals["velocity"], dt)
        units["position"] = ", ".join(u.strip().removesuffix("/s") for u in units["velocity"].split(","))
        notes.append("position integrated from velocity, starting at 0, as asked")
    elif "velocity" not in signals:
        signals["velocity"] = differentiate(smooth(signals["position"], dt, cutoff), dt)
        units["velocity"] = ", ".join(u.strip() + "/s" for u in units["position"].split(","))
        notes.append(f"{DERIVED}: zero-phase low-pass {cutoff:.4g} Hz, central differences")
    else:
        position, velocity, unit = signals["position"], signals["velocity"], units["position"]
        check_velocity(where, position, velocity, dt, cutoff_hz=cutoff, axes=axes, notes=notes, unit=unit)


def _interaction(
    signals: Mapping[str, Array],
    dt: float,
    cutoff: float,
    chosen: Preparation,
    axes: Sequence[str],
    where: str,
    notes: list[str],
) -> Array:
    """Eq. (3) off line: F_s and a pass one zero-phase filter."""
    payload = chosen.payload
    if payload is None:
        raise ChannelError(
            f"{where}: hand.sensor_force is raw: eq. (3) needs the payload; give payload=Payload(mass_kg=...) "
            "or identify it from a window at rest (identify_payload)"
        )
    share = 0.5 if chosen.load_share is None else chosen.load_share
    gravity = np.array(chosen.gravity) if chosen.gravity is not None else gravity_along(axes)
    bias = np.array(payload.force_bias_n) if payload.force_bias_n else np.zeros(len(axes))
    if gravity.shape != (len(axes),) or bias.shape != (len(axes),):
        raise ParameterError(f"{where}: gravity {gravity.shape} and bias {bias.shape} need one entry an axis, {len(axes)}")
    acceleration = smooth(differentiate(signals["velocity"], dt), dt, cutoff)
    sensed = smooth(signals["sensor_force"] - bias, dt, cutoff)
    notes.append(
        f"force from eq. (3): mass {payload.mass_kg:g} kg, share {share:g}, bias {bias.tolist()} N, "
        f"zero-phase low-pass {cutoff:.4g} Hz on F_s and acceleration"
    )
    return interaction_force(sensed, acceleration, mass_kg=payload.mass_kg, load_share=share, gravity=gravity)
