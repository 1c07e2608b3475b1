"""What a number is worth: the same number of rules that know nothing, or nearly nothing, of the task.

Velocity hardly changes within one frame, so a one-step R² of 0.97 is no merit where the last velocity gives 0.998; a free run of
5 cm is none where the hand that never moves ends 4 cm away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..interfaces import Array
from ..lessons.demonstration import Demonstration
from ..lessons.faults import kinds_of_axes

ONSET = 0.25  # of the usual peak: where a force begins
REST_S = 0.1  # the first so many seconds say what the force is before anything happens
_LEAST = 1e-4  # of a channel's variance: what a step from frame to frame varies at least


def last_velocity(lesson: Demonstration) -> Array:
    """(T, d) each frame's velocity foreseen as that of the frame before; zero before the first."""
    return np.concatenate([np.zeros_like(lesson.velocity[:1]), lesson.velocity[:-1]])


def standing_still(lesson: Demonstration) -> Array:
    """(T, d) the path of a hand that never leaves its first position."""
    return np.repeat(lesson.position[:1], len(lesson), axis=0)


def force_onset(force: Array, dt: float, unit: str, peaks: dict[str, float]) -> int:
    """First frame where a force (T, d), its first 0.1 s taken off, is a quarter of the usual peak; T where none is."""
    size = sizes(force, dt, unit)
    above = np.max([size[kind] > ONSET * peaks.get(kind, np.inf) for kind in size], axis=0)
    return int(np.argmax(above)) if above.any() else len(force)


def sizes(force: Array, dt: float, unit: str) -> dict[str, Array]:
    """Unit -> (T,) length of the force in the axes of that unit, without what it is at the beginning."""
    moved = force - force[: max(1, round(REST_S / dt))].mean(axis=0)
    return {kind: np.linalg.norm(moved[:, columns], axis=1) for kind, columns in kinds_of_axes(unit, force.shape[1]).items()}


@dataclass(frozen=True, eq=False)
class MeanLesson:
    """The lessons' mean way, from the onset of their force on or by the time since they began.

    way (T, d) displacement; start (d,) where it begins on the average; peaks the usual peak of the force by unit
    """

    way: Array
    start: Array
    peaks: dict[str, float]
    onset: bool = True

    @classmethod
    def of(cls, lessons: Sequence[Demonstration], *, onset: bool = True) -> MeanLesson:
        units = lessons[0].units.get("force", "")
        tops = [{k: float(v.max()) for k, v in sizes(x.force, x.dt, units).items()} for x in lessons] if onset else [{}]
        peaks = {kind: float(np.median([top[kind] for top in tops])) for kind in tops[0]}
        begins = [min(force_onset(x.force, x.dt, units, peaks), len(x) - 1) if onset else 0 for x in lessons]
        ways = [x.position[begin:] for x, begin in zip(lessons, begins, strict=True)]
        longest = max(len(w) for w in ways)
        rest = [np.concatenate([w - w[0], np.repeat(w[-1:] - w[0], longest - len(w), axis=0)]) for w in ways]
        return cls(np.mean(rest, axis=0), np.mean([w[0] for w in ways], axis=0), peaks, onset)

    def path(self, lesson: Demonstration, *, in_place: bool = False) -> Array:
        """(T, d) from the lesson's first position, still until its force sets in; `in_place`: where the lessons were instead."""
        begin = force_onset(lesson.force, lesson.dt, lesson.units.get("force", ""), self.peaks) if self.onset else 0
        found = np.repeat(self.start[None], len(lesson), axis=0) if in_place else standing_still(lesson)
        left = len(lesson) - begin
        if left > 0:
            way = np.concatenate([self.way, np.repeat(self.way[-1:], max(0, left - len(self.way)), axis=0)])
            found[begin:] += way[:left]
        return found


def persistence_log_likelihood(frames: Array, others: Sequence[Array]) -> float:
    """A frame, of frames (T, D) [nats]: each is a Gaussian step from the one before, of the covariance that steps of other
    lessons have; the first frame is not counted."""
    steps = np.concatenate([np.diff(x, axis=0) for x in others])
    spread = np.var(np.concatenate(list(others)), axis=0)
    covariance = steps.T @ steps / len(steps) + np.diag(_LEAST * spread + 1e-300)
    moved = np.diff(frames, axis=0)
    squared = np.einsum("ti,ij,tj->t", moved, np.linalg.inv(covariance), moved)
    return float(np.mean(-0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * covariance)[1])))
