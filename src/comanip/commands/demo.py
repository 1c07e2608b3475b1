"""The main job in one command: teach both roles, learn them, collaborate with partners never met, and report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from ..evaluation import prediction
from ..learned import file as skill_file
from ..learned.learn import learn
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration, demonstrations
from ..loop import unbroken
from ..recording import Recording
from ..reproduction import make_skill
from ..teaching import ROLES
from ..teaching import teach as record_lessons
from ..trials import Case, Verdict, draw_case, judge, run_case, run_cases
from ..whole_file import write_whole
from .console import print_json, progress, say, say_if_slow
from .ending import keeping
from .outputs import may_fill, must_draw
from .running import LESSON_RATE_HZ, best_plant
from .trying import summary
from .words import WORDS

PARTNERS = 24  # a role and law, on the exact beam; `comanip trial` runs as many as wanted
IN_PHYSICS = 4  # a role, on the humanoid
LAWS = ("default", "paper", "mass-damper")


def demo(out: Path, seed: int, plant: str | None, overwrite: bool, json: bool) -> None:
    from ..evaluation import drawing as figures
    from ..page import export as page_export
    from ..web import report

    must_draw("demo")
    may_fill(out, ("leader.json", "follower.json", "report.html", "lift.html"), overwrite=overwrite)
    say_if_slow()
    started = time.perf_counter()
    plant = plant or best_plant()
    streams = np.random.SeedSequence(seed).spawn(5)
    lessons: dict[str, tuple[Demonstration, ...]] = {}
    skills: dict[str, LearnedSkill] = {}
    results: dict[str, Any] = {"seed": seed, "plant": plant, "roles": {}}
    shown: dict[str, tuple[Case, Recording, Verdict]] = {}
    for n, role in enumerate(ROLES):
        with progress(f"five lessons as {role}") as report_progress:
            recordings = record_lessons(role, 5, rng=np.random.default_rng(streams[n]), plant=plant, progress=report_progress)
        lessons[role] = demonstrations(recordings, rate_hz=LESSON_RATE_HZ)
        begun = time.perf_counter()
        skills[role] = learn(lessons[role], role=role)
        learn_s = time.perf_counter() - begun
        skill_file.save(skills[role], out / f"{role}.json")
        keeping(f"{' and '.join(f'{r}.json' for r in skills)} in {out}; no report")
        with progress(f"{role} against the lesson it has not seen") as report_progress:
            left_out = prediction.overall(prediction.leave_one_out(lessons[role], progress=report_progress, role=role))
        results["roles"][role] = {"learn_s": learn_s, "prediction": left_out}
    for n, role in enumerate(ROLES):
        rng = np.random.default_rng(streams[2 + n])
        cases = [draw_case(role, rng) for _ in range(PARTNERS)]
        trials = {}
        for law in LAWS if role == "follower" else LAWS[:2]:
            with progress(f"{role}, law {law}, {PARTNERS} partners never met") as report_progress:
                trials[law] = summary(run_cases(cases, skills, law, workers=0, progress=report_progress), cases)
        results["roles"][role]["trial"] = trials
        if plant != "beam":
            some = cases[:IN_PHYSICS]
            with progress(f"{role}, law default, {IN_PHYSICS} of them on the {plant}") as report_progress:
                verdicts = run_cases(some, skills, "default", plant=plant, workers=0, progress=report_progress)
            results["roles"][role]["in_physics"] = summary(verdicts, some)
        shown[role] = _shown(cases[0], skills[role], plant)
        results["roles"][role]["shown"] = {"success": shown[role][2].success, **shown[role][2]._asdict()}
    rng = np.random.default_rng(streams[4])
    cases = [draw_case("auto", rng) for _ in range(PARTNERS)]
    with progress(f"told no role, {PARTNERS} partners never met") as report_progress:
        results["auto"] = summary(run_cases(cases, skills, "default", workers=0, progress=report_progress), cases)
    results["seconds"] = time.perf_counter() - started
    pictures = {
        "demonstrations": figures.demonstrations([x for role in ROLES for x in lessons[role]]),
        "skills": figures.skills(skills),
        **{f"{role}": figures.reproduction(shown[role][1], title=f"Robot as {role}") for role in ROLES},
    }
    drawn = {name: figures.to_svg(f) for name, f in pictures.items()}
    words = {name: WORDS[name] for name in ("effort", "told nothing", "residual force", "ripple", "one-step R²", "free run")}
    lift = page_export.page(skills, seed=seed)
    page = report.page(results, drawn, {r: shown[r][:2] for r in ROLES}, words=words, lift=lift)
    write_whole(out / "lift.html", lift)
    target = out / "report.html"
    write_whole(target, page)
    results["report"] = str(target)
    results["success"] = all(results["roles"][role]["shown"]["success"] for role in ROLES)
    if json:
        print_json(results)
        return
    for role in ROLES:
        r = results["roles"][role]
        t = r["trial"]["default"]
        say(
            f"{role}: learned from 5 lessons in {r['learn_s']:.2f} s; carried the beam with "
            f"{round(t['success'] * t['partners'])} of {t['partners']} partners it had never met "
            f"(the paper's law: {round(r['trial']['paper']['success'] * t['partners'])})"
        )
        if p := r.get("in_physics"):
            say(f"  on the humanoid, in physics: {round(p['success'] * p['partners'])} of {p['partners']}")
    a = results["auto"]
    say(
        f"told nothing: carried it with {round(a['success'] * a['partners'])} of {a['partners']}, some of whom lead; "
        f"knew its role in time {100 * a['role_right']:.0f} %"
    )
    say(f"{out / 'lift.html'}: lift with the robot yourself (the report has it, too)")
    say(f"{target}: pictures, numbers and an animation of both collaborations ({results['seconds']:.0f} s)")


def _shown(case: Case, learned: LearnedSkill, plant: str) -> tuple[Case, Recording, Verdict]:
    """The first partner drawn, whatever comes of it: nothing is picked for the show."""
    recording = unbroken(run_case(case, make_skill(learned, axes=learned.axes, dt=0.01, role=case.role), plant=plant))
    return case, recording, judge(case, recording, taught_ends_m=learned.ends)
