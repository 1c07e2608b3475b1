"""PPO on comanip/Carry-v0, for a stated time of one core: python benchmarks/policies/train_ppo.py OUT --role follower

Stable-Baselines3's PPO on `CarryVectorEnv`. The curve (minutes of CPU time, steps, success and mean return with partners of their
own seed, beside those of a hand that does nothing) goes to OUT/ppo_TASK_ROLE.csv and .png, the policy to OUT/ppo.py, for
comanip trial --law-from. Needs stable-baselines3; the picture needs matplotlib.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from figures import ppo_curves
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from nets import HELD, SAID_M_PER_S2, SEEN, Mlp, accelerations, entry, picked, save
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from comanip.gym import CarryVectorEnv

ABOUT: dict[str, Any] = {
    "misbehaving": 0.0,
    "action": "acceleration",
    "history": SEEN[0] + 1,
    "autoreset_mode": AutoresetMode.SAME_STEP,
}
WORTH = 0.1  # of the reward: returns of about 1 suit the step of the critic
PARTNERS, TRIED_SEED, EVERY_MIN = 40, 5, 0.5
HOW = {"n_steps": 64, "batch_size": 512, "n_epochs": 6, "gamma": 0.995, "gae_lambda": 0.95, "learning_rate": 5e-4}
# Noise that depends on what is seen (Raffin et al. 2022): a hand that feels nothing stands still. White noise drifts it 1 cm,
# which is "moved before the partner", or is too small to be felt.
NOISE = {"use_sde": True, "sde_sample_freq": 16}
LOUDEST, QUIETER = -2.0, 2.5  # log of its scale, and how much lower it is at the end: a hand that shakes at rest has lost
NET = {"log_std_init": LOUDEST, "net_arch": [64, 64]}


class Runs:
    """`CarryVectorEnv`, a decision of which is held for HELD ticks: observations from the start of the run and scaled."""

    def __init__(self, n: int, task: str, role: str) -> None:
        self.envs = CarryVectorEnv(n, task, role, **ABOUT)
        self.n, self.d = n, self.envs.setting.seen.n_axes
        if self.envs.setting.seen.goal:
            raise SystemExit(f"{task} as {role} is told where to lead to; this script trains nobody who is")

    def reset(self, seed: int) -> np.ndarray:
        self.seen, _ = self.envs.reset(seed=seed)
        self.start = self.seen[:, -3 * self.d : -2 * self.d].copy()
        return picked(self.seen, self.start)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[int, tuple[np.ndarray, bool]]]:
        """What is seen then, the rewards, who has ended, and {run: what it saw last, whether it was a success}."""
        reward, over, last = np.zeros(self.n), np.zeros(self.n, dtype=bool), {}
        for _ in range(HELD):
            said = accelerations(actions, self.seen[:, -2 * self.d : -self.d])
            said[over] = 0.0  # the next run begins at rest, and with the next decision
            self.seen, worth, ended, _, infos = self.envs.step(said)
            reward += np.where(over, 0.0, worth)
            for k in np.flatnonzero(ended & ~over).tolist():
                seen = picked(infos["final_obs"][k][None], self.start[k : k + 1])[0]
                last[k] = seen, bool(infos["final_info"]["success"][k])
                self.start[k] = self.seen[k, -3 * self.d : -2 * self.d]
            over |= ended
        return picked(self.seen, self.start), reward, over, last


class Training(VecEnv):
    """`Runs` as Stable-Baselines3 takes them."""

    def __init__(self, n: int, task: str, role: str, seed: int) -> None:
        self.runs, self.first = Runs(n, task, role), seed
        d = self.runs.d
        super().__init__(n, Box(-100.0, 100.0, (3 * d * len(SEEN),)), Box(-1.0, 1.0, (d,)))

    def reset(self) -> np.ndarray:
        return self.runs.reset(self.first)

    def step_async(self, actions: np.ndarray) -> None:
        self.said = actions

    def step_wait(self):
        seen, reward, ended, last = self.runs.step(self.said)
        told: list[dict] = [{"terminal_observation": last[k][0]} if k in last else {} for k in range(self.num_envs)]
        return seen, (WORTH * reward).astype(np.float32), ended, told

    def close(self) -> None:
        """Nothing is held open."""

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.runs.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None) -> None:
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


def judged(runs: Runs, policy: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Success and mean return of a policy with partners of a seed that is not trained with."""
    seen, over, good, worth = runs.reset(TRIED_SEED), np.zeros(runs.n, dtype=bool), 0, np.zeros(runs.n)
    while not over.all():
        seen, reward, ended, last = runs.step(policy(seen))
        worth += np.where(over, 0.0, reward)
        good += sum(success for k, (_, success) in last.items() if not over[k])
        over |= ended
    return good / runs.n, float(worth.mean())


