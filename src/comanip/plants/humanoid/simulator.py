"""The one door to MuJoCo."""

from __future__ import annotations

from typing import Any

from ...errors import ParameterError


def mujoco() -> Any:
    """The simulator's module; says how to get it when it is absent."""
    try:
        import mujoco as module
    except ImportError as problem:
        raise ParameterError(f"the humanoid plant needs MuJoCo ({problem}); try: pip install comanip[humanoid]") from None
    if module.get_mju_user_warning() is None:
        module.set_mju_user_warning(_silent)
    return module


def _silent(message: str) -> None:
    """Warnings are counted and end the run; by default each would also go to a log file wherever the user happens to be."""
