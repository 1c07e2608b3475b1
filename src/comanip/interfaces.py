"""Read first: the values that cross every border, and the sockets that parts plug into.

One loop serves teaching and reproduction (see `comanip.loop.run`):

    plant.read(obs) -> skill.step(obs, command) -> plant.write(command) -> record -> taps -> plant.advance()

Frames and signs. d task axes, each with a name ("z" is vertical, up positive); 1-D is d = 1 and nothing special. A force
is what the PARTNER does to the robot's hand through the object, so `force > 0` when the partner lifts while the hand is
still. A missing or untrusted value is NaN: a skill must expect any of them to be NaN at any tick.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # [m/s^2]


class Observation:
    """What the robot knows at one tick. Arrays are written in place; NaN means missing.

    time                 [s], on the plant's own clock
    position, velocity   (d,) hand, task frame [m], [m/s]
    sensor_force         (d,) F_s, force of the OBJECT ON THE HAND [N], weight and inertia included; of a sensor slower than the
                         ticks the last sample again, or NaN until the next
    force_time           [s] when `sensor_force` was measured; NaN: at `time`
    force                (d,) F, interaction force of eq. (3) [N]; filled by the loop's force estimator
    """

    __slots__ = ("force", "force_time", "position", "sensor_force", "time", "velocity")

    def __init__(self, n_axes: int) -> None:
        self.time = 0.0
        self.force_time = np.nan
        self.position: Array = np.full(n_axes, np.nan)
        self.velocity: Array = np.full(n_axes, np.nan)
        self.sensor_force: Array = np.full(n_axes, np.nan)
        self.force: Array = np.full(n_axes, np.nan)

    def __repr__(self) -> str:
        x, v, f = self.position.tolist(), self.velocity.tolist(), self.force.tolist()
        return f"Observation({self.time:g} s: position {x} m, velocity {v} m/s, force {f} N)"


class Command:
    """What the robot is asked to do until the next tick, written in place.

    position, velocity, acceleration   (d,) reference for the hand [m], [m/s], [m/s^2]; a plant may follow the
                                       velocity alone
    """

    __slots__ = ("acceleration", "position", "velocity")

    def __init__(self, n_axes: int) -> None:
        self.position: Array = np.zeros(n_axes)
        self.velocity: Array = np.zeros(n_axes)
        self.acceleration: Array = np.zeros(n_axes)

    def __repr__(self) -> str:
        return f"Command(velocity {self.velocity.tolist()} m/s, acceleration {self.acceleration.tolist()} m/s^2)"


@runtime_checkable
class Skill(Protocol):
    """Maps observation to command, with memory. Teleoperation is a skill whose brain is a human.

    dt, axes  optional: the control period [s] and the axes that it was made for; the loop refuses a plant of others
    """

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        """Arrays that the skill rewrites at each step (weights, targets, gains); the loop records them by name."""
        ...

    @property
    def stop_reason(self) -> str:
        """Empty while the skill runs; else why it asks the loop to end."""
        ...

    @property
    def notice(self) -> str:
        """What the person should know ("outside what was taught: complies only"); empty when all is well."""
        ...

    def reset(self, obs: Observation) -> None:
        """Forgets everything: two runs from the same reset are equal."""
        ...

    def step(self, obs: Observation, command: Command) -> None:
        """Fills `command`. Allocates little and raises nothing."""
        ...


@runtime_checkable
class Plant(Protocol):
    """Robot, object, partner and contact; simulated or real.

    dt       control period [s]
    axes     names of the d task axes, for example ("z",)
    channels extra truths worth recording (tilt, partner's force ...), rewritten by `read`: name -> (array, unit)
    columns  optional: name -> names of a channel's columns, for channels that are not one column a task axis (joints)
    real     optional: True where time passes by itself and something may be hit; the loop then runs on the wall clock
    halt     optional: a method that brakes what was commanded last; the loop calls it however a run ends
    """

    dt: float
    axes: tuple[str, ...]

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        """What it shows beside the observation: name -> (array, unit)."""
        ...

    @property
    def stop_reason(self) -> str:
        """Empty while it works; else why the run must end."""
        ...

    def reset(self) -> None:
        """Back to the start, at rest: two runs from the same reset are equal."""
        ...

    def read(self, obs: Observation) -> None:
        """Fills `obs` with what is measured now; NaN for what is not."""
        ...

    def write(self, command: Command) -> None:
        """Takes the command for the next period."""
        ...

    def advance(self) -> None:
        """Lets one control period pass; a real robot has nothing to do here."""
        ...


@runtime_checkable
class Partner(Protocol):
    """The person (or machine) at the other end of the object.

    One who levels the object by eye has a method `see(tilt, rate)`, too: a plant that knows the object's tilt calls it before
    each `force`, with (d,) angles [rad], positive where the partner's end is farther along the axis than the robot's, and their
    rates [rad/s].
    """

    def reset(self, position: Array) -> None:
        """Takes hold at `position` (d,) [m], at rest."""
        ...

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        """Writes the force on the object at the partner's end, (d,) [N], given that end's position and velocity."""
        ...


@runtime_checkable
class HapticDevice(Protocol):
    """What the teacher holds. Velocity out, force in (eqs. 1 and 2)."""

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        """More that it measures, rewritten by `read`: name -> (array, unit), known before it is connected.

        Teleoperation makes use of device.position (d,) [m], device.clutch (1,) (1 while held down), device.delay (1,) [s] there
        and back; a device may lack any.
        """
        ...

    @property
    def problem(self) -> str:
        """Empty while it works; else why nothing it says can be trusted ("device lost")."""
        ...

    @property
    def notice(self) -> str:
        """What the teacher should know ("handle force clipped ..."); empty when all is well."""
        ...

    def reset(self) -> None:
        """Back to rest; a real one forgets what it was sent."""
        ...

    def read(self, out: Array) -> None:
        """Writes the handle's velocity v_h, (d,) [m/s]; NaN when there is no new sample."""
        ...

    def write(self, force: Array, duration: float, power: float = 0.0) -> None:
        """Renders `force` F_m, (d,) [N], on the handle for `duration` [s].

        power   [W] that the object puts into the coupling at the robot's hand, for devices that keep an account of energy
        """
        ...


class Tap(Protocol):
    """Watches a run; copies what it wants and returns at once."""

    def __call__(self, obs: Observation, command: Command) -> None: ...
