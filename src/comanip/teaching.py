"""Lessons: a teacher moves the robot through a haptic handle while a partner holds the other end of the beam.

The paper's two sets (section II-A): robot as follower (teacher blind, partner leads) and robot as leader (teacher leads,
partner blind). A third set is "natural": nobody is told a role, both know about how high and how fast, and each gives way to
what he feels of the other. Each lesson draws its lift, duration, onset and the day's arms from stated distributions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from typing import Protocol

import numpy as np

from .devices.link import Link, Network
from .devices.phantom import IDEAL, HeldHandle, phantom
from .errors import ParameterError
from .interaction import gravity_along, interaction_force
from .interfaces import STANDARD_GRAVITY, Array, HapticDevice, Partner, Plant
from .loop import run, unbroken
from .people.intent import Plan, Yielding
from .people.partners import Arm, HumanFollower, HumanLeader, HumanSharing, dyad
from .people.teacher import Teacher, TeacherHand
from .plants.beam import Beam, BeamPlant, WristSensor
from .recording import Recording
from .signals.filters import differentiate, smooth
from .skills.passivity import Passive
from .skills.teleoperation import CouplingLimits, Teleoperation

ROLES = ("leader", "follower")
SCENARIOS = (*ROLES, "natural")
FORCE_CUTOFF_HZ = 10.0
Rng = np.random.Generator


@dataclass(frozen=True)
class Habits:
    """A dyad: its arms and habits, and the distributions that lessons are drawn from: (mean, standard deviation), or (low,
    high) for onset. What the teacher feels is stated at the ROBOT's scale; the handle's is s_v K_f or K_f times that.
    """

    lift_m: tuple[float, float] = (0.30, 0.025)
    duration_s: tuple[float, float] = (2.2, 0.25)
    shortest_s: float = 1.8
    onset_s: tuple[float, float] = (0.4, 1.2)
    after_s: float = 1.0  # how long both hold still at the top
    start_m: tuple[float, float] = (0.85, 0.0)
    leading_arm: Arm = field(default_factory=lambda: Arm(120.0, 20.0))
    following_arm: Arm = field(default_factory=lambda: Arm(90.0, 22.0))
    yielding: Yielding = field(default_factory=Yielding)
    leading_hand: TeacherHand = field(default_factory=TeacherHand)
    following_hand: TeacherHand = field(default_factory=lambda: TeacherHand(stiffness_n_per_m=90.0))
    teacher_damping_ns_per_m: float = 40.0  # F it takes a following teacher for 1 m/s
    teacher_dead_zone_n: float = 2.0  # F that a following teacher does not answer
    teacher_delay_s: float = 0.12
    # natural lessons: how far two people's ideas of the same lift lie apart (standard deviation of each)
    lift_apart_m: float = 0.015
    duration_apart: float = 0.05  # share of the duration
    onset_apart_s: float = 0.15


# Three pairs of people: "a" as in all figures, "b" softer and more patient, "c" stiffer and quicker, with a shorter way up
DYADS = {
    "a": Habits(),
    "b": Habits(
        lift_m=(0.33, 0.03),
        duration_s=(2.9, 0.3),
        shortest_s=2.3,
        onset_s=(0.5, 1.6),
        leading_arm=Arm(85.0, 16.0),
        following_arm=Arm(65.0, 17.0),
        yielding=Yielding(damping_ns_per_m=20.0, persistence=0.4, delay_s=0.18, dead_zone_n=0.5),
        leading_hand=TeacherHand(0.4, 110.0, 12.0),
        following_hand=TeacherHand(0.4, 70.0, 11.0),
        teacher_damping_ns_per_m=32.0,
        teacher_dead_zone_n=1.5,
        teacher_delay_s=0.15,
    ),
    "c": Habits(
        lift_m=(0.26, 0.02),
        duration_s=(1.9, 0.15),
        shortest_s=1.6,
        onset_s=(0.3, 0.9),
        leading_arm=Arm(190.0, 30.0),
        following_arm=Arm(130.0, 30.0),
        yielding=Yielding(damping_ns_per_m=34.0, persistence=0.5, delay_s=0.12, dead_zone_n=1.2),
        leading_hand=TeacherHand(0.7, 230.0, 20.0),
        following_hand=TeacherHand(0.7, 130.0, 18.0),
        teacher_damping_ns_per_m=50.0,
        teacher_dead_zone_n=2.5,
        teacher_delay_s=0.10,
    ),
}


@dataclass(frozen=True)
class Coupling:
    """Eqs. (1), (2): what the haptic side is set to.

    device     "ideal" (mass, friction and an 8.5 N limit) or "phantom" (a Premium 1.5: see `PHANTOM`)
    network    between device and robot; None: a cable without delay
    passivity  energy that the network makes is taken out on the device's side (`skills.passivity`)
    """

    force_gain: float = 0.15
    velocity_scale: float = 1.3
    device_period_s: float = 0.001
    device: str = "ideal"
    network: Network | None = None
    passivity: bool = False
    limits: CouplingLimits = field(default_factory=CouplingLimits)

    def __post_init__(self) -> None:
        if self.device not in ("ideal", "phantom"):
            raise ParameterError(f"device {self.device!r} is unknown; devices are: ideal, phantom")

    @property
    def rendered_gain(self) -> float:
        """K_f that the network's delay leaves: the weight and the pull that a teacher gets used to."""
        delay = self.network.to_device_s + self.network.to_robot_s if self.network else 0.0
        return self.force_gain * self.limits.feedback(delay)


