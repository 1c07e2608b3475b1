"""What a skill that changes its role remembers beside its law: one array, which the compiled tick (kernels/_roles.h) shares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..interfaces import Array
from ..kernels import layouts
from .collaborate import MOST_AXES

FOLLOWS, PROBES, LEADS = "follows", "offers to lead", "leads"
STATES = (FOLLOWS, PROBES, LEADS)
ROLE = layouts.BLOCKS["role"]


class Number:
    """A number of `Kept.kept`, as the Python's own kind."""

    def __init__(self, name: str, kind: Callable[[Any], Any]) -> None:
        self._at, self._kind = ROLE.index(name), kind

    def __get__(self, skill: Any, kind: Any = None) -> Any:
        return self if skill is None else self._kind(skill.kept[self._at])

    def __set__(self, skill: Any, value: Any) -> None:
        skill.kept[self._at] = value


class Kept:
    """A part of `RoleSkill`."""

    _answers, _gave_way, _put_back = Number("answers", int), Number("gave_way", bool), Number("put_back", bool)
    _reached, _push, _meant, _outside = (Number(name, float) for name in ("reached", "push", "meant", "outside"))
    _gives, _complies_only = Number("gives", bool), Number("complies_only", bool)

    def _keep(self, n_axes: int) -> None:
        wide = max(n_axes, MOST_AXES)
        self.kept = np.zeros(len(ROLE) + 2 * wide)  # what else it remembers: the numbers of ROLE, then a place and a way
        self._blend = self.kept[ROLE.index("blend") :][:1]
        self._at_place, self._way = (self.kept[len(ROLE) + n * wide :][:n_axes] for n in range(2))  # where an offer pushes

    @property
    def _state(self) -> str:
        return STATES[int(self.kept[0])]

    @_state.setter
    def _state(self, state: str) -> None:
        self.kept[0] = STATES.index(state)

    @property
    def _place(self) -> Array | None:
        """Where an offer was begun, or answered."""
        return self._at_place if self.kept[ROLE.index("placed")] else None

    @_place.setter
    def _place(self, place: Array | None) -> None:
        self.kept[ROLE.index("placed")] = place is not None
        if place is not None:
            self._at_place[:] = place
