"""The humanoid over many lessons and reproductions: does it feel the truth, stand, hold the beam level, keep its limits?

    python experiments/physics_check.py [folder] [--lessons 100] [--runs 40] [--seed 0] [--workers 1]      a role

Before each five lessons the same two people hold the beam still for five seconds: the paper's footnote 2 weighs it. Every lesson
and every reproduction is done twice, with the same people, habits and noise: on the humanoid and on the exact beam. The last
columns of the table say how far the two plants part. F is what a skill is given: of a lesson by `demonstration`, of a
reproduction on line (what the partner pulled while the object was weighed counts as weight there). Truth is unfiltered.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.interaction import gravity_along, identify_payload
from comanip.interfaces import Array
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstration, demonstrations
from comanip.parallel import each
from comanip.plants.beam import Beam
from comanip.recording import Recording
from comanip.reproduction import make_skill
from comanip.teaching import ROLES, Habits, teach
from comanip.trials import draw_case, run_case

PLANTS = ("humanoid", "beam")
SET = 5  # lessons between two weighings
WEIGHED_S = 0.25  # how long a reproduction weighs
HOLDING = replace(Habits(), lift_m=(0.0, 0.0), duration_s=(1.8, 0.0), onset_s=(2.2, 2.2))


class Readings(NamedTuple):
    """Of one lesson or reproduction on the humanoid; `*_apart`: rms of its difference from the same on the exact beam."""

    force_rms_n: float  # F by eq. (3) against the truth
    first_third_n: float  # mean true F in the first third of the lift that was meant; negative when the robot leads
    peak_n: float
    tilt_deg: float  # largest
    limits: float  # times that a joint left its range or reached its speed, its torque or the end of its reach
    sunk_mm: float  # how far the base was at most from where it stood
    lean_deg: float
    position_apart_mm: float
    force_apart_n: float
    stopped: str  # why it ended


class Numbers(NamedTuple):
    """By role; `weights`: the whole beam in every weighing [kg]."""

    lessons: dict[str, list[Readings]]
    runs: dict[str, list[Readings]]
    weights: list[float]


def numbers(
    seed: int, *, lessons: int = 100, runs: int = 40, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> Numbers:
    learned = {r: _taught(r, seed) for r in ROLES} if runs else {}
    work: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
    for role in ROLES:
        work += [(weighing, (role, seed, n)) for n in range(-(-lessons // SET))]
        work += [(lesson, (role, seed, n)) for n in range(lessons)]
        work += [(reproduction, (role, seed, n, learned[role])) for n in range(runs)]
    done: list[Any] = []
    for result in each(_call, work, n_jobs=workers):
        done.append(result)
        if progress is not None:
            progress(len(done), len(work))
    found: dict[Any, list[Any]] = {}
    for (what, (role, *_)), result in zip(work, done, strict=True):
        found.setdefault((what, role), []).append(result)
    return Numbers(
        {r: found.get((lesson, r), []) for r in ROLES},
        {r: found.get((reproduction, r), []) for r in ROLES},
        [kg for r in ROLES for kg in found.get((weighing, r), [])],
    )


def _call(what: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return what(*arguments)


def _stream(kind: int, role: str, seed: int, number: int = 0) -> np.random.Generator:
    return np.random.default_rng([seed, kind, ROLES.index(role), number])


def _taught(role: str, seed: int) -> Any:
    return learn(demonstrations(teach(role, SET, rng=_stream(0, role, seed)), rate_hz=100.0), role=role)


def weighing(role: str, seed: int, number: int) -> float:
    """Mass of the whole beam [kg] that two people hold still, by footnote 2."""
    held = teach(role, 1, rng=_stream(1, role, seed, number), habits=HOLDING, plant="humanoid")[0]["hand.sensor_force"]
    return identify_payload(held.values, gravity=gravity_along(held.axes)).mass_kg


def lesson(role: str, seed: int, number: int) -> Readings:
    both = [teach(role, 1, rng=_stream(2, role, seed, number), plant=plant)[0] for plant in PLANTS]
    given = demonstration(both[0], rate_hz=100.0)
    at = given.dt * np.arange(len(given)) + both[0]["hand.position"].time[0]
    return readings(*both, at=at, force=given.force[:, 0], onset_s=both[0].metadata["onset_s"])


def reproduction(role: str, seed: int, number: int, learned: Any) -> Readings:
    case = draw_case(role, _stream(3, role, seed, number))
    skills = (make_skill(learned, axes=learned.axes, dt=0.01, role=role) for _ in PLANTS)
    both = [run_case(case, skill, plant=plant) for plant, skill in zip(PLANTS, skills, strict=True)]
    felt, truth = both[0]["hand.force"], both[0]["hand.true_force"]
    weighed = float(truth.values[truth.time < WEIGHED_S].mean())
    return readings(*both, at=felt.time, force=felt.values[:, 0] + weighed, onset_s=None)


def readings(run: Recording, twin: Recording, *, at: Array, force: Array, onset_s: float | None) -> Readings:
    truth, base = run["hand.true_force"], run["robot.base"].values
    error = force - np.interp(at, truth.time, truth.values[:, 0])
    upright = 1.0 - 2.0 * (base[:, 4:6] ** 2).sum(axis=1)
    third = slice(0, 0)
    if onset_s is not None:
        third = slice(*np.searchsorted(truth.time, [onset_s, onset_s + run.metadata["duration_s"] / 3.0]))
    return Readings(
        force_rms_n=_rms(error),
        first_third_n=float(truth.values[third].mean()) if onset_s is not None else float("nan"),
        peak_n=float(np.abs(truth.values).max()),
        tilt_deg=float(np.degrees(np.abs(run["beam.tilt"].values).max())),
        limits=float(run["robot.limits"].values[-1].sum()),
        sunk_mm=1e3 * float(np.linalg.norm(base[:, :3] - base[0, :3], axis=1).max()),
        lean_deg=float(np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)).max())),
        position_apart_mm=1e3 * _apart(run, twin, "hand.position"),
        force_apart_n=_apart(run, twin, "hand.true_force"),
        stopped=run.metadata["stop_reason"],
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _apart(run: Recording, twin: Recording, name: str) -> float:
    a, b = (recording[name].values[:, 0] for recording in (run, twin))
    shared = min(len(a), len(b))
    return _rms(a[:shared] - b[:shared])


def claims(found: Numbers) -> list[Claim]:
    everything = [r for kind in (found.lessons, found.runs) for rs in kind.values() for r in rs]
    lessons = [r for rs in found.lessons.values() for r in rs]
    wrong = sum(
        sign * r.first_third_n <= 0.0 for role, sign in (("leader", -1.0), ("follower", 1.0)) for r in found.lessons[role]
    )
    mass = Beam().mass_kg
    return [
        at_most(
            "F by eq. (3) is the simulator's truth: rms over a lesson, worst",
            max(r.force_rms_n for r in lessons),
            0.3,
            unit="N",
            refuted_by="a sensor that feels more than the object",
        ),
        at_least(
            "and there was something to feel: peak of F, least of all lessons",
            min(r.peak_n for r in lessons),
            1.5,
            unit="N",
            refuted_by="a lesson without force",
        ),
        at_most(
            "footnote 2 weighs the beam: worst error",
            100.0 * max(abs(kg - mass) for kg in found.weights) / mass,
            2.0,
            unit="%",
            refuted_by="a hand or sensor whose own weight is counted",
        ),
        at_most(
            "F in the first third has its role's sign: lessons where it has not",
            wrong,
            0.0,
            refuted_by="one lesson that is led the wrong way",
        ),
        at_most(
            "the beam stays level: largest tilt", max(r.tilt_deg for r in everything), 2.0, unit="deg", refuted_by="a soft wrist"
        ),
        at_most("no joint met a limit: times", sum(r.limits for r in everything), 0.0, refuted_by="a lift beyond this robot"),
        at_most("the robot stands: largest lean", max(r.lean_deg for r in everything), 2.0, unit="deg", refuted_by="a fall"),
        at_most(
            "nothing ended early (a warning, a state that is not finite, a fall, a fault): runs",
            sum(r.stopped != "duration" for r in everything),
            0.0,
            refuted_by="one reason to stop",
        ),
    ]


def table(found: Numbers) -> str:
    """Median and worst of each reading, a line a kind and role."""
    measured = [name for name in Readings._fields if name != "stopped"]
    lines = (
        [f"weighed {len(found.weights)} times: {min(found.weights):.3f} to {max(found.weights):.3f} kg"] if found.weights else []
    )
    for kind, by_role in (("lessons", found.lessons), ("reproductions", found.runs)):
        for role, runs in by_role.items():
            if not runs:
                continue
            columns = {name: np.array([getattr(r, name) for r in runs]) for name in measured}
            cells = (
                f"{n} {np.median(v):.3g} ({v.min():.3g} to {v.max():.3g})" for n, v in columns.items() if np.isfinite(v).all()
            )
            lines.append(f"{len(runs)} {kind}, robot as {role}: {', '.join(cells)}")
    return "\n".join(lines)


def draw(found: Numbers) -> Any:
    lessons, runs = (sum(map(len, kind.values())) for kind in (found.lessons, found.runs))
    caption = (
        f"The humanoid over {lessons} lessons (points) and {runs} reproductions (crosses): error of F against the simulator's "
        "truth, largest tilt of the beam, and how far hand and F are from the same run on the exact beam (RMS over a run). Dark: "
        "the robot leads; orange: it follows. Crosses are F on line, from sensors drawn with up to 0.5 N of noise and 20 ms of "
        "delay. Refuted by a point above 0.3 N, or any mark above 2 degrees (dashed)."
    )
    with figures.taste():
        figure = figures.blank(7.4, 2.6, caption=caption)
        panels = figure.subplots(1, 3)
        for role in ROLES:
            for runs_of, mark in ((found.lessons[role], "."), (found.runs[role], "x")):
                style = {"color": figures.ROLE_STYLE[role]["color"], "markersize": 4, "linestyle": "", "marker": mark}
                panels[0].plot([r.peak_n for r in runs_of], [r.force_rms_n for r in runs_of], **style)
                panels[1].plot([r.peak_n for r in runs_of], [r.tilt_deg for r in runs_of], **style)
                panels[2].plot([r.position_apart_mm for r in runs_of], [r.force_apart_n for r in runs_of], **style)
        panels[0].axhline(0.3, color=figures.CLAY, linestyle="--", linewidth=0.9)
        panels[1].axhline(2.0, color=figures.CLAY, linestyle="--", linewidth=0.9)
        figures.label(panels[0], "peak of F [N]", "error of F, rms [N]", "F against the truth")
        figures.label(panels[1], "peak of F [N]", "largest tilt [deg]", "level")
        figures.label(panels[2], "hand apart [mm]", "F apart [N]", "against the exact beam")
        for panel in panels:
            panel.set_ylim(bottom=0.0)
    return figure


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/figures"))
    for name, default in (("lessons", 100), ("runs", 40), ("seed", 0), ("workers", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()

    def progress(done: int, of: int) -> None:
        print(f"\r{done} of {of}", end="" if done < of else "\n", file=sys.stderr, flush=True)

    found = numbers(given.seed, lessons=given.lessons, runs=given.runs, workers=given.workers, progress=progress)
    given.folder.mkdir(parents=True, exist_ok=True)
    as_rows = {kind: {r: [x._asdict() for x in v] for r, v in getattr(found, kind).items()} for kind in ("lessons", "runs")}
    (given.folder / "physics_check.json").write_text(json.dumps({**as_rows, "weights": found.weights}, indent=1))
    figures.save(draw(found), given.folder / "physics_check.png")
    print(table(found))
    held = claims(found)
    for claim in held:
        print(f"{'pass' if claim.passed else 'FAIL'}  {claim.text}: {claim.measured:.4g} ({claim.bound})")
    return 0 if all(c.passed for c in held) else 1


if __name__ == "__main__":
    sys.exit(main())
