"""Which sequences ride together: groups of lanes that are nearly equally long, so that no lane waits for another."""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

ALONE = 1.7  # a frame of a sequence that runs alone costs this many frames of a full group
LEAST_LENGTH = 64  # frames a lane: shorter groups would spend their time on adding up


class Plan(NamedTuple):
    """Rows where sequences begin (S + 1,); sequences lane by lane (S,); where lanes begin in that order (groups·W + 1,).

    A group with one sequence is computed with lanes across frames and states; all others with lanes across sequences.
    """

    starts: np.ndarray
    order: np.ndarray
    lanes: np.ndarray


def plan(lengths: np.ndarray, width: int) -> Plan:
    """Packs sequences into groups of `width` lanes: the longest sets the length, shorter ones fill lanes one after another."""
    lengths = np.asarray(lengths, dtype=np.int64)
    waiting = np.argsort(lengths, kind="stable").tolist()  # shortest first, so that the longest is popped from the end
    sizes = lengths[waiting].tolist()
    groups: list[list[list[int]]] = []
    alone: list[int] = []
    while waiting:
        group, used = _group(waiting, sizes, width)
        length = max(used)
        if ALONE * sum(used) <= length * width or sum(map(len, group)) == 1:
            longest = group[0][0]  # the one that makes the others wait; they try again without it
            alone.append(longest)
            for s in sorted((s for lane in group for s in lane if s != longest), key=lengths.__getitem__):
                at = bisect_right(sizes, lengths[s])
                waiting.insert(at, s)
                sizes.insert(at, int(lengths[s]))
        else:
            groups.append(group)
    groups += [[[s]] + [[] for _ in range(width - 1)] for s in alone]
    lanes = [lane for group in groups for lane in group]
    return Plan(
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        np.array([s for lane in lanes for s in lane], dtype=np.int64),
        np.concatenate([[0], np.cumsum([len(lane) for lane in lanes])]).astype(np.int64),
    )


def _group(waiting: list[int], sizes: list[int], width: int) -> tuple[list[list[int]], list[int]]:
    """Takes one group out of what waits: each lane as full as the longest sequence allows."""
    length = max(sizes[-1], LEAST_LENGTH)
    if len(sizes) < width:
        length = sizes[-1]
    lanes: list[list[int]] = []
    used: list[int] = []
    for _ in range(width):
        lane: list[int] = []
        room = length
        while sizes and (at := bisect_right(sizes, room)):
            lane.append(waiting.pop(at - 1))
            room -= sizes.pop(at - 1)
        lanes.append(lane)
        used.append(length - room)
    return lanes, used
