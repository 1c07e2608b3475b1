"""Modules of the page in Node: numbers go in and come back as JSON, arrays as files of float64."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import comanip.page

APP = Path(comanip.page.__file__).parent / "app"
WASM = APP.parent / "page.wasm"
NODE = shutil.which("node")
_HEAD = """
import fs from "fs";
const given = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const array = name => { const b = fs.readFileSync(given.folder + "/" + name + ".f64"); return new Float64Array(b.buffer.slice(b.byteOffset, b.byteOffset + b.length)); };
const keep = (name, values) => fs.writeFileSync(given.folder + "/" + name + ".f64", Buffer.from(values.buffer, values.byteOffset, values.byteLength));
const answer = value => fs.writeFileSync(given.folder + "/answer.json", JSON.stringify(value));
"""


def needs_node() -> None:
    if NODE is None:
        pytest.skip("node is not installed: what runs in the page is compared through it")


def ran(folder: Path, script: str, *, modules: dict[str, str], arrays: dict[str, np.ndarray] | None = None, **given: Any) -> Any:
    """What `script` answers; `modules`: name -> what it takes from app/name.js."""
    needs_node()
    for name, values in (arrays or {}).items():
        np.asarray(values, dtype="<f8").tofile(folder / f"{name}.f64")
    imports = "\n".join(f'import {{ {names} }} from "{(APP / f"{module}.js").as_uri()}";' for module, names in modules.items())
    (folder / "given.json").write_text(json.dumps({"folder": str(folder), "wasm": str(WASM), **given}))
    (folder / "script.mjs").write_text(imports + _HEAD + script)
    assert NODE is not None
    done = subprocess.run(
        [NODE, str(folder / "script.mjs"), str(folder / "given.json")], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr[-2000:]
    answer = folder / "answer.json"
    return json.loads(answer.read_text()) if answer.exists() else None


def array(folder: Path, name: str) -> np.ndarray:
    return np.fromfile(folder / f"{name}.f64", dtype="<f8")
