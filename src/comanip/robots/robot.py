"""From a name or a robot.toml to something that can be driven: the plant, the same plant at rest for the pre-flight, and how to
let go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Plant
from ..loop import Clock, SimulatedClock, WallClock
from ..trials.cases import Case
from .hand import HandPlant
from .settings import Settings

EXPECTED_DELAY_S = 0.010  # of a simulated wrist sensor, as in trials: the robot knows no better


def nothing() -> None:
    """Of a simulated robot: there is nothing to let go of."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot that is there.

    plant, at_rest   the one to run; the one to measure first (the same, but for a simulated one, whose person would not wait)
    gravity          (d,) along the task axes [m/s^2]
    listener         why nobody would hear a command; close: lets go of it
    """

    settings: Settings
    plant: Plant
    at_rest: Plant
    gravity: Array
    delay_s: float
    close: Callable[[], None] = nothing
    listener: Callable[[], str] = str

    @property
    def real(self) -> bool:
        """Whether something may be hit, and time passes by itself."""
        return bool(getattr(self.plant, "real", False))

    def clock(self, realtime: bool = False) -> Clock:
        """The wall clock where time passes by itself, or where it is asked for."""
        return WallClock() if self.real or realtime else SimulatedClock()


def simulated(settings: Settings, case: Case) -> Robot:
    """The beam or the humanoid, with the person of this case at the other end."""
    from .people import plant_of

    if settings.axes and tuple(settings.axes) != case.axes:
        raise ParameterError(
            f"{settings.source}: [axes] are {', '.join(settings.axes)}; task {case.task.name!r} moves {', '.join(case.axes)}"
        )
    settings = replace(settings, share=case.task.carried.share)
    world, still = (plant_of(settings.adapter, case, settings.dt, at_rest=rest) for rest in (False, True))
    return Robot(settings, world, still, case.task.gravity, EXPECTED_DELAY_S)


def real(settings: Settings, arm: Any = None, **about: Any) -> Robot:
    """A real arm, connected; `arm` is for tests and your own adapters. ParameterError when it does not answer."""
    made = arm if arm is not None else _arm(settings)
    try:
        plant = HandPlant(made, settings, **about)
    except BaseException:
        made.close()
        raise
    gravity = np.array([sum(a * b for a, b in zip(settings.gravity, settings.axes[n], strict=True)) for n in plant.axes])
    return Robot(settings, plant, plant, gravity, settings.force_delay_s, plant.close, made.listener)


def _arm(settings: Settings) -> Any:
    if settings.adapter == "ros2":
        from .ros2 import Ros2Arm
        from .wire import opened

        return Ros2Arm(opened(settings.wire, "comanip"), settings)
    from . import in_process

    return {"franky": in_process.FrankyArm, "panda-py": in_process.PandaPyArm}[settings.adapter](settings)
