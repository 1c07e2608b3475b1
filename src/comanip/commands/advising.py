"""The next command: what `inspect` advises is a line that works as it is when it is pasted, and was tried before it was said."""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import ComanipError, ComanipWarning
from .flags import DataFlags
from .reading import preparation_of, read_recordings

if TYPE_CHECKING:
    from ..formats.guessing import Guess
    from ..formats.listing import Column
    from ..lessons.checkup import Checkup

_TRIES = 8
STANDS_IN_HZ = 100.0  # for a rate that nothing in a file says
_SIGNALS = ("position", "velocity", "force", "sensor_force")


class Advice(NamedTuple):
    """The next command, and what must be known about it; "" where there is none."""

    command: str
    notes: tuple[str, ...] = ()


def next_command(found: Checkup, files: Sequence[Path], data: DataFlags, columns: Sequence[Column] = ()) -> Advice:
    """After a look at recordings from which lessons were made: learning, with the remedies of all findings, as far as they
    read; a force on another clock is set right first. Where `columns` has labels of takes, the file is cut by them."""
    found, data = _cut(found, files, data, columns)
    flags, looked = _mended(found, files, data)
    if not looked.lessons:
        return Advice("")
    verb, end, more = "learn", "-o skill.json", []
    if "doctor-force" in found.remedies:
        verb, end = "doctor-force", "-o clean.csv"
    elif any("force" not in lesson.signals for lesson in looked.lessons):
        if (guessed := propose(files, data, columns) if columns else None) and "--force=" in guessed.command:
            return guessed  # a force under a name of its own
        more = ["--no-force"]
    return Advice(" ".join(["comanip", verb, named(files), *given_flags(flags), *more, end]), _on_choices(looked))


def _cut(found: Checkup, files: Sequence[Path], data: DataFlags, columns: Sequence[Column]) -> tuple[Checkup, DataFlags]:
    from ..formats.guessing import labels

    named_labels = labels(columns)
    if not named_labels or data.segment_by:
        return found, data
    flags = replace(data, segment_by=",".join(named_labels))
    looked, _ = _looked(files, flags)
    return (looked, flags) if looked is not None and len(looked.lessons) > len(found.lessons) else (found, data)


def _on_choices(found: Checkup) -> tuple[str, ...]:
    if not any(f.remedy == "--tare" for f in found.findings):
        return ()
    return ("--tare-auto instead of --tare takes the force at rest off only where lessons left out are foreseen better by it",)


def propose(files: Sequence[Path], data: DataFlags, columns: Sequence[Column]) -> Advice:
    """For files that do not say what is what: `inspect` with a guess, which is read and checked before it is said."""
    from ..formats.guessing import guess

    guessed = guess(columns, stamped=any(c.stamped for c in columns))
    if guessed is None:
        return Advice("", ("nothing in it looks like a motion; name columns with --position, --force, --time or --rate-hz",))
    notes = [f"a guess {guessed.why}; look at it before you use it"]
    found = _that_reads(files, _flags(guessed, data, columns), notes)
    if found is None:
        return Advice("", (*notes, "it does not read as it is: change it, or name columns with --position, --force, --time"))
    return Advice(" ".join(["comanip inspect", named(files), *given_flags(found)]), tuple(notes))


def _flags(guessed: Guess, data: DataFlags, columns: Sequence[Column]) -> DataFlags:
    from ..formats.columns import recognise_time

    changes: dict[str, Any] = {kind: ",".join(names) for kind, names in guessed.signals.items()}
    try:
        plain = recognise_time([c.name for c in columns])
    except ComanipError:
        plain = None
    if guessed.time and guessed.time != plain and data.time is None:
        changes["time"] = guessed.time
    if guessed.angle and not any((data.position_unit, data.velocity_unit, data.force_unit)):
        changes |= _of_angles(guessed, columns)
    if guessed.rate_hz and data.rate_hz is None:
        changes["rate_hz"] = guessed.rate_hz
    if guessed.labels and data.segment_by is None:
        changes["segment_by"] = ",".join(guessed.labels)
    return replace(data, **changes)


def _of_angles(guessed: Guess, columns: Sequence[Column]) -> dict[str, str]:
    """Units of a turn, for what the file states none of."""
    stated = {c.name: c.unit for c in columns}
    units = {"position": guessed.angle, "velocity": f"{guessed.angle}/s", "force": "N m"}
    return {f"{k}_unit": units[k] for k, names in guessed.signals.items() if not any(stated.get(n) for n in names)}


def _that_reads(files: Sequence[Path], flags: DataFlags, notes: list[str]) -> DataFlags | None:
    """The flags, changed until the files are read with them and a lesson comes of it; None where that is not reached."""
    for _ in range(_TRIES):
        found, refusal = _looked(files, flags)
        if found is not None and found.lessons:
            mended, _ = _mended(found, files, flags)
            return mended
        refusal = refusal or next((f.text for f in found.findings if f.rank == 0), "") if found else refusal
        changed = _changed(refusal, flags, notes)
        if changed is None:
            return None
        flags = changed
    return None


