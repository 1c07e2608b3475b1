"""Turns between frames, one vector at a time, in plain floats: a tick has four of them.

A quaternion is (w, x, y, z), of length 1, and turns vectors of a frame into another. Stated are they in robot.toml:
"same", "hand" (the frame turns with the hand, as the pose says), a quaternion, or "hand" and a quaternion (fixed to the hand).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..errors import ParameterError

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
NONE: Quaternion = (1.0, 0.0, 0.0, 0.0)
HAND = "hand"


def turned(q: Sequence[float], v: Sequence[float]) -> Vector:
    """`v` turned by the unit quaternion `q`."""
    w, a, b, c = q
    x, y, z = v
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx)


def back(q: Sequence[float]) -> Quaternion:
    """The turn the other way."""
    return (q[0], -q[1], -q[2], -q[3])


def after(p: Sequence[float], q: Sequence[float]) -> Quaternion:
    """First `q`, then `p`."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def is_turn(q: Sequence[float]) -> bool:
    """Whether it is a quaternion of length 1, as far as a driver rounds."""
    return all(map(math.isfinite, q)) and abs(math.hypot(*q) - 1.0) < 1e-2


class Turn(NamedTuple):
    """How a frame lies to that of the pose: `fixed`, then, where it goes `with_hand`, as the hand."""

    with_hand: bool = False
    fixed: Quaternion = NONE

    def now(self, hand: Sequence[float]) -> Quaternion:
        """The turn of vectors of that frame into the pose's, while the hand is turned so."""
        return after(hand, self.fixed) if self.with_hand else self.fixed


def parsed(text: object) -> Turn:
    """ParameterError says what is allowed."""
    allowed = 'allowed: "same", "hand", a quaternion [w, x, y, z] of length 1, or "hand w x y z"'
    words = text.replace(",", " ").split() if isinstance(text, str) else list(text) if isinstance(text, list | tuple) else [None]
    with_hand = bool(words) and words[0] == HAND
    numbers = words[1:] if with_hand else words
    if (numbers == ["same"] and not with_hand) or (with_hand and not numbers):
        return Turn(with_hand)
    try:
        q = tuple(float(n) for n in numbers)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        q = ()
    if len(q) != 4 or not is_turn(q):
        raise ParameterError(f"{text!r} is no turn; {allowed}")
    size = math.hypot(*q)
    return Turn(with_hand, (q[0] / size, q[1] / size, q[2] / size, q[3] / size))
