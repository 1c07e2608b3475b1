"""Runs every benchmark and writes docs/benchmarks.md, docs/benchmarks.png and docs/scaling.png: `make bench`.

python benchmarks/report.py [parts]    only these again, beside what build/benchmarks.json kept of the others
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
KEPT = HERE.parent / "build" / "benchmarks.json"
PARTS = {
    "em": "em.measure()",
    "memory": "em.memory_over_data()",
    "scaling": "scaling.measure()",
    "scoring": "scoring.measure()",
    "interfaces": "interfaces.measure()",
    "hsmm": "hsmm.measure()",
    "online": "online.measure()",
    "tick": "tick.summary()",
    "rollouts": "rollouts.measure()",
    "closed_loop": "closed_loop.measure()",
    "streaming": "streaming.measure(10)",
    "startup": "startup.measure()",
}
PEERS = ("comanip", "comanip, 2 threads", "comanip, float32", "comanip, numpy twin", "comanip.GaussianHMM", "hmmlearn",
         "JAX, hand-written", "dynamax", "dynamax, float32", "pomegranate", "pbdlib", "gmr")  # fmt: skip
GREYS = {"comanip": "0.0", "comanip, 2 threads": "0.2", "comanip, float32": "0.35", "comanip, numpy twin": "0.5",
         "comanip.GaussianHMM": "0.55", "hmmlearn": "0.65", "dynamax": "0.75", "dynamax, float32": "0.8", "pomegranate": "0.85",
         "pbdlib": "0.95"}  # fmt: skip


def measured(part: str) -> Any:
    """Each part in a process of its own, so that no peer's threads or memory stay in the way."""
    print(f"{part} ...", file=sys.stderr)
    module = PARTS[part].partition(".")[0]
    code = f"import json, {module}; print('@' + json.dumps({PARTS[part]}))"
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(HERE)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("@"))[1:])


