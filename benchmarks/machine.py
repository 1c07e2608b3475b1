"""What every benchmark shares: data and a start from a seed, times in alternation, and the machine they were measured on."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))  # at the start

A_TURN_S, A_TURN, A_PAUSE_S = 0.25, 10, 0.3


class Problem(NamedTuple):
    """Sequences stacked (N, D), their lengths, and a start that is neither good nor hopeless."""

    frames: np.ndarray
    lengths: np.ndarray
    initial: np.ndarray
    transition: np.ndarray
    means: np.ndarray
    covariances: np.ndarray

    @property
    def sequences(self) -> list[np.ndarray]:
        return np.split(self.frames, np.cumsum(self.lengths)[:-1])


def problem(lengths: Any, n_channels: int, n_states: int, seed: int = 0) -> Problem:
    """Every sequence goes through the states in order, with noise; all transitions allowed, so that every peer can hold it."""
    rng = np.random.default_rng(seed)
    lengths = np.asarray(lengths)
    centres = 2.0 * rng.normal(size=(n_states, n_channels))
    phase = np.concatenate([np.linspace(0.0, n_states - 1e-9, n) for n in lengths]).astype(int)
    frames = centres[phase] + rng.normal(size=(len(phase), n_channels))
    transition = np.full((n_states, n_states), 0.1 / n_states) + 0.9 * np.eye(n_states)
    return Problem(
        frames,
        lengths,
        np.full(n_states, 1.0 / n_states),
        transition / transition.sum(axis=1, keepdims=True),
        centres + 0.3 * rng.normal(size=centres.shape),
        np.tile(1.5 * np.eye(n_channels), (n_states, 1, 1)),
    )


def alternated(work: dict[str, Callable[[], Any]], repeats: int, budget_s: float = 20.0) -> dict[str, list[float]]:
    """Seconds of each piece of work, taken in turns so that a busy machine hurts all alike; slow ones stop at `budget_s`.

    A neighbour's work comes and goes within seconds, so quick work is done again and again in its turn, for A_TURN_S or A_TURN
    times, and its turn has one voice: the median, without the first that finds the caches cold. Before each turn the core is kept
    busy for a while: threads of XLA spin on for 0.2 s after their work is done, and a core that rested would be slow at first.
    """
    times: dict[str, list[float]] = {name: [] for name in work}
    spent = dict.fromkeys(work, 0.0)
    gc.collect()
    for _ in range(repeats):
        for name, call in work.items():
            if spent[name] > budget_s:
                continue
            until = time.perf_counter() + A_PAUSE_S * (len(work) > 1)
            while time.perf_counter() < until:
                pass
            turn: list[float] = []
            while not turn or (sum(turn) < A_TURN_S and len(turn) < A_TURN):
                before = time.perf_counter()
                call()
                turn.append(time.perf_counter() - before)
            times[name].append(median(turn[1:] or turn))
            spent[name] += sum(turn)
    return times


def stay_on_one_core() -> None:
    """Everybody gets one core, threads that start from now on included: XLA would take them all and leave them spinning."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def on_all_cores(call: Callable[[], Any]) -> Callable[[], Any]:
    """The same call, with every core that this process was given for the threads that it starts."""
    return on_cores(CORES, call)


def on_cores(cores: list[int], call: Callable[[], Any]) -> Callable[[], Any]:
    if not hasattr(os, "sched_setaffinity"):
        return call

    def wrapped() -> Any:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, cores)
        try:
            return call()
        finally:
            os.sched_setaffinity(0, before)

    return wrapped


def median(times: list[float]) -> float:
    return float(np.median(times))


def dgemm_gflops(size: int = 1000, repeats: int = 5) -> float:
    """One thread, when the environment says OPENBLAS_NUM_THREADS=1: the best this core did."""
    a, b = np.random.default_rng(0).random((2, size, size))
    return 2.0 * size**3 / min(alternated({"": lambda: a @ b}, repeats)[""]) / 1e9


def dgemm_gflops_of(n_threads: int, size: int = 1000, repeats: int = 15) -> float:
    """n threads at once, each with matrices of its own, for long enough that a machine which lends its cores shows it."""
    pairs = np.random.default_rng(0).random((n_threads, 2, size, size))

    def multiply(pair: np.ndarray) -> None:
        for _ in range(repeats):
            pair[0] @ pair[1]

    def all_at_once() -> None:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(multiply, pairs))

    return 2.0 * size**3 * repeats * n_threads / median(alternated({"": on_all_cores(all_at_once)}, 5)[""]) / 1e9


def flops_per_frame(n_channels: int, n_states: int) -> float:
    """What an E-step cannot avoid: densities by triangles, exponentials, two products with the chain and ξ, moments."""
    d, k = n_channels, n_states
    return 2.0 * (k * (d * (d + 1) / 2 + d) + 13 * k + 3 * k * k + k * (d + 1) * (d + 2) / 2) + (d + 1) * (d + 2) / 2


def described() -> dict[str, str]:
    """The processor, the system, and the versions of everything that is measured."""
    processor = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        pairs = (line.partition(":") for line in info.read_text().splitlines())
        found = {name.strip(): value.strip() for name, _, value in pairs}
        processor = f"{found.get('model name', processor)}, family {found.get('cpu family', '?')} model {found.get('model', '?')}"
    packages = ("comanip", "numpy", "hmmlearn", "dynamax", "jax", "gmr", "pomegranate", "torch")
    about = {"processor": processor, "system": platform.platform(terse=True), "python": platform.python_version()}
    pbdlib = {"pbdlib": "a checkout" if os.environ.get("PBDLIB") else "absent"}
    return about | {name: _version(name) for name in packages} | pbdlib


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
