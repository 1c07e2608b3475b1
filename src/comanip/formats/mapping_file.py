"""A mapping of columns in a TOML file: what `Columns` has, under the same names.

position = ["/ee_pose.pose.position.z"]
force = "-/ft.wrench.force.z"
role = "follower"

[frames]
ft_sensor = "hand"
"""

from __future__ import annotations

import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import ParameterError, RecordingError
from .columns import Columns

_LISTS, _TABLES = ("position", "velocity", "force", "sensor_force", "axes", "segment_by"), ("extra", "frames")


def mapping_file(path: str | Path) -> Columns:
    """ParameterError for a name that `Columns` has not, or a value of another kind; RecordingError for a file that is no TOML."""
    path = Path(path)
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"{path}: not TOML: {' '.join(str(error).split())}") from None
    allowed = [f.name for f in fields(Columns)]
    for name, value in found.items():
        if name not in allowed:
            raise ParameterError(f"{path}: {name!r} is no part of a mapping; allowed: {', '.join(allowed)}")
        _check(path, name, value)
    return Columns(**found)


def _check(path: Path, name: str, value: Any) -> None:
    if name in _TABLES:
        good = isinstance(value, dict) and all(isinstance(v, str) or _texts(v) for v in value.values())
        want = "a table of names"
    elif name in _LISTS:
        good, want = isinstance(value, str) or _texts(value), "a column, or a list of columns"
    elif name == "rate_hz":
        good, want = isinstance(value, int | float) and not isinstance(value, bool), "a number [Hz]"
    else:
        good, want = isinstance(value, str), "a text"
    if not good:
        raise ParameterError(f"{path}: {name} is {value!r}; allowed: {want}")


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, str) for v in value)
