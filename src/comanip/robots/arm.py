"""The socket of a real arm, in three dimensions: what `hand.HandPlant` makes a Plant of.

An adapter says what its sensors said last, each with its own stamp on this machine's clock, and takes a velocity and a target.
It never waits, and raises nothing: what is wrong with it stands in `problem`.
"""

from __future__ import annotations

from math import nan
from typing import Protocol

from .turns import NONE, Quaternion, Vector

MISSING: Vector = (nan, nan, nan)


class Sensed:
    """The latest of each signal, in the frame of the pose; NaN where there is none.

    time         [s] of the pose, on this machine's monotonic clock; force_time that of the force
    position [m], orientation (w, x, y, z) of the hand; velocity [m/s], NaN where nobody measures it
    force        F_s [N], of the OBJECT ON THE HAND
    joints       positions [rad] or [m], by name
    """

    __slots__ = ("force", "force_time", "joints", "orientation", "position", "time", "velocity")

    def __init__(self) -> None:
        self.time = self.force_time = nan
        self.position, self.velocity, self.force = MISSING, MISSING, MISSING
        self.orientation: Quaternion = NONE
        self.joints: dict[str, float] = {}


class Arm(Protocol):
    """What moves a hand.

    joints    names of the joints it says, known once it is open
    """

    joints: tuple[str, ...]

    @property
    def problem(self) -> str:
        """Empty while it works; else why the run must end."""
        ...

    @property
    def notice(self) -> str:
        """What the user should know ("wrench refused: unknown frame"); empty when all is well."""
        ...

    def missing(self) -> str:
        """What has not been heard yet, for an error; empty when there is a pose and a force."""
        ...

    def sense(self, out: Sensed) -> None:
        """Writes the latest of each signal."""
        ...

    def send(self, velocity: Vector, target: Vector, orientation: Quaternion, measured: Vector) -> None:
        """For one control period: the hand's velocity [m/s], or the target [m] and orientation, whichever this arm takes.

        measured   the hand's velocity now [m/s], for arms that take a force
        """
        ...

    def listener(self) -> str:
        """Why nobody would hear a command, as far as it can be known; empty: somebody does, or nobody can know."""
        ...

    def close(self) -> None:
        """Lets go of the connection; the low level stands by itself then."""
        ...
