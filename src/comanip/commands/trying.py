"""trial: laws and baselines with many partners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..trials import LAWS, Case, Verdict, draw_case, partner_of, run_cases, success_interval
from ..trials.cases import ROLES
from ..trials.foreign import PartnersFrom, bounds_memory
from ..trials.running import one_run
from .console import note, print_json, progress, say, table
from .ending import keeping
from .outputs import may_fill, must_draw
from .running import taught
from .words import explained

WORST = 10
LIFTS = ("z",)


def trial(
    roles: Sequence[str],
    partners: int,
    seed: int,
    plant: str,
    laws: Sequence[str],
    files: Sequence[Path],
    partners_from: Path | None,
    misbehaving: float,
    pictures: Path | None,
    workers: int,
    overwrite: bool,
    json: bool,
) -> None:
    if unknown := sorted(set(laws) - set(LAWS)):
        raise ParameterError(f"law {unknown[0]!r} is unknown; there are: {', '.join(LAWS)}")
    if not 0.0 <= misbehaving <= 1.0:
        raise ParameterError(f"--misbehaving is a share of the partners, 0 to 1; got {misbehaving}")
    if partners < 1:
        raise ParameterError(f"--partners must be at least 1; got {partners}")
    if workers < 0:
        raise ParameterError(f"--workers must be 0 (one a core) or more; got {workers}")
    if pictures is not None:
        must_draw("--pictures")
        may_fill(pictures, (picture_name(r, w, n + 1) for r in roles for w in laws for n in range(WORST)), overwrite=overwrite,
                 flag="--pictures")  # fmt: skip
    if partners_from is not None and not bounds_memory():
        note("what a partner of yours allocates cannot be bounded on this system")
    skills = _skills(roles, laws, files)
    people = PartnersFrom(str(partners_from), bounded=True) if partners_from is not None else partner_of
    results: dict[str, dict[str, Any]] = {}
    for role in roles:
        rng = np.random.default_rng([seed, ROLES.index(role)])
        cases = [draw_case(role, rng, misbehaving=misbehaving) for _ in range(partners)]
        for law in laws:
            keeping("a trial is told when it is over; nothing was written")
            with progress(f"{role}, {law}") as report:
                verdicts = run_cases(cases, skills, law, plant=plant, workers=workers, partner=people, progress=report)
            results.setdefault(role, {})[law] = summary(verdicts, cases)
            if pictures is not None:
                results[role][law]["pictures"] = _draw_worst(cases, verdicts, skills, law, plant, people, pictures)
    if json:
        print_json(results)
        return
    for role, by_law in results.items():
        _print(role, by_law, partners, seed, plant)
    words = ["effort", "peak", "end", "ripple", "LDLJ", *(["told nothing", "role right"] if "auto" in results else [])]
    for line in explained(words):
        say(line)


def _skills(roles: Sequence[str], laws: Sequence[str], files: Sequence[Path]) -> dict[str, LearnedSkill]:
    """Skills by role: from files, or learned now from five fresh lessons."""
    skills: dict[str, LearnedSkill] = {}
    for file in files:
        learned = skill_file.load(file)
        if learned.role in skills or not learned.role:
            raise ParameterError(f"{file}: role {learned.role or 'not stated'!r}; --skill takes one file a role")
        if learned.axes != LIFTS:
            raise ParameterError(
                f"{file}: moves {', '.join(learned.axes)}; partners of trials lift along "
                f"{', '.join(LIFTS)}: it would be judged by another task"
            )
        skills[learned.role] = learned
    wanted = {"leader", "follower"} if "auto" in roles or "active-passive" in laws else set(roles)
    if files and (absent := sorted(wanted - set(skills))):
        note(f"no --skill as {' or '.join(absent)}: learned now from five simulated lessons a role")
    for role in sorted(wanted - set(skills)):
        skills[role] = taught(role, seed=0)
    if "auto" in roles and "natural" not in skills and not files:
        skills["natural"] = taught("natural", seed=0)
    return skills


def picture_name(role: str, law: str, place: int) -> str:
    return f"{role}_{law}_{place:02d}.png"


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


def _print(role: str, by_law: Mapping[str, Mapping[str, Any]], partners: int, seed: int, plant: str) -> None:
    columns = ["law", "success", "95 %", "effort N²s", "peak N", "end cm", "level °", "ripple mm/s", "LDLJ"]
    if role == "auto":
        columns.append("role right")
    rows = []
    for law, r in by_law.items():
        row = [
            law,
            f"{100 * r['success']:.1f} %",
            f"{100 * r['interval'][0]:.1f}-{100 * r['interval'][1]:.1f}",
            _shown(r["effort"], 1.0, 3),
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
    table(
        f"{who}, on the {plant}: {partners} partners it has never met (seed {seed}); medians over those who behave", columns, rows
    )
    for law, r in by_law.items():
        by = ", ".join(f"{name} {s['successes']}/{s['partners']}" for name, s in r["behaviours"].items())
        why = "; ".join(f"{reason} {n}" for reason, n in r["failures"].items()) or "none"
        say(f"{law}: {by}. Failures: {why}")
        for file in r.get("pictures", ()):
            say(f"  {file}")


def _shown(value: float | None, factor: float, digits: int) -> str:
    """ "-" where no partner behaved, so that there is nothing to take a median of."""
    return "-" if value is None else f"{factor * value:.{digits}g}"


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
        "internal_force_n": over("internal_force_n"),
        "effort_share": over("effort_share"),
        "role_right": float(np.mean(told)) if told else None,
        "behaviours": behaviours,
        "failures": dict(Counter(reason for v in verdicts for reason in v.failures)),
    }
