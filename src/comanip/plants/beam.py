"""The exact rigid beam: robot at one end, partner at the other, tilt between them.

One axis, small angles (derived in docs/physics.md): the hand follows its velocity command through the actuator's lag and
holds its orientation with wrist stiffness k_w and damping d_w; the partner's end is z_u = z_r + L theta, and

    (m L^2/3) dd_theta = f_u L - m (g0 + ddz_r) L/2 - k_w theta - d_w d_theta
    F_s = f_u - m (g0 + ddz_r + L dd_theta/2)                  force of the object on the hand

so the robot feels its partner only through the tilt that its wrist resists. Vertical and lateral axes are of this kind; along
the beam ("axial") the two ends move as one. Each sub-step solves its linear equations exactly for inputs held constant.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import exp, isfinite
from typing import Any

import numpy as np

from .. import kernels
from ..errors import ParameterError, check_generator, check_has
from ..interaction import gravity_along
from ..interfaces import Array, Command, Observation, Partner
from ..kernels import layouts
from ..kernels.copies import Copied
from ..people.intent import BLOCK
from ..signals.second_order import second_order_step


@dataclass(frozen=True)
class Beam:
    """The object and how the robot holds it."""

    mass_kg: float = 2.0
    length_m: float = 0.8
    wrist_stiffness_nm_per_rad: float = 2000.0  # 10 N of F tilts 0.8 m of beam by 0.23 deg
    wrist_damping_nms_per_rad: float = 29.0  # damping ratio 0.5 of the beam on the wrist
    actuator_lag_s: float = 0.020  # velocity command -> hand velocity, first order

    def __post_init__(self) -> None:
        for name in ("mass_kg", "length_m", "wrist_stiffness_nm_per_rad", "actuator_lag_s"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} must be positive; got {getattr(self, name)}")


@dataclass(frozen=True)
class WristSensor:
    """What stands between the force on the hand and the number the skill gets."""

    noise_n: float = 0.2  # standard deviation of one sample
    bias_n: float = 0.0
    delay_s: float = 0.005


def shown(
    *, far_force: Array, far_position: Array, tilt: Array, acceleration: Array, true_force: Array
) -> dict[str, tuple[Array, str]]:
    """The channels of every plant that carries something, (d,) each, with their units."""
    return {
        "partner.force": (far_force, "N"),
        "partner.position": (far_position, "m"),
        "beam.tilt": (tilt, "rad"),
        "hand.acceleration": (acceleration, "m/s^2"),
        "hand.true_force": (true_force, "N"),
    }


class _TransverseAxis:
    """State of one axis across the beam; everything is a float because d is small and ticks are many."""

    def __init__(self, beam: Beam, gravity: float, step: float) -> None:
        self.beam, self.gravity, self.step = beam, gravity, step
        inertia = beam.mass_kg * beam.length_m**2 / 3.0
        self.inertia = inertia
        self.tilting = second_order_step(
            beam.wrist_stiffness_nm_per_rad / inertia, beam.wrist_damping_nms_per_rad / inertia, step
        )
        self.decay = exp(-step / beam.actuator_lag_s)
        self.reset(0.0)

    def reset(self, position: float) -> None:
        self.position, self.velocity, self.acceleration = position, 0.0, 0.0
        self.tilt, self.tilt_rate, self.tilt_acceleration = 0.0, 0.0, 0.0
        self.sensor_force = -0.5 * self.beam.mass_kg * self.gravity

    @property
    def far_position(self) -> float:
        return self.position + self.beam.length_m * self.tilt

    @property
    def far_velocity(self) -> float:
        return self.velocity + self.beam.length_m * self.tilt_rate

    def advance(self, commanded: float, partner_force: float) -> None:
        beam, step = self.beam, self.step
        m, length, lag = beam.mass_kg, beam.length_m, beam.actuator_lag_s
        error = self.velocity - commanded
        self.acceleration = -error * (1.0 - self.decay) / step  # mean over the sub-step
        self.position += commanded * step + error * lag * (1.0 - self.decay)
        self.velocity = commanded + error * self.decay
        moment = partner_force * length - 0.5 * m * (self.gravity + self.acceleration) * length
        self.tilt_acceleration = (
            moment - beam.wrist_stiffness_nm_per_rad * self.tilt - beam.wrist_damping_nms_per_rad * self.tilt_rate
        ) / self.inertia
        self.sensor_force = partner_force - m * (self.gravity + self.acceleration + 0.5 * length * self.tilt_acceleration)
        tilt, rate, pull = self.tilt, self.tilt_rate, moment / self.inertia
        one = self.tilting
        self.tilt = one.yy * tilt + one.yv * rate + one.yu * pull
        self.tilt_rate = one.vy * tilt + one.vv * rate + one.vu * pull


class _AxialAxis(_TransverseAxis):
    """Along the beam nothing tilts: the ends move as one and the partner's force arrives whole."""

    def reset(self, position: float) -> None:
        super().reset(position)
        self.sensor_force = 0.0

    def advance(self, commanded: float, partner_force: float) -> None:
        super().advance(commanded, 0.5 * self.beam.mass_kg * (self.gravity + self.acceleration))
        self.tilt = self.tilt_rate = self.tilt_acceleration = 0.0
        self.sensor_force = partner_force - self.beam.mass_kg * self.acceleration


