"""The humanoid in physics (MuJoCo): a sibling of `plants.beam`, with the same socket and channels.

Nothing here imports the simulator until a plant is built; `pip install comanip[humanoid]` brings it.
"""

from importlib import import_module
from typing import Any

_PUBLIC = {
    "HumanoidPlant": "plant",
    "EQUIVALENT_BEAM": "plant",
    "Robot": "robot",
    "load_robot": "robot",
    "InverseKinematics": "inverse_kinematics",
    "film": "render",
    "picture": "render",
}

__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    try:
        module = import_module(f"{__name__}.{_PUBLIC[name]}")
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has: {', '.join(_PUBLIC)}") from None
    return getattr(module, name)
