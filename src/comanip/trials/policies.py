"""Anybody's policy in the trials: `comanip trial --law-from my_policy.py`, `.onnx`, or a Stable-Baselines3 `.zip`.

A Python file holds one of these, found in this order; each is given those of role, axes, dt, goal, task and learned that it
names:

    class or function `skill`   gives a Skill (reset(obs), step(obs, command)), as `interfaces.Skill`
    class `Policy`              called with what is seen (`trials.sight`), gives a velocity (d,) [m/s]; `reset()` forgets
    function `policy`           the same without memory

HISTORY = n and ACTION = "acceleration" in the file change what is seen and what is said. An ONNX file says them in its metadata,
or by the sizes of what goes in and comes out; inputs and outputs beyond the first are its memory, zeros at first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib import import_module
from inspect import isclass, signature
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Skill
from ..learned.skill import LearnedSkill
from ..tasks import Task
from .foreign import module_of, where
from .sight import Seen, Sight, Told, checked

LOADERS = {".py": "", ".onnx": "onnx_policy", ".zip": "sb3_policy"}
WHAT = "a class or function `skill`, a class `Policy`, or a function `policy`"
FORGETS = 0.01  # exponent a tick of the weights of a chunk's predictions, the oldest first: those of ACT (Zhao et al. 2023)


def is_policy(law: str) -> bool:
    """Whether a law's name is that of a file."""
    return Path(law).suffix.lower() in LOADERS


def check_policy(file: str) -> None:
    """ParameterError for what is no file, or none of a kind that is known."""
    if not is_policy(file):
        raise ParameterError(f"--law-from {file}: a policy is a file that ends in {', '.join(LOADERS)}")
    if not Path(file).is_file():
        raise ParameterError(f"--law-from {file}: no such file")


def policy_skill(
    file: str,
    role: str,
    learned: Mapping[str, LearnedSkill],
    *,
    axes: tuple[str, ...],
    dt: float,
    goal: Array | None = None,
    task: Task | None = None,
) -> Skill:
    """The skill that a file stands for, without an envelope.

    Raises ParameterError, in one line with the file's name, for what cannot be loaded, and for a first answer that is no (d,)
    finite numbers. What fails later, in a run, is a fault of the policy: the envelope stops the robot, and the verdict says so.
    """
    check_policy(file)
    offered = {"role": role, "axes": axes, "dt": dt, "goal": goal, "task": task.name if task else "", "learned": dict(learned)}
    reader = LOADERS[Path(file).suffix.lower()]
    if reader:
        brain = import_module(f"{__package__}.{reader}").brain(file, len(axes), goal is not None)
        return Policy(file, brain, goal, dt)
    return _from_python(file, offered)


class Brain:
    """What a policy is behind every format: what it sees and says, `reset`, and a call that answers (d,), or a chunk (H, d)."""

    seen: Seen

    def reset(self) -> None:
        """Forgets."""

    def __call__(self, values: Array) -> Any:
        raise NotImplementedError


class Policy(Told):
    """A Brain as a Skill. An answer of H next ones is averaged with those for this tick before (ACT's temporal ensembling)."""

    def __init__(self, file: str, brain: Brain, goal: Array | None, dt: float) -> None:
        super().__init__(brain.seen, dt=dt)
        self.file, self.brain, self._sight = file, brain, Sight(brain.seen, goal)
        self._seen, self._began = brain.seen, False
        self._try_out()

    def _try_out(self) -> None:
        """Its first answer, to zeros, before a run is begun for nothing."""
        try:
            self.brain.reset()
            self._chunks: list[Array] = []
            self._answer(np.zeros(self._seen.size))
        except Exception as error:
            raise ParameterError(f"{self.file}: {where(error, self.file)}") from None

    def reset(self, obs: Observation) -> None:
        super().reset(obs)
        self.brain.reset()
        self._chunks = []
        self._sight.begin(obs)
        self._began = True

    def step(self, obs: Observation, command: Command) -> None:
        values = self._sight.values if self._began else self._sight.look(obs)
        self._began = False
        try:
            self.say(self._answer(values))
        except Exception as error:
            raise ParameterError(where(error, self.file)) from None
        super().step(obs, command)

    def _answer(self, values: Array) -> Array:
        """What is said now (d,)."""
        answer = self.brain(values.copy())
        chunk = np.asarray(answer, dtype=float)
        if chunk.ndim != 2:
            return checked(answer, self._seen)
        for row in chunk:
            checked(row, self._seen)
        self._chunks = [one[1:] for one in self._chunks if len(one) > 1] + [chunk]
        weights = np.exp(-FORGETS * np.arange(len(self._chunks)))
        return np.asarray(weights @ np.array([one[0] for one in self._chunks]) / weights.sum())


