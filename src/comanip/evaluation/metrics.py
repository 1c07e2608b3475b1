"""Measures of a collaboration, with their sources. Forces (T,) [N], velocities (T,) [m/s] along one axis, dt [s]."""

from __future__ import annotations

import numpy as np

from ..interfaces import Array
from ..signals.filters import smooth


def effort(force: Array, dt: float) -> float:
    """Integral of F^2 [N^2 s]: what the interaction costs both, beyond carrying the load."""
    return float(np.sum(np.asarray(force) ** 2) * dt)


def work(force: Array, velocity: Array, dt: float) -> float:
    """Net work of the interaction force on the hand [J]: positive when the partner moves the robot."""
    return float(np.sum(np.asarray(force) * np.asarray(velocity)) * dt)


def energy_exchanged(force: Array, velocity: Array, dt: float) -> float:
    """Integral of |F v| [J]: what flows between the partners in either direction."""
    return float(np.sum(np.abs(np.asarray(force) * np.asarray(velocity))) * dt)


def internal_force(first: Array, second: Array) -> Array:
    """Part of two opposed forces that moves nothing (Groten et al. 2009): the smaller of them, signed as `first`."""
    first, second = np.asarray(first), np.asarray(second)
    opposed = np.sign(first) != np.sign(second)
    return np.where(opposed, np.sign(first) * np.minimum(np.abs(first), np.abs(second)), 0.0)


def effort_share(first: Array, second: Array) -> float:
    """Share of `first` in the sum of squared forces of both, 0 to 1; 0.5 when both work alike."""
    a, b = float(np.sum(np.asarray(first) ** 2)), float(np.sum(np.asarray(second) ** 2))
    return a / (a + b) if a + b > 0.0 else 0.5


def log_dimensionless_jerk(velocity: Array, dt: float) -> float:
    """LDLJ of Balasubramanian et al. 2012: -ln(T^3 / v_peak^2 * integral of jerk^2). Higher (nearer 0) is smoother."""
    v = np.asarray(velocity)
    peak = float(np.abs(v).max())
    if peak <= 0.0 or len(v) < 3:
        return 0.0
    jerk = np.diff(v, 2) / dt**2
    duration = len(v) * dt
    total = float(np.sum(jerk**2) * dt)
    return float(-np.log(duration**3 / peak**2 * total)) if total > 0.0 else 0.0


def vibration(force: Array, dt: float, moving: Array | None = None, *, above_hz: float = 2.5) -> float:
    """Root mean square [N] of what oscillates above `above_hz` in an interaction force (T,), where `moving` (T,) is true.

    People move a load together at up to about 1 Hz; what is faster is a loop that shakes, or tremor. Zero-phase, half of the
    amplitude passes at `above_hz`, 94 % at twice, 6 % at half of it.
    """
    force = np.asarray(force, dtype=float)
    fast = force - smooth(force, dt, above_hz)
    fast = fast if moving is None else fast[np.asarray(moving, dtype=bool)]
    return float(np.sqrt(np.mean(fast**2))) if len(fast) else 0.0


def tracking_rms(position: Array, reference: Array) -> float:
    """Root mean square distance between two paths (T, d) [m]."""
    apart = np.atleast_2d(np.asarray(position) - np.asarray(reference))
    return float(np.sqrt((apart**2).sum(axis=-1).mean()))
