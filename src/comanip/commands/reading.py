"""Files and flags to demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..cli_flags import DataFlags
from ..demonstration import Demonstration, Preparation, demonstrations
from ..errors import ParameterError, RecordingError
from ..formats import read
from ..formats.columns import Columns
from ..interaction import Payload
from ..recording import Recording


def columns_of(flags: DataFlags) -> Columns:
    extra = {}
    for item in flags.extra or ():
        name, separator, columns = item.partition("=")
        if not separator:
            raise ParameterError(f"--extra {item!r}; write it as name=column,column")
        extra[name] = (columns,)
    given = {
        name: getattr(flags, name)
        for name in ("position", "velocity", "force", "sensor_force", "axes")
        if getattr(flags, name) is not None
    }
    return Columns(
        **given,
        time=flags.time,
        rate_hz=flags.rate_hz,
        role=flags.role,
        extra=extra,
        position_unit=flags.position_unit,
        velocity_unit=flags.velocity_unit,
        force_unit=flags.force_unit,
        time_unit=flags.time_unit,
    )


def read_recordings(files: Sequence[Path], flags: DataFlags) -> list[Recording]:
    """All recordings of all files, in order."""
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: no such file or folder")
    columns = columns_of(flags)
    return [recording for file in files for recording in read(file, columns, recover=flags.recover)]


def read_lessons(files: Sequence[Path], flags: DataFlags, *, min_frames: int = 4) -> tuple[Demonstration, ...]:
    """Demonstrations at one rate, prepared and checked as a set (one role, no repeats, one scale) as the flags say."""
    return demonstrations(read_recordings(files, flags), preparation_of(flags, min_frames))


def read_each(files: Sequence[Path], flags: DataFlags) -> tuple[Demonstration, ...]:
    """Demonstrations that need not belong together: what a finished skill is held against."""
    preparation = preparation_of(flags)
    return tuple(lesson for r in read_recordings(files, flags) for lesson in demonstrations([r], preparation))


def preparation_of(flags: DataFlags, min_frames: int = 4) -> Preparation:
    return Preparation(
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