SHOWN = len(layouts.BLOCKS["end"])


class BeamPlant(Copied):
    """Robot hand, beam and partner in closed loop, for any task axes.

    axes            names; the axis named `axial` lies along the beam, the others are across it
    gravity         (d,) [m/s^2], negative along an axis that points up; default: down along "z"
    dt              control period [s]; physics runs in `substep_s` <= 1 ms steps that divide it
    start_position  (d,) of the hand [m]
    rng             sensor noise; pass your own for a reproducible run
    """

    ANEW = ("_compiled",)

    def __init__(
        self,
        partner: Partner,
        *,
        beam: Beam = Beam(),
        sensor: WristSensor = WristSensor(),
        axes: tuple[str, ...] = ("z",),
        axial: str = "x",
        gravity: Sequence[float] | None = None,
        dt: float = 0.01,
        substep_s: float = 0.001,
        start_position: Array | None = None,
        rng: np.random.Generator,
    ) -> None:
        if not 0 < dt <= 0.1:
            raise ParameterError(f"control period dt must lie in (0, 0.1] s; got {dt}")
        self.dt, self.axes, self.beam, self.sensor, self.partner = dt, tuple(axes), beam, sensor, partner
        check_generator(rng)
        check_has(partner, "partner", ("reset", "force"), "comanip.interfaces.Partner")
        self._substeps = max(1, round(dt / substep_s))
        self._step = dt / self._substeps
        self._rng = rng
        d = len(self.axes)
        self._start = np.zeros(d) if start_position is None else np.array(start_position, dtype=float)
        if self._start.shape != (d,):
            raise ParameterError(f"start_position needs {d} values for axes {self.axes}; got {self._start.shape}")
        down = gravity_along(self.axes) if gravity is None else np.array(gravity, dtype=float)
        if down.shape != (d,):
            raise ParameterError(f"gravity needs {d} values for axes {self.axes}; got {down.shape}")
        self._state = [
            (_AxialAxis if name == axial else _TransverseAxis)(beam, 0.0 - g, self._step)
            for name, g in zip(self.axes, down.tolist(), strict=True)
        ]
        self._commanded = np.zeros(d)
        self._shown = np.zeros(SHOWN * d)
        self._ends = self._shown.reshape(SHOWN, d)
        self._far_position, self._far_velocity, self._partner_force, self._sampled = self._ends[-4:]
        self._tilt, self._acceleration, self._true_force = np.zeros(d), np.zeros(d), np.zeros(d)
        self._channels = shown(
            far_force=self._partner_force, far_position=self._far_position, tilt=self._tilt, acceleration=self._acceleration,
            true_force=self._true_force,
        )  # fmt: skip
        self.reset()

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def stop_reason(self) -> str:
        if not all(map(isfinite, self._far_position.tolist())):
            return "the plant's state is not finite"
        return ""

    def reset(self) -> None:
        for axis, position in zip(self._state, self._start, strict=True):
            axis.reset(float(position))
        self.time = 0.0
        self._commanded[:] = 0.0
        self._far_position[:] = self._start
        self._far_velocity[:] = 0.0
        self.partner.reset(self._start.copy())
        self._sampled[:] = [axis.sensor_force for axis in self._state]
        late = round(self.sensor.delay_s / self._step)
        self._see = getattr(self.partner, "see", None)
        self._line = [deque([axis.sensor_force] * (late + 1), maxlen=late + 1) for axis in self._state]
        self._run = b""
        self._made_of, self._noise = self._as_numbers(late)
        self._link()

    def _link(self) -> None:
        """Beam and person in C, where they are known by numbers; a copy's go on in mid-run."""
        if self._made_of and kernels.native is None:
            raise ParameterError("a beam in a compiled run goes on only where comanip is compiled, too; here it is not")
        self._compiled: Any = kernels.native.Beam(*self._made_of) if self._made_of else None
        if self._compiled is not None and self._run:
            self._compiled.recall(self._run)

    def __getstate__(self) -> dict[str, Any]:
        self._run = self._compiled.run() if self._made_of else b""
        return super().__getstate__()

    def _as_numbers(self, late: int) -> tuple[tuple[Any, ...], np.random.Generator]:
        """What a compiled run is made of, and where the partner's noise comes from; nothing where none can be."""
        person = self.partner.by_numbers() if hasattr(self.partner, "by_numbers") else None
        if kernels.native is None or person is None or len(self.axes) > 6 or self._substeps > BLOCK:
            return (), self._rng
        beam, one, axis = self.beam, self._state[0].tilting, self._state[0]
        on_the_way = {"inertia": axis.inertia, "decay": axis.decay, "step_s": self._step}
        wrist = layouts.packed("wrist", {**asdict(beam), **on_the_way, **one._asdict()})
        ends = np.array([[isinstance(a, _AxialAxis), a.gravity, a.position] for a in self._state], dtype=float)
        along = np.hstack([ends, person.along])
        curve = (person.legs, person.curve, person.clock)
        return (wrist, person.numbers, along, *curve, self._substeps, person.late, late), person.rng

    def read(self, obs: Observation) -> None:
        obs.time = self.time
        noise, sampled = self._rng.standard_normal(len(self.axes)).tolist(), self._sampled.tolist()
        for i, axis in enumerate(self._state):
            obs.position[i] = axis.position
            obs.velocity[i] = axis.velocity
            obs.sensor_force[i] = sampled[i] + self.sensor.bias_n + self.sensor.noise_n * noise[i]
            self._tilt[i] = axis.tilt
            self._acceleration[i] = axis.acceleration
            self._true_force[i] = axis.sensor_force + 0.5 * self.beam.mass_kg * (axis.gravity + axis.acceleration)

    def write(self, command: Command) -> None:
        self._commanded[:] = command.velocity

    def advance(self) -> None:
        """One control period. The sensor integrates over it, as anti-aliased sensors do."""
        if self._compiled is None:
            self._advance()
        else:
            if not self._compiled.advance(self.time, self._commanded, self._shown):
                self._compiled.feed(self._noise.standard_normal((len(self.axes), BLOCK)))
                self._compiled.advance(self.time, self._commanded, self._shown)
            for axis, numbers in zip(self._state, self._ends.T.tolist(), strict=True):
                axis.position, axis.velocity, axis.acceleration, axis.tilt, _, _, axis.sensor_force, *_ = numbers
        self.time += self.dt

    def draws_from(self, rng: Any) -> None:
        """Sensor and person draw from this stream of normal numbers, until the next reset."""
        self._rng = self._noise = rng

    def catch_up(self, time: float) -> None:
        """After periods that somebody else let the compiled beam pass (`kernels.native.carry`), up to `time` [s]."""
        for axis, numbers in zip(self._state, self._ends.T.tolist(), strict=True):
            axis.position, axis.velocity, axis.acceleration, axis.tilt, _, _, axis.sensor_force, *_ = numbers
        self.time = time

    def _advance(self) -> None:
        """The period to read."""
        total = [0.0] * len(self._state)
        commanded = self._commanded.tolist()
        for n in range(self._substeps):
            if self._see is not None:
                self._see([axis.tilt for axis in self._state], [axis.tilt_rate for axis in self._state])
            self.partner.force(self.time + n * self._step, self._far_position, self._far_velocity, self._partner_force)
            for i, axis in enumerate(self._state):
                axis.advance(commanded[i], float(self._partner_force[i]))
                self._far_position[i] = axis.far_position
                self._far_velocity[i] = axis.far_velocity
                line = self._line[i]
                line.append(axis.sensor_force)
                total[i] += line[0]
        self._sampled[:] = [t / self._substeps for t in total]
