"""Lessons of any task: a teacher moves the robot through a haptic handle while a partner holds the other end of the object.

The paper's two sets (section II-A): robot as follower (teacher blind, partner leads) and robot as leader (teacher leads,
partner blind). A third set is "natural": nobody is told a role, both know about how high and how fast, and each gives way to
what is felt of the other. Each lesson draws its size, duration, onset and the day's arms from stated distributions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from inspect import signature
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .devices.link import Link, Network
from .devices.phantom import IDEAL
from .errors import ParameterError, check_generator
from .interaction import interaction_force
from .interfaces import Array, HapticDevice, Partner, Plant
from .loop import run, unbroken
from .parts import DEVICES, PLANTS, known, unknown
from .people.intent import Course, Yielding
from .people.partners import Arm, HumanFollower, HumanLeader, HumanSharing, dyad
from .people.teacher import Teacher, TeacherHand
from .plants.beam import Beam, WristSensor
from .plants.rigid import Turning, TurningObject
from .recording import Recording
from .signals.filters import differentiate, smooth
from .skills.passivity import Passive
from .skills.teleoperation import CouplingLimits, Teleoperation
from .tasks import Drawn, Spread, Task, draw_lesson, named, way

ROLES = ("leader", "follower")
SCENARIOS = (*ROLES, "natural")
FORCE_CUTOFF_HZ = 10.0
Rng = np.random.Generator


@dataclass(frozen=True)
class Habits:
    """A dyad: its arms and habits, and the distributions that its lessons of the usual task, "lift", are drawn from: (mean,
    standard deviation), or (low, high) for onset. In another task all of it grows and shrinks with the task's own numbers. What
    the teacher feels is stated at the ROBOT's scale; the handle's is s_v K_f or K_f times that.

    start_m   (mean, standard deviation) of where the hand starts in a task of one axis; None: as the task says
    """

    lift_m: tuple[float, float] = (0.30, 0.025)
    duration_s: tuple[float, float] = (2.2, 0.25)
    shortest_s: float = 1.8
    onset_s: tuple[float, float] = (0.4, 1.2)
    after_s: float = 1.0  # how long both hold still at the end
    start_m: tuple[float, float] | None = None
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

    device     one of `parts.DEVICES`: "ideal" (mass, friction and an 8.5 N limit), "phantom" (a Premium 1.5: see `PHANTOM`) ...
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
        known("device", self.device, DEVICES)

    @classmethod
    def usual(cls, device: str, **changes: Any) -> Coupling:
        """With the velocity scale at which a lift fits that device's workspace."""
        return cls(**{"device": device, "velocity_scale": known("device", device, DEVICES).velocity_scale, **changes})

    @property
    def rendered_gain(self) -> float:
        """K_f that the network's delay leaves: the weight and the pull that a teacher gets used to."""
        delay = self.network.to_device_s + self.network.to_robot_s if self.network else 0.0
        return self.force_gain * self.limits.feedback(delay)


PHANTOM = Coupling.usual("phantom")


class MakesPlant(Protocol):
    """How lessons make their plant: `start_position` (d,) [m], control period `dt` [s]. One whose arguments also name `task` is
    told the Task, with its axes and its gravity."""

    def __call__(
        self, partner: Partner, *, beam: Beam, sensor: WristSensor, dt: float, start_position: Array, rng: Rng
    ) -> Plant: ...


def teach(
    role: str,
    lessons: int = 5,
    *,
    task: str | Path | Task = "lift",
    rng: np.random.Generator,
    habits: Habits = Habits(),
    beam: Beam | None = None,
    sensor: WristSensor = WristSensor(),
    coupling: Coupling = Coupling(),
    plant: str | MakesPlant = "beam",
    progress: Callable[[int, int], None] | None = None,
    keep: Callable[[int, Recording], None] | None = None,
) -> list[Recording]:
    """`lessons` Recordings of the robot in `role` ("leader", "follower", or "natural"), at the device's 1 kHz.

    task     one that ships by its name, a file, or a Task
    beam     the object; default: the task's own
    habits   the dyad, for example DYADS["b"]
    plant    of `parts.PLANTS`: "beam", "humanoid" (needs mujoco) ...; or your own maker of a `Plant`, called as MakesPlant says
    keep     called with number and Recording as soon as a lesson is over, to store it: a crash then loses one lesson, not all

    The recordings hold device, hand, object and partner: the raw sensor force (hand.sensor_force) and what eq. (3) makes of it
    (hand.compensated_force, zero-phase below 10 Hz, for looking at; demonstrations compute their own), what was commanded
    (command.*, device.force) and what came of it (hand.*, device.applied). A lesson that a fault ended is kept, with the reason
    under metadata["incomplete"]. So is one that Control-C cut; then no other is begun, and KeyboardInterrupt goes on.
    """
    if role not in SCENARIOS:
        raise unknown("role", role, SCENARIOS)
    check_generator(rng)
    what, make = named(task).runnable().in_arcs(), _maker(plant)
    carried = beam or Beam(mass_kg=what.carried.mass_kg, length_m=what.carried.length_m)
    recordings = []
    for number in range(lessons):
        recordings.append(_lesson(what, role, number, rng, habits, carried, sensor, coupling, make))
        if keep is not None:
            keep(number, recordings[-1])
        if progress is not None:
            progress(number + 1, lessons)
        unbroken(recordings[-1])
    return recordings


