"""learn, evaluate, classify, inspect, convert."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ParameterError
from ..learned import file as skill_file
from ..learned.learn import learn as learn_skill
from ..learned.learn import states_of
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..parts import holding_several
from .console import note, print_json, print_notes, progress, say, say_if_slow, stages, table
from .flags import DataFlags, LearnFlags
from .outputs import may_write
from .reading import beyond_memory, read_each, read_lessons, read_recordings, reader_of
from .units import scale_of, unit_of
from .words import explained

if TYPE_CHECKING:
    from ..evaluation.prediction import Prediction


def learn(files: Sequence[Path], out: Path, data: DataFlags, flags: LearnFlags, overwrite: bool, json: bool) -> None:
    may_write([out], inputs=files, overwrite=overwrite)
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
        **summary(learned),
        "read_s": round(read_s, 4),
        "learn_s": round(learn_s, 4),
    }
    if json:
        print_json(result)
        return
    model, what = learned.model, learned.provenance
    say(
        f"{out}: {learned.role or 'role not stated'}, law {learned.law}, {model.n_states} states over {', '.join(model.channels)}"
    )
    say(
        f"learned from {len(lessons)} recordings, {what['n_frames']} frames at {1 / learned.dt:g} Hz, in {learn_s:.2f} s; "
        f"log-likelihood per frame {what['log_likelihood'][-1] / what['n_frames']:.3f}"
    )
    print_notes(learned.notes)


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
            checkpoint=flags.checkpoint, allow_constant=flags.allow_constant, n_jobs=flags.workers or -1, progress=report,
        )  # fmt: skip
    learn_s = time.perf_counter() - started
    skill_file.save(learned, out)
    if json:
        print_json({"skill": str(out), **summary(learned), "learn_s": round(learn_s, 4)})
        return
    what = learned.provenance
    say(f"{out}: {learned.role or 'role not stated'}, law {learned.law}, {learned.model.n_states} states over {', '.join(names)}")
    say(f"learned from {len(paths)} files, {what['n_frames']} frames at {1 / dt:g} Hz, in {learn_s:.1f} s")
    print_notes(learned.notes)


def evaluate(files: Sequence[Path], leave_one_out: bool, data: DataFlags, flags: LearnFlags, json: bool) -> None:
    from ..evaluation import prediction
    from ..evaluation.forecasting import leave_one_out as foreseen

    if leave_one_out:
        if files and files[0].suffix == ".json":
            raise ParameterError(f"{files[0]}: --leave-one-out learns its own skills; give recordings only")
        lessons = read_lessons(files, data)
        say_if_slow()
        learn_on = _learner(flags, role=data.role, shares=len(lessons))
        fitting = {"topology": flags.topology, "allow_constant": flags.allow_constant}
        with progress("learning on the others") as report:
            found = prediction.leave_one_out(lessons, progress=report, choose=True, learn_on=learn_on, **fitting)
        forecasts = foreseen(lessons, learn_on, prediction.takes_of(lessons))
        source = "leave-one-out"
    else:
        if len(files) < 2:
            raise ParameterError("give a skill file and recordings: comanip evaluate skill.json lesson*.csv, or --leave-one-out")
        learned = skill_file.load(files[0])
        lessons = read_each(files[1:], _at_rate(data, learned))
        found, forecasts = [prediction.predict(learned, lesson) for lesson in lessons], []
        source = str(files[0])
    units = learned.units if not leave_one_out else lessons[0].units
    overall, medians = prediction.overall(found), prediction.medians(found)
    if json:
        about = {"overall": overall, "median": medians, "units": dict(units)}
        told = [p._asdict() | ({"forecast": forecasts[i]._asdict()} if forecasts else {}) for i, p in enumerate(found)]
        print_json({"skill": source, "files": told, **about})
        return
    _print_predictions(source, found, (overall, medians), units)
    _print_beside(found, medians, units)
    if forecasts:
        _print_forecasts(forecasts, units)
    if len(lessons[0].axes) > 1:
        _print_axes(found, lessons[0].axes, units)
    words = ("one-step R²", "free run", "log p per frame", "v(t−1)", "persistence", *(("forecast",) if forecasts else ()))
    for line in explained(words):
        say(line)


def _print_predictions(
    source: str, found: Sequence[Prediction], typical: tuple[Mapping[str, float], Mapping[str, float]], units: Mapping[str, str]
) -> None:
    """A row a recording, or a fragment of one that was cut at gaps (name#0, name#1), then mean and median over them."""
    from ..evaluation.prediction import OVERALL

    speed, place = scale_of(units.get("velocity", "m/s")), scale_of(units.get("position", "m"))

    def cells(r2: float, rmse: float, path: float, end: float, likelihood: float) -> list[str]:
        return [f"{r2:.3f}", speed.shown(rmse), place.shown(path), place.shown(end), f"{likelihood:.2f}"]

    rows = [(p.name, p.frames, *cells(*(getattr(p, name) for name in OVERALL))) for p in found]
    footers = [(n, "", *cells(*(t[name] for name in OVERALL))) for n, t in zip(("mean", "median"), typical, strict=True)]
    distances = (f"free run RMSE {place.unit}", f"end error {place.unit}")
    columns = ("recording", "frames", "one-step R²", f"RMSE {speed.unit}", *distances, "log p per frame")
    table(f"Prediction ({source})", columns, rows, footers=footers)
    if fragments := [p.name for p in found if "#" in p.name]:
        say(f"{len(fragments)} of {len(found)} rows are fragments of recordings that were cut at gaps: {', '.join(fragments)}")
    if still := [p.name for p in found if p.one_step_velocity_r2 != p.one_step_velocity_r2]:
        say(f"nothing moves in {', '.join(still)}: no R² there, and means are over the others")


def _print_beside(found: Sequence[Prediction], medians: Mapping[str, float], units: Mapping[str, str]) -> None:
    """The same figures of rules that know nothing of the task: what ours must be better than to be worth anything."""
    place = scale_of(units.get("position", "m"))
    chosen = [p.chosen for p in found if p.chosen]
    own = (("skill_velocity_r2",), ("skill_path_rmse_m",), ("skill's",)) if chosen else ((), (), ())
    figures = ("one_step_velocity_r2", *own[0], "last_velocity_r2")
    lengths = ("free_run_position_rmse_m", *own[1], "standing_still_rmse_m", "mean_lesson_rmse_m")
    likelihoods = ("log_likelihood_per_frame", "persistence_log_likelihood_per_frame")

    def cells(p: Mapping[str, Any]) -> list[str]:
        return [
            *(_known(p[n], f"{p[n]:.4f}") for n in figures),
            *(_known(p[n], place.shown(p[n])) for n in lengths),
            *(_known(p[n], f"{p[n]:.2f}") for n in likelihoods),
        ]

    ways = (f"free run {place.unit}: ours", *own[2], "still", "mean lesson")
    columns = ("recording", "R²: ours", *own[2], "v(t−1)", *ways, "log p: ours", "persistence")
    rows = [(p.name, *cells(p._asdict())) for p in found]
    table("Beside it", columns, rows, footers=[("median", *cells(medians))])
    for rule in dict.fromkeys(chosen):
        say(f"ours, as the other lessons choose ({chosen.count(rule)} of {len(found)}): {rule}")


def _known(value: float, shown: str) -> str:
    return shown if value == value else "-"


def _print_forecasts(forecasts: Sequence[Any], units: Mapping[str, str]) -> None:
    place = scale_of(units.get("position", "m"))
    rows = []
    for h, horizon in enumerate(forecasts[0].horizons_s):
        several = [[getattr(f, name)[h] for f in forecasts] for name in ("ours", "ridge", "rmse_m")]
        if np.isnan(several[0]).all():
            continue
        ours, ridge, rmse = (float(np.nanmedian(values)) for values in several)
        rows.append((f"{horizon:g} s", f"{ours:.3f}", f"{ridge:.3f}", place.shown(rmse)))
    table("Forecasts, median over the recordings", ("after", "forecast: ours", "ridge", f"RMSE of ours {place.unit}"), rows)


def _print_axes(found: Sequence[Prediction], axes: Sequence[str], units: Mapping[str, str]) -> None:
    from ..evaluation.prediction import PER_AXIS

    rows = []
    for i, axis in enumerate(axes):
        speed, place = (scale_of(unit_of(units, group, i, usual)) for group, usual in (("velocity", "m/s"), ("position", "m")))
        r2, rmse, path = (float(np.nanmedian([getattr(p, n)[i] for p in found])) for n in PER_AXIS)
        rows.append((axis, f"{r2:.3f}", f"{speed.shown(rmse)} {speed.unit}", f"{place.shown(path)} {place.unit}"))
    table("By axis, median over the recordings", ("axis", "one-step R²", "RMSE", "free run RMSE"), rows)


def classify(files: Sequence[Path], skills: Sequence[Path], after_s: float | None, data: DataFlags, json: bool) -> None:
    from ..evaluation.recognition import recognise

    if len(skills) < 2:
        raise ParameterError("give at least two skills to tell apart: --skill leader.json --skill follower.json")
    learned = [skill_file.load(path) for path in skills]
    names = [str(path) for path in skills]
    found: list[dict[str, Any]] = []
    for lesson in read_each(files, _at_rate(data, learned[0])):
        seen = recognise(learned, lesson, after_s=after_s)
        found.append(
            {
                "name": lesson.name,
                "posterior": dict(zip(names, seen.posterior.tolist(), strict=True)),
                "none": seen.none,
                "score_per_frame": dict(zip(names, seen.scores.tolist(), strict=True)),
                "unit": seen.unit,
                "best": NEITHER if seen.best is None else names[seen.best],
            }
        )
    if json:
        print_json({"files": found})
        return
    rows = [(e["name"], *(f"{e['posterior'][n]:.3f}" for n in names), f"{e['none']:.3f}", _stem(e["best"])) for e in found]
    stems = [Path(n).stem for n in names]
    until = "" if after_s is None else f" after {after_s:g} s"
    table(f"Probability of each skill{until}", ("recording", *stems, f"{NEITHER} of these", "shows"), rows)
    for line in explained(("probability", "neither")):
        say(line)
    if not seen.learned:
        say(
            "a skill without scores of lessons left out (an older file, a stream, other channels) has a doubt that is only stated"
        )


NEITHER = "neither"


def _stem(best: str) -> str:
    return best if best == NEITHER else Path(best).stem


def convert(file: Path, out: Path, data: DataFlags, overwrite: bool, json: bool) -> None:
    from ..formats import write, write_all
    from ..lessons.regrid import regridded

    if out.is_dir():
        may_write([out])
    recordings = read_recordings([file], data)
    if data.resample_hz is not None:
        recordings = [regridded(recording, data.resample_hz) for recording in recordings]
    several = len(recordings) > 1 and out.suffix.lower() not in holding_several()
    targets = [out.with_name(f"{out.stem}_{i + 1}{out.suffix}") for i in range(len(recordings))] if several else [out]
    may_write(targets, inputs=[file], overwrite=overwrite, flag="OUT")
    if several:
        for recording, target in zip(recordings, targets, strict=True):
            write(recording, target)
    else:
        write_all(recordings, out)
    if json:
        print_json({"written": [str(t) for t in targets]})
    elif len(targets) < len(recordings):
        print(f"{out}: {len(recordings)} recordings of {', '.join(recordings[0].channels)}")
    else:
        for target, recording in zip(targets, recordings, strict=True):
            say(f"{target}: {', '.join(recording.channels)}")


def _learner(flags: LearnFlags, *, role: str | None, shares: int) -> Callable[[list[Demonstration]], LearnedSkill]:
    """Learns from lessons as the flags say, from the same lessons once: whatever is chosen is chosen on these lessons alone."""
    known: dict[tuple[int, ...], LearnedSkill] = {}

    def learn_on(others: list[Demonstration]) -> LearnedSkill:
        key = tuple(id(x) for x in others)
        if key not in known:
            known[key] = learn_skill(others, **_options(others, flags, role=role, shares=shares))
        return known[key]

    return learn_on


def _options(
    lessons: Sequence[Demonstration], flags: LearnFlags, *, role: str | None, states: int | None = None, shares: int = 1
) -> dict[str, Any]:
    """Arguments of `learn`; `states` is a number that has been chosen already, one of so many `shares` of the time for it."""
    if states is None and flags.states == "auto":
        states = _choose_states(lessons, flags, role=role, shares=shares)
    elif states is None and flags.states in ("", "default"):
        states = states_of(flags.law, None, {})
    elif states is None:
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
        "allow_constant": flags.allow_constant,
        "rng": np.random.default_rng(flags.seed),
    }


