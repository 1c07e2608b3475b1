"""From an arm to a Plant: task axes, a target on a leash, braking when the run ends.

Everything about one arm's messages or functions is its adapter's; everything about hands is here, once. Tried against fakes only.
"""

from __future__ import annotations

import time as _time
from collections.abc import Callable, Mapping
from math import exp, isfinite, nan

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation
from .arm import Arm, Sensed
from .settings import Settings
from .turns import NONE, Quaternion, Vector

FIRST_S = 5.0  # for the first samples to come
ABSURD_M = 1e6  # no hand is there: NaN and infinite are not less, either
FRESH_S = 0.1  # a pose older than this says nothing of where the hand is: the target waits
SMOOTH_S = 0.01  # of a velocity that is differentiated from poses
STOPS = 3  # times that rest is commanded at the end: one message may be lost
LEAST_S = 1e-4  # between two poses that a velocity can be told from


class HandPlant:
    """A Plant around an `Arm`: real, unless it is told otherwise.

    now     seconds of a clock that never goes back; sleep waits by it
    """

    def __init__(
        self,
        arm: Arm,
        settings: Settings,
        *,
        real: bool = True,
        now: Callable[[], float] = _time.monotonic,
        sleep: Callable[[float], None] = _time.sleep,
        first_s: float = FIRST_S,
    ) -> None:
        self.arm, self.settings, self.real = arm, settings, real
        self.dt, self.axes = settings.dt, tuple(settings.axes)
        self.sensor_delay_s = settings.force_delay_s
        self._directions = [settings.axes[name] for name in self.axes]
        self._now, self._sleep, self._first_s = now, sleep, first_s
        self._sensed = Sensed()
        self._began: float | None = None
        self._ages = np.full(2, nan)
        self._wait()
        self._joints = np.full(len(arm.joints), nan)
        self._forget()

    def _forget(self) -> None:
        self._last_time, self._last = nan, (nan, nan, nan)
        self._speed: Vector = (nan, nan, nan)
        self._measured = self._speed
        self._sent: Vector = (0.0, 0.0, 0.0)
        self._target: Vector | None = None
        self._lost = True
        self._held: Quaternion = NONE

    @property
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {"robot.joints": self.arm.joints, "robot.ages": ("pose", "force")}

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        """Ages of pose and force as they were read [s], and the joints where the arm says them."""
        joints = {"robot.joints": (self._joints, "rad")} if len(self._joints) else {}
        return {"robot.ages": (self._ages, "s"), **joints}

    @property
    def stop_reason(self) -> str:
        return self.arm.problem

    @property
    def notice(self) -> str:
        """What the arm has to say; empty when all is well."""
        return self.arm.notice

    def rates(self) -> Mapping[str, tuple[float, float]]:
        """Of each signal since the last call (samples a second, longest gap [s]), where the arm knows them."""
        known = getattr(self.arm, "rates", None)
        return known() if known is not None else {}

    def _wait(self) -> None:
        until = self._now() + self._first_s
        while missing := self.arm.missing():
            if self._now() > until:
                raise ParameterError(f"{self.settings.source}: {missing}")
            self._sleep(0.01)

    def reset(self) -> None:
        """Nothing moves: waits for fresh samples, and forgets what was commanded."""
        self._wait()
        self._forget()
        self._began = None

    def read(self, obs: Observation) -> None:
        s, now = self._sensed, self._now()
        self.arm.sense(s)
        self._began = s.time if self._began is None and isfinite(s.time) else self._began
        began = self._began or 0.0
        self._differentiate(s)
        velocity = self._measured = s.velocity if all(map(isfinite, s.velocity)) else self._speed
        obs.time, obs.force_time = s.time - began, s.force_time - began
        for i, (x, y, z) in enumerate(self._directions):
            obs.position[i] = x * s.position[0] + y * s.position[1] + z * s.position[2]
            obs.velocity[i] = x * velocity[0] + y * velocity[1] + z * velocity[2]
            obs.sensor_force[i] = x * s.force[0] + y * s.force[1] + z * s.force[2]
        self._ages[0], self._ages[1] = now - s.time, now - s.force_time
        for i, name in enumerate(self.arm.joints):
            self._joints[i] = s.joints.get(name, nan)

    def _differentiate(self, s: Sensed) -> None:
        """The velocity from poses, smoothed over `SMOOTH_S`, for arms that say none."""
        period = s.time - self._last_time
        if period < LEAST_S or not isfinite(s.time):
            return
        if isfinite(period):
            raw = [(x - last) / period for x, last in zip(s.position, self._last, strict=True)]
            share = 1.0 - exp(-period / SMOOTH_S)
            old = [v if isfinite(v) else 0.0 for v in self._speed]
            self._speed = (
                old[0] + share * (raw[0] - old[0]), old[1] + share * (raw[1] - old[1]), old[2] + share * (raw[2] - old[2]),
            )  # fmt: skip
        else:
            self._speed = (0.0, 0.0, 0.0)
        self._last_time, self._last = s.time, s.position

    def write(self, command: Command) -> None:
        velocity = command.velocity.tolist()
        v = [sum(d[i] * one for d, one in zip(self._directions, velocity, strict=True)) for i in range(3)]
        self._send((v[0], v[1], v[2]))

    def _send(self, velocity: Vector) -> None:
        """The velocity, and the target that it moves. A target is never farther from the hand than the leash: a node that comes
        back elsewhere is not pulled to where the hand was."""
        s, leash = self._sensed, self.settings.command.leash_m
        if not all(map(isfinite, velocity)):
            velocity = (0.0, 0.0, 0.0)
        fresh = self._now() - s.time < FRESH_S and all(abs(x) < ABSURD_M for x in s.position)
        if not fresh:
            velocity, self._lost = (0.0, 0.0, 0.0), True
        elif self._lost:  # the first time, or it was away: from where it is, not from where it was
            self._target, self._held, self._lost = s.position, s.orientation, False
        if self._target is not None:
            ahead = [t + v * self.dt for t, v in zip(self._target, velocity, strict=True)]
            if fresh:
                off = [a - x for a, x in zip(ahead, s.position, strict=True)]
                size = sum(o * o for o in off) ** 0.5
                if size > leash:
                    ahead = [x + o * leash / size for x, o in zip(s.position, off, strict=True)]
            self._target = (ahead[0], ahead[1], ahead[2])
            self.arm.send(velocity, self._target, self._held, self._measured)
        self._sent = velocity

    def advance(self) -> None:
        """Nothing: time passes by itself."""

    def halt(self) -> None:
        """Brakes what was commanded last down to rest, as the envelope would; the loop calls it however a run ends."""
        step = self.settings.acceleration_m_per_s2 * self.dt
        speed = sum(v * v for v in self._sent) ** 0.5
        while speed > 0.0:
            self.arm.sense(self._sensed)
            left = max(0.0, speed - step)
            x, y, z = (v * left / speed for v in self._sent)
            self._send((x, y, z))
            speed = sum(v * v for v in self._sent) ** 0.5
            self._sleep(self.dt)
        for _ in range(STOPS if self._target is not None else 0):
            self._send((0.0, 0.0, 0.0))

    def close(self) -> None:
        self.halt()
        self.arm.close()
