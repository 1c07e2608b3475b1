"""People and furniture for pictures: poses as lists of simple shapes, drawn into a scene and unknown to the physics."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from ...interfaces import Array

Colour = tuple[float, float, float, float]
SKIN, HAIR, SHOE = (0.86, 0.67, 0.54, 1.0), (0.16, 0.11, 0.09, 1.0), (0.13, 0.13, 0.15, 1.0)
CLAY, SEA, TROUSERS = (0.78, 0.33, 0.24, 1.0), (0.16, 0.50, 0.53, 1.0), (0.20, 0.23, 0.30, 1.0)
WOOD, STEEL, DEVICE = (0.80, 0.70, 0.56, 1.0), (0.45, 0.47, 0.50, 1.0), (0.18, 0.19, 0.21, 1.0)
UPPER_ARM, FOREARM, THIGH, SHANK = 0.29, 0.27, 0.43, 0.43  # [m]
SHOULDER_HALF, HIP_HALF, PELVIS, SPINE = 0.185, 0.095, 0.94, 0.47


class Shape(NamedTuple):
    """A capsule from `a` to `b` of radius `size[0]`; without `b` an ellipsoid or box of half sizes `size` at `a`, turned."""

    kind: str  # "capsule", "ellipsoid", "box"
    a: Array
    size: tuple[float, ...]
    colour: Colour
    b: Array | None = None
    turn: Array | None = None  # (3, 3)


def person(hands: Array, *, at: Array, facing: float, shirt: Colour) -> list[Shape]:
    """Somebody of 1.72 m who stands `at` (2,) [m], looks along `facing` * x and holds `hands` (2, 3) [m], the right one first."""
    side = np.diag([facing, facing, 1.0])  # half a turn about the vertical
    origin = np.array([at[0], at[1], 0.0])
    grip = [(side @ (hand - origin)) for hand in hands]
    height = 0.5 * (grip[0][2] + grip[1][2])
    sink = float(np.clip(0.30 * (1.12 - height), 0.0, 0.10))
    lean = float(np.clip(0.8 * (1.22 - height), 0.03, 0.36))
    pelvis = np.array([-0.02 - 0.6 * sink, 0.0, PELVIS - sink])
    local = [*_trunk(pelvis, lean, shirt), *_head(pelvis, lean)]
    for y, hand, stagger in ((-1.0, grip[0], 0.05), (1.0, grip[1], -0.04)):
        local += _leg(pelvis, y, stagger) + _arm(pelvis, lean, y, hand, shirt)
    return [_moved(shape, side, origin) for shape in local]


def _along(pelvis: Array, lean: float, length: float) -> Array:
    return np.asarray(pelvis + length * np.array([sin(lean), 0.0, cos(lean)]))


def _pitch(angle: float) -> Array:
    return np.array([[cos(angle), 0.0, sin(angle)], [0.0, 1.0, 0.0], [-sin(angle), 0.0, cos(angle)]])


def _trunk(pelvis: Array, lean: float, shirt: Colour) -> list[Shape]:
    shoulders = _along(pelvis, lean, SPINE)
    out = np.array([0.0, SHOULDER_HALF - 0.02, 0.0])
    return [
        Shape("ellipsoid", pelvis, (0.115, 0.155, 0.115), TROUSERS, turn=_pitch(0.5 * lean)),
        Shape("ellipsoid", _along(pelvis, lean, 0.25), (0.118, 0.168, 0.255), shirt, turn=_pitch(lean)),
        Shape("capsule", shoulders - out, (0.068,), shirt, b=shoulders + out),
    ]


def _head(pelvis: Array, lean: float) -> list[Shape]:
    neck = _along(pelvis, lean, SPINE + 0.03)
    turn = _pitch(0.5 * lean)
    head = neck + turn @ np.array([0.015, 0.0, 0.165])
    return [
        Shape("capsule", neck, (0.047,), SKIN, b=neck + 0.5 * (head - neck)),
        Shape("ellipsoid", head, (0.092, 0.075, 0.115), SKIN, turn=turn),
        Shape("ellipsoid", head + turn @ np.array([-0.022, 0.0, 0.026]), (0.088, 0.082, 0.104), HAIR, turn=turn),
        Shape("ellipsoid", head + turn @ np.array([0.090, 0.0, -0.012]), (0.016, 0.012, 0.018), SKIN, turn=turn),
    ]


def _leg(pelvis: Array, y: float, stagger: float) -> list[Shape]:
    hip = pelvis + np.array([0.0, y * HIP_HALF, -0.03])
    ankle = np.array([stagger, y * 0.11, 0.085])
    knee = joint_between(hip, ankle, THIGH, SHANK, np.array([1.0, 0.0, 0.0]))
    heel, toe = ankle + np.array([-0.045, 0.0, -0.045]), ankle + np.array([0.145, 0.012 * y, -0.048])
    return [
        Shape("capsule", hip, (0.078,), TROUSERS, b=knee),
        Shape("capsule", knee, (0.058,), TROUSERS, b=ankle),
        Shape("capsule", heel, (0.038,), SHOE, b=toe),
    ]


def _arm(pelvis: Array, lean: float, y: float, hand: Array, shirt: Colour) -> list[Shape]:
    shoulder = _along(pelvis, lean, SPINE) + np.array([0.0, y * SHOULDER_HALF, 0.0])
    elbow = joint_between(shoulder, hand, UPPER_ARM, FOREARM, np.array([-0.5, 0.6 * y, -0.7]))
    return [
        Shape("capsule", shoulder, (0.047,), shirt, b=elbow),
        Shape("capsule", elbow, (0.037,), SKIN, b=hand),
        Shape("ellipsoid", hand, (0.045, 0.036, 0.036), SKIN),
    ]


def joint_between(start: Array, end: Array, first: float, second: float, towards: Array) -> Array:
    """(3,) where the knee or elbow of two links from `start` to `end` is, bent towards `towards`; stretched when too far."""
    span = end - start
    distance = float(np.linalg.norm(span))
    along = span / distance
    reach = min(distance, 0.999 * (first + second))
    foot = (first**2 - second**2 + reach**2) / (2.0 * reach)
    out = towards - (towards @ along) * along
    return np.asarray(start + foot * along + sqrt(max(first**2 - foot**2, 0.0)) * out / np.linalg.norm(out))


def desk(at: Array, stylus: Array) -> list[Shape]:
    """A table whose top's centre is `at` (3,), and on it a haptic device whose stylus is held at `stylus` (3,)."""
    legs = [
        Shape("capsule", at + np.array([x, y, -0.03]), (0.018,), STEEL, b=np.array([at[0] + x, at[1] + y, 0.02]))
        for x in (-0.24, 0.24)
        for y in (-0.32, 0.32)
    ]
    base = at + np.array([0.14, stylus[1] - at[1], 0.05])
    mast = base + np.array([0.0, 0.0, 0.11])
    elbow = joint_between(mast, stylus, 0.24, 0.22, np.array([0.2, 0.0, 1.0]))
    return [
        Shape("box", at, (0.28, 0.36, 0.014), WOOD),
        *legs,
        Shape("box", base, (0.085, 0.085, 0.036), DEVICE),
        Shape("capsule", base, (0.045,), DEVICE, b=mast),
        Shape("capsule", mast, (0.016,), STEEL, b=elbow),
        Shape("capsule", elbow, (0.011,), STEEL, b=stylus),
        Shape("capsule", stylus, (0.010,), DEVICE, b=stylus + np.array([-0.055, 0.0, 0.075])),
    ]


def _moved(shape: Shape, side: Array, origin: Array) -> Shape:
    return shape._replace(
        a=origin + side @ shape.a,
        b=None if shape.b is None else origin + side @ shape.b,
        turn=None if shape.turn is None else side @ shape.turn,
    )


def draw(mj: Any, scene: Any, shapes: list[Shape]) -> None:
    """Adds the shapes to an abstract scene of the simulator's visualiser."""
    kinds = {"capsule": mj.mjtGeom.mjGEOM_CAPSULE, "ellipsoid": mj.mjtGeom.mjGEOM_ELLIPSOID, "box": mj.mjtGeom.mjGEOM_BOX}
    for shape in shapes:
        geom = scene.geoms[scene.ngeom]
        size = np.array([*shape.size, 0.0, 0.0][:3])
        turn = np.eye(3) if shape.turn is None else shape.turn
        colour = np.array(shape.colour, dtype=np.float32)
        mj.mjv_initGeom(geom, kinds[shape.kind], size, np.asarray(shape.a), turn.ravel(), colour)
        if shape.b is not None:
            mj.mjv_connector(geom, kinds[shape.kind], shape.size[0], shape.a, shape.b)
        geom.specular, geom.shininess = 0.15, 0.3
        scene.ngeom += 1
