"""Pickles and copies of what runs, in mid-run too.

Two things do not survive a copy by themselves. A window into an array (`self.velocity = self.memory[:3]`) becomes an array of its
own, so what one part writes the other no longer sees. And what is compiled holds the memory of the original.
"""

from __future__ import annotations

import copy
from typing import Any, ClassVar, NamedTuple

import numpy as np


class Window(NamedTuple):
    """A window into `base`, from byte `begin` on."""

    base: np.ndarray
    begin: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    kind: str

    def opened(self) -> np.ndarray:
        return np.ndarray(self.shape, self.kind, self.base, self.begin, self.strides)


class Copied:
    """To inherit from: windows stay windows into the copy's own arrays, and `_link` makes the attributes of `ANEW` again.

    A copy by `copy.copy` is a deep one: two runs that shared their memory would disturb each other in silence.
    """

    ANEW: ClassVar[tuple[str, ...]] = ()  # names of what is compiled, and of what points into it

    def __getstate__(self) -> dict[str, Any]:
        return {name: _closed(value) for name, value in vars(self).items() if name not in self.ANEW}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update({name: _opened(value) for name, value in state.items()})
        self._link()

    def __copy__(self) -> Any:
        return copy.deepcopy(self)

    def _link(self) -> None:
        """Sets the attributes of `ANEW`, over the arrays that are there."""


def _closed(value: Any) -> Any:
    if isinstance(value, np.ndarray) and isinstance(value.base, np.ndarray) and value.flags.writeable:
        begin = value.__array_interface__["data"][0] - value.base.__array_interface__["data"][0]
        return Window(value.base, begin, value.shape, value.strides, value.dtype.str)
    return _within(value, _closed)


def _opened(value: Any) -> Any:
    return value.opened() if isinstance(value, Window) else _within(value, _opened)


def _within(value: Any, change: Any) -> Any:
    """The same inside plain containers, which hold windows where a plant shows its channels."""
    if type(value) in (tuple, list):
        return type(value)(map(change, value))
    if type(value) is dict:
        return {key: change(one) for key, one in value.items()}
    return value
