"""Robot, beam, floor and light in one compiled model, and where to find things in it.

The beam is part of the kinematic tree: the hand clamps it, so that a force at its far end is a moment at the wrist. A grip that
pivots would transmit no lift at all. The far handle is a body of its own (1 g) so that the partner's force acts at its centre
through `xfrc_applied`: force sensors do not see `qfrc_applied`, nor gravity compensation, so neither is used anywhere.
"""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ...errors import ParameterError
from ...interfaces import STANDARD_GRAVITY, Array
from .robot import HERE, Robot
from .simulator import mujoco

PHYSICS_STEP_S = 0.001
FAR_HANDLE_KG = 0.001  # enough for a body; taken off the beam

# first of three columns of `data.sensordata`, world frame unless said otherwise
WRIST_FORCE = 0  # of the arm on the hand, in the sensor's frame
HAND_VELOCITY = 3  # of the grasp
BEAM_VELOCITY = 6  # of its centre of mass
FAR_POSITION = 9
FAR_VELOCITY = 12
HAND_POSITION = 15


class Scene(NamedTuple):
    """A compiled model with the indices that the plant needs; J joints driven by servos, in the model's order."""

    model: Any
    joints: tuple[str, ...]
    position_at: Array  # (J,) of qpos
    velocity_at: Array  # (J,) of qvel
    arm: Array  # (A,) of the J joints, those that move the hand
    free_base: bool
    hand_kg: float  # what the sensor carries besides the beam
    posture: Array  # (J,) [rad]
    sensor_site: int
    grasp_site: int
    far_body: int


def build(robot: Robot, *, load_mass_kg: float, length_m: float) -> Scene:
    """Compiles `robot` holding a uniform beam. Raises ParameterError naming what the model lacks."""
    if not (load_mass_kg > 2 * FAR_HANDLE_KG and length_m > 0.2):
        raise ParameterError(f"load_mass_kg {load_mass_kg:g}, length_m {length_m:g}; allowed: mass > 0.002 kg, length > 0.2 m")
    try:
        spec = _read(robot)
        _complete(spec, robot)
        _set_stage(spec)
        _give_beam(spec, robot, load_mass_kg, length_m)
        joints = _hinges(spec, robot)
        for name in joints:
            _drive(spec, robot, name)
        _sense(spec, robot)
        return _indexed(spec.compile(), robot, joints, load_mass_kg)
    except (ValueError, mujoco().FatalError, ElementTree.ParseError, OSError) as problem:
        if isinstance(problem, ParameterError):
            raise
        raise ParameterError(
            f"robot {robot.name!r}: {robot.model.name} is no model that compiles: {_in_one_line(problem)}"
        ) from None


def ranges_of(model: Any, joints: Sequence[str]) -> Array:
    """(J, 2) lowest and highest angle of each joint [rad]; infinite for one that turns on and on."""
    ids = [model.joint(name).id for name in joints]
    limited = model.jnt_limited[ids].astype(bool)
    return np.where(limited[:, None], model.jnt_range[ids], [-np.inf, np.inf])


# What a process does that may die: MuJoCo ends its own on some models that are malformed.
_TRY = """
import sys, mujoco
text = sys.stdin.buffer.read().decode("utf-8")
spec = mujoco.MjSpec.from_string(text) if text else mujoco.MjSpec.from_file(sys.argv[1])
spec.compile()
"""
PATIENCE_S = 60.0


