"""Plants by name, as lessons and trials make them: `parts.PLANTS`.

Each is called with the partner, and by name with the object (`Beam`), the wrist's sensor, the control period dt [s], the hand's
start (d,) [m], a Generator, and the task, of which a plant needs `axes`, `gravity` (d,) [m/s^2] and `carried.along`; and of one
that turns the object, `levers_m` (d,) [m], too.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Partner, Plant
from .beam import Beam, BeamPlant, WristSensor
from .rigid import AtLever, RigidPlant, Turning, TurningObject


def beam_plant(
    partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: np.random.Generator, task: Any
) -> Plant:
    """The exact beam, or where the task turns the object that: fast, and without a robot's body."""
    if task.turns:
        return AtLever(
            RigidPlant(
                partner,
                Turning(task.axes, task.levers_m, task.carried.along),
                held=TurningObject(beam.mass_kg, beam.length_m, task.carried.width_m),
                share=task.carried.share,
                sensor=sensor,
                gravity=task.gravity.tolist(),
                dt=dt,
                start_position=start_position / np.where(np.isnan(task.levers_m), 1.0, task.levers_m),
                rng=rng,
            )
        )
    return BeamPlant(
        partner,
        beam=beam,
        sensor=sensor,
        axes=task.axes,
        axial=task.carried.along,
        gravity=task.gravity.tolist(),
        dt=dt,
        start_position=start_position,
        rng=rng,
    )


def humanoid_plant(
    partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: np.random.Generator, task: Any
) -> Plant:
    """A humanoid in MuJoCo. ParameterError where that is not installed, and for a task that turns the object."""
    if task.turns:
        raise ParameterError(f"plant 'humanoid' does not turn the object; task {task.name!r} runs on the exact one, beam")
    try:
        made: Plant = import_module("comanip.plants.humanoid").HumanoidPlant(
            partner,
            load_mass_kg=beam.mass_kg,
            length_m=beam.length_m,
            sensor=sensor,
            axes=task.axes,
            dt=dt,
            start_position=start_position,
            rng=rng,
        )
    except ImportError as error:
        raise ParameterError(
            f"plant 'humanoid' cannot be built here ({error}): pip install 'comanip[humanoid]', or use plant 'beam'"
        ) from None
    return made
