"""A humanoid that stands on its feet, holds one end of a beam in its right hand and feels it through its wrist.

Commands at `dt`, joint references and physics every millisecond (`servos`). The sensor is averaged over the control period: read
at single instants it would alias.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ParameterError, check_generator, check_has
from ...interfaces import STANDARD_GRAVITY, Array, Command, Observation, Partner
from ..beam import Beam, WristSensor, shown
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
    ranges_of,
)
from .self_collision import SelfCollision
from .servos import EVERY, PERIOD_S, ServoReferences
from .simulator import mujoco
from .stance import resume, stand

FALLEN_SHARE, FALLEN_COSINE = 0.85, 0.94  # of the base's height; of its upright axis (20 deg)
LOOK_EVERY = 20  # physics steps between two looks at what touches what: the hand moves 16 mm in that time at most
ABSURD_M_PER_S = 100.0  # no hand is asked for that: beyond, inverse kinematics leaves float64
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
        check_generator(rng)
        check_has(partner, "partner", ("reset", "force"), "comanip.interfaces.Partner")
        self._mj = mujoco()
        self.dt, self.axes, self.sensor, self.partner = dt, tuple(axes), sensor, partner
        self.robot, self.load_mass_kg, self.length_m = load_robot(robot), load_mass_kg, length_m
        self._rng, self._steps = rng, steps
        self.scene = build(self.robot, load_mass_kg=load_mass_kg, length_m=length_m)
        self._ik = InverseKinematics(self.scene, self.robot, axes=self.axes, step_s=PERIOD_S)
        self._servos = ServoReferences(self.scene, self.robot, self._ik, smoothing_s=smoothing_s, n_axes=len(self.axes))
        self._columns = [WORLD.index(a) for a in self.axes]
        self._task = np.array(self._columns)
        self._weight = [STANDARD_GRAVITY if a == "z" else 0.0 for a in self.axes]  # [m/s^2]
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
        self._limits, self._self_collision = _Limits(scene, self.robot), SelfCollision(scene)
        self._force, self._position, self._velocity, self._user = np.zeros(d), np.zeros(d), np.zeros(d), np.zeros(d)
        self._late = round(self.sensor.delay_s / PHYSICS_STEP_S)
        self._trace: deque[list[float]] = deque(maxlen=self._late + self._steps + 1)  # one row a millisecond, oldest first
        # Windows into the simulator's memory: asking for them anew costs a microsecond each
        self._sensors, self._attitude = self._data.sensordata, self._data.site_xmat[scene.sensor_site]
        self._pull = self._data.xfrc_applied[scene.far_body]
        self._far, self._far_speed = FAR_POSITION + self._task, FAR_VELOCITY + self._task
        joints, base = np.zeros(len(scene.joints)), np.zeros(7)
        self._channels: dict[str, tuple[Array, str]] = {
            **shown(
                far_force=self._force,
                far_position=self._position,
                tilt=np.zeros(d),
                acceleration=np.zeros(d),
                true_force=np.zeros(d),
            ),
            "robot.joints": (joints, "rad"),
            "robot.joint_reference": (joints.copy(), "rad"),
            "robot.torque": (joints.copy(), "N m"),
            "robot.base": (base, ""),
            "robot.limits": (self._limits.counts, ""),
        }
        self._seen = tuple(self._channels[name][0] for name in ("beam.tilt", "hand.acceleration", "hand.true_force"))
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
        """[s] since the reset."""
        return self._tick * PHYSICS_STEP_S

    def reset(self) -> None:
        data = self._data
        resume(self.scene, data, self._stance)
        self._servos.reset(self._stance, self._start)
        data.ctrl[:] = self._servos.control
        self._mj.mj_forward(self.scene.model, data)
        self._tick, self._stopped = 0, ""
        self._limits.counts[:] = 0.0
        at_rest = self._sensors.copy()
        at_rest[HAND_VELOCITY : HAND_VELOCITY + 3] = at_rest[BEAM_VELOCITY : BEAM_VELOCITY + 3] = 0.0
        self._trace.extend([at_rest.tolist()] * (self._late + self._steps + 1))
        self._user[:] = self._force[:] = [0.5 * self.load_mass_kg * weight for weight in self._weight]
        self._position[:], self._velocity[:] = self._sensors[self._far], 0.0
        self.partner.reset(self._position.copy())
        self._see = getattr(self.partner, "see", None)

    def _show_tilt(self, see: Callable[[list[float], list[float]], None]) -> None:
        """To a partner who levels the object by eye."""
        now, tilt, rate = self._sensors.tolist(), [], []
        for i, axis in enumerate(self._columns):
            tilt.append((float(self._position[i]) - now[HAND_POSITION + axis]) / self.length_m - (axis == 0))
            rate.append((float(self._velocity[i]) - now[HAND_VELOCITY + axis]) / self.length_m)
        see(tilt, rate)

    def read(self, obs: Observation) -> None:
        data, scene, out, now = self._data, self.scene, self._channels, self._trace[-1]
        tilt, acceleration, truth = self._seen
        obs.time = self.time
        on_hand, far, user = self._arm_on_hand(), self._position.tolist(), self._user.tolist()
        noise = self._rng.standard_normal(len(user)).tolist()
        for i, (axis, weight) in enumerate(zip(self._columns, self._weight, strict=True)):  # plain floats: few axes, many ticks
            position, half_kg = now[HAND_POSITION + axis], 0.5 * self.load_mass_kg
            inertial = scene.hand_kg * (self._mean_rate(HAND_VELOCITY + axis, 0) + weight)
            obs.position[i], obs.velocity[i] = position, now[HAND_VELOCITY + axis]
            obs.sensor_force[i] = inertial - on_hand[axis] + self.sensor.bias_n + self.sensor.noise_n * noise[i]
            tilt[i] = (far[i] - position) / self.length_m - (axis == 0)
            acceleration[i] = self._mean_rate(HAND_VELOCITY + axis, self._late)
            truth[i] = user[i] - half_kg * (self._mean_rate(BEAM_VELOCITY + axis, self._late) + weight)
        data.qpos.take(scene.position_at, out=out["robot.joints"][0], mode="clip")
        out["robot.joint_reference"][0][:] = self._servos.reference
        out["robot.torque"][0][:] = data.actuator_force
        if scene.free_base:
            out["robot.base"][0][:] = data.qpos[:7]

    def _mean_rate(self, column: int, row: int) -> float:
        """Mean acceleration over the control period that starts at `row` of the trace [m/s^2]."""
        return (self._trace[row + self._steps][column] - self._trace[row][column]) / self.dt

    def _arm_on_hand(self) -> list[float]:
        """(3,) what the wrist sensor reads, mean over one period, turned into the world [N]; the object's pull is minus that."""
        rows = [row[WRIST_FORCE : WRIST_FORCE + 3] for row in islice(self._trace, self._steps)]
        x, y, z = [sum(column) / self._steps for column in zip(*rows, strict=True)]
        r = self._attitude.tolist()
        return [r[k] * x + r[k + 1] * y + r[k + 2] * z for k in (0, 3, 6)]

    def write(self, command: Command) -> None:
        """Takes the velocity; one that cannot be ends the run, and the recording is kept."""
        fastest = max(map(abs, command.velocity.tolist()))
        if not fastest < ABSURD_M_PER_S or any(v != v for v in command.velocity.tolist()):
            what = "is not finite" if not isfinite(fastest) or fastest != fastest else f"asks for {fastest:.3g} m/s"
            self._stopped = self._stopped or f"the command {what} at {self.time:.3f} s"
            return
        self._servos.command[:] = command.velocity

    def advance(self) -> None:
        """One control period; nothing moves any more once there is a reason to stop."""
        if self._stopped:
            return
        mj, model, data, servos, trace = self._mj, self.scene.model, self._data, self._servos, self._trace
        sensors, control, force, user = self._sensors, data.ctrl, self._force, self._user
        trace.pop()  # the end of the last period is the start of this one, as yet without forces
        user[:] = 0.0
        for _ in range(self._steps):
            if self._tick % EVERY == 0:
                servos.plan()
                self._limits.count(data, self._ik)
            servos.step()
            control[:] = servos.control
            if self._see is not None:
                self._show_tilt(self._see)
            self.partner.force(self.time, self._position, self._velocity, force)
            if not isfinite(force @ force):
                self._stopped = self._stopped or f"the partner's force is not finite at {self.time:.3f} s"
                force[:] = 0.0
            self._pull[self._task] = force
            user += force
            mj.mj_step2(model, data)  # accelerations, forces, integration ...
            trace.append(sensors.tolist())
            mj.mj_step1(model, data)  # ... and the kinematics of the new state, which the partner feels next
            self._tick += 1
            self._position[:], self._velocity[:] = sensors[self._far], sensors[self._far_speed]
            if self._tick % EVERY == 0:
                self._stopped = self._stopped or _trouble(mj, self.scene, data, self._stance.height, self.time)
            if self._tick % LOOK_EVERY == 0 and (touching := self._self_collision.look(data.qpos)):
                self._stopped = self._stopped or f"the robot hits itself at {self.time:.3f} s: {touching}"
        trace.append(sensors.tolist())
        user /= self._steps


