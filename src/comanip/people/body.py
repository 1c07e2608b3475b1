"""The drawn person: an arm, a grip, strength, delays, and a share of the weight. A value; what it does stands in `person`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, log, sqrt
from typing import Any

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Array


@dataclass(frozen=True)
class Body:
    """One person on one day. Forces act on the object.

    carried_n            (d,) share of the weight, along each axis: -s m g
    load_kg              share of the object's mass whose inertia is anticipated
    stiffness_n_per_m    of the arm about where the hand is meant to be, with `damping_ns_per_m`
    yielding_ns_per_m    pull for 1 m/s of somebody who follows
    arm_kg, grip_n_per_m, grip_ns_per_m   what lies between that arm and the object: its mass, and the soft grip
    force_limit_n        most that the arm exerts along an axis, the weight included
    delay_s, reaction_s  from a feeling to the muscle's answer; from a sight to the new intention
    relative             force noise as a share of the force (signal-dependent: Jones, Hamilton and Wolpert 2002)
    """

    carried_n: tuple[float, ...] = (9.80665,)
    load_kg: float = 1.0
    stiffness_n_per_m: float = 120.0
    damping_ns_per_m: float = 20.0
    yielding_ns_per_m: float = 25.0
    arm_kg: float = 1.2
    grip_n_per_m: float = 2000.0
    grip_ns_per_m: float = 40.0
    force_limit_n: float = 100.0
    delay_s: float = 0.15
    reaction_s: float = 0.20
    relative: float = 0.03
    tremor_n: float = 0.07
    tremor_hz: float = 10.0

    def __post_init__(self) -> None:
        for name in ("stiffness_n_per_m", "yielding_ns_per_m", "arm_kg", "grip_n_per_m", "force_limit_n"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"a body's {name} must be positive; got {getattr(self, name)}")
        for name in ("damping_ns_per_m", "grip_ns_per_m", "delay_s", "reaction_s", "relative", "tremor_n", "load_kg"):
            if not getattr(self, name) >= 0:
                raise ParameterError(f"a body's {name} must not be negative; got {getattr(self, name)}")

    @property
    def upward(self) -> tuple[float, ...]:
        """(d,) unit vector against the weight that is carried; along the first axis where nothing is."""
        size = sqrt(sum(c * c for c in self.carried_n))
        if size > 0.0:
            return tuple(c / size for c in self.carried_n)
        return tuple(1.0 if i == 0 else 0.0 for i in range(len(self.carried_n)))

    def stiffened(self, stiffness_n_per_m: float, ratio: float | None = None) -> Body:
        """The same at another stiffness, at the same damping ratio or at `ratio`."""
        kept = self.ratio if ratio is None else ratio
        damping = 2.0 * kept * sqrt(stiffness_n_per_m * (self.arm_kg + self.load_kg))
        return replace(self, stiffness_n_per_m=stiffness_n_per_m, damping_ns_per_m=damping)

    @property
    def ratio(self) -> float:
        """Damping ratio of the arm with its share of the load on the arm's stiffness."""
        return self.damping_ns_per_m / (2.0 * sqrt(self.stiffness_n_per_m * (self.arm_kg + self.load_kg)))

    def steady(self) -> Body:
        """Somebody who follows can hold a rail without shaking only up to some stiffness."""
        return self.stiffened(min(self.stiffness_n_per_m, 0.9 * self.yielding_ns_per_m / (self.delay_s + 0.13)))


def draw_body(rng: np.random.Generator, *, load_kg: float, axes_gravity: Sequence[float] | Array, **known: Any) -> Body:
    """A person as wide as people are, who carries half of an object of `load_kg` [kg].

    axes_gravity   (d,) gravity along the task's axes [m/s^2]
    known          what was drawn elsewhere already: fields of Body, or `ratio`, the damping ratio

    K 60-600 N/m (log-uniform), damping ratio 0.3-0.8, following 15-60 N s/m, delays 0.10-0.25 s, arm 0.5-2.5 kg (effective mass
    of a hand in reach: Dolan et al. 1993), grip 1-4 kN/m at ratio 0.2-0.6 (Kuchenbecker et al. 2003), strength 60-150 N.
    """
    check_generator(rng)
    stiffness, ratio = exp(rng.uniform(log(60.0), log(600.0))), rng.uniform(0.3, 0.8)
    arm, grip = rng.uniform(0.5, 2.5), exp(rng.uniform(log(1000.0), log(4000.0)))
    drawn: dict[str, Any] = {
        "carried_n": tuple(float(-0.5 * load_kg * g) + 0.0 for g in axes_gravity),
        "load_kg": 0.5 * load_kg,
        "yielding_ns_per_m": rng.uniform(15.0, 60.0),
        "arm_kg": arm,
        "grip_n_per_m": grip,
        "grip_ns_per_m": 2.0 * rng.uniform(0.2, 0.6) * sqrt(grip * arm),
        "force_limit_n": rng.uniform(60.0, 150.0),
        "delay_s": rng.uniform(0.10, 0.25),
        "reaction_s": rng.uniform(0.15, 0.25),
        "tremor_n": rng.uniform(0.0, 0.1),
    }
    ratio = known.pop("ratio", ratio)
    body = Body(**{**drawn, **known, "stiffness_n_per_m": known.get("stiffness_n_per_m", stiffness)})
    return body if "damping_ns_per_m" in known else body.stiffened(body.stiffness_n_per_m, ratio)
