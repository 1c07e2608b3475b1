"""From how the hand shall move to how the joints shall move, one small step at a time.

    dq = J# (twist of the hand + correction) + (1 - J# J) (posture pull)        damped least squares, J is 6 x A
    dq <- s dq, the largest s <= 1 at which no joint exceeds what it can do

The twist holds orientation and the axes that are not the task's. Slowing all joints by one factor keeps the hand on its path:
near a limit or a singularity it moves along the same line, only slower. A joint near the end of its range may go no faster than
it can brake in what is left, cap(d) = sqrt(2 a d) - a T/2 (the same rule as the safety envelope's).
"""

from __future__ import annotations

import numpy as np

from ...errors import ParameterError
from ...interfaces import Array
from .robot import Robot
from .scene import Scene
from .simulator import mujoco

WORLD = ("x", "y", "z")


class InverseKinematics:
    """Joint references of a robot whose base stands still at `base`.

    axes      names of the d task axes, of the world: x forward, y left, z up
    step_s    time between two references [s]
    joints    (J,) the reference [rad]; only the arm's joints ever change
    slowed    the factor s of the last step: 1 when no joint was at what it can do
    holds_back whether the hand fell short of what was asked, at a limit or by damping
    """

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        *,
        axes: tuple[str, ...] = ("z",),
        step_s: float = 0.005,
        braking_rad_per_s2: float = 20.0,
        margin_rad: float = 0.01,  # kept from the ends of each range
        small_singular_value: float = 0.05,  # [m/rad] below it steps are damped
        posture_pull_per_s: float = 1.0,
        leash_m: float = 0.001,  # how far the reference may run ahead of what the arm can do
    ) -> None:
        unknown = [a for a in axes if a not in WORLD]
        if unknown or len(set(axes)) != len(axes):
            raise ParameterError(f"axes {axes}: allowed are some of {', '.join(WORLD)}, each once")
        self.step_s, self.scene = step_s, scene
        self._task = np.array([WORLD.index(a) for a in axes])
        self._braking, self._small = braking_rad_per_s2, small_singular_value
        self._pull, self._leash = posture_pull_per_s, leash_m
        model, arm = scene.model, scene.arm
        self._dofs = scene.velocity_at[arm]
        ranges = model.jnt_range[[model.joint(scene.joints[j]).id for j in arm]]
        self._low, self._high = ranges[:, 0] + margin_rad, ranges[:, 1] - margin_rad
        self._speed = np.array([robot.servo_of(scene.joints[j]).speed for j in arm])
        self._data = mujoco().MjData(model)
        self._jacobian = np.zeros((6, model.nv))
        self._turn, self._level = np.zeros(3), np.eye(3)  # the beam is held level, along x
        self.joints = scene.posture.copy()
        self.target = np.zeros(3)
        self.slowed, self.holds_back = 1.0, False

    def stand_at(self, base: Array) -> None:
        """Takes (7,) position and quaternion of the base; ignored by a robot that is bolted down."""
        if self.scene.free_base:
            self._data.qpos[:7] = base

    def reach(self, position: Array) -> Array:
        """(J,) joints that put the grasp at `position` (3,) [m], held level, from the posture. Raises if it cannot."""
        self.joints[:] = self.scene.posture
        arm = self.scene.arm
        self.joints[arm] = np.clip(self.joints[arm], self._low, self._high)
        self.target[:] = position
        for _ in range(400):
            error = self._error()
            if np.abs(error).max() < 1e-7:
                return self.joints
            self.move(0.5 * error)
        raise ParameterError(
            f"the hand cannot hold the beam level at {np.round(position, 3).tolist()} m: {np.round(error, 4).tolist()} [m, rad] "
            "are missing; start elsewhere"
        )

    def step(self, velocity: Array) -> Array:
        """(J,) joints one step on, the hand moving at `velocity` (d,) [m/s] along the task axes."""
        task = self._task
        self.target[task] += velocity * self.step_s
        self.move(self._error())
        hand = self._data.site_xpos[self.scene.grasp_site]  # before the move: the leash is one step longer
        room = self._leash + np.abs(velocity) * self.step_s
        wanted = self.target[task]
        self.target[task] = np.clip(wanted, hand[task] - room, hand[task] + room)
        self.holds_back = self.slowed < 1.0 or bool((self.target[task] != wanted).any())
        return self.joints

    def hand(self) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of the grasp at the present reference."""
        self._error()
        return self._data.site_xpos[self.scene.grasp_site].copy(), self._data.site_xmat[self.scene.grasp_site].reshape(
            3, 3
        ).copy()

    def singular_values(self) -> Array:
        """(6,) of the arm's Jacobian at the present reference, largest first."""
        self._error()
        return np.asarray(np.linalg.svd(self._arm_jacobian(), compute_uv=False))

    def _error(self) -> Array:
        """(6,) what is missing to the target [m], [rad]; leaves the kinematics of the present reference behind."""
        mj, scene, data = mujoco(), self.scene, self._data
        data.qpos[scene.position_at] = self.joints
        mj.mj_kinematics(scene.model, data)
        mj.mj_comPos(scene.model, data)
        rotation = data.site_xmat[scene.grasp_site].reshape(3, 3)
        x, y, z = rotation.T
        self._turn[:] = 0.5 * (_cross(x, self._level[0]) + _cross(y, self._level[1]) + _cross(z, self._level[2]))
        return np.concatenate([self.target - data.site_xpos[scene.grasp_site], self._turn])

    def _arm_jacobian(self) -> Array:
        mujoco().mj_jacSite(self.scene.model, self._data, self._jacobian[:3], self._jacobian[3:], self.scene.grasp_site)
        return self._jacobian[:, self._dofs]

    def move(self, step: Array) -> None:
        """Moves the arm's joints by what brings the hand `step` (6,) [m], [rad] further, as far as they may go in one step."""
        arm = self.scene.arm
        q = self.joints[arm]
        u, s, vt = np.linalg.svd(self._arm_jacobian(), full_matrices=False)
        damping = self._small**2 * max(0.0, 1.0 - (s[-1] / self._small) ** 2)
        dq = vt.T @ (s / (s * s + damping) * (u.T @ step))
        if len(arm) > 6:
            pull = (self._pull * self.step_s) * (self.scene.posture[arm] - q)
            dq += pull - vt.T @ (vt @ pull)
        self.slowed = min(1.0, float((self._allowed(q, dq) / np.maximum(np.abs(dq), 1e-12)).min()))
        self.joints[arm] = q + self.slowed * dq

    def _allowed(self, q: Array, dq: Array) -> Array:
        """(A,) how far each joint may go in this step, in the direction of dq [rad]."""
        left = np.maximum(np.where(dq > 0, self._high - q, q - self._low), 0.0)
        brakeable = np.sqrt(2 * self._braking * left) - 0.5 * self._braking * self.step_s
        return np.asarray(np.minimum(self._speed, np.maximum(brakeable, 0.0)) * self.step_s)


def _cross(a: Array, b: Array) -> Array:
    """np.cross is ten times slower on two vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
