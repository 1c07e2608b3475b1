"""The mass-damper c of the default law, in d axes: how the hand gives way, at rest, in motion and where it is shaken."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from ..interfaces import Array, Command
from ..kernels.copies import Copied
from ..signals.exponential import exponential
from ..signals.vectors import length

if TYPE_CHECKING:
    from .collaborate import CollaborativeLaw

ABSURD = 1e6  # no robot is so far away, so fast or so strong, in any unit
AS_SLOW = 4.0  # times as slowly as the hand: lessons as good as never went that way


class Compliance(Copied):
    """The mass-damper c of the law, in d axes; `velocity` (d,) [m/s] is rewritten by `step`.

    Here and below a tick is written in plain floats: on one to three axes numpy's calls cost five times the arithmetic. What is
    remembered lies in `memory`, which kernels/_law.h shares: there the same tick is written once more, for speed.
    """

    def __init__(self, n_axes: int, dt: float) -> None:
        self._dt = dt
        self.memory = np.zeros(4 * n_axes + 4)
        self.velocity, self._slow, self._slower, self._gripping = self.memory[:-4].reshape(4, n_axes)
        self._shaking = self.memory[-4:]  # its mean size, and how long it has gone on; the same of what turns on the grip

    def reset(self) -> None:
        self.memory[:] = 0.0

    def step(
        self,
        law: CollaborativeLaw,
        excess: Array,
        reference: Array,
        feedforward: Array,
        departs_m_per_s: float = 0.0,
        going: float | None = None,
        untaught: float = 0.0,
    ) -> None:
        """Damping is implicit, so any value is stable by itself at any dt. Speed, dead zone and shaking are of vectors.

        departs_m_per_s   a hand that rests yet counts as so fast: it is known that somebody sets out
        going   [m/s] how fast the task goes on by itself here, where that is known: the hand rests where it does not, and moves
                neither. An attraction that a force keeps in balance is rest, although both are large
        untaught   in [0, 1]: the hand goes where lessons never went
        """
        c, off = self.velocity.tolist(), excess.tolist()
        if going is None:
            speed = max(length(c), length(reference.tolist()), departs_m_per_s)
        else:
            speed = max(length([a + b for a, b in zip(c, reference.tolist(), strict=True)]), going)
        rest = 1.0 - min(speed / law.moving_speed_m_per_s, 1.0)
        damping = law.moving_damping_ns_per_m + rest * rest * (law.resting_damping_ns_per_m - law.moving_damping_ns_per_m)
        damping += untaught * law.untaught_damping_ns_per_m
        shaking, on_grip = self._shakes(law, off)
        damping += law.shake_damping_ns_per_m_per_n * shaking
        size, dead = length(off), law.dead_zone_n * rest
        felt = 1.0 - dead / size if size > dead else 0.0  # of a size beyond all numbers, too
        share = self._dt / (law.virtual_mass_kg + law.grip_mass_kg_per_n * on_grip)
        for i, (f, a) in enumerate(zip(off, feedforward.tolist(), strict=True)):
            self.velocity[i] = (c[i] + share * (f * felt) + self._dt * a) / (1.0 + share * damping)

    def _shakes(self, law: CollaborativeLaw, excess: list[float]) -> tuple[float, float]:
        """Amplitudes [N], beyond what is usual, of a force that oscillates faster than people lift together, and of the part of
        it that is as fast as a grip; both grow as it goes on.

        Around a partner of stiffness K and damping B, a delay tau takes tau K from the loop's damping, whatever the virtual mass:
        stable if B + D > tau K. So a stiff partner needs D, and only such a partner. A firm grip turns faster than D can hold.
        """
        share, memory_s = min(self._dt / 0.3, 1.0), law.shake_memory_s
        keep = 1.0 - exponential(-2.0 * pi * law.shake_hz * self._dt)
        # twice: of a stroke of 0.6 Hz one such filter leaves a quarter, and damps the task; two leave a twentieth
        quick = _beyond(excess, self._slow, keep)
        fast = _beyond(quick, self._slower, keep)
        faster = _beyond(quick, self._gripping, 1.0 - exponential(-2.0 * pi * law.grip_hz * self._dt))
        shake, went_on, turn, turned = self._shaking.tolist()
        shake += share * (min(length(fast), ABSURD) - shake)
        turn += share * (min(length(faster), ABSURD) - turn)
        amplitude = max(1.57 * shake - law.shake_n, 0.0)  # mean |sin| = amplitude / 1.57
        turns = max(1.57 * turn - law.grip_n, 0.0)
        went_on += self._dt * (law.shake_growth_per_s * amplitude - went_on / memory_s)
        turned += self._dt * (law.shake_growth_per_s * turns - turned / memory_s)
        self._shaking[:] = shake, went_on, turn, turned
        return amplitude + went_on, turns + turned


def _beyond(values: list[float], slow: Array, keep: float) -> list[float]:
    """What is faster in `values` than the low-pass that `slow` (d,) remembers."""
    passed = [s + keep * (v - s) for v, s in zip(values, slow.tolist(), strict=True)]
    slow[:] = passed
    return [v - p for v, p in zip(values, passed, strict=True)]


def untaught(velocity: Array, taught: Array) -> float:
    """In [0, 1]: whether lessons never went that way there, or `AS_SLOW` times as slowly; both (d,) [m/s]."""
    return max(1.0 - AS_SLOW * length(taught.tolist()) / max(length(velocity.tolist()), 1e-6), 0.0)


def command_velocity(law: CollaborativeLaw, dt: float, x: Array, wanted: Array, velocity: Array, command: Command) -> None:
    """Moves `velocity` (d,) toward `wanted` no faster than the law's acceleration, and fills `command` from it."""
    limit, before = law.max_acceleration_m_per_s2 * dt, velocity.tolist()
    changes = [w - v for w, v in zip(wanted.tolist(), before, strict=True)]
    size = length(changes)
    share = limit / size if size > limit else 1.0
    for i, (p, v, change) in enumerate(zip(x.tolist(), before, changes, strict=True)):
        change *= share
        v += change
        velocity[i] = v
        command.velocity[i] = v + law.lead_s / dt * change
        command.position[i] = p + dt * v
        command.acceleration[i] = change / dt
