"""The humanoid in real time: lessons at the device's 1 kHz, reproductions at 100 Hz, everything in one process on one core.

    python benchmarks/physics.py [repeats]

Processor time, everything included. The floor is what the simulator itself takes for the same milliseconds (`mj_step`
alone, the same robot standing with its beam), measured in turns with the rest so that a busy machine hurts both.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

import mujoco
import numpy as np

from comanip.interfaces import Skill
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.people.partners import HumanLeader
from comanip.plants.humanoid import HumanoidPlant
from comanip.recording import Recording
from comanip.reproduction import make_skill
from comanip.teaching import teach
from comanip.trials import draw_case, run_case
from machine import median, stay_on_one_core

ROLES = ("leader", "follower")
FLOOR_MS = 2000


def lesson(role: str, seed: int) -> Recording:
    return teach(role, 1, rng=np.random.default_rng([seed, ROLES.index(role)]), plant="humanoid")[0]


def skill_of(role: str) -> Skill:
    learned = learn(demonstrations(teach(role, 5, rng=np.random.default_rng(0)), rate_hz=100.0), role=role)
    return make_skill(learned, axes=learned.axes, dt=0.01, role=role)


def reproduction(role: str, skill: Skill, seed: int) -> Recording:
    return run_case(draw_case(role, np.random.default_rng([seed, ROLES.index(role)])), skill, plant="humanoid")


def floor() -> Callable[[], None]:
    rng = np.random.default_rng(0)
    plant = HumanoidPlant(HumanLeader(rng=rng), rng=rng)
    return lambda: mujoco.mj_step(plant.scene.model, plant._data, FLOOR_MS)


def measure(repeats: int) -> dict[str, list[tuple[float, float, float]]]:
    """Name -> (simulated, taken, taken by the simulator alone for as much) [s]; people and lifts differ from run to run."""
    skills, simulate = {role: skill_of(role) for role in ROLES}, floor()
    found: dict[str, list[tuple[float, float, float]]] = {}
    lesson("leader", 0)  # imports and compiles: not counted
    for seed in range(1, repeats + 1):
        for role in ROLES:
            for name, work in (("lesson", lesson), ("reproduction", lambda r, s: reproduction(r, skills[r], s))):
                before = time.process_time()
                simulated = work(role, seed).duration_s
                between = time.process_time()
                simulate()
                alone = (time.process_time() - between) * simulated / (1e-3 * FLOOR_MS)
                found.setdefault(f"{name}, robot as {role}", []).append((simulated, between - before, alone))
    return found


if __name__ == "__main__":
    stay_on_one_core()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name, runs in measure(int(sys.argv[1]) if len(sys.argv) > 1 else 10).items():
        times = [simulated / taken for simulated, taken, _ in runs]
        share = [alone / taken for _, taken, alone in runs]
        print(
            f"{name:32s} {median(times):5.1f} x real time ({min(times):.1f} to {max(times):.1f}); "
            f"mj_step alone {100.0 * median(share):.0f} % of that time"
        )
