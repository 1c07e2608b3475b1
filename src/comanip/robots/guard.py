"""Around a skill on a robot: re-arming by the user, braking when asked to end, a slow start, and a shadow that commands
nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Plant
from ..safety.envelope import Envelope
from ..safety.limits import Limits, as_taught
from .settings import Settings

STALE_S = 0.05  # stamps that stand still for longer: nothing is measured, and nothing runs again on what was
APART_M = 1e3  # how far a shadow's command may run off from the hand, which somebody else moves
WALL_M = 1e4  # where a simulated robot has no walls of its own


class Guarded:
    """The envelope's socket with two wishes of the user, each asked for from any thread and granted in the next tick.

    answer    what became of the last re-arming: "" it runs, else why not
    """

    def __init__(self, envelope: Envelope, *, dt: float, a_max_m_per_s2: float) -> None:
        self.envelope, self._dt, self._a = envelope, dt, a_max_m_per_s2
        self._rearm, self._why, self._over, self.answer = False, "", "", ""
        self.rearmed = 0
        self._last: Array | None = None
        self._stamps, self._stood_s = (np.nan, np.nan), [0.0, 0.0]  # of pose and force

    def ask_rearm(self) -> None:
        """Run again from where the hand is, if it may."""
        self._rearm = True

    def ask_stop(self, why: str = "interrupted") -> None:
        """Brake to rest, then end the run with this reason."""
        self._why = self._why or why

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return self.envelope.diagnostics

    @property
    def stop_reason(self) -> str:
        return self._over or ("" if self._why else self.envelope.stop_reason)

    @property
    def notice(self) -> str:
        said = self.envelope.notice
        return f"{said}; not re-armed: {self.answer}" if self.answer and self.envelope.mode == "HOLD" else said

    def reset(self, obs: Observation) -> None:
        self._rearm, self._why, self._over, self.answer, self.rearmed = False, "", "", "", 0
        self._last = np.zeros(len(obs.position))
        self._stamps, self._stood_s = (np.nan, np.nan), [0.0, 0.0]
        self.envelope.reset(obs)

    def step(self, obs: Observation, command: Command) -> None:
        stale = self._stale(obs)
        if self._rearm:
            self._rearm = False
            self.answer = stale or self.envelope.rearm(obs)
            self.rearmed += not self.answer
        self.envelope.step(obs, command)
        if self._why:
            self._brake(command)
        assert self._last is not None
        self._last[:] = command.velocity

    def _stale(self, obs: Observation) -> str:
        """Which stamp stands still, and for how long; empty: none. One that is missing is the envelope's to judge."""
        now = obs.time, obs.force_time
        for i, (stamp, before) in enumerate(zip(now, self._stamps, strict=True)):
            self._stood_s[i] = self._stood_s[i] + self._dt if stamp == before else 0.0
        self._stamps = now
        name, stood = max(zip(("pose", "force"), self._stood_s, strict=True), key=lambda one: one[1])
        return f"no {name} for {stood:.1f} s: cable, node?" if stood > STALE_S else ""

    def _brake(self, command: Command) -> None:
        assert self._last is not None
        speed = float(np.linalg.norm(self._last))
        left = max(0.0, speed - self._a * self._dt)
        command.position -= command.velocity * self._dt
        command.velocity[:] = self._last * (left / speed if speed > 0.0 else 0.0)
        command.position += command.velocity * self._dt
        command.acceleration[:] = 0.0
        if left == 0.0:
            self._over = self._why


class Shadow:
    """A plant that is read and never commanded: what a skill would do, beside whatever moves the arm."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def write(self, command: Command) -> None:
        """Nothing."""

    def halt(self) -> None:
        """Nothing: whoever moves it stops it."""


def limits_of(
    settings: Settings,
    axes: Sequence[str],
    learned: Sequence[Any],
    *,
    share: float = 1.0,
    yields: bool = True,
    shadow: bool = False,
) -> Limits:
    """What was taught and what this arm may, whichever is less; the speed is `share` of it (--limit)."""
    if not 0.0 < share <= 1.0:
        raise ParameterError(f"share of the speed (--limit) is {share:g}; allowed: above 0, up to 1 (the whole speed)")
    taught = as_taught(learned, yields=yields)
    assert taught.workspace_m is not None
    walls = []
    for name, (low, high) in zip(axes, taught.workspace_m, strict=True):
        least, most = settings.walls_m.get(name, (-WALL_M, WALL_M))
        if not max(low, least) < min(high, most):
            raise ParameterError(
                f"{settings.source}: limits.walls.{name} is {least:g} to {most:g} m, and the lessons went {low:.3g} to "
                f"{high:.3g} m: this arm cannot do what was taught"
            )
        walls.append((max(low, least), min(high, most)))
    return replace(
        taught,
        workspace_m=tuple(walls),
        v_max_m_per_s=share * min(taught.v_max_m_per_s, settings.speed_m_per_s),
        a_max_m_per_s2=min(taught.a_max_m_per_s2, settings.acceleration_m_per_s2),
        force_limit_n=min(taught.force_limit_n, settings.force_n),
        late_s=settings.late_s,
        drift_m=APART_M if shadow else taught.drift_m,
    )
