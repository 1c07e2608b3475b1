"""Fig. 5: lessons of the lift in both roles, and their models of 5 states.

Claims of the paper: the two roles are distinct and stereotypical; each begins and ends with force and velocity near zero;
five states hold each compactly. Refuted by a lesson whose force does work of the other role's sign, by a held-out lesson
that the other role's model explains better, or by one that leaves its own model's states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.evaluation.metrics import work
from comanip.evaluation.prediction import one_step_velocity
from comanip.experiments.lifts import LESSONS, learned, moving, taught
from comanip.experiments.readings import script
from comanip.interfaces import Array
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import Demonstration
from comanip.models.hmm import log_likelihood

ROLES = ("leader", "follower")
PLANES = (("position", "velocity"), ("position", "force"), ("velocity", "force"))
UNITS = {"position": "x [m]", "velocity": "dx [m/s]", "force": "F [N]"}


class Numbers(NamedTuple):
    lessons: Mapping[str, Sequence[Demonstration]]
    skills: Mapping[str, LearnedSkill]
    own: Array  # (10,) log-likelihood per frame of each lesson under its role's model learned from the other four
    other: Array  # (10,) and under the other role's
    r2: Array  # (10,) R^2 of its velocity by eq. (5), from position and force, learned from the other four


def numbers(seed: int, *, lessons: Mapping[str, Sequence[Demonstration]] | None = None) -> Numbers:
    lessons = lessons or {role: taught(role, seed)[:LESSONS] for role in ROLES}
    skills = {role: learned(tuple(lessons[role])) for role in ROLES}
    own, other, r2 = [], [], []
    for role, against in (ROLES, ROLES[::-1]):
        for n, held in enumerate(lessons[role]):
            left = learned(tuple(x for m, x in enumerate(lessons[role]) if m != n))
            frames = held.array(left.model.channels)
            own.append(log_likelihood(left.model, [frames])[0] / len(held))
            other.append(log_likelihood(skills[against].model, [frames])[0] / len(held))
            part = moving(held)
            wrong = one_step_velocity(left, held)[part] - held.velocity[part]
            r2.append(1.0 - float((wrong**2).sum() / ((held.velocity[part] - held.velocity[part].mean()) ** 2).sum()))
    return Numbers(lessons, skills, np.array(own), np.array(other), np.array(r2))


def claims(found: Numbers) -> list[Claim]:
    done = {role: [work(x.force[:, 0], x.velocity[:, 0], x.dt) for x in found.lessons[role]] for role in ROLES}
    ends = [
        float(np.abs(signal[[0, -1], 0]).max() / np.abs(signal).max())
        for role in ROLES
        for lesson in found.lessons[role]
        for signal in (lesson.velocity, lesson.force)
    ]
    return [
        at_least(
            "the partner works on a following hand: least work of 5 lessons",
            min(done["follower"]),
            0.1,
            unit="J",
            refuted_by="a follower lesson in which the robot does the lifting",
        ),
        at_most(
            "a leading hand works on the partner: most work of 5 lessons",
            max(done["leader"]),
            -0.1,
            unit="J",
            refuted_by="a leader lesson in which the partner does the lifting",
        ),
        at_most(
            "force and velocity begin and end small: largest of 10 lessons, share of the lesson's peak",
            max(ends),
            1.0 / 3.0,  # a following teacher leaves up to 2 N of some 9 N unanswered
            refuted_by="a lesson that begins or ends with more than a third of its peak",
        ),
        at_least(
            "5 states tell the roles apart: least margin of held-out lessons, log-likelihood per frame",
            float((found.own - found.other).min()),
            0.1,
            unit="nat",
            refuted_by="a lesson that the other role's model explains as well",
        ),
        at_least(
            "5 states hold a motion they have not seen: R^2 of its velocity from position and force, eq. (5), mean of 10",
            float(found.r2.mean()),
            0.8,
            refuted_by="lessons whose velocity five states leave unexplained by more than a fifth",
        ),
    ]


def draw(found: Numbers) -> Any:
    caption = (
        "Fig. 5. Five lessons as leader (dark, solid) and five as follower (light, dashed), taught on the simulated beam; "
        "points mark the beginning. F is the partner's force on the hand. Bottom: models of 5 states each, 2 standard "
        "deviations, numbered in order of time. Refuted if a lesson's force works with the other role's sign, or if the "
        "other role's model explains a held-out lesson better."
    )
    with figures.taste():
        figure = figures.blank(7.4, 6.9, legend=figures.roles_legend(ROLES), caption=caption)
        grid = figure.subplots(3, 3)
        for ax, name in zip(grid[0], UNITS, strict=True):
            _over_time(ax, found, name)
        for ax, plane in zip(grid[1], PLANES, strict=True):
            _plane(ax, found, plane)
        for ax, (a, b) in zip(grid[2], PLANES, strict=True):
            for role in ROLES:
                figures.ellipses(ax, found.skills[role].model, f"{a}.z", f"{b}.z", **figures.ROLE_STYLE[role])
            figures.label(ax, UNITS[a], UNITS[b])
        for ax, title in zip(grid[:, 0], ("Lessons over time", "Against each other", "Models of 5 states"), strict=True):
            ax.set_title(title)
    return figure


def _over_time(ax: Any, found: Numbers, name: str) -> None:
    for role in ROLES:
        for lesson in found.lessons[role]:
            ax.plot(np.arange(len(lesson)) * lesson.dt, lesson[name][:, 0], linewidth=1.0, **figures.ROLE_STYLE[role])
    figures.label(ax, "time [s]", UNITS[name])


def _plane(ax: Any, found: Numbers, plane: tuple[str, str]) -> None:
    for role in ROLES:
        for lesson in found.lessons[role]:
            x, y = (lesson[name][:, 0] for name in plane)
            ax.plot(x, y, linewidth=0.9, **figures.ROLE_STYLE[role])
            ax.plot(x[0], y[0], "o", markersize=3, color=figures.ROLE_STYLE[role]["color"])
    figures.label(ax, UNITS[plane[0]], UNITS[plane[1]])


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    figures.save(draw(found), out / "figure_5.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
