"""What the baselines came to, into the docs: python benchmarks/policies/tell.py OUT

From OUT/results (files of `comanip trial --json`), OUT/latency.csv and the curves of OUT come docs/gym-table.md, which is what
`comanip board OUT/results` prints, the part of docs/gym.md between its two marks, and the figures. No number is typed.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from figures import cloned_curves, ppo_curves, success_by_lessons

from comanip.trials.board import Row, gathered
from comanip.trials.cases import ROLES

DOCS = Path(__file__).parent.parent.parent / "docs"
BEGIN, END = "<!-- told by benchmarks/policies/tell.py -->", "<!-- until here -->"
KINDS = ("mlp", "gru", "act")
BESIDE = ("default", "paper", "lqt", "mass-damper", "minimum-jerk")
HEAD = """# Carry-Gym: every law and policy, every role and task

What `comanip board` prints of the results of `python benchmarks/policies/everything.py`, written here by its last step,
`tell.py`: [gym.md](gym.md) says how a score is made. In brackets are 95 % intervals; a dash says why there is no number.

"""


def parts_of(law: str) -> tuple[str, int] | None:
    """("mlp", 50) of "mlp_50.py 1f2e..."; None for what is no cloned network."""
    kind, _, lessons = law.split(".py")[0].partition("_")
    return (kind, int(lessons)) if kind in KINDS and lessons.isdigit() else None


def short(law: str) -> str:
    """A policy's name without the hash of its file."""
    return law.split(".py")[0]


def latencies(file: Path) -> dict[str, str]:
    """Law -> median microseconds a tick, as text."""
    if not file.is_file():
        return {}
    with file.open() as lines:
        return {short(Path(row["law"]).name): f"{float(row['median_us']):.0f}" for row in csv.DictReader(lines)}


def by_lessons(rows: Iterable[Row]) -> dict[tuple[str, str], dict[str, dict[int, tuple[float, float, float]]]]:
    """(task, role) -> kind -> lessons -> success and its interval."""
    found: dict[tuple[str, str], dict[str, dict[int, tuple[float, float, float]]]] = {}
    for row in sorted(rows, key=lambda row: (row.task, ROLES.index(row.role))):
        if (known := parts_of(row.law)) is not None:
            kind, lessons = known
            found.setdefault((row.task, row.role), {}).setdefault(kind, {})[lessons] = (row.score, *row.interval)
    ordered = {at: {kind: dict(sorted(some[kind].items())) for kind in KINDS if kind in some} for at, some in found.items()}
    return dict(sorted(ordered.items(), key=lambda one: (one[0][0] != "lift", one[0][0], ROLES.index(one[0][1]))))


def heights(rows: Iterable[Row]) -> dict[tuple[str, str], dict[str, float]]:
    """(task, role) -> law -> success, of those that stand beside the networks."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row.law in BESIDE or short(row.law) == "ppo":
            found.setdefault((row.task, row.role), {})[short(row.law)] = row.score
    return found


def table(rows: Iterable[Row], ticks: Mapping[str, str], task: str, role: str) -> str:
    """All of a task and role, the best first."""
    lines = ["| law | success | 95 % | effort N²s | time s | peak N | a tick µs |", "| --- | --- | --- | --- | --- | --- | --- |"]
    some = [row for row in rows if (row.task, row.role) == (task, role)]
    for row in sorted(some, key=lambda row: (-row.score, row.effort_n2s or 0.0)):
        low, high = row.interval
        numbers = [f"{value:.3g}" if value is not None else "-" for value in (row.effort_n2s, row.time_s, row.peak_n)]
        name = short(row.law)
        tick = ticks.get(name) or ticks.get(f"{name.split('_')[0]}_500", "-")  # of a kind all take the same time
        lines.append(f"| {name} | {100 * row.score:.0f} % | {100 * low:.0f}-{100 * high:.0f} | {' | '.join(numbers)} | {tick} |")
    return "\n".join(lines)


def told(rows: list[Row], ticks: Mapping[str, str]) -> str:
    """The part of docs/gym.md."""
    roles = [role for role in ROLES if any((row.task, row.role) == ("lift", role) for row in rows)]
    who = {"leader": "robot as leader", "follower": "robot as follower", "auto": "robot told nothing"}
    several = {row.steady[1] for row in rows}
    said = [f"With {min(several)} to {max(several)} partners who behave a row, of a seed that nobody was trained with."]
    for role in roles:
        said.append(f"**Lift, {who[role]}**")
        said.append(table(rows, ticks, "lift", role))
    return "\n\n".join(said)


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("out", type=Path)
    words.add_argument("--docs", type=Path, default=DOCS)
    asked = words.parse_args()
    out, docs = asked.out, asked.docs
    rows, ticks = gathered(out / "results"), latencies(out / "latency.csv")
    what = [sys.executable, "-m", "comanip", "board", str(out / "results")]
    board = subprocess.run(what, stdout=subprocess.PIPE, text=True, check=True).stdout
    (docs / "gym-table.md").write_text(HEAD + board)
    page = (docs / "gym.md").read_text()
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        raise SystemExit(f"{docs / 'gym.md'} lacks the marks {BEGIN} and {END}")
    (docs / "gym.md").write_text(f"{before}{BEGIN}\n\n{told(rows, ticks)}\n\n{END}{after}")
    success_by_lessons(by_lessons(rows), heights(rows), docs / "gym_lessons.png")
    if files := sorted(out.glob("ppo_*.csv"), key=lambda file: ("lift" not in file.name, file.name)):
        ppo_curves(files, docs / "gym_ppo.png")
    cloned_curves(out, docs / "gym_cloned.png")
    print(f"{docs / 'gym-table.md'}, {docs / 'gym.md'}, {docs}/gym_lessons.png, gym_ppo.png, gym_cloned.png")


if __name__ == "__main__":
    main()
