"""Many runs at once: a Gymnasium VectorEnv whose ordinary ticks pass in C, all runs in one call."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array
from ..trials.sight import real
from .asked import asked_case, asked_seeds, check_case, check_drawn, given, whole
from .compiled import FOR_PYTHON, NO_NOISE, OPEN, TICKED, Compiled, fits
from .draw import next_case
from .env import about, spaces
from .episode import Episode, Parts, Setting
from .needing import needed

gymnasium = needed("gymnasium", "CarryVectorEnv")
Autoreset = gymnasium.vector.AutoresetMode
MODES = {one.value: one for one in (Autoreset.NEXT_STEP, Autoreset.SAME_STEP)}


class Plain:
    """An episode all of whose ticks are the Python's."""

    run = None

    def __init__(self, episode: Episode, seen: Array, parts: Array) -> None:
        self.episode, self._parts = episode, parts
        episode.sight.move_to(seen)
        episode.seen = seen

    def tick(self, status: int) -> Parts:
        """One control period."""
        parts = self.episode.tick()
        self._parts[:] = parts
        return parts


class CarryVectorEnv(gymnasium.vector.VectorEnv):  # type: ignore[name-defined]
    """`gymnasium.make_vec("comanip/Carry-v0", num_envs=64, task="lift", role="follower")`: `num_envs` times `CarryEnv`.

    The numbers are those of `CarryEnv`: run i of reset(seed=s) is that of seed s + i, then and after every episode. Compiled are
    the ticks of `gym.compiled`: the usual people on the beam while the envelope has nothing to say. Other people, plants, tasks
    and ticks are the Python's, slower; `info["compiled"]` says for which runs, `compiled_share` how many ticks.

    autoreset_mode   Gymnasium's: NEXT_STEP (the step after an end resets, its action is not used) or SAME_STEP (an end resets at
                     once; the last observation and info are in `final_obs` and `final_info`)
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": Autoreset.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        task: Any = "lift",
        role: str = "follower",
        people: Any = "usual",
        *,
        plant: str = "beam",
        autoreset_mode: Any = Autoreset.NEXT_STEP,
        render_mode: str | None = None,
        **setting: Any,
    ) -> None:
        num_envs = whole("num_envs", num_envs, 1)
        if render_mode is not None:
            raise ParameterError(f"render_mode is {render_mode!r}; the vector environment draws nothing, CarryEnv does")
        mode = (
            MODES.get(getattr(autoreset_mode, "value", autoreset_mode)) if isinstance(autoreset_mode, (str, Autoreset)) else None
        )
        if mode is None:
            said = getattr(autoreset_mode, "name", given(autoreset_mode))
            raise ParameterError(f"autoreset_mode is {said}; allowed: NEXT_STEP, SAME_STEP, of gymnasium.vector.AutoresetMode")
        self.num_envs, self.setting, self.render_mode = num_envs, Setting.of(task, role, people, plant=plant, **setting), None
        self.metadata = {**self.metadata, "autoreset_mode": mode}  # type: ignore[misc]
        self.single_observation_space, self.single_action_space = spaces(self.setting.seen)
        batched = gymnasium.vector.utils.batch_space
        self.observation_space = batched(self.single_observation_space, num_envs)
        self.action_space = batched(self.single_action_space, num_envs)
        self._same, self._learned = mode is Autoreset.SAME_STEP, self.setting.learned()
        self._seen, self._parts = np.zeros((num_envs, self.setting.seen.size)), np.zeros((num_envs, 4))
        self._status, self._open = np.zeros(num_envs, dtype=np.int64), np.zeros(num_envs, dtype=np.int64)
        self._rngs = [np.random.default_rng() for _ in range(num_envs)]
        self._slots: list[Any] = []
        self._runs: list[Any] = [None] * num_envs
        self._ended = np.zeros(num_envs, dtype=bool)
        self._ticks = self._in_python = 0

    @property
    def compiled_share(self) -> float:
        """Of all ticks so far, those that passed in C."""
        return 1.0 - self._in_python / self._ticks if self._ticks else 0.0

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """All runs anew. seed: one number, or one a run; options: {"case": case} is met by all."""
        case = asked_case(options)
        if case is not None:
            check_case(case, self.setting)
        if seed is not None:
            self._seed(asked_seeds(seed, self.num_envs))
        infos: dict[str, Any] = {}
        self._slots = [None] * self.num_envs
        for n in range(self.num_envs):
            infos = self._add_info(infos, self._begin(n, case), n)
        self._ended[:] = False
        return self._seen.copy(), infos

    def _seed(self, seeds: list[int | None]) -> None:
        """None, of one of several, is a run that goes on drawing as before, as with Gymnasium's own."""
        for n, one in enumerate(seeds):
            if one is not None:
                self._rngs[n] = gymnasium.utils.seeding.np_random(one)[0]

    def _begin(self, n: int, case: Any = None) -> dict[str, Any]:
        """The next episode of run n; what there is to say about it."""
        one = self.setting
        if case is None:
            case = next_case(one.role, one.people, self._rngs[n], task=one.task, misbehaving=one.misbehaving)
        episode = Episode(one, case, self._learned)
        kind = Compiled if fits(episode) else Plain
        self._slots[n] = kind(episode, self._seen[n], self._parts[n])
        self._runs[n] = self._slots[n].run
        return {**about(episode), "compiled": kind is Compiled}

    def step(self, actions: Any) -> tuple[Array, Array, Any, Any, dict[str, Any]]:
        """ParameterError for actions of another shape or not finite; nothing has moved then."""
        said = self._checked(actions)
        infos: dict[str, Any] = {}
        resting = self._ended.copy()
        for n in np.flatnonzero(resting):  # NEXT_STEP: they begin anew instead
            infos = self._add_info(infos, self._begin(int(n)), int(n))
            self._runs[n] = None
        self._advance(said, resting)
        for n in np.flatnonzero(resting):
            self._parts[n] = 0.0
            self._runs[n] = self._slots[n].run
        self._ended = np.array([slot.episode.over for slot in self._slots]) & ~resting if self._open.any() else resting & False
        rewards, ended = self._parts.sum(axis=1), self._ended.copy()
        infos["parts"] = dict(zip(Parts._fields, self._parts.T.copy(), strict=True))
        for n in np.flatnonzero(ended):
            infos = self._tell(infos, int(n))
        if self._same:
            self._ended = np.zeros(self.num_envs, dtype=bool)
        return self._seen.copy(), rewards, ended, np.zeros(self.num_envs, dtype=bool), infos

    def _advance(self, said: Array, resting: Any) -> None:
        """One tick of all runs that go on: in C where it is ordinary."""
        self._status[:], self._open[:] = FOR_PYTHON, OPEN
        if kernels.native is not None:
            kernels.native.carry(self._runs, said, self._status, self._open)
        self._ticks += self.num_envs - int(resting.sum())
        for n in np.flatnonzero(self._open).tolist():
            self._slots[n].end(int(self._open[n]))
        for n in np.flatnonzero(self._status).tolist():
            if not resting[n]:
                self._tick_of(n, said)

    def _tick_of(self, n: int, said: Array) -> None:
        """What C has left of the tick of run n."""
        slot, status = self._slots[n], int(self._status[n])
        if status == NO_NOISE:
            slot.refill()
            again, over = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
            kernels.native.carry([slot.run], said[n : n + 1], again, over)
            status = int(again[0])
            if over[0]:
                self._open[n] = over[0]
                slot.end(int(over[0]))
        if status != TICKED:
            self._in_python += 1
            slot.episode.told.say(said[n])
            slot.tick(status)
            self._open[n] = slot.episode.over
            self._runs[n] = slot.run

    def _tell(self, infos: dict[str, Any], n: int) -> dict[str, Any]:
        """The verdict on a run that is over; with SAME_STEP the next one has begun."""
        episode = self._slots[n].episode
        verdict = {"success": episode.verdict.success, "failures": episode.verdict.failures, "verdict": episode.verdict}
        verdict |= {"reason": episode.reason or "duration", "seconds_run": episode.time_s}
        if not self._same:
            return dict(self._add_info(infos, verdict, n))
        last = self._seen[n].copy()
        infos = self._add_info(infos, {"final_obs": last, "final_info": verdict}, n)
        return dict(self._add_info(infos, self._begin(n), n))

    def _checked(self, actions: Any) -> Array:
        if not self._slots:
            raise ParameterError("no run has begun: call reset()")
        seen, shape = self.setting.seen, (self.num_envs, self.setting.seen.n_axes)
        try:
            said = real(actions)
        except Exception:
            raise ParameterError(f"actions are {given(actions)}; allowed: {shape} finite numbers of a {seen.action}") from None
        if said.shape != shape:
            raise ParameterError(f"actions have shape {said.shape}; allowed: {shape}, one row a run")
        if not np.isfinite(said).all():
            run = int(np.flatnonzero(~np.isfinite(said).all(axis=1))[0])
            raise ParameterError(f"action of run {run} is {said[run].tolist()}; allowed: finite numbers of a {seen.action}")
        return np.ascontiguousarray(np.clip(said, -seen.most, seen.most))

    def render(self) -> Any:
        """ParameterError: see `render_mode`."""
        check_drawn(self.render_mode, None)

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing is held open."""
