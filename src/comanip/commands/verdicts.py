"""What `reproduce` says of one run: whether it went well, why not, and the numbers with units and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from .units import scale_of
from .words import WORDS


class Line(NamedTuple):
    """How a number is told: its key, its name, what it is multiplied by, its unit, and the word of `WORDS` that explains it."""

    key: str
    name: str
    factor: float
    unit: str
    word: str


_LINES = (
    Line("end_error_m", "end error", 1000.0, "mm", "end"),
    Line("peak_force_n", "highest |F|", 1.0, "N", "peak"),
    Line("residual_force_n", "residual force", 1.0, "N", "residual force"),
    Line("effort_n2s", "partner's effort", 1.0, "N² s", "effort"),
    Line("work_j", "partner's work", 1.0, "J", "work"),
    Line("internal_force_n", "internal force", 1.0, "N", "internal force"),
    Line("effort_share", "effort share", 1.0, "", "effort share"),
    Line("tilt_deg", "beam's tilt", 1.0, "°", "level"),
    Line("ripple_m_per_s", "ripple", 1000.0, "mm/s", "ripple"),
    Line("smoothness", "LDLJ", 1.0, "", "LDLJ"),
)
_ENDS = {"duration": "the time that the partner needs was over", "interrupted": "Ctrl-C"}


def told(result: Mapping[str, Any], *, partner: str, units: Mapping[str, str]) -> list[str]:
    """The lines that stand on the terminal; --json has every number in SI."""
    lines = _replayed(result, units) if "force_from" in result else _collaboration(result, partner)
    lines += [f"said on the way: {result['notice']}"] if result.get("notice") else []
    lines += [f"recording: {result['recording']}"] if "recording" in result else []
    return lines + ([f"picture: {result['picture']}"] if "picture" in result else [])


def _collaboration(result: Mapping[str, Any], partner: str) -> list[str]:
    role = {"auto": "told no role", "leader": "as leader", "follower": "as follower"}[result["role"]]
    how = "succeeded" if result["success"] else "FAILED: " + ", ".join(result["failures"])
    ended = _ENDS.get(result["stop_reason"], result["stop_reason"])
    lines = [f"{result['skill']}, {role}, law {result['law']}, with {partner}: {how}", f"ended by: {ended}"]
    lines += [_number(line, result[line.key]) for line in _LINES if result[line.key] == result[line.key]]
    if (moving := result["duration_s"]) == moving:
        lines.append(f"  {'motion lasted':<17}{moving:>8.3g} s")
    if (right := result["role_right"]) == right:  # NaN where the robot was told its role
        lines.append(f"  {'role in time':<17}{'yes' if right else 'NO':>8}       known 0.3 s after 1 cm of motion")
    return lines


def _number(line: Line, value: float) -> str:
    return f"  {line.name:<17}{line.factor * value:>8.3g} {line.unit:<5} {WORDS[line.word]}"


def _replayed(result: Mapping[str, Any], units: Mapping[str, str]) -> list[str]:
    place = scale_of(units.get("position", "m"))
    return [
        f"{result['skill']}, law {result['law']}, moved by the force recorded in {result['force_from']}",
        "nobody answers: this says how the skill responds, and nothing about collaboration",
        f"ended by: {result['stop_reason']}",
        f"  distance from the recorded path, RMSE: {place.shown(result['position_rmse_m'])} {place.unit}",
        f"  distance at the end: {place.shown(result['end_error_m'])} {place.unit}",
    ]
