"""Measures of a collaboration, with their sources.

Forces [N] and velocities [m/s] are (T,) along one axis or (T, d); dt [s]. None depends on how the axes are turned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    power = np.asarray(force) * np.asarray(velocity)
    return float(np.sum(np.abs(power.sum(axis=1) if power.ndim == 2 else power)) * dt)


def internal_force(first: Array, second: Array) -> Array:
    """Part of two opposed forces that moves nothing (Groten et al. 2009), as `first` points.

    On one axis the smaller of the two where they are opposed. In d axes the smaller one, times the cosine by which they are.
    """
    first, second = np.asarray(first), np.asarray(second)
    if first.ndim < 2 or first.shape[1] == 1:
        opposed = np.sign(first) != np.sign(second)
        return np.where(opposed, np.sign(first) * np.minimum(np.abs(first), np.abs(second)), 0.0)
    a, b = (np.maximum(np.linalg.norm(f, axis=1), 1e-12) for f in (first, second))
    against = np.maximum(-(first * second).sum(axis=1) / (a * b), 0.0)
    return np.asarray(first / a[:, None] * (np.minimum(a, b) * against)[:, None])


def effort_share(first: Array, second: Array) -> float:
    """Share of `first` in the sum of squared forces of both, 0 to 1; 0.5 when both work alike."""
    a, b = float(np.sum(np.asarray(first) ** 2)), float(np.sum(np.asarray(second) ** 2))
    return a / (a + b) if a + b > 0.0 else 0.5


def log_dimensionless_jerk(velocity: Array, dt: float) -> float:
    """LDLJ of Balasubramanian et al. 2012: -ln(T^3 / v_peak^2 * integral of jerk^2). Higher (nearer 0) is smoother."""
    v = np.asarray(velocity)
    peak = float(np.sqrt((v**2).sum(axis=1).max()) if v.ndim == 2 and v.shape[1] > 1 else np.abs(v).max())
    if peak <= 0.0 or len(v) < 3:
        return 0.0
    jerk = np.diff(v, 2, axis=0) / dt**2
    duration = len(v) * dt
    total = float(np.sum(jerk**2) * dt)
    return float(-np.log(duration**3 / peak**2 * total)) if total > 0.0 else 0.0


def vibration(force: Array, dt: float, moving: NDArray[Any] | None = None, *, above_hz: float = 2.5) -> float:
    """Root mean square [N] of what oscillates above `above_hz` in an interaction force, (T,) or (T, d), where `moving`.

    People move a load together at up to about 1 Hz; what is faster is a loop that shakes, or tremor. Zero-phase, half of the
    amplitude passes at `above_hz`, 94 % at twice, 6 % at half of it. 0 where nothing moves.
    """
    force = np.asarray(force, dtype=float)
    fast = force - smooth(force, dt, above_hz)
    fast = fast if moving is None else fast[np.asarray(moving, dtype=bool)]
    return float(np.sqrt(np.mean((fast**2).sum(axis=1) if fast.ndim == 2 else fast**2))) if len(fast) else 0.0


def widest(vectors: Array) -> float:
    """Greatest distance between any two of (T, d): on one axis, from peak to peak."""
    v = np.asarray(vectors)
    if v.ndim < 2 or v.shape[1] == 1:
        return float(np.ptp(v))
    return float(np.sqrt(((v[:, None] - v[None]) ** 2).sum(axis=2).max()))


def tracking_rms(position: Array, reference: Array) -> float:
    """Root mean square distance between two paths (T, d) [m]."""
    apart = np.atleast_2d(np.asarray(position) - np.asarray(reference))
    return float(np.sqrt((apart**2).sum(axis=-1).mean()))
