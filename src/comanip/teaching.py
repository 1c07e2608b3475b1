"""Lessons: a teacher moves the robot through a haptic handle while a partner holds the other end of the beam.

The paper's two sets (section II-A): robot as follower (teacher blind, partner leads) and robot as leader (teacher leads,
partner blind). Each lesson draws its lift, duration, onset and the day's arms from stated distributions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from .devices.teacher import SimulatedTeacher, TeacherHand, TeacherPlan, TeacherYielding
from .errors import ParameterError
from .interfaces import STANDARD_GRAVITY
from .loop import run
from .plants.beam import Beam, BeamPlant, WristSensor
from .plants.partners import Arm, HumanFollower, HumanLeader, Plan, Yielding, dyad
from .recording import Recording
from .skills.teleoperation import Teleoperation

ROLES = ("leader", "follower")


@dataclass(frozen=True)
class Habits:
    """Distributions that lessons are drawn from: (mean, standard deviation), or (low, high) for onset."""

    lift_m: tuple[float, float] = (0.30, 0.025)
    duration_s: tuple[float, float] = (2.2, 0.25)
    shortest_s: float = 1.8
    onset_s: tuple[float, float] = (0.4, 1.2)
    after_s: float = 1.0  # how long both hold still at the top
    start_m: tuple[float, float] = (0.85, 0.0)
    leading_arm: Arm = field(default_factory=lambda: Arm(120.0, 20.0))
    following_arm: Arm = field(default_factory=lambda: Arm(90.0, 22.0))
    yielding: Yielding = field(default_factory=Yielding)
    teacher_dead_zone_n: float = 2.0  # F that a following teacher does not answer


@dataclass(frozen=True)
class Coupling:
    """Eqs. (1), (2): what the haptic side is set to."""

    force_gain: float = 0.15
    velocity_scale: float = 1.3
    device_period_s: float = 0.001


def teach(
    role: str,
    lessons: int = 5,
    *,
    rng: np.random.Generator,
    habits: Habits = Habits(),
    beam: Beam = Beam(),
    sensor: WristSensor = WristSensor(),
    coupling: Coupling = Coupling(),
    progress: Callable[[int, int], None] | None = None,
) -> list[Recording]:
    """`lessons` Recordings of the robot in `role` ("leader" or "follower"), at the device's 1 kHz, vertical axis.

    The recordings hold raw sensor force; the interaction force of eq. (3) is computed when they become demonstrations.
    """
    if role not in ROLES:
        raise ParameterError(f"role {role!r} is unknown; roles are: {', '.join(ROLES)}")
    recordings = []
    for number in range(lessons):
        recordings.append(_lesson(role, number, rng, habits, beam, sensor, coupling))
        if progress is not None:
            progress(number + 1, lessons)
    return recordings


def _lesson(
    role: str,
    number: int,
    rng: np.random.Generator,
    habits: Habits,
    beam: Beam,
    sensor: WristSensor,
    coupling: Coupling,
) -> Recording:
    lift = float(rng.normal(*habits.lift_m))
    duration = max(habits.shortest_s, float(rng.normal(*habits.duration_s)))
    onset = float(rng.uniform(*habits.onset_s))
    start = np.array([rng.normal(*habits.start_m)])
    gain, scale = coupling.force_gain, coupling.velocity_scale
    share = 0.5 * beam.mass_kg
    static = np.array([-gain * share * STANDARD_GRAVITY])
    partner: HumanLeader | HumanFollower
    if role == "follower":
        arm = replace(dyad(rng, habits.leading_arm), carried_n=share * STANDARD_GRAVITY)
        partner = HumanLeader(Plan(lift, duration, onset, feedforward_kg=share), arm, rng=rng)
        teacher = SimulatedTeacher(
            yielding=TeacherYielding(damping_ns_per_m=40.0 * scale * gain, dead_zone_n=habits.teacher_dead_zone_n * gain),
            hand=TeacherHand(stiffness_n_per_m=90.0),
            static_force=static,
            rng=rng,
        )
    else:
        arm = replace(dyad(rng, habits.following_arm), carried_n=share * STANDARD_GRAVITY)
        partner = HumanFollower(habits.yielding, arm, rng=rng)
        teacher = SimulatedTeacher(plan=TeacherPlan(lift / scale, duration, onset), static_force=static, rng=rng)
    dt = coupling.device_period_s
    plant = BeamPlant(partner, beam=beam, sensor=sensor, dt=dt, start_position=start, rng=rng)
    teleoperation = Teleoperation(teacher, n_axes=1, dt=dt, force_gain=gain, velocity_scale=scale)
    metadata = {
        "role": role,
        "task": "lift",
        "lesson": number,
        "load_mass_kg": beam.mass_kg,
        "load_share": 0.5,
        "lift_m": lift,
        "duration_s": duration,
        "onset_s": onset,
        "coupling": asdict(coupling),
    }
    return run(plant, teleoperation, duration_s=onset + duration + habits.after_s, metadata=metadata)
