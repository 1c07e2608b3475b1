"""Teleoperation: a skill whose brain is a human. Bilateral 2-channel velocity-force coupling, eqs. (1) and (2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import dist, exp, hypot, inf, isfinite, sqrt
from operator import mul

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, HapticDevice, Observation

RUN, HOLD = 0, 1
EASE_S = 0.1  # [s] in which a force comes into the hand: a jump of the weight would be a push


@dataclass(frozen=True)
class CouplingLimits:
    """What the coupling refuses to do. Defaults leave a lesson on a good device unchanged.

    full_feedback_s, no_feedback_s   measured round trip up to which K_f is as set; above, K_f falls as 1/delay; from
                                     no_feedback_s on there is no force feedback (docs/physics.md: stability map)
    workspace_m                      (lowest, highest) of the ROBOT'S hand per axis; None: no walls
    sensor_max_n                     |F_s| that a sensor at a hand can measure while people carry: above, it is broken
    handle_max_n                     |F_m| that is ever asked of the handle; a device may state less as its `force_limit_n`
    """

    v_max_m_per_s: float = 0.8
    a_max_m_per_s2: float = 10.0
    handle_max_m_per_s: float = 3.0  # no wrist is faster: a sample above is no motion
    sensor_max_n: float = 250.0  # five times the weight of the heaviest beam
    handle_max_n: float = 40.0  # the strongest handles give that
    stale_s: float = 0.050
    frozen_s: float = 0.5  # a velocity that is not 0 and stays the same to the last bit: no hand does that
    connect_s: float = 1.0  # how long the first sample may take
    match_m: float = 0.02  # how well handle and hand must agree before they are coupled again
    ramp_s: float = 1.5  # the robot's share of the handle's velocity fades in after a fault
    patience_s: float = 3.0  # held for so long, the run ends
    full_feedback_s: float = 0.010
    no_feedback_s: float = 0.150
    workspace_m: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name == "workspace_m":
                if any(not low < high for low, high in value or ()):
                    raise ParameterError(f"workspace_m needs lowest < highest on each axis; got {value}")
            elif not (value > 0 and isfinite(value)):
                raise ParameterError(f"{name} must be positive and finite; got {value}")
        if not self.full_feedback_s < self.no_feedback_s:
            raise ParameterError(
                f"full_feedback_s must be below no_feedback_s; got {self.full_feedback_s} and {self.no_feedback_s} s"
            )

    def feedback(self, round_trip_s: float) -> float:
        """Share of K_f that this delay allows, 0 to 1."""
        if round_trip_s >= self.no_feedback_s:
            return 0.0
        return 1.0 if round_trip_s <= self.full_feedback_s else self.full_feedback_s / round_trip_s


class Teleoperation:
    """Hands the handle's velocity to the robot and the robot's force to the handle.

    Eq. (1)  F_m = U K_f F_s          force_gain K_f (scalar or (d,)), rotation U (d, d) from sensor to device frame
    Eq. (2)  v   = s_v U^-1 v_h       velocity_scale s_v maps the device's workspace on the robot's

    F_s is the RAW sensor force, so the teacher feels the load's weight scaled by K_f. U must be orthonormal with det +1.

    home     (d,) [m] handle position that fits the hand's position at the start; None: wherever the handle is, fits
    carried  the person holds the rendered weight already when the run starts; else it comes into the hand within 0.1 s

    The clutch uncouples: while it is up the robot stands, and pressed again it goes on from wherever the handle is. On a fault
    (device lost, silent or repeating its last sample, a sample or force that cannot be) the robot brakes and holds. To go on, the
    device must work again and the clutch be released and pressed where handle and hand agree within `limits.match_m`; then the
    coupling fades in. A run held longer than `limits.patience_s` ends, with the fault as its stop reason.

    Diagnostics: device.velocity v_h, device.force F_m as asked, the device's own channels, coupling.mode (0 run, 1 hold),
    coupling.gain (share of K_f rendered), coupling.mismatch [m].
    """

    def __init__(
        self,
        device: HapticDevice,
        *,
        n_axes: int,
        dt: float,
        force_gain: float | Array = 0.15,
        velocity_scale: float = 1.3,
        rotation: Array | None = None,
        home: Array | None = None,
        limits: CouplingLimits = CouplingLimits(),
        carried: bool = False,
    ) -> None:
        self.dt = dt
        self._device, self._dt, self._scale, self.limits = device, dt, velocity_scale, limits
        u = _checked_rotation(rotation, n_axes)
        gain = np.asarray(force_gain, dtype=float)
        if gain.shape not in ((), (n_axes,)) or not (np.isfinite(gain).all() and (gain >= 0).all()):
            raise ParameterError(f"force_gain K_f must be >= 0, one number or {n_axes}; got {force_gain}")
        if not (velocity_scale > 0 and isfinite(velocity_scale)):
            raise ParameterError(f"velocity_scale s_v must be positive; got {velocity_scale}")
        if limits.workspace_m is not None and len(limits.workspace_m) != n_axes:
            raise ParameterError(f"workspace_m needs {n_axes} rows; got {len(limits.workspace_m)}")
        self._walls = limits.workspace_m or ((-inf, inf),) * n_axes
        # Rows of plain floats: there are few axes and 1,000 ticks a second
        self._render = (u @ np.diag(np.broadcast_to(gain, (n_axes,)))).tolist()
        self._back = (velocity_scale * u.T).tolist()  # U^-1 = U^T
        self._forth = (velocity_scale * u).tolist()
        own = getattr(device, "force_limit_n", None)
        if own is not None and not (isfinite(own) and own > 0):
            raise ParameterError(f"the device states a force limit of {own!r} N; it must be positive and finite")
        self._carried = carried
        self._most_n = limits.handle_max_n if own is None else min(limits.handle_max_n, float(own))
        self._home = None if home is None else np.array(home, dtype=float)
        self._handle_velocity, self._handle_force, self._sample = np.zeros(n_axes), np.zeros(n_axes), np.zeros(n_axes)
        self._hand_anchor, self._handle_anchor = [0.0] * n_axes, [0.0] * n_axes
        self._mode, self._gain, self._mismatch = np.zeros(1), np.ones(1), np.zeros(1)
        more = {name: array for name, (array, _) in device.channels.items()}
        self._place, self._clutch, self._delay = (more.get(f"device.{n}") for n in ("position", "clutch", "delay"))
        if self._home is not None and self._place is None:
            raise ParameterError("home needs a device that measures device.position; this one does not")
        self._diagnostics = {
            "device.velocity": self._handle_velocity,
            "device.force": self._handle_force,
            **more,
            "coupling.mode": self._mode,
            "coupling.gain": self._gain,
            "coupling.mismatch": self._mismatch,
        }
        self._begin()

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return self._diagnostics

    @property
    def units(self) -> Mapping[str, str]:
        """Of the diagnostics, for the recording."""
        device = {name: unit for name, (_, unit) in self._device.channels.items()}
        return {**device, "device.velocity": "m/s", "device.force": "N", "coupling.mismatch": "m"}

    @property
    def fault(self) -> str:
        """Why it holds; empty while it runs."""
        return self._reason

    @property
    def stop_reason(self) -> str:
        return self._reason if self._held_s > self.limits.patience_s else ""

    @property
    def notice(self) -> str:
        said = [f"HOLD: {self._reason}{self._how_to_go_on()}" if self._reason else "", self._device.notice]
        if self._asked_n > self._most_n:
            said.append(f"handle force limited: {self._asked_n:.3g} N asked, {self._most_n:g} N given")
        share = min(float(self._gain[0]), self._allowed()) if self._settled else self._allowed()
        if self._delay is not None and share < 1.0 and not self._reason:
            how = f"at {100.0 * share:.0f} %" if share > 0.0 else "off"
            said.append(f"force feedback {how}: delay {1000.0 * float(self._delay[0]):.0f} ms")
        if self._at_wall:
            said.append("the arm is at the edge of its workspace")
        return "; ".join(s for s in said if s)

    def _how_to_go_on(self) -> str:
        if self._mismatch[0] > self.limits.match_m:
            return f" (handle is {100.0 * self._mismatch[0]:.0f} cm from where the arm is)"
        return " (press the clutch to go on)" if self._released else " (release the clutch)"

    def reset(self, obs: Observation) -> None:
        self._device.reset()
        self._begin()
        if _finite(felt := obs.sensor_force.tolist()) and hypot(*felt) <= self.limits.sensor_max_n:
            self._fresh_force = self._rest_force = felt
        self._anchor(obs)
        self._gain[0] = self._allowed() if self._carried else 0.0
        if self._home is not None:
            self._handle_anchor = self._home.tolist()
            self._measure_mismatch(obs)
            if self._mismatch[0] > self.limits.match_m:
                self._fault("handle and arm do not match at the start")

    def _begin(self) -> None:
        self._reason, self._held_s, self._silent_s, self._blind_s, self._met = "", 0.0, 0.0, 0.0, False
        self._ramp, self._released, self._coupled, self._at_wall = 1.0, False, True, False
        self._mode[0], self._gain[0], self._mismatch[0] = RUN, 0.0, 0.0
        self._asked_n, self._same_s, self._settled = 0.0, 0.0, False
        self._sample_before: list[float] = []
        self._handle_velocity[:] = self._handle_force[:] = 0.0
        self._velocity = [0.0] * len(self._sample)
        self._fresh_force = self._rest_force = [0.0] * len(self._sample)

    def _fault(self, reason: str) -> None:
        if not self._reason:
            self._reason, self._held_s, self._released = reason, 0.0, False

    # one tick

    def step(self, obs: Observation, command: Command) -> None:
        self._feel(obs)
        self._device.write(self._handle_force, self._dt, self._power(obs))
        self._listen()
        if self._reason:
            self._wait(obs)
        self._couple(obs)
        command.velocity[:] = self._velocity
        command.acceleration[:] = 0.0
        command.position[:] = obs.position

    def _feel(self, obs: Observation) -> None:
        """Eq. (1), with the share of K_f that the delay allows, never more than the handle may have; none in HOLD."""
        felt = obs.sensor_force.tolist()
        finite = _finite(felt)
        if finite and hypot(*felt) <= self.limits.sensor_max_n:
            self._fresh_force, self._blind_s = felt, 0.0
        elif finite:  # never rendered: the last one that can be fades out
            self._blind_s += self._dt
            self._fault(f"a force of {hypot(*felt):.3g} N cannot be (a sensor here gives up to {self.limits.sensor_max_n:g} N)")
        else:  # a missing sample holds the last force for a while
            self._blind_s += self._dt
            if self._blind_s > self.limits.stale_s + 1e-9:
                self._fault(f"force {1000.0 * self._blind_s:.0f} ms old")
        gain = self._eased(0.0 if self._reason else self._allowed())
        self._gain[0] = gain
        self._settled |= gain == self._allowed()
        asked = _product(self._render, self._fresh_force)
        self._asked_n = gain * hypot(*asked)
        share = gain if self._asked_n <= self._most_n else gain * self._most_n / self._asked_n
        for i, force in enumerate(asked):
            self._handle_force[i] = share * force

    def _allowed(self) -> float:
        return 1.0 if self._delay is None else self.limits.feedback(float(self._delay[0]))

    def _eased(self, allowed: float) -> float:
        """K_f falls at once to what the delay allows; else it moves in `EASE_S`."""
        gain = float(self._gain[0])
        if not self._settled and not self._reason:  # at the start the weight is nothing to be hit by
            return min(allowed, gain + self._dt / EASE_S)
        if (allowed < gain and not self._reason) or abs(allowed - gain) < 1e-3:
            return allowed
        return gain + (allowed - gain) * (1.0 - exp(-self._dt / EASE_S))

    def _power(self, obs: Observation) -> float:
        """(K_f/s_v) (F_s - F_s at rest) v [W]: what the object puts in at the hand, at the handle's scale."""
        if not _finite(velocity := obs.velocity.tolist()):
            return 0.0
        handle_side = _product(self._render, [f - rest for f, rest in zip(self._fresh_force, self._rest_force, strict=True)])
        power = sum(map(mul, handle_side, _product(self._forth, velocity)))
        return float(self._gain[0]) * power / self._scale**2

    def _listen(self) -> None:
        """A sample, or the last one again; too long without, or one that cannot be, is a fault."""
        if problem := self._device.problem:
            self._fault(problem)
        self._device.read(self._sample)
        if not _finite(sample := self._sample.tolist()):
            self._silent_s += self._dt
            if self._silent_s > 1e-9 + (self.limits.stale_s if self._met else self.limits.connect_s):
                self._fault(f"no sample from the device for {1000.0 * self._silent_s:.0f} ms")
            return
        self._silent_s, self._met = 0.0, True
        if self._is_frozen(sample):
            self._fault(f"the device says it moves and repeats one sample for {1000.0 * self._same_s:.0f} ms: its driver hangs")
            return
        fastest = hypot(*sample)
        if fastest > self.limits.handle_max_m_per_s:
            self._fault(f"handle velocity {fastest:.3g} m/s cannot be")
            return
        self._handle_velocity[:] = self._sample

    def _is_frozen(self, sample: list[float]) -> bool:
        """Whether a driver says the same over and over: a velocity, and the handle is where it was. 0 is a hand at rest."""
        now = sample if self._place is None else sample + self._place.tolist()
        self._same_s = self._same_s + self._dt if any(sample) and now == self._sample_before else 0.0
        self._sample_before = now
        return self._same_s > 1e-9 + (self.limits.frozen_s if self._place is None else self.limits.stale_s)

    def _wait(self, obs: Observation) -> None:
        """In HOLD: goes on when the device works, the clutch was up and is pressed where handle and hand agree."""
        self._held_s += self._dt
        self._measure_mismatch(obs)
        pressed = self._clutch is not None and self._clutch[0] > 0.5
        works = not self._device.problem and self._silent_s == 0.0 and self._blind_s == 0.0 and self._same_s == 0.0
        if self._clutch is None or not works:
            return
        if not pressed:
            self._released = True
        elif self._released and self._mismatch[0] <= self.limits.match_m and not any(self._velocity):
            self._reason, self._ramp = "", 0.0
        else:
            self._released = False  # pressed at the wrong place: once more

    def _couple(self, obs: Observation) -> None:
        """Eq. (2) inside what the arm may do. Wherever it is not one to one, the anchor moves along: no wind-up."""
        coupled = not self._reason and (self._clutch is None or self._clutch[0] > 0.5)
        self._ramp = min(1.0, self._ramp + self._dt / self.limits.ramp_s)
        share = self._ramp if coupled else 0.0
        wishes = _product(self._back, self._handle_velocity.tolist())
        exact = coupled and self._ramp == 1.0
        wishes = _no_faster(wishes, self.limits.v_max_m_per_s)
        step, fastest = self.limits.a_max_m_per_s2 * self._dt, self.limits.v_max_m_per_s
        self._at_wall = False
        for i, (low, high) in enumerate(self._walls):
            up, down = fastest, fastest
            if isfinite(high - low) and isfinite(obs.position[i]):
                up, down = min(up, self._reach(high - obs.position[i])), min(down, self._reach(obs.position[i] - low))
            wanted, last = share * wishes[i], self._velocity[i]
            allowed = min(max(wanted, -down), up)
            self._at_wall |= allowed != wanted and abs(allowed) < fastest
            self._velocity[i] = min(max(allowed, last - step), last + step)
            exact &= self._velocity[i] == wanted
        if exact:
            self._measure_mismatch(obs)
        elif not self._reason:
            self._anchor(obs)
        self._mode[0] = HOLD if self._reason else RUN

    def _reach(self, left: float) -> float:
        """Highest speed [m/s] from which the arm can brake inside `left` [m], one period later at the latest."""
        a = self.limits.a_max_m_per_s2
        return max(0.0, sqrt(2.0 * a * max(left, 0.0)) - a * self._dt)

    def _places(self, obs: Observation) -> tuple[list[float], list[float]] | None:
        """Where hand and handle are; None when either is not known."""
        if self._place is None:
            return None
        hand, handle = obs.position.tolist(), self._place.tolist()
        return (hand, handle) if _finite(hand) and _finite(handle) else None

    def _anchor(self, obs: Observation) -> None:
        if places := self._places(obs):
            self._hand_anchor, self._handle_anchor = places
            self._mismatch[0] = 0.0

    def _measure_mismatch(self, obs: Observation) -> None:
        """How far the hand is from where the handle's way since the anchor would have it."""
        if places := self._places(obs):
            hand = [x - start for x, start in zip(places[0], self._hand_anchor, strict=True)]
            handle = [x - start for x, start in zip(places[1], self._handle_anchor, strict=True)]
            self._mismatch[0] = dist(hand, _product(self._back, handle))


def _finite(values: list[float]) -> bool:
    return all(map(isfinite, values))


def _no_faster(velocity: list[float], most: float) -> list[float]:
    """The same direction, at `most` in any."""
    speed = hypot(*velocity)
    return velocity if speed <= most else [v * most / speed for v in velocity]


def _product(matrix: list[list[float]], vector: list[float]) -> list[float]:
    return [sum(map(mul, row, vector)) for row in matrix]


def _checked_rotation(rotation: Array | None, n_axes: int) -> Array:
    u = np.eye(n_axes) if rotation is None else np.asarray(rotation, dtype=float)
    if u.shape != (n_axes, n_axes) or not np.allclose(u @ u.T, np.eye(n_axes), atol=1e-6) or np.linalg.det(u) < 0:
        raise ParameterError(
            f"rotation U must be orthonormal ({n_axes}, {n_axes}) with determinant +1; got {np.round(u, 3).tolist()}"
        )
    return u
