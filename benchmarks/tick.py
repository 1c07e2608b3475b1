"""One tick of the whole default skill within its envelope, from Python: how long, and how evenly.

python benchmarks/tick.py [ticks] [picture.png]
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from comanip import kernels
from comanip.interfaces import Command, Observation, Skill
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.reproduction import make_auto, make_skill
from comanip.teaching import teach

DT = 0.01
EDGES = np.concatenate(
    [np.arange(0.0, 10.0), np.arange(10.0, 100.0, 10.0), [100.0, 200.0, 500.0, 1000.0, 10_000.0, np.inf]]
)  # [µs]


CASES = (
    ("skill alone", False, True),
    ("skill and envelope", True, True),
    ("skill alone, numpy twin", False, False),
    ("skill and envelope, numpy twin", True, False),
)


@contextmanager
def only_numpy(wanted: bool) -> Iterator[None]:
    """What is made here is made of the readable twins, when they are wanted."""
    native, kernels.native = kernels.native, None if wanted else kernels.native
    try:
        yield
    finally:
        kernels.native = native


def course(role: str, learned: Any) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T,) and forces (T,) of one lift as another person would do it, there and back, for ever."""
    low, high = learned.workspace[0].mean() - 0.1, learned.workspace[0].mean() + 0.1
    s = 0.5 - 0.5 * np.cos(np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False))
    sign = -1.0 if role == "leader" else 1.0
    return low + (high - low) * s, sign * 3.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False))


def ticks(skill: Skill, positions: np.ndarray, forces: np.ndarray, n: int, *, noise: np.ndarray) -> np.ndarray:
    """Seconds of each of n steps (n,), collection off as in `loop.run`; what is commanded is where the hand goes."""
    obs, command = Observation(1), Command(1)
    obs.position[:] = positions[0]
    obs.force[:] = obs.velocity[:] = 0.0
    obs.sensor_force[:] = 0.0
    skill.reset(obs)
    took = np.empty(n)
    clock, step = time.perf_counter, skill.step
    gc.collect()
    gc.disable()
    try:
        for i in range(n):
            obs.time = i * DT
            k = i % len(positions)
            obs.force[0] = forces[k] + noise[i % len(noise)]
            obs.sensor_force[0] = -obs.force[0]
            before = clock()
            step(obs, command)
            took[i] = clock() - before
            obs.position[0] = command.position[0]
            obs.velocity[0] = command.velocity[0]
    finally:
        gc.enable()
    return took


def measure(n: int = 1_000_000) -> dict[str, np.ndarray]:
    found = {}
    noise = 0.05 * np.random.default_rng(0).normal(size=9973)
    taught = {
        role: learn(demonstrations(teach(role, 5, rng=np.random.default_rng(0)), rate_hz=100.0), role=role)
        for role in ("follower", "leader", "natural")
    }
    for role in ("follower", "leader", "auto"):
        learned = taught.get(role, taught["follower"])
        positions, forces = course(role, learned)
        for name, envelope, native in CASES:
            with only_numpy(not native):
                if role == "auto":
                    skill = make_auto(taught, axes=learned.axes, dt=DT, envelope=envelope)
                else:
                    skill = make_skill(learned, axes=learned.axes, dt=DT, role=role, envelope=envelope)
            took = 1e6 * ticks(skill, positions, forces, n if envelope and native else max(n // 20, 1), noise=noise)
            if getattr(skill, "mode", "RUN") == "HOLD":
                raise AssertionError(f"{role}: the envelope held: {getattr(skill, 'reason', '')}; that is no tick to measure")
            found[f"{role}, {name}"] = took
    return found


def summary(n: int = 1_000_000) -> list[dict[str, Any]]:
    """What `measure` found of a role within its envelope: quantiles [µs], how many ticks, and the median of the twin."""
    found = measure(n)
    rows = []
    for name, took in found.items():
        if not name.endswith("skill and envelope"):
            continue
        p50, p99, p999 = (float(q) for q in np.percentile(took, (50.0, 99.0, 99.9)))
        twin = float(np.median(found[f"{name}, numpy twin"]))
        rows.append({"role": name.split(",")[0], "ticks": len(took), "median": p50, "p99": p99, "p999": p999,
                     "longest": float(took.max()), "twin": twin})  # fmt: skip
        print({k: v if isinstance(v, str) else round(v, 2) for k, v in rows[-1].items()}, file=sys.stderr)
    return rows


def histogram(took: np.ndarray) -> str:
    """Counts on a logarithmic scale: what matters is the tail."""
    counts, _ = np.histogram(took, EDGES)
    lines = []
    for low, high, count in zip(EDGES[:-1], EDGES[1:], counts, strict=True):
        if count:
            lines.append(f"{low:7.0f} to {high:7.0f} µs {count:9d} {'#' * (1 + int(6 * np.log10(count)))}")
    return "\n".join(lines)


def draw(found: dict[str, np.ndarray], path: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4))
    shown = [took for name, took in found.items() if "envelope" in name]
    bins = np.geomspace(min(t.min() for t in shown), max(t.max() for t in shown), 120)
    for name, took in found.items():
        style = {"follower": "-", "leader": ":", "auto": "--"}[name.split(",")[0]]
        color = "tab:red" if "twin" in name else "black"
        if "envelope" in name:
            axes.hist(took, bins, histtype="step", label=name, linestyle=style, color=color)
    axes.set(xscale="log", yscale="log", xlabel="one tick [µs]", ylabel="ticks")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    results = measure(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
    for name, took in results.items():
        p50, p99, p999 = np.percentile(took, (50.0, 99.0, 99.9))
        print(f"{name}: median {p50:.2f}, 99 % {p99:.2f}, 99.9 % {p999:.2f}, longest {took.max():.0f} µs of {len(took)} ticks")
        twin = results.get(f"{name}, numpy twin")
        if twin is not None:
            print(f"    the numpy twin takes {np.median(twin) / p50:.1f} times as long")
        print(histogram(took))
    if len(sys.argv) > 2:
        draw(results, sys.argv[2])
