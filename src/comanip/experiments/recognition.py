"""Can a recogniser's confidence be believed? python -m comanip.experiments.recognition [calibration.png]

Three simulated pairs of people, three roles each, six lessons a role: each lesson is recognised among the roles of its pair by
skills that have not seen it; whole, and when half of it is known. Then as before: frames counted as independent witnesses.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace

import numpy as np

from comanip.evaluation.drawing import blank, label, save, taste
from comanip.evaluation.recognition import Calibration, Recognition, calibration, recognise
from comanip.interfaces import Array
from comanip.learned.skill import LearnedSkill, learn
from comanip.lessons.demonstration import Demonstration, demonstrations
from comanip.models.hmm import log_likelihood
from comanip.teaching import DYADS, teach

ROLES = ("leader", "follower", "natural")
KINDS = ("whole", "half", "frames as independent")


def independent(skills: list[LearnedSkill], lesson: Demonstration) -> Recognition:
    """The posterior that adds up the frames' log-likelihoods."""
    scores = np.array([float(log_likelihood(s.model, [lesson.array(s.model.channels)])[0]) for s in skills])
    weights: Array = np.exp(scores - scores.max())
    return Recognition(weights / weights.sum(), 0.0, scores, 1.0, False)


def found_in(dyad: str, lessons_each: int = 6) -> dict[str, list[tuple[Recognition, int]]]:
    """By kind, (recognition, truth) of every lesson of a pair of people."""
    groups = [
        demonstrations(teach(role, lessons_each, rng=np.random.default_rng(11 + n), habits=DYADS[dyad]), rate_hz=100.0)
        for n, role in enumerate(ROLES)
    ]
    every = [learn(group) for group in groups]
    found: dict[str, list[tuple[Recognition, int]]] = {kind: [] for kind in KINDS}
    for truth, group in enumerate(groups):
        for lesson in group:
            skills = list(every)
            skills[truth] = learn([x for x in group if x is not lesson])
            unnamed = replace(lesson, role="")
            found["whole"].append((recognise(skills, unnamed), truth))
            found["half"].append((recognise(skills, unnamed, after_s=0.5 * lesson.duration_s), truth))
            found["frames as independent"].append((independent(skills, lesson), truth))
    return found


def picture(judged: dict[str, Calibration], path: str) -> None:
    with taste():
        figure = blank(4.2, 3.6, caption="On the diagonal a confidence of p is right in p of all cases. Numbers: recordings.")
        ax = figure.subplots()
        ax.plot([0, 1], [0, 1], color="#bbbbbb", lw=0.8)
        for row, ((name, k), colour) in enumerate(zip(judged.items(), ("#2a6f97", "#588157", "#c8553d"), strict=True)):
            ax.plot(k.stated, k.held, "o-", color=colour, ms=4, lw=1.0, label=name)
            for x, y, n in zip(k.stated, k.held, k.counts, strict=True):
                beside = (0, -10 - 9 * row) if y > 0.2 else (0, 6 + 9 * row)  # a row a kind: points of several lie on one place
                ax.annotate(str(n), (x, y), xytext=beside, textcoords="offset points", fontsize=7, color=colour, ha="center")
        ax.set(xlim=(-0.05, 1.08), ylim=(-0.05, 1.08))
        ax.legend(loc="center left")
        label(ax, "stated confidence", "share that was right")
        save(figure, path)


def main(path: str = "") -> None:
    warnings.simplefilter("ignore")
    total: dict[str, list[tuple[Recognition, int]]] = {kind: [] for kind in KINDS}
    for dyad in DYADS:
        for name, found in found_in(dyad).items():
            total[name] += found
    judged = {name: calibration(found) for name, found in total.items()}
    for name, k in judged.items():
        bins = ", ".join(f"{s:.2f}: {h:.2f} of {n}" for s, h, n in zip(k.stated, k.held, k.counts, strict=True))
        print(f"{name}: mean -log p {k.surprise:.2f} nats, right {k.right} of {k.of}, neither {k.none}; stated: held {bins}")
    if path:
        picture(judged, path)


if __name__ == "__main__":
    main(*sys.argv[1:])
