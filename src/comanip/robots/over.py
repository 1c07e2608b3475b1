"""A skill over the wire of a fake robot, in one thread and one time: bytes travel as on a network, and runs repeat to the last
bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..interfaces import Array, Partner, Plant
from ..plants.beam import Beam, BeamPlant, WristSensor
from ..tasks import Task, named
from ..trials.cases import Case
from .fake import FakeRobot, Rests, Stepped, SteppedTime
from .people import plant_of
from .robot import Robot
from .ros2 import Ros2Arm
from .settings import Settings
from .wire import Loopback


def behind_wire(settings: Settings, resting: Plant, living: Callable[[int], Plant]) -> Stepped:
    """The Plant of a fake robot behind its messages; time passes with the Plant's own."""
    time, wire = SteppedTime(), Loopback()
    arm = Ros2Arm(wire, settings, time.now)
    node = FakeRobot(wire, settings, resting, living, stamp_ns=time.now_ns)
    return Stepped(node, time, arm, settings)


def robot_of(settings: Settings, case: Case, *, node_s: float = 0.002) -> Robot:
    """As `robot.simulated`, with the wire between: the person of this case comes with the first command."""
    settings = replace(settings, share=case.task.carried.share)
    plant = behind_wire(settings, plant_of("beam", case, node_s, at_rest=True), lambda number: plant_of("beam", case, node_s))
    return Robot(settings, plant, plant, case.task.gravity, settings.force_delay_s)


def maker(settings: Settings) -> Callable[..., Plant]:
    """For `teach(plant=...)`: lessons over the wire, at the rate of the device."""

    def make(
        partner: Partner,
        *,
        beam: Beam,
        sensor: WristSensor,
        dt: float,
        start_position: Array,
        rng: Any,
        task: Task = named("lift"),
    ) -> Plant:
        about: dict[str, Any] = {
            "beam": beam,
            "sensor": sensor,
            "axes": task.axes,
            "axial": task.carried.along,
            "gravity": task.gravity.tolist(),
            "dt": dt,
            "start_position": start_position,
            "rng": rng,
        }
        carried = (1.0 - task.carried.share) * beam.mass_kg * -task.gravity
        resting = BeamPlant(Rests(carried), **about)
        return behind_wire(replace(settings, rate_hz=1.0 / dt), resting, lambda number: BeamPlant(partner, **about))

    return make
