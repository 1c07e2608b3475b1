"""Handles and hands for tests of teleoperation: a handle that moves by a formula, a hand that goes where it is sent."""

from __future__ import annotations

import numpy as np

from comanip.devices.link import Link, Network
from comanip.experiments.stability_map import both_hold, ripple
from comanip.loop import run
from comanip.skills.teleoperation import Teleoperation

__all__ = ["FreeHand", "Scripted", "both_hold", "driven", "over", "pulse", "ripple"]


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
