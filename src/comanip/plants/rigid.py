"""An exact rigid object that turns: robot at one end, partner at the other, one angle beside any lengths.

The hand follows its velocity command through the actuator's lag, in every axis. The object's near end goes where the hand goes;
about the hand, which accelerates by a_h, it turns by phi on a compliant wrist held at phi_h (stiffness k_w, damping d_w):

    I_e dd_phi = [r_u x f_u] + tau_u - [r_c x m (a_h - g)] - k_w (phi - phi_h) - d_w (d_phi - d_phi_h)
    F_s = f_u - m (a_c - g)      a_c = a_h + dd_phi z x r_c - d_phi^2 r_c         T_s = k_w (phi - phi_h) + d_w (d_phi - d_phi_h)

f_u, tau_u are the partner's; r_c, r_u go from the hand to the centre of mass and to the partner's grip, along the object. Angles
of any size. With inputs held constant over a sub-step the wrist's equation is solved exactly. A roll about the object's own long
axis is the same with r = 0. Along a length that is not in the plane of turning the two ends move as one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, exp, isfinite, sin

import numpy as np

from ..errors import ParameterError
from ..interaction import TurningLoad
from ..interfaces import Array, Command, Observation, Partner
from ..people.intent import Course, Curve
from ..signals.second_order import second_order_step
from .beam import WristSensor, shown

STEP_S = 0.005  # of sampled courses
TORQUE_M = 0.05  # a wrist sensor's noise and bias of torque [N m] over those of force [N]


@dataclass(frozen=True)
class TurningObject:
    """The object and how the robot holds it."""

    mass_kg: float = 2.0
    length_m: float = 0.8  # from hand to hand
    width_m: float = 0.2
    wrist_stiffness_nm_per_rad: float = 2000.0
    damping_ratio: float = 0.5  # of the object on the wrist
    actuator_lag_s: float = 0.020  # velocity command -> hand velocity, first order

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not (getattr(self, name) > 0.0 and isfinite(getattr(self, name))):
                raise ParameterError(f"{name} must be positive; got {getattr(self, name)}")

    @property
    def across_kg_m2(self) -> float:
        """Inertia about the centre of mass, of turning end over end."""
        return self.mass_kg * (self.length_m**2 + self.width_m**2) / 12.0

    @property
    def along_kg_m2(self) -> float:
        """The same of a roll about the long axis."""
        return self.mass_kg * self.width_m**2 / 6.0


@dataclass(frozen=True)
class Turning:
    """Which axes turn how: what the plant and the robot's force estimate both have to know of a task.

    axes      (d,) names
    levers_m  (d,) at which an angle counts as a length, NaN for a length
    along     the axis that the object lies along at the start; it need not be one of `axes`
    hands_m   at which the partner's own hands turn the object: two on a rim are so far apart, a wrist is less

    One axis is an angle. It turns the object from `along` towards the first length that is not `along`; where there is none, it
    rolls about its own long axis.
    """

    axes: tuple[str, ...]
    levers_m: tuple[float, ...]
    along: str = ""
    hands_m: float = 0.25

    def __post_init__(self) -> None:
        if len(self.levers_m) != len(self.axes):
            raise ParameterError(f"levers_m has {len(self.levers_m)} entries; allowed: {len(self.axes)}, one an axis")
        angles = [name for name, lever in zip(self.axes, self.levers_m, strict=True) if lever == lever]
        if len(angles) != 1:
            raise ParameterError(f"this plant turns about one axis; got {', '.join(angles) or 'none'} of {', '.join(self.axes)}")

    @property
    def angle(self) -> int:
        return next(i for i, lever in enumerate(self.levers_m) if lever == lever)

    @property
    def lever_m(self) -> float:
        return self.levers_m[self.angle]

    @property
    def across(self) -> int | None:
        """Column of the length that the object turns towards; None: it rolls."""
        return next((i for i, n in enumerate(self.axes) if i != self.angle and n != self.along), None)

    @property
    def axial(self) -> int | None:
        """Column of the length that the object lies along, where it is a task axis."""
        return self.axes.index(self.along) if self.along in self.axes and self.across is not None else None

    def gripped(self, displacement: Array, length_m: float) -> Array:
        """(..., d) how the partner's grip moves when the hand moves the object by `displacement` (..., d): lengths [m], and the
        angle [rad] at the partner's hands, [m]."""
        out = np.array(displacement, dtype=float)
        turned = out[..., self.angle]
        if self.across is not None:
            out[..., self.across] += length_m * np.sin(turned)
        if self.axial is not None:
            out[..., self.axial] += length_m * (np.cos(turned) - 1.0)
        out[..., self.angle] = self.hands_m * turned
        return out

    def course(self, course: Course, length_m: float, gone: Array | None = None) -> Course:
        """How the partner's grip goes when the hand goes `course`, its angle an arc; from a displacement `gone` (d,) on."""
        scale = np.ones(len(self.axes))
        scale[self.angle] = self.lever_m
        steps = max(round((course.stop_s - course.start_s) / STEP_S), 1) + 2
        times: Array = course.start_s + STEP_S * np.arange(steps, dtype=np.float64)
        before: Array = np.zeros(len(self.axes)) if gone is None else gone
        there = self.gripped((before + course.sampled(times)) / scale, length_m) - self.gripped(before / scale, length_m)
        return Course((), Curve.through(course.start_s, STEP_S, there), course.feedforward_kg)

    def ungripped(self, displacement: Array, length_m: float) -> Array:
        """(..., d) the hand's displacement, with the angle as an arc, of a grip's: what undoes `gripped`."""
        out = np.array(displacement, dtype=float)
        turned = out[..., self.angle] / self.hands_m
        out[..., self.angle] = self.lever_m * turned
        if self.across is not None:
            out[..., self.across] -= length_m * np.sin(turned)
        if self.axial is not None:
            out[..., self.axial] -= length_m * (np.cos(turned) - 1.0)
        return out

    def load(self, held: TurningObject, share: float, gravity: Sequence[float]) -> TurningLoad:
        """What the robot's hand carries of it, for its force estimate."""
        rolls = self.across is None
        spin = (held.along_kg_m2 if rolls else held.across_kg_m2) / self.lever_m**2
        carried = tuple(share * (spin if i == self.angle else held.mass_kg) for i in range(len(self.axes)))
        centre = 0.0 if rolls else 0.5 * held.length_m
        return TurningLoad(carried, tuple(map(float, gravity)), self.angle, self.lever_m, self.across, self.axial, centre)


