"""Partners from somebody else's Python file: `comanip trial --partners-from my_partners.py`."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Partner
from .cases import Case

MORE_BYTES = 2 << 30  # address space for a partner and the simulation around it; a run of ours takes a tenth of that
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
    bounded: bool = False  # whether the process that asks a partner is kept from allocating without end (Linux); it stays so

    def __call__(self, case: Case, rng: np.random.Generator) -> Partner:
        if self.bounded:
            bound_memory()
        made = self._makers()
        maker = made[case.seed % len(made)]
        try:
            person = maker(**_wanted(maker, {"case": case, "rng": rng}))
        except Exception as error:
            raise ParameterError(f"{self.path}: {maker.__name__}: {where(error, self.path)}") from None
        if not isinstance(person, Partner):
            raise ParameterError(f"{self.path}: {maker.__name__} gives {type(person).__name__}, which lacks reset or force")
        for name, value in stated_by(person).items():
            if name == "goal_m" and _is_place(value, len(case.axes)):
                continue
            if not (isinstance(value, (int, float)) and isfinite(value)):
                raise ParameterError(f"{self.path}: {maker.__name__}.{name} must be a finite number; got {value!r}")
            if name == "goal_m" and len(case.axes) > 1:
                raise ParameterError(f"{self.path}: {maker.__name__}.goal_m must be {len(case.axes)} numbers; got {value!r}")
        return Foreign(person, self.path)

    def _makers(self) -> list[Any]:
        module = module_of(self.path, "--partners-from", WHAT)
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


class Foreign:
    """Somebody else's partner: what it raises is told as a fault of its file, by line, and not as one of comanip's."""

    def __init__(self, person: Partner, path: str) -> None:
        self.person, self._path = person, path

    def reset(self, position: Array) -> None:
        try:
            self.person.reset(position)
        except Exception as error:
            raise ParameterError(f"{self._path}: {type(self.person).__name__}.reset: {where(error, self._path)}") from None

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        try:
            self.person.force(time, position, velocity, out)
        except Exception as error:
            at = f"{type(self.person).__name__}.force at {time:.3f} s"
            raise ParameterError(f"{self._path}: {at}: {where(error, self._path)}") from None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("person", "_path"):
            raise AttributeError(name)
        return getattr(self.person, name)


def where(error: Exception, path: str) -> str:
    """What was raised, and the last line of the file that had a part in it."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename).resolve() == Path(path).resolve()]
    what = str(error) or ("more than is allowed" if isinstance(error, MemoryError) else "no message")
    return f"{type(error).__name__}: {what}" + (f" (line {lines[-1]})" if lines else "")


def bounds_memory() -> bool:
    """Whether this system can keep a process from allocating without end: Linux can, macOS and Windows cannot."""
    return sys.platform == "linux"


def bound_memory() -> None:
    """From now on this process may allocate MORE_BYTES beside what it has: a partner that takes more gets MemoryError."""
    if _bounded or not bounds_memory():
        return
    import resource

    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = has + MORE_BYTES if hard == resource.RLIM_INFINITY else min(has + MORE_BYTES, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    _bounded.append(most)


_bounded: list[int] = []


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


def module_of(path: str, flag: str, what: str) -> ModuleType:
    """Somebody's Python file as a module, loaded once a process and until it changes.

    Raises ParameterError, in one line with the file's, for one that is absent or raises; `flag` and `what` say what was wanted.
    """
    if not Path(path).is_file():
        raise ParameterError(f"{path}: no such file; {flag} takes a Python file with {what}")
    name = f"_comanip_{flag.strip('-').replace('-', '_')}_{abs(hash((path, Path(path).stat().st_mtime_ns)))}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ParameterError(f"{path}: not a Python file; {flag} takes one with {what}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ParameterError(f"{path}: {where(error, path)}") from error
    return module
