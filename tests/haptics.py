"""Handles and hands for tests of teleoperation: a handle that moves by a formula, a hand that goes where it is sent."""

from __future__ import annotations

import numpy as np

from comanip.devices.link import Link, Network
from comanip.devices.phantom import HeldHandle, phantom
from comanip.devices.teacher import Teacher, TeacherHand
from comanip.interfaces import STANDARD_GRAVITY
from comanip.loop import run
from comanip.plants.beam import BeamPlant, WristSensor
from comanip.plants.partners import Arm, HumanLeader, Plan, Unsteadiness
from comanip.skills.passivity import Passive
from comanip.skills.teleoperation import CouplingLimits, Teleoperation

GRIPS = {"light": TeacherHand(0.15, 40.0, 2.0), "normal": TeacherHand(0.5, 100.0, 8.0), "stiff": TeacherHand(0.8, 300.0, 20.0)}


class Scripted:
    """A handle whose velocity is `velocity(t)` [m/s] and whose clutch is `clutch(t)`; `sample(t, v)` is what it says of v."""

    problem = notice = ""

    def __init__(self, velocity, clutch=lambda t: True, sample=lambda t, v: v, start=0.0):
        self.velocity, self.clutch, self.sample, self.start = velocity, clutch, sample, start
        self.channels = {"device.position": (np.zeros(1), "m"), "device.clutch": (np.ones(1), "")}
        self.forces = []
        self.reset()

    def reset(self):
        self.time = 0.0
        self.forces.clear()
        self.channels["device.position"][0][:] = self.start
        self.channels["device.clutch"][0][:] = float(self.clutch(0.0))

    def read(self, out):
        out[:] = self.sample(self.time, self.velocity(self.time))

    def write(self, force, duration, power=0.0):
        self.forces.append(force.copy())
        self.time += duration
        self.channels["device.position"][0][:] += duration * self.velocity(self.time)
        self.channels["device.clutch"][0][:] = float(self.clutch(self.time))


class FreeHand:
    """A plant that obeys at once; its sensor force is `force(t, x)` [N]."""

    axes = ("z",)
    stop_reason = ""
    channels = {}  # noqa: RUF012

    def __init__(self, force=lambda t, x: 0.0, dt=0.001):
        self.force, self.dt = force, dt

    def reset(self):
        self.time = self.x = self.v = 0.0

    def read(self, obs):
        obs.time, obs.position[0], obs.velocity[0] = self.time, self.x, self.v
        obs.sensor_force[0] = self.force(self.time, self.x)

    def write(self, command):
        self.v = float(command.velocity[0])

    def advance(self):
        self.x += self.dt * self.v
        self.time += self.dt


def over(device, network=None, *, seed=0):
    return Link(device, network or Network(), rng=np.random.default_rng(seed))


def driven(device, *, plant=None, duration=3.0, taps=(), **options):
    plant = plant or FreeHand()
    return run(plant, Teleoperation(device, n_axes=1, dt=plant.dt, **options), duration_s=duration, taps=taps)


def pulse(start, end, speed):
    """A velocity of `speed` between two times [s]."""
    return lambda t: speed if start <= t < end else 0.0


class Nudged(HumanLeader):
    """A partner who only holds, and is nudged by 2 N for a tenth of a second."""

    def __init__(self, stiffness, damping, rng):
        steady = Unsteadiness(0.0, 0.0, 0.08, 0.0)
        super().__init__(Plan(lift_m=0.0), Arm(stiffness, damping, unsteadiness=steady), rng=rng)

    def force(self, time, position, velocity, out):
        super().force(time, position, velocity, out)
        if 0.2 <= time < 0.3:
            out += 2.0


def both_hold(gain, delay_s, grip="normal", *, passive=False, stiffness=150.0, damping=22.0, duration=5.0, limits=None):
    """Partner and teacher hold still after one nudge, over a delay of half `delay_s` each way; a Recording.

    Without `limits` the gain is rendered as it is, whatever the delay.
    """
    limits = limits or CouplingLimits(full_feedback_s=9.0, no_feedback_s=10.0)
    rng = np.random.default_rng(0)
    plant = BeamPlant(Nudged(stiffness, damping, rng), dt=0.001, sensor=WristSensor(0.05, 0.0, 0.005), rng=rng)
    static = np.array([-gain * limits.feedback(delay_s) * STANDARD_GRAVITY])
    device = HeldHandle(Teacher(hand=GRIPS[grip], static_force=static, unsteady_n=0.0, rng=rng), phantom())
    link = over(Passive(device) if passive else device, Network(0.5 * delay_s, 0.5 * delay_s))
    return run(plant, Teleoperation(link, n_axes=1, dt=0.001, force_gain=gain, limits=limits), duration_s=duration)


def ripple(recording, last_s=1.5):
    """Rms speed of the hand [m/s] at the end."""
    v = recording["hand.velocity"].values[:, 0]
    return float(np.sqrt((v[-round(last_s / recording.metadata["dt_s"]) :] ** 2).mean()))
