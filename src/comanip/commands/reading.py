"""Files and flags to demonstrations."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import ChannelError, ComanipError, ParameterError, RecordingError
from ..formats import read
from ..formats.columns import Columns, has_unit, split_columns
from ..formats.mapping_file import mapping_file
from ..interaction import Payload
from ..lessons.demonstration import Demonstration, Preparation, demonstrations
from ..lessons.shards import ParquetShards, RecordingShards, rate_of
from ..recording import Recording
from .flags import DataFlags

LEAST_TO_CHOOSE = 3  # recordings
STREAMED_BYTES = 128 << 20  # of Parquet, packed: more is read a piece at a time
PREPARED = ("sensor_force", "time", "resample_hz", "extra", "position_unit", "velocity_unit", "force_unit", "time_unit",
            "load_mass_kg", "trim_rest_s", "drop_bad", "split_gaps", "segment_by", "tare", "tare_auto", "force_bias_n",
            "integrate_position")  # fmt: skip


def beyond_memory(files: Sequence[Path]) -> bool:
    """Whether these are Parquet files, or LeRobot folders, of more than is read at once."""
    found = [p for f in files for p in ([f] if f.suffix == ".parquet" else (f / "data").glob("**/*.parquet"))]
    return sum(p.stat().st_size for p in found if p.exists()) > STREAMED_BYTES


def columns_of(flags: DataFlags) -> Columns:
    """The mapping of a file that is given, and of the flags, which go before it."""
    base = mapping_file(flags.mapping) if flags.mapping is not None else Columns()
    named = ("position", "velocity", "force", "sensor_force", "axes", "time", "rate_hz", "role", "position_unit", "velocity_unit",
             "force_unit", "time_unit", "segment_by")  # fmt: skip
    given: dict[str, Any] = {name: getattr(flags, name) for name in named if getattr(flags, name) is not None}
    extra = {**base.extra, **{name: (columns,) for name, columns in _pairs("--extra", flags.extra, "name=column,column")}}
    frames = {**base.frames, **dict(_pairs("--frame", flags.frame, "name=same, name=hand or name=w,x,y,z"))}
    return replace(base, **given, extra=extra, frames=frames)


def _pairs(flag: str, items: Sequence[str] | None, form: str) -> list[tuple[str, str]]:
    found = []
    for item in items or ():
        name, separator, value = item.partition("=")
        if not separator:
            raise ParameterError(f"{flag} {item!r}; write it as {form}")
        found.append((name, value))
    return found


def read_recordings(files: Sequence[Path], flags: DataFlags) -> list[Recording]:
    """All recordings of all files, in order."""
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: no such file or folder")
        if file.suffix.lower() == ".json":
            raise RecordingError(f"{file}: a .json file is a skill, no recording")
    columns = columns_of(flags)
    return [recording for file in files for recording in read(file, columns, recover=flags.recover)]


def _mapped(files: Sequence[Path], flags: DataFlags) -> list[Recording]:
    """As `read_recordings`; where nobody said what is what, the error says who proposes it."""
    try:
        return read_recordings(files, flags)
    except (ChannelError, RecordingError) as refused:
        if any(words in str(refused) for words in ("no column is obviously", "no time column among")):
            raise type(refused)(f"{refused}; or let `comanip inspect` propose it") from None
        raise


def read_lessons(files: Sequence[Path], flags: DataFlags, *, min_frames: int = 4) -> tuple[Demonstration, ...]:
    """Demonstrations at one rate, prepared and checked as a set (one role, no repeats, one scale) as the flags say."""
    recordings = _mapped(files, flags)
    if flags.tare_auto:
        flags = replace(flags, tare=_worth_taring(recordings, flags, min_frames), tare_auto=False)
    return demonstrations(recordings, preparation_of(flags, min_frames))


def _worth_taring(recordings: Sequence[Recording], flags: DataFlags, min_frames: int) -> bool:
    """Says which; where a recording has no rest to tare by, or there are fewer than 3, nothing is taken off."""
    from ..evaluation.choosing import choose_tare
    from .console import note

    if flags.tare or flags.force_bias_n:
        raise ParameterError("--tare-auto with --tare or --force-bias-n; allowed: one of them")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            plain, tared = (
                demonstrations(recordings, preparation_of(replace(flags, tare=tare, tare_auto=False), min_frames))
                for tare in (False, True)
            )
        except ComanipError as error:
            note(f"force at rest left as recorded: {error}")
            return False
    if len(plain) < LEAST_TO_CHOOSE:
        note(f"force at rest left as recorded: {len(plain)} recordings are too few to choose by; least {LEAST_TO_CHOOSE}")
        return False
    chosen = choose_tare(plain, tared)
    note(str(chosen))
    return chosen.tare


def read_each(files: Sequence[Path], flags: DataFlags) -> tuple[Demonstration, ...]:
    """Demonstrations that need not belong together: what a finished skill is held against."""
    preparation = preparation_of(flags)
    return tuple(lesson for r in _mapped(files, flags) for lesson in demonstrations([r], preparation))


def reader_of(
    files: Sequence[Path], paths: Sequence[str], flags: DataFlags, *, with_force: bool
) -> tuple[Any, tuple[str, ...], float]:
    """(reader, channels, period [s]) for shards: Parquet by the columns that the flags name, other formats as always."""
    groups = ("position", "force", "velocity") if with_force else ("position", "velocity")
    prepared = any(getattr(flags, name) not in (None, False) for name in PREPARED)
    prepared = prepared or any(has_unit(getattr(flags, group) or "") for group in groups)
    if prepared or not flags.position or not all(p.endswith(".parquet") for p in paths):
        rate = flags.rate_hz or next((r for f in files if (r := rate_of(f))), None)
        flags, preparation = replace(flags, rate_hz=rate), preparation_of(flags)
        first = read_lessons([Path(paths[0])], flags)[0]
        names = tuple(c for c in first.channels if c.split(".")[0] in groups)
        preparation = replace(preparation, rate_hz=preparation.rate_hz or 1.0 / first.dt)
        return RecordingShards(names, columns_of(flags), preparation, flags.recover), names, first.dt
    columns: dict[str, str] = {}
    axes = [a.strip() for a in (flags.axes or "z").split(",")]
    for group in groups:
        given = split_columns(getattr(flags, group) or "")
        if len(given) != len(axes):
            raise ParameterError(
                f"--{group} names {len(given)} Parquet columns for the axes {', '.join(axes)}; give one an axis, for example "
                f"--{group} 'observation.state[0]'" + ("; or --no-force" if group == "force" else "")
            )
        columns |= {f"{group}.{axis}": column for axis, column in zip(axes, given, strict=True)}
    rate = flags.rate_hz or next((r for f in files if (r := rate_of(f))), None)
    if rate is None:
        raise ParameterError("Parquet files do not say at which rate their frames come; give --rate-hz")
    return ParquetShards(columns), tuple(columns), 1.0 / rate


def _numbers(flag: str, given: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in given.split(","))
    except ValueError:
        raise ParameterError(f"{flag} {given!r}: give numbers, for example 4.0 or 0,0,4.0") from None


def preparation_of(flags: DataFlags, min_frames: int = 4) -> Preparation:
    asked: dict[str, Any] = {"plausible": None} if flags.any_size else {}
    asked |= {"tare": True} if flags.tare else {}
    asked |= {"force_bias_n": _numbers("--force-bias-n", flags.force_bias_n)} if flags.force_bias_n else {}
    return Preparation(
        **asked,
        integrate_position=flags.integrate_position,
        rate_hz=flags.resample_hz,
        cutoff_hz=flags.cutoff_hz,
        trim_rest_s=flags.trim_rest_s,
        payload=None if flags.load_mass_kg is None else Payload(flags.load_mass_kg),
        load_share=flags.load_share,
        drop_bad=flags.drop_bad,
        split_gaps=flags.split_gaps,
        role=flags.role,
        min_frames=min_frames,
    )
