"""learn, evaluate, classify, inspect, convert."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError, SkillFileError
from ..learned import file as skill_file
from ..learned.skill import LAWS, STATES, LearnedSkill
from ..learned.skill import learn as learn_skill
from ..lessons.demonstration import Demonstration
from .console import print_json, progress, say_if_slow, stages, table
from .flags import DataFlags, LearnFlags
from .reading import beyond_memory, read_each, read_lessons, read_recordings, reader_of


def learn(files: Sequence[Path], out: Path, data: DataFlags, flags: LearnFlags, json: bool) -> None:
    if flags.stream or flags.checkpoint or flags.stepwise or beyond_memory(files):
        _learn_stream(files, out, data, flags, json)
        return
    started = time.perf_counter()
    lessons = read_lessons(files, data)
    read_s = time.perf_counter() - started
    options = _options(lessons, flags, role=data.role)
    say_if_slow()
    started = time.perf_counter()
    learned = learn_skill(lessons, **options)
    learn_s = time.perf_counter() - started
    skill_file.save(learned, out)
    result = {
        "skill": str(out),
        **_summary(learned),
        "read_s": round(read_s, 4),
        "learn_s": round(learn_s, 4),
    }
    if json:
        print_json(result)
        return
    model, what = learned.model, learned.provenance
    print(
        f"{out}: {learned.role or 'role not stated'}, law {learned.law}, {model.n_states} states over {', '.join(model.channels)}"
    )
    print(
        f"learned from {len(lessons)} recordings, {what['n_frames']} frames at {1 / learned.dt:g} Hz, in {learn_s:.2f} s; "
        f"log-likelihood per frame {what['log_likelihood'][-1] / what['n_frames']:.3f}"
    )
    _print_notes(learned.notes)


def _learn_stream(files: Sequence[Path], out: Path, data: DataFlags, flags: LearnFlags, json: bool) -> None:
    from ..learned.stream import learn_stream
    from ..lessons.shards import files_of

    if flags.states == "auto" or flags.restarts != 1:
        raise ParameterError("--states auto and --restarts need data in memory; try them on some of the files without --stream")
    if flags.states not in ("", "default") and not flags.states.isdigit():
        raise ParameterError(f"--states {flags.states!r}; give a number")
    paths = files_of(files)
    read, names, dt = reader_of(files, paths, data, with_force=not flags.no_force)
    say_if_slow()
    started = time.perf_counter()
    with stages() as report:
        learned = learn_stream(
            paths, read=read, channels=names, dt=dt, role=data.role or "", law=flags.law, topology=flags.topology,
            n_states=int(flags.states) if flags.states.isdigit() else None, stepwise_passes=flags.stepwise,
            checkpoint=flags.checkpoint, n_jobs=flags.workers or -1, progress=report,
        )  # fmt: skip
    learn_s = time.perf_counter() - started
    skill_file.save(learned, out)
    if json:
        print_json({"skill": str(out), **_summary(learned), "learn_s": round(learn_s, 4)})
        return
    what = learned.provenance
    print(
        f"{out}: {learned.role or 'role not stated'}, law {learned.law}, {learned.model.n_states} states over {', '.join(names)}"
    )
    print(f"learned from {len(paths)} files, {what['n_frames']} frames at {1 / dt:g} Hz, in {learn_s:.1f} s")
    _print_notes(learned.notes)


def evaluate(files: Sequence[Path], leave_one_out: bool, data: DataFlags, flags: LearnFlags, json: bool) -> None:
    from ..evaluation import prediction

    if leave_one_out:
        if files and files[0].suffix == ".json":
            raise ParameterError(f"{files[0]}: --leave-one-out learns its own skills; give recordings only")
        lessons = read_lessons(files, data)
        say_if_slow()
        with progress("learning on the others") as report:
            found = prediction.leave_one_out(lessons, progress=report, **_options(lessons, flags, role=data.role))
        source = "leave-one-out"
    else:
        if len(files) < 2:
            raise ParameterError("give a skill file and recordings: comanip evaluate skill.json lesson*.csv, or --leave-one-out")
        learned = skill_file.load(files[0])
        lessons = read_each(files[1:], _at_rate(data, learned))
        found = [prediction.predict(learned, lesson) for lesson in lessons]
        source = str(files[0])
    overall = prediction.overall(found)
    if json:
        print_json({"skill": source, "files": [p._asdict() for p in found], "overall": overall})
        return
    rows = [
        (
            p.name,
            p.frames,
            f"{p.one_step_velocity_r2:.3f}",
            f"{1000 * p.one_step_velocity_rmse:.1f}",
            f"{100 * p.free_run_position_rmse_m:.2f}",
            f"{100 * p.free_run_end_error_m:.2f}",
            f"{p.log_likelihood_per_frame:.2f}",
        )
        for p in found
    ]
    names = ("recording", "frames", "one-step R²", "RMSE mm/s", "free run RMSE cm", "end error cm", "log p per frame")
    footer = (
        "mean",
        "",
        f"{overall['one_step_velocity_r2']:.3f}",
        f"{1000 * overall['one_step_velocity_rmse']:.1f}",
        f"{100 * overall['free_run_position_rmse_m']:.2f}",
        f"{100 * overall['free_run_end_error_m']:.2f}",
        f"{overall['log_likelihood_per_frame']:.2f}",
    )
    table(f"Prediction ({source})", names, rows, footer=footer)


def classify(files: Sequence[Path], skills: Sequence[Path], data: DataFlags, json: bool) -> None:
    from ..evaluation import prediction

    if len(skills) < 2:
        raise ParameterError("give at least two skills to tell apart: --skill leader.json --skill follower.json")
    learned = [skill_file.load(path) for path in skills]
    lessons = read_each(files, _at_rate(data, learned[0]))
    names = [str(path) for path in skills]
    found: list[dict[str, Any]] = [
        {"name": lesson.name, "posterior": dict(zip(names, prediction.classify(learned, lesson).tolist(), strict=True))}
        for lesson in lessons
    ]
    for entry in found:
        entry["best"] = max(entry["posterior"], key=entry["posterior"].__getitem__)
    if json:
        print_json({"files": found})
        return
    rows = [(e["name"], *[f"{e['posterior'][n]:.4f}" for n in names], Path(e["best"]).stem) for e in found]
    table("Posterior of each skill", ("recording", *[Path(n).stem for n in names], "shows"), rows)


def inspect(files: Sequence[Path], plot: Path | None, data: DataFlags, json: bool) -> None:
    results: list[dict[str, Any]] = []
    skills = {file: skill_file.load(file) for file in files if file.suffix == ".json"}
    recordings = [(file, r) for file in files if file not in skills for r in read_recordings([file], data)]
    for file, learned in skills.items():
        results.append({"skill": str(file), **_summary(learned), "states": _states(learned)})
    for file, recording in recordings:
        results.append({"recording": str(file), **_contents(recording)})
    if plot is not None:
        _draw(plot, skills, [f for f in files if f not in skills], data)
    if json:
        print_json(results)
        return
    for result in results:
        _print_skill(result) if "skill" in result else _print_recording(result)
    if plot is not None:
        print(f"drawn into {plot}")


def convert(file: Path, out: Path, data: DataFlags, json: bool) -> None:
    from ..formats import write, write_all
    from ..lessons.regrid import regridded

    recordings = read_recordings([file], data)
    if data.resample_hz is not None:
        recordings = [regridded(recording, data.resample_hz) for recording in recordings]
    if len(recordings) > 1 and out.suffix.lower() not in HOLD_SEVERAL:
        targets = [out.with_name(f"{out.stem}_{i + 1}{out.suffix}") for i in range(len(recordings))]
        for recording, target in zip(recordings, targets, strict=True):
            write(recording, target)
    else:
        targets = [out]
        write_all(recordings, out)
    if json:
        print_json({"written": [str(t) for t in targets]})
    elif len(targets) < len(recordings):
        print(f"{out}: {len(recordings)} recordings of {', '.join(recordings[0].channels)}")
    else:
        print("\n".join(f"{t}: {', '.join(r.channels)}" for t, r in zip(targets, recordings, strict=True)))


HOLD_SEVERAL = (".hdf5", ".h5", ".lerobot")  # formats of which one file or folder holds many recordings


def _options(lessons: Sequence[Demonstration], flags: LearnFlags, *, role: str | None) -> dict[str, Any]:
    if flags.law not in LAWS:
        raise ParameterError(f"law {flags.law!r} is unknown; there are: {', '.join(LAWS)}")
    states: int | None
    if flags.states == "auto":
        states = _choose_states(lessons, flags)
    elif flags.states in ("", "default"):
        states = STATES[flags.law]
    else:
        try:
            states = int(flags.states)
        except ValueError:
            raise ParameterError(f"--states {flags.states!r}; give a number, or auto") from None
    return {
        "n_states": states,
        "law": flags.law,
        "role": role,
        "with_force": not flags.no_force,
        "topology": flags.topology,
        "restarts": flags.restarts,
        "rng": np.random.default_rng(flags.seed),
    }


def _choose_states(lessons: Sequence[Demonstration], flags: LearnFlags) -> int:
    from ..fitting.selection import select_states

    say_if_slow()
    groups = ("position", "velocity") if flags.no_force else ("position", "force", "velocity")
    channels = [c for c in lessons[0].channels if c.split(".")[0] in groups]
    chosen = select_states(
        [lesson.array(channels) for lesson in lessons],
        range(3, 13),
        channels=channels,
        criterion="cross-validation" if len(lessons) > 1 else "bic",
        topology=flags.topology,
    )
    print(f"states: {chosen.n_states} of 3..12", file=sys.stderr)
    return chosen.n_states


def _at_rate(data: DataFlags, learned: LearnedSkill) -> DataFlags:
    """The skill's rate unless the flags say otherwise: recordings are resampled to it, and their notes say so."""
    from dataclasses import replace

    return data if data.resample_hz is not None else replace(data, resample_hz=1.0 / learned.dt)