def rows_of(columns: tuple[str, ...], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def ns_cell(row: dict[str, Any], peer: str) -> str:
    if peer not in row["ns"]:
        return "–"
    return f"{row['ns'][peer]:,.0f} ({row['ns'][peer] / row['ns']['comanip']:.1f} ×)"


def em_table(rows: list[dict[str, Any]], first: str = "sequences × frames", key: str = "size") -> str:
    peers = [p for p in PEERS if any(p in r["ns"] for r in rows)]
    body = [
        [f"{r[key]:,}" if key == "value" else r[key], *[ns_cell(r, p) for p in peers],
         f"{r['floor_ns']:.0f} ({r['ns']['comanip'] / r['floor_ns']:.2f} ×)"]
        for r in rows
    ]  # fmt: skip
    return rows_of((first, *peers, "dgemm floor"), body)


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


def envelope_table(rows: list[dict[str, Any]]) -> str:
    columns = ("role", "ticks", "median", "99 %", "99.9 %", "longest", "numpy twin, median")
    body = [
        [r["role"], f"{r['ticks']:,}", *[f"{r[q]:.2f}" for q in ("median", "p99", "p999")], f"{r['longest']:,.0f}",
         f"{r['twin']:.0f} ({r['twin'] / r['median']:.1f} ×)"]
        for r in rows
    ]  # fmt: skip
    return rows_of(columns, body)


def rates_table(rates: dict[str, float]) -> str:
    return rows_of(("", "million steps a second"), [[p, f"{v:.2f} ({v / rates['comanip']:.2f} ×)"] for p, v in rates.items()])


def loop_table(found: dict[str, Any]) -> str:
    ours = found["us"]["comanip"]
    body = [[n, f"{us:.1f} ({us / ours:.1f} ×)", f"{found['partners_per_s'][n]:.0f}"] for n, us in found["us"].items()]
    return rows_of(("", "µs a tick", "partners a second"), body)


def streaming_table(found: dict[str, float]) -> str:
    ours, cells = found["ns_per_frame"], {"comanip, from Parquet": found["ns_per_frame"]}
    cells |= {"comanip, in memory": found["in_memory_ns_per_frame"]}
    if "hmmlearn_in_memory_ns_per_frame" in found:
        cells["hmmlearn, in memory"] = found["hmmlearn_in_memory_ns_per_frame"]
    return rows_of(tuple(cells), [[f"{v:,.0f} ({v / ours:.1f} ×)" for v in cells.values()]])


def on_pbdlib(results: dict[str, Any]) -> str:
    """What was used of pbdlib and how far it agrees, or how to have it in the tables."""
    ticks = [r["pbdlib_agrees"] for r in results["online"] if "pbdlib_agrees" in r]
    if not ticks:
        return "pbdlib is on no package index: `make bench PBDLIB=path` puts a checkout of it into the tables; this run had none."
    whole = 100 * results["rollouts"]["pbdlib_agrees"]
    after = "as before" if all(r["pbdlib_comes_back"] for r in results["online"]) else "NaN from then on"
    return f"""pbdlib is on no package index; this run had a checkout of it (`make bench PBDLIB=path`). EM: one step of `HMM.em`;
its likelihood agrees with ours to 1e-8, its transitions do not: they are divided by the occupancy of the state that is entered.
The tick: `online_forward_message` and `GMM.condition` with those weights, for `HMM.condition` starts anew with each call; it
gives a covariance, too. It answers as comanip does to 1e-4 in {100 * min(ticks):.1f} % of the ticks, and after one frame that no
state explains, {after}. The roll-outs: `obs_likelihood` and `GMM.condition`, all of them at once in a loop over time;
{whole:.1f} % stay within 1e-6 of ours to their end."""


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


def scoring_table(rows: list[dict[str, Any]]) -> str:
    peers = [p for p in PEERS if any(p in r["ns"] for r in rows)]
    body = [[r["kind"], r["size"], *[ns_cell(r, p) for p in peers]] for r in rows]
    return rows_of(("", "sequences × frames", *peers), body)


def scaling_tables(found: dict[str, list[dict[str, Any]]]) -> str:
    return "\n".join(em_table(rows, varied, "value") for varied, rows in found.items())


def interfaces_table(rows: list[dict[str, Any]]) -> str:
    def cell(seconds: float, first: float, score: float | None) -> str:
        found = "" if score is None else f" [{score:.2f}]"
        return f"{seconds:.4f} ({seconds / first:.1f} ×){found}"

    return rows_of(
        ("", "comanip", "the peer", ""),
        [[r["work"], *(cell(t, r["s"][0], q) for t, q in zip(r["s"], r["score"], strict=True)), r["peer"]] for r in rows],
    )


def page(results: dict[str, Any]) -> str:
    """docs/benchmarks.md as Markdown."""
    return f"""# Benchmarks

Made by `make bench`; nothing here is typed by hand. The same data, the same start and the same work for everyone, taken in
turns; medians. Absolute times move with the machine (and with its neighbours); the ratios in brackets, to comanip with one
thread, move less. Likelihoods of hmmlearn and of the numpy twin agree to 1e-8 with ours, or the run stops; that of dynamax
{"agrees to 1e-4" if all(r["dynamax_agrees"] for r in results["em"]) else "DOES NOT AGREE"}.

{rows_of(("", ""), [[k, v] for k, v in results["about"].items()])}
{on_pbdlib(results)}

## One EM iteration, ns a frame

{em_table(results["em"])}
comanip.GaussianHMM is ours behind hmmlearn's interface, asked in the same words as hmmlearn; both with `fit` in scaling mode,
hmmlearn's faster one; dynamax with E- and M-step in one compiled function; pomegranate's E-step only, in
float32, the only one it holds throughout. All others are in float64 where float32 is not said. Everybody on one core, except
where two threads are named. The floor is the arithmetic that cannot be avoided, at the speed of numpy's matrix product on the
same core in the same minute. Peak memory over the data, 10⁶ frames: {results["memory"]:.1f} MB.

![One EM iteration](benchmarks.png)

## One EM iteration as the problem grows, ns a frame

{scaling_tables(results["scaling"])}
One thing varies, the others stay at 50,000 frames in sequences of 500, D 7, K 10. 10⁷ frames are the same 10⁶ ten times over. A
dash: a call would have taken more than 8 s, or it is not measured there. Threads share 10⁶ frames; one thread runs on each core
in turn, and its row is their mean speed, for a machine that lends its cores does not lend them equally; the floor is that of as
many threads that multiply matrices at once.

![Scaling](scaling.png)

What would refute that the cost follows the arithmetic: a line of comanip that rises with N, or that leaves the dashed one as D or
K grows. Threads have a scale of their own.

## A learned model at work, ns a frame

{scoring_table(results["scoring"])}
Everybody in float64 on one core, and all find the same to 1e-8, or the run stops. All take all
sequences at once.

## The peers' own interfaces, s

{interfaces_table(results["interfaces"])}
The same words to our class and to theirs, with all their defaults where nothing is said: `GaussianHMM(K, "full", random_state=0)`
with its ten iterations, `GMM(K, random_state=0)` with 20. In brackets the log-likelihood a frame of what was found. hmmlearn and
ours start from k-means, which ours does with 10,000 frames at most; gmr's start is drawn alike by both.

## Explicit durations: one E-step, and one tick of the filter

{durations_table(results["hsmm"])}
L is how many frames a state may last. No peer: hmmlearn, dynamax, pomegranate and gmr have none, and pbdlib counts durations on
Viterbi's path after the EM of a plain chain.

## One tick on line from Python, median / 99.9 % in µs

{tick_table(results["online"])}
The filter of eq. (4) and the regression of eq. (5), two calls. dynamax has no on-line filter; its column is made of its own
parts, the emission distribution and the two steps of `hmm_filter`, compiled into one function, with the regression prepared as
ours is. "JAX, hand-written" is our tick written in JAX. Both answer as comanip does to 1e-4, or the run stops. gmr's `predict`
has no filter, so it does less.

## The whole tick of a skill within its envelope, µs

{envelope_table(results["tick"])}
Everything that a robot waits for, called from Python; what other processes of the machine took meanwhile is in it.
`python benchmarks/tick.py` prints the histograms.

## Roll-outs, 1,024 at once, D 7, K 10, million steps a second

{rates_table(results["rollouts"]["rates"])}
dynamax has no roll-outs: these are its emission distribution and the two steps of its filter in a scan under a vmap, compiled.
"JAX, hand-written" is our recursion in JAX, the factors prepared as ours are. After ten steps both are where ours is to 1e-6
(1e-4 in float32), or the run stops. dynamax has no gate; here it moves no roll-out by more than
{results["rollouts"]["gate_m"]:.0e} m.

## Roll-outs on the beam with partners that answer, 20 of them one after another

{loop_table(results["closed_loop"])}
The whole loop of `comanip trial`: skill within its envelope, force estimate, beam and person in sub-steps of 1 ms, everything
recorded. One core; `--workers` shares partners among processes. All go the same way to 1e-8 m, or the run stops.

## EM over a stream, {results["streaming"]["frames"]:,.0f} frames in Parquet, ns a frame

{streaming_table(results["streaming"])}
D 7, K 10, {results["streaming"]["megabytes"]:.0f} MB in files of 100,000 frames, one process. Its memory had its peak at
{results["streaming"]["peak_mb"]:.0f} MB, libraries included. `python benchmarks/streaming.py` takes more files.

## What a person waits for, s

{rows_of(("", "s"), [[k, f"{v:.2f}"] for k, v in results["startup"].items()])}"""


def gathered(parts: list[str]) -> dict[str, Any]:
    """These parts measured now, all when none is named; the others as kept, where machine and packages are the same."""
    from machine import described

    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    results: dict[str, Any] = {"about": described()}
    if parts and KEPT.exists():
        kept = json.loads(KEPT.read_text(encoding="utf-8"))
        if kept["about"] == results["about"]:
            results = kept
    KEPT.parent.mkdir(exist_ok=True)
    for part in parts or PARTS:
        results[part] = measured(part)
        KEPT.write_text(json.dumps(results), encoding="utf-8")
    missing = [part for part in PARTS if part not in results]
    if missing:
        raise SystemExit(f"not measured yet on this machine with these packages: {', '.join(missing)}; name them, too")
    return results


def main(parts: list[str], docs: Path = HERE.parent / "docs") -> None:
    import scaling

    results = gathered(parts)
    text = page(results)
    (docs / "benchmarks.md").write_text(text, encoding="utf-8")
    draw(results, docs / "benchmarks.png")
    scaling.draw(results["scaling"], docs / "scaling.png")
    print(text)


if __name__ == "__main__":
    main(sys.argv[1:])
