"""Whom a skill is tried with: partners it has never met, drawn wider than the lessons, some of whom misbehave.

The distribution is stated here once, and used by `comanip demo`, `comanip trial` and the tests.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, log, sqrt
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import STANDARD_GRAVITY, Array, Partner
from ..people.misbehaving import Blocks, LetsGo, Switches
from ..people.partners import Arm, HumanFollower, HumanLeader, Legs, Unsteadiness, Yielding

ROLES = ("leader", "follower", "auto")
MISBEHAVIOURS = ("hesitates", "reverses", "blocks", "lets go", "changes role")
HAND_KG = 1.0  # effective mass of a hand in a lift, for the damping ratio
LEADER_STARTS_S = 0.5  # a robot told to lead begins about here, so a partner who follows misbehaves some time after
USUAL_LIFT_S = 2.2
AUTO_PATIENCE_S = 6.5  # a robot told nothing gives a partner who leads all the time that the draw allows him


@dataclass(frozen=True)
class Case:
    """One partner and one day: everything a closed-loop run needs, by value.

    role        what the ROBOT is told: "leader", "follower", or "auto" when nobody tells it
    partner     what the person does: "leading" or "following"
    behaviour   "steady", or one of MISBEHAVIOURS, which begins `event` of the way through the motion
    lift_m      where a leading partner goes; for a following one who changes role, where he then wants to be
    """

    role: str
    lift_m: float
    duration_s: float
    onset_s: float
    stiffness_n_per_m: float
    damping_ns_per_m: float
    yielding_ns_per_m: float
    delay_s: float
    beam_mass_kg: float
    force_bias_n: float
    force_noise_n: float
    sensor_delay_s: float
    tremor_n: float
    seed: int
    partner: str = "leading"
    behaviour: str = "steady"
    event: float = 0.5
    pause_s: float = 1.0

    @property
    def leads(self) -> bool:
        """Whether the person leads, at least at first."""
        return self.partner == "leading"

    @property
    def carried_n(self) -> float:
        """The share of the weight that the partner carries [N]."""
        return 0.5 * self.beam_mass_kg * STANDARD_GRAVITY

    @property
    def event_s(self) -> float:
        """When the misbehaviour begins [s]."""
        if self.leads:
            return self.onset_s + self.event * self.duration_s
        begins = AUTO_PATIENCE_S if self.role == "auto" else LEADER_STARTS_S
        return begins + self.event * USUAL_LIFT_S

    @property
    def within_s(self) -> float:
        """Within which a partner who lets go has gone, 0.05 to 2 s [s]; out of the seed, so that it moves no other draw."""
        return 0.05 + 1.95 * (self.seed % 9973) / 9972

    @property
    def legs(self) -> tuple[tuple[float, float, float], ...]:
        """How a leading partner goes: (start [s], duration [s], how far [m])."""
        whole, part = (self.onset_s, self.duration_s, self.lift_m), self.event * self.lift_m
        first = (self.onset_s, max(0.8, 1.3 * self.event * self.duration_s), part)
        stop = first[0] + first[1]
        rest = max(0.8, 1.3 * (1.0 - self.event) * self.duration_s)
        if self.behaviour == "hesitates":
            return first, (stop + self.pause_s, rest, self.lift_m - part)
        if self.behaviour == "reverses":
            return first, (stop, first[1], -part)
        return (first,) if self.behaviour == "changes role" else (whole,)

    @property
    def stop_s(self) -> float:
        """When the partner's own plan, or his misbehaviour, has come to its end [s]; 0 for one who only follows."""
        if self.behaviour in ("blocks", "lets go"):
            return self.event_s + (self.within_s if self.behaviour == "lets go" else 0.0)
        if self.leads:
            start, duration, _ = self.legs[-1]
            return start + duration
        return {"hesitates": self.event_s + self.pause_s, "steady": 0.0}.get(self.behaviour, self.event_s + 0.2 + self.duration_s)

    @property
    def run_s(self) -> float:
        """How long the run lasts [s]."""
        if self.behaviour == "changes role" and self.leads and self.role == "auto":
            return self.stop_s + 10.0  # the robot has to notice and to finish the task
        # a robot that may lead might take a partner's end for a hand-over, and offers: watched until that is over
        insists = self.behaviour in ("reverses", "changes role")
        after = self.stop_s + (2.5 if self.role == "follower" else 14.0 if insists else 8.0)
        if self.leads:
            return after
        begins = AUTO_PATIENCE_S if self.role == "auto" else 0.0
        return max(begins + 8.0 + (self.pause_s + 8.0 if self.behaviour == "hesitates" else 0.0), after)


