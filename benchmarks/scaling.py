"""One EM iteration as the problem grows: frames, channels, states and threads, one at a time; ns a frame beside the floor.

python benchmarks/scaling.py [picture.png]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import em
from machine import (
    CORES,
    Problem,
    alternated,
    dgemm_gflops,
    dgemm_gflops_of,
    flops_per_frame,
    median,
    on_all_cores,
    on_cores,
    problem,
    stay_on_one_core,
)

LENGTH, N, D, K = 500, 50_000, 7, 10  # what does not vary
VARIED: dict[str, tuple[int, ...]] = {
    "frames": (1_000, 10_000, 100_000, 1_000_000, 10_000_000),
    "channels": (1, 3, 7, 14, 30, 60),
    "states": (1, 2, 5, 10, 20, 40, 64),
}
ALONE = 1_000_000  # frames beyond this are for comanip alone: the others would want more memory or patience
LONGEST_S = 8.0  # a call that would take longer, by the point before it, is not made
BUDGET_S = 2.0  # of repeated calls a point and peer
PEERS: dict[str, Callable[[Problem], Callable[[], float]]] = {
    "comanip": em.comanip,
    "comanip, 2 threads": lambda p: on_all_cores(em.comanip(p, 2)),
    "hmmlearn": em.hmmlearn,
    "dynamax": em.dynamax,
}
STYLES = {"comanip": ("0.0", "o", "-"), "comanip, 2 threads": ("0.0", "o", ":"), "hmmlearn": ("0.5", "s", "-"),
          "dynamax": ("0.5", "^", "-.")}  # fmt: skip


def sized(n: int, d: int, k: int) -> Problem:
    """Sequences of 500 frames; beyond a million the same ones again, which takes no second copy to make."""
    p = problem([LENGTH] * (min(n, ALONE) // LENGTH), d, k)
    again = n // len(p.frames)
    return p if again == 1 else p._replace(frames=np.tile(p.frames, (again, 1)), lengths=np.tile(p.lengths, again))


def point(p: Problem, makers: dict[str, Any], last: dict[str, float]) -> dict[str, Any]:
    """ns a frame of each peer and of the floor. `last` is the ns a flop of the point before, and becomes that of this one."""
    flops = flops_per_frame(p.frames.shape[1], len(p.initial))
    work, likelihood, gflops = {}, {}, [dgemm_gflops()]
    for peer, make in makers.items():
        if last.get(peer, 0.0) * flops * len(p.frames) * 1e-9 > LONGEST_S:
            continue
        try:
            work[peer] = make(p)
        except ImportError:
            print(f"{peer} is absent", file=sys.stderr)
            continue
        likelihood[peer] = work[peer]()
        rtol = 1e-4 if peer == "dynamax" else 1e-8
        if not np.isclose(likelihood[peer], likelihood["comanip"], rtol=rtol):
            raise AssertionError(f"{peer} computes something else: {likelihood[peer]} and {likelihood['comanip']}")
    ns = {peer: median(t) / len(p.frames) * 1e9 for peer, t in alternated(work, 7, BUDGET_S).items()}
    last.update({peer: value / flops for peer, value in ns.items()})
    gflops.append(dgemm_gflops())
    return {"ns": ns, "floor_ns": flops / float(np.median(gflops))}


def measure() -> dict[str, list[dict[str, Any]]]:
    """Rows of what is varied: its value, ns a frame of each peer, and the floor."""
    stay_on_one_core()
    found: dict[str, list[dict[str, Any]]] = {}
    for varied, values in VARIED.items():
        last: dict[str, float] = {}
        found[varied] = []
        for value in values:
            p = sized(*(value if varied == name else usual for name, usual in (("frames", N), ("channels", D), ("states", K))))
            makers = PEERS if len(p.frames) <= ALONE else {n: m for n, m in PEERS.items() if n.startswith("comanip")}
            row = {"value": value} | point(p, makers, last)
            found[varied].append(row)
            print(varied, value, {n: round(v, 1) for n, v in row["ns"].items()}, f"floor {row['floor_ns']:.1f}", file=sys.stderr)
    found["threads"] = by_threads()
    return found


def by_threads() -> list[dict[str, Any]]:
    """The same rows for all numbers of threads, taken in turns over a million frames; the floor is that of as many dgemms.

    One thread runs on each core in turn, and its row is their mean speed: cores that are lent are not equally quick.
    """
    p, numbers = sized(ALONE, D, K), range(2, len(CORES) + 1)
    work = {f"core {c}": on_cores([c], em.comanip(p)) for c in CORES}
    times = alternated(work | {str(n): on_all_cores(em.comanip(p, n)) for n in numbers}, 15)
    seconds = {1: len(CORES) / sum(1.0 / median(times[core]) for core in work)} | {n: median(times[str(n)]) for n in numbers}
    rows = [
        {"value": n, "ns": {"comanip": s / len(p.frames) * 1e9}, "floor_ns": flops_per_frame(D, K) / dgemm_gflops_of(n)}
        for n, s in seconds.items()
    ]
    print({core: round(median(times[core]) / len(p.frames) * 1e9, 1) for core in work}, file=sys.stderr)
    print("threads", rows, file=sys.stderr)
    return rows


def draw(found: dict[str, list[dict[str, Any]]], path: Any) -> None:
    """Four panels; the first three have one scale for the time, so that heights compare."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullLocator, StrMethodFormatter

    usual = {"frames": f"D {D}, K {K}", "channels": f"{N:,} frames, K {K}", "states": f"{N:,} frames, D {D}",
             "threads": f"{ALONE:,} frames, D {D}, K {K}"}  # fmt: skip
    labels = {"frames": "frames N", "channels": "channels D", "states": "states K", "threads": "threads"}
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.4), constrained_layout=True)
    for axis, (varied, rows) in zip(axes.flat, found.items(), strict=True):
        for peer, (grey, marker, line) in STYLES.items():
            at = [(r["value"], r["ns"][peer]) for r in rows if peer in r["ns"]]
            if at:
                axis.plot(*zip(*at, strict=True), color=grey, marker=marker, linestyle=line, label=peer, markersize=5,
                          markerfacecolor="1.0" if "threads" in peer else grey)  # fmt: skip
        axis.plot([r["value"] for r in rows], [r["floor_ns"] for r in rows], color="0.0", linestyle="--", label="dgemm floor",
                  linewidth=1.0)  # fmt: skip
        axis.set(xscale="log", yscale="log", xlabel=labels[varied], ylabel="one EM iteration [ns / frame]")
        axis.set_title(usual[varied], fontsize=9)
        axis.grid(color="0.9", linewidth=0.6)
        if varied != "frames":
            axis.set_xticks([r["value"] for r in rows], [str(r["value"]) for r in rows])
            axis.xaxis.set_minor_locator(NullLocator())
    compared = axes.flat[:3]
    limits = [axis.get_ylim() for axis in compared]
    for axis in compared:
        axis.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
    for each in (axes[1, 1].yaxis.set_major_formatter, axes[1, 1].yaxis.set_minor_formatter):
        each(StrMethodFormatter("{x:.0f}"))
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=5, frameon=False, fontsize=8)
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    result = measure()
    if len(sys.argv) > 1:
        draw(result, sys.argv[1])
