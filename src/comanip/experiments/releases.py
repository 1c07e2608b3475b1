"""What the envelope does with partners who let go, sensors that lie and people who mean no harm: the figures of docs/safety.md.

    python -m comanip.experiments.releases [releases | lies | innocents] [--runs 16] [--seed 10000] [--plant beam | humanoid]

Each row is a cell of `runs` partners from `draw_case`, which nothing was chosen on where the seed is 10,000 or more.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from comanip.interfaces import Array, Command, Observation, Partner
from comanip.learned.skill import LearnedSkill
from comanip.loop import run
from comanip.people.misbehaving import LetsGo
from comanip.safety.limits import taught_walls
from comanip.trials.cases import Case, draw_case, partner_of
from comanip.trials.contestants import contestant
from comanip.trials.people import draw_people, person_of
from comanip.trials.running import estimator_for, plant_for

from .lifts import learned, taught

Lie = Callable[[Array, np.random.Generator], Array]
Reading = Callable[[float, Array], Array]  # (time [s], F_s) -> what the sensor says
WITHIN_S, AT_S = (0.01, 0.15, 0.4, 1.0, 2.0), (0.6, 2.4, 5.0)
RUNS_ON_S = 5.0
ROLES = ("leader", "follower", "auto")
INNOCENTS = ("child", "rests an elbow", "sways", "re-grasps", "steps on the spot", "crawls", "snatches")


@cache
def learned_skills() -> dict[str, LearnedSkill]:
    return {role: learned(taught(role, 0)) for role in ("leader", "follower")}


class Senses:
    """A plant whose force sensor says something else."""

    def __init__(self, plant: Any, reading: Reading) -> None:
        self._plant, self._reading = plant, reading

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def read(self, obs: Observation) -> None:
        self._plant.read(obs)
        obs.sensor_force[:] = self._reading(obs.time, obs.sensor_force)


@dataclass(frozen=True)
class Came:
    """Of one run.

    sank_m    how far the hand went down after `since_s`; beyond_m: how far beyond the workspace
    fastest   its speed as a share of the limit
    said      why it did less than asked, each reason once; held: whether it was in HOLD at the end
    gave_j    the most work that the hand had done on the object beyond what it had got
    """

    sank_m: float
    beyond_m: float
    fastest: float
    said: tuple[str, ...]
    held: bool
    gave_j: float


def honest(time: float, force: Array) -> Array:
    return force


def try_one(
    case: Case, person: Partner, rng: np.random.Generator, *, reading: Reading = honest, since_s: float = 0.0,
    lasts_s: float | None = None, plant: str = "beam",
) -> Came:  # fmt: skip
    """One run of `case` with `person`; what came of it after `since_s`."""
    skills = learned_skills()
    skill: Any = contestant("default", case.role, skills, dt=0.01)
    said: list[str] = []

    def tap(obs: Observation, command: Command) -> None:
        if skill.mode != "RUN" or skill.notice.startswith(("at the edge", "felt", "shaking")):
            said.append(skill.notice)

    world = Senses(plant_for(plant, person, case, 0.01, rng), reading)
    recording = run(world, skill, duration_s=lasts_s or case.run_s, estimator=estimator_for(case, 0.01), taps=[tap])
    x, time = recording["hand.position"].values[:, 0], recording["hand.position"].time
    v, true = recording["command.velocity"].values[:, 0], recording["hand.true_force"].values[:, 0]
    (low, high), *_ = taught_walls(skills["leader" if case.role == "auto" else case.role])
    after = x[time >= since_s]
    beyond = max(low + 0.05 - x.min(), x.max() - high + 0.05, 0.0)
    return Came(
        float(after[0] - after.min()), beyond, float(np.abs(v).max() / skill.limits.v_max_m_per_s), tuple(dict.fromkeys(said)),
        skill.mode == "HOLD", float(max(-np.cumsum(true * v * 0.01).min(), 0.0)),
    )  # fmt: skip


def row(name: str, came: Sequence[Came]) -> None:
    sank, n = [100.0 * c.sank_m for c in came], len(came)
    beyond, fastest = 100.0 * max(c.beyond_m for c in came), max(c.fastest for c in came)
    print(
        f"{name:48} sank {np.median(sank):4.1f}, most {max(sank):5.1f} cm, > 10 cm {sum(s > 10.0 for s in sank)}/{n};"
        f" beyond {beyond:4.1f} cm; speed {fastest:.2f}; said {sum(bool(c.said) for c in came)}/{n};"
        f" HOLD at the end {sum(c.held for c in came)}; gave {max(c.gave_j for c in came):.1f} J",
        flush=True,
    )


def drawn(role: str, runs: int, seed: int) -> Iterator[tuple[Case, np.random.Generator]]:
    """Each with the generator of its run."""
    for n in range(runs):
        case = draw_case(role, np.random.default_rng([seed, n]))
        yield case, np.random.default_rng(case.seed)


def releases(runs: int, seed: int, plant: str) -> None:
    for role in ROLES:
        for within in WITHIN_S:
            came = []
            for n, (case, rng) in enumerate(drawn(role, runs, seed)):
                at = AT_S[n % len(AT_S)]
                person = LetsGo(partner_of(replace(case, onset_s=1.0), rng), at, within)
                came.append(try_one(case, person, rng, since_s=at, lasts_s=at + within + RUNS_ON_S, plant=plant))
            row(f"{role}, released within {within:g} s", came)


def says_zero(force: Array, rng: np.random.Generator) -> Array:
    return 0.2 * rng.standard_normal(len(force))


def says_constant(force: Array, rng: np.random.Generator) -> Array:
    return -5.0 + 0.2 * rng.standard_normal(len(force))


def scaled(by: float) -> Lie:
    return lambda force, rng: by * force


def moved(by_n: float) -> Lie:
    return lambda force, rng: force + by_n


LIES: dict[str, Lie] = {
    "reads zero, with the noise of a living one": says_zero,
    "reads a plausible constant": says_constant,
    "has the wrong sign": scaled(-1.0),
    "reads twice": scaled(2.0),
    "reads a third": scaled(0.3),
    **{f"reads {n:+g} N more": moved(n) for n in (-49.0, -20.0, -10.0, -5.0, -2.0, 2.0, 5.0, 10.0, 20.0)},
}


def from_then(lie: Lie, since_s: float, rng: np.random.Generator) -> Reading:
    return lambda time, force: lie(force, rng) if time >= since_s else force


def lies(runs: int, seed: int, plant: str) -> None:
    for role in ROLES:
        for since in (0.0, 2.4):
            for name, lie in LIES.items():
                came = [
                    try_one(c, partner_of(c, rng), rng, reading=from_then(lie, since, rng), since_s=since, plant=plant)
                    for c, rng in drawn(role, runs, seed)
                ]
                row(f"{role}, sensor {name} from {since:g} s", came)


def firmer(case: Case, mass_kg: float) -> Case:
    """The same person with another object, damped in proportion."""
    ratio = float(np.sqrt((1.0 + 0.5 * mass_kg) / (1.0 + 0.5 * case.beam_mass_kg)))
    return replace(case, beam_mass_kg=mass_kg, damping_ns_per_m=case.damping_ns_per_m * ratio)


def rounded(step_n: float) -> Reading:
    return lambda time, force: np.round(force / step_n) * step_n


def innocents(runs: int, seed: int, plant: str) -> None:
    for role in ROLES:
        for kind in INNOCENTS:
            people = [(case, np.random.default_rng(case.seed)) for case in draw_people(role, kind, runs, seed)]
            came = [try_one(case, person_of(case, rng, learned_skills(), 0.01), rng, plant=plant) for case, rng in people]
            if came:
                row(f"{role}, who {kind}", came)
        for mass in (0.3, 0.6, 1.0, 3.0, 4.0, 6.0, 8.0):
            heavy = [(firmer(case, mass), rng) for case, rng in drawn(role, runs, seed)]
            row(f"{role}, object of {mass:g} kg", [try_one(c, partner_of(c, rng), rng, plant=plant) for c, rng in heavy])
        for step in (0.05, 0.2, 0.5):
            usual = drawn(role, runs, seed)
            came = [try_one(c, partner_of(c, rng), rng, reading=rounded(step), plant=plant) for c, rng in usual]
            row(f"{role}, sensor in steps of {step:g} N", came)


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("what", nargs="?", choices=("releases", "lies", "innocents"))
    asked.add_argument("--runs", type=int, default=16)
    asked.add_argument("--seed", type=int, default=10_000)
    asked.add_argument("--plant", choices=("beam", "humanoid"), default="beam")
    given = asked.parse_args()
    for name, part in (("releases", releases), ("lies", lies), ("innocents", innocents)):
        if given.what in (None, name):
            part(given.runs, given.seed, given.plant)


if __name__ == "__main__":
    main()