@lru_cache(maxsize=64)
def _survives(path: str, text: str, changed: tuple[int, int]) -> str:
    """What MuJoCo says against a model, by file or as text, in a process of its own; empty when nothing."""
    try:
        done = subprocess.run(
            [sys.executable, "-I", "-c", _TRY, path], input=text.encode(), capture_output=True, timeout=PATIENCE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"MuJoCo has not read it within {PATIENCE_S:g} s"
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return f"MuJoCo dies of it (signal {-done.returncode}): it is malformed"
    said = done.stderr.decode(errors="replace").strip().splitlines()
    errors = [i for i, line in enumerate(said) if line.startswith(("ValueError:", "mujoco.FatalError:"))]
    return _in_one_line("\n".join(said[errors[-1] :] if errors else said[-1:])).removeprefix("ValueError: ")


def _in_one_line(problem: object) -> str:
    return " ".join(str(problem).split())[:300]


def _checked(robot: Robot, text: str) -> None:
    """Of a model from elsewhere; what comes with comanip or an installed package has been read before."""
    if robot.model.parent == HERE or robot.packaged:
        return
    about = robot.model.stat()
    if problem := _survives(str(robot.model), text, (about.st_mtime_ns, about.st_size)):
        raise ParameterError(f"robot {robot.name!r}: {robot.model.name} is no model that MuJoCo reads: {problem}")


def _read(robot: Robot) -> Any:
    spec_of = mujoco().MjSpec
    if robot.geometry:
        _checked(robot, "")
        return spec_of.from_file(str(robot.model))
    root = ElementTree.parse(robot.model).getroot()
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("visual", "collision", "geom", "mesh", "mimic"):  # mimic: each joint has a servo of its own here
                parent.remove(child)
    if root.tag == "robot":  # URDF: keep the bodies of fixed joints and what is only to be seen
        ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    text = ElementTree.tostring(root, encoding="unicode")
    _checked(robot, text)
    return spec_of.from_string(text)


def _body(spec: Any, robot: Robot, name: str) -> Any:
    body = spec.body(name)
    if body is None:
        has = ", ".join(b.name for b in spec.bodies)
        raise ParameterError(f"robot {robot.name!r}: no body {name!r} in {robot.model.name}; it has: {has}")
    return body


def _complete(spec: Any, robot: Robot) -> None:
    """Sites, soles and the free base that the description adds to its model."""
    mj = mujoco()
    _body(spec, robot, robot.hand)
    for site in robot.sites:
        added = _body(spec, robot, site.body).add_site(name=site.name, pos=site.position)
        added.alt.type = mj.mjtOrientation.mjORIENTATION_XYAXES
        added.alt.xyaxes = site.xyaxes
    for sole in robot.soles:
        _body(spec, robot, sole.body).add_geom(
            type=mj.mjtGeom.mjGEOM_BOX, pos=sole.position, size=sole.half_size, condim=3, friction=(0.9, 0.01, 0.001),
            solref=(0.01, 1.0), contype=1, conaffinity=1, mass=0.0, rgba=(0.13, 0.20, 0.36, 1.0),
        )  # fmt: skip
    if robot.soles and not any(j.type == mj.mjtJoint.mjJNT_FREE for j in spec.joints):
        spec.worldbody.first_body().add_freejoint(name="base")
    if not robot.geometry:
        _show_bones(spec)


def _show_bones(spec: Any) -> None:
    """A robot without shapes is drawn as capsules from each body to the next."""
    mj, light, dark = mujoco(), (0.90, 0.91, 0.93, 1.0), (0.13, 0.20, 0.36, 1.0)
    look: dict[str, Any] = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 1}
    for body in list(spec.bodies):
        length = float(np.linalg.norm(body.pos))
        if body.name == "world" or body.parent.name == "world" or length < 0.02:  # asking the world for its parent can crash
            continue
        width = min(0.055, 0.012 + 0.15 * length)
        body.parent.add_geom(type=mj.mjtGeom.mjGEOM_CAPSULE, fromto=(0, 0, 0, *body.pos), size=(width, 0, 0), rgba=light, **look)
        body.add_geom(type=mj.mjtGeom.mjGEOM_SPHERE, size=(1.15 * width, 0, 0), rgba=dark, **look)


