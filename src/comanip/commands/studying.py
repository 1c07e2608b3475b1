"""page, study: the page served here, and what a study on it gave."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import ParameterError
from ..formats import write
from ..page import study as studies
from .console import print_json, say, table
from .outputs import may_draw, may_fill


def study(files: Sequence[Path], plot: Path | None, out: Path | None, overwrite: bool, json: bool) -> None:
    persons = [studies.read_person(file) for file in files]
    may_draw(plot, inputs=files, overwrite=overwrite)
    found = studies.analysis(persons)
    stored = _store(persons, out, overwrite) if out is not None else []
    if plot is not None:
        from ..evaluation import drawing
        from ..evaluation.study_picture import study_picture

        drawing.save(study_picture(found, {name: about for name, about in studies.MEASURES.items()}), plot)
    if json:
        print_json({**found, "recordings": [str(f) for f in stored], "picture": None if plot is None else str(plot)})
        return
    _tell(found)
    for one in ([plot] if plot is not None else []) + ([out] if stored else []):
        say(str(one))


def _tell(found: dict[str, Any]) -> None:
    measures = studies.MEASURES
    title = f"{found['persons']} persons, {found['complete']} to the end"
    rows = [
        (c, str(found["trials"][c]), *(f"{found['means'][c][m]:.3g}" for m in measures), str(found["prefer"][c]))
        for c in found["means"]
    ]
    units = [f"{label} {f'[{unit}]' if unit else ''}".strip() for label, unit, _ in measures.values()]
    table(title, ("condition", "trials", *units, "prefer"), rows)
    pairs: dict[str, Any] = next(iter(found["differences"].values()), {})
    rows = [(pair, *(_interval(found["differences"][m][pair]) for m in measures)) for pair in pairs]
    table(f"Differences in pairs of {found['pairs_are']}: mean, 95 % interval", ("pair", *units), rows)


def _interval(d: Any) -> str:
    return "-" if d.pairs == 0 else f"{d.mean:+.3g} ({d.low:.3g} to {d.high:.3g}){' *' if d.told else ''}"


def _store(persons: Sequence[studies.Person], out: Path, overwrite: bool) -> list[Path]:
    """Each trial as MCAP; names in files of others are made plain before they name files here."""
    named = [(_plain(name), recording) for person in persons for name, recording in studies.recordings(person)]
    names = [f"{name}.mcap" for name, _ in named]
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise ParameterError(f"{twice[0]}: two trials would have this name; analyse one file a person")
    may_fill(out, names, overwrite=overwrite)
    out.mkdir(parents=True, exist_ok=True)
    for (_, recording), name in zip(named, names, strict=True):
        write(recording, out / name)
    return [out / name for name in names]


def _plain(name: str) -> str:
    return re.sub(r"[^\w.-]+", "-", name).strip(".-")[:80] or "trial"
