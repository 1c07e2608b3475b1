"""Lessons, cloned networks, PPO, trials of all of them beside our laws, and the table: python everything.py OUT

Each step is a command that is printed before it runs; one whose product is in OUT is not run again. At the end docs/gym-table.md
(what `comanip board OUT/results` prints), the table of docs/gym.md and the figures are written by benchmarks/policies/tell.py.
Needs torch, stable-baselines3 and matplotlib; about an hour and a half of one core.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
COMANIP = (sys.executable, "-m", "comanip")
KINDS, LESSONS = ("mlp", "gru", "act"), ("5", "50", "500")
UNTOLD = ("default", "lqt", "without-lessons", "mass-damper", "variable-damping", "homotopy", "rigid")
TOLD = ("paper", "minimum-jerk")
ROLES = ("leader", "follower")
EVERY = ("--role", "leader", "--role", "follower", "--role", "auto")


def run(what: list[str], product: Path, *, printed: bool = False) -> None:
    """A command, unless its product is there; `printed`: what it prints is the product."""
    if product.exists():
        return
    print("$", *what, *([">", str(product)] if printed else []), flush=True)
    product.parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(what, stdout=subprocess.PIPE if printed else None, check=False)
    if done.returncode != 0:
        raise SystemExit(f"ended with {done.returncode}; nothing of it is kept")
    if printed:
        product.write_bytes(done.stdout)


def script(name: str, *words: str) -> list[str]:
    return [sys.executable, str(HERE / name), *words]


def trained(out: Path, tasks: list[str], most: int, seconds: str, minutes: str) -> None:
    """All networks."""
    for task in tasks:
        for role in ROLES:
            where = ("--task", task, "--role", role)
            run(
                script("lessons.py", str(out / "lessons"), *where, "--lessons", str(most)), out / "lessons" / f"{task}_{role}.npz"
            )
            for kind in KINDS:
                for lessons in LESSONS:
                    if int(lessons) > most:
                        continue
                    how = ("--kind", kind, "--lessons", lessons, "--seconds", seconds, *where)
                    product = out / f"{kind}_{lessons}_{task}_{role}.pt"
                    run(script("train_bc.py", str(out), "--lessons-in", str(out / "lessons"), *how), product)
            run(script("train_ppo.py", str(out), *where, "--minutes", minutes), out / f"ppo_{task}_{role}.png")


def tried(out: Path, tasks: list[str], partners: str, seed: str, workers: str) -> None:
    """All trials of laws and networks; a network is tried where it was trained in both roles."""
    how = ["--partners", partners, "--seed", seed, "--workers", workers, "--json"]
    results = out / "results"
    for task in tasks:
        laws = [word for law in UNTOLD for word in ("--law", law)]
        run([*COMANIP, "trial", "--task", task, *EVERY, *laws, *how], results / f"laws_{task}.json", printed=True)
        laws = [word for law in TOLD for word in ("--law", law)]
        run([*COMANIP, "trial", "--task", task, *EVERY[:4], *laws, *how], results / f"told_{task}.json", printed=True)
    for name in [f"{kind}_{lessons}" for kind in KINDS for lessons in LESSONS] + ["ppo"]:
        for task in tasks:
            if all((out / f"{name}_{task}_{role}.pt").is_file() for role in ROLES):
                what = [*COMANIP, "trial", "--task", task, *EVERY, "--law-from", str(out / f"{name}.py"), *how]
                run(what, results / f"{name}_{task}.json", printed=True)


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("out", type=Path)
    words.add_argument("--task", nargs="+", default=["lift", "slide", "round-the-corner"])
    words.add_argument(
        "--lessons", type=int, default=500, help="recorded of each task and role; more than that are not learned from"
    )
    words.add_argument("--seconds", default="4", help="of CPU time for each cloned network")
    words.add_argument("--minutes", default="3", help="of CPU time for each that PPO trains")
    words.add_argument("--partners", default="50", help="in each task and role")
    words.add_argument("--seed", default="190001", help="of the partners")
    words.add_argument("--workers", default="0")
    words.add_argument("--steps", nargs="+", choices=("train", "try", "tell"), default=["train", "try", "tell"])
    asked = words.parse_args()
    if "train" in asked.steps:
        trained(asked.out, asked.task, asked.lessons, asked.seconds, asked.minutes)
    if "try" in asked.steps:
        tried(asked.out, asked.task, asked.partners, asked.seed, asked.workers)
    if "tell" in asked.steps:
        told(asked.out)


def told(out: Path) -> None:
    """Latency of a tick, figures and tables."""
    policies = [str(out / f"{kind}_500.py") for kind in KINDS] + [str(out / "ppo.py")]
    run(script("latency.py", "--law", *UNTOLD, *TOLD, "--law-from", *policies), out / "latency.csv", printed=True)
    run(script("tell.py", str(out)), out / "never")


if __name__ == "__main__":
    main()
