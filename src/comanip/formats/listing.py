"""What columns a foreign file has, with ranges: to choose a mapping by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import ChannelError
from .columns import recognise, recognise_time
from .looking import Column

_LIKE = {"position": "--position", "velocity": "--velocity", "force": "--force"}


class Listed(NamedTuple):
    """One column: unit as the file states it, frames, lowest and highest value, how many are not finite, and the flag that its
    name suggests; `problem` instead where it holds no numbers."""

    name: str
    unit: str
    frames: int
    low: float
    high: float
    bad: int
    suggests: str
    problem: str = ""


def listed(columns: Sequence[Column]) -> tuple[Listed, ...]:
    """Every column that `looking.look` found, with its range."""
    like = _like([c.name for c in columns])
    return tuple(_one(column, like.get(column.name, "")) for column in columns)


def _like(names: Sequence[str]) -> dict[str, str]:
    """Column -> the flag that its name suggests, where that is obvious."""
    try:
        like = {column: _LIKE[kind] for kind, axes in recognise(names).items() if kind in _LIKE for column in axes.values()}
        time = recognise_time(names)
    except ChannelError:  # two that could be the same: reading says which
        return {}
    return like | ({time: "--time"} if time else {})


def _one(column: Column, suggests: str) -> Listed:
    fine = column.values[np.isfinite(column.values)]
    low, high = (float(fine.min()), float(fine.max())) if len(fine) else (np.nan, np.nan)
    bad = len(column.values) - len(fine)
    return Listed(column.name, column.unit, len(column.values), low, high, bad, suggests, column.problem)