# 267 mm of height, taken hold of 15 mm above the lowest: 1.6 lets a lift of 0.4 m fit; at 1.3 it would end at 0.33 m
PHANTOM = Coupling(velocity_scale=1.6, device="phantom")
PHANTOM_START_M = -0.118


class MakesPlant(Protocol):
    """How lessons make their plant: vertical axis, `start_position` (1,) [m], control period `dt` [s]."""

    def __call__(
        self, partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: Rng
    ) -> Plant: ...


def teach(
    role: str,
    lessons: int = 5,
    *,
    rng: np.random.Generator,
    habits: Habits = Habits(),
    beam: Beam = Beam(),
    sensor: WristSensor = WristSensor(),
    coupling: Coupling = Coupling(),
    plant: str | MakesPlant = "beam",
    progress: Callable[[int, int], None] | None = None,
    keep: Callable[[int, Recording], None] | None = None,
) -> list[Recording]:
    """`lessons` Recordings of the robot in `role` ("leader", "follower", or "natural"), at the device's 1 kHz, vertical axis.

    habits   the dyad, for example DYADS["b"]
    plant    "beam", "humanoid" (needs mujoco), or your own maker of a `Plant`, called as MakesPlant says
    keep     called with number and Recording as soon as a lesson is over, to store it: a crash then loses one lesson, not all

    The recordings hold device, hand, object and partner: the raw sensor force (hand.sensor_force) and what eq. (3) makes of it
    (hand.compensated_force, zero-phase below 10 Hz, for looking at; demonstrations compute their own), what was commanded
    (command.*, device.force) and what came of it (hand.*, device.applied). A lesson that a fault ended is kept, with the reason
    under metadata["incomplete"]. So is one that Control-C cut; then no other is begun, and KeyboardInterrupt goes on.
    """
    if role not in SCENARIOS:
        raise ParameterError(f"role {role!r} is unknown; roles are: {', '.join(SCENARIOS)}")
    make = _maker(plant)
    recordings = []
    for number in range(lessons):
        recordings.append(_lesson(role, number, rng, habits, beam, sensor, coupling, make))
        if keep is not None:
            keep(number, recordings[-1])
        if progress is not None:
            progress(number + 1, lessons)
        unbroken(recordings[-1])
    return recordings


def _lesson(
    role: str,
    number: int,
    rng: np.random.Generator,
    habits: Habits,
    beam: Beam,
    sensor: WristSensor,
    coupling: Coupling,
    make: MakesPlant,
) -> Recording:
    drawn = Plan(
        lift_m=float(rng.normal(*habits.lift_m)),
        duration_s=max(habits.shortest_s, float(rng.normal(*habits.duration_s))),
        onset_s=float(rng.uniform(*habits.onset_s)),
        feedforward_kg=0.5 * beam.mass_kg,
    )
    start = np.array([rng.normal(*habits.start_m)])
    partner, teacher = _people(role, drawn, habits, beam, coupling, rng)
    dt = coupling.device_period_s
    plant = make(partner, beam=beam, sensor=sensor, dt=dt, start_position=start, rng=rng)
    teleoperation = Teleoperation(
        _device(teacher, coupling, rng),
        n_axes=1,
        dt=dt,
        force_gain=coupling.force_gain,
        velocity_scale=coupling.velocity_scale,
        limits=coupling.limits,
        carried=True,
    )
    metadata = {
        "role": role,
        "task": "lift",
        "lesson": number,
        "load_mass_kg": beam.mass_kg,
        "load_share": 0.5,
        "lift_m": drawn.lift_m,
        "duration_s": drawn.duration_s,
        "onset_s": drawn.onset_s,
        "coupling": asdict(coupling),
    }
    duration = drawn.onset_s + drawn.duration_s + habits.after_s
    recording = _with_interaction_force(run(plant, teleoperation, duration_s=duration, metadata=metadata), beam)
    stopped = recording.metadata["stop_reason"]
    reason = teleoperation.fault or (stopped if stopped != "duration" else "")
    return recording.with_metadata(incomplete=reason) if reason else recording


