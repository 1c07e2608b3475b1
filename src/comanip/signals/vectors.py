"""Arithmetic on a few axes in plain floats and plain order, as in the compiled tick: sum() compensates since Python 3.12."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt


def plain_sum(a: Sequence[float]) -> float:
    total = 0.0
    for x in a:
        total += x
    return total


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def length(a: Sequence[float]) -> float:
    return sqrt(dot(a, a))


def apart(a: Sequence[float], b: Sequence[float]) -> float:
    return length([x - y for x, y in zip(a, b, strict=True)])
