"""A picture of an episode from the side, drawn in numpy: no library of figures is needed in a loop that trains."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Array
from ..tasks import Task
from ..tasks.value import LENGTH

if TYPE_CHECKING:
    from .episode import Episode

HEIGHT, WIDTH = 240, 400
LEFT, BELOW, PIXELS_PER_M = 60.0, 70.0, 200.0  # where a run begins; a table of 0.8 m then stays in it over 0.8 m
PIXELS_PER_N = 4.0
SLANT = 0.5, 0.35  # right and up in the picture, of what is level and across the object
PAPER, BEAM, MEANT = (250, 249, 246), (120, 96, 70), (190, 190, 190)
ROBOT, PERSON, FORCE = (38, 84, 124), (214, 120, 46), (180, 40, 40)
MODES = {"RUN": (60, 150, 80), "COMPLY": (220, 170, 40), "HOLD": (190, 50, 50)}
Picture = NDArray[np.uint8]
Place: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[int, int, int]
_ROWS, _COLUMNS = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)


def picture(episode: Episode) -> Picture:
    """(240, 400, 3): the robot's hand left, the partner's right, the object between them.

    What is level and across the object goes slantwise into the picture, an angle turns the spoke of both hands. Grey is where the
    hand is meant to be, red the partner's force on the robot's hand, and a corner the envelope's mode.
    """
    image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[:] = PAPER
    task, start, plant = episode.case.task, episode.case.start_m, episode.loop.plant
    shown, turned = projection(task)
    place, length = episode.loop.obs.position - start, task.carried.length_m

    def at(moved: Array, along_m: float) -> Place:
        right, up = (shown @ moved).tolist()
        return LEFT + PIXELS_PER_M * (along_m + right), HEIGHT - BELOW - PIXELS_PER_M * up

    far_end = plant.channels["partner.position"][0] - start
    hand, far = at(place, 0.0), at(far_end, length)
    meant = np.array(episode.meant[min(episode.ticks, len(episode.meant) - 1)]) - start
    _disc(image, at(meant, 0.0), 13.0, MEANT)
    _line(image, hand, far, 5.0, BEAM)
    for middle, colour, moved in ((hand, ROBOT, place), (far, PERSON, far_end)):
        _disc(image, middle, 10.0, colour)
        if turned.any():
            _spoke(image, middle, float(turned @ moved))
    right, up = (shown @ plant.channels["hand.true_force"][0]).tolist()
    _line(image, hand, (hand[0] + PIXELS_PER_N * right, hand[1] - PIXELS_PER_N * up), 2.5, FORCE)
    if episode.setting.envelope:
        image[6:18, 6:18] = MODES[episode.mode]
    return image


def projection(task: Task) -> tuple[Array, Array]:
    """(2, d) metres to the right and up in the picture per metre of each axis, and (d,) radians a metre of what turns."""
    shown, turned = np.zeros((2, len(task.axes_))), np.zeros(len(task.axes_))
    for i, axis in enumerate(task.axes_):
        if axis.kind != LENGTH:
            turned[i] = 1.0 / axis.lever_m
            continue
        level = max(1.0 - axis.up**2, 0.0) ** 0.5
        shown[:, i] = level * np.array((1.0, 0.0) if axis.name == task.carried.along else SLANT)
        shown[1, i] += axis.up
    return shown, turned


def _spoke(image: Picture, middle: Place, angle: float) -> None:
    """From a hand's middle outwards, up where nothing is turned."""
    _line(image, middle, (middle[0] + 22.0 * float(np.sin(angle)), middle[1] - 22.0 * float(np.cos(angle))), 2.0, BEAM)


def _disc(image: Picture, centre: Place, radius: float, colour: Colour) -> None:
    image[(_COLUMNS - centre[0]) ** 2 + (_ROWS - centre[1]) ** 2 <= radius**2] = colour


def _line(
    image: Picture, one: tuple[float, float], other: tuple[float, float], half: float, colour: tuple[int, int, int]
) -> None:
    """All pixels within `half` of the straight line between two places."""
    (x, y), (dx, dy) = one, (other[0] - one[0], other[1] - one[1])
    share = np.clip(((_COLUMNS - x) * dx + (_ROWS - y) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0, 1.0)
    image[(_COLUMNS - x - share * dx) ** 2 + (_ROWS - y - share * dy) ** 2 <= half**2] = colour