class Called(Brain):
    """A function or an object of a Python file."""

    def __init__(self, function: Callable[..., Any], seen: Seen, given: Mapping[str, Any]) -> None:
        self._function, self._given, self.seen = function, dict(given), seen

    def reset(self) -> None:
        if callable(forget := getattr(self._function, "reset", None)):
            forget()

    def __call__(self, values: Array) -> Any:
        return self._function(values, **self._given)


class Complete:
    """Somebody's skill with what a Skill may leave out."""

    def __init__(self, skill: Any, file: str) -> None:
        self._skill, self._file = skill, file
        for name in ("dt", "axes"):
            if hasattr(skill, name):
                setattr(self, name, getattr(skill, name))

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return getattr(self._skill, "diagnostics", MappingProxyType({}))

    @property
    def stop_reason(self) -> str:
        return str(getattr(self._skill, "stop_reason", ""))

    @property
    def notice(self) -> str:
        return str(getattr(self._skill, "notice", ""))

    def reset(self, obs: Observation) -> None:
        try:
            self._skill.reset(obs)
        except Exception as error:
            raise ParameterError(where(error, self._file)) from None

    def step(self, obs: Observation, command: Command) -> None:
        try:
            self._skill.step(obs, command)
        except Exception as error:
            raise ParameterError(where(error, self._file)) from None


def _from_python(file: str, offered: dict[str, Any]) -> Skill:
    module = module_of(file, "--law-from", WHAT)
    if callable(maker := getattr(module, "skill", None)):
        made = _made(maker, offered, file)
        if missing := [name for name in ("reset", "step") if not callable(getattr(made, name, None))]:
            raise ParameterError(f"{file}: skill gives {type(made).__name__}, which has no {' and no '.join(missing)}")
        return Complete(made, file)
    brain = _brain(module, offered, file)
    return Policy(file, brain, offered["goal"], offered["dt"])


def _brain(module: Any, offered: dict[str, Any], file: str) -> Brain:
    d, told = len(offered["axes"]), offered["goal"] is not None
    try:
        seen = Seen(d, getattr(module, "HISTORY", 1), told, getattr(module, "ACTION", "velocity"))
    except ParameterError as error:
        raise ParameterError(f"{file}: {error}") from None
    if isclass(kind := getattr(module, "Policy", None)):
        made = _made(kind, offered, file)
        if not callable(made):
            raise ParameterError(f"{file}: Policy cannot be called; give it __call__(self, seen)")
        return Called(made, seen, {})
    if callable(function := getattr(module, "policy", None)):
        return Called(function, seen, _named(function, offered))
    raise ParameterError(f"{file} holds no policy: give {WHAT}")


def _made(maker: Any, offered: dict[str, Any], file: str) -> Any:
    try:
        return maker(**_named(maker, offered))
    except Exception as error:
        raise ParameterError(f"{file}: {maker.__name__}: {where(error, file)}") from None


def _named(function: Any, offered: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the offered arguments that it names."""
    try:
        names = signature(function).parameters
    except (TypeError, ValueError):
        return {}
    return {name: value for name, value in offered.items() if name in names}


def history_of(size: int, n_axes: int, goal: bool, file: str) -> int:
    """Of how many ticks a policy sees `size` numbers."""
    ticks, left = divmod(size - goal * n_axes, 3 * n_axes)
    if left or ticks < 1:
        raise ParameterError(
            f"{file}: sees {size} numbers; on {n_axes} axes they are {3 * n_axes} a tick (position, velocity, force)"
            + (f" and {n_axes} of the goal" if goal else "")
        )
    return ticks


@lru_cache(maxsize=8)
def kept(loader: Callable[[str], Any], file: str, changed_ns: int) -> Any:
    """What was loaded from a file, once a process and until it changes."""
    return loader(file)
