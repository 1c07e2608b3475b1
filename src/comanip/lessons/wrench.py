"""What a wrist sensor carries, from the motion itself: mass, centre of mass, bias, gravity's direction and the sensor's mount.

    F_s = C R' m (g - a) + b_f        the force of the object ON THE HAND, R the hand's orientation, C the sensor's in the hand
    T_s = c x (F_s - b_f) + b_t       its torque, c the centre of mass in the sensor's frame

Only what the motion shows can be known. Without rotation the weight and a bias along gravity are one number, and where nothing
accelerates either, the mass is not to be had at all: `Load.unknown` says what, and why.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import ParameterError
from ..formats.frames import rotate
from ..interfaces import STANDARD_GRAVITY, Array
from ..signals.filters import MAX_CUTOFF, differentiate, smooth
from ..signals.links import Link, linked

REACH_S = 0.2
TURNED_RAD = 0.35  # root of the mean squared turn from the mean orientation that tells weight from bias: 20 degrees
EXPLAINED = 0.8  # R² from which the object explains the force: a partner who pulls as well leaves the rest
LEAST_MOUNT_RAD = 0.05  # a smaller turn of the sensor in the hand is how well it was screwed on
SURE = 5.0  # a mass is known when it is so many standard errors


@dataclass(frozen=True, eq=False)
class Load:
    """What is known (value and standard error, SI); None where the motion does not show it, and `unknown` says why.

    mass_kg         what this hand carries: its share of the object
    bias            (3,) or (d,) force with nothing in the hand
    gravity         (3,) m/s² in the frame of the position, from the force alone
    centre_m        (3,) centre of mass in the sensor's frame; torque_bias with it
    mount           (3, 3) turns vectors of the hand's frame into the sensor's, and its angle
    offset_s        how much later force is stamped than motion
    r2, residual    share of the force explained; (T, d) the rest: what somebody else exerts, in the sensor's frame
    """

    mass_kg: tuple[float, float] | None
    bias: tuple[Array, Array] | None
    r2: float
    residual: Array
    offset_s: tuple[float, float] | None = None
    gravity: tuple[Array, Array] | None = None
    mount: Array | None = None
    mount_angle_rad: tuple[float, float] | None = None
    centre_m: tuple[Array, Array] | None = None
    torque_bias: tuple[Array, Array] | None = None
    unknown: Mapping[str, str] = field(default_factory=dict)


def carried(
    force: Array,
    velocity: Array,
    dt: float,
    *,
    gravity: Array,
    orientation: Array | None = None,
    torque: Array | None = None,
    cutoff_hz: float = 10.0,
) -> Load:
    """From force (T, d) as the sensor gives it, velocity (T, d) and gravity (d,) in the task's frame.

    orientation  (T, 4) w, x, y, z of the hand: the force is in a frame that turns with it. Without one the sensor does not turn,
                 and its axes are those of the position
    torque       (T, 3) in the force's frame
    """
    _three_axes(force, orientation, torque)
    cutoff = min(cutoff_hz, 0.8 * MAX_CUTOFF / dt)
    acceleration = smooth(differentiate(velocity, dt), dt, cutoff)
    sensed = smooth(force, dt, cutoff)
    if orientation is None:
        found, turn = _unturned(sensed, acceleration, dt, gravity), None
    else:
        turn = np.asarray(_continuous(orientation) * [1.0, -1.0, -1.0, -1.0])
        found = _turned(sensed, acceleration, dt, gravity, turn)
    return found if torque is None else _with_centre(found, sensed, smooth(torque, dt, cutoff), dt)


def _three_axes(force: Array, orientation: Array | None, torque: Array | None) -> None:
    if (orientation is not None or torque is not None) and force.shape[1] != 3:
        raise ParameterError(f"force has {force.shape[1]} axes; orientation and torque need x, y, z")


def _continuous(orientation: Array) -> Array:
    """Unit quaternions whose sign never jumps: q and -q are one turn, and between them lies nothing."""
    flips = np.where((orientation[1:] * orientation[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(flips)])
    q = orientation * signs[:, None]
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def turned_by(orientation: Array) -> float:
    """Root of the mean squared angle from the mean orientation [rad]."""
    q = _continuous(orientation)
    middle = np.linalg.eigh(q.T @ q)[1][:, -1]
    half = np.arccos(np.clip(np.abs(q @ middle), 0.0, 1.0))
    return float(np.sqrt((4.0 * half**2).mean()))


def _unturned(sensed: Array, acceleration: Array, dt: float, gravity: Array) -> Load:
    """F_s = -m a + (m g + b): one mass, one constant an axis."""
    d = sensed.shape[1]
    constants = np.broadcast_to(np.eye(d), (len(sensed), d, d))
    link = linked(np.concatenate([-acceleration[:, :, None], constants], axis=2), sensed, dt, reach_s=REACH_S)
    mass, error = float(link.values[0]), float(link.errors[0])
    unknown = {"centre": "the hand does not turn", "gravity": "the hand does not turn", "mount": "the hand does not turn"}
    if mass < SURE * error or mass <= 0.0:
        why = f"accelerations are too small or the force is somebody else's (m = {mass:.3g} ± {error:.2g} kg); shake the object"
        return Load(None, None, link.r2, link.residual, unknown=unknown | {"mass": why, "bias": "the mass is not known"})
    bias = link.values[1:] - mass * gravity
    errors = np.sqrt(link.errors[1:] ** 2 + (error * gravity) ** 2)
    return Load((mass, error), (bias, errors), link.r2, link.residual, _offset(link), unknown=unknown)


def _offset(link: Link) -> tuple[float, float] | None:
    known = link.r2 >= EXPLAINED and abs(link.offset_s) < 0.98 * REACH_S and link.offset_error_s < 0.02
    return (link.offset_s, link.offset_error_s) if known else None


def _turned(sensed: Array, acceleration: Array, dt: float, gravity: Array, turn: Array) -> Load:
    """Gravity free and the sensor in the hand's frame; where that fits badly, gravity given and the sensor's mount free."""
    angle = turned_by(turn)
    if angle < TURNED_RAD:
        why = f"the hand turns by {math.degrees(angle):.0f}° only; {math.degrees(TURNED_RAD):.0f}° tell weight from bias"
        pull = rotate(turn, np.tile(gravity, (len(turn), 1))).mean(axis=0)
        found = _unturned(sensed, rotate(turn, acceleration), dt, pull)
        return replace(found, unknown={**found.unknown, "centre": why, "gravity": why, "mount": why})
    straight = _free_gravity(sensed, acceleration, dt, turn)
    mounted = _free_mount(sensed, acceleration, dt, gravity, turn)
    if mounted.mount is None or mounted.mount_angle_rad is None:
        return straight
    angle, error = mounted.mount_angle_rad
    better = mounted.r2 - straight.r2 > 0.2 * (1.0 - straight.r2)
    return mounted if better and angle > max(LEAST_MOUNT_RAD, 3.0 * error) else straight


def _free_gravity(sensed: Array, acceleration: Array, dt: float, turn: Array) -> Load:
    """F_s = R' w - m R' a + b with w = m g: linear in w, m, b. The mass is that of the weight, |w| / g0."""
    basis = np.stack([rotate(turn, np.tile(axis, (len(turn), 1))) for axis in np.eye(3)], axis=2)  # R', (T, 3, 3)
    constants = np.broadcast_to(np.eye(3), basis.shape)
    inertial = np.einsum("tij,tj->ti", basis, acceleration) / STANDARD_GRAVITY
    link = linked(np.concatenate([basis, constants], axis=2), sensed, dt, reach_s=REACH_S)
    for _ in range(
        3
    ):  # |w| = u w along the direction u of the last round: hands accelerate far less than g, so it settles at once
        u = link.values[:3] / np.linalg.norm(link.values[:3])
        columns = np.concatenate([basis - inertial[:, :, None] * u, constants], axis=2)
        link = linked(columns, sensed, dt, reach_s=REACH_S)
    weight = link.values[:3]
    size = float(np.linalg.norm(weight))
    direction = weight / size
    error = float(np.sqrt(((direction * link.errors[:3]) ** 2).sum()))
    across = link.errors[:3] / size * STANDARD_GRAVITY
    mass = size / STANDARD_GRAVITY
    return Load(
        (mass, error / STANDARD_GRAVITY), (link.values[3:], link.errors[3:]), link.r2, link.residual, _offset(link),
        gravity=(direction * STANDARD_GRAVITY, across), unknown={"mount": "taken to be the hand's own frame, which fits"},
    )  # fmt: skip


def _free_mount(sensed: Array, acceleration: Array, dt: float, gravity: Array, turn: Array) -> Load:
    """F_s = G R' (g - a) + b, linear in the nine numbers of G = m C; C is the turn nearest to G."""
    pulled = rotate(turn, gravity - acceleration)
    columns = np.zeros((len(sensed), 3, 12))
    for row in range(3):
        columns[:, row, 3 * row : 3 * row + 3] = pulled
        columns[:, row, 9 + row] = 1.0
    link = linked(columns, sensed, dt, reach_s=REACH_S)
    u, s, vt = np.linalg.svd(link.values[:9].reshape(3, 3))
    if s[2] < 0.5 * s[0] or np.linalg.det(u @ vt) < 0.0:  # no turn times a mass: what pulls is not this object
        return Load(None, None, link.r2, link.residual, unknown={"mass": "the force does not turn as a weight does"})
    mount, mass = u @ vt, float(s.mean())
    error = float(np.sqrt((link.errors[:9] ** 2).mean()) / math.sqrt(3.0))
    angle = math.acos(max(-1.0, min(1.0, 0.5 * (float(np.trace(mount)) - 1.0))))
    return Load(
        (mass, error), (link.values[9:], link.errors[9:]), link.r2, link.residual, _offset(link), mount=mount,
        mount_angle_rad=(angle, float(np.sqrt((link.errors[:9] ** 2).mean())) / mass), unknown={"gravity": "as given"},
    )  # fmt: skip


