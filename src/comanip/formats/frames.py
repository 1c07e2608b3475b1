"""Frames of the signals: a vector is turned into the frame of the position where the turn is known or stated, else refused.

Known are the transforms that a file holds (/tf, TransformStamped, Odometry), along any chain of them. Stated are those of
`Columns.frames`: "same" (no turn), "hand" (the frame turns with the hand, as the orientation recorded beside the position says)
or a quaternion "w,x,y,z" that turns vectors of that frame into the position's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import ChannelError, ParameterError, RecordingError
from ..interfaces import Array
from ..recording import Channel
from .messages import Transforms

HAND = "hand"
_BEYOND_S = 0.05  # a turn that is held for longer than this is said


def turned(
    path: Path,
    channel: Channel,
    into: Channel,
    what: str,
    *,
    stated: Mapping[str, str],
    turns: Sequence[Transforms],
    orientation: Channel | None,
    notes: list[str],
) -> Channel:
    """`channel` in the frame of the position `into`. ChannelError when how the frames lie to each other is not known."""
    source, target = channel.frame.lstrip("/"), into.frame.lstrip("/")
    if not source or not target or source == target:
        return channel
    edges = [*turns, *_edges(path, stated, source, target, orientation)]
    chain = _chain(edges, source, target)
    if chain is None:
        raise ChannelError(
            f"{path}: {what} is in frame {source!r}, the position in {target!r}, and the file does not say how they lie to each "
            f"other; state it: frames={{{source!r}: ...}} (--frame {source}=...), one of same, hand (it turns with the recorded "
            "orientation), or a quaternion w,x,y,z"
        )
    if set(channel.axes) != set("xyz"):
        raise ChannelError(f"{path}: {what} has the axes {', '.join(channel.axes)}; turning it into {target!r} needs x, y, z")
    order = [channel.axes.index(a) for a in "xyz"]
    values = channel.values[:, order]
    for edge, forward in chain:
        values = rotate(_at(path, edge, channel.time, what, notes) * ([1, 1, 1, 1] if forward else [1, -1, -1, -1]), values)
    way = " -> ".join([source, *[e.parent if forward else e.child for e, forward in chain]])
    notes.append(f"{what} turned into frame {target} ({way})")
    return replace(channel, values=values, frame=into.frame, axes=("x", "y", "z"))


def _edges(path: Path, stated: Mapping[str, str], source: str, target: str, orientation: Channel | None) -> list[Transforms]:
    found = []
    for name, text in stated.items():
        child = name.lstrip("/")
        if text == HAND:
            if orientation is None:
                raise ChannelError(
                    f"{path}: frame {name!r} is said to turn with the hand, and no orientation lies beside the position"
                )
            quaternions = orientation.values[:, [orientation.axes.index(a) for a in "wxyz"]]
            found.append(Transforms(target, child, orientation.time, quaternions))
        else:
            found.append(Transforms(target, child, np.zeros(1), np.array([_quaternion(name, text)])))
    return found


def _quaternion(name: str, text: str) -> Array:
    if text == "same":
        return np.array([1.0, 0.0, 0.0, 0.0])
    try:
        values = np.array([float(part) for part in text.replace(",", " ").split()])
    except ValueError:
        values = np.empty(0)
    if values.shape != (4,) or not np.isfinite(values).all() or not abs(np.linalg.norm(values) - 1.0) < 1e-2:
        raise ParameterError(f"frame {name}={text!r}; allowed: same, hand, or a quaternion w,x,y,z of length 1")
    return values


def _chain(edges: Sequence[Transforms], source: str, target: str) -> list[tuple[Transforms, bool]] | None:
    """The shortest way from one frame to another: (transform, whether from child to parent); None when there is none."""
    waiting: deque[tuple[str, list[tuple[Transforms, bool]]]] = deque([(source, [])])
    seen = {source}
    while waiting:
        here, way = waiting.popleft()
        if here == target:
            return way
        for edge in edges:
            for start, end, forward in ((edge.child, edge.parent, True), (edge.parent, edge.child, False)):
                if start == here and end not in seen:
                    seen.add(end)
                    waiting.append((end, [*way, (edge, forward)]))
    return None


def _at(path: Path, edge: Transforms, time: Array, what: str, notes: list[str]) -> Array:
    """(n, 4) unit quaternions at the stamps asked for: linear between neighbours of one sign, the ends held."""
    norms = np.linalg.norm(edge.turns, axis=1)
    bad = np.flatnonzero(~(np.abs(norms - 1.0) < 0.05))
    if len(bad):
        k = int(bad[0])
        raise RecordingError(
            f"{path}: the turn from {edge.child} to {edge.parent} at t = {edge.time[k]:.6f} s is {edge.turns[k].tolist()}; "
            "allowed: quaternions of length 1"
        )
    if len(edge.time) == 1:
        return np.repeat(edge.turns / norms[:, None], len(time), axis=0)
    far = max(float(edge.time[0] - time.min()), float(time.max() - edge.time[-1]), 0.0) if len(time) else 0.0
    if far > _BEYOND_S and np.ptp(edge.turns, axis=0).max() > 1e-9:
        notes.append(f"{what}: the turn from {edge.child} to {edge.parent} is held for {far:.3g} s beyond its stamps")
    smooth = one_sign(edge.turns / norms[:, None])
    found = np.column_stack([np.interp(time, edge.time, column) for column in smooth.T])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def one_sign(quaternions: Array) -> Array:
    """(n, 4) with the sign of each as near to the one before as can be: q and -q are one turn."""
    steps = np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1))
    steps[steps == 0.0] = 1.0
    return quaternions * np.concatenate([[1.0], np.cumprod(steps)])[:, None]


def rotate(quaternions: Array, vectors: Array) -> Array:
    """(n, 3) vectors turned by (n, 4) unit quaternions w, x, y, z."""
    w, u = quaternions[:, :1], quaternions[:, 1:]
    t = 2.0 * np.cross(u, vectors)
    return vectors + w * t + np.cross(u, t)