def draw_case(role: str, rng: np.random.Generator, *, misbehaving: float = 0.0) -> Case:
    """A partner for a robot in `role`, drawn wider than the lessons (lift 0.30 +- 0.025 m in 2.2 +- 0.25 s).

    lift 0.15-0.38 m, 1.6-4 s, onset 0.3-6 s, K 60-600 N/m (log-uniform), damping ratio 0.3-0.8, follower damping 15-60 N s/m,
    delays 0.10-0.25 s, beam mass +-30 %, force bias +-1 N, noise to 0.5 N, sensor delay to 20 ms, tremor to 0.1 N. A following
    partner is somebody who can hold a rail without shaking: his stiffness is capped where his own loop (stiffness, yielding,
    delay) would oscillate against a wall. For "auto" one partner in two leads.

    misbehaving   share of partners who hesitate, reverse, block, let go or change role, each as often, at 0.3-0.7 of the motion
    """
    if role not in ROLES:
        raise ParameterError(f"role {role!r} is unknown; roles are: {', '.join(ROLES)}")
    leads = role == "follower" or (role == "auto" and bool(rng.uniform() < 0.5))
    mass = 2.0 * rng.uniform(0.7, 1.3)
    stiffness = exp(rng.uniform(log(60.0), log(600.0)))
    ratio, yielding, delay = rng.uniform(0.3, 0.8), rng.uniform(15.0, 60.0), rng.uniform(0.10, 0.25)
    if not leads:
        stiffness = min(stiffness, _steady_stiffness(yielding, delay))
    steady: dict[str, Any] = {
        "lift_m": rng.uniform(0.15, 0.38),
        "duration_s": rng.uniform(1.6, 4.0),
        "onset_s": rng.uniform(0.3, 6.0),
        "force_bias_n": rng.uniform(-1.0, 1.0),
        "force_noise_n": rng.uniform(0.05, 0.5),
        "sensor_delay_s": rng.uniform(0.0, 0.020),
        "tremor_n": rng.uniform(0.0, 0.1),
        "seed": int(rng.integers(2**62)),
    }
    habit, which = rng.uniform(), int(rng.integers(len(MISBEHAVIOURS)))
    return Case(
        role=role,
        partner="leading" if leads else "following",
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=2.0 * ratio * sqrt(stiffness * (HAND_KG + 0.5 * mass)),
        yielding_ns_per_m=yielding,
        delay_s=delay,
        beam_mass_kg=mass,
        behaviour=MISBEHAVIOURS[which] if habit < misbehaving else "steady",
        event=rng.uniform(0.3, 0.7),
        pause_s=rng.uniform(0.8, 2.5),
        **steady,
    )


def _steady_stiffness(yielding_ns_per_m: float, delay_s: float) -> float:
    """Up to this stiffness [N/m] somebody who follows can hold a rail without shaking."""
    return 0.9 * yielding_ns_per_m / (delay_s + 0.13)


def partner_of(case: Case, rng: np.random.Generator) -> Partner:
    """The person of the case; `rng` is what makes him unsteady."""
    arm = Arm(case.stiffness_n_per_m, case.damping_ns_per_m, case.carried_n, Unsteadiness(tremor_n=case.tremor_n))
    softer = replace(arm, stiffness_n_per_m=min(case.stiffness_n_per_m, _steady_stiffness(case.yielding_ns_per_m, case.delay_s)))
    share = 0.5 * case.beam_mass_kg

    def leading(*legs: tuple[float, float, float]) -> Partner:
        return HumanLeader(Legs(legs, feedforward_kg=share), arm, rng=rng)

    def following(*_: Array) -> Partner:
        return HumanFollower(Yielding(damping_ns_per_m=case.yielding_ns_per_m, delay_s=case.delay_s), softer, rng=rng)

    def insisting(start: Array, position: Array) -> Partner:
        target = 0.0 if case.behaviour == "reverses" else case.lift_m
        return leading((0.2, case.duration_s, target - float((position - start)[0])))

    first = leading(*case.legs) if case.leads else following()
    if case.behaviour == "lets go":
        return LetsGo(first, case.event_s, case.within_s)
    if case.behaviour == "blocks":
        return Blocks(first, case.event_s, carried=np.array([case.carried_n]))
    if case.leads:
        return Switches(first, [(case.stop_s, following)]) if case.behaviour == "changes role" else first
    if case.behaviour == "hesitates":
        return Switches(first, [(case.event_s, lambda *_: leading()), (case.event_s + case.pause_s, following)])
    return Switches(first, [(case.event_s, insisting)]) if case.behaviour != "steady" else first