def _set_stage(spec: Any) -> None:
    mj = mujoco()
    option = spec.option
    option.timestep = PHYSICS_STEP_S
    option.gravity = (0.0, 0.0, -STANDARD_GRAVITY)
    # Explicit in the servos' damping, on purpose. An implicit integrator moves with another acceleration than the force sensor
    # reads: with these servos it overstates the load's inertia. Stable while damping * step < 2 armature at every joint.
    option.integrator = mj.mjtIntegrator.mjINT_EULER
    option.cone = mj.mjtCone.mjCONE_PYRAMIDAL
    # By default MuJoCo answers a bad state by starting over, silently in the middle of a run.
    option.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET
    world = spec.worldbody
    world.add_geom(
        name="floor", type=mj.mjtGeom.mjGEOM_PLANE, size=(12, 12, 0.1), condim=3, friction=(0.9, 0.01, 0.001),
        solref=(0.01, 1.0), contype=1, conaffinity=1, material=_floor(spec),
    )  # fmt: skip
    _sun(world.add_light(pos=(-1.0, -2.0, 4.0), dir=(0.30, 0.62, -1.0), diffuse=(0.55, 0.55, 0.53), specular=(0.2, 0.2, 0.2)))
    _sun(world.add_light(dir=(-0.6, 0.8, -0.5), diffuse=(0.14, 0.15, 0.17), specular=(0, 0, 0), castshadow=False))
    light = spec.visual.headlight
    light.ambient, light.diffuse, light.specular = (0.42, 0.42, 0.43), (0.16, 0.16, 0.16), (0.03, 0.03, 0.03)
    spec.visual.rgba.haze = (0.87, 0.90, 0.93, 1.0)


def _sun(light: Any) -> None:
    """Parallel rays; how to say so has changed between versions of the simulator."""
    if hasattr(light, "directional"):
        light.directional = True
    else:
        light.type = mujoco().mjtLightType.mjLIGHT_DIRECTIONAL


def _floor(spec: Any) -> str:
    """Name of the floor's material; sky and floor are for the eye."""
    textures, builtin = mujoco().mjtTexture, mujoco().mjtBuiltin
    spec.add_texture(
        name="sky", type=textures.mjTEXTURE_SKYBOX, builtin=builtin.mjBUILTIN_GRADIENT, width=32, height=192,
        rgb1=(0.66, 0.74, 0.83), rgb2=(0.87, 0.90, 0.93),
    )  # fmt: skip
    spec.add_texture(
        name="tiles", type=textures.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER, width=64, height=64,
        rgb1=(0.84, 0.84, 0.83), rgb2=(0.79, 0.79, 0.79),
    )  # fmt: skip
    material = spec.add_material(name="floor", texrepeat=(1.6, 1.6), texuniform=True, reflectance=0.0, specular=0.0)
    material.textures[mujoco().mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    return "floor"


def _give_beam(spec: Any, robot: Robot, mass: float, length: float) -> None:
    """A uniform rod from the grasp to the far handle, along the grasp's x; shapes are for the eye."""
    mj = mujoco()
    grasp = spec.site(robot.grasp)
    if grasp is None or spec.site(robot.sensor) is None:
        missing = robot.grasp if grasp is None else robot.sensor
        has = ", ".join(s.name for s in spec.sites)
        raise ParameterError(f"robot {robot.name!r}: no site {missing!r}; it has: {has or 'none'}; add a [[site]]")
    rod = mass - FAR_HANDLE_KG
    centre = (length / 2.0, 0.0, 0.0)
    inertia = rod * length**2 / 12.0
    at = spec.copy().compile().site(robot.grasp)  # resolved, however the model file wrote its orientation
    beam = grasp.parent.add_body(name="beam", pos=at.pos, quat=at.quat)
    beam.explicitinertial = True
    beam.mass, beam.ipos, beam.inertia = rod, centre, (1e-3 * inertia, inertia, inertia)
    far = beam.add_body(name="far handle", pos=(length, 0.0, 0.0))
    far.explicitinertial = True
    far.mass, far.inertia = FAR_HANDLE_KG, (1e-7, 1e-7, 1e-7)
    far.ipos = (0.0, 0.0, 0.0)  # unsaid, it would be a copy of `pos`: the partner would pull another beam's length away
    far.add_site(name="far handle", size=(0.01, 0.01, 0.01))
    shape: dict[str, Any] = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 1}
    wood, metal = (0.76, 0.55, 0.33, 1.0), (0.30, 0.32, 0.35, 1.0)
    beam.add_geom(type=mj.mjtGeom.mjGEOM_BOX, pos=centre, size=(length / 2.0 - 0.09, 0.055, 0.020), rgba=wood, **shape)
    capsule, cylinder = mj.mjtGeom.mjGEOM_CAPSULE, mj.mjtGeom.mjGEOM_CYLINDER
    for end, inward in ((0.0, 1.0), (length, -1.0)):
        beam.add_geom(type=capsule, fromto=(end, -0.052, 0, end, 0.052, 0), size=(0.014, 0, 0), rgba=metal, **shape)
        for side in (-0.052, 0.052):
            rail = (end, side, 0, end + 0.12 * inward, side, 0)
            beam.add_geom(type=cylinder, fromto=rail, size=(0.010, 0, 0), rgba=metal, **shape)


