"""A skill as a file: versioned JSON that a person, a page or a C program can read. Never pickle.

{"format": "comanip.skill", "version": 1, ..., "sha256": "<of everything else, in canonical form>"}. Floats are written with repr,
so float64 comes back exactly. The reader is strict: what it does not know, or cannot check, it refuses.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ComanipError, SkillFileError
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..models.taught_path import TaughtPath
from ..whole_file import digest, write_whole
from .skill import LearnedSkill

FORMAT, VERSION = "comanip.skill", 2
_FIELDS_1 = frozenset("format version role law settings axes dt_s units workspace_m ends_m model clock provenance sha256".split())
_FIELDS = {1: _FIELDS_1, 2: _FIELDS_1 | {"paths", "onsets_s"}}


def save(learned: LearnedSkill, path: str | Path) -> None:
    """Writes the file whole or not at all: a crash leaves the old one untouched."""
    write_whole(Path(path), json.dumps(to_json(learned), indent=1, allow_nan=False) + "\n")


def load(path: str | Path) -> LearnedSkill:
    """Reads and checks a skill file. Raises SkillFileError that names the file and what is wrong."""
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_no_duplicates)
    except OSError as error:
        raise SkillFileError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise SkillFileError(f"{path}: not a skill file: {error}") from None
    except ValueError as error:
        raise SkillFileError(f"{path}: {error}") from None
    try:
        return from_json(content)
    except ComanipError as error:
        raise SkillFileError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SkillFileError(f"{path}: a field is missing or malformed: {error}") from None


def to_json(learned: LearnedSkill) -> dict[str, Any]:
    model, clock = learned.model, learned.clock
    content: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "role": learned.role,
        "law": learned.law,
        "settings": dict(learned.settings),
        "axes": list(learned.axes),
        "dt_s": learned.dt,
        "units": dict(learned.units),
        "workspace_m": learned.workspace.tolist(),
        "ends_m": learned.ends.tolist(),
        "onsets_s": learned.onsets_s.tolist(),
        "paths": [
            {
                "step_s": path.step_s,
                "position_m": path.position.tolist(),
                "force_n": path.force.tolist(),
                "spread_m": path.spread.tolist(),
                "ends_m": path.ends.tolist(),
                "framed_m": path.framed.tolist(),
            }
            for path in learned.paths
        ],
        "model": {
            "kind": "hmm",
            "channels": list(model.channels),
            "initial": model.initial.tolist(),
            "transition": model.transition.tolist(),
            "means": model.means.tolist(),
            "covariances": model.covariances.tolist(),
        },
        "clock": None
        if clock is None
        else {
            "kind": "gmm",
            "channels": list(clock.channels),
            "weights": clock.weights.tolist(),
            "means": clock.means.tolist(),
            "covariances": clock.covariances.tolist(),
        },
        "provenance": json.loads(json.dumps(dict(learned.provenance))),
    }
    content["sha256"] = digest(content)
    return content


def from_json(content: Any) -> LearnedSkill:
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise SkillFileError(f'not a skill file: it lacks "format": "{FORMAT}"')
    version = content.get("version")
    if version not in _FIELDS or isinstance(version, bool):
        newer = isinstance(version, int) and version > VERSION
        advice = "update comanip to read it" if newer else "no such version was ever written"
        raise SkillFileError(f"written as version {version!r}; this comanip reads versions 1 to {VERSION}: {advice}")
    stray, absent = sorted(set(content) - _FIELDS[version]), sorted(_FIELDS[version] - set(content))
    if stray or absent:
        raise SkillFileError(f"unknown fields {stray}, missing fields {absent}")
    if content["sha256"] != digest(content):
        raise SkillFileError("the content does not match its sha256: it was damaged or edited by hand")
    model, clock = content["model"], content["clock"]
    return LearnedSkill(
        model=Hmm(
            _array(model, "initial"),
            _array(model, "transition"),
            _array(model, "means"),
            _array(model, "covariances"),
            tuple(model["channels"]),
        ),
        clock=None
        if clock is None
        else Gmm(_array(clock, "weights"), _array(clock, "means"), _array(clock, "covariances"), tuple(clock["channels"])),
        role=str(content["role"]),
        law=str(content["law"]),
        settings=content["settings"],
        axes=tuple(content["axes"]),
        dt=float(content["dt_s"]),
        units=content["units"],
        workspace=np.array(content["workspace_m"], dtype=float),
        ends=np.array(content["ends_m"], dtype=float),
        provenance=content["provenance"],
        paths=tuple(map(_path, content.get("paths", ()))),
        onsets_s=np.array(content.get("onsets_s", ()), dtype=float),
    )


def _path(part: Mapping[str, Any]) -> TaughtPath:
    step_s = float(part["step_s"])
    position, force, spread, ends = (_array(part, name) for name in ("position_m", "force_n", "spread_m", "ends_m"))
    n, d = position.shape
    if n < 2 or force.shape != (n, d) or spread.shape != (n,) or ends.shape != (len(ends), d) or not step_s > 0.0:
        shapes = f"{position.shape}, {force.shape}, {spread.shape}, {ends.shape}"
        raise SkillFileError(
            "a path has position_m and force_n (N >= 2, d), spread_m (N,), ends_m (lessons, d) and step_s > 0; "
            f"got {shapes} and {step_s:g}"
        )
    framed = _array(part, "framed_m") if "framed_m" in part else np.zeros((2, 0))
    if framed.size and framed.shape != (2, n):
        raise SkillFileError(f"a path has framed_m (2, {n}), from its start and from its end; got {framed.shape}")
    return TaughtPath(step_s, position, force, spread, ends, framed)


def _array(part: Mapping[str, Any], name: str) -> np.ndarray:
    array = np.array(part[name], dtype=float)
    if not np.isfinite(array).all():
        raise SkillFileError(f"{name} holds a value that is not finite")
    return array


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"field {key!r} appears twice")
        found[key] = value
    return found
