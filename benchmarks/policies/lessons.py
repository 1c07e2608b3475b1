"""Lessons as a policy learns them: what it would have seen, and the velocity that the teacher wanted then.

python benchmarks/policies/lessons.py OUT --task lift --role follower --lessons 500
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from comanip.lessons.demonstration import Demonstration, demonstrations
from comanip.teaching import teach

RATE_HZ = 100.0  # of the control loop that a policy is asked in
LAG = 2  # [ticks] 20 ms from command to hand
SEED = 0  # the same first five lessons as `comanip trial` learns from


def recorded(task: str, role: str, lessons: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """(T, 3 d) position, velocity, force, and (T, d) velocity to command, of each lesson, at the control rate."""
    recordings = teach(role, lessons, task=task, rng=np.random.default_rng(SEED))
    return [as_seen(one) for one in demonstrations(recordings, rate_hz=RATE_HZ)]


def as_seen(lesson: Demonstration) -> tuple[np.ndarray, np.ndarray]:
    """The velocity that the hand had LAG ticks later is what was commanded: the actuator is so much behind."""
    seen = np.hstack([lesson.position, lesson.velocity, lesson.force])
    return seen[:-LAG], lesson.velocity[LAG:]


def stored(folder: Path, task: str, role: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Those of a folder that `main` filled."""
    with np.load(folder / f"{task}_{role}.npz") as data:
        ends = np.cumsum(data["lengths"])[:-1]
        return list(zip(np.split(data["seen"], ends), np.split(data["said"], ends), strict=True))


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("out", type=Path)
    words.add_argument("--task", default="lift")
    words.add_argument("--role", default="follower")
    words.add_argument("--lessons", type=int, default=500)
    asked = words.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    found = recorded(asked.task, asked.role, asked.lessons)
    seen, said = (np.vstack([one[n] for one in found]) for n in range(2))
    file = asked.out / f"{asked.task}_{asked.role}.npz"
    np.savez_compressed(file, seen=seen, said=said, lengths=[len(one[0]) for one in found])
    print(f"{file}: {len(found)} lessons, {len(seen) / RATE_HZ:.0f} s")


if __name__ == "__main__":
    main()
