"""The Partner socket: who asks is shown the tilt, by the plant, before each force; and another robot fits into it."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interaction import TaringInteractionForce
from comanip.interfaces import Command, Observation, Partner
from comanip.people.robot import Gripper, RobotPartner
from comanip.plants.beam import Beam, BeamPlant, WristSensor

WEIGHT = (9.80665,)


class Looks:
    """Pushes down by 5 N more than it carries, and keeps what it is shown."""

    def __init__(self):
        self.shown = []

    def reset(self, position):
        self.shown.clear()

    def see(self, tilt, rate):
        self.shown.append((tilt[0], rate[0]))

    def force(self, time, position, velocity, out):
        out[:] = 9.80665 - 5.0


def test_the_beam_shows_its_tilt_before_each_force():
    person = Looks()
    plant = BeamPlant(person, beam=Beam(mass_kg=2.0), sensor=WristSensor(0.0), rng=np.random.default_rng(0))
    command, obs = Command(1), Observation(1)
    for _ in range(100):
        plant.write(command)
        plant.advance()
        plant.read(obs)
    assert len(person.shown) == 1000
    assert person.shown[0] == (0.0, 0.0)
    settled = -5.0 * 0.8 / 2000.0  # moment over the wrist's stiffness: the partner's end is lower
    assert person.shown[-1][0] == pytest.approx(settled, rel=0.01)
    assert plant.channels["beam.tilt"][0][0] == pytest.approx(person.shown[-1][0], rel=0.01)


class Drives:
    """A skill that goes at one speed from 0.5 s on, and keeps the force that it feels."""

    diagnostics, stop_reason, notice = {}, "", ""

    def __init__(self, speed):
        self.speed = speed

    def reset(self, obs):
        self.felt, self.times = [], []

    def step(self, obs, command):
        self.felt.append(float(obs.force[0]))
        self.times.append(obs.time)
        command.velocity[:] = self.speed if obs.time >= 0.5 else 0.0


def robot(speed, **gripper):
    skill = Drives(speed)
    estimator = TaringInteractionForce(0.01, gravity=[-9.80665], cutoff_hz=15.0)
    return skill, RobotPartner(
        skill, estimator, carried_n=WEIGHT, gripper=Gripper(noise_n=0.0, **gripper), rng=np.random.default_rng(0)
    )


@pytest.mark.parametrize("stiffness", [300.0, 4000.0])
def test_another_robot_carries_at_once_and_pulls_as_its_grip_is_stiff(stiffness):
    skill, other = robot(0.05, stiffness_n_per_m=stiffness, damping_ns_per_m=20.0)
    assert isinstance(other, Partner)
    other.reset(np.array([0.85]))
    out, forces = np.zeros(1), []
    for n in range(1000):
        other.force(n * 0.001, np.array([0.85]), np.zeros(1), out)
        forces.append(out[0] - 9.80665)
    assert np.abs(forces[:500]).max() < 1e-9
    lag = 0.02 * 0.05  # the hand is behind its command by lag times speed
    assert forces[-1] == pytest.approx(stiffness * (0.05 * 0.499 - lag) + 20.0 * 0.05, rel=0.02)
    assert skill.times == pytest.approx([0.01 * k for k in range(100)])
    assert max(map(abs, skill.felt[:45])) < 1e-6
    assert skill.felt[-1] == pytest.approx(-forces[-1], rel=0.1)  # what it feels is the object that holds it back


def test_two_runs_from_a_reset_are_equal():
    runs = []
    _, other = robot(0.05)
    for _ in range(2):
        other.reset(np.array([0.85]))
        out = np.zeros(1)
        runs.append([float(other.force(n * 0.001, np.array([0.85]), np.zeros(1), out) or out[0]) for n in range(800)])
    assert runs[0] == runs[1]


def test_a_gripper_without_stiffness_is_refused():
    with pytest.raises(ParameterError, match="a gripper's stiffness_n_per_m must be positive; got 0"):
        Gripper(stiffness_n_per_m=0.0)
