"""Does the robot touch itself? Looked at beside the physics, in a model of its own in which every shape is solid.

Contacts between links would cost half as much again at every millisecond and are never wanted: one look every 20 ms is enough to
end the run. Neighbours overlap by design, and so do other links as the robot stands; those pairs do not count.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from ...interfaces import Array
from .scene import Scene
from .simulator import mujoco

CLOSE_M = 0.005  # links that are closer as the robot stands are built that way


class SelfCollision:
    """Of the robot and the beam in its hand. The floor is not its business."""

    def __init__(self, scene: Scene) -> None:
        self._model = model = copy(scene.model)
        own = np.asarray(model.geom_bodyid > 0)
        model.geom_contype[:] = model.geom_conaffinity[:] = own
        model.body_contype[1:] = model.body_conaffinity[1:] = 1
        model.body_contype[0] = model.body_conaffinity[0] = 0
        self._data = mujoco().MjData(model)
        self._data.qpos[scene.position_at] = scene.posture
        self._built = np.zeros((model.nbody, model.nbody), dtype=bool)
        model.geom_margin[:] = CLOSE_M
        first, second = self._contacts()
        self._built[first, second] = self._built[second, first] = True
        model.geom_margin[:] = 0.0

    def look(self, positions: Array) -> str:
        """The first two links that touch at `positions` (nq,): "RARM3 touches CHEST1"; empty when none do."""
        self._data.qpos[:] = positions
        first, second = self._contacts()
        for a, b in zip(first, second, strict=True):
            if not self._built[a, b]:
                return f"{self._model.body(a).name} touches {self._model.body(b).name}"
        return ""

    def _contacts(self) -> tuple[Array, Array]:
        """The bodies of every contact, twice (contacts,)."""
        mj, model, data = mujoco(), self._model, self._data
        mj.mj_kinematics(model, data)
        mj.mj_collision(model, data)
        pairs = model.geom_bodyid[data.contact.geom]
        return pairs[:, 0], pairs[:, 1]
