"""Compiled leaves, and the choice between them and their readable twins in comanip.models.

`native` is the compiled module, or None where nothing could be compiled or COMANIP_KERNELS=numpy asks for the twins: then everything
runs, slower. COMANIP_KERNELS=avx512, avx2 or plain asks for one instruction set. Which one runs is said by `comanip doctor`.
"""

from __future__ import annotations

import os
from typing import Any

ABSENT = "the compiled kernels are absent (no C compiler when comanip was installed): numpy does the same work 10 to 50 times slower"


def _load() -> tuple[Any, str]:
    wanted = os.environ.get("COMANIP_KERNELS", "").lower()
    if wanted == "numpy":
        return None, "numpy, as COMANIP_KERNELS asks"
    try:
        from . import _native
    except ImportError:
        return None, ABSENT
    if wanted in _native.levels():
        _native.use(wanted)
    elif wanted not in ("", "native"):
        raise ImportError(f"COMANIP_KERNELS={wanted!r}; allowed here: numpy, native, {', '.join(_native.levels())}")
    return _native, f"native, {_native.level()}"


native, description = _load()
