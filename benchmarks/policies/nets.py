"""Small networks of the baselines, and the file that each entry of the board is asked through.

All see what `trials.sight` shows, made relative to the start of the run and scaled by the lessons' (or the task's) spread.
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from pprint import pformat
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

torch.set_num_threads(1)  # nets this small are slower on several cores
CHUNK, MEMORY = 20, 5  # [ticks] that ACT foresees, and that it sees
SEEN, HELD = (8, 4, 0), 4  # [ticks] ago that PPO sees, and for which a decision of its is held
SCALES = (0.2, 0.25, 5.0)  # of position from the start [m], velocity [m/s], force [N], for PPO
SAID_M_PER_S2, LEAK_PER_S = 2.0, 3.0  # what 1 of PPO's network means; a damper below it, so that noise does not walk away


def accelerations(actions: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """What the -1 to 1 of PPO's network means at this velocity [m/s^2]."""
    return SAID_M_PER_S2 * np.clip(actions, -1.0, 1.0) - LEAK_PER_S * velocity


def picked(seen: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(N, 3 d len(SEEN)) what PPO's network sees of (N, 3 d history): from the start of the run, and scaled."""
    n, d = len(seen), start.shape[1]
    ticks = seen.reshape(n, -1, 3, d)[:, [-1 - ago for ago in SEEN]].copy()
    ticks[:, :, 0] -= start[:, None]
    return np.clip(ticks / np.array(SCALES)[:, None], -100.0, 100.0).reshape(n, -1).astype(np.float32)


class Mlp(nn.Module):
    """Two hidden layers of 64."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        self.net = nn.Sequential(nn.Linear(n_in, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, n_out))

    def forward(self, x: Tensor) -> Tensor:
        return self.net(x)


class Gru(nn.Module):
    """64 units of memory; (B, T, n) in, (B, T, d) out."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        self.gru, self.out = nn.GRU(n_in, 64, batch_first=True), nn.Linear(64, n_out)

    def forward(self, x: Tensor, memory: Tensor | None = None) -> tuple[Tensor, Tensor]:
        y, memory = self.gru(x, memory)
        return self.out(y), memory


class Act(nn.Module):
    """Action chunking with transformers (Zhao et al. 2023) without images and without its style variable, which is 0 when asked.

    The last MEMORY ticks are tokens of an encoder; CHUNK learned queries of a decoder give the next CHUNK velocities.
    """

    def __init__(self, n_in: int, n_out: int, width: int = 48) -> None:
        super().__init__()
        about = {"d_model": width, "nhead": 4, "dim_feedforward": 96, "dropout": 0.0, "batch_first": True}
        self.token, self.place = nn.Linear(n_in, width), nn.Parameter(0.02 * torch.randn(MEMORY, width))
        self.queries = nn.Parameter(0.02 * torch.randn(CHUNK, width))
        self.encoder = nn.TransformerEncoder(nn.TransformerEncoderLayer(**about), 2, enable_nested_tensor=False)
        self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(**about), 1)
        self.out = nn.Linear(width, n_out)

    def forward(self, x: Tensor) -> Tensor:
        """(B, MEMORY, n) -> (B, CHUNK, d)"""
        seen = self.encoder(self.token(x) + self.place)
        return self.out(self.decoder(self.queries.expand(len(x), -1, -1), seen))


KINDS = {"mlp": Mlp, "gru": Gru, "act": Act, "ppo": Mlp}


class Brain:
    """One trained network as `comanip trial --law-from` asks it; `kept` is what `save` stored."""

    action, history = "velocity", 1

    def __init__(self, kept: dict[str, Any]) -> None:
        self.d, self.by = kept["n_out"], kept["by"]
        self.net = KINDS[kept["kind"]](kept["n_in"], kept["n_out"]).eval()
        self.net.load_state_dict(kept["weights"])
        self.mean, self.scale = np.array(kept["mean"]), np.array(kept["scale"])
        self.reset()

    def reset(self) -> None:
        self.memory: Any = None
        self.start: Any = None

    def scaled(self, seen: np.ndarray) -> Tensor:
        """(3 d,) from where the run began, by the lessons' spread."""
        now = seen[-3 * self.d :].copy()
        self.start = now[: self.d].copy() if self.start is None else self.start
        now[: self.d] -= self.start
        return torch.as_tensor((now - self.mean) / self.scale, dtype=torch.float32)

    @torch.no_grad()
    def __call__(self, seen: np.ndarray) -> np.ndarray:
        return self.net(self.scaled(seen)).double().numpy() * self.by