def _hinges(spec: Any, robot: Robot) -> tuple[str, ...]:
    hinge, free = mujoco().mjtJoint.mjJNT_HINGE, mujoco().mjtJoint.mjJNT_FREE
    if others := [j.name for j in spec.joints if j.type not in (hinge, free)]:
        raise ParameterError(f"robot {robot.name!r}: joint {others[0]!r} does not rotate about an axis; remove it from the model")
    return tuple(j.name for j in spec.joints if j.type == hinge)


def _drive(spec: Any, robot: Robot, joint: str) -> None:
    """A joint servo inside the simulator, at its own rate: torque = stiffness (ctrl - q) - damping dq, limited."""
    mj, servo = mujoco(), robot.servo_of(joint)
    if servo.armature is not None:
        spec.joint(joint).armature = servo.armature
    spec.joint(joint).actfrclimited = False
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mj.mjtTrn.mjTRN_JOINT)
    actuator.gainprm[0] = servo.stiffness
    actuator.biastype = mj.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[1], actuator.biasprm[2] = -servo.stiffness, -servo.damping
    actuator.forcelimited = True
    actuator.forcerange = (-servo.torque, servo.torque)


def _sense(spec: Any, robot: Robot) -> None:
    mj = mujoco()
    kinds, objects = mj.mjtSensor, mj.mjtObj
    for kind, what, name in (
        (kinds.mjSENS_FORCE, objects.mjOBJ_SITE, robot.sensor),
        (kinds.mjSENS_FRAMELINVEL, objects.mjOBJ_SITE, robot.grasp),
        (kinds.mjSENS_FRAMELINVEL, objects.mjOBJ_BODY, "beam"),
        (kinds.mjSENS_FRAMEPOS, objects.mjOBJ_SITE, "far handle"),
        (kinds.mjSENS_FRAMELINVEL, objects.mjOBJ_SITE, "far handle"),
        (kinds.mjSENS_FRAMEPOS, objects.mjOBJ_SITE, robot.grasp),
    ):
        spec.add_sensor(type=kind, objtype=what, objname=name)
    if len(spec.sensors) > 6:
        raise ParameterError(f"robot {robot.name!r}: {robot.model.name} has sensors of its own; remove them from the model")


def _indexed(model: Any, robot: Robot, joints: tuple[str, ...], load_mass_kg: float) -> Scene:
    unknown = [j for j in (*robot.arm, *robot.posture_deg) if j not in joints]
    if unknown:
        raise ParameterError(f"robot {robot.name!r}: no joint {unknown[0]!r}; the model's are: {', '.join(joints)}")
    at = [model.joint(j) for j in joints]
    return Scene(
        model=model,
        joints=joints,
        position_at=np.array([int(j.qposadr[0]) for j in at]),
        velocity_at=np.array([int(j.dofadr[0]) for j in at]),
        arm=np.array([joints.index(j) for j in robot.arm]),
        free_base=bool((model.jnt_type == mujoco().mjtJoint.mjJNT_FREE).any()),
        hand_kg=float(model.body_subtreemass[model.body(robot.hand).id]) - load_mass_kg,
        posture=np.radians([robot.posture_deg.get(j, 0.0) for j in joints]),
        sensor_site=model.site(robot.sensor).id,
        grasp_site=model.site(robot.grasp).id,
        far_body=model.body("far handle").id,
    )