def _changed(refusal: str, flags: DataFlags, notes: list[str]) -> DataFlags | None:
    """What a refusal asks for; None where it asks for nothing that can be guessed."""
    if "(--frame " in refusal:
        frame = refusal.split("(--frame ")[1].split("=")[0]
        given = [*(flags.frame or [])]
        if f"{frame}=hand" not in given:
            notes.append(f"frame {frame!r} is taken to turn with the hand; --frame {frame}=same where it does not")
            return replace(flags, frame=[*given, f"{frame}=hand"])
        return replace(flags, frame=[f"{frame}=same" if one == f"{frame}=hand" else one for one in given])
    if "no time column" in refusal and flags.rate_hz is None:
        notes.append(f"nothing says the rate: {STANDS_IN_HZ:g} Hz stands in the command for yours")
        return replace(flags, rate_hz=STANDS_IN_HZ)
    if "no 'hand.position'" in refusal and not flags.integrate_position:
        return replace(flags, integrate_position=True)
    for name in ("segment_by", "velocity", "force"):
        if getattr(flags, name):
            without: dict[str, Any] = {name: None}
            return replace(flags, **without)
    return None


def _looked(files: Sequence[Path], flags: DataFlags) -> tuple[Checkup | None, str]:
    """(what a checkup finds with these flags, or None and why they are not read)."""
    from ..lessons.checkup import checkup

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ComanipWarning)
        try:
            return checkup(read_recordings(files, flags), preparation_of(flags), clocks=False), ""
        except ComanipError as refused:
            return None, str(refused)


def _mended(found: Checkup, files: Sequence[Path], data: DataFlags) -> tuple[DataFlags, Checkup]:
    """The flags with every remedy, in turns: what a unit hides is seen when it is stated. What does not read is not added."""
    flags = data
    for _ in range(_TRIES):
        wanted = flags
        for remedy in found.remedies:
            wanted = _with_remedy(remedy, wanted, found)
        if wanted == flags:
            break
        for tried in (wanted, _without_units(wanted, flags)):  # a file that states its units takes no other
            looked, _ = _looked(files, tried)
            if looked is not None and looked.lessons:
                flags, found = tried, looked
                break
        else:
            break
    return _units_behind(flags), found


def _without_units(wanted: DataFlags, before: DataFlags) -> DataFlags:
    """Sizes as they are, where they were taken for another unit."""
    units = ("position_unit", "velocity_unit", "force_unit")
    changed = any(getattr(wanted, name) != getattr(before, name) for name in units)
    kept: dict[str, Any] = {name: getattr(before, name) for name in units}
    return replace(wanted, **kept, any_size=True) if changed else wanted


def _with_remedy(remedy: str, flags: DataFlags, found: Checkup) -> DataFlags:
    if remedy.startswith("leave out"):
        return _without_velocity(flags, found)
    if not remedy.startswith("--"):
        return flags
    name, _, value = remedy[2:].partition("=")
    name = name.replace("-", "_")
    if name == "rate_hz":
        return replace(flags, rate_hz=float(value), time="none" if _stamped(found) else flags.time)
    if name == "resample_hz":
        return replace(flags, resample_hz=float(value))
    if getattr(flags, name, None) not in (None, False) or (name.endswith("_unit") and _states_unit(flags, name)):
        return flags
    if name == "tare" and (flags.force_bias_n or flags.tare_auto):
        return flags
    if name == "position_unit" and _has_velocity(flags, found):
        return replace(flags, position_unit=value, velocity_unit=f"{value}/s")
    if name == "velocity_unit" and not flags.position_unit and not any("position" in r for r in found.remedies):
        return replace(flags, velocity_unit=value, position_unit=value.removesuffix("/s"))  # they agree as they stand
    mended: dict[str, Any] = {name: value or True}
    return replace(flags, **mended)


def _has_velocity(flags: DataFlags, found: Checkup) -> bool:
    """Whether a velocity is read that agrees with the position as it stands, so that both are in units of one length."""
    read = flags.velocity or "velocity" in found.recognised
    return bool(read) and not flags.velocity_unit and not any("velocity" in remedy for remedy in found.remedies)


def _stamped(found: Checkup) -> bool:
    ignored = ("no stamps: frame i", "the file's stamps are ignored")
    return not any(note.startswith(ignored) for lesson in found.lessons for note in lesson.notes)


def _states_unit(flags: DataFlags, name: str) -> bool:
    return "[" in (getattr(flags, name.removesuffix("_unit")) or "").rpartition(" ")[2]


def _without_velocity(flags: DataFlags, found: Checkup) -> DataFlags:
    """Position and force by name, without --velocity: where they were recognised, the velocity would be again."""
    named_now: dict[str, Any] = {k: v for k, v in found.recognised.items() if k != "velocity" and not getattr(flags, k)}
    return replace(flags, velocity=None, velocity_unit=None, **named_now)


def _units_behind(flags: DataFlags) -> DataFlags:
    """Units behind the columns that they belong to, where each has a plain name: one flag a signal instead of two."""
    from ..formats.columns import split_columns

    changes: dict[str, Any] = {}
    for kind in ("position", "velocity", "force"):
        unit, given = getattr(flags, f"{kind}_unit"), getattr(flags, kind)
        if unit and given and "," not in unit:
            changes |= {kind: ",".join(f"{name} [{unit}]" for name in split_columns(given)), f"{kind}_unit": None}
    return replace(flags, **changes)


def named(files: Sequence[Path]) -> str:
    return " ".join(shlex.quote(str(f)) for f in files)


def given_flags(data: DataFlags) -> list[str]:
    """The data flags as they are given on a line."""
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
    return shlex.quote(f"{value:g}" if isinstance(value, float) else str(value))