class Remembering(Brain):
    """A GRU."""

    @torch.no_grad()
    def __call__(self, seen: np.ndarray) -> np.ndarray:
        y, self.memory = self.net(self.scaled(seen)[None, None], self.memory)
        return y[0, 0].double().numpy() * self.by


class Chunking(Brain):
    """ACT: (CHUNK, d) at each tick, which `trials.policies` averages with those before."""

    def __init__(self, kept: dict[str, Any]) -> None:
        super().__init__(kept)
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")  # traced it is asked in a quarter of the time; that traces are out of fashion is said
            self.net = torch.jit.freeze(torch.jit.trace(self.net, torch.zeros(1, MEMORY, kept["n_in"])))

    @torch.no_grad()
    def __call__(self, seen: np.ndarray) -> np.ndarray:
        x = self.scaled(seen)
        self.memory = x.repeat(MEMORY, 1) if self.memory is None else torch.cat([self.memory[1:], x[None]])
        return self.net(self.memory[None])[0].double().numpy() * self.by


class Held(Brain):
    """PPO: a decision is held for HELD ticks, the damper below it works at each."""

    action, history = "acceleration", SEEN[0] + 1

    def reset(self) -> None:
        super().reset()
        self.ticks, self.said = 0, np.zeros(self.d)

    @torch.no_grad()
    def __call__(self, seen: np.ndarray) -> np.ndarray:
        now = seen[-3 * self.d :]
        self.start = now[: self.d].copy() if self.start is None else self.start
        if self.ticks % HELD == 0:
            past = seen[: 3 * self.d * self.history]
            self.said = self.net(torch.as_tensor(picked(past[None], self.start[None])))[0].double().numpy()
        self.ticks += 1
        return accelerations(self.said, now[self.d : 2 * self.d])


BRAINS = {"mlp": Brain, "gru": Remembering, "act": Chunking, "ppo": Held}


def sums(out: Path, name: str) -> dict[str, str]:
    """SHA-256 of each network of a policy, by file: its own hash, which a result states, then is one of them, too."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(out.glob(f"{name}_*.pt"))}


ENTRY = '''"""{what}"""

import sys

sys.path.insert(0, {here!r})
from nets import skill_of

WEIGHTS = {weights}


def skill(role, axes, dt, task):
    return skill_of({out!r}, {name!r}, role, axes, dt, task, WEIGHTS)
'''


def entry(out: Path, name: str, what: str) -> Path:
    """The policy's file: comanip trial --law-from OUT/NAME.py"""
    file = out / f"{name}.py"
    about = {"here": str(Path(__file__).parent.resolve()), "out": str(out.resolve()), "weights": pformat(sums(out, name))}
    file.write_text(ENTRY.format(what=what, name=name, **about))
    return file


def save(out: Path, name: str, task: str, role: str, net: nn.Module, **about: Any) -> Path:
    """Where `skill_of` looks for it."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / f"{name}_{task}_{role}.pt"
    torch.save({"weights": net.state_dict(), **about}, file)
    return file


_loaded: dict[str, Any] = {}


def brain_of(out: str, name: str, role: str, task: str, weights: dict[str, str]) -> Brain:
    """Raises FileNotFoundError where none was trained, ValueError where the network is not the one that the entry states."""
    file = str(Path(out) / f"{name}_{task}_{role}.pt")
    if file not in _loaded:
        if not Path(file).is_file():
            raise FileNotFoundError(f"{name} was not trained for {task} as {role}: no {file}")
        if hashlib.sha256(Path(file).read_bytes()).hexdigest() != weights.get(Path(file).name):
            raise ValueError(f"{file} is not the network that {name}.py states: train again, or write the entry again")
        _loaded[file] = torch.load(file, weights_only=True)
    return BRAINS[_loaded[file]["kind"]](_loaded[file])


def skill_of(out: str, name: str, role: str, axes: Any, dt: float, task: str, weights: dict[str, str]) -> Any:
    """The network of this task and role; told nothing, an Arbiter of both (`comanip.skills.arbiter`)."""
    from comanip.trials.policies import Called, Policy
    from comanip.trials.sight import Seen

    def one(of: str) -> Policy:
        brain = brain_of(out, name, of, task, weights)
        return Policy(f"{name}.py", Called(brain, Seen(len(axes), brain.history, action=brain.action), {}), None, dt)

    if role != "auto":
        return one(role)
    from comanip.skills.arbiter import Arbiter, Patience

    return Arbiter(one("follower"), one("leader"), axes=axes, dt=dt, evidence=Patience(dt))
