"""What the extra `gym` brings, and one clear error where it is absent."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..errors import ParameterError


def needed(module: str, what: str = "this environment") -> Any:
    """The outside module. Raises ParameterError that says which extra brings it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ParameterError(f"{what} needs {module.partition('.')[0]} ({error}): pip install 'comanip[gym]'") from None
