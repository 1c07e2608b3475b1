"""trial: laws and baselines with many partners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import ParameterError
from ..learned.skill import LearnedSkill
from ..parts import LAWS, TASKS, known
from ..tasks import Task, named
from ..trials import ABLATION, Case, Verdict, draw_case, paired, partner_of, run_cases, success_interval
from ..trials.board import ABOUT
from ..trials.board import about as about_result
from ..trials.cases import ROLES, TASK
from ..trials.foreign import PartnersFrom, bounds_memory
from ..trials.policies import check_policy
from ..trials.running import one_run
from . import people as of_kinds
from .console import note, print_json, progress, say, table
from .ending import keeping
from .outputs import may_fill, must_draw
from .skills import skills_for
from .words import explained

WORST = 10


def trial(
    roles: Sequence[str],
    partners: int,
    seed: int,
    plant: str,
    laws: Sequence[str],
    policies: Sequence[Path],
    files: Sequence[Path],
    partners_from: Path | None,
    people: Sequence[str],
    tasks: Sequence[str],
    ablate: bool,
    misbehaving: float,
    pictures: Path | None,
    workers: int,
    overwrite: bool,
    json: bool,
) -> None:
    laws = laws_asked(laws, policies)
    if not 0.0 <= misbehaving <= 1.0:
        raise ParameterError(f"--misbehaving is a share of the partners, 0 to 1; got {misbehaving}")
    if partners < 1:
        raise ParameterError(f"--partners must be at least 1; got {partners}")
    if workers < 0:
        raise ParameterError(f"--workers must be 0 (one a core) or more; got {workers}")
    if people:
        clash = (
            ("--partners-from", partners_from),
            ("--pictures", pictures),
            ("--task", tasks or None),
            ("--ablate", ablate or None),
        )
        if given := [flag for flag, value in clash if value is not None]:
            raise ParameterError(f"{given[0]} does not go with --people; leave one of them out")
        of_kinds.trial(roles, people, partners, seed, plant, laws, files, misbehaving, workers, json)
        return
    whats = _tasks(tasks, files)
    asked = _Asked(roles, partners, seed, plant, tuple(laws), ablate, misbehaving, partner_of, workers)
    folders = {what.name: pictures / what.name if pictures is not None and tasks else pictures for what in whats}
    if pictures is not None:
        must_draw("--pictures")
        for folder in folders.values():
            names = (picture_name(r, w, n + 1) for r in roles for w in asked.laws_of(r) for n in range(WORST))
            may_fill(folder or pictures, names, overwrite=overwrite, flag="--pictures")
    if partners_from is not None:
        asked = replace(asked, makes=PartnersFrom(str(partners_from), bounded=True))
        if not bounds_memory():
            note("what a partner of yours allocates cannot be bounded on this system")
    results: dict[str, dict[str, Any]] = {}
    for task in whats:
        results[task.name] = _of_task(asked, task, files, folders[task.name], says=task.name if tasks else "")
    if json:
        told = _told(asked, whats, files, by_task=bool(tasks))
        print_json({**(results if tasks else results[TASK]), ABOUT: told})
        return
    for name, by_role in results.items():
        for role, by_law in by_role.items():
            _print(role, by_law, partners, seed, plant, task=name if tasks else "")
    words = ["effort", "peak", "end", "ripple", "LDLJ", *(["told nothing", "role right"] if "auto" in roles else [])]
    for line in explained(words):
        say(line)


def laws_asked(laws: Sequence[str], policies: Sequence[Path]) -> tuple[str, ...]:
    """Laws by name and policies by file, each once; the default law where nothing was asked for."""
    for law in laws:
        known("law", law, LAWS)
    for file in policies:
        check_policy(str(file))
    return tuple(dict.fromkeys([*laws, *map(str, policies)])) or ("default",)


@dataclass(frozen=True)
class _Asked:
    """What all tasks of one trial share."""

    roles: Sequence[str]
    partners: int
    seed: int
    plant: str
    laws: tuple[str, ...]
    ablate: bool
    misbehaving: float
    makes: Any
    workers: int

    def cases(self, role: str, task: Task) -> list[Case]:
        """The partners, in order."""
        rng = np.random.default_rng([self.seed, ROLES.index(role)])
        return [draw_case(role, rng, task=task, misbehaving=self.misbehaving) for _ in range(self.partners)]

    def laws_of(self, role: str) -> tuple[str, ...]:
        """The default law goes first where others are compared with it."""
        if not self.ablate:
            return self.laws
        return tuple(dict.fromkeys(("default", *ABLATION[role], *self.laws)))


def _tasks(names: Sequence[str], files: Sequence[Path]) -> list[Task]:
    """The tasks that were named, "all" being those that ship and run here; without any, the usual one."""
    if not names:
        return [named(TASK)]
    found: dict[str, Task] = {}
    for name in names:
        several = [one for one in map(named, TASKS) if not one.needs] if name == "all" else [named(name).runnable()]
        for one in several:
            if found.setdefault(one.name, one) != one:
                raise ParameterError(
                    f"--task {name}: another task is called {one.name!r}, too; change `name` in one of the files"
                )
    if files and len(found) > 1:
        raise ParameterError(f"--skill goes with one --task; got {', '.join(found)}")
    return list(found.values())


def _of_task(asked: _Asked, task: Task, files: Sequence[Path], pictures: Path | None, says: str) -> dict[str, Any]:
    """{role: {law: summary}}, and under "against" of a law what the default law gains on it."""
    laws = [law for role in asked.roles for law in asked.laws_of(role)]
    skills = skills_for(asked.roles, laws, files, task)
    results: dict[str, Any] = {}
    for role in asked.roles:
        cases = asked.cases(role, task)
        by_law: dict[str, list[Verdict]] = {}
        for law in asked.laws_of(role):
            keeping("a trial is told when it is over; nothing was written")
            with progress(", ".join(filter(None, (says, role, law)))) as report:
                by_law[law] = run_cases(
                    cases, skills, law, plant=asked.plant, workers=asked.workers, partner=asked.makes, progress=report
                )
            results.setdefault(role, {})[law] = summary(by_law[law], cases)
            if pictures is not None:
                drawn = _draw_worst(cases, by_law[law], skills, law, asked.plant, asked.makes, pictures)
                results[role][law]["pictures"] = drawn
        if asked.ablate:
            steady = [n for n, case in enumerate(cases) if case.behaviour == "steady"]
            for law, verdicts in by_law.items():
                if law != "default":
                    one, other = ([some[n] for n in steady] for some in (by_law["default"], verdicts))
                    results[role][law]["default_minus_this"] = paired(one, other, np.random.default_rng(asked.seed))
    return results


def _told(asked: _Asked, whats: Sequence[Task], files: Sequence[Path], *, by_task: bool) -> dict[str, Any]:
    """What was asked, and hashes, for who gathers or repeats it."""
    cases = [case for task in whats for role in asked.roles for case in asked.cases(role, task)]
    about = {name: getattr(asked, name) for name in ("roles", "partners", "seed", "plant", "misbehaving")}
    named_ = {"people": "usual", "tasks": [task.name for task in whats], "by_task": by_task}
    return about_result(cases, asked.laws, version=__version__, files=files, **about, **named_)


def picture_name(role: str, law: str, place: int) -> str:
    return f"{role}_{Path(law).name}_{place:02d}.png"


def _draw_worst(
    cases: Sequence[Case],
    verdicts: Sequence[Verdict],
    skills: Mapping[str, LearnedSkill],
    law: str,
    plant: str,
    people: Any,
    folder: Path,
) -> list[str]:
    """Pictures of the ten worst runs: failures first, then by effort."""
    from ..evaluation import drawing as figures

    order = sorted(range(len(cases)), key=lambda i: (verdicts[i].success, -verdicts[i].effort_n2s))[:WORST]
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for place, i in enumerate(order, 1):
        case = cases[i]
        recording, verdict = one_run(case, skills, law, plant, partner=people)
        why = ", ".join(verdict.failures) or f"effort {verdict.effort_n2s:.0f} N²s"
        title = f"{case.role}, {law}, partner {i}: {case.partner}, {case.behaviour}: {why}"
        file = folder / picture_name(case.role, law, place)
        figures.save(figures.reproduction(recording, title=title), file)
        files.append(str(file))
    return files


def _print(role: str, by_law: Mapping[str, Mapping[str, Any]], partners: int, seed: int, plant: str, task: str = "") -> None:
    columns = ["law", "success", "95 %", "effort N²s", "time s", "peak N", "end cm", "level °", "ripple mm/s", "LDLJ"]
    if role == "auto":
        columns.append("role right")
    rows = []
    for law, r in by_law.items():
        row = [
            law,
            f"{100 * r['success']:.1f} %",
            f"{100 * r['interval'][0]:.1f}-{100 * r['interval'][1]:.1f}",
            _shown(r["effort"], 1.0, 3),
            _shown(r["time_s"], 1.0, 3),
            _shown(r["peak_force_n"], 1.0, 3),
            _shown(r["end_error_m"], 100.0, 2),
            _shown(r["tilt_deg"], 1.0, 2),
            _shown(r["ripple_m_per_s"], 1000.0, 2),
            _shown(r["smoothness"], 1.0, 3),
        ]
        if role == "auto":
            row.append("-" if r["role_right"] is None else f"{100 * r['role_right']:.1f} %")
        rows.append(row)
    who = "Robot told nothing" if role == "auto" else f"Robot as {role}"
    who = f"{task}: {who}" if task else who
    table(
        f"{who}, on the {plant}: {partners} partners it has never met (seed {seed}); medians over those who behave", columns, rows
    )
    for law, r in by_law.items():
        by = ", ".join(f"{name} {s['successes']}/{s['partners']}" for name, s in r["behaviours"].items())
        why = "; ".join(f"{reason} {n}" for reason, n in r["failures"].items()) or "none"
        say(f"{law}: {by}. Failures: {why}")
        if (apart := r.get("default_minus_this")) is not None:
            say(f"  default minus {law}: {_differences(apart)}")
        for file in r.get("pictures", ()):
            say(f"  {file}")


def _shown(value: float | None, factor: float, digits: int) -> str:
    """ "-" where no partner behaved, so that there is nothing to take a median of."""
    return "-" if value is None else f"{factor * value:.{digits}g}"


def _differences(apart: Mapping[str, Any]) -> str:
    """In words: success in points of per cent, effort and time where both succeeded."""
    said = []
    for name, scale, unit in (("success", 100.0, "%"), ("effort", 1.0, "N²s"), ("time_s", 1.0, "s")):
        if apart[name] is not None:
            mean, low, high = (scale * x for x in apart[name])
            said.append(f"{name.removesuffix('_s')} {mean:+.3g} ({low:+.3g} to {high:+.3g}) {unit}")
    return f"{', '.join(said)}; both succeed with {apart['both']}"


def summary(verdicts: Sequence[Verdict], cases: Sequence[Case]) -> dict[str, Any]:
    """Success with its 95 % interval and reasons over ALL partners; medians over those who behave (peaks: the highest)."""
    successes, n = sum(v.success for v in verdicts), len(verdicts)
    steady = [v for v, c in zip(verdicts, cases, strict=True) if c.behaviour == "steady"]
    told = [v.role_right for v in steady if v.role_right == v.role_right]

    def over(name: str, by: Any = np.median) -> float | None:
        values = [abs(x) for v in steady if (x := getattr(v, name)) == x]
        return float(by(values)) if values else None

    behaviours: dict[str, dict[str, int]] = {}
    for verdict, case in zip(verdicts, cases, strict=True):
        counted = behaviours.setdefault(case.behaviour, {"partners": 0, "successes": 0})
        counted["partners"] += 1
        counted["successes"] += verdict.success
    return {
        "success": successes / max(n, 1),
        "interval": list(success_interval(successes, n)),
        "partners": n,
        "effort": over("effort_n2s"),
        "work_j": float(np.median([v.work_j for v in steady])) if steady else None,
        "peak_force_n": over("peak_force_n", np.max),
        "residual_force_n": over("residual_force_n"),
        "end_error_m": over("end_error_m"),
        "tilt_deg": over("tilt_deg", np.max),
        "ripple_m_per_s": over("ripple_m_per_s"),
        "smoothness": float(np.median([v.smoothness for v in steady])) if steady else None,
        "duration_s": over("duration_s"),
        "time_s": over("duration_s"),
        "vibration_n": over("vibration_n"),
        "clearance_m": over("clearance_m", np.min) if cases and cases[0].task.obstacles else None,
        "visited": over("visited", np.mean),
        "cycles": over("cycles"),
        "rest_error_s": over("rest_error_s", np.max),
        "slowness": over("slowness"),
        "internal_force_n": over("internal_force_n"),
        "effort_share": over("effort_share"),
        "role_right": float(np.mean(told)) if told else None,
        "behaviours": behaviours,
        "failures": dict(Counter(reason for v in verdicts for reason in v.failures)),
    }
