"""Low-pass filters and derivatives: zero-phase for recordings, a causal twin for the loop.

Both use the same second-order Butterworth section. Zero-phase runs it forward and backward (no delay, twice the
attenuation); the causal twin delays by about 0.225 / cutoff_hz seconds [s] at low frequency.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array

MAX_CUTOFF = 0.45  # of the sampling rate: above it the bilinear transform bends the filter out of shape


def lowpass_coefficients(cutoff_hz: float, dt: float) -> tuple[float, float, float, float, float]:
    """(b0, b1, b2, a1, a2) of a second-order Butterworth low-pass: bilinear transform, prewarped, unit gain at rest.

    Raises ParameterError when the cutoff is not inside (0, 0.45 / dt).
    """
    if not 0.0 < cutoff_hz * dt < MAX_CUTOFF:
        raise ParameterError(
            f"cutoff {cutoff_hz:g} Hz at a rate of {1.0 / dt:g} Hz; allowed: 0 < cutoff < {MAX_CUTOFF / dt:g} Hz"
        )
    k = math.tan(math.pi * cutoff_hz * dt)
    norm = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    b0 = k * k * norm
    return b0, 2.0 * b0, b0, 2.0 * (k * k - 1.0) * norm, (1.0 - math.sqrt(2.0) * k + k * k) * norm


class Lowpass:
    """Causal low-pass of one scalar signal in plain floats (about 0.3 us a step); starts settled on its first value."""

    __slots__ = ("_a1", "_a2", "_b0", "_b1", "_b2", "_s1", "_s2", "_started")

    def __init__(self, cutoff_hz: float, dt: float) -> None:
        self._b0, self._b1, self._b2, self._a1, self._a2 = lowpass_coefficients(cutoff_hz, dt)
        self.reset()

    def reset(self) -> None:
        self._s1 = self._s2 = 0.0
        self._started = False

    def step(self, value: float) -> float:
        """The filtered value (transposed direct form II). `value` must be finite: one NaN would stay for ever."""
        if not self._started:
            self._started = True
            self._s1 = value * (1.0 - self._b0)
            self._s2 = value * (self._b2 - self._a2)
        out = self._b0 * value + self._s1
        self._s1 = self._b1 * value - self._a1 * out + self._s2
        self._s2 = self._b2 * value - self._a2 * out
        return out


def smooth(values: Array, dt: float, cutoff_hz: float) -> Array:
    """Zero-phase low-pass of (T,) or (T, d): the section of `Lowpass` run forward, then backward."""
    from scipy.signal import sosfiltfilt  # slow to import

    b0, b1, b2, a1, a2 = lowpass_coefficients(cutoff_hz, dt)
    # Odd padding of three time constants keeps both ends from bending towards zero.
    padding = min(len(values) - 1, max(9, math.ceil(1.0 / (cutoff_hz * dt))))
    if padding < 1:
        return np.array(values, dtype=np.float64)
    return np.asarray(sosfiltfilt(np.array([[b0, b1, b2, 1.0, a1, a2]]), values, axis=0, padlen=padding))


def differentiate(values: Array, dt: float) -> Array:
    """Derivative of (T,) or (T, d) by central differences, second order at the ends too; needs T >= 3."""
    return np.asarray(np.gradient(values, dt, axis=0, edge_order=2))


def integrate(values: Array, dt: float) -> Array:
    """Integral of (T, d) from zero by the trapezium rule."""
    steps = 0.5 * dt * (values[1:] + values[:-1])
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(steps, axis=0)])


def resample(time: Array, values: Array, grid: Array, *, cutoff_hz: float | None = None) -> Array:
    """`values` (T, d) at the stamps of `grid` (N,) [s], linear between neighbours, held beyond the ends.

    With `cutoff_hz` the values are low-passed first at their own mean rate (zero-phase), so that a slower grid does not
    fold fast noise into slow motion.
    """
    if cutoff_hz is not None:
        dt = float(time[-1] - time[0]) / (len(time) - 1)
        values = smooth(resample(time, values, time[0] + dt * np.arange(len(time))), dt, cutoff_hz)
        time = time[0] + dt * np.arange(len(time))
    return np.stack([np.interp(grid, time, column) for column in values.T], axis=1)
