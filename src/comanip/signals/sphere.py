"""Unit quaternions (w, x, y, z) as orientations: what can be added to one, and what lies between two.

q and -q are one orientation. A tangent vector at a base is the ROTATION VECTOR [rad], (..., 3), that turns the base into another
orientation, in the base's own axes (the hand's):

    exp(b, r) = b * (cos |r|/2, sin(|r|/2) r/|r|)         log(b, q) its inverse, the short way round, |r| <= pi

So turning the world (p * b, p * q) changes no tangent vector, and a standard deviation reads in rad. At |r| = pi both ways are
short; `log` then takes one of them. Nothing here raises; NaN goes through.
"""

from __future__ import annotations

import numpy as np

from ..interfaces import Array

SMALL = 1e-8  # [rad/2] below it sin(x)/x is 1 to the last bit
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def product(p: Array, q: Array) -> Array:
    """p * q, (..., 4): the turn q, then seen from p."""
    p, q = np.asarray(p, dtype=np.float64), np.asarray(q, dtype=np.float64)
    out = np.empty(np.broadcast_shapes(p.shape, q.shape))
    pw, px, py, pz = (p[..., i] for i in range(4))
    qw, qx, qy, qz = (q[..., i] for i in range(4))
    out[..., 0] = pw * qw - px * qx - py * qy - pz * qz
    out[..., 1] = pw * qx + px * qw + py * qz - pz * qy
    out[..., 2] = pw * qy - px * qz + py * qw + pz * qx
    out[..., 3] = pw * qz + px * qy - py * qx + pz * qw
    return out


def inverse(q: Array) -> Array:
    """The turn back, of unit quaternions (..., 4)."""
    return np.asarray(q, dtype=np.float64) * (1.0, -1.0, -1.0, -1.0)


def quaternion(rotation: Array) -> Array:
    """(..., 4), w >= 0 up to |r| = pi, of rotation vectors (..., 3) [rad]."""
    rotation = np.asarray(rotation, dtype=np.float64)
    half = 0.5 * np.sqrt((rotation * rotation).sum(axis=-1, keepdims=True))
    small = half < SMALL
    ratio = np.where(small, 0.5, 0.5 * np.sin(half) / np.where(small, 1.0, half))
    return np.concatenate([np.cos(half), ratio * rotation], axis=-1)


def rotation_vector(q: Array) -> Array:
    """(..., 3) [rad], |r| <= pi, of unit quaternions (..., 4) of either sign."""
    q = np.asarray(q, dtype=np.float64)
    w = q[..., :1]
    imaginary = np.where(w < 0.0, -1.0, 1.0) * q[..., 1:]
    sine = np.sqrt((imaginary * imaginary).sum(axis=-1, keepdims=True))
    small = sine < SMALL
    # the arc tangent, not the arc cosine: near no turn at all the cosine has lost half of the digits
    return np.where(small, 2.0, 2.0 * np.arctan2(sine, np.abs(w)) / np.where(small, 1.0, sine)) * imaginary


def exp(base: Array, rotation: Array) -> Array:
    """Orientation (..., 4) that the rotation vector (..., 3) [rad, in the base's axes] turns `base` (..., 4) into."""
    return normalised(product(base, quaternion(rotation)))


def log(base: Array, q: Array) -> Array:
    """The rotation vector (..., 3) [rad, in the base's axes] from `base` to `q`, (..., 4) each: the short way round."""
    return rotation_vector(product(inverse(base), q))


def distance(p: Array, q: Array) -> Array:
    """Angle (...) [rad] between orientations (..., 4), 0 to pi."""
    r = log(p, q)
    return np.asarray(np.sqrt((r * r).sum(axis=-1)))


def transport(start: Array, end: Array) -> Array:
    """Parallel transport (..., 3, 3): tangent vectors at `start`, carried along the shortest way, as tangent vectors at `end`.

    A tangent vector is written in axes that turn along with the way; carrying it without turning it on the sphere is turning it
    back by half of the way. A rotation matrix, so a covariance S becomes T S T^T.
    """
    return carrying(log(start, end))


def carrying(rotation: Array) -> Array:
    """The same (..., 3, 3) along the way that rotation vectors (..., 3) [rad] stand for."""
    return matrix(quaternion(-0.5 * rotation))


def matrix(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.asarray(q, dtype=np.float64)
    out = np.empty((*q.shape[:-1], 3, 3))
    w, x, y, z = (q[..., i] for i in range(4))
    out[..., 0, 0], out[..., 1, 1] = 1.0 - 2.0 * (y * y + z * z), 1.0 - 2.0 * (x * x + z * z)
    out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    out[..., 0, 1], out[..., 1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    out[..., 0, 2], out[..., 2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    out[..., 1, 2], out[..., 2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
    return out


def normalised(q: Array) -> Array:
    """Of length 1, (..., 4)."""
    q = np.asarray(q, dtype=np.float64)
    return np.asarray(q / np.sqrt((q * q).sum(axis=-1, keepdims=True)))


def continuous(q: Array) -> Array:
    """The same orientations (T, 4) with signs that never flip from frame to frame; the first keeps its own."""
    q = np.asarray(q, dtype=np.float64)
    flips = (q[1:] * q[:-1]).sum(axis=1) < 0.0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return q * signs[: len(q), None]


def mean(q: Array, weights: Array | None = None, start: Array | None = None, *, most: int = 50, close: float = 1e-13) -> Array:
    """The orientation (4,) with the smallest weighted sum of squared angles to q (N, 4): the tangent average, again and again.

    start   where to begin; default: the principal axis of sum w q q^T, which does not know the sign of a quaternion
    """
    q = np.asarray(q, dtype=np.float64)
    w = np.full(len(q), 1.0 / len(q)) if weights is None else np.asarray(weights) / np.sum(weights)
    found = np.linalg.eigh((q * w[:, None]).T @ q)[1][:, -1] if start is None else np.asarray(start, dtype=np.float64)
    for _ in range(most):
        step = w @ log(found, q)
        found = exp(found, step)
        if step @ step < close**2:
            break
    return found
