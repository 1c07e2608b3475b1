"""Fig. 1: the experiment. A user teleoperates a humanoid to carry a beam together with another user.

One lesson, the same people with the same habits and noise, taught twice: on the exact beam and on the humanoid in physics. The
picture is the second one's moment of fastest lifting, drawn from the recorded joints. Claims: the humanoid is taught what the
beam is. Refuted by a hand or a force that differs, a beam that tilts, a joint at its limit, a robot that falls.

    python experiments/figure_1.py [folder] [--films]      the films: the lesson, and both skills with partners they never met
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.recording import Recording
from comanip.reproduction import make_skill
from comanip.signals.filters import smooth
from comanip.teaching import teach
from comanip.trials import draw_case, run_case

SIZE = (1280, 720)
FELT_HZ = 15.0


class Numbers(NamedTuple):
    lesson: Recording  # on the exact beam
    physics: Recording  # on the humanoid


def numbers(seed: int) -> Numbers:
    taught = (teach("follower", 1, rng=np.random.default_rng([seed, 1]), plant=plant)[0] for plant in ("beam", "humanoid"))
    return Numbers(*taught)


def claims(found: Numbers) -> list[Claim]:
    physics = found.physics
    both = min(len(run["hand.position"].time) for run in found)
    hands = [run["hand.position"].values[:both, 0] for run in found]
    forces = [smooth(run["hand.true_force"].values[:both, 0], 0.001, FELT_HZ) for run in found]
    apart, difference = hands[1] - hands[0], forces[1] - forces[0]
    joints = physics["robot.joints"].values
    return [
        at_most(
            "the hand goes where it goes on the exact beam: largest distance",
            1000.0 * float(np.abs(apart).max()),
            15.0,  # a twentieth of the lift
            unit="mm",
            refuted_by="an arm, balance or inverse kinematics that does not follow",
        ),
        at_most(
            "and feels the force that it feels there: RMS of the difference",
            float(np.sqrt(np.mean(difference**2))),
            0.5,
            unit="N",
            refuted_by="a grip that pivots, or forces that do not reach the wrist",
        ),
        at_least(
            "which was worth feeling: peak", float(np.abs(forces[1]).max()), 3.0, unit="N", refuted_by="a lesson without force"
        ),
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
    return run_case(draw_case(role, rng), make_skill(learned, axes=learned.axes, dt=0.01, role=role), plant="humanoid")


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    out.mkdir(parents=True, exist_ok=True)
    draw(found, out / "figure_1.png")
    return claims(found)


if __name__ == "__main__":
    from comanip.errors import ComanipError
    from comanip.experiments.readings import script

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
