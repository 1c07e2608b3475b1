"""Behaviour cloning from lessons: python benchmarks/policies/train_bc.py OUT --lessons-in LESSONS

Kinds: mlp, gru (one-step), act (chunks), each from 5, 50 and 500 lessons of benchmarks/policies/lessons.py. The curve of the
held-out error goes to OUT/KIND_LESSONS_TASK_ROLE.csv and the policy to OUT/KIND_LESSONS.py, for comanip trial --law-from. Needs
torch.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TextIO

import numpy as np
import torch
from nets import CHUNK, KINDS, MEMORY, entry, save
from torch import Tensor, nn

from lessons import stored

HELD_OUT = 0.1  # of the lessons, one at least
RATE = 2e-3
NOISE = 0.05  # of the scaled input: what is seen in a run is never quite a lesson


def relative(lesson: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Positions from where the lesson began."""
    seen, said = lesson
    d = said.shape[1]
    return np.hstack([seen[:, :d] - seen[0, :d], seen[:, d:]]), said


class Steps:
    """One tick, one velocity."""

    @staticmethod
    def rows(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        return x, y


class Chunks:
    """The last MEMORY ticks, the next CHUNK velocities; at rest before the start and as it ended after the end."""

    @staticmethod
    def rows(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        before = torch.cat([x[:1].repeat(MEMORY - 1, 1), x]).unfold(0, MEMORY, 1).transpose(1, 2)
        after = torch.cat([y, y[-1:].repeat(CHUNK - 1, 1)]).unfold(0, CHUNK, 1).transpose(1, 2)
        return before, after


def batches(kind: str, data: list[tuple[Tensor, Tensor]], rng: np.random.Generator, size: int):
    """Whole lessons for a memory, else rows of all of them, in random order."""
    if kind == "gru":
        order = rng.permutation(len(data))
        for n in range(0, len(order), 16):
            some = [data[i] for i in order[n : n + 16]]
            yield tuple(nn.utils.rnn.pad_sequence([one[k] for one in some], batch_first=True) for k in range(2))
        return
    rows = [(Chunks if kind == "act" else Steps).rows(x, y) for x, y in data]
    x, y = (torch.cat([one[k] for one in rows]) for k in range(2))
    order = torch.as_tensor(rng.permutation(len(x)))
    for n in range(0, len(order), size):
        some = order[n : n + size]
        yield x[some], y[some]


def error(kind: str, net: nn.Module, x: Tensor, y: Tensor) -> Tensor:
    said = net(x)[0] if kind == "gru" else net(x)
    return ((said - y) ** 2).mean()


class Data:
    """Scaled lessons, to train on and held out."""

    def __init__(self, lessons: list[tuple[np.ndarray, np.ndarray]]) -> None:
        seen, said = (np.vstack([one[k] for one in lessons]) for k in range(2))
        self.mean, self.scale, self.by = seen.mean(axis=0), seen.std(axis=0) + 1e-3, float(said.std()) + 1e-3
        self.n_in, self.n_out = seen.shape[1], said.shape[1]
        both = [(torch.as_tensor((x - self.mean) / self.scale).float(), torch.as_tensor(y / self.by).float()) for x, y in lessons]
        held = max(1, round(HELD_OUT * len(both)))
        self.train, self.test = both[:-held], both[-held:]


def trained(kind: str, data: Data, curve: TextIO, *, seconds: float, rng: np.random.Generator) -> tuple[nn.Module, float]:
    """The network of the least held-out error, and that, as a share of the variance."""
    net = KINDS[kind](data.n_in, data.n_out)
    optimiser = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=1e-4)
    began, best, kept = time.process_time(), np.inf, net.state_dict()
    curve.write("cpu_s,train,held_out\n")
    while (spent := time.process_time() - began) < seconds:
        for group in optimiser.param_groups:
            group["lr"] = RATE * (1.0 - 0.9 * spent / seconds)
        losses = []
        for x, y in batches(kind, data.train, rng, 512):
            losses.append(improved(kind, net, optimiser, x, y))
            if time.process_time() - began > seconds:
                break
        with torch.no_grad():
            tried = float(np.mean([error(kind, net, x, y).item() for x, y in batches(kind, data.test, rng, 4096)]))
        curve.write(f"{time.process_time() - began:.2f},{np.mean(losses):.5f},{tried:.5f}\n")
        if tried < best:
            best, kept = tried, {key: value.clone() for key, value in net.state_dict().items()}
    net.load_state_dict(kept)
    return net, best


def improved(kind: str, net: nn.Module, optimiser: torch.optim.Optimizer, x: Tensor, y: Tensor) -> float:
    optimiser.zero_grad()
    loss = error(kind, net, x + NOISE * torch.randn_like(x), y)
    loss.backward()
    nn.utils.clip_grad_norm_(net.parameters(), 1.0)
    optimiser.step()
    return loss.item()


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("out", type=Path)
    words.add_argument("--lessons-in", type=Path, required=True)
    words.add_argument("--kind", nargs="+", choices=("mlp", "gru", "act"), default=["mlp", "gru", "act"])
    words.add_argument("--task", nargs="+", default=["lift"])
    words.add_argument("--role", nargs="+", default=["follower", "leader"])
    words.add_argument("--lessons", nargs="+", type=int, default=[5, 50, 500])
    words.add_argument("--seconds", type=float, default=4.0, help="of CPU time that each may take")
    words.add_argument("--seed", type=int, default=0)
    asked = words.parse_args()
    for kind in asked.kind:
        for task in asked.task:
            for role in asked.role:
                for lessons in asked.lessons:
                    one(asked.out, asked.lessons_in, kind, task, role, lessons, seconds=asked.seconds, seed=asked.seed)


def one(out: Path, stored_in: Path, kind: str, task: str, role: str, n: int, *, seconds: float, seed: int) -> None:
    """One network, its curve and its entry."""
    torch.manual_seed(seed)
    lessons = [relative(lesson) for lesson in stored(stored_in, task, role)[:n]]
    if len(lessons) < max(n, 2):
        raise SystemExit(f"{stored_in}: {len(lessons)} lessons of {task} as {role}; needed: {n}, 2 at least")
    data, name = Data(lessons), f"{kind}_{n}"
    out.mkdir(parents=True, exist_ok=True)
    with (out / f"{name}_{task}_{role}.csv").open("w") as curve:
        net, best = trained(kind, data, curve, seconds=seconds, rng=np.random.default_rng(seed))
    about = {"kind": kind, "n_in": data.n_in, "n_out": data.n_out, "by": data.by}
    save(out, name, task, role, net, **about, mean=data.mean.tolist(), scale=data.scale.tolist())
    file = entry(out, name, f"{kind}, cloned from {n} lessons by benchmarks/policies/train_bc.py")
    print(f"{file}: {task} as {role}, held-out error {best:.4f} of the variance", flush=True)


if __name__ == "__main__":
    main()