def _choose_states(lessons: Sequence[Demonstration], flags: LearnFlags, *, role: str | None, shares: int) -> int:
    """By the figures that `evaluate` prints, of lessons left out; of one lesson by the information criterion."""
    from ..evaluation.choosing import BUDGET_S, choose_states
    from ..evaluation.takes import takes_of

    say_if_slow()
    usual = states_of(flags.law, None, {})
    if len(set(takes_of(lessons))) < 2:
        return _by_criterion(lessons, flags)
    learning = {k: v for k, v in _options(lessons, flags, role=role, states=usual).items() if k not in ("n_states", "rng")}
    with progress("choosing the number of states") as report:
        chosen = choose_states(lessons, usual=usual, progress=report, budget_s=BUDGET_S / shares, **{**learning, "restarts": 1})
    note(str(chosen))
    return chosen.n_states


def _by_criterion(lessons: Sequence[Demonstration], flags: LearnFlags) -> int:
    from ..fitting.selection import select_states

    groups = ("position", "velocity") if flags.no_force else ("position", "force", "velocity")
    channels = [c for c in lessons[0].channels if c.split(".")[0] in groups]
    frames = [lesson.array(channels) for lesson in lessons]
    chosen = select_states(frames, range(3, 13), channels=channels, criterion="bic", topology=flags.topology)
    note(f"states: {chosen.n_states} of 3..12 by BIC: nothing can be left out of one recording")
    return chosen.n_states


def _at_rate(data: DataFlags, learned: LearnedSkill) -> DataFlags:
    """The skill's rate unless the flags say otherwise: recordings are resampled to it, and their notes say so."""
    from dataclasses import replace

    return data if data.resample_hz is not None else replace(data, resample_hz=1.0 / learned.dt)


def summary(learned: LearnedSkill) -> dict[str, Any]:
    what = learned.provenance
    return {
        "role": learned.role,
        "law": learned.law,
        "states": learned.model.n_states,
        "channels": list(learned.model.channels),
        "axes": list(learned.axes),
        "units": dict(learned.units),
        "settings": dict(learned.settings),
        "rate_hz": 1.0 / learned.dt,
        "lessons": what.get("lessons", []),
        "log_likelihood": what.get("log_likelihood", [None])[-1],
        "iterations": len(what.get("log_likelihood", [])) - 1,
        "converged": what.get("converged"),
        "bic": what.get("bic"),
        "notes": list(learned.notes),
    }
