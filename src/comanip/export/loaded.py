"""An exported controller compiled and loaded again, through ctypes: for proofs, tests and own loops in Python."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from .c_file import Source

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror")
BATCH = """
void comanip_batch(@NAME@_state *state, const @NAME@_obs *obs, @NAME@_cmd *cmd, int n);
void comanip_batch(@NAME@_state *state, const @NAME@_obs *obs, @NAME@_cmd *cmd, int n) {
    for (int i = 0; i < n; i++) @NAME@_step(state, obs + i, cmd + i);
}
"""


def compiler() -> str | None:
    """The C compiler of this machine, or None."""
    return next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)


def compiled(source: Source, folder: Path, *, name: str = "skill", flags: Sequence[str] = ("-O2",), strict: bool = True) -> Path:
    """A shared library of `source` in `folder`. Raises ParameterError where there is no compiler, or it does not compile."""
    cc = compiler()
    if cc is None:
        raise ParameterError("there is no C compiler here (cc, gcc or clang): install one to compile what is exported")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.h").write_text(source.h, encoding="utf-8")
    (folder / f"{name}.c").write_text(source.c, encoding="utf-8")
    glue = folder / f"{name}_batch.c"
    glue.write_text(f'#include "{name}.h"\n' + BATCH.replace("@NAME@", name), encoding="utf-8")
    out = folder / f"lib{name}.so"
    made = subprocess.run(
        [cc, *(STRICT if strict else STRICT[:1]), *flags, "-fPIC", "-shared", f"{name}.c", glue.name, "-o", out.name, "-lm"],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    if made.returncode:
        raise ParameterError(f"{folder / name}.c: {made.stderr.strip().splitlines()[0]}")
    return out


def cmd_type(d: int) -> np.dtype[Any]:
    """NAME_cmd as numpy sees it."""
    vectors = [(name, float, (d,)) for name in ("position", "velocity", "acceleration", "force")]
    numbers = [(name, float) for name in ("tank_j", "confidence", "phase_s", "clock_rate", "blend", "reason_value")]
    return np.dtype([*vectors, *numbers, *[(name, np.int32) for name in ("mode", "reason", "passes", "acts")]])


def obs_type(d: int) -> np.dtype[Any]:
    """NAME_obs as numpy sees it."""
    return np.dtype(
        [("time", float), ("force_time", float), *[(n, float, (d,)) for n in ("position", "velocity", "sensor_force")]]
    )


class Loaded:
    """The library at `path`, and one state of it."""

    def __init__(self, path: Path, header: str, *, name: str = "skill") -> None:
        self._library = ctypes.CDLL(str(path))
        found = re.search(rf"double opaque\[(\d+)\].*{name}_state", header)
        axes = re.search(rf"#define {name}_AXES (\d+)", header)
        assert found and axes
        self.d = int(axes[1])
        self._state = np.zeros(int(found[1]))
        self._name = name
        for what in (f"{name}_init", f"{name}_step", "comanip_batch"):
            getattr(self._library, what).restype = None
        getattr(self._library, f"{name}_reason_text").restype = ctypes.c_char_p
        self.init()

    def _call(self, what: str, *arguments: Any) -> Any:
        return getattr(self._library, what)(*arguments)

    def init(self) -> None:
        self._call(f"{self._name}_init", self._state.ctypes.data_as(ctypes.c_void_p))

    def run(self, obs: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Commands (n,) of `cmd_type` for observations (n,) of `obs_type`, one tick after the other."""
        obs = np.ascontiguousarray(obs)
        assert obs.dtype == obs_type(self.d)
        out = np.zeros(len(obs), cmd_type(self.d)) if out is None else out
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (self._state, obs, out)]
        self._call("comanip_batch", *pointers, ctypes.c_int(len(obs)))
        return out

    def rearm(self) -> int:
        """0: it runs again."""
        return int(self._call(f"{self._name}_rearm", self._state.ctypes.data_as(ctypes.c_void_p)))

    def reason(self, number: int) -> str:
        return str(self._call(f"{self._name}_reason_text", ctypes.c_int(number)).decode())

    def weights(self, n: int) -> Array:
        out = np.zeros(n)
        self._call(f"{self._name}_weights", *[a.ctypes.data_as(ctypes.c_void_p) for a in (self._state, out)])
        return out
