"""One robot, one partner who answers by force: the Gymnasium environment."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..trials.sight import Seen, checked
from .asked import asked_case, asked_render, asked_seed, check_case, check_drawn, whole
from .draw import next_case
from .episode import Episode, Parts, Setting
from .needing import needed
from .render import picture

gymnasium = needed("gymnasium", "comanip/Carry-v0")
PLACE_M, SPEED_M_PER_S, FORCE_N = 100.0, 100.0, 1000.0  # no hand of a run that is not over is there


class CarryEnv(gymnasium.Env):  # type: ignore[name-defined]
    """`gymnasium.make("comanip/Carry-v0", task="lift", role="follower", people="usual", plant="beam")`.

    observation  (n,) float64: position [m], velocity [m/s], force [N] of the hand (`trials.sight.Seen`), oldest tick first
    action       (d,) wanted velocity [m/s] or acceleration [m/s^2], through the safety envelope; beyond the space it is clipped
    reward       sum of `info["parts"]` (`gym.episode`)
    terminated   the run is over, or can only be lost; `info` then has `success`, `failures` and `verdict`, the judge's
    truncated    after `most_ticks`, where that is given, without a verdict

    The other arguments are those of `Setting`. The same seed gives the same bytes. A NaN, a wrong shape, an unknown name is one
    ParameterError; nothing has moved then, and the environment goes on as before.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 100}

    def __init__(
        self,
        task: Any = "lift",
        role: str = "follower",
        people: Any = "usual",
        *,
        plant: str = "beam",
        render_mode: str | None = None,
        most_ticks: int | None = None,
        **setting: Any,
    ) -> None:
        self.setting = Setting.of(task, role, people, plant=plant, **setting)
        self.render_mode = asked_render(render_mode)
        self.most_ticks = None if most_ticks is None else whole("most_ticks", most_ticks, 1)
        self._learned = self.setting.learned()
        self.observation_space, self.action_space = spaces(self.setting.seen)
        self.episode: Episode | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """The next partner, drawn; or `options={"case": case}`, that one (`comanip.gym.trial_cases`)."""
        case = asked_case(options)
        if case is not None:
            check_case(case, self.setting)
        super().reset(seed=asked_seed(seed))
        if case is None:
            one = self.setting
            case = next_case(one.role, one.people, self.np_random, task=one.task, misbehaving=one.misbehaving)
        self.episode = Episode(self.setting, case, self._learned)
        return self.episode.seen.copy(), about(self.episode)

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        episode = self.episode
        if episode is None or episode.over:
            raise ParameterError("the episode is over, or never began: call reset()")
        episode.told.say(checked(action, self.setting.seen))
        parts = episode.tick()
        cut = not episode.over and self.most_ticks is not None and episode.ticks >= self.most_ticks
        return episode.seen.copy(), sum(parts), episode.over, cut, said(episode, parts)

    def render(self) -> np.ndarray:
        """(H, W, 3) bytes of the scene from the side. ParameterError where no picture was asked for, or nothing has begun."""
        check_drawn(self.render_mode, self.episode)
        assert self.episode is not None
        return picture(self.episode)


def spaces(seen: Seen) -> tuple[Any, Any]:
    """(observation, action)."""
    d, box = seen.n_axes, gymnasium.spaces.Box
    most = np.tile(np.repeat([PLACE_M, SPEED_M_PER_S, FORCE_N], d), seen.history)
    most = np.concatenate([most, np.full(d * seen.goal, PLACE_M)])
    return box(-most, most, dtype=np.float64), box(-seen.most, seen.most, (d,), dtype=np.float32)


def about(episode: Episode) -> dict[str, Any]:
    """Of an episode that begins: whom it is with."""
    case = episode.case
    told = {"role": case.role, "task": case.task.name, "kind": case.kind or "usual", "partner": case.partner}
    return {**told, "behaviour": case.behaviour, "seconds": episode.most * episode.setting.dt, "case": case}


def said(episode: Episode, parts: Parts) -> dict[str, Any]:
    """Of a tick: the reward's parts, what was sent, whether the envelope lets the policy pass; at the end the verdict."""
    found: dict[str, Any] = {"parts": parts._asdict(), "sent": episode.loop.command.velocity.copy()}
    if episode.setting.envelope:
        found["mode"] = episode.mode
    if episode.verdict is not None:
        found |= {"success": episode.verdict.success, "failures": episode.verdict.failures, "verdict": episode.verdict}
        found |= {"reason": episode.reason or "duration"}
    return found
