"""Who holds the other end of a simulated robot, drawn as `trial` draws them; and the beam between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..interfaces import Array, Partner, Plant
from ..plants.beam import Beam, BeamPlant, WristSensor
from ..trials.cases import Case, draw_case, partner_of
from .fake import Rests


def carried_by(case: Case) -> Array:
    """(d,) [N] what the person carries at rest, as a force on the object."""
    return case.carried


def plant_of(kind: str, case: Case, dt: float, *, at_rest: bool = False) -> Plant:
    """ "beam" or "humanoid" with the person of this case, or with one who only holds."""
    rng = np.random.default_rng(case.seed)
    person: Partner = Rests(carried_by(case)) if at_rest else partner_of(case, rng)
    sensor = WristSensor(case.force_noise_n, case.force_bias_n, case.sensor_delay_s)
    about: dict[str, Any] = {"sensor": sensor, "axes": case.axes, "start_position": case.start_m, "dt": dt, "rng": rng}
    what = case.task
    if kind == "humanoid":
        from ..plants.humanoid import HumanoidPlant

        return HumanoidPlant(person, load_mass_kg=case.beam_mass_kg, length_m=what.carried.length_m, **about)
    beam = Beam(mass_kg=case.beam_mass_kg, length_m=what.carried.length_m)
    return BeamPlant(person, beam=beam, axial=what.carried.along, gravity=what.gravity.tolist(), **about)


def living(draw: Callable[[int], Case], dt: float) -> Callable[[int], Plant]:
    """For a fake robot: the beam of its n-th run."""
    return lambda number: plant_of("beam", draw(number), dt)


def cases(role: str, task: Any, seed: int, start: Array | None = None) -> Callable[[int], Case]:
    """The n-th person for a robot in this role; all take hold at one place, where the robot's hand is."""

    def draw(number: int) -> Case:
        case = draw_case(role, np.random.default_rng([seed, number]), task=task)
        return case.starting(task.start if start is None else start)

    return draw