class _Limits:
    """Counts, every 5 ms, the joints' excursions beyond what the robot is allowed."""

    def __init__(self, scene: Scene, robot: Robot) -> None:
        servos = [robot.servo_of(j) for j in scene.joints]
        self._torque, self._speed = np.array([s.torque for s in servos]), np.array([s.speed for s in servos])
        self._low, self._high = ranges_of(scene.model, scene.joints).T
        self._position_at, self._velocity_at = scene.position_at, scene.velocity_at
        self.counts = np.zeros(len(LIMITS))

    def count(self, data: Any, ik: InverseKinematics) -> None:
        q = data.qpos[self._position_at]
        self.counts[0] += np.count_nonzero((q < self._low) | (q > self._high)) > 0
        self.counts[1] += np.count_nonzero(np.abs(data.qvel[self._velocity_at]) > self._speed) > 0
        self.counts[2] += np.count_nonzero(np.abs(data.actuator_force) >= self._torque) > 0
        self.counts[3] += ik.holds_back


def _trouble(mj: Any, scene: Scene, data: Any, standing_m: float, time: float) -> str:
    """Why the run must end: a state that is not finite, a warning of the simulator, a fall; empty when all is well."""
    if not isfinite(data.qpos @ data.qpos + data.qvel @ data.qvel):
        return f"the physics is not finite at {time:.3f} s"
    counts = data.warning.number
    if np.count_nonzero(counts):
        kind = int(np.flatnonzero(counts)[0])
        return f"the simulator warned {mj.mjtWarning(kind).name} ({int(counts[kind])} times) at {time:.3f} s"
    if scene.free_base:
        upright, height = 1.0 - 2.0 * float(data.qpos[4] ** 2 + data.qpos[5] ** 2), float(data.qpos[2])
        if upright < FALLEN_COSINE or height < FALLEN_SHARE * standing_m:
            lean = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
            return f"the robot fell at {time:.3f} s: base at {height:.2f} m, leaning {lean:.0f} deg"
    return ""
