"""people: the kinds that there are, and one of them against a rail; and trials with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import ParameterError
from ..evaluation.metrics import vibration
from ..people.kinds import KINDS, TUNING, kind_of, names_of
from ..people.rail import STEP_S, on_rail
from ..trials.board import ABOUT, about
from ..trials.cases import TASK, Case
from ..trials.people import USUAL, draw_people, meet_all, summary
from .console import print_json, progress, table
from .skills import skills_for


def people(name: str | None, seed: int, plot: Path | None, json: bool) -> None:
    if name is None:
        if plot is not None:
            raise ParameterError(f"--plot draws one kind: comanip people NAME --plot {plot}; there are: {', '.join(KINDS)}")
        _list(json)
        return
    _play(name, seed, plot, json)


def _list(json: bool) -> None:
    if json:
        print_json({name: _about(name) for name in KINDS})
        return
    rows = [(name, kind.about, " and ".join(kind.roles), kind.split, kind.source) for name, kind in KINDS.items()]
    tuning = sum(kind.split == TUNING for kind in KINDS.values())
    title = f"{len(KINDS)} kinds of people: {tuning} to choose numbers on, {len(KINDS) - tuning} to judge by"
    table(title, ("kind", "what it does", "plays", "split", "source"), rows)


def _about(name: str) -> dict[str, Any]:
    kind = kind_of(name)
    said = {"about": kind.about, "source": kind.source, "split": kind.split, "roles": list(kind.roles)}
    return {**said, "behaviour": kind.behaviour, "criteria": dict(kind.criteria)}


def _play(name: str, seed: int, plot: Path | None, json: bool) -> None:
    result: dict[str, Any] = {"kind": name, **_about(name), "rail": {}}
    for role in kind_of(name).roles:
        recording = on_rail(name, role, seed=seed)
        force = recording["hand.true_force"].values[:, 0]
        result["rail"][role] = {
            "most_n": float(force.max()),
            "least_n": float(force.min()),
            "end_n": float(force[-500:].mean()),
            "vibration_n": vibration(force, STEP_S),
        }
        if plot is not None:
            from ..evaluation import drawing

            file = plot if len(kind_of(name).roles) == 1 else plot.with_stem(f"{plot.stem}_{role}")
            drawing.save(drawing.reproduction(recording, title=f"{name}, {role}, against a rail"), file)
            result.setdefault("pictures", []).append(str(file))
    if json:
        print_json(result)
        return
    print(f"{name}: {result['about']} ({result['source']}); {result['split']}")
    if result["criteria"]:
        print("its own criteria: " + ", ".join(f"{key} {value:g}" for key, value in result["criteria"].items()))
    for role, n in result["rail"].items():
        print(
            f"{role}, against a rail: {n['least_n']:.1f} to {n['most_n']:.1f} N, {n['end_n']:.1f} N in the end, "
            f"vibration {n['vibration_n']:.2f} N"
        )
    for file in result.get("pictures", ()):
        print(f"  {file}")


def trial(
    roles: Sequence[str],
    people: Sequence[str],
    partners: int,
    seed: int,
    plant: str,
    laws: Sequence[str],
    files: Sequence[Path],
    misbehaving: float,
    workers: int,
    json: bool,
) -> None:
    """`comanip trial --people`: `partners` of each kind."""
    names = [*([USUAL] if USUAL in people else []), *names_of([one for one in people if one != USUAL])]
    robots = any(name != USUAL and kind_of(name).robot for name in names)
    skills = skills_for([*roles, *(["leader", "follower"] if robots else [])], laws, files)
    results: dict[str, dict[str, Any]] = {}
    met_all: list[Case] = []
    for role in roles:
        cases = [case for name in names for case in draw_people(role, name, partners, seed, misbehaving=misbehaving)]
        if not cases:
            plays = ", ".join(f"{name!r} plays {' and '.join(kind_of(name).roles)}" for name in names)
            raise ParameterError(f"--people: none of them can be the partner of a robot as {role}: {plays}")
        met_all += cases
        for law in laws:
            with progress(f"{role}, {law}") as report:
                met = meet_all(cases, skills, law, plant=plant, workers=workers, progress=report)
            results.setdefault(role, {})[law] = summary(cases, met)
    if json:
        asked = {"roles": roles, "partners": partners, "seed": seed, "plant": plant, "misbehaving": misbehaving}
        where = {"people": names, "tasks": [TASK], "by_task": False}
        print_json({**results, ABOUT: about(met_all, laws, version=__version__, files=files, **asked, **where)})
        return
    for role, by_law in results.items():
        for law, found in by_law.items():
            _print(f"Robot as {role}, law {law}: {partners} partners of each kind (seed {seed})", found)


def _print(title: str, found: Mapping[str, Any]) -> None:
    columns = ("kind", "success", "95 %", "effort N²s", "vibration N", "time s", "peak N", "failures")
    rows = [_row(kind, numbers) for kind, numbers in found["kinds"].items()]
    table(title, columns, [*rows, _row("all", found)])


def _row(kind: str, r: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = r["interval"]
    why = "; ".join(f"{reason} {n}" for reason, n in r["failures"].items())
    return (
        kind,
        f"{100 * r['success']:.1f} %",
        f"{100 * low:.0f}-{100 * high:.0f}",
        f"{r['effort']:.3g}",
        f"{r['vibration_n']:.2f}",
        f"{r['time_s']:.2f}",
        f"{r['peak_force_n']:.3g}",
        why,
    )
