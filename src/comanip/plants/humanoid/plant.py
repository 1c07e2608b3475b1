"""A humanoid that stands on its feet, holds one end of a beam in its right hand and feels it through its wrist.

Rates: commands at `dt`, inverse kinematics every 5 ms, servo references and physics every 1 ms. Between two solutions of the
inverse kinematics the reference moves on a line (held constant instead, its steps ring through the wrist at 200 Hz), with the
velocity fed forward. The sensor is averaged over the control period: read at single instants it would alias.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp
from pathlib import Path

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
    build,
)
from .simulator import mujoco

IK_EVERY = 5  # physics steps
UP = np.array([0.0, 0.0, STANDARD_GRAVITY])
FALLEN_SHARE, FALLEN_COSINE = 0.85, 0.94  # of the base's height; of its upright axis (20 deg)
# While the robot takes its stand, and never afterwards: damping on the base [N s/m], [N m s/rad]; of the joints [s] of stiffness
SETTLING_DAMPING, SETTLING_TIME_S = 1000.0, 0.02
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
        self.scene = build(self.robot, load_mass_kg=load_mass_kg, length_m=length_m)
        self._ik = InverseKinematics(self.scene, self.robot, axes=self.axes, step_s=IK_EVERY * PHYSICS_STEP_S)
        self._rng, self._steps, self._smoothing = rng, steps, smoothing_s
        self._task = np.array([WORLD.index(a) for a in self.axes])
        self._start = self._start_point(start_position)
        self._data = self._mj.MjData(self.scene.model)
        self._allocate()
        self._settle()
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
        scene, d, n = self.scene, len(self.axes), len(self.scene.joints)
        servos = [self.robot.servo_of(j) for j in scene.joints]
        self._stiffness = np.array([s.stiffness for s in servos])
        self._torque_limit = np.array([s.torque for s in servos])
        self._speed_limit = np.array([s.speed for s in servos])
        self._lead = np.array([s.damping / s.stiffness for s in servos]) / PHYSICS_STEP_S  # velocity feed-forward [steps]
        ranges = scene.model.jnt_range[[scene.model.joint(j).id for j in scene.joints]]
        self._low, self._high = ranges[:, 0], ranges[:, 1]
        self._offset = np.zeros(n)  # of the servo references: what holds the robot's weight at the start
        self._reference, self._planned, self._per_step = np.zeros(n), np.zeros(n), np.zeros(n)
        self._commanded, self._moving = np.zeros(d), np.zeros(d)
        self._force, self._position, self._velocity = np.zeros(d), np.zeros(d), np.zeros(d)
        self._late = round(self.sensor.delay_s / PHYSICS_STEP_S)
        self._trace = np.zeros((self._late + self._steps + 1, scene.model.nsensordata))
        self._channels: dict[str, tuple[Array, str]] = {
            "partner.force": (self._force, "N"),
            "partner.position": (self._position, "m"),
            "beam.tilt": (np.zeros(d), "rad"),
            "hand.acceleration": (np.zeros(d), "m/s^2"),
            "hand.true_force": (np.zeros(d), "N"),
            "robot.joints": (np.zeros(n), "rad"),
            "robot.joint_reference": (np.zeros(n), "rad"),
            "robot.torque": (np.zeros(n), "N m"),
            "robot.base": (np.zeros(7), ""),
            "robot.limits": (np.zeros(len(LIMITS)), ""),
        }
        joints = dict.fromkeys(("robot.joints", "robot.joint_reference", "robot.torque"), scene.joints)
        self.columns: dict[str, tuple[str, ...]] = {
            **joints,
            "robot.base": ("x", "y", "z", "qw", "qx", "qy", "qz"),
            "robot.limits": LIMITS,
        }

    def _settle(self) -> None:
        """Lets the robot come to rest under its half of the beam, then puts the hand where it shall start, and settles again.

        The offsets that hold the weight are then frozen, as the integral part of a servo at rest.
        """
        scene, data = self.scene, self._data
        if scene.free_base:
            data.qpos[2] -= self._lowest_point()
        self._ik.stand_at(data.qpos[:7])
        data.qpos[scene.position_at] = self._ik.reach(self._start)
        damping = scene.model.dof_damping
        own = damping.copy()
        damping[: 6 * scene.free_base] = SETTLING_DAMPING
        damping[scene.velocity_at] = SETTLING_TIME_S * self._stiffness
        for _ in range(4):
            self._rest(0.25)
            self._offset[:] = data.actuator_force / self._stiffness
        damping[:] = own
        self._rest(0.25)
        data.qvel[:] = 0.0
        self._rest_state = self._mj.MjData(scene.model)
        self._mj.mj_copyData(self._rest_state, scene.model, data)
        self._upright_height = float(data.qpos[2]) if scene.free_base else 1.0

    def _rest(self, seconds: float) -> None:
        """Holds still with the hand where it shall start, seen from where the base stands."""
        scene, data = self.scene, self._data
        self._stand = data.qpos[:7].copy()
        self._ik.stand_at(self._stand)
        data.ctrl[:] = self._ik.reach(self._start) + self._offset
        data.xfrc_applied[scene.far_body, 2] = 0.5 * self.load_mass_kg * STANDARD_GRAVITY
        self._mj.mj_step(scene.model, data, round(seconds / PHYSICS_STEP_S))

    def _lowest_point(self) -> float:
        """Height of the lowest sole at the starting posture [m]."""
        model, data = self.scene.model, self._data
        data.qpos[self.scene.position_at] = self.scene.posture
        self._mj.mj_kinematics(model, data)
        touching = [g for g in range(model.ngeom) if model.geom_contype[g] and model.geom_bodyid[g]]
        return min((float(data.geom_xpos[g, 2] - model.geom_size[g, 2]) for g in touching), default=0.0)

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def stop_reason(self) -> str:
        return self._stopped

    def reset(self) -> None:
        scene = self.scene
        self._mj.mj_copyData(self._data, scene.model, self._rest_state)
        self._ik.stand_at(self._stand)
        self._reference[:] = self._planned[:] = self._ik.reach(self._start)
        self._per_step[:] = 0.0
        self._commanded[:] = self._moving[:] = 0.0
        self._data.ctrl[:] = self._reference + self._offset
        self._tick, self._stopped = 0, ""
        self._channels["robot.limits"][0][:] = 0.0
        self._mj.mj_forward(scene.model, self._data)
        self._trace[:] = self._data.sensordata
        self._trace[:, HAND_VELOCITY] = self._trace[:, BEAM_VELOCITY] = 0.0
        self._user = np.zeros(len(self.axes))
        self._user[self._task == 2] = 0.5 * self.load_mass_kg * STANDARD_GRAVITY
        self._position[:], self._velocity[:] = self._data.sensordata[FAR_POSITION][self._task], 0.0
        self._force[:] = self._user
        self.partner.reset(self._position.copy())

    @property
    def time(self) -> float:
        return self._tick * PHYSICS_STEP_S

    def read(self, obs: Observation) -> None:
        task, data, out = self._task, self._data, self._channels
        now = data.sensordata
        obs.time = self.time
        obs.position[:] = now[HAND_POSITION][task]
        obs.velocity[:] = now[HAND_VELOCITY][task]
        noise = self.sensor.noise_n * self._rng.standard_normal(len(task))
        obs.sensor_force[:] = self._object_on_hand()[task] + self.sensor.bias_n + noise
        span = (now[FAR_POSITION] - now[HAND_POSITION])[task] - self.length_m * (task == 0)
        out["beam.tilt"][0][:] = span / self.length_m
        out["hand.acceleration"][0][:] = self._mean_rate(HAND_VELOCITY, self._late)[task]
        weight = self.load_mass_kg * (self._mean_rate(BEAM_VELOCITY, self._late) + UP)
        out["hand.true_force"][0][:] = self._user - 0.5 * weight[task]
        out["robot.joints"][0][:] = data.qpos[self.scene.position_at]
        out["robot.joint_reference"][0][:] = data.ctrl - self._offset - self._lead * self._per_step
        out["robot.torque"][0][:] = data.actuator_force
        if self.scene.free_base:
            out["robot.base"][0][:] = data.qpos[:7]

    def _mean_rate(self, velocity: slice, row: int) -> Array:
        """(3,) mean acceleration over the control period that starts at `row` of the trace [m/s^2]."""
        return np.asarray((self._trace[row + self._steps, velocity] - self._trace[row, velocity]) / self.dt)

    def _object_on_hand(self) -> Array:
        """(3,) F_s [N], world frame: the sensor's mean over one period, less the hand's own weight and inertia."""
        rotation = self._data.site_xmat[self.scene.sensor_site].reshape(3, 3)
        arm_on_hand = rotation @ self._trace[: self._steps, WRIST_FORCE].mean(axis=0)
        return np.asarray(self.scene.hand_kg * (self._mean_rate(HAND_VELOCITY, 0) + UP) - arm_on_hand)

    def write(self, command: Command) -> None:
        self._commanded[:] = command.velocity

    def advance(self) -> None:
        """One control period; nothing moves any more once there is a reason to stop."""
        if self._stopped:
            return
        mj, model, data, late = self._mj, self.scene.model, self._data, self._late
        partner_force, force, task = self.partner.force, self._force, self._task
        trace, sensors, control, step = self._trace, data.sensordata, data.ctrl, self._per_step
        pull = data.xfrc_applied[self.scene.far_body]
        position, velocity = sensors[FAR_POSITION], sensors[FAR_VELOCITY]
        trace[:late] = trace[self._steps : self._steps + late]
        self._user[:] = 0.0
        for row in range(late, late + self._steps):
            if self._tick % IK_EVERY == 0:
                self._plan()
            control += step
            self._position[:], self._velocity[:] = position[task], velocity[task]
            partner_force(self.time, self._position, self._velocity, force)
            pull[task] = force
            self._user += force
            mj.mj_step2(model, data)
            trace[row] = sensors
            mj.mj_step1(model, data)
            self._tick += 1
        trace[late + self._steps] = sensors
        self._user /= self._steps
        self._position[:], self._velocity[:] = position[task], velocity[task]
        self._stopped = self._trouble()

    def _plan(self) -> None:
        """The reference of the next 5 ms: smoothed velocity, inverse kinematics, a line from here to there."""
        duration = IK_EVERY * PHYSICS_STEP_S
        keep = exp(-duration / self._smoothing) if self._smoothing > 0 else 0.0
        behind = self._moving - self._commanded
        travel = self._commanded * duration + behind * (self._smoothing * (1.0 - keep))
        self._moving[:] = self._commanded + behind * keep
        self._reference[:] = self._planned
        self._planned[:] = self._ik.step(travel / duration)
        self._per_step[:] = (self._planned - self._reference) / IK_EVERY
        self._data.ctrl[:] = self._reference + self._offset + self._lead * self._per_step
        self._count_limits()

    def _count_limits(self) -> None:
        scene, data = self.scene, self._data
        q, v = data.qpos[scene.position_at], data.qvel[scene.velocity_at]
        self._channels["robot.limits"][0][:] += (
            bool(((q < self._low) | (q > self._high)).any()),
            bool((np.abs(v) > self._speed_limit).any()),
            bool((np.abs(data.actuator_force) >= self._torque_limit).any()),
            self._ik.holds_back,
        )

    def _trouble(self) -> str:
        """Why the run must end: a state that is not finite, a warning of the simulator, a fall; empty when all is well."""
        data = self._data
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            return f"the physics is not finite at {self.time:.3f} s"
        counts = data.warning.number
        if counts.any():
            kind = int(np.flatnonzero(counts)[0])
            return f"the simulator warned {self._mj.mjtWarning(kind).name} ({int(counts[kind])} times) at {self.time:.3f} s"
        if self.scene.free_base:
            upright = 1.0 - 2.0 * float(data.qpos[4] ** 2 + data.qpos[5] ** 2)
            if upright < FALLEN_COSINE or data.qpos[2] < FALLEN_SHARE * self._upright_height:
                lean = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
                return f"the robot fell at {self.time:.3f} s: base at {data.qpos[2]:.2f} m, leaning {lean:.0f} deg"
        return ""
