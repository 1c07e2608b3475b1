"""A policy in a zip of Stable-Baselines3. Such a file holds pickles, which run what they like: open your own alone."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from .policies import Brain, history_of, kept
from .sight import ACTIONS, Seen

# what only this algorithm's zip states, in this order: TD3 is a DDPG with more
ALGORITHMS = (
    ("PPO", "clip_range"),
    ("SAC", "target_entropy"),
    ("TD3", "target_policy_noise"),
    ("A2C", "normalize_advantage"),
)


def brain(file: str, n_axes: int, goal: bool) -> Brain:
    """Its mean action. What its own action space holds (often -1 to 1) is spread over what may be said: RescaleAction's rule."""
    model = kept(_model, file, Path(file).stat().st_mtime_ns)
    return _Model(model, file, n_axes, goal)


def _model(file: str) -> Any:
    stated = _stated(file)
    name = next((name for name, key in ALGORITHMS if key in stated), None)
    if name is None:
        raise ParameterError(f"{file}: of none of the algorithms {', '.join(name for name, _ in ALGORITHMS)}")
    try:
        import stable_baselines3
        import torch
    except ImportError as error:
        raise ParameterError(f"{file}: .zip needs stable-baselines3 ({error}): pip install 'comanip[sb3]'") from None
    torch.set_num_threads(1)  # of a net this small more are slower, and trials have a process a core
    try:
        return getattr(stable_baselines3, name).load(file, device="cpu")
    except Exception as error:
        raise ParameterError(f"{file}: stable-baselines3 cannot load it: {error}") from None


def _stated(file: str) -> dict[str, Any]:
    """The settings of a zip, read without running anything."""
    try:
        with zipfile.ZipFile(file) as packed:
            found = json.loads(packed.read("data"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise ParameterError(f"{file}: no zip of Stable-Baselines3: {error}") from None
    return dict(found)


class _Model(Brain):
    def __init__(self, model: Any, file: str, n_axes: int, goal: bool) -> None:
        shape: tuple[int, ...] = tuple(model.observation_space.shape or ())
        space = model.action_space
        if len(shape) != 1 or getattr(space, "shape", None) != (n_axes,):
            raise ParameterError(
                f"{file}: sees {shape}, says {getattr(space, 'shape', space)}; on {n_axes} axes a policy says ({n_axes},)"
            )
        most = float(np.abs(space.high).max())
        action = "acceleration" if np.isclose(most, ACTIONS["acceleration"]) else "velocity"
        self.seen = Seen(n_axes, history_of(shape[0], n_axes, goal, file), goal, action)
        self._model, self._low, self._span = model, space.low.astype(float), (space.high - space.low).astype(float)

    def __call__(self, values: Array) -> Array:
        said, _ = self._model.predict(values, deterministic=True)
        most = self.seen.most
        return np.asarray(-most + 2.0 * most * (np.asarray(said, dtype=float) - self._low) / self._span)
