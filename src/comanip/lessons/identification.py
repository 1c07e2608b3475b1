"""Everything that one recording shows of its own force, and the force that is left when all of it is taken off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import ChannelError, ParameterError
from ..formats.frames import rotate
from ..interaction import gravity_along
from ..interfaces import Array
from ..recording import Channel, Recording
from .admittance import Admittance, admittance
from .demonstration import Demonstration, Preparation, demonstration
from .wrench import Load, carried

RAW, FORCE = "hand.sensor_force", "hand.force"
ORIENTATION, TORQUE = "hand.orientation", "hand.torque"


@dataclass(frozen=True, eq=False)
class Identification:
    """What `identify` found.

    lesson    the recording at one rate, its force as recorded
    raw       whether that force is the sensor's, object included
    load      what the hand carries; None where the force is the interaction's already and the hand does not turn
    law       the admittance that explains the force best (of a raw force: what the load leaves of it); None where none was asked
    unknown   what the motion does not show, and why
    turned    (T, 4) orientation w, x, y, z, where the force was taken in a frame that turns with the hand
    """

    lesson: Demonstration
    raw: bool
    load: Load | None
    law: Admittance | None
    unknown: Mapping[str, str] = field(default_factory=dict)
    turned: Array | None = None


def identify(recording: Recording, preparation: Preparation | None = None) -> Identification:
    """Time offset, bias, load and admittance of a recording, each with its standard error, or why it cannot be known."""
    chosen = replace(preparation or Preparation(), payload=None)
    raw = RAW in recording
    if not raw and FORCE not in recording:
        raise ChannelError(
            f"there is no force to identify; found {', '.join(recording.channels) or 'nothing'}; map one with force"
        )
    lesson, q, torque = _prepared(recording, chosen, raw)
    load, turned = None, None
    if raw or q is not None:
        force = lesson.force
        if q is not None and _same_frame(recording, raw):  # back into the hand, where the sensor's own bias stands still
            force = rotate(q * [1.0, -1.0, -1.0, -1.0], force)
            torque = None if torque is None else rotate(q * [1.0, -1.0, -1.0, -1.0], torque)
        turned = q
        load = carried(
            force, lesson.velocity, lesson.dt, gravity=_gravity(lesson, chosen), orientation=q, torque=torque,
            cutoff_hz=chosen.cutoff_hz,
        )  # fmt: skip
        if not raw and (load.mass_kg is None or load.r2 < 0.5):
            load = None  # an interaction force that holds no weight any more
    found = Identification(lesson, raw, load, None, {} if load is None else load.unknown, turned if load is not None else None)
    return _with_law(found, chosen)


def _with_law(found: Identification, chosen: Preparation) -> Identification:
    lesson = (
        found.lesson if found.load is None else replace(found.lesson, signals={**found.lesson.signals, "force": _left(found)})
    )
    try:
        law = admittance(lesson, cutoff_hz=chosen.cutoff_hz)
    except ParameterError as refused:
        return replace(found, unknown={**found.unknown, "admittance": str(refused)})
    why = {}
    if not law.offset_known and (found.load is None or found.load.offset_s is None):
        why["offset"] = (
            f"no linear law links this force and this motion sharply enough (R² {law.r2:.2f})"
            if not law.explains
            else "the motion is too even: a shift looks like another mass or damping"
        )
    if law.stiffness is not None:
        why["bias"] = "with a spring, a bias and its rest position are one number; let go once and use --tare"
    return replace(found, law=law, unknown={**found.unknown, **why})


def _prepared(recording: Recording, chosen: Preparation, raw: bool) -> tuple[Demonstration, Array | None, Array | None]:
    """(lesson whose force is the recorded one, orientation, torque) on one grid."""
    channels = {n: c for n, c in recording.channels.items() if n not in (RAW, FORCE)}
    channels[FORCE] = recording[RAW if raw else FORCE]
    extra = [n for n in (ORIENTATION, TORQUE) if n in recording and channels[FORCE].values.shape[1] == 3]
    if ORIENTATION in extra:
        channels[ORIENTATION] = _unwrapped(recording[ORIENTATION])
    metadata = {k: v for k, v in recording.metadata.items() if k not in ("load_mass_kg", "payload", "extra")}
    lesson = demonstration(Recording(channels, metadata), replace(chosen, extra=tuple(extra)))
    q = lesson.signals.get(ORIENTATION)
    if q is not None:
        order = (
            [recording[ORIENTATION].axes.index(a) for a in "wxyz"]
            if set("wxyz") <= set(recording[ORIENTATION].axes)
            else [0, 1, 2, 3]
        )
        q = np.asarray(q[:, order] / np.linalg.norm(q, axis=1, keepdims=True))
    return lesson, q, lesson.signals.get(TORQUE)


def _unwrapped(channel: Channel) -> Channel:
    """q and -q are one turn: signs that do not jump, so that what lies between two samples is a turn as well."""
    flips = np.where((channel.values[1:] * channel.values[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return replace(channel, values=channel.values * np.concatenate([[1.0], np.cumprod(flips)])[:, None])


def _same_frame(recording: Recording, raw: bool) -> bool:
    frame = recording[RAW if raw else FORCE].frame
    return bool(frame) and frame == recording["hand.position"].frame


def _gravity(lesson: Demonstration, chosen: Preparation) -> Array:
    return np.array(chosen.gravity) if chosen.gravity is not None else gravity_along(lesson.axes)


def _left(found: Identification) -> Array:
    """(T, d) the force that the load leaves, in the position's frame."""
    assert found.load is not None
    rest = found.load.residual
    return rest if found.turned is None else rotate(found.turned, rest)


