"""Teleoperation: a skill whose brain is a human. Bilateral 2-channel velocity-force coupling, eqs. (1) and (2)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, HapticDevice, Observation


class Teleoperation:
    """Hands the handle's velocity to the robot and the robot's force to the handle.

    Eq. (1)  F_m = U K_f F_s          force_gain K_f (scalar or (d,)), rotation U (d, d) from sensor to device frame
    Eq. (2)  v   = s_v U^-1 v_h       velocity_scale s_v maps the device's workspace on the robot's

    F_s is the RAW sensor force, so the teacher feels the load's weight scaled by K_f. U must be orthonormal with det +1.
    """

    notice = ""
    stop_reason = ""

    def __init__(
        self,
        device: HapticDevice,
        *,
        n_axes: int,
        dt: float,
        force_gain: float | Array = 0.15,
        velocity_scale: float = 1.3,
        rotation: Array | None = None,
    ) -> None:
        u = np.eye(n_axes) if rotation is None else np.asarray(rotation, dtype=float)
        if u.shape != (n_axes, n_axes) or not np.allclose(u @ u.T, np.eye(n_axes), atol=1e-6) or np.linalg.det(u) < 0:
            raise ParameterError(
                f"rotation U must be orthonormal ({n_axes}, {n_axes}) with determinant +1; got {np.round(u, 3).tolist()}"
            )
        self._device, self._dt, self._scale = device, dt, velocity_scale
        self._render = u @ np.diag(np.broadcast_to(np.asarray(force_gain, dtype=float), (n_axes,)))
        self._back = velocity_scale * u.T  # U^-1 = U^T
        self._handle_velocity, self._handle_force = np.zeros(n_axes), np.zeros(n_axes)
        self._diagnostics = {
            "device.velocity": self._handle_velocity,
            "device.force": self._handle_force,
        }

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return self._diagnostics

    def reset(self, obs: Observation) -> None:
        self._device.reset()

    def step(self, obs: Observation, command: Command) -> None:
        if np.isfinite(obs.sensor_force).all():  # a missing sample holds the last force for one tick
            np.matmul(self._render, obs.sensor_force, out=self._handle_force)
        self._device.write(self._handle_force, self._dt)
        self._device.read(self._handle_velocity)
        np.matmul(self._back, self._handle_velocity, out=command.velocity)
        command.acceleration[:] = 0.0
        command.position[:] = obs.position
