"""Fig. 3: a handwriting-like motion as a dynamical system: velocity term alone, position term alone, both.

Claims of the paper: the velocity term follows the learned motion but strays from a new start; the position term comes to
the taught path and does not go along it; both together do what neither does. Refuted by a run that does not end where the
lessons end, by a velocity term that needs no help, or by a position term that goes along the path.

To the letter (weights from all of xi, eq. (9)) the law locks itself into one state or runs away; the picture shows it beside the
reading.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.experiments import planar
from comanip.experiments.readings import LETTER, READING, script
from comanip.interfaces import Array
from comanip.learned.learn import learn
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import Demonstration
from comanip.skills.paper import PaperLaw

PATH = planar.curve([(0.16, 0.26), (0.06, 0.30), (0.00, 0.22), (0.08, 0.15), (0.15, 0.08), (0.08, 0.0), (-0.02, 0.03)])
SIZE_M = 0.30  # height of the letter
SPREAD_M = 0.006
LESSONS, STATES = 12, 8
STARTS = ((0.20, 0.20), (0.10, 0.36), (-0.06, 0.18), (0.22, 0.30))  # all outside of what was shown, and on its outside
STRETCH = slice(50, 150)  # [frames] 0.5 s to 1.5 s: long enough to have come back, short enough to be still in motion


class Numbers(NamedTuple):
    lessons: list[Demonstration]
    skill: LearnedSkill
    velocity_alone: list[Array]
    position_alone: list[Array]
    both: list[Array]
    letter: list[Array]
    law: PaperLaw


@lru_cache(maxsize=2)
def _taught(seed: int) -> tuple[list[Demonstration], LearnedSkill]:
    shown = planar.lessons(PATH, LESSONS, SPREAD_M, np.random.default_rng([seed, 3]))
    return shown, learn(shown, n_states=STATES, law="paper", with_force=False)


def numbers(seed: int, *, law: PaperLaw = READING) -> Numbers:
    shown, skill = _taught(seed)
    box = planar.workspace(PATH)

    def runs(chosen: PaperLaw) -> list[Array]:
        return [planar.reproduce(skill, start, chosen, box).position for start in STARTS]

    alone = [planar.follow_position_term(skill, start, law) for start in STARTS]
    return Numbers(shown, skill, runs(replace(law, attraction_per_s=0.0)), alone, runs(law), runs(LETTER), law)


def claims(found: Numbers) -> list[Claim]:
    end = np.mean([lesson.position[-1] for lesson in found.lessons], axis=0)

    def misses(runs: list[Array]) -> float:
        return float(max(np.linalg.norm(x[-1] - end) for x in runs))

    def strays(runs: list[Array]) -> float:
        return float(max(planar.distance(x[STRETCH], PATH).mean() for x in runs))

    first, last = (np.mean([planar.distance(x[[n]], PATH)[0] for x in found.position_alone]) for n in (0, -1))
    along = [abs(float(planar.progress(x[[100, -1]], PATH) @ [-1.0, 1.0])) for x in found.position_alone]
    return [
        at_most(
            "both terms: farthest end from the lessons' end, of 4 new starts",
            misses(found.both),
            0.1 * SIZE_M,
            unit="m",
            refuted_by="an end more than a tenth of the letter away",
        ),
        at_most(
            "both terms: mean distance to the path from 0.5 to 1.5 s, worst of 4",
            strays(found.both),
            0.1 * SIZE_M,
            unit="m",
            refuted_by="runs that stay off the path by more than a tenth of the letter",
        ),
        at_least(
            "velocity term alone strays: its worst over that of both",
            strays(found.velocity_alone) / strays(found.both),
            2.0,
            refuted_by="a velocity term that stays as close without help",
        ),
        at_most(
            "position term alone comes to the path: mean distance at rest over that at the start",
            float(last / first),
            1.0 / 3.0,
            refuted_by="a hand that stays more than a third as far away",
        ),
        at_most(
            "and does not go along it: largest share of the path covered after 1 s",
            float(max(along)),
            0.1,
            refuted_by="motion along the path without the velocity term",
        ),
        at_least(
            "to the letter, eqs. (4) and (9) do not get there: farthest end",
            misses(found.letter),
            0.1 * SIZE_M,
            unit="m",
            refuted_by="a literal law that ends where the lessons end: then our departure is not needed",
        ),
    ]


def draw(found: Numbers) -> Any:
    caption = (
        f"Fig. 3. {len(found.lessons)} lessons (grey) of a handwriting-like motion, 8 states, position and velocity only. "
        "Ellipses: 2 standard deviations. Points: new starts; bold: runs of 3 s from there. Arrows: where the terms of eq."
        " (8) point from rest, weights from position. To the letter: weights from position and velocity, gain of eq. (9)."
        " Refuted if 'both' misses the end, if 'velocity' needs no help, or if 'position' moves along the path."
    )
    with figures.taste():
        figure = figures.blank(7.4, 5.3, caption=caption)
        grid = figure.subplots(2, 3)
        _model(grid[0, 0], found, "position")
        _model(grid[1, 0], found, "velocity")
        _field(grid[0, 1], found, "velocity", found.velocity_alone, "Velocity term alone")
        _field(grid[1, 1], found, "position", found.position_alone, "Position term alone")
        _field(grid[0, 2], found, "both", found.both, "Both, our reading")
        _field(grid[1, 2], found, "both", found.letter, "Both, to the letter", arrows=False)
    return figure


def _model(ax: Any, found: Numbers, group: str) -> None:
    for lesson in found.lessons:
        ax.plot(*lesson[group].T, color=figures.ASH, linewidth=0.8)
    figures.ellipses(ax, found.skill.model, f"{group}.x", f"{group}.y", color=figures.INK)
    ax.set_aspect("equal", adjustable="datalim")
    unit, sign = ("m", "") if group == "position" else ("m/s", "d")
    figures.label(ax, f"{sign}x [{unit}]", f"{sign}y [{unit}]", f"States in {group}")


def _field(ax: Any, found: Numbers, term: str, runs: list[Array], title: str, *, arrows: bool = True) -> None:
    (x0, x1), (y0, y1) = (-0.13, 0.30), (-0.06, 0.40)
    for lesson in found.lessons:
        ax.plot(*lesson.position.T, color=figures.ASH, linewidth=0.7, zorder=1)
    if arrows:
        x, y = np.meshgrid(np.linspace(x0, x1, 20)[1:-1], np.linspace(y0, y1, 21)[1:-1])
        asked = planar.field(found.skill, np.column_stack([x.ravel(), y.ravel()]), found.law)
        v = {
            "velocity": asked.velocity_term,
            "position": asked.position_term,
            "both": asked.velocity_term + asked.position_term,
        }[term]
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        u, w = (v / np.maximum(speed, 0.05)).T  # direction; shorter only below 5 cm/s
        ax.quiver(x, y, u, w, color="#9fc9c3", pivot="mid", scale=26.0, width=0.0045, headwidth=4.5, zorder=0)
    for run, dash in zip(runs, figures.DASHES, strict=False):
        ax.plot(*run.T, color=figures.CLAY, linewidth=2.0, linestyle=dash, zorder=3)
        ax.plot(*run[0], "o", color=figures.INK, markersize=4, zorder=4)
    end = found.lessons[0].position[-1]
    ax.plot(*end, "s", color=figures.INK, markersize=4, markerfacecolor="white", zorder=4)
    ax.set_xlim(x0, x1)
    ax.set_ylim(y0, y1)
    ax.set_aspect("equal")
    ax.grid(False)
    figures.label(ax, "x [m]", "y [m]", title)


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    figures.save(draw(found), out / "figure_3.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