def mean_of(net: Mlp) -> Callable[[np.ndarray], np.ndarray]:
    """What a network says without noise."""

    @torch.no_grad()
    def said(seen: np.ndarray) -> np.ndarray:
        return net(torch.as_tensor(seen, dtype=torch.float32)).double().numpy()

    return said


class Curve(BaseCallback):
    """Tries the mean policy on the same partners now and then, writes what came of it, keeps the best, stops in time."""

    def __init__(self, d: int, file: Path, asked: argparse.Namespace, keep: Callable[[PPO], None]) -> None:
        super().__init__()
        self.keep, self.minutes, self.best, self.d, self.next = keep, asked.minutes, (-1.0, 0.0), d, 0.0
        self.tried, self.file = Runs(PARTNERS, asked.task, asked.role), file
        self.nothing = judged(self.tried, lambda seen: np.zeros((PARTNERS, d)))
        print(f"does nothing: success {self.nothing[0]:.3f}, return {self.nothing[1]:.2f}", flush=True)
        self.rows: list[tuple[float, ...]] = []
        self.began, self.began_wall = time.process_time(), time.monotonic()

    @property
    def done_min(self) -> float:
        """Of CPU time, trying included."""
        return (time.process_time() - self.began) / 60.0

    def _on_step(self) -> bool:
        return self.done_min < self.minutes

    def _on_rollout_start(self) -> None:
        loudest = LOUDEST - QUIETER * min(self.done_min / self.minutes, 1.0)
        self.model.policy.log_std.data.clamp_(max=loudest)

    def _on_rollout_end(self) -> None:
        if self.done_min >= self.next:
            self.next = self.done_min + EVERY_MIN
            self.say()

    def say(self) -> None:
        good, worth = judged(self.tried, mean_of(network(self.model, self.d)))
        wall, steps = (time.monotonic() - self.began_wall) / 60.0, self.num_timesteps * HELD
        self.rows.append((round(self.done_min, 2), round(wall, 2), steps, good, round(worth, 3), *self.nothing))
        with self.file.open("w", newline="") as out:
            csv.writer(out).writerows([("cpu_min", "wall_min", "steps", "success", "return", "nothing", "nothing_return")])
            csv.writer(out).writerows(self.rows)
        noise = self.model.policy.log_std.exp().mean().item()
        print(f"{self.done_min:.1f} min, {steps} steps: success {good:.3f}, return {worth:.2f}, noise {noise:.3f}", flush=True)
        if (good, worth) >= self.best:
            self.best = good, worth
            self.keep(self.model)


def network(model: PPO, d: int) -> Mlp:
    """The mean of the policy as one of `nets`."""
    net, policy = Mlp(3 * d * len(SEEN), d), model.policy
    layers = [policy.mlp_extractor.policy_net[0], policy.mlp_extractor.policy_net[2], policy.action_net]
    for mine, theirs in zip([net.net[0], net.net[2], net.net[4]], layers, strict=True):
        mine.load_state_dict(theirs.state_dict())
    return net


def train(asked: argparse.Namespace) -> tuple[float, float]:
    """The best policy's success and return with the partners of the curve; its files are in asked.out."""
    asked.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    envs = Training(asked.runs, asked.task, asked.role, 1000 + asked.seed)
    model = PPO("MlpPolicy", envs, **HOW, **NOISE, seed=asked.seed, device="cpu", policy_kwargs=NET)
    d = envs.runs.d
    about = {"kind": "ppo", "n_in": 3 * d * len(SEEN), "n_out": d, "by": SAID_M_PER_S2, "mean": [], "scale": []}

    def keep(model: PPO) -> None:
        save(asked.out, "ppo", asked.task, asked.role, network(model, d), **about)

    curve = Curve(d, asked.out / f"ppo_{asked.task}_{asked.role}.csv", asked, keep)
    model.learn(total_timesteps=10**9, callback=curve)
    curve.say()
    ppo_curves([curve.file], curve.file.with_suffix(".png"))
    return curve.best


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("out", type=Path)
    words.add_argument("--task", default="lift")
    words.add_argument("--role", default="follower", choices=("follower", "leader"))
    words.add_argument("--minutes", type=float, default=3.0, help="of CPU time")
    words.add_argument("--runs", type=int, default=32)
    words.add_argument("--seed", type=int, default=0)
    asked = words.parse_args()
    best = train(asked)
    print(f"{entry(asked.out, 'ppo', 'PPO, trained by benchmarks/policies/train_ppo.py')}: best {best[0]:.3f}")


if __name__ == "__main__":
    main()
