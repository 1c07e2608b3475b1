"""Partners from somebody else's Python file: `comanip trial --partners-from my_partners.py`."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Partner
from .cases import Case

STATED = ("goal_m", "onset_s", "stop_s")  # what a partner may say of himself, and is then judged by
WHAT = "a function partner(case, rng), or classes with reset(position) and force(time, position, velocity, out)"


@dataclass(frozen=True)
class PartnersFrom:
    """Makes partners as a file tells, one after the other if it holds several classes. Pickles by its path.

    A function `partner(case, rng)` gets the draw (`trials.Case`) and a Generator. A class is made with those of the arguments
    `case` and `rng` that its constructor names. In both, case.axes are the task's axes, and case.carried (d,) is the weight that
    a partner carries along each (case.carried_n where there is one, upright).

    A partner is judged by the draw: the goal is `partners_goal(case)` from the start, the motion begins at case.onset_s and
    stops at case.stop_s. One who has other plans says so by the attributes goal_m [m from the start; (d,) in d axes], onset_s and
    stop_s [s].
    """

    path: str

    def __call__(self, case: Case, rng: np.random.Generator) -> Partner:
        made = self._makers()
        maker = made[case.seed % len(made)]
        person = maker(**_wanted(maker, {"case": case, "rng": rng}))
        if not isinstance(person, Partner):
            raise ParameterError(f"{self.path}: {maker.__name__} gives {type(person).__name__}, which lacks reset or force")
        for name, value in stated_by(person).items():
            if name == "goal_m" and _is_place(value, len(case.axes)):
                continue
            if not (isinstance(value, (int, float)) and isfinite(value)):
                raise ParameterError(f"{self.path}: {maker.__name__}.{name} must be a finite number; got {value!r}")
            if name == "goal_m" and len(case.axes) > 1:
                raise ParameterError(f"{self.path}: {maker.__name__}.goal_m must be {len(case.axes)} numbers; got {value!r}")
        return person

    def _makers(self) -> list[Any]:
        module = _loaded(self.path)
        if callable(function := getattr(module, "partner", None)):
            return [function]
        classes = [
            c
            for _, c in sorted(vars(module).items())
            if inspect.isclass(c) and c.__module__ == module.__name__ and callable(getattr(c, "force", None))
        ]
        if not classes:
            raise ParameterError(f"{self.path} holds no partner: give {WHAT}")
        return classes


def stated_by(person: Partner) -> dict[str, Any]:
    """What the partner says of himself, of STATED."""
    said = {name: getattr(person, name) for name in STATED if getattr(person, name, None) is not None}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in said.items()}


def _is_place(value: Any, n_axes: int) -> bool:
    """Whether it is (d,) finite numbers."""
    try:
        place = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return place.shape == (n_axes,) and bool(np.isfinite(place).all())


def _wanted(maker: Any, offered: dict[str, Any]) -> dict[str, Any]:
    """Those of the offered arguments that the maker names."""
    try:
        names = inspect.signature(maker).parameters
    except ValueError:
        return {}
    return {name: value for name, value in offered.items() if name in names}


def _loaded(path: str) -> ModuleType:
    name = f"_comanip_partners_{abs(hash(path))}"
    if name in sys.modules:
        return sys.modules[name]
    if not Path(path).is_file():
        raise ParameterError(f"{path}: no such file; --partners-from takes a Python file with {WHAT}")
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ParameterError(f"{path}: not a Python file; --partners-from takes one with {WHAT}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ParameterError(f"{path}: {type(error).__name__}: {error}") from error
    return module