def _with_centre(load: Load, sensed: Array, torque: Array, dt: float) -> Load:
    """T_s = c x f + b_t: linear in c and b_t. A force of one direction leaves c along it open."""
    if load.bias is None:
        return replace(load, unknown={**load.unknown, "centre": "the bias is not known"})
    pull = sensed - load.bias[0]
    columns = np.concatenate([_crossed(pull), np.broadcast_to(np.eye(3), (len(pull), 3, 3))], axis=2)
    link = linked(columns, torque, dt)
    shown = np.linalg.svd(columns.reshape(-1, 6) / np.sqrt((columns**2).mean(axis=(0, 1))), compute_uv=False)
    if shown[-1] < 0.02 * shown[0]:
        return replace(
            load, unknown={**load.unknown, "centre": "the weight keeps one direction in the sensor's frame: turn the hand"}
        )
    unknown = {k: v for k, v in load.unknown.items() if k != "centre"}
    return replace(
        load, centre_m=(link.values[:3], link.errors[:3]), torque_bias=(link.values[3:], link.errors[3:]), unknown=unknown
    )


def _crossed(f: Array) -> Array:
    """(T, 3, 3) with rows such that _crossed(f) @ c = c x f."""
    zero = np.zeros(len(f))
    x, y, z = f.T
    return np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
