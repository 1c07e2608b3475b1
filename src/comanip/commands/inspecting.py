"""inspect: what recordings and skill files hold, and everything that is the matter with them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ChannelError, ComanipError, RecordingError, SkillFileError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..recording import Recording
from .console import print_json, print_notes, say, table
from .flag_words import in_flags
from .flags import DataFlags
from .learning import summary
from .outputs import may_draw
from .reading import preparation_of, read_recordings
from .units import slope_scale, unit_of
from .words import explained

if TYPE_CHECKING:
    from ..formats.listing import Listed
    from ..lessons.checkup import Checkup

_RECOGNISED = re.compile(r"columns (.+) taken as (position|force|velocity)")
_RANKS = ("refused", "suspicious", "told")


def inspect(files: Sequence[Path], plot: Path | None, data: DataFlags, overwrite: bool, json: bool) -> None:
    may_draw(plot, inputs=files, overwrite=overwrite)
    skills = {file: skill_file.load(file) for file in files if file.suffix == ".json"}
    if plot is not None and skills and len(skills) < len(files):
        raise SkillFileError("--plot draws skills or recordings, not both at once")
    results: list[dict[str, Any]] = [{"skill": str(f), **summary(s), "states": _states(s)} for f, s in skills.items()]
    recordings: list[Recording] = []
    for file in files:
        if file not in skills:
            entries, found = _of_file(file, data)
            results += entries
            recordings += found
    if recordings:
        results.append({"checkup": _checked(recordings, [f for f in files if f not in skills], data)})
    if plot is not None:
        _draw(plot, skills, recordings)
    if json:
        print_json(results)
        return
    for result in results:
        _print(result)
    if plot is not None:
        say(f"drawn into {plot}")


def _of_file(file: Path, data: DataFlags) -> tuple[list[dict[str, Any]], list[Recording]]:
    """(entries to print, recordings): also its columns, where no mapping was given and the file has columns to choose from."""
    listing = _listing(file, data)
    try:
        recordings = read_recordings([file], data)
    except (ChannelError, RecordingError) as refused:
        if not listing:
            raise
        return [{"columns": str(file), "listed": listing, "refused": in_flags(str(refused))}], []
    entries = [{"recording": str(file), **_contents(recording)} for recording in recordings]
    return entries + ([{"columns": str(file), "listed": listing}] if listing else []), recordings


def _listing(file: Path, data: DataFlags) -> list[Listed]:
    from ..formats.listing import listed

    mapped = data.mapping is not None or any((data.position, data.velocity, data.force, data.sensor_force))
    return [] if mapped or not file.exists() else list(listed(file))


def _checked(recordings: Sequence[Recording], files: Sequence[Path], data: DataFlags) -> dict[str, Any]:
    from ..lessons.checkup import checkup

    try:
        found = checkup(recordings, preparation_of(data))
    except ComanipError as refused:
        return {"findings": [{"rank": _RANKS[0], "text": in_flags(str(refused)), "remedy": ""}], "advice": "", "lessons": 0}
    return {
        "findings": [{"rank": _RANKS[f.rank], "text": in_flags(f.text), "remedy": f.remedy} for f in found.findings],
        "lessons": len(found.lessons),
        "advice": advice(found, files, data),
    }


def advice(found: Checkup, files: Sequence[Path], data: DataFlags) -> str:
    """One line that is a command: the next one to give."""
    if not found.lessons:
        return f"comanip inspect {_named(files)} --position ... --force ... (the first refusal above says what is missing)"
    flags = dict(flag.partition("=")[::2] for flag in given_flags(data))
    for remedy in found.remedies:
        if remedy.startswith("leave out"):
            flags |= _without_velocity(flags, found)
        elif remedy.startswith("--rate-hz") and data.rate_hz is None:
            flags |= {"--time": "none", "--rate-hz": remedy.partition("=")[2]}
        elif remedy.startswith("--"):
            flags |= dict([remedy.partition("=")[::2]])
    clock = "doctor-force" in found.remedies
    line = [flag + ("=" if value else "") + value for flag, value in flags.items()]
    end = "-o clean.csv" if clock else "-o skill.json"
    return " ".join(["comanip", "doctor-force" if clock else "learn", _named(files), *line, end])


def _without_velocity(flags: dict[str, str], found: Checkup) -> dict[str, str]:
    """Position and force by name, without --velocity: where they were recognised, the velocity would be again."""
    flags.pop("--velocity", None)
    named = {}
    for note in (n for lesson in found.lessons for n in lesson.notes):
        if recognised := _RECOGNISED.fullmatch(note):
            named[f"--{recognised[2]}"] = recognised[1].replace(", ", ",")
    return {k: v for k, v in named.items() if k not in flags and k != "--velocity"}


def _named(files: Sequence[Path]) -> str:
    return " ".join(f"'{f}'" if " " in str(f) else str(f) for f in files)


def given_flags(data: DataFlags) -> list[str]:
    """The data flags as they were given on the line."""
    found = []
    for one in fields(DataFlags):
        value, flag = getattr(data, one.name), "--" + one.name.replace("_", "-")
        if value is None or value == one.default:
            continue
        if value is True:
            found.append(flag)
        else:
            found += [f"{flag}={_quoted(v)}" for v in (value if isinstance(value, list) else [value])]
    return found


def _quoted(value: Any) -> str:
    text = str(value)
    return text if text.replace("_", "").replace(",", "").replace(".", "").replace("-", "").isalnum() else f"'{text}'"


def _print(result: dict[str, Any]) -> None:
    if "skill" in result:
        _print_skill(result)
    elif "columns" in result:
        _print_columns(result)
    elif "checkup" in result:
        _print_checkup(result["checkup"])
    else:
        _print_recording(result)


def _print_columns(result: dict[str, Any]) -> None:
    rows = [
        (
            c.name,
            c.unit,
            *((c.frames, f"{c.low:.4g}", f"{c.high:.4g}", c.bad or "") if not c.problem else ("", "", "", c.problem)),
            c.suggests,
        )
        for c in result["listed"]
    ]
    table(f"{result['columns']}: columns", ("column", "unit", "frames", "min", "max", "not finite", "looks like"), rows)
    if "refused" in result:
        say(f"not read: {result['refused']}")
        say("choose columns with --position, --force, --velocity, --time (or --rate-hz) and inspect again")


def _print_checkup(result: dict[str, Any]) -> None:
    told = [f for f in result["findings"] if f["rank"] == "told"]
    for finding in result["findings"]:
        if finding["rank"] != "told":
            remedy = f" [{finding['remedy']}]" if finding["remedy"] else ""
            say(f"{finding['rank']}: {finding['text']}{remedy}")
    for finding in told:
        say(f"note: {finding['text']}")
    if len(told) == len(result["findings"]):
        say(f"{result['lessons']} lessons: nothing suspicious was found")
    if result["advice"]:
        say(f"next: {result['advice']}")


def _states(learned: LearnedSkill) -> list[dict[str, Any]]:
    """One entry a state: centre, spread, and the slope of velocity on force, the sign of a role."""
    from ..models.gmr import Regression
    from ..models.stability import PARTNERS, stability

    model, found = learned.model, stability(learned.model)
    regression = Regression(model, [c for c in model.channels if not c.startswith("velocity.")], "velocity")
    force = [i for i, c in enumerate(regression.inputs) if c.startswith("force.")]
    spread = np.sqrt(np.einsum("kii->ki", model.covariances))
    stay = np.diag(model.transition)
    return [
        {
            "state": k + 1,  # as in pictures: from 1, in order of time
            "mean": dict(zip(model.channels, model.means[k].tolist(), strict=True)),
            "std": dict(zip(model.channels, spread[k].tolist(), strict=True)),
            "expected_duration_s": float(learned.dt / max(1.0 - stay[k], 1e-12)) if stay[k] < 1.0 else None,
            "velocity_per_force": regression.gains[k][:, force].tolist() if force else None,
            "contraction_per_s": float(found.contraction[k]),
            "loop_gain": {f"{p.stiffness_n_per_m:g} N/m": _finite(g) for p, g in zip(PARTNERS, found.loop_gain[k], strict=True)},
        }
        for k in range(model.n_states)
    ]


def _finite(value: float) -> float | str:
    return float(value) if np.isfinite(value) else "unstable"


def _contents(recording: Any) -> dict[str, Any]:
    channels = {}
    for name, c in recording.channels.items():
        gaps = np.diff(c.time)
        channels[name] = {
            "axes": list(c.axes),
            "unit": c.unit,
            "frame": c.frame,
            "frames": len(c.time),
            "rate_hz": float(1.0 / np.median(gaps)) if len(gaps) else None,
            "min": np.min(c.values, axis=0).tolist() if len(c.time) else [],
            "max": np.max(c.values, axis=0).tolist() if len(c.time) else [],
        }
    return {"duration_s": recording.duration_s, "channels": channels, "metadata": dict(recording.metadata)}


def _print_skill(result: dict[str, Any]) -> None:
    say(
        f"{result['skill']}: {result['role'] or 'role not stated'}, law {result['law']}, {len(result['states'])} states, "
        f"{len(result['lessons'])} lessons at {result['rate_hz']:g} Hz"
    )
    channels = result["channels"]
    own = [
        (unit_of(result["units"], "velocity", i, "m/s"), unit_of(result["units"], "force", i, "N"))
        for i in range(len(result["axes"]))
    ]
    answers = [slope_scale(*one) for one in own]
    answer = ", ".join(dict.fromkeys(one.unit for one in answers))
    rows = []
    for s in result["states"]:
        cells = [f"{s['mean'][c]:+.3f} ± {s['std'][c]:.3f}" for c in channels]
        slope = s["velocity_per_force"]
        along = " ".join(f"{one.factor * row[i]:+.1f}" for i, (one, row) in enumerate(zip(answers, slope or (), strict=False)))
        gains = " ".join(g if isinstance(g, str) else f"{g:.2g}" for g in list(s["loop_gain"].values())[-1:])
        rows.append((s["state"], *cells, along, f"{s['contraction_per_s']:+.2g}", gains))
    table("States", ("state", *channels, f"∂v/∂F {answer}", "∂v/∂x 1/s", "loop gain"), rows)
    for line in explained(("∂v/∂F", "∂v/∂x", "loop gain")):
        say(line)
    print_notes(result["notes"])


def _print_recording(result: dict[str, Any]) -> None:
    rows = [
        (
            name,
            ",".join(c["axes"]),
            c["unit"] or "?",
            c["frames"],
            f"{c['rate_hz']:.4g}" if c["rate_hz"] else "",
            " ".join(f"{v:.3g}" for v in c["min"]),
            " ".join(f"{v:.3g}" for v in c["max"]),
        )
        for name, c in result["channels"].items()
    ]
    title = f"{result['recording']} ({result['duration_s']:.2f} s)"
    table(title, ("channel", "axes", "unit", "frames", "rate Hz", "min", "max"), rows)


def _draw(plot: Path, skills: dict[Path, LearnedSkill], recordings: Sequence[Recording]) -> None:
    from ..evaluation import drawing as figures
    from ..evaluation.checkup_picture import checkup_picture

    if skills:
        figures.save(figures.skills({path.stem: s for path, s in skills.items()}), plot)
    else:
        figures.save(checkup_picture(recordings), plot)
