"""A picture of an episode from the side, drawn in numpy: no library of figures is needed in a loop that trains."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Array

if TYPE_CHECKING:
    from .episode import Episode

HEIGHT, WIDTH = 240, 400
PIXELS_PER_M = 220.0
PIXELS_PER_N = 4.0
PAPER, BEAM, MEANT = (250, 249, 246), (120, 96, 70), (190, 190, 190)
ROBOT, PERSON, FORCE = (38, 84, 124), (214, 120, 46), (180, 40, 40)
MODES = {"RUN": (60, 150, 80), "COMPLY": (220, 170, 40), "HOLD": (190, 50, 50)}
Picture = NDArray[np.uint8]
Place: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[int, int, int]
_ROWS, _COLUMNS = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)


def picture(episode: Episode) -> Picture:
    """(240, 400, 3): the robot's hand left, the partner's right, the object between them.

    Grey is where the hand is meant to be, red the partner's force on the robot's hand, and a corner the envelope's mode.
    """
    image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[:] = PAPER
    across, up = _shown_axes(episode)
    start, obs, plant = episode.case.start_m, episode.loop.obs, episode.loop.plant
    length = episode.case.task.carried.length_m

    def at(place: Array, along_m: float) -> Place:
        moved = place - start
        sideways = moved[across] if across is not None else 0.0
        return 90.0 + PIXELS_PER_M * (along_m + sideways), HEIGHT - 70.0 - PIXELS_PER_M * float(moved[up])

    hand, far = at(obs.position, 0.0), at(plant.channels["partner.position"][0], length)
    meant = np.array(episode.meant[min(episode.ticks, len(episode.meant) - 1)])
    _disc(image, at(meant, 0.0), 9.0, MEANT)
    _line(image, hand, far, 5.0, BEAM)
    _disc(image, hand, 10.0, ROBOT)
    _disc(image, far, 10.0, PERSON)
    force = plant.channels["hand.true_force"][0]
    tip = hand[0] + PIXELS_PER_N * (force[across] if across is not None else 0.0), hand[1] - PIXELS_PER_N * float(force[up])
    _line(image, hand, tip, 2.5, FORCE)
    if episode.setting.envelope:
        image[6:18, 6:18] = MODES[episode.mode]
    return image


def _shown_axes(episode: Episode) -> tuple[int | None, int]:
    """Columns of the axis drawn sideways (None: there is none), and of the one drawn upwards, the steepest."""
    axes = episode.case.task.axes_
    up = int(np.argmax([abs(axis.up) for axis in axes]))
    others = [i for i in range(len(axes)) if i != up]
    return (others[0] if others else None), up


def _disc(image: Picture, centre: Place, radius: float, colour: Colour) -> None:
    image[(_COLUMNS - centre[0]) ** 2 + (_ROWS - centre[1]) ** 2 <= radius**2] = colour


def _line(
    image: Picture, one: tuple[float, float], other: tuple[float, float], half: float, colour: tuple[int, int, int]
) -> None:
    """All pixels within `half` of the straight line between two places."""
    (x, y), (dx, dy) = one, (other[0] - one[0], other[1] - one[1])
    share = np.clip(((_COLUMNS - x) * dx + (_ROWS - y) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0, 1.0)
    image[(_COLUMNS - x - share * dx) ** 2 + (_ROWS - y - share * dy) ** 2 <= half**2] = colour