def _lesson(
    task: Task,
    role: str,
    number: int,
    rng: np.random.Generator,
    habits: Habits,
    beam: Beam,
    sensor: WristSensor,
    coupling: Coupling,
    make: MakesPlant,
) -> Recording:
    drawn = draw_lesson(task, rng, _spread(task, habits))
    if task.goals:  # five lessons drawn at random may all go to one of them, and then nothing is learned of the others
        drawn = replace(drawn, goal=list(task.goals)[number % len(task.goals)])
    start = task.start if drawn.start is None else task.start + np.array(drawn.start)
    if habits.start_m is not None:
        start = np.array([rng.normal(*habits.start_m)])
    partner, teacher = _people(task, role, drawn, habits, beam, coupling, rng)
    dt = coupling.device_period_s
    told: dict[str, Any] = {"task": task} if "task" in signature(make).parameters else {}
    plant = make(partner, beam=beam, sensor=sensor, dt=dt, start_position=start, rng=rng, **told)
    if tuple(plant.axes) != task.axes:
        raise ParameterError(
            f"the plant moves axes {tuple(plant.axes)}; task {task.name!r} has {task.axes}: let its maker take an argument `task`"
        )
    course = way(task, drawn).course
    teleoperation = Teleoperation(
        _device(teacher, course, task, coupling, rng),
        n_axes=len(task.axes),
        dt=dt,
        force_gain=coupling.force_gain,
        velocity_scale=coupling.velocity_scale,
        limits=coupling.limits,
        carried=True,
    )
    metadata = {
        "role": role,
        "task": task.name,
        "lesson": number,
        "load_mass_kg": beam.mass_kg,
        "load_share": task.carried.share,
        "gravity_m_per_s2": task.gravity.tolist(),
        "lift_m": drawn.size_m,
        "duration_s": drawn.duration_s,
        "onset_s": drawn.onset_s,
        "end_m": course.end.tolist(),
        **({"levers_m": dict(zip(task.axes, task.levers_m, strict=True))} if task.turns else {}),
        "coupling": asdict(coupling),
    }
    metadata |= {"goal": drawn.goal} if drawn.goal else {}
    recording = run(plant, teleoperation, duration_s=course.stop_s + habits.after_s, metadata=metadata)
    recording = _with_interaction_force(recording, beam, task)
    if task.obstacles:
        recording = recording.with_metadata(clearance_m=clearance_of(task, recording))
    stopped = recording.metadata["stop_reason"]
    reason = teleoperation.fault or (stopped if stopped != "duration" else "")
    return recording.with_metadata(incomplete=reason) if reason else recording


def clearance_of(task: Task, recording: Recording) -> float:
    """Smallest distance [m] of the hand in a recording to the task's obstacles."""
    place = recording["hand.position"].values
    offset = place[0] - task.start if task.fixed_places else None
    return task.clearance_m(place - place[0], offset)


def _spread(task: Task, habits: Habits) -> Spread:
    """What this dyad's lessons of a task are drawn from: as its lifts differ from the usual lift."""
    usual, one = Habits(), task.lessons
    far, long = task.size_m / usual.lift_m[0], task.moving_s / usual.duration_s[0]
    far_sd, long_sd = one.size_sd_m / usual.lift_m[1], one.duration_sd_s / usual.duration_s[1]
    return Spread(
        size_m=(habits.lift_m[0] * far, habits.lift_m[1] * far_sd),
        duration_s=(habits.duration_s[0] * long, habits.duration_s[1] * long_sd),
        shortest_s=habits.shortest_s * (one.shortest_s / usual.shortest_s),
        onset_s=habits.onset_s if one.onset_s == usual.onset_s else one.onset_s,
    )


