"""What somebody passes to an environment, checked before anything moves: one ParameterError that says what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from math import isfinite
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..errors import given as shown_of
from ..trials.cases import Case

LONGEST_DT_S = 0.1  # the safety envelope's


def given(value: Any) -> str:
    """As an error shows it; a numpy number as the number that it is."""
    return shown_of(value.item() if isinstance(value, np.generic) else value)


def is_whole(value: Any) -> bool:
    """Whether it is a whole number; True and False are none."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def whole(name: str, value: Any, least: int) -> int:
    """A whole number, `least` or more."""
    if not is_whole(value) or value < least:
        raise ParameterError(f"{name} is {given(value)}; allowed: a whole number, {least} or more")
    return int(value)


def number(name: str, value: Any, allowed: str, least: float, most: float) -> float:
    """A number within [least, most]."""
    good = isinstance(value, (int, float, np.number)) and not isinstance(value, (bool, np.complexfloating))
    if not good or not isfinite(value) or not least <= value <= most:
        raise ParameterError(f"{name} is {given(value)}; allowed: {allowed}")
    return float(value)


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ParameterError(f"{name} is {given(value)}; allowed: True, False")
    return bool(value)


def asked_seed(seed: Any) -> int | None:
    """None, or a whole number that Gymnasium takes."""
    return None if seed is None else whole("seed", seed, 0)


def asked_seeds(seed: Any, runs: int) -> list[int | None]:
    """One a run: from one number s on s, s + 1, ...; or as they were given."""
    if is_whole(seed):
        return [whole("seed", seed, 0) + n for n in range(runs)]
    if not isinstance(seed, (list, tuple, np.ndarray)) or np.ndim(seed) != 1 or len(seed) != runs:
        raise ParameterError(f"seed is {given(seed)}; allowed: one number, or one a run, {runs}")
    return [asked_seed(one) for one in seed]


def asked_case(options: Any) -> Case | None:
    """The one of `options`, the only thing there is to ask."""
    if options is not None and not isinstance(options, Mapping):
        raise ParameterError(f"options is {given(options)}; allowed: {{'case': case}}, a trials.Case")
    if stray := sorted(map(str, set(options or {}) - {"case"})):
        raise ParameterError(f"options has {stray[0]!r}; allowed: case, a trials.Case")
    return (options or {}).get("case")


def check_case(case: Any, setting: Any) -> None:
    """ParameterError unless the case is of this environment's task and role."""
    if not isinstance(case, Case):
        raise ParameterError(f"case is {type(case).__name__}; allowed: a trials.Case, for example of comanip.gym.trial_cases")
    for name, has, wanted in (("role", case.role, setting.role), ("task", case.task.name, setting.task.name)):
        if has != wanted:
            raise ParameterError(f"the case's {name} is {has!r}; this environment's is {wanted!r}")


def asked_render(mode: Any, modes: tuple[str, ...] = ("rgb_array",)) -> str | None:
    """One of the modes, or None."""
    if not (mode is None or (isinstance(mode, str) and mode in modes)):
        raise ParameterError(f"render_mode is {given(mode)}; allowed: {', '.join(modes)}, or None")
    return mode


def check_drawn(mode: str | None, episode: Any) -> None:
    """ParameterError where there is nothing to draw, or nobody asked for pictures when the environment was made."""
    if mode is None:
        raise ParameterError("render_mode is None, so nothing is drawn; make the environment with render_mode='rgb_array'")
    if episode is None:
        raise ParameterError("no episode has begun: call reset() before render()")


def settings(kind: type, more: Mapping[str, Any], taken: tuple[str, ...]) -> dict[str, Any]:
    """Of the arguments that are passed on to `kind`, a Setting, each checked; `taken` are no arguments."""
    known = [one.name for one in fields(kind) if one.name not in taken]
    if stray := sorted(set(more) - set(known)):
        raise ParameterError(f"argument {stray[0]!r} is unknown; there are: task, role, people, {', '.join(known)}")
    found = dict(more)
    for name in {"envelope", "ends_early"} & set(found):
        found[name] = flag(name, found[name])
    if "misbehaving" in found:
        found["misbehaving"] = number("misbehaving", found["misbehaving"], "a share of the partners, 0 to 1", 0.0, 1.0)
    if "dt" in found:
        said = f"a control period in (0, {LONGEST_DT_S:g}] s"
        found["dt"] = number("dt", found["dt"], said, np.nextafter(0.0, 1.0), LONGEST_DT_S)
    if "history" in found and is_whole(found["history"]):
        found["history"] = int(found["history"])
    return found
