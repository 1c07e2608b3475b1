"""From how the hand shall move to how the joints shall move, one small step at a time.

    dq = J# (twist of the hand + correction) + (1 - J# J) (posture pull)        damped least squares, J is 6 x A
    dq <- s dq, the largest s <= 1 at which no joint exceeds what it can do

The twist holds orientation and the axes that are not the task's. Slowing all joints by one factor keeps the hand on its path:
near a limit or a singularity it moves along the same line, only slower. A joint near the end of its range may go no faster than
it can brake in what is left, cap(d) = sqrt(2 a d) - a T/2 (the same rule as the safety envelope's).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ...errors import ParameterError
from ...interfaces import Array
from .robot import Robot
from .scene import Scene, ranges_of
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
        ranges = ranges_of(model, [scene.joints[j] for j in arm])
        self._low, self._high = ranges[:, 0] + margin_rad, ranges[:, 1] - margin_rad
        speeds = [robot.servo_of(scene.joints[j]).speed for j in arm]
        self._ways = list(zip(self._low.tolist(), self._high.tolist(), speeds, strict=True))
        self._data = mujoco().MjData(model)
        self._place, self._rotation = self._data.site_xpos[scene.grasp_site], self._data.site_xmat[scene.grasp_site]
        self._jacobian = np.zeros((6, model.nv))
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
        self.target[self._task] += velocity * self.step_s
        self.move(self._error())
        self.holds_back = self.slowed < 1.0
        for i, axis in enumerate(self._task.tolist()):
            room = self._leash + abs(float(velocity[i])) * self.step_s  # `_place` is before the move: one step more
            wanted, place = float(self.target[axis]), float(self._place[axis])
            self.target[axis] = min(max(wanted, place - room), place + room)
            self.holds_back |= self.target[axis] != wanted
        return self.joints

    def hand(self) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of the grasp at the present reference."""
        self._error()
        return self._place.copy(), self._rotation.reshape(3, 3).copy()

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
        (x, y, z), r = self._place.tolist(), self._rotation.tolist()  # level is the world's attitude: the turn back is r - r^T
        target = self.target.tolist()
        turn = 0.5 * (r[5] - r[7]), 0.5 * (r[6] - r[2]), 0.5 * (r[1] - r[3])
        return np.array([target[0] - x, target[1] - y, target[2] - z, *turn])

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
        self.slowed = self._share(q.tolist(), dq.tolist())
        self.joints[arm] = q + self.slowed * dq

    def _share(self, q: list[float], dq: list[float]) -> float:
        """The largest part of the step dq, up to 1, at which every joint keeps its speed and could still brake [rad]."""
        share, braking, step_s = 1.0, self._braking, self.step_s
        for at, step, (low, high, speed) in zip(q, dq, self._ways, strict=True):
            left = max(high - at if step > 0.0 else at - low, 0.0)
            brakeable = max(sqrt(2.0 * braking * left) - 0.5 * braking * step_s, 0.0)
            allowed = min(speed, brakeable) * step_s
            if share * abs(step) > allowed:
                share = allowed / abs(step)
        return share
