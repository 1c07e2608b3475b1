"""How the robot stands before a run: at rest on its soles, its hand where it shall start, half of the beam in it."""

from __future__ import annotations

from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np

from ...interfaces import STANDARD_GRAVITY, Array
from .inverse_kinematics import InverseKinematics
from .robot import Robot
from .scene import PHYSICS_STEP_S, Scene
from .simulator import mujoco

# While the robot takes its stand, and never afterwards: damping on the base [N s/m], [N m s/rad]; of the joints [s] of stiffness
BASE_DAMPING, JOINT_DAMPING_S = 1000.0, 0.02
PASSES, PASS_S = 4, 0.25
REMEMBERED = 64  # stances
_known: dict[bytes, Stance] = {}


class Stance(NamedTuple):
    """The simulator's state at rest, and what the servos need to hold it."""

    state: Array  # of the whole simulation, see `resume`
    base: Array  # (7,) where the base stands, as the inverse kinematics sees it
    offset: Array  # (J,) what must be added to the servos' references to carry the weight [rad]
    height: float  # of the base [m]


def stand(scene: Scene, robot: Robot, ik: InverseKinematics, *, start: Array, load_mass_kg: float) -> Stance:
    """How the robot stands with the grasp at `start` (3,) [m] while a partner carries half of the beam.

    The same model stands the same way, so that only the first of many lessons has to wait for it. Raises ParameterError when
    out of reach.
    """
    compiled = np.zeros(mujoco().mj_sizeModel(scene.model), dtype=np.uint8)
    mujoco().mj_saveModel(scene.model, None, compiled)
    key = sha256(b"".join(a.tobytes() for a in (compiled, scene.arm, scene.posture, start))).digest()
    if key not in _known:
        if len(_known) >= REMEMBERED:
            _known.clear()
        _known[key] = _settled(scene, robot, ik, start=start, load_mass_kg=load_mass_kg)
    return _known[key]


def _settled(scene: Scene, robot: Robot, ik: InverseKinematics, *, start: Array, load_mass_kg: float) -> Stance:
    """Each pass puts the hand where it shall start, seen from where the base has come to stand, and takes the torque that this
    took into the offsets: the integral part of a servo, frozen when the run starts.
    """
    mj, model = mujoco(), scene.model
    data = mj.MjData(model)
    stiffness = np.array([robot.servo_of(j).stiffness for j in scene.joints])
    offset = np.zeros(len(scene.joints))
    if scene.free_base:
        data.qpos[2] -= _lowest_sole(scene, data)
    ik.stand_at(data.qpos[:7])
    data.qpos[scene.position_at] = ik.reach(start)
    data.xfrc_applied[scene.far_body, 2] = 0.5 * load_mass_kg * STANDARD_GRAVITY
    own = model.dof_damping.copy()
    model.dof_damping[: 6 * scene.free_base] = BASE_DAMPING
    model.dof_damping[scene.velocity_at] = JOINT_DAMPING_S * stiffness
    for _ in range(PASSES):
        _hold(scene, ik, data, start, offset)
        offset = data.actuator_force / stiffness
    model.dof_damping[:] = own
    base = _hold(scene, ik, data, start, offset)
    data.qvel[:] = 0.0
    kind = mj.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mj.mj_stateSize(model, kind))
    mj.mj_getState(model, data, state, kind)
    return Stance(state, base, offset, float(data.qpos[2]))


def resume(scene: Scene, data: Any, stance: Stance) -> None:
    """Puts the simulation back to the stance, with every count at zero."""
    mj = mujoco()
    mj.mj_resetData(scene.model, data)
    mj.mj_setState(scene.model, data, stance.state, mj.mjtState.mjSTATE_INTEGRATION)


def _hold(scene: Scene, ik: InverseKinematics, data: Any, start: Array, offset: Array) -> Array:
    base = np.array(data.qpos[:7])
    ik.stand_at(base)
    data.ctrl[:] = ik.reach(start) + offset
    mujoco().mj_step(scene.model, data, round(PASS_S / PHYSICS_STEP_S))
    return base


def _lowest_sole(scene: Scene, data: Any) -> float:
    """Height at which the lowest sole is in the starting posture [m]."""
    model = scene.model
    data.qpos[scene.position_at] = scene.posture
    mujoco().mj_kinematics(model, data)
    touching = [g for g in range(model.ngeom) if model.geom_contype[g] and model.geom_bodyid[g]]
    return min((float(data.geom_xpos[g, 2] - model.geom_size[g, 2]) for g in touching), default=0.0)
