"""PPO on comanip/Carry-v0, for a stated time: python benchmarks/policies/train_ppo.py OUT --role follower --minutes 20

Stable-Baselines3's PPO on `CarryVectorEnv`; the curve of success with partners drawn for training goes to OUT/ppo_TASK_ROLE.csv,
the policy to OUT/ppo.py. Needs stable-baselines3.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from nets import Mlp, entry, save
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from comanip.gym import CarryVectorEnv

SCALES = (0.2, 0.25, 5.0)  # of position from the start [m], velocity [m/s], force [N]
SAID_M_PER_S2, LEAK_PER_S = 2.0, 3.0  # what 1 of the network means; a damper below it, so that noise does not walk away
ABOUT = {"misbehaving": 0.0, "action": "acceleration", "autoreset_mode": AutoresetMode.SAME_STEP}


def accelerations(actions: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """What the network's -1 to 1 means at this velocity [m/s^2]."""
    return SAID_M_PER_S2 * np.clip(actions, -1.0, 1.0) - LEAK_PER_S * velocity


class Training(VecEnv):
    """`CarryVectorEnv` as Stable-Baselines3 takes it: observations from the start of the run and scaled, actions of -1 to 1."""

    def __init__(self, n: int, task: str, role: str, seed: int) -> None:
        import gymnasium

        self.envs = CarryVectorEnv(n, task, role, **ABOUT)
        self.d = self.envs.setting.seen.n_axes
        self.scale = np.repeat(SCALES, self.d)
        box = gymnasium.spaces.Box
        super().__init__(n, box(-100.0, 100.0, (3 * self.d,)), box(-1.0, 1.0, (self.d,)))
        self.first = seed

    def reset(self) -> np.ndarray:
        seen, _ = self.envs.reset(seed=self.first)
        self.start, self.moving = seen[:, : self.d].copy(), seen[:, self.d : 2 * self.d]
        return self._scaled(seen)

    def _scaled(self, seen: np.ndarray) -> np.ndarray:
        shown = seen[:, : 3 * self.d].copy()
        shown[:, : self.d] -= self.start
        return np.clip(shown / self.scale, -100.0, 100.0).astype(np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        self.said = accelerations(actions, self.moving)

    def step_wait(self):
        seen, reward, ended, _, infos = self.envs.step(self.said)
        self.moving = seen[:, self.d : 2 * self.d]
        told: list[dict] = [{} for _ in range(self.num_envs)]
        for n in np.flatnonzero(ended):
            last = infos["final_obs"][n][None, :]
            now = self.start.copy()
            self.start = self.start[n : n + 1]
            told[n] = {"terminal_observation": self._scaled(last)[0]}
            self.start = now
            self.start[n] = seen[n, : self.d]
        return self._scaled(seen), reward.astype(np.float32), ended, told

    def close(self) -> None:
        """Nothing is held open."""

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None) -> None:
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


class Curve(BaseCallback):
    """Tries the mean policy on the same partners every two minutes, writes what came of it, keeps the best, stops in time."""

    EVERY_MIN, PARTNERS = 3.0, 20

    def __init__(self, envs: Training, file: Path, asked: argparse.Namespace, keep) -> None:
        super().__init__()
        self.keep, self.minutes, self.best, self.began = keep, asked.minutes, (-1.0, 0.0), time.monotonic()
        self.out, self.d, self.scale, self.next = file.open("w", newline=""), envs.d, envs.scale, 0.0
        self.tried = CarryVectorEnv(self.PARTNERS, asked.task, asked.role, **ABOUT)
        self.out.write("minutes,steps,success,return\n")

    @property
    def done_min(self) -> float:
        return (time.monotonic() - self.began) / 60.0

    def _on_step(self) -> bool:
        return self.done_min < self.minutes

    def _on_rollout_end(self) -> None:
        if self.done_min >= self.next:
            self.next = self.done_min + self.EVERY_MIN
            self.say()

    def say(self) -> None:
        good, worth = self.judged(network(self.model, self.d))
        self.out.write(f"{self.done_min:.2f},{self.num_timesteps},{good:.3f},{worth:.2f}\n")
        self.out.flush()
        print(f"{self.done_min:.1f} min, {self.num_timesteps} steps: success {good:.3f}, return {worth:.2f}", flush=True)
        if (good, worth) >= self.best:
            self.best = good, worth
            self.keep(self.model)

    @torch.no_grad()
    def judged(self, net: Mlp) -> tuple[float, float]:
        """Success and mean return of the mean policy with partners of their own seed."""
        seen, _ = self.tried.reset(seed=5)
        start, over, good, worth = seen[:, : self.d].copy(), np.zeros(self.PARTNERS, bool), [], np.zeros(self.PARTNERS)
        while not over.all():
            shown = seen[:, : 3 * self.d].copy()
            shown[:, : self.d] -= start
            said = net(torch.as_tensor(shown / self.scale, dtype=torch.float32)).numpy()
            seen, reward, ended, _, infos = self.tried.step(accelerations(said, seen[:, self.d : 2 * self.d]))
            worth += np.where(over, 0.0, reward)
            good += [infos["final_info"]["success"][n] for n in np.flatnonzero(ended & ~over)]
            start[ended] = seen[ended, : self.d]
            over |= ended
        return float(np.mean(good)), float(worth.mean())


def network(model: PPO, d: int) -> Mlp:
    """The mean of the policy as one of `nets`."""
    net, policy = Mlp(3 * d, d), model.policy
    layers = [policy.mlp_extractor.policy_net[0], policy.mlp_extractor.policy_net[2], policy.action_net]
    for mine, theirs in zip([net.net[0], net.net[2], net.net[4]], layers, strict=True):
        mine.load_state_dict(theirs.state_dict())
    return net


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("out", type=Path)
    words.add_argument("--task", default="lift")
    words.add_argument("--role", default="follower")
    words.add_argument("--minutes", type=float, default=20.0)
    words.add_argument("--runs", type=int, default=32)
    words.add_argument("--seed", type=int, default=0)
    asked = words.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    envs = Training(asked.runs, asked.task, asked.role, 1000 + asked.seed)
    how = {"n_steps": 128, "batch_size": 1024, "n_epochs": 8, "gamma": 0.997, "gae_lambda": 0.95, "learning_rate": 1e-3}
    net = {"log_std_init": -2.6, "net_arch": [64, 64]}
    model = PPO("MlpPolicy", envs, **how, seed=asked.seed, device="cpu", policy_kwargs=net)
    d = envs.d

    def keep(model: PPO) -> None:
        about = {"kind": "ppo", "action": "acceleration", "n_in": 3 * d, "n_out": d, "leak": LEAK_PER_S, "by": SAID_M_PER_S2}
        about |= {"mean": [0.0] * 3 * d, "scale": envs.scale.tolist()}
        save(asked.out, "ppo", asked.task, asked.role, network(model, d), **about)

    curve = Curve(envs, asked.out / f"ppo_{asked.task}_{asked.role}.csv", asked, keep)
    model.learn(total_timesteps=10**9, callback=curve)
    curve.say()
    print(f"{entry(asked.out, 'ppo', 'PPO, trained by benchmarks/policies/train_ppo.py')}: best {curve.best[0]:.3f}")


if __name__ == "__main__":
    main()
