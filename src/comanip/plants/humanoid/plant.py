"""A humanoid that stands on its feet, holds one end of a beam in its right hand and feels it through its wrist.

Commands at `dt`, joint references and physics every millisecond (`servos`). The sensor is averaged over the control period: read
at single instants it would alias.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ParameterError
from ...interfaces import STANDARD_GRAVITY, Array, Command, Observation, Partner
from ..beam import Beam, WristSensor
from .inverse_kinematics import WORLD, InverseKinematics
from .robot import Robot, load_robot
from .scene import (
    BEAM_VELOCITY,
    FAR_POSITION,
    FAR_VELOCITY,
    HAND_POSITION,
    HAND_VELOCITY,
    PHYSICS_STEP_S,
    WRIST_FORCE,
    Scene,
    build,
)
from .servos import EVERY, PERIOD_S, ServoReferences
from .simulator import mujoco
from .stance import resume, stand

FALLEN_SHARE, FALLEN_COSINE = 0.85, 0.94  # of the base's height; of its upright axis (20 deg)
LIMITS = ("range", "speed", "torque", "reach")

# The exact beam that moves most like this robot with any load (identified from pulls and lifts; docs/physics.md).
EQUIVALENT_BEAM = Beam(wrist_stiffness_nm_per_rad=610.0, wrist_damping_nms_per_rad=16.0, actuator_lag_s=0.018)


class HumanoidPlant:
    """Robot, beam and partner in closed loop in MuJoCo; the sibling of `BeamPlant`, in the world frame.

    robot           "hrp2-class", "jvrc1", a TOML file or a `Robot`
    load_mass_kg    of the whole beam, `length_m` long from hand to hand
    axes            some of "x" (along the beam), "y" (left), "z" (up); the hand keeps its other coordinates and its orientation
    dt              control period [s], whole milliseconds
    start_position  (d,) of the hand [m]; default: where the robot's description says
    smoothing_s     time constant of the hand's velocity command; with it the hand follows as `Beam.actuator_lag_s` does
    rng             sensor noise; pass your own for a reproducible run

    Channels beyond those of `BeamPlant`: robot.joints, robot.joint_reference (J,) [rad], robot.torque (J,) [N m], robot.base (7,)
    position [m] and quaternion, robot.limits (4,): how many times a joint was found beyond its range or speed or at its torque
    limit, and how often the arm had to slow down to stay within reach. hand.true_force is the mean over the control period of
    (F_user - F_robot)/2, from the partner's force and the beam's momentum; no sensor is involved.
    """

    def __init__(
        self,
        partner: Partner,
        *,
        robot: str | Path | Robot = "hrp2-class",
        load_mass_kg: float = 2.0,
        length_m: float = 0.8,
        sensor: WristSensor = WristSensor(),
        axes: tuple[str, ...] = ("z",),
        dt: float = 0.01,
        start_position: Array | None = None,
        smoothing_s: float = 0.018,
        rng: np.random.Generator,
    ) -> None:
        steps = round(dt / PHYSICS_STEP_S)
        if steps < 1 or dt > 0.1 or abs(steps * PHYSICS_STEP_S - dt) > 1e-9:
            raise ParameterError(f"control period dt is {dt} s; allowed are multiples of {PHYSICS_STEP_S} s up to 0.1 s")
        if smoothing_s < 0:
            raise ParameterError(f"smoothing_s must not be negative; got {smoothing_s}")
        self._mj = mujoco()
        self.dt, self.axes, self.sensor, self.partner = dt, tuple(axes), sensor, partner
        self.robot, self.load_mass_kg, self.length_m = load_robot(robot), load_mass_kg, length_m
        self._rng, self._steps = rng, steps
        self.scene = build(self.robot, load_mass_kg=load_mass_kg, length_m=length_m)
        self._ik = InverseKinematics(self.scene, self.robot, axes=self.axes, step_s=PERIOD_S)
        self._servos = ServoReferences(self.scene, self.robot, self._ik, smoothing_s=smoothing_s, n_axes=len(self.axes))
        self._task = np.array([WORLD.index(a) for a in self.axes])
        self._start = self._start_point(start_position)
        self._stance = stand(self.scene, self.robot, self._ik, start=self._start, load_mass_kg=load_mass_kg)
        self._data = self._mj.MjData(self.scene.model)
        self._allocate()
        self.reset()

    def _start_point(self, given: Array | None) -> Array:
        point = np.array(self.robot.grasp_m, dtype=float)
        if given is not None:
            given = np.asarray(given, dtype=float)
            if given.shape != (len(self.axes),):
                raise ParameterError(f"start_position needs {len(self.axes)} values for axes {self.axes}; got {given.shape}")
            point[self._task] = given
        return point

    def _allocate(self) -> None:
        scene, d = self.scene, len(self.axes)
        self._limits = _Limits(scene, self.robot)
        self._force, self._position, self._velocity, self._user = np.zeros(d), np.zeros(d), np.zeros(d), np.zeros(d)
        self._weight = np.where(self._task == 2, STANDARD_GRAVITY, 0.0)  # [m/s^2]
        self._late = round(self.sensor.delay_s / PHYSICS_STEP_S)
        self._trace = np.zeros((self._late + self._steps + 1, scene.model.nsensordata))  # one row a millisecond, oldest first
        joints, base = np.zeros(len(scene.joints)), np.zeros(7)
        self._channels: dict[str, tuple[Array, str]] = {
            "partner.force": (self._force, "N"),
            "partner.position": (self._position, "m"),
            "beam.tilt": (np.zeros(d), "rad"),
            "hand.acceleration": (np.zeros(d), "m/s^2"),
            "hand.true_force": (np.zeros(d), "N"),
            "robot.joints": (joints, "rad"),
            "robot.joint_reference": (joints.copy(), "rad"),
            "robot.torque": (joints.copy(), "N m"),
            "robot.base": (base, ""),
            "robot.limits": (self._limits.counts, ""),
        }
        self.columns: dict[str, tuple[str, ...]] = {
            **dict.fromkeys(("robot.joints", "robot.joint_reference", "robot.torque"), scene.joints),
            "robot.base": ("x", "y", "z", "qw", "qx", "qy", "qz"),
            "robot.limits": LIMITS,
        }

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def stop_reason(self) -> str:
        return self._stopped

    @property
    def time(self) -> float:
        return self._tick * PHYSICS_STEP_S

    def reset(self) -> None:
        data = self._data
        resume(self.scene, data, self._stance)
        self._servos.reset(self._stance, self._start)
        data.ctrl[:] = self._servos.control
        self._mj.mj_forward(self.scene.model, data)
        self._tick, self._stopped = 0, ""
        self._limits.counts[:] = 0.0
        self._trace[:] = data.sensordata
        self._trace[:, HAND_VELOCITY] = self._trace[:, BEAM_VELOCITY] = 0.0
        self._user[:] = self._force[:] = 0.5 * self.load_mass_kg * self._weight
        self._position[:], self._velocity[:] = data.sensordata[FAR_POSITION][self._task], 0.0
        self.partner.reset(self._position.copy())

    def read(self, obs: Observation) -> None:
        task, data, out = self._task, self._data, self._channels
        now = data.sensordata
        obs.time = self.time
        obs.position[:] = now[HAND_POSITION][task]
        obs.velocity[:] = now[HAND_VELOCITY][task]
        noise = self.sensor.noise_n * self._rng.standard_normal(len(task))
        obs.sensor_force[:] = self._object_on_hand() + self.sensor.bias_n + noise
        out["beam.tilt"][0][:] = (self._position - obs.position) / self.length_m - (task == 0)
        out["hand.acceleration"][0][:] = self._mean_rate(HAND_VELOCITY, self._late)
        momentum_rate = self.load_mass_kg * (self._mean_rate(BEAM_VELOCITY, self._late) + self._weight)
        out["hand.true_force"][0][:] = self._user - 0.5 * momentum_rate
        data.qpos.take(self.scene.position_at, out=out["robot.joints"][0])
        out["robot.joint_reference"][0][:] = self._servos.reference
        out["robot.torque"][0][:] = data.actuator_force
        if self.scene.free_base:
            out["robot.base"][0][:] = data.qpos[:7]

    def _mean_rate(self, velocity: slice, row: int) -> Array:
        """(d,) mean acceleration over the control period that starts at `row` of the trace [m/s^2]."""
        gained = self._trace[row + self._steps, velocity] - self._trace[row, velocity]
        return np.asarray(gained[self._task] / self.dt)

    def _object_on_hand(self) -> Array:
        """(d,) F_s [N], world frame: the sensor's mean over one period, less the hand's own weight and inertia."""
        rotation = self._data.site_xmat[self.scene.sensor_site].reshape(3, 3)
        arm_on_hand = rotation[self._task] @ self._trace[: self._steps, WRIST_FORCE].sum(axis=0) / self._steps
        return np.asarray(self.scene.hand_kg * (self._mean_rate(HAND_VELOCITY, 0) + self._weight) - arm_on_hand)

    def write(self, command: Command) -> None:
        self._servos.command[:] = command.velocity

    def advance(self) -> None:
        """One control period; nothing moves any more once there is a reason to stop."""
        if self._stopped:
            return
        mj, model, data, servos, task = self._mj, self.scene.model, self._data, self._servos, self._task
        trace, sensors, control, reference = self._trace, data.sensordata, data.ctrl, servos.control
        pull, position, velocity = data.xfrc_applied[self.scene.far_body], sensors[FAR_POSITION], sensors[FAR_VELOCITY]
        partner_force, force, late, steps = self.partner.force, self._force, self._late, self._steps
        trace[:late] = trace[steps : steps + late]
        self._user[:] = 0.0
        for row in range(late, late + steps):
            if self._tick % EVERY == 0:
                self._stopped = self._stopped or _trouble(self._mj, self.scene, data, self._stance.height, self.time)
                servos.plan()
                self._limits.count(data, self._ik)
            servos.step()
            control[:] = reference
            self._position[:], self._velocity[:] = position[task], velocity[task]
            partner_force(self._tick * PHYSICS_STEP_S, self._position, self._velocity, force)
            pull[task] = force
            self._user += force
            mj.mj_step2(model, data)  # accelerations, forces, integration ...
            trace[row] = sensors
            mj.mj_step1(model, data)  # ... and the kinematics of the new state, which the partner feels next
            self._tick += 1
        trace[late + steps] = sensors
        self._user /= steps
        self._position[:], self._velocity[:] = position[task], velocity[task]
        if steps >= EVERY:
            self._stopped = self._stopped or _trouble(self._mj, self.scene, data, self._stance.height, self.time)


class _Limits:
    """Counts, every 5 ms, the joints' excursions beyond what the robot is allowed."""

    def __init__(self, scene: Scene, robot: Robot) -> None:
        servos = [robot.servo_of(j) for j in scene.joints]
        self._torque, self._speed = np.array([s.torque for s in servos]), np.array([s.speed for s in servos])
        ranges = scene.model.jnt_range[[scene.model.joint(j).id for j in scene.joints]]
        self._low, self._high = ranges[:, 0].copy(), ranges[:, 1].copy()
        self._position_at, self._velocity_at = scene.position_at, scene.velocity_at
        self.counts = np.zeros(len(LIMITS))

    def count(self, data: Any, ik: InverseKinematics) -> None:
        q = data.qpos[self._position_at]
        self.counts[0] += bool(((q < self._low) | (q > self._high)).any())
        self.counts[1] += bool((np.abs(data.qvel[self._velocity_at]) > self._speed).any())
        self.counts[2] += bool((np.abs(data.actuator_force) >= self._torque).any())
        self.counts[3] += ik.holds_back


def _trouble(mj: Any, scene: Scene, data: Any, standing_m: float, time: float) -> str:
    """Why the run must end: a state that is not finite, a warning of the simulator, a fall; empty when all is well."""
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        return f"the physics is not finite at {time:.3f} s"
    counts = data.warning.number
    if counts.any():
        kind = int(np.flatnonzero(counts)[0])
        return f"the simulator warned {mj.mjtWarning(kind).name} ({int(counts[kind])} times) at {time:.3f} s"
    if scene.free_base:
        upright, height = 1.0 - 2.0 * float(data.qpos[4] ** 2 + data.qpos[5] ** 2), float(data.qpos[2])
        if upright < FALLEN_COSINE or height < FALLEN_SHARE * standing_m:
            lean = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
            return f"the robot fell at {time:.3f} s: base at {height:.2f} m, leaning {lean:.0f} deg"
    return ""