def _with_interaction_force(recording: Recording, beam: Beam, task: Task) -> Recording:
    sensed, speed = recording["hand.sensor_force"], recording["hand.velocity"].values
    if len(speed) < 20:
        return recording
    dt = recording.metadata["dt_s"]
    if task.turns:  # no mass alone takes the load's inertia off: the force of the lesson is made here
        load = _turning(task).load(_turned(beam, task), task.carried.share, task.gravity.tolist())
        place = recording["hand.position"].values
        rate = smooth(differentiate(load.centre_velocity(place - place[0], speed), dt), dt, FORCE_CUTOFF_HZ)
        force = load.interaction(smooth(sensed.values, dt, FORCE_CUTOFF_HZ), rate)
        return recording.with_channels({"hand.force": replace(sensed, values=force)})
    force = interaction_force(
        smooth(sensed.values, dt, FORCE_CUTOFF_HZ),
        smooth(differentiate(speed, dt), dt, FORCE_CUTOFF_HZ),
        mass_kg=beam.mass_kg,
        load_share=task.carried.share,
        gravity=task.gravity,
    )
    return recording.with_channels({"hand.compensated_force": replace(sensed, values=force)})


def _turning(task: Task) -> Turning:
    return Turning(task.axes, task.levers_m, task.carried.along)


def _turned(beam: Beam, task: Task) -> TurningObject:
    return TurningObject(beam.mass_kg, beam.length_m, task.carried.width_m)


def _maker(plant: str | MakesPlant) -> MakesPlant:
    if not isinstance(plant, str):
        return plant
    made: MakesPlant = known("plant", plant, PLANTS).load()
    return made


def _device(teacher: Teacher, course: Course, task: Task, coupling: Coupling, rng: np.random.Generator) -> HapticDevice:
    """The handle, its account of energy on its own side, and the network between them and the robot."""
    moves = course.sampled(np.linspace(course.start_s, course.stop_s, 100)) / coupling.velocity_scale
    device: HapticDevice = DEVICES[coupling.device].load()(teacher, axes=task.axes, moves=moves)
    if coupling.passivity:
        device = Passive(device)
    return device if coupling.network is None else Link(device, coupling.network, rng=rng)


def _people(
    task: Task, role: str, drawn: Drawn, habits: Habits, beam: Beam, coupling: Coupling, rng: np.random.Generator
) -> tuple[Partner, Teacher]:
    """Who leads, who follows, or two who share; the partner at the robot's scale, the teacher at the handle's."""
    leads = {"follower": habits.leading_arm, "leader": habits.following_arm, "natural": habits.leading_arm}
    share_kg = (1.0 - task.carried.share) * beam.mass_kg
    carried = [share_kg * -g for g in task.gravity.tolist()]
    arm = dyad(rng, leads[role])
    static = np.array([-coupling.rendered_gain * n for n in carried])
    about: dict[str, Any] = {"axes": task.axes, "carried": carried, "rng": rng}
    everywhere = range(len(task.axes))

    def meant(one: Drawn) -> Course:
        return way(task, one, share_kg).course

    def at_grip(one: Drawn) -> Course:
        """Where the partner's own hand goes for it."""
        return _turning(task).course(meant(one), task.carried.length_m) if task.turns else meant(one)

    if role == "follower":
        hand, yielding = habits.following_hand, _felt_by_teacher(habits, coupling)
        teacher = Teacher(yielding=yielding, hand=hand, static_force=static, moving=everywhere, rng=rng)
        return HumanLeader(at_grip(drawn), arm, **about), teacher
    hand = habits.leading_hand
    if role == "leader":
        plan = _at_handle(meant(drawn), hand, coupling)
        partner = HumanFollower(habits.yielding, arm, moving=task.axes, **about)
        return partner, Teacher(plan=plan, hand=hand, static_force=static, rng=rng)
    partners, teachers = (made(_idea(task, drawn, habits, rng)) for made in (at_grip, meant))
    teacher = Teacher(
        plan=_at_handle(teachers, hand, coupling),
        yielding=_felt_by_teacher(habits, coupling),
        hand=hand,
        static_force=static,
        rng=rng,
    )
    return HumanSharing(partners, habits.yielding, arm, **about), teacher


def _idea(task: Task, common: Drawn, habits: Habits, rng: np.random.Generator) -> Drawn:
    """One person's idea of the way that both were told. Who saws or cranks together agrees on the beat: over all cycles the two
    ideas of it part by no more than over one motion."""
    apart = habits.duration_apart / max(task.cycles, 1.0)
    idea = replace(
        common,
        size_m=common.size_m + habits.lift_apart_m * float(rng.normal()),
        duration_s=common.duration_s * max(0.7, 1.0 + apart * float(rng.normal())),
        onset_s=max(0.0, common.onset_s + habits.onset_apart_s * float(rng.normal())),
    )
    if not task.rests_s:
        return idea
    return replace(idea, rest=common.rest * max(0.7, 1.0 + habits.duration_apart * float(rng.normal())))


def _at_handle(course: Course, hand: TeacherHand, coupling: Coupling) -> Course:
    return course.divided(coupling.velocity_scale, hand.mass_kg + IDEAL.mass_kg)


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