def _summary(learned: LearnedSkill) -> dict[str, Any]:
    what = learned.provenance
    return {
        "role": learned.role,
        "law": learned.law,
        "states": learned.model.n_states,
        "channels": list(learned.model.channels),
        "axes": list(learned.axes),
        "rate_hz": 1.0 / learned.dt,
        "lessons": what.get("lessons", []),
        "log_likelihood": what.get("log_likelihood", [None])[-1],
        "iterations": len(what.get("log_likelihood", [])) - 1,
        "converged": what.get("converged"),
        "bic": what.get("bic"),
        "notes": list(learned.notes),
    }


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
            "state": k,
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
    print(
        f"{result['skill']}: {result['role'] or 'role not stated'}, law {result['law']}, {len(result['states'])} states, "
        f"{len(result['lessons'])} lessons at {result['rate_hz']:g} Hz"
    )
    channels = result["channels"]
    rows = []
    for s in result["states"]:
        cells = [f"{s['mean'][c]:+.3f} ± {s['std'][c]:.3f}" for c in channels]
        slope = s["velocity_per_force"]
        along = " ".join(f"{1000 * row[i]:+.1f}" for i, row in enumerate(slope or ()))
        gains = " ".join(g if isinstance(g, str) else f"{g:.2g}" for g in list(s["loop_gain"].values())[-1:])
        rows.append((s["state"], *cells, along, f"{s['contraction_per_s']:+.2g}", gains))
    table("States", ("state", *channels, "∂v/∂F mm/s/N", "∂v/∂x 1/s", "loop gain, 600 N/m"), rows)
    print("∂v/∂x < 0 contracts; loop gain of eq. (5) with a partner of 600 N/m: below 1 is stable (the default law has its own)")
    _print_notes(result["notes"])


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
    _print_notes(result["metadata"].get("notes", ()))


def _print_notes(notes: Sequence[str]) -> None:
    for note in notes:
        print(f"note: {note}")


def _draw(plot: Path, skills: dict[Path, LearnedSkill], files: Sequence[Path], data: DataFlags) -> None:
    from ..evaluation import drawing as figures

    if skills and files:
        raise SkillFileError("--plot draws skills or recordings, not both at once")
    if skills:
        figures.save(figures.skills({path.stem: s for path, s in skills.items()}), plot)
    else:
        figures.save(figures.demonstrations(read_lessons(files, data)), plot)
