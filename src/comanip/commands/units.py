"""Numbers of a table in a unit that fits them: mm for metres, mrad for radians, and nothing else for what is neither."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Scale(NamedTuple):
    """How a number in SI is shown: times `factor`, as `unit`, with `digits` behind the point."""

    factor: float
    unit: str
    digits: int = 1

    def shown(self, value: float) -> str:
        if not self.factor:  # metres and radians together: no number would mean anything
            return "-"
        return f"{self.factor * value:.{self.digits}f}"


_SCALES = {
    "m": Scale(100.0, "cm", 2),
    "m/s": Scale(1000.0, "mm/s"),
    "rad": Scale(1000.0, "mrad"),
    "rad/s": Scale(1000.0, "mrad/s"),
}


def scale_of(unit: str) -> Scale:
    """For the axis' own unit; one that is not known is shown as it is, and of several kinds together nothing is."""
    kinds = list(dict.fromkeys(part.strip() for part in unit.split(",")))
    if len(kinds) > 1:
        return Scale(0.0, "of all axes")
    unit = kinds[0]
    return _SCALES.get(unit, Scale(1.0, unit or "(no unit)", 4))


def unit_of(units: Mapping[str, str], group: str, axis: int, usual: str) -> str:
    """The unit of one axis of a group: "m", or the axis' own where a group states one an axis, "m,m,rad"."""
    stated = [part.strip() for part in (units.get(group) or usual).split(",")]
    return stated[axis] if axis < len(stated) > 1 else stated[0]


def slope_scale(velocity: str, force: str) -> Scale:
    """Of ∂v/∂F: velocity a force."""
    speed = scale_of(velocity)
    return Scale(speed.factor, f"{speed.unit}/{force}" if " " not in force else f"{speed.unit}/({force})")
