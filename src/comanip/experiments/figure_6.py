"""Fig. 6: how force and velocity go together, in three parts of the motion, and how badly one constant damping fits.

Claims of the paper: the correlation between force and velocity changes along the motion, so that a constant damping F = D v
would be a poor model of either role, while 5 Gaussians hold it. Refuted by slopes that agree in all thirds, or by a
constant damping that predicts the force of a held-out lesson as well as the regression.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least
from comanip.experiments.figure_5 import ROLES, UNITS
from comanip.experiments.lifts import LESSONS, learned, moving, taught
from comanip.experiments.readings import script
from comanip.interfaces import Array
from comanip.lessons.demonstration import Demonstration
from comanip.models.gmr import regress

PARTS = ("first third", "middle third", "last third")


class Fit(NamedTuple):
    """One held-out lesson."""

    damping: float  # D [N s/m], least squares over the other four lessons, through the origin
    constant: Array  # (T,) D v [N]
    regressed: Array  # (T,) F from position and velocity [N]
    r2_constant: float
    r2_regressed: float


class Numbers(NamedTuple):
    lessons: Mapping[str, Sequence[Demonstration]]
    correlation: Mapping[str, Array]  # role -> (lessons, 3) of F and v in each third
    slope: Mapping[str, Array]  # role -> (lessons, 3) dF/dv of a line with offset [N s/m]
    fits: Mapping[str, Sequence[Fit]]


def numbers(seed: int, *, lessons: Mapping[str, Sequence[Demonstration]] | None = None) -> Numbers:
    lessons = lessons or {role: taught(role, seed)[:LESSONS] for role in ROLES}
    correlation, slope, fits = {}, {}, {}
    for role in ROLES:
        correlation[role] = np.array([[np.corrcoef(v, f)[0, 1] for v, f in _thirds(lesson)] for lesson in lessons[role]])
        slope[role] = np.array([[np.polyfit(v, f, 1)[0] for v, f in _thirds(lesson)] for lesson in lessons[role]])
        fits[role] = [_fit(lessons[role], n) for n in range(len(lessons[role]))]
    return Numbers(lessons, correlation, slope, fits)


def _thirds(lesson: Demonstration) -> list[Array]:
    """(2, n) velocity and force of each third of the motion, rest left out."""
    part = moving(lesson)
    both = np.stack([lesson.velocity[part, 0], lesson.force[part, 0]])
    return np.array_split(both, 3, axis=1)


def _fit(lessons: Sequence[Demonstration], held: int) -> Fit:
    others = [x for n, x in enumerate(lessons) if n != held]
    v = np.concatenate([x.velocity[:, 0] for x in others])
    f = np.concatenate([x.force[:, 0] for x in others])
    damping = float(v @ f / (v @ v))
    lesson = lessons[held]
    model = learned(tuple(others)).model
    constant = damping * lesson.velocity[:, 0]
    inputs = ("position", "velocity")
    regressed = regress(model, inputs, "force", lesson.array(inputs)).mean[:, 0]
    truth = lesson.force[:, 0]
    return Fit(damping, constant, regressed, _r2(constant, truth), _r2(regressed, truth))


def _r2(predicted: Array, truth: Array) -> float:
    return float(1.0 - ((predicted - truth) ** 2).sum() / ((truth - truth.mean()) ** 2).sum())


def claims(found: Numbers) -> list[Claim]:
    r = np.concatenate([found.correlation[role] for role in ROLES])
    slope = np.abs(np.concatenate([found.slope[role] for role in ROLES]))
    made = [
        at_least(
            "the correlation changes along the motion: of ten lessons, those least correlated in the middle "
            f"({_means(found.correlation)})",
            float((np.abs(r).argmin(axis=1) == 1).sum()),
            8,  # chance 1 in 3 for each: 8 of 10 happen 3 times in 1,000
            refuted_by="lessons that are as correlated in the middle as at the ends",
        ),
        at_least(
            "so does its slope dF/dv: of ten lessons, those steeper in the first third than in the last "
            f"({_means(found.slope, '.0f')} N s/m)",
            float((slope[:, 0] > slope[:, 2]).sum()),
            9,  # chance 1 in 2 for each: 9 of 10 happen once in 100
            refuted_by="one slope for all thirds: a constant damping",
        ),
    ]
    for role in ROLES:
        constant, regressed = (float(np.mean([getattr(f, n) for f in found.fits[role]])) for n in ("r2_constant", "r2_regressed"))
        made.append(
            at_least(
                f"robot as {role}: variance of held-out force that constant damping leaves over what 5 Gaussians leave "
                f"(R^2 {constant:.2f} and {regressed:.2f})",
                (1.0 - constant) / (1.0 - regressed),
                1.5,
                refuted_by="a constant damping that predicts nearly as well",
            )
        )
    return made


def _means(values: Mapping[str, Array], digits: str = ".2f") -> str:
    """Per role the means of the three thirds."""
    return "; ".join(f"{role} {', '.join(format(v, '+' + digits) for v in values[role].mean(axis=0))}" for role in ROLES)


def draw(found: Numbers) -> Any:
    caption = (
        "Fig. 6. Force against velocity in the three parts of the motion, five lessons a role, with the line of least "
        "squares of each part and the lessons' mean correlation r. Below: the force of a held-out lesson, by one constant"
        " damping D and by regression on a model of 5 states (both learned from the other four lessons; R^2 is the mean "
        "over all five). Refuted if the lines of a role agree in all parts, or if D v follows the force as well."
    )
    with figures.taste():
        figure = figures.blank(7.4, 4.9, legend=[figures.line(label=n, **s) for n, s in DRAWN.items()], caption=caption)
        grid = figure.add_gridspec(2, 6)
        first: Any = None
        for n, part in enumerate(PARTS):
            first = figure.add_subplot(grid[0, 2 * n : 2 * n + 2], sharex=first, sharey=first)
            _part(first, found, n, part)
        for n, role in enumerate(ROLES):
            _held_out(figure.add_subplot(grid[1, 3 * n : 3 * n + 3]), found, role)
    return figure


def _part(ax: Any, found: Numbers, n: int, title: str) -> None:
    for role in ROLES:
        style = figures.ROLE_STYLE[role]
        thirds = [_thirds(lesson)[n] for lesson in found.lessons[role]]
        for v, f in thirds:
            ax.plot(v, f, linewidth=0.8, alpha=0.45, color=style["color"])
        v, f = np.concatenate(thirds, axis=1)
        ends = np.array([v.min(), v.max()])
        ax.plot(ends, f.mean() + np.polyfit(v, f, 1)[0] * (ends - v.mean()), linewidth=2.2, **style)
        names = {"leader": "leads", "follower": "follows"}
        at = (0.03, 0.97) if role == "follower" else (0.03, 0.03)
        ax.text(
            *at,
            f"robot {names[role]}: r = {found.correlation[role][:, n].mean():+.2f}",
            transform=ax.transAxes,
            va="top" if role == "follower" else "bottom",
            fontsize=8,
            color=style["color"],
        )
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -9.0), max(high, 15.0))
    ax.axhline(0.0, color=figures.ASH, linewidth=0.7, zorder=0)
    figures.label(ax, UNITS["velocity"], UNITS["force"] if n == 0 else "", title.capitalize())


DRAWN: Mapping[str, Mapping[str, Any]] = {
    "felt": {"color": figures.ASH, "linewidth": 3.0},
    "5 Gaussians, from position and velocity": {"color": figures.INK},
    "constant damping": {"color": figures.CLAY, "linestyle": figures.DASHES[1]},
}


def _held_out(ax: Any, found: Numbers, role: str) -> None:
    lesson, fit = found.lessons[role][-1], found.fits[role][-1]
    time = np.arange(len(lesson)) * lesson.dt
    means = {n: float(np.mean([getattr(f, n) for f in found.fits[role]])) for n in ("r2_constant", "r2_regressed")}
    ax.plot(time, lesson.force[:, 0], **DRAWN["felt"])
    ax.plot(time, fit.regressed, **DRAWN["5 Gaussians, from position and velocity"])
    ax.plot(time, fit.constant, **DRAWN["constant damping"])
    text = f"D = {fit.damping:+.0f} N s/m: $R^2$ = {means['r2_constant']:.2f}\n5 Gaussians: $R^2$ = {means['r2_regressed']:.2f}"
    up = role == "follower"
    low, high = ax.get_ylim()
    ax.set_ylim((low, high + 0.25 * (high - low)) if up else (low - 0.25 * (high - low), high))
    ax.text(0.98, 0.97 if up else 0.03, text, transform=ax.transAxes, ha="right", va="top" if up else "bottom", fontsize=8)
    figures.label(ax, "time [s]", UNITS["force"], f"Robot {'follows' if role == 'follower' else 'leads'}, held-out lesson")


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    figures.save(draw(found), out / "figure_6.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
