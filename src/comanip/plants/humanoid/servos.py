"""From a velocity command for the hand to a reference for every joint servo, one each millisecond.

Inverse kinematics every 5 ms; in between the reference moves on a line, with its velocity fed forward. Held constant instead, the
steps ring through the wrist at 200 Hz, several newtons high. The line runs to where the hand shall be 5 ms later, so that
interpolating costs no delay.
"""

from __future__ import annotations

from math import exp

import numpy as np

from ...interfaces import Array
from .inverse_kinematics import InverseKinematics
from .robot import Robot
from .scene import PHYSICS_STEP_S, Scene
from .stance import Stance

EVERY = 5  # physics steps between two inverse kinematics
PERIOD_S = EVERY * PHYSICS_STEP_S


class ServoReferences:
    """Memory between two physics steps.

    command   (d,) velocity that the hand is asked for [m/s], written by the plant
    control   (J,) the servos' input, rewritten by `step`: reference + what carries the weight + what the damping takes away [rad]
    """

    def __init__(self, scene: Scene, robot: Robot, ik: InverseKinematics, *, smoothing_s: float, n_axes: int) -> None:
        servos, n = [robot.servo_of(j) for j in scene.joints], len(scene.joints)
        self._ik, self._smoothing = ik, smoothing_s
        self._keep = exp(-PERIOD_S / smoothing_s) if smoothing_s > 0 else 0.0
        self._lead = np.array([s.damping / s.stiffness for s in servos]) / PHYSICS_STEP_S  # velocity feed-forward [steps]
        self.command, self._moving = np.zeros(n_axes), np.zeros(n_axes)
        self.control, self._planned, self._per_step = np.zeros(n), np.zeros(n), np.zeros(n)
        self._offset, self._ahead = np.zeros(n), np.zeros(n)  # control - reference: what carries the weight; and all of it

    @property
    def reference(self) -> Array:
        """(J,) where the joints shall be now [rad]."""
        return np.asarray(self.control - self._ahead)

    def reset(self, stance: Stance, start: Array) -> None:
        self._ik.stand_at(stance.base)
        self._planned[:] = self._ik.reach(start)
        self._offset[:] = self._ahead[:] = stance.offset
        self.control[:] = self._planned + self._offset
        self._per_step[:] = 0.0
        self.command[:] = self._moving[:] = 0.0

    def plan(self) -> None:
        """The line of the next 5 ms: the command smoothed by a first-order lag (solved exactly), then inverse kinematics."""
        behind = self._moving - self.command
        travel = self.command * PERIOD_S + behind * (self._smoothing * (1.0 - self._keep))
        self._moving[:] = self.command + behind * self._keep
        planned = self._ik.step(travel / PERIOD_S)
        self._per_step[:] = (planned - self._planned) / EVERY
        self._ahead[:] = self._offset + self._lead * self._per_step
        self.control[:] = self._planned + self._ahead
        self._planned[:] = planned

    def step(self) -> None:
        self.control += self._per_step