class RigidPlant:
    """Robot hand, turning object and partner in closed loop; positions [m] and [rad], forces [N] and [N m].

    The partner is asked in lengths, as people are made: where its grip is, seen from where it took hold, and how far the object
    has turned at `Turning.hands_m`; its force there times that is its torque.

    gravity          (d,) [m/s^2]; default: none, the plane is level
    start_position   (d,) of the hand [m], [rad]; dt, substep_s, rng as for `BeamPlant`
    """

    def __init__(
        self,
        partner: Partner,
        turning: Turning,
        *,
        held: TurningObject = TurningObject(),
        share: float = 0.5,
        sensor: WristSensor = WristSensor(),
        gravity: Sequence[float] | None = None,
        dt: float = 0.01,
        substep_s: float = 0.001,
        start_position: Array | None = None,
        rng: np.random.Generator,
    ) -> None:
        if not 0 < dt <= 0.1:
            raise ParameterError(f"control period dt must lie in (0, 0.1] s; got {dt}")
        d = len(turning.axes)
        self.dt, self.axes, self.turning, self.held, self.sensor, self.partner = dt, turning.axes, turning, held, sensor, partner
        self.units = tuple("rad" if i == turning.angle else "m" for i in range(d))
        self._gravity = np.zeros(d) if gravity is None else np.array(gravity, dtype=float)
        self._start = np.zeros(d) if start_position is None else np.array(start_position, dtype=float)
        for name, value in (("gravity", self._gravity), ("start_position", self._start)):
            if value.shape != (d,) or not np.isfinite(value).all():
                raise ParameterError(f"{name} needs {d} finite values for axes {self.axes}; got {value.tolist()}")
        if self._gravity[turning.angle]:
            raise ParameterError("gravity has no part along an angle")
        self._substeps = max(1, round(dt / substep_s))
        self._step, self._rng, self._share = dt / self._substeps, rng, share
        self._rolls = turning.across is None
        self._inertia = held.along_kg_m2 if self._rolls else held.across_kg_m2 + 0.25 * held.mass_kg * held.length_m**2
        k = held.wrist_stiffness_nm_per_rad / self._inertia
        c = 2.0 * held.damping_ratio * k**0.5
        self._damping = c * self._inertia
        self._wrist = second_order_step(k, c, self._step)
        self._decay = exp(-self._step / held.actuator_lag_s)
        self._commanded, self._grip, self._grip_speed, self._pull = (np.zeros(d) for _ in range(4))
        self._true, self._twisted, self._shown_acceleration = np.zeros(d), np.zeros(d), np.zeros(d)
        self._channels = shown(
            far_force=np.zeros(d), far_position=np.zeros(d), tilt=self._twisted, acceleration=self._shown_acceleration,
            true_force=self._true,
        )  # fmt: skip
        self.reset()

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        """As those of `BeamPlant`; beam.tilt is how far the wrist gives, the partner's torque is in partner.force [N m]."""
        return self._channels

    @property
    def stop_reason(self) -> str:
        return "" if all(map(isfinite, self._grip.tolist())) else "the plant's state is not finite"

    def reset(self) -> None:
        d = len(self.axes)
        self.time = 0.0
        self._x, self._v, self._a = self._start.tolist(), [0.0] * d, [0.0] * d
        self._start_floats, self._gravity_floats = self._start.tolist(), self._gravity.tolist()
        self._twist = self._twist_rate = self._turn_acceleration = 0.0
        self._commanded[:] = 0.0
        self._pull[:] = 0.0
        self._locate()
        self.partner.reset(self._grip.copy())
        self._sensed: list[float] = self._at_rest().tolist()
        self._sampled = np.array(self._sensed)
        late = round(self.sensor.delay_s / self._step)
        self._line = deque([self._sensed] * (late + 1), maxlen=late + 1)

    def _at_rest(self) -> Array:
        """What the sensor reads while both hold still: the weight that the hand carries."""
        return np.asarray(self._share * self.held.mass_kg * self._gravity)

    def _turned(self) -> float:
        """How far the object has turned since the start [rad]."""
        i = self.turning.angle
        return self._x[i] - self._start_floats[i] + self._twist

    def _locate(self) -> None:
        """Where the partner's grip is, and how fast, as the partner is told."""
        i, length, t = self.turning.angle, self.held.length_m, self.turning
        phi, rate = self._turned(), self._v[i] + self._twist_rate
        self._cos, self._sin = cos(phi), sin(phi)
        grip, speed = list(self._x), list(self._v)
        if t.across is not None:
            grip[t.across] += length * self._sin
            speed[t.across] += rate * length * self._cos
            if t.axial is not None:
                grip[t.axial] += length * (self._cos - 1.0)
                speed[t.axial] -= rate * length * self._sin
        grip[i], speed[i] = t.hands_m * phi, t.hands_m * rate
        self._grip[:], self._grip_speed[:] = grip, speed

    def read(self, obs: Observation) -> None:
        i, d = self.turning.angle, len(self.axes)
        scale = np.ones(d)
        scale[i] = TORQUE_M
        obs.time = self.time
        obs.position[:], obs.velocity[:] = self._x, self._v
        noise = self.sensor.bias_n + self.sensor.noise_n * self._rng.standard_normal(d)
        obs.sensor_force[:] = self._sampled + scale * noise
        self._twisted[i] = self._twist
        self._shown_acceleration[:] = self._a
        self._true[:] = self._sensed + self._share * self._carried()
        self._channels["partner.position"][0][:] = self._grip
        self._channels["partner.force"][0][:] = self._pull
        self._channels["partner.force"][0][i] = self.turning.hands_m * self._pull[i]

    def _carried(self) -> Array:
        """(d,) what it takes to carry the object as it moves: m (a_c - g) [N], and I_c dd_phi [N m]."""
        out = self.held.mass_kg * (np.array(self._centre_acceleration()) - self._gravity)
        spin = self.held.along_kg_m2 if self._rolls else self.held.across_kg_m2
        out[self.turning.angle] = spin * self._turn_acceleration
        return np.asarray(out)

    def _centre_acceleration(self) -> list[float]:
        """a_h + dd_phi z x r_c - d_phi^2 r_c [m/s^2], with the sub-step's own angle."""
        out, t = list(self._a), self.turning
        if t.across is not None:
            half, rate = 0.5 * self.held.length_m, self._v[t.angle] + self._twist_rate
            out[t.across] += half * (self._turn_acceleration * self._cos - rate * rate * self._sin)
            if t.axial is not None:
                out[t.axial] -= half * (self._turn_acceleration * self._sin + rate * rate * self._cos)
        return out

    def write(self, command: Command) -> None:
        self._commanded[:] = command.velocity

    def advance(self) -> None:
        """One control period. The sensor integrates over it, as anti-aliased sensors do."""
        total, commanded = [0.0] * len(self.axes), self._commanded.tolist()
        for n in range(self._substeps):
            self.partner.force(self.time + n * self._step, self._grip, self._grip_speed, self._pull)
            self._advance(commanded, self._pull.tolist())
            self._line.append(self._sensed)
            total = [t + f for t, f in zip(total, self._line[0], strict=True)]
        self._sampled[:] = [t / self._substeps for t in total]
        self.time += self.dt

    def _advance(self, commanded: list[float], pull: list[float]) -> None:
        """One sub-step, in plain floats: on a few axes numpy's calls cost ten times the arithmetic."""
        t, step, held, decay, gravity = self.turning, self._step, self.held, self._decay, self._gravity_floats
        error = [v - c for v, c in zip(self._v, commanded, strict=True)]
        self._a = [-e * ((1.0 - decay) / step) for e in error]  # mean over the sub-step
        far = held.actuator_lag_s * (1.0 - decay)
        self._x = [x + c * step + e * far for x, c, e in zip(self._x, commanded, error, strict=True)]
        self._v = [c + e * decay for c, e in zip(commanded, error, strict=True)]
        moment = t.hands_m * pull[t.angle]
        half = 0.5 * held.length_m
        self._cos, self._sin = cos(self._turned()), sin(self._turned())
        if t.across is not None:
            weight = held.mass_kg * half * (self._a[t.across] - gravity[t.across])
            moment += self._cos * (held.length_m * pull[t.across] - weight)
            if t.axial is not None:
                weight = held.mass_kg * half * (self._a[t.axial] - gravity[t.axial])
                moment -= self._sin * (held.length_m * pull[t.axial] - weight)
        wrist = held.wrist_stiffness_nm_per_rad * self._twist + self._damping * self._twist_rate
        self._turn_acceleration = (moment - wrist) / self._inertia
        centre = self._centre_acceleration()
        self._sensed = [f - held.mass_kg * (c - g) for f, c, g in zip(pull, centre, gravity, strict=True)]
        self._sensed[t.angle] = wrist
        u, one, y, v = moment / self._inertia - self._a[t.angle], self._wrist, self._twist, self._twist_rate
        self._twist = one.yy * y + one.yv * v + one.yu * u
        self._twist_rate = one.vy * y + one.vv * v + one.vu * u
        self._locate()


