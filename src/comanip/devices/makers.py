"""Haptic devices by name, as lessons make them: `parts.DEVICES`.

Each is called with the person who holds it, and by name with the task's axes and with `moves` (n, d) [m], the displacements that
the handle will go through from where it is taken.
"""

from __future__ import annotations

import numpy as np

from ..interfaces import Array, HapticDevice
from .phantom import Handle, HeldHandle, Person, phantom

EDGE_M = 0.0155  # 267 mm of height, taken hold of so far above the lowest: at a scale of 1.6 a lift of 0.4 m fits


def ideal(teacher: Person, *, axes: tuple[str, ...], moves: Array) -> HapticDevice:
    """Mass, friction and an 8.5 N limit; no walls."""
    return HeldHandle(teacher, n_axes=len(axes))


def phantom_device(teacher: Person, *, axes: tuple[str, ...], moves: Array) -> HapticDevice:
    """A PHANToM Premium 1.5, taken hold of where all of `moves` fits."""
    handle = phantom(axes)
    return HeldHandle(teacher, handle, n_axes=len(axes), start_m=_taken_at(handle, moves))


def _taken_at(handle: Handle, moves: Array) -> Array:
    """(d,) where a teacher takes hold of the handle: near the edge that the course leads away from."""
    start = []
    for (low, high), least, most in zip(handle.workspace_m or (), moves.min(axis=0), moves.max(axis=0), strict=True):
        if least > -EDGE_M and most > EDGE_M:
            start.append(round(low + EDGE_M, 3))
        elif most < EDGE_M and least < -EDGE_M:
            start.append(round(high - EDGE_M, 3))
        else:
            start.append(0.5 * (low + high) - 0.5 * float(least + most))
    return np.array(start)
