"""Runs every benchmark and writes docs/benchmarks.md and docs/benchmarks.png: `make bench`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PEERS = ("comanip", "comanip, 2 threads", "comanip, float32", "comanip, numpy twin", "hmmlearn", "dynamax", "dynamax, float32",
         "pomegranate", "gmr")  # fmt: skip
GREYS = {"comanip": "0.0", "comanip, 2 threads": "0.2", "comanip, float32": "0.35", "comanip, numpy twin": "0.5",
         "hmmlearn": "0.65", "dynamax": "0.75", "dynamax, float32": "0.8", "pomegranate": "0.85", "gmr": "0.9"}  # fmt: skip


def measured(part: str) -> Any:
    """Each part in a process of its own, so that no peer's threads or memory stay in the way."""
    print(f"{part} ...", file=sys.stderr)
    code = f"import json, {part}; print('@' + json.dumps({part}.measure()))"
    return _run(["-c", code])


def memory() -> float:
    return float(_run(["-c", "import em; print('@' + str(em.memory_over_data()))"]))


def _run(arguments: list[str]) -> Any:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(HERE)}
    done = subprocess.run([sys.executable, *arguments], env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("@"))[1:])


def rows_of(columns: tuple[str, ...], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def em_table(rows: list[dict[str, Any]]) -> str:
    peers = [p for p in PEERS if any(p in r["ns"] for r in rows)]

    def cell(row: dict[str, Any], peer: str) -> str:
        if peer not in row["ns"]:
            return "–"
        return f"{row['ns'][peer]:,.0f} ({row['ns'][peer] / row['ns']['comanip']:.1f} ×)"

    body = [
        [r["size"], *[cell(r, p) for p in peers], f"{r['floor_ns']:.0f} ({r['ns']['comanip'] / r['floor_ns']:.2f} ×)"]
        for r in rows
    ]
    return rows_of(("sequences × frames", *peers, "dgemm floor"), body)


def tick_table(rows: list[dict[str, Any]]) -> str:
    peers = [p for p in PEERS if p in rows[0]["us"]]
    body = [
        [
            r["size"],
            *[f"{r['us'][p][0]:.2f} / {r['us'][p][1]:.0f} ({r['us'][p][0] / r['us']['comanip'][0]:.0f} ×)" for p in peers],
        ]
        for r in rows
    ]
    return rows_of(("size", *peers), body)


def durations_table(rows: list[dict[str, Any]]) -> str:
    body = [
        [r["size"], *[f"{r['ns'][p]:,.0f} ({r['ns'][p] / r['ns']['comanip']:.0f} ×)" for p in r["ns"]],
         *[f"{r['us'][p]:.2f} ({r['us'][p] / r['us']['comanip']:.0f} ×)" for p in r["us"]]]
        for r in rows
    ]  # fmt: skip
    peers = list(rows[0]["ns"])
    return rows_of(("sequences × frames", *[f"{p}, ns a frame" for p in peers], *[f"{p}, µs a tick" for p in peers]), body)


def draw(results: dict[str, Any], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = results["em"]
    peers = [p for p in PEERS if any(p in r["ns"] for r in rows)]
    figure, axis = plt.subplots(figsize=(9.0, 3.6), constrained_layout=True)
    width = 0.8 / len(peers)
    for i, peer in enumerate(peers):
        at = [(j + (i - len(peers) / 2 + 0.5) * width, r["ns"][peer]) for j, r in enumerate(rows) if peer in r["ns"]]
        axis.bar([x for x, _ in at], [y for _, y in at], width, label=peer, color=GREYS[peer], edgecolor="0.2", linewidth=0.4)
    for j, r in enumerate(rows):
        axis.plot([j - 0.42, j + 0.42], [r["floor_ns"]] * 2, "k--", linewidth=0.9, label="dgemm floor" if j == 0 else None)
    axis.set(yscale="log", ylabel="one EM iteration [ns / frame]")
    axis.set_xticks(range(len(rows)), [r["size"].replace(", D", "\nD") for r in rows], fontsize=8)
    axis.legend(fontsize=7, ncols=4, loc="upper left")
    axis.set_ylim(top=axis.get_ylim()[1] * 4)
    figure.savefig(path, dpi=150)


def main() -> None:
    from machine import described

    results = {part: measured(part) for part in ("em", "hsmm", "online", "rollouts", "startup")}
    about = described()
    speeds = results["rollouts"]
    text = f"""# Benchmarks

Made by `make bench`; nothing here is typed by hand. The same data, the same start and the same work for everyone, taken in
turns; medians. Absolute times move with the machine (and with its neighbours); the ratios in brackets, to comanip with one
thread, move less. Likelihoods of hmmlearn and of the numpy twin agree to 1e-8 with ours, or the run stops; that of dynamax
{"agrees to 1e-4" if all(r["dynamax_agrees"] for r in results["em"]) else "DOES NOT AGREE"}.

{rows_of(("", ""), [[k, v] for k, v in about.items()])}
## One EM iteration, ns a frame

{em_table(results["em"])}
hmmlearn in scaling mode, its faster one; dynamax with E- and M-step in one compiled function; pomegranate's E-step only, in
float32, the only one it holds throughout. All others are in float64 where float32 is not said. Everybody on one core, except
where two threads are named. The floor is the arithmetic that cannot be avoided, at the speed of numpy's matrix product on the
same core in the same minute. Peak memory over the data, 10⁶ frames: {memory():.1f} MB.

![One EM iteration](benchmarks.png)

## Explicit durations: one E-step, and one tick of the filter

{durations_table(results["hsmm"])}
L is how many frames a state may last. No peer: hmmlearn, dynamax, pomegranate and gmr have none.

## One tick on line from Python, median / 99.9 % in µs

{tick_table(results["online"])}
The filter of eq. (4) and the regression of eq. (5), two calls. dynamax has no on-line filter: this is the same tick in JAX,
compiled. gmr's `predict` has no filter, so it does less.

## Roll-outs, 1,024 at once, D 7, K 10, million steps a second

dynamax has no roll-outs: this is the same recursion in JAX, a scan under a vmap, with the factors prepared as ours are.

{rows_of(tuple(speeds), [[f"{v:.2f} ({v / speeds['comanip']:.2f} ×)" for v in speeds.values()]])}
## What a person waits for, s

{rows_of(("", "s"), [[k, f"{v:.2f}"] for k, v in results["startup"].items()])}"""
    docs = HERE.parent / "docs"
    (docs / "benchmarks.md").write_text(text, encoding="utf-8")
    draw(results, docs / "benchmarks.png")
    print(text)


if __name__ == "__main__":
    main()