def interaction_only(found: Identification) -> Recording:
    """The recording on one clock, with `hand.force` as what somebody exerts and `hand.force_recorded` as it was; every step in
    its notes. Taken off is what is known: the load, the bias, the offset; what is not is left in and said."""
    lesson, notes = found.lesson, list(found.lesson.notes)
    time: Array = lesson.dt * np.arange(len(lesson), dtype=np.float64)
    force = lesson.force if found.load is None else _left(found)
    if found.load is not None and found.load.mass_kg is not None:
        notes.append(f"force: load of {found.load.mass_kg[0]:.4g} kg, its inertia and the sensor's bias taken off, as identified")
    elif found.raw:
        notes.append("force: the load could not be identified; only its mean and what follows the acceleration are taken off")
    if found.load is None and found.law is not None:
        force = _on_the_clock(force, time, found.law, notes)
    clean = {
        f"hand.{n}": Channel(time, v, lesson.units.get(n, ""), "task", lesson.signal_axes[n])
        for n, v in lesson.signals.items()
        if n in ("position", "velocity")
    }
    unit = lesson.units.get("force", "")
    clean[FORCE] = Channel(time, force, unit, "task", lesson.axes)
    clean["hand.force_recorded"] = Channel(time, lesson.force, unit, "task", lesson.axes)
    return Recording(clean, {"name": lesson.name, "role": lesson.role, "source": lesson.source, "notes": notes})


def _on_the_clock(force: Array, time: Array, law: Admittance, notes: list[str]) -> Array:
    """The force at the motion's stamps, and without the bias that the law shows."""
    if law.offset_known and abs(law.offset.value) > 3.0 * law.offset.error:
        force = np.stack([np.interp(time + law.offset.value, time, column) for column in force.T], axis=1)
        notes.append(f"force: moved by {-1e3 * law.offset.value:.3g} ms onto the motion's clock, as identified")
    if law.explains and law.stiffness is None:
        bias = np.array([t.value if t.sure else 0.0 for t in law.bias])
        force = force - bias
        if bias.any():
            notes.append(f"force: bias {', '.join(f'{b:.3g}' for b in bias)} subtracted, as identified")
    return force
