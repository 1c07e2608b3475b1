"""What is installed here, and which kernels run: the first thing to ask for when something is slow or missing."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, metadata, version
from typing import Any

import numpy as np

from .. import __version__, kernels
from .console import print_json


def doctor(json: bool) -> None:
    found = examined()
    if json:
        print_json(found)
        return
    for name in ("comanip", "python", "numpy", "platform", "kernels"):
        print(f"{name:10s}{found[name]}")
    for extra, state in found["extras"].items():
        print(f"{'extra':10s}{extra}: {state}")


def examined() -> dict[str, Any]:
    return {
        "comanip": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": f"{platform.system()} {platform.machine()}",
        "kernels": kernels.description,
        "instruction_sets": kernels.native.levels() if kernels.native else [],
        "extras": _extras(),
    }


def _extras() -> dict[str, str]:
    """Each extra that the installed package declares: complete, or what is absent."""
    try:
        about = metadata("comanip")
    except PackageNotFoundError:
        return {}
    wanted: dict[str, list[str]] = {name: [] for name in about.get_all("Provides-Extra") or []}
    for requirement in about.get_all("Requires-Dist") or []:
        package, _, condition = requirement.partition(";")
        for extra in wanted:
            if f'extra == "{extra}"' in condition.replace("'", '"'):
                wanted[extra].append(package.split("[")[0].rstrip("<>=!~. 0123456789,").strip())
    return {extra: _state(packages) for extra, packages in wanted.items()}


def _state(packages: list[str]) -> str:
    absent = [p for p in packages if not _is_present(p)]
    return f"absent: {', '.join(absent)}" if absent else "present"


def _is_present(package: str) -> bool:
    try:
        version(package)
    except PackageNotFoundError:
        return False
    return True
