"""Recorded force, replayed: the paper's Fig. 7, and the free run of `comanip evaluate`.

An open loop. The hand follows its command exactly and the force arrives whatever the robot does; it says how a skill responds
to force in time, and nothing about collaboration.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation


def distort_time(duration_s: float, knots: list[tuple[float, float]], dt: float) -> Array:
    """Stretches time piecewise: (T,) original times to read at each new tick.

    knots: (new time, original time) pairs [s]; both must not decrease. Equal original times hold the signal still.
    """
    new, old = np.array(sorted(knots), dtype=float).T
    if (np.diff(old) < 0).any():
        raise ParameterError(f"time must not run backwards in a distortion; got knots {knots}")
    return np.interp(np.arange(0.0, duration_s + dt / 2, dt), new, old)


class ReplayPlant:
    """A free hand under a recorded interaction force.

    force           (T, d) [N], one row a tick of `dt`; the last row is held when the run is longer
    start_position  (d,) [m]
    """

    def __init__(self, force: Array, *, dt: float, start_position: Array, axes: tuple[str, ...] = ("z",)) -> None:
        self._force = np.atleast_2d(np.asarray(force, dtype=float))
        self.dt, self.axes = dt, tuple(axes)
        self._start = np.asarray(start_position, dtype=float)
        d = len(self.axes)
        if self._force.shape[1] != d or self._start.shape != (d,):
            raise ParameterError(
                f"for axes {self.axes} force must be (T, {d}) and start_position ({d},); "
                f"got {self._force.shape} and {self._start.shape}"
            )
        self._position, self._velocity = self._start.copy(), np.zeros(d)
        self._tick = 0

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return {}

    @property
    def stop_reason(self) -> str:
        return ""

    def reset(self) -> None:
        self._position[:], self._velocity[:], self._tick = self._start, 0.0, 0

    def read(self, obs: Observation) -> None:
        obs.time = self._tick * self.dt
        obs.position[:], obs.velocity[:] = self._position, self._velocity
        obs.force[:] = self._force[min(self._tick, len(self._force) - 1)]
        obs.sensor_force[:] = np.nan

    def write(self, command: Command) -> None:
        self._velocity[:] = command.velocity
        self._position[:] = command.position

    def advance(self) -> None:
        self._tick += 1
