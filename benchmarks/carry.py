"""Steps a second of the gym: one environment, many in C, and the same many behind Gymnasium's own SyncVectorEnv.

python benchmarks/carry.py [--json]. Everything runs in one process. CPU seconds are printed beside wall seconds: on a machine
that does other work, too, the first say what an idle one would do. The policy is a mass-damper on the force, so most succeed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import comanip.gym
from comanip import kernels
from machine import described

MASS_KG, DAMPING_NS_PER_M, DT = 6.0, 20.0, 0.01
ABOUT = {"task": "lift", "role": "follower", "misbehaving": 0.0}


def damped(v: np.ndarray, force: np.ndarray) -> np.ndarray:
    return (MASS_KG * v + DT * force) / (MASS_KG + DT * DAMPING_NS_PER_M)


def alone(ticks: int) -> int:
    env = gymnasium.make("comanip/Carry-v0", disable_env_checker=True, **ABOUT)
    seen, _ = env.reset(seed=0)
    v = np.zeros(1)
    for _ in range(ticks):
        v = damped(v, seen[2:3])
        seen, _, over, _, _ = env.step(v)
        if over:
            (seen, _), v = env.reset(), np.zeros(1)
    return ticks


def many(envs: Any, ticks: int) -> int:
    seen, _ = envs.reset(seed=0)
    v = np.zeros((envs.num_envs, 1))
    for _ in range(ticks):
        v = damped(v, seen[:, 2:3])
        seen, _, over, _, _ = envs.step(v)
        v[over] = 0.0
    return ticks * envs.num_envs


def measured(work: Callable[[], int]) -> dict[str, float]:
    """The best of three, because other work only slows."""
    rows = []
    for _ in range(3):
        wall, cpu = time.perf_counter(), time.process_time()
        steps = work()
        rows.append((steps / (time.perf_counter() - wall), steps / (time.process_time() - cpu)))
    return {"steps_per_s": max(w for w, _ in rows), "steps_per_cpu_s": max(c for _, c in rows)}


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--json", action="store_true")
    asked = words.parse_args()
    peer = gymnasium.vector.SyncVectorEnv([lambda: comanip.gym.CarryEnv(**ABOUT) for _ in range(64)])
    many(comanip.gym.CarryVectorEnv(2, **ABOUT), 300)  # imports and caches
    found: dict[str, Any] = {"one environment": measured(lambda: alone(8000))}
    found["SyncVectorEnv of 64"] = measured(lambda: many(peer, 250))
    for n in (16, 64, 256):
        envs = comanip.gym.CarryVectorEnv(n, **ABOUT)
        found[f"CarryVectorEnv of {n}"] = measured(lambda envs=envs, n=n: many(envs, 1200 if n <= 64 else 800))
        found[f"CarryVectorEnv of {n}"]["compiled_share"] = envs.compiled_share
    if asked.json:
        print(json.dumps({"machine": described(), "kernels": kernels.description, **found}, indent=1))
        return
    print(f"{described()}; {kernels.description}")
    base = found["SyncVectorEnv of 64"]["steps_per_cpu_s"]
    for name, row in found.items():
        share = f", {100 * row['compiled_share']:.0f} % of ticks in C" if "compiled_share" in row else ""
        print(
            f"{name}: {row['steps_per_s']:,.0f} steps/s, {row['steps_per_cpu_s']:,.0f} a CPU second, "
            f"{row['steps_per_cpu_s'] / base:.1f} times SyncVectorEnv{share}"
        )


if __name__ == "__main__":
    main()
