"""Which sequences ride together: groups of lanes that are nearly equally long, so that no lane waits for another.

A long sequence is cut into pieces, which ride side by side: a hidden Markov model forgets. Each piece runs over a margin on
either side that does not count, and what it has forgotten there is checked at every seam afterwards; where that was not enough,
the sequence gets wider margins, and then is taken whole.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

ALONE = 1.7  # a frame of a sequence that runs alone costs this many frames of a full group
LEAST_LENGTH = 64  # frames a lane: shorter groups would spend their time on adding up
PIECE = 1024  # frames that count in a piece: a group of them stays in a cache near the core
MARGIN, WIDE_MARGIN = 64, 320  # frames on either side
WHOLE = -1


class Plan(NamedTuple):
    """Pieces of sequences and the lanes that they ride in.

    first   (S + 1,) where each sequence's pieces begin
    pieces  (P, 4) rows: where a piece begins to run, begins to count, ceases to count, ceases to run
    order   (P,) pieces lane by lane
    lanes   (groups·W + 1,) where lanes begin in that order

    A group with one whole sequence is computed with lanes across frames and states; all others with lanes across pieces.
    """

    first: np.ndarray
    pieces: np.ndarray
    order: np.ndarray
    lanes: np.ndarray


def plan(lengths: np.ndarray, width: int, margins: np.ndarray | None = None) -> Plan:
    """Packs sequences, or pieces of them, into groups of `width` lanes: the longest sets the length, shorter ones fill lanes one
    after another. `margins` (S,) are MARGIN where not given, and WHOLE for a sequence that must not be cut."""
    lengths = np.asarray(lengths, dtype=np.int64)
    margins = np.full_like(lengths, MARGIN) if margins is None else margins
    number = np.where(margins == WHOLE, 1, _pieces_of(lengths, width))
    if len(lengths) == 1 == number[0]:
        return Plan(np.array([0, 1]), np.array([[0, 0, lengths[0], lengths[0]]]), np.array([0]), np.array([0] + [1] * width))
    pieces, first = _cut(lengths, number, margins)
    order, lanes = _pack(pieces[:, 3] - pieces[:, 0], width, _repeated(number, number) > 1)
    return Plan(first, pieces, order, lanes)


class Seating:
    """The plan for some sequences, and what has been learned about cutting them: one that remembers longer gets wider margins."""

    def __init__(self, lengths: np.ndarray, width: int) -> None:
        self._lengths, self._width = np.asarray(lengths, dtype=np.int64), width
        self._margins = np.full_like(self._lengths, MARGIN)
        self.plan = plan(self._lengths, width)

    def mend(self, failed: np.ndarray) -> bool:
        """Another plan for sequences (S,) that failed in pieces; False when none of them was cut."""
        again = failed & (np.diff(self.plan.first) > 1)
        if not again.any():
            return False
        self._margins[again] = np.where(self._margins[again] == MARGIN, WIDE_MARGIN, WHOLE)
        self.plan = plan(self._lengths, self._width, self._margins)
        return True


def _repeated(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """numpy.repeat, which on a machine of 32 bits takes no counts of 64."""
    return np.repeat(values, times.astype(np.intp))


def _pieces_of(lengths: np.ndarray, width: int) -> np.ndarray:
    """How many pieces of each sequence: as many in all as fill whole groups."""
    total = int(lengths.sum())
    if total < 3 * MARGIN * width:  # the margins would cost more than the lanes bring
        return np.ones_like(lengths)
    groups = -(-total // (PIECE * width))
    return np.maximum(lengths * (groups * width) // total, 1)


def _cut(lengths: np.ndarray, number: np.ndarray, margins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`pieces` and `first` of a Plan, with sequence s in number[s] parts of equal length."""
    first = np.concatenate([[0], np.cumsum(number)])
    owner = _repeated(np.arange(len(lengths)), number)
    ends = np.cumsum(lengths)
    starts = ends - lengths
    part = np.arange(first[-1]) - first[owner]
    counts_from = starts[owner] + part * lengths[owner] // number[owner]
    counts_to = starts[owner] + (part + 1) * lengths[owner] // number[owner]
    margin = np.maximum(margins, 0)[owner]
    runs_from = np.maximum(counts_from - margin, starts[owner])
    runs_to = np.minimum(counts_to + margin, ends[owner])
    return np.stack([runs_from, counts_from, counts_to, runs_to], axis=1).astype(np.int64), first.astype(np.int64)


def _pack(lengths: np.ndarray, width: int, cut: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`order` and `lanes` of a Plan, of pieces (P,) that run so long and are `cut` (P,) or whole sequences."""
    too_long = ~cut & (lengths > 2 * PIECE)  # side by side they would not fit into any cache
    alone = np.flatnonzero(too_long).tolist()
    waiting = np.argsort(lengths, kind="stable")  # shortest first, so that the longest is popped from the end
    waiting = waiting[~too_long[waiting]].tolist()
    sizes = lengths[waiting].tolist()
    groups: list[list[list[int]]] = []
    while waiting:
        group, used = _group(waiting, sizes, width)
        length, longest = max(used), group[0][0]
        if not cut[longest] and (ALONE * sum(used) <= length * width or sum(map(len, group)) == 1):
            alone.append(longest)  # the one that makes the others wait; they try again without it
            for s in sorted((s for lane in group for s in lane if s != longest), key=lengths.__getitem__):
                at = bisect_right(sizes, lengths[s])
                waiting.insert(at, s)
                sizes.insert(at, int(lengths[s]))
        else:
            groups.append(group)
    groups += [[[s]] + [[] for _ in range(width - 1)] for s in alone]
    lanes = [lane for group in groups for lane in group]
    return (
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
