"""What the field uses, behind the same socket, to be measured against."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation


class MassDamper:
    """Admittance M dv/dt = F - D v (the paper's ref. [1]). D alone (M = 0) is constant damping v = F / D."""

    notice = ""
    stop_reason = ""

    def __init__(self, *, n_axes: int, dt: float, mass_kg: float = 2.0, damping_ns_per_m: float = 10.0) -> None:
        if not (mass_kg >= 0.0 and damping_ns_per_m > 0.0):
            raise ParameterError(f"mass >= 0 and damping > 0; got {mass_kg} kg and {damping_ns_per_m} N s/m")
        self._dt, self._mass, self._damping = dt, mass_kg, damping_ns_per_m
        self._velocity = np.zeros(n_axes)

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {}

    def reset(self, obs: Observation) -> None:
        self._velocity[:] = 0.0

    def step(self, obs: Observation, command: Command) -> None:
        force = np.where(np.isfinite(obs.force), obs.force, 0.0)
        self._velocity[:] = (self._mass * self._velocity + self._dt * force) / (self._mass + self._dt * self._damping)
        if self._mass == 0.0:
            self._velocity[:] = force / self._damping
        command.velocity[:] = self._velocity
        command.position[:] = obs.position + self._dt * self._velocity
        command.acceleration[:] = 0.0
