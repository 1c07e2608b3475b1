"""What a robot must not be given: period, axes, units, frames and limits that are not its own. Each is refused in one line.

    python -m comanip.experiments.wrong_ways

Nothing moves: the plant here says so by ending the program if it is ever written to.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..commands.console import table
from ..errors import ComanipError
from ..interaction import TaringInteractionForce
from ..interfaces import Array, Command, Observation
from ..loop import run
from ..robots.hand import HandPlant
from ..robots.messages import Writer
from ..robots.ros2 import Ros2Arm
from ..robots.settings import Settings, load
from ..robots.wire import Loopback

ROBOT = 'preset = "fake"\n'


class Still:
    """A plant that must never be written to, and a skill made for another."""

    stop_reason = notice = ""
    diagnostics: dict[str, Array]
    channels: dict[str, tuple[Array, str]]

    def __init__(self, axes: tuple[str, ...] = ("z",), dt: float = 0.01, units: dict[str, str] | None = None) -> None:
        self.axes, self.dt, self.units, self.channels, self.diagnostics = axes, dt, units or {}, {}, {}

    def reset(self, obs: Observation | None = None) -> None: ...

    def read(self, obs: Observation) -> None: ...

    def advance(self) -> None: ...

    def step(self, obs: Observation, command: Command) -> None: ...

    def write(self, command: Command) -> None:
        raise SystemExit("it moved")


def _run(plant: Still, skill: Still, estimator: Any = None) -> Callable[[Path], object]:
    made: Any = skill
    return lambda _: run(plant, made, duration_s=1.0, estimator=estimator)


def _robot(text: str) -> Callable[[Path], object]:
    def tried(folder: Path) -> Settings:
        (folder / "robot.toml").write_text(text)
        return load(folder / "robot.toml")

    return tried


def _frames(pose: str, wrench: str) -> Callable[[Path], object]:
    """A hand behind messages in these frames."""

    def tried(_: Path) -> HandPlant:
        settings, wire = load("fake"), Loopback()
        arm = Ros2Arm(wire, settings, time.monotonic)
        says = {name: wire.advertise(settings.topics[name]) for name in ("pose", "twist", "wrench")}
        says["pose"](Writer(settings.topics["pose"].type, pose).write(time.time_ns(), (0.0,) * 3 + (1.0, 0.0, 0.0, 0.0)))
        says["twist"](Writer(settings.topics["twist"].type, "base").write(time.time_ns(), (0.0,) * 6))
        says["wrench"](Writer(settings.topics["wrench"].type, wrench).write(time.time_ns(), (0.0,) * 6))
        return HandPlant(arm, settings, first_s=0.02)  # all that will ever come is there

    return tried


def ways() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """What is wrong, and what tries it."""
    still = Still()
    yield "a skill for 10 ms on an arm of 2 ms", _run(Still(dt=0.002), still)
    yield "a skill for z on an arm of x", _run(Still(("x",)), still)
    yield "the same axes in another order", _run(Still(("x", "y")), Still(("y", "x")))
    yield "a skill of one axis on an arm of two", _run(Still(("y", "z")), still)
    yield "positions in millimetres", _run(Still(units={"position": "mm"}), still)
    yield "forces in kilograms", _run(Still(units={"sensor_force": "kgf"}), still)
    yield "a force estimate for another period", _run(still, still, TaringInteractionForce(0.002, gravity=[-9.8]))
    yield "a force estimate for other axes", _run(still, still, TaringInteractionForce(0.01, gravity=[0.0, -9.8]))
    yield "a pose in the camera's frame", _frames("camera", "ft_sensor")
    yield "a wrench in a frame that nobody stated", _frames("base", "tool0")
    yield "an axis that is no direction", _robot(ROBOT + "[axes]\nz = [0, 0, 0]\n")
    yield "two axes along one direction", _robot(ROBOT + "[axes]\ny = [0, 0, 1]\nz = [0, 0, 1]\n")
    yield "walls upside down", _robot(ROBOT + "[limits]\nwalls.z = [0.8, 0.2]\n")
    yield "a rate of no ticks a second", _robot("rate_hz = 0\n" + ROBOT)
    yield "a force that is turned twice", _robot("force_sign = 2\n" + ROBOT)


def tried() -> list[tuple[str, str]]:
    """What is wrong, and the line that refuses it; empty where nothing does."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for what, way in ways():
            said = ""
            try:
                way(Path(folder))
            except ComanipError as error:
                said = str(error).replace(folder + "/", "")
            found.append((what, said))
    return found


def main() -> None:
    rows = tried()
    table("Refused before anything moves", ("what is wrong", "what is said"), rows)
    sys.exit(int(any(not said or "\n" in said for _, said in rows)))


if __name__ == "__main__":
    main()
