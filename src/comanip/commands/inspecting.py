"""inspect: what recordings and skill files hold, and everything that is the matter with them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ChannelError, ComanipError, RecordingError, SkillFileError
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..recording import Recording
from .advising import Advice, next_command, propose
from .console import print_json, print_notes, say, table
from .flag_words import in_flags
from .flags import DataFlags
from .learning import summary
from .outputs import may_draw
from .reading import preparation_of, read_recordings
from .units import slope_scale, unit_of
from .words import explained

if TYPE_CHECKING:
    from ..formats.listing import Column

_RANKS = ("refused", "suspicious", "told")


def inspect(files: Sequence[Path], plot: Path | None, data: DataFlags, overwrite: bool, json: bool) -> None:
    may_draw(plot, inputs=files, overwrite=overwrite)
    skills = {file: skill_file.load(file) for file in files if file.suffix == ".json"}
    if plot is not None and skills and len(skills) < len(files):
        raise SkillFileError("--plot draws skills or recordings, not both at once")
    results: list[dict[str, Any]] = [{"skill": str(f), **summary(s), "states": _states(s)} for f, s in skills.items()]
    recordings: list[Recording] = []
    columns: tuple[Column, ...] = ()
    refused = False
    for file in files:
        if file not in skills:
            entries, found, seen = _of_file(file, data)
            results += _unlike(entries, results)
            recordings += found
            columns, refused = columns or seen, refused or not found
    others = [f for f in files if f not in skills]
    if others:
        results.append({"checkup": _checked(recordings, others, data, columns, refused)})
    if plot is not None:
        _draw(plot, skills, recordings)
    if json:
        print_json(results)
        return
    for result in results:
        _print(result)
    if plot is not None:
        say(f"drawn into {plot}")


def _unlike(entries: list[dict[str, Any]], before: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries to print; of files with the same columns those are listed once."""
    seen = {tuple(c.name for c in e["listed"]) for e in before if e.get("listed")}
    return [{**e, "listed": []} if "listed" in e and tuple(c.name for c in e["listed"]) in seen else e for e in entries]


def _of_file(file: Path, data: DataFlags) -> tuple[list[dict[str, Any]], list[Recording], tuple[Column, ...]]:
    """(entries to print, recordings, columns): columns where no mapping was given and the file has some to choose from."""
    columns = _columns(file, data)
    try:
        recordings = read_recordings([file], data)
    except (ChannelError, RecordingError) as refused:
        if not columns:
            raise
        return [_listing(file, columns, in_flags(str(refused)))], [], columns
    entries = [{"recording": str(file), **_contents(recording)} for recording in recordings]
    listing = [_listing(file, columns)] if columns and not _own_table(recordings) else []
    return entries + listing, recordings, columns


def _listing(file: Path, columns: Sequence[Column], refused: str = "") -> dict[str, Any]:
    from ..formats.listing import listed

    return {"columns": str(file), "listed": list(listed(columns)), **({"refused": refused} if refused else {})}


def _own_table(recordings: Sequence[Recording]) -> bool:
    """Whether the channels' own table says all that a list of columns would: topics of a bag, each with its axes."""
    return any(not name.startswith("hand.") and name != "events" for r in recordings for name in r.channels)


def _columns(file: Path, data: DataFlags) -> tuple[Column, ...]:
    from ..formats.listing import look

    mapped = data.mapping is not None or any((data.position, data.velocity, data.force, data.sensor_force))
    return () if mapped or not file.exists() else look(file)


def _checked(
    recordings: Sequence[Recording], files: Sequence[Path], data: DataFlags, columns: Sequence[Column], refused: bool
) -> dict[str, Any]:
    """Findings and the next command; where nothing was read, or nothing that a lesson can be made of, a guess at the mapping."""
    from ..lessons.checkup import checkup

    findings: list[dict[str, Any]] = []
    found = None
    if recordings:
        try:
            found = checkup(recordings, preparation_of(data))
        except ComanipError as wrong:
            findings = [{"rank": _RANKS[0], "text": in_flags(str(wrong)), "remedy": ""}]
    if found is not None:
        findings = [{"rank": _RANKS[f.rank], "text": in_flags(f.text), "remedy": f.remedy} for f in found.findings]
    said = next_command(found, files, data, columns) if found is not None and not refused else Advice("")
    if not said.command and columns:
        said = propose(files, data, columns)
    lessons = len(found.lessons) if found is not None else 0
    return {"findings": findings, "lessons": lessons, "advice": said.command, "on_advice": list(said.notes)}


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
    if rows:
        table(f"{result['columns']}: columns", ("column", "unit", "frames", "min", "max", "not finite", "looks like"), rows)
    if "refused" in result:
        say(f"not read: {result['refused']}")


def _print_checkup(result: dict[str, Any]) -> None:
    told = [f for f in result["findings"] if f["rank"] == "told"]
    for finding in result["findings"]:
        if finding["rank"] != "told":
            remedy = f" [{finding['remedy']}]" if finding["remedy"] else ""
            say(f"{finding['rank']}: {finding['text']}{remedy}")
    for finding in told:
        say(f"note: {finding['text']}")
    if result["lessons"] and len(told) == len(result["findings"]):
        say(f"{result['lessons']} lessons: nothing suspicious was found")
    for line in result["on_advice"]:
        say(line)
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
