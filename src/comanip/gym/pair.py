"""Both ends open: two agents carry one object, as a PettingZoo ParallelEnv."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import ParameterError
from ..interfaces import STANDARD_GRAVITY, Array, Observation
from ..parts import known
from ..people.robot import Gripper, RobotPartner
from ..trials.cases import Case
from ..trials.judging import MOVED_M
from ..trials.running import estimator_for
from ..trials.sight import Seen, Sight, Told, checked
from .asked import asked_case, asked_render, asked_seed, check_case, check_drawn, given
from .draw import next_case
from .env import CarryEnv, said, spaces
from .episode import Episode, Setting
from .needing import needed
from .render import picture

pettingzoo = needed("pettingzoo", "CarryPair")
ROBOT, PARTNER = "robot", "partner"


class End(Told):
    """The partner's own end: told from outside, and remembers what it sees, and when it first and last moved."""

    def __init__(self, seen: Seen, *, dt: float, goal: Array) -> None:
        super().__init__(seen, dt=dt)
        self.sight, self._began, self._goal = Sight(seen, goal), False, goal

    def reset(self, obs: Observation) -> None:
        super().reset(obs)
        self._start = obs.position.copy()
        self.first_s = self.last_s = float("inf")
        self.sight.begin(obs)

    def step(self, obs: Observation, command: Any) -> None:
        self.sight.look(obs)
        if np.linalg.norm(obs.position - self._start) > MOVED_M:
            self.first_s = min(self.first_s, obs.time)
        if np.linalg.norm(obs.velocity) > 2.0 * MOVED_M:
            self.last_s = obs.time
        super().step(obs, command)


class CarryPair(pettingzoo.ParallelEnv):  # type: ignore[name-defined]
    """Agents "robot" and "partner", one at each end of the object; `role` is what the robot is told.

    The robot's end is that of `CarryEnv`. The partner's is a hand that goes with its own velocity command, through a lag of
    20 ms, and holds the object by a grip, a spring and a damper drawn anew in each episode (`people.robot`); so each feels
    the other through the object. Both see position, velocity and force of their own hand and, behind them, where the one that
    leads is to go (d,) [m]: the one that follows sees zeros there. Both say a velocity, or an acceleration. With role "auto"
    the drawn case says who leads.

    Rewards are shared: the sum of the parts of `gym.episode`, for both the same, because an end that gains by the other's
    effort does not carry. The judge takes the partner's onset and stop from what its hand did.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "comanip_carry_v0", **CarryEnv.metadata, "is_parallelizable": True}

    def __init__(
        self, task: Any = "lift", role: str = "follower", *, plant: str = "beam", render_mode: str | None = None, **setting: Any
    ) -> None:
        if stray := sorted(set(setting) & {"people", "misbehaving", "by_kind"}):
            raise ParameterError(f"{stray[0]} goes with people; here the partner is an agent")
        self.setting = Setting.of(task, role, plant=plant, misbehaving=0.0, **setting)
        own = self.setting.seen
        self.seen = Seen(own.n_axes, own.history, True, own.action)
        self.render_mode, self._learned = asked_render(render_mode), self.setting.learned()
        self.possible_agents = [ROBOT, PARTNER]
        self.agents: list[str] = []
        one = dict(zip(("observation", "action"), spaces(self.seen), strict=True))
        self.observation_spaces = {agent: one["observation"] for agent in self.possible_agents}
        self.action_spaces = {agent: one["action"] for agent in self.possible_agents}
        self._rng = np.random.default_rng()
        self.episode: Episode | None = None

    def observation_space(self, agent: str) -> Any:
        return known("agent", agent, self.observation_spaces)

    def action_space(self, agent: str) -> Any:
        return known("agent", agent, self.action_spaces)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Array], dict[str, Any]]:
        one, seed = self.setting, asked_seed(seed)
        others = isinstance(options, Mapping) and "case" not in options  # PettingZoo's checker gives some
        case = asked_case(None if others else options)
        if case is not None:
            check_case(case, one)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        case = case or next_case(one.role, one.people, self._rng, task=one.task, misbehaving=0.0)
        self._end, person = self._partner(case)
        self.episode = Episode(one, case, self._learned, partner=person)
        self._sight = Sight(self.seen, np.zeros(self.seen.n_axes) if case.leads else self.episode.taught_end())
        self._sight.begin(self.episode.loop.obs)
        self.agents = list(self.possible_agents)
        who = "follower" if case.leads else "leader"
        roles = {ROBOT: who, PARTNER: "leader" if who == "follower" else "follower"}
        return self._observed(), {agent: {"role": roles[agent], "task": case.task.name} for agent in self.agents}

    def _partner(self, case: Case) -> tuple[End, RobotPartner]:
        """The hand at the far end, and its grip, drawn."""
        own, dt = np.random.default_rng([case.seed, 3]), self.setting.dt
        stiffness = float(np.exp(own.uniform(np.log(300.0), np.log(4000.0))))
        gripper = Gripper(
            stiffness, 2.0 * float(own.uniform(0.2, 0.6)) * stiffness**0.5, delay_s=0.005, noise_n=case.force_noise_n
        )
        goal = case.start_m + case.course.end if case.leads else np.zeros(self.seen.n_axes)
        end = End(self.seen, dt=dt, goal=goal)
        weight = tuple((case.carried_n / STANDARD_GRAVITY * -case.task.gravity).tolist())
        return end, RobotPartner(end, estimator_for(case, dt), carried_n=weight, gripper=gripper, dt=dt, rng=own)

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """ParameterError for an action that is missing, not finite or of another shape; nothing has moved then."""
        episode = self.episode
        if episode is None or not self.agents:
            raise ParameterError("the episode is over, or never began: call reset()")
        if not isinstance(actions, Mapping):
            raise ParameterError(f"actions are {given(actions)}; allowed: {{agent: action}} of {', '.join(self.agents)}")
        for agent in actions:
            known("agent", agent, self.action_spaces)
        if missing := [agent for agent in self.agents if agent not in actions]:
            raise ParameterError(f"no action for agent {missing[0]!r}; allowed: one for each of {', '.join(self.agents)}")
        told = {agent: checked(actions[agent], self.seen) for agent in self.agents}
        episode.told.say(told[ROBOT])
        self._end.say(told[PARTNER])
        episode.stated = {
            "onset_s": min(self._end.first_s, episode.case.run_s),
            "stop_s": min(self._end.last_s, episode.case.run_s),
        }
        episode.onset_s = self._end.first_s
        parts = episode.tick()
        self._sight.look(episode.loop.obs)
        reward, over = sum(parts), episode.over
        shared = [{agent: value for agent in self.agents} for value in (reward, over, False)]
        infos = {agent: said(episode, parts) for agent in self.agents}
        self.agents = [] if over else self.agents
        return self._observed(), *shared, infos

    def _observed(self) -> dict[str, Array]:
        return {ROBOT: self._sight.values.copy(), PARTNER: self._end.sight.values.copy()}

    def render(self) -> np.ndarray:
        """As `CarryEnv`'s."""
        check_drawn(self.render_mode, self.episode)
        assert self.episode is not None
        return picture(self.episode)

    def close(self) -> None:
        """Nothing is held open."""
