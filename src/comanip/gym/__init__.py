"""Carry-Gym: partners who answer by force, for everybody's policy, as Gymnasium and PettingZoo environments.

    import gymnasium, comanip.gym
    env = gymnasium.make("comanip/Carry-v0", task="lift", role="follower", people="usual", plant="beam")

Importing this room registers the environment; `gymnasium.make("comanip.gym:comanip/Carry-v0")` does both. It needs the extra
`gym` (gymnasium, pettingzoo). docs/gym.md says how a score is made.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

ID = "comanip/Carry-v0"
_PUBLIC = {
    "CarryEnv": "env",
    "CarryPair": "pair",
    "CarryVectorEnv": "vector",
    "Setting": "episode",
    "trial_cases": "draw",
}
__all__ = ["ID", "CarryEnv", "CarryPair", "CarryVectorEnv", "Setting", "register", "trial_cases"]


def register() -> None:
    """Makes the environment known to Gymnasium by its name, once; a no-op where Gymnasium is not installed."""
    if find_spec("gymnasium") is None:
        return
    registering = import_module("gymnasium.envs.registration")
    if ID not in registering.registry:
        registering.register(
            id=ID, entry_point="comanip.gym.env:CarryEnv", vector_entry_point="comanip.gym.vector:CarryVectorEnv"
        )


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has: {', '.join(__all__)}")
    return getattr(import_module(f"{__name__}.{_PUBLIC[name]}"), name)


register()
