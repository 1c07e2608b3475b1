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
from ..models.taught_path import TaughtPath
from ..parts import known, stored_models
from ..whole_file import digest, write_whole
from .skill import LearnedSkill

FORMAT, VERSION = "comanip.skill", 3
_FIELDS_1 = frozenset("format version role law settings axes dt_s units workspace_m ends_m model clock provenance sha256".split())
_FIELDS_2 = _FIELDS_1 | {"paths", "onsets_s"}
_FIELDS = {1: _FIELDS_1, 2: _FIELDS_2, 3: _FIELDS_2 | {"starts_m"}}


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
        "starts_m": learned.starts.tolist(),
        "model": _model_to_json(learned.model),
        "clock": None if learned.clock is None else _model_to_json(learned.clock),
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
    clock = content["clock"]
    return LearnedSkill(
        model=_model_from_json(content["model"]),
        clock=None if clock is None else _model_from_json(clock),
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
        starts=np.array(content.get("starts_m", ()), dtype=float).reshape(-1, len(content["axes"])),
    )


def _model_to_json(model: Any) -> dict[str, Any]:
    """By the arrays that `parts.MODELS` states for its kind."""
    at = f"{type(model).__module__}:{type(model).__qualname__}"
    for kind, part in stored_models().items():
        if part.at == at:
            arrays = {name: getattr(model, name).tolist() for name in part.arrays}
            return {"kind": kind, "channels": list(model.channels), **arrays}
    stored = ", ".join(part.object for part in stored_models().values())
    raise SkillFileError(f"a {type(model).__name__} cannot be stored; a skill file holds: {stored}")


def _model_from_json(content: Mapping[str, Any]) -> Any:
    part = known("model", content["kind"], stored_models())
    stated, has = {"kind", "channels", *part.arrays}, set(content)
    if stated != has:
        raise SkillFileError(f"model: unknown fields {sorted(has - stated)}, missing fields {sorted(stated - has)}")
    arrays = {name: _array(content, name) for name in part.arrays}
    return part.load()(**arrays, channels=tuple(content["channels"]))


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
