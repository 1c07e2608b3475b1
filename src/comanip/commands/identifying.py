"""doctor-force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..lessons.admittance import Admittance, Term, units_of
from ..lessons.demonstration import Demonstration
from ..lessons.identification import Identification, identify, interaction_only
from ..lessons.wrench import Load
from ..recording import axis_units
from .advising import given_flags, named
from .console import print_json, say, table
from .flags import DataFlags
from .outputs import may_write
from .reading import preparation_of, read_recordings

_NAMES = {"M": "mass or inertia", "D": "damping", "K": "stiffness"}


def doctor_force(files: Sequence[Path], out: Path | None, data: DataFlags, overwrite: bool, json: bool) -> None:
    from ..formats import write

    recordings = read_recordings(files, data)
    targets = _targets(out, len(recordings))
    may_write(targets, inputs=files, overwrite=overwrite)
    results: list[dict[str, Any]] = []
    worth_writing = False
    for i, recording in enumerate(recordings):
        found = identify(recording, preparation_of(data))
        worth_writing = worth_writing or _says(found)[1]
        results.append({"recording": found.lesson.name, "source": found.lesson.source, **_numbers(found)})
        if not json:
            _print(found)
        if targets:
            write(interaction_only(found), targets[i])
            results[-1]["written"] = str(targets[i])
            if not json:
                say(f"the interaction force, as hand.force: {targets[i]}")
    command = _next(files, targets, data, worth_writing)
    if json:
        print_json({"recordings": results, "advice": command})
    else:
        say(f"next: {command}")


def _targets(out: Path | None, count: int) -> list[Path]:
    if out is None:
        return []
    return [out] if count == 1 else [out.with_name(f"{out.stem}_{i + 1}{out.suffix}") for i in range(count)]


def _print(found: Identification) -> None:
    lesson = found.lesson
    kind = "the sensor's force, object included" if found.raw else "the interaction force"
    say(f"{lesson.source or lesson.name}: {len(lesson)} frames at {1.0 / lesson.dt:.4g} Hz, {kind}")
    if found.load is not None:
        _print_load(found.load)
    if found.law is not None:
        _print_law(found.law, lesson)
    for what, why in found.unknown.items():
        say(f"  not known: {what}: {why}")
    if says := _says(found)[0]:
        say(f"  {says}")


def _print_law(law: Admittance, lesson: Demonstration) -> None:
    whom = "the partner answers the hand" if law.of_the_partner else "F moves the hand"
    verdict = "" if law.explains else ": no law of it"
    say(f"  an admittance {law.terms} explains this recording to R² {law.r2:.4f} ({whom}){verdict}")
    rows = []
    for term, values in (("M", law.inertia), ("D", law.damping), ("K", law.stiffness)):
        for axis, unit, one in zip(lesson.axes, units_of(lesson, term), values or (), strict=False):
            rows.append((_NAMES[term], axis, _shown(one), unit, _in_degrees(one, lesson, axis)))
    forces = axis_units(lesson.units.get("force", "N"), len(lesson.axes))
    rows += [("force at rest", a, _shown(b), u, "") for a, b, u in zip(lesson.axes, law.bias, forces, strict=True)]
    rows += [("unexplained, RMS", a, f"{r:.3g}", u, "") for a, r, u in zip(lesson.axes, law.residual_rms, forces, strict=True)]
    table("", ("", "axis", "value ± standard error", "unit", "a degree"), rows)
    if law.offset_known:
        say(f"  force is stamped {1e3 * law.offset.value:+.2f} ± {1e3 * law.offset.error:.2f} ms late")
    if max(law.noise_share) > 0.05 and law.inertia is not None:
        say(f"  up to {100 * max(law.noise_share):.0f} % of the acceleration is noise: the true M is larger by about as much")


def _print_load(load: Load) -> None:
    say(f"  a load explains the force to R² {load.r2:.4f}")
    if load.mass_kg is not None:
        say(f"  it carries {load.mass_kg[0]:.4g} ± {load.mass_kg[1]:.2g} kg")
    for name, pair, unit in (
        ("bias", load.bias, "N"),
        ("gravity", load.gravity, "m/s²"),
        ("centre of mass", load.centre_m, "m"),
        ("bias of the torque", load.torque_bias, "N m"),
    ):
        if pair is not None:
            say(f"  {name}: {_vector(pair[0])} ± {_vector(pair[1])} {unit}")
    if load.mount is not None and load.mount_angle_rad is not None:
        angle, error = (math.degrees(a) for a in load.mount_angle_rad)
        say(f"  the sensor is turned by {angle:.1f} ± {error:.1f}° in the hand: {np.round(load.mount, 3).tolist()}")
    if load.offset_s is not None:
        say(f"  force is stamped {1e3 * load.offset_s[0]:+.2f} ± {1e3 * load.offset_s[1]:.2f} ms late")


def _shown(term: Term) -> str:
    return f"{term.value:.4g} ± {term.error:.2g}"


def _in_degrees(term: Term, lesson: Demonstration, axis: str) -> str:
    """What people write who count in degrees: per degree, for an angle."""
    angular = lesson.unit_of(f"position.{axis}") == "rad"
    return f"{math.radians(term.value):.4g}" if angular else ""


def _vector(values: Any) -> str:
    return ", ".join(f"{v:.3g}" for v in np.atleast_1d(values))


def _says(found: Identification) -> tuple[str, bool]:
    """(what follows from it, whether the force is worth writing anew)."""
    law = found.law
    if found.load is not None and found.load.mass_kg is not None:
        return "-o clean.csv writes the force without the load: learn from that", True
    if found.raw:
        return "the load is not known: let the hand turn by 20° or more, or state --load-mass-kg with --sensor-force", False
    if law is not None and law.offset_known and abs(law.offset.value) > max(0.5 * found.lesson.dt, 3.0 * law.offset.error):
        return "-o clean.csv writes the force on the motion's clock: learn from that", True
    if law is not None and law.explains:
        return (
            "this recording is of the robot's own law: it shows how the person pulls, and cannot prove how a follower answers",
            False,
        )
    return "", False


def _next(files: Sequence[Path], targets: Sequence[Path], data: DataFlags, worth_writing: bool) -> str:
    """The next command, as it can be pasted."""
    if targets:
        role = [f"--role={data.role}"] if data.role else []
        return " ".join(["comanip inspect", named(targets), *role])
    line = [named(files), *given_flags(data)]
    return " ".join(["comanip doctor-force", *line, "-o clean.csv"] if worth_writing else ["comanip inspect", *line])


def _numbers(found: Identification) -> dict[str, Any]:
    law, load = found.law, found.load
    units = {t: units_of(found.lesson, t) for t in ("M", "D", "K")}
    return {
        "raw": found.raw,
        "admittance": None
        if law is None
        else {
            "terms": law.terms,
            "r2": law.r2,
            "r2_by_axis": law.r2_by_axis,
            "explains": law.explains,
            "inertia": law.inertia,
            "damping": law.damping,
            "stiffness": law.stiffness,
            "force_at_rest": law.bias,
            "units": units,
            "offset_s": law.offset if law.offset_known else None,
            "unexplained_rms": law.residual_rms,
            "noise_share": law.noise_share,
            "of_the_partner": law.of_the_partner,
        },
        "load": None
        if load is None
        else {n: getattr(load, n) for n in ("mass_kg", "bias", "gravity", "centre_m", "torque_bias", "mount", "offset_s", "r2")},
        "unknown": dict(found.unknown),
    }
