"""CPU microseconds of a tick of laws and policies, without the envelope: python benchmarks/policies/latency.py --law-from mine.py

Printed as CSV: law, the median and the 99th of a hundred. Each carries with one partner, in Python.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from comanip.gym.draw import trial_cases
from comanip.interfaces import Command, Observation
from comanip.tasks import named
from comanip.trials import contestant, run_case
from comanip.trials.taught import kept


class Timed:
    """A skill and how long each of its ticks took."""

    def __init__(self, skill: Any) -> None:
        self.skill, self.took = skill, []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.skill, name)

    def step(self, obs: Observation, command: Command) -> None:
        began = time.perf_counter_ns()
        self.skill.step(obs, command)
        self.took.append(1e-3 * (time.perf_counter_ns() - began))


def of(law: str, role: str, task: str) -> tuple[float, float]:
    """Median and 99 % of a tick [us], of one run."""
    learned = kept(named(task), ("leader", "follower"))
    skill = Timed(contestant(law, role, learned, dt=0.01, envelope=False, task=named(task)))
    run_case(trial_cases(role, 1, seed=3, task=task, misbehaving=0.0)[0], skill)
    return float(np.median(skill.took)), float(np.quantile(skill.took, 0.99))


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--law", nargs="*", default=[])
    words.add_argument("--law-from", nargs="*", default=[])
    words.add_argument("--role", default="follower")
    words.add_argument("--task", default="lift")
    asked = words.parse_args()
    print("law,median_us,most_us")
    for law in (*asked.law, *asked.law_from):
        median, most = min(of(law, asked.role, asked.task) for _ in range(3))  # other work only slows
        print(f"{law},{median:.1f},{most:.1f}", flush=True)


if __name__ == "__main__":
    main()
