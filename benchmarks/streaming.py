"""EM over more data than one wants in memory: 10^7 frames in Parquet shards; cost a frame and a byte, and peak memory.

python benchmarks/streaming.py [shards of 100,000 frames] [processes]
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from comanip.fitting.streaming import fit_stream
from comanip.lessons.shards import ParquetShards
from em import comanip
from machine import alternated, median, problem

D, K, FRAMES, LENGTH = 7, 10, 100_000, 500
NAMES = tuple(f"c.{i}" for i in range(D))


def write(folder: Path, n_shards: int) -> int:
    """Shards as LeRobot would keep them; gives their size in bytes."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    for shard in range(n_shards):
        p = problem([LENGTH] * (FRAMES // LENGTH), D, K, seed=shard)
        columns: dict[str, Any] = {name: p.frames[:, i] for i, name in enumerate(NAMES)}
        columns["episode_index"] = shard * FRAMES + np.arange(FRAMES) // LENGTH
        parquet.write_table(pa.table(columns), folder / f"{shard:05d}.parquet", compression="snappy")
    return sum(f.stat().st_size for f in folder.iterdir())


def peak_mb() -> float:
    """This process and the largest of its finished children."""
    return sum(resource.getrusage(w).ru_maxrss for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024.0


def measure(n_shards: int = 100, n_jobs: int = 1, iterations: int = 3) -> dict[str, float]:
    options: dict[str, Any] = {"channels": NAMES, "topology": "free", "tolerance": 0.0}
    ended: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = write(folder, n_shards)
        paths, n = sorted(folder.iterdir()), n_shards * FRAMES
        began = time.perf_counter()

        def note(stage: str, done: int, total: int) -> None:
            ended[stage] = time.perf_counter() - began

        fit_stream(paths, K, read=ParquetShards(dict(zip(NAMES, NAMES, strict=True))), max_iterations=iterations,
                   n_jobs=n_jobs, checkpoint=folder / "checkpoint.json", progress=note, **options)  # fmt: skip
        peak = peak_mb()
        passes = np.diff([0.0, *ended.values()])
        em = float(np.median([t for t, stage in zip(passes, ended, strict=True) if stage.startswith("EM")]))
        found = {"frames": float(n), "megabytes": size / 1e6, "processes": float(n_jobs), "peak_mb": peak,
                 "pass_s": em, "ns_per_frame": em / n * 1e9, "ns_per_byte": em / size * 1e9}  # fmt: skip
        # the same iteration in memory, on data of the same making: what reading costs
        few = problem([LENGTH] * 200, D, K)
        memory = median(alternated({"": comanip(few)}, 15)[""]) / len(few.frames) * 1e9
        found |= {"in_memory_ns_per_frame": memory, "ratio_to_memory": found["ns_per_frame"] / memory}
        try:
            from em import hmmlearn

            iterate = hmmlearn(few)
            before = time.perf_counter()
            iterate()
            there = (time.perf_counter() - before) / len(few.frames) * 1e9
            found |= {"hmmlearn_in_memory_ns_per_frame": there, "times_hmmlearn": there / found["ns_per_frame"]}
        except ImportError:
            print("hmmlearn is absent", file=sys.stderr)
    return found


if __name__ == "__main__":
    for key, value in measure(*map(int, sys.argv[1:])).items():
        print(f"{key:34s} {value:12.4g}")
