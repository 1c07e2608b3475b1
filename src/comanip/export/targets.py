"""What a controller can be written as. A target takes `make`, which gives a controller that has never run, and where it goes to; it
gives the text of every file. `parts.EXPORTS` names them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from .c_file import filled, identifier, source
from .controller import Controller, settings_of
from .ctypes_text import MODULE
from .ros2_text import FILES
from .self_test import self_test

Make = Callable[[], Controller]


class Export(NamedTuple):
    """files   path -> text, to be written whole; about   what they are, for a report"""

    files: Mapping[Path, str]
    about: Mapping[str, Any]


def to_c(make: Make, out: Path) -> Export:
    """NAME.c and NAME.h beside it."""
    name = identifier(out.stem)
    made = make()
    text = source(made, name=out.stem, self_test=self_test(make(), name))
    about = {**settings_of(made), "state_bytes": text.state_bytes, "prefix": name}
    return Export({out.with_suffix(".c"): text.c, out.with_suffix(".h"): text.h}, about)


def to_ctypes(make: Make, out: Path) -> Export:
    """The same, and NAME.py, which builds a library of it once and calls that."""
    found = to_c(make, out.with_suffix(".c"))
    axes = found.about["axes"]
    fields = {"NAME": found.about["prefix"], "STEM": out.stem, "AXES": len(axes), "DT": repr(found.about["dt_s"]),
              "AXIS_NAMES": ", ".join(axes), "DOUBLES": found.about["state_bytes"] // 8}  # fmt: skip
    return Export({**found.files, out.with_suffix(".py"): filled(MODULE, fields)}, found.about)


def to_ros2_control(make: Make, out: Path) -> Export:
    """A package of that name: a controller plugin with the C inside, its parameters, a launch file and a README."""
    name = identifier(out.name).lower()
    made = make()
    text = source(made, name="skill", self_test=self_test(make(), "skill"))
    axes = made.axes
    about = {**settings_of(made), "state_bytes": text.state_bytes, "prefix": "skill", "package": name}
    fields = {"PACKAGE": name, "CLASS": "".join(part.title() for part in name.split("_")), "AXES": len(axes),
              "AXIS_NAMES": ", ".join(axes), "RATE": f"{1.0 / made.dt:.0f}", "DT": repr(made.dt), "ROLE": made.role,
              "POSITIONS": _interfaces("hand/position", axes), "VELOCITIES": _interfaces("hand/velocity", axes),
              "FORCES": _interfaces("wrist_sensor/force", axes), "COMMANDS": _interfaces("hand/velocity", axes)}  # fmt: skip
    files = {out / filled(path, fields): filled(content, fields) for path, content in FILES.items()}
    return Export({**files, out / "src" / "skill.c": text.c, out / "src" / "skill.h": text.h}, about)


def _interfaces(of: str, axes: tuple[str, ...]) -> str:
    return "[" + ", ".join(f'"{of}.{axis}"' for axis in axes) + "]"
