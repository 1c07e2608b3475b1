"""Fig. 1: the experiment. A user teleoperates a humanoid to carry a beam together with another user.

A lesson is taught on the exact beam and carried out again in physics: the same command for the hand, the same force of the
partner. The picture is its moment of fastest lifting, drawn from the recorded joints. Claims: the humanoid does what the lesson
did. Refuted by a hand or a force that differs from the lesson's, a beam that tilts, a joint at its limit, a robot that falls.

    python experiments/figure_1.py [folder] [--films]      the films: the lesson, and both skills with partners they never met
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.demonstration import demonstrations
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.filters import smooth
from comanip.interaction import TaringInteractionForce, gravity_along
from comanip.interfaces import Array, Command, Observation
from comanip.learned import learn
from comanip.loop import run as run_loop
from comanip.plants.beam import WristSensor
from comanip.plants.humanoid import HumanoidPlant
from comanip.recording import Recording
from comanip.reproduction import make_skill
from comanip.teaching import teach
from comanip.trials import FORCE_CUTOFF_HZ, draw_case, partner_of

SIZE = (1280, 720)


class Numbers(NamedTuple):
    lesson: Recording  # as taught, on the exact beam
    physics: Recording  # the same lesson carried out by the humanoid


class _Replayed:
    """A recorded signal (T, d) over time [s], as a partner's force or as a skill's velocity."""

    stop_reason = notice = ""

    def __init__(self, time: Array, values: Array) -> None:
        self._time, self._values = time - time[0], values
        self.diagnostics: dict[str, Array] = {}

    def reset(self, start: Any) -> None:
        pass

    def at(self, time: float, out: Array) -> None:
        out[:] = self._values[min(int(np.searchsorted(self._time, time + 1e-9, side="right")), len(self._time)) - 1]

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        self.at(time, out)

    def step(self, obs: Observation, command: Command) -> None:
        self.at(obs.time, command.velocity)


def numbers(seed: int) -> Numbers:
    rng = np.random.default_rng([seed, 1])
    lesson = teach("follower", 1, rng=rng)[0]
    channels = lesson["partner.force"], lesson["command.velocity"]
    partner, skill = (_Replayed(c.time, c.values) for c in channels)
    plant = HumanoidPlant(partner, sensor=WristSensor(0.0, 0.0, 0.0), dt=0.01, rng=rng)
    return Numbers(lesson, run_loop(plant, skill, duration_s=lesson.duration_s, metadata={"role": "follower"}))


def claims(found: Numbers) -> list[Claim]:
    lesson, physics = found
    time = physics["hand.position"].time
    taught_at = lesson["hand.position"].time
    hand = np.interp(time, taught_at, lesson["hand.position"].values[:, 0])
    apart = physics["hand.position"].values[:, 0] - hand
    force = np.interp(time, taught_at, smooth(lesson["hand.true_force"].values, 0.001, FORCE_CUTOFF_HZ)[:, 0])
    felt = smooth(physics["hand.true_force"].values, 0.01, FORCE_CUTOFF_HZ)[:, 0]
    joints = physics["robot.joints"].values
    return [
        at_most(
            "the hand goes where the lesson went: largest distance",
            1000.0 * float(np.abs(apart).max()),
            5.0,
            unit="mm",
            refuted_by="an arm, balance or inverse kinematics that does not follow",
        ),
        at_most(
            "and feels the force that the lesson felt: RMS of the difference",
            float(np.sqrt(np.mean((felt - force) ** 2))),
            0.5,
            unit="N",
            refuted_by="a grip that pivots, or forces that do not reach the wrist",
        ),
        at_least("which was worth feeling: peak", float(np.abs(force).max()), 3.0, unit="N", refuted_by="a lesson without force"),
        at_most(
            "the beam stays level: largest tilt",
            float(np.degrees(np.abs(physics["beam.tilt"].values).max())),
            2.0,
            unit="deg",
            refuted_by="a wrist too soft to resist",
        ),
        at_most(
            "no joint leaves its range or reaches its torque or speed limit: times",
            float(physics["robot.limits"].values[-1].sum()),
            0.0,
            refuted_by="a lift that this robot cannot do",
        ),
        at_least(
            "the arm did the lift: largest rotation of a joint",
            float(np.degrees(np.ptp(joints, axis=0).max())),
            20.0,
            unit="deg",
            refuted_by="a body that rises instead of an arm",
        ),
    ]


def draw(found: Numbers, path: Path) -> Path:
    """The moment of fastest lifting, seen as in the paper: teacher on the left, partner on the right."""
    from comanip.plants.humanoid import render

    speed = found.physics["hand.velocity"].values[:, 0]
    moment = float(found.physics["hand.velocity"].time[int(np.argmax(speed))])
    return render.save(render.picture(found.physics, at_s=moment, teacher=True, size=SIZE), path)


def films(found: Numbers, out: Path, *, seed: int, suffix: str = ".gif") -> list[Path]:
    """The lesson, and each role's skill with a partner it has never met, all on the humanoid."""
    from comanip.plants.humanoid import render

    settings: dict[str, Any] = {"rate_hz": 12.5, "size": (640, 360)}
    made = [render.film(found.physics, out / f"figure_1_lesson{suffix}", teacher=True, **settings)]
    for role in ("follower", "leader"):
        made.append(render.film(reproduced(role, seed), out / f"figure_1_{role}{suffix}", **settings))
    return made


def reproduced(role: str, seed: int) -> Recording:
    rng = np.random.default_rng([seed, 1, ("follower", "leader").index(role)])
    learned = learn(demonstrations(teach(role, 5, rng=rng), rate_hz=100.0), role=role)
    case = draw_case(role, rng)
    sensor = WristSensor(case.force_noise_n, case.force_bias_n, case.sensor_delay_s)
    plant = HumanoidPlant(partner_of(case, rng), load_mass_kg=case.beam_mass_kg, sensor=sensor, rng=rng)
    estimator = TaringInteractionForce(plant.dt, gravity=gravity_along(plant.axes).tolist(), cutoff_hz=FORCE_CUTOFF_HZ)
    skill = make_skill(learned, axes=learned.axes, dt=plant.dt, role=role)
    seconds = case.onset_s + case.duration_s + 1.5 if role == "follower" else 6.0
    return run_loop(plant, skill, duration_s=seconds, estimator=estimator, metadata={"role": role})


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    out.mkdir(parents=True, exist_ok=True)
    draw(found, out / "figure_1.png")
    return claims(found)


if __name__ == "__main__":
    from comanip.experiments.readings import script

    from comanip.errors import ComanipError

    wants_films = "--films" in sys.argv
    if wants_films:
        sys.argv.remove("--films")
    try:
        script(run)
        if wants_films:
            folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/figures")
            print("films:", *films(numbers(0), folder, seed=0))
    except ComanipError as problem:
        sys.exit(f"figure_1: {problem}")