def _with_interaction_force(recording: Recording, beam: Beam) -> Recording:
    sensed, speed = recording["hand.sensor_force"], recording["hand.velocity"].values
    if len(speed) < 20:
        return recording
    dt = recording.metadata["dt_s"]
    force = interaction_force(
        smooth(sensed.values, dt, FORCE_CUTOFF_HZ),
        smooth(differentiate(speed, dt), dt, FORCE_CUTOFF_HZ),
        mass_kg=beam.mass_kg,
        gravity=gravity_along(sensed.axes),
    )
    return recording.with_channels({"hand.compensated_force": replace(sensed, values=force)})


def _beam_plant(partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: Rng) -> Plant:
    return BeamPlant(partner, beam=beam, sensor=sensor, dt=dt, start_position=start_position, rng=rng)


def _humanoid_plant(partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: Rng) -> Plant:
    try:
        humanoid = import_module("comanip.plants.humanoid")
        made: Plant = humanoid.HumanoidPlant(
            partner, load_mass_kg=beam.mass_kg, sensor=sensor, axes=("z",), dt=dt, start_position=start_position, rng=rng
        )
    except ImportError as error:
        raise ParameterError(
            f"plant 'humanoid' cannot be built here ({error}): pip install 'comanip[humanoid]', or use plant 'beam'"
        ) from None
    return made


PLANTS: dict[str, MakesPlant] = {"beam": _beam_plant, "humanoid": _humanoid_plant}


def _maker(plant: str | MakesPlant) -> MakesPlant:
    if not isinstance(plant, str):
        return plant
    if plant not in PLANTS:
        raise ParameterError(f"plant {plant!r} is unknown; plants are: {', '.join(PLANTS)}")
    return PLANTS[plant]


def _device(teacher: Teacher, coupling: Coupling, rng: np.random.Generator) -> HapticDevice:
    """The handle, its account of energy on its own side, and the network between them and the robot."""
    device: HapticDevice = HeldHandle(teacher)
    if coupling.device == "phantom":
        device = HeldHandle(teacher, phantom(), start_m=np.array([PHANTOM_START_M]))
    if coupling.passivity:
        device = Passive(device)
    return device if coupling.network is None else Link(device, coupling.network, rng=rng)


def _people(
    role: str, drawn: Plan, habits: Habits, beam: Beam, coupling: Coupling, rng: np.random.Generator
) -> tuple[Partner, Teacher]:
    """Who leads, who follows, or two who share; the partner at the robot's scale, the teacher at the handle's."""
    leads = {"follower": habits.leading_arm, "leader": habits.following_arm, "natural": habits.leading_arm}
    carried = 0.5 * beam.mass_kg * STANDARD_GRAVITY
    arm = replace(dyad(rng, leads[role]), carried_n=carried)
    static = np.array([-coupling.rendered_gain * carried])
    if role == "follower":
        hand, plan, yielding = habits.following_hand, None, _felt_by_teacher(habits, coupling)
        return HumanLeader(drawn, arm, rng=rng), Teacher(yielding=yielding, hand=hand, static_force=static, rng=rng)
    hand = habits.leading_hand
    if role == "leader":
        plan = _at_handle(drawn, hand, coupling)
        return HumanFollower(habits.yielding, arm, rng=rng), Teacher(plan=plan, hand=hand, static_force=static, rng=rng)
    partners, teachers = _idea(drawn, habits, rng), _idea(drawn, habits, rng)
    teacher = Teacher(
        plan=_at_handle(teachers, hand, coupling),
        yielding=_felt_by_teacher(habits, coupling),
        hand=hand,
        static_force=static,
        rng=rng,
    )
    return HumanSharing(partners, habits.yielding, arm, rng=rng), teacher


def _idea(common: Plan, habits: Habits, rng: np.random.Generator) -> Plan:
    """One person's idea of the lift that both were told."""
    return replace(
        common,
        lift_m=common.lift_m + habits.lift_apart_m * float(rng.normal()),
        duration_s=common.duration_s * max(0.7, 1.0 + habits.duration_apart * float(rng.normal())),
        onset_s=max(0.0, common.onset_s + habits.onset_apart_s * float(rng.normal())),
    )


def _at_handle(plan: Plan, hand: TeacherHand, coupling: Coupling) -> Plan:
    return replace(plan, lift_m=plan.lift_m / coupling.velocity_scale, feedforward_kg=hand.mass_kg + IDEAL.mass_kg)


def _felt_by_teacher(habits: Habits, coupling: Coupling) -> Yielding:
    gain = coupling.rendered_gain
    if not gain > 0:
        raise ParameterError(
            f"a teacher who feels nothing cannot yield: K_f is {gain:g} at this delay; "
            f"keep the round trip below {1000.0 * coupling.limits.no_feedback_s:g} ms, or teach as leader"
        )
    return Yielding(
        damping_ns_per_m=habits.teacher_damping_ns_per_m * coupling.velocity_scale * gain,
        persistence=0.3,
        lag_s=0.06,
        delay_s=habits.teacher_delay_s,
        dead_zone_n=habits.teacher_dead_zone_n * gain,
    )
