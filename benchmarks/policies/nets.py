"""Small networks of the baselines, and the file that each entry of the board is asked through.

All see what `trials.sight` shows, made relative to the start of the run and scaled by the lessons' (or the task's) spread.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

torch.set_num_threads(1)  # nets this small are slower on several cores
CHUNK, MEMORY = 20, 5  # [ticks] that ACT foresees, and that it sees


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

    def __init__(self, kept: dict[str, Any]) -> None:
        self.kind, self.d, self.action = kept["kind"], kept["n_out"], kept.get("action", "velocity")
        self.leak = kept.get("leak", 0.0)
        self.net = KINDS[self.kind](kept["n_in"], kept["n_out"]).eval()
        self.net.load_state_dict(kept["weights"])
        self.mean, self.scale, self.out = (np.array(kept[name]) for name in ("mean", "scale", "by"))
        self.reset()

    def reset(self) -> None:
        self.memory, self.past, self.start = None, None, None

    @torch.no_grad()
    def __call__(self, seen: np.ndarray) -> np.ndarray:
        now = seen[-3 * self.d :].copy()
        self.start = now[: self.d].copy() if self.start is None else self.start
        now[: self.d] -= self.start
        x = torch.as_tensor((now - self.mean) / self.scale, dtype=torch.float32)
        if self.kind == "gru":
            y, self.memory = self.net(x[None, None], self.memory)
            return y[0, 0].double().numpy() * self.out
        if self.kind == "act":
            self.past = x.repeat(MEMORY, 1) if self.past is None else torch.cat([self.past[1:], x[None]])
            return self.net(self.past[None])[0].double().numpy() * self.out
        said = self.net(x).double().numpy()
        return (np.clip(said, -1.0, 1.0) if self.kind == "ppo" else said) * self.out - self.leak * seen[-2 * self.d : -self.d]


ENTRY = '''"""{what}"""

import sys

sys.path.insert(0, {here!r})
from nets import skill_of


def skill(role, axes, dt, task):
    return skill_of({out!r}, {name!r}, role, axes, dt, task)
'''


def entry(out: Path, name: str, what: str) -> Path:
    """The policy's file: comanip trial --law-from OUT/NAME.py"""
    file = out / f"{name}.py"
    file.write_text(ENTRY.format(what=what, here=str(Path(__file__).parent.resolve()), out=str(out.resolve()), name=name))
    return file


def save(out: Path, name: str, task: str, role: str, net: nn.Module, **about: Any) -> Path:
    """Where `skill_of` looks for it."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / f"{name}_{task}_{role}.pt"
    torch.save({"weights": net.state_dict(), **about}, file)
    return file


_loaded: dict[str, Any] = {}


def brain_of(out: str, name: str, role: str, task: str) -> Brain:
    file = str(Path(out) / f"{name}_{task}_{role}.pt")
    if file not in _loaded:
        if not Path(file).is_file():
            raise FileNotFoundError(f"{name} was not trained for {task} as {role}: no {file}")
        _loaded[file] = torch.load(file, weights_only=True)
    return Brain(_loaded[file])


def skill_of(out: str, name: str, role: str, axes: Any, dt: float, task: str) -> Any:
    """The network of this task and role; told nothing, an Arbiter of both (`comanip.skills.arbiter`)."""
    from comanip.trials.policies import Called, Policy
    from comanip.trials.sight import Seen

    def one(of: str) -> Policy:
        brain = brain_of(out, name, of, task)
        return Policy(f"{name}.py", Called(brain, Seen(len(axes), action=brain.action), {}), None, dt)

    if role != "auto":
        return one(role)
    from comanip.skills.arbiter import Arbiter, Patience

    return Arbiter(one("follower"), one("leader"), axes=axes, dt=dt, evidence=Patience(dt))
