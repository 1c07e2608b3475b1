"""Figures of the baselines: training curves, and success against the number of lessons."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

LOOKS = {"mlp": ("o", "-", "0.0"), "gru": ("s", "--", "0.35"), "act": ("^", ":", "0.0"), "ppo": ("D", "-.", "0.5")}


def numbers(file: Path) -> dict[str, list[float]]:
    """Columns of a curve's CSV."""
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def ppo_curves(files: Sequence[Path], out: Path) -> None:
    """Success and return against CPU minutes, each beside that of a hand that does nothing."""
    fig, axes = plt.subplots(2, len(files), figsize=(max(4.0, 3.0 * len(files)), 5.0), sharex="col", sharey="row", squeeze=False)
    for (over, under), file in zip(axes.T, files, strict=True):
        curve = numbers(file)
        for ax, name, nothing in ((over, "success", "nothing"), (under, "return", "nothing_return")):
            ax.plot(curve["cpu_min"], curve[name], "k.-", label="PPO, mean action")
            ax.axhline(curve[nothing][0], color="0.5", ls="--", label="does nothing")
            ax.grid(alpha=0.3)
        over.set_title(file.stem.removeprefix("ppo_").replace("_", ", robot as "), fontsize=9)
        over.set_ylim(-0.05, 1.05)
        under.set_xlabel(f"CPU time [min]\n{curve['steps'][-1] / 1e6:.1f} million ticks")
    axes[0, 0].set_ylabel("success with 40 partners")
    axes[1, 0].set_ylabel("mean return")
    axes[0, 0].legend(fontsize=7, loc="lower right")
    _save(fig, out)


def cloned_curves(folder: Path, out: Path) -> None:
    """Held-out error against CPU seconds, by kind; one line a number of lessons, task and role."""
    fig, axes = plt.subplots(1, 3, figsize=(9.0, 3.2), sharey=True)
    shades = {"5": "0.7", "50": "0.4", "500": "0.0"}
    for ax, kind in zip(axes, ("mlp", "gru", "act"), strict=True):
        for file in sorted(folder.glob(f"{kind}_*.csv")):
            lessons, curve = file.stem.split("_")[1], numbers(file)
            ax.plot(curve["cpu_s"], curve["held_out"], color=shades.get(lessons, "k"), lw=0.8)
        ax.set(title=kind, xlabel="CPU time [s]", yscale="log")
        ax.grid(alpha=0.3)
    for lessons, shade in shades.items():
        axes[0].plot([], [], color=shade, label=f"{lessons} lessons")
    axes[0].legend(fontsize=7)
    axes[0].set_ylabel("held-out error,\nshare of the variance")
    _save(fig, out)


def success_by_lessons(
    found: Mapping[tuple[str, str], Mapping[str, Mapping[int, tuple[float, float, float]]]],
    laws: Mapping[tuple[str, str], Mapping[str, float]],
    out: Path,
) -> None:
    """One panel a (task, role): kinds of network {lessons: (success, low, high)}, and laws that stand at one height."""
    tasks, roles = list(dict.fromkeys(task for task, _ in found)), list(dict.fromkeys(role for _, role in found))
    size = (3.2 * len(tasks), 2.3 * len(roles))
    fig, axes = plt.subplots(len(roles), len(tasks), figsize=size, sharex=True, sharey=True, squeeze=False)
    for (task, role), by_kind in found.items():
        ax = axes[roles.index(role), tasks.index(task)]
        _panel(ax, by_kind, laws.get((task, role), {}))
        ax.set_title(f"{task}, robot as {role}" if role != "auto" else f"{task}, robot told nothing", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("lessons")
    for ax in axes[:, 0]:
        ax.set_ylabel("success [%]")
    axes[0, 0].legend(fontsize=6, loc="center left")
    _save(fig, out)


def _panel(ax: Any, by_kind: Mapping[str, Mapping[int, tuple[float, float, float]]], laws: Mapping[str, float]) -> None:
    for n, (kind, points) in enumerate(by_kind.items()):
        marker, line, colour = LOOKS[kind]
        x = [lessons * 1.08 ** (n - 1) for lessons in points]
        y, low, high = ([100.0 * one[k] for one in points.values()] for k in range(3))
        errors = [[a - b for a, b in zip(y, low, strict=True)], [b - a for a, b in zip(y, high, strict=True)]]
        ax.errorbar(x, y, errors, marker=marker, ls=line, color=colour, ms=4, lw=1.0, elinewidth=0.6, label=kind.upper())
    for n, (law, success) in enumerate(sorted(laws.items(), key=lambda one: -one[1])):
        ax.axhline(100.0 * success, color="0.6", lw=0.6)
        ax.text(900, 100.0 * success - 6.0 * n * (len(set(laws.values())) < len(laws)), law, fontsize=5.5, va="center")
    ax.set(xscale="log", xlim=(3.5, 900), ylim=(-5, 108), xticks=[5, 50, 500], xticklabels=["5", "50", "500"])
    ax.grid(alpha=0.25)


def _save(fig: Any, out: Path) -> None:
    fig.tight_layout()
    fig.savefig(out, dpi=110)
    plt.close(fig)
