"""One exact step of y'' = -k y - c y' + u for u held constant, shared by the beam and the controller of eq. (8)."""

from __future__ import annotations

from math import cos, cosh, exp, expm1, sin, sinh, sqrt
from typing import NamedTuple


class Step(NamedTuple):
    """y(h) = yy y + yv y' + yu u;  y'(h) = vy y + vv y' + vu u."""

    yy: float
    yv: float
    yu: float
    vy: float
    vv: float
    vu: float


def second_order_step(k: float, c: float, h: float) -> Step:
    """Stiffness k >= 0 [1/s^2], damping c >= 0 [1/s], step h [s]; any of under-, over- and undamped, and k = 0."""
    a = 0.5 * c
    w2 = k - a * a
    if w2 > 1e-12:
        w = sqrt(w2)
        co, si = exp(-a * h) * cos(w * h), exp(-a * h) * sin(w * h) / w
    elif w2 < -1e-12:
        w = sqrt(-w2)
        co, si = exp(-a * h) * cosh(w * h), exp(-a * h) * sinh(w * h) / w
    else:
        co, si = exp(-a * h), h * exp(-a * h)
    if k * h * h > 1e-6:
        yu = (1.0 - co - a * si) / k
    elif c * h > 1e-6:
        yu = (h + expm1(-c * h) / c) / c  # limit k -> 0
    else:
        yu = 0.5 * h * h
    return Step(co + a * si, si, yu, -k * si, co - a * si, si)