class AtLever:
    """The same plant with its angle as a length at the lever [m] and its torque as a force there [N], for a loop of lengths."""

    def __init__(self, plant: RigidPlant) -> None:
        self.plant, self.dt, self.axes = plant, plant.dt, plant.axes
        self._scale = np.ones(len(plant.axes))
        self._scale[plant.turning.angle] = plant.turning.lever_m
        self._command = Command(len(plant.axes))
        self._channels = {name: (array.copy(), unit) for name, (array, unit) in plant.channels.items()}

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def stop_reason(self) -> str:
        return self.plant.stop_reason

    def reset(self) -> None:
        self.plant.reset()

    def read(self, obs: Observation) -> None:
        self.plant.read(obs)
        for values in (obs.position, obs.velocity):
            values *= self._scale
        obs.sensor_force /= self._scale
        for name, (array, _) in self.plant.channels.items():
            shown = self._channels[name][0]
            if name == "hand.acceleration":
                shown[:] = array * self._scale
            else:
                shown[:] = array / self._scale if name in ("partner.force", "hand.true_force") else array

    def write(self, command: Command) -> None:
        for name in ("position", "velocity", "acceleration"):
            getattr(self._command, name)[:] = getattr(command, name) / self._scale
        self.plant.write(self._command)

    def advance(self) -> None:
        self.plant.advance()
