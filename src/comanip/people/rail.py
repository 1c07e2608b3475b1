"""One person against a rail: what a kind does by itself, without any robot's answer.

The object's end is on a rail that nothing moves but its own drive: it stands still for somebody who leads, and goes by a minimum
jerk for somebody who follows.
"""

from __future__ import annotations

import numpy as np

from ..interfaces import STANDARD_GRAVITY, Array
from ..recording import Channel, Recording
from .body import draw_body
from .intent import Course
from .kinds import FOLLOWING, make, planned

USUAL = (1.0, 2.2, (0.30,))  # start [s], duration [s], way [m]
STEP_S = 0.001
LOAD_KG = 2.0


def on_rail(name: str, role: str, *, seed: int, seconds: float | None = None) -> Recording:
    """hand.position, hand.velocity: the rail's; partner.position: the person's own hand; hand.true_force: beyond the weight."""
    rng = np.random.default_rng([seed, len(role)])
    body = draw_body(rng, load_kg=LOAD_KG, axes_gravity=[-STANDARD_GRAVITY])
    course, usual = Course((USUAL,), feedforward_kg=0.5 * LOAD_KG), Course((USUAL,))
    meant = planned(name, course, rng)
    person = make(name, role=role, course=meant, body=body, axes=("z",), rng=rng)
    lasts = seconds or max(meant.stop_s, usual.stop_s) + 3.0
    person.reset(np.zeros(1))
    rows, out = np.zeros((round(lasts / STEP_S), 4)), np.array(body.carried_n)
    for n, row in enumerate(rows):
        x, v, _ = usual.along(0).at(n * STEP_S) if role == FOLLOWING else (0.0, 0.0, 0.0)
        if hasattr(person, "see"):  # a rail tilts nothing: the eye sees what the force would tilt a beam by
            person.see([(out[0] - body.carried_n[0]) * 4e-4], [0.0])
        person.force(n * STEP_S, np.array([x]), np.array([v]), out)
        row[:] = x, v, _own_hand(person, x), out[0] - body.carried_n[0]
    return _recorded(rows, name, role)


def _own_hand(person: object, x: float) -> float:
    """Where the hand of one person is; of several the object's end."""
    hand = getattr(person, "hand", None)
    return float(hand.position[0]) if hand is not None else x


def _recorded(rows: Array, name: str, role: str) -> Recording:
    time: Array = np.arange(len(rows), dtype=float) * STEP_S
    names = (("hand.position", "m"), ("hand.velocity", "m/s"), ("partner.position", "m"), ("hand.true_force", "N"))
    channels = {one: Channel(time, rows[:, [i]], unit=unit, axes=("z",)) for i, (one, unit) in enumerate(names)}
    return Recording(channels, {"kind": name, "partner_role": role})
