"""The exact turning object: against the beam where angles are small, against Newton and Euler where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.people.intent import Course
from comanip.people.partners import Arm, HumanLeader, Unsteadiness
from comanip.plants.beam import Beam, BeamPlant, WristSensor
from comanip.plants.rigid import AtLever, RigidPlant, Turning, TurningObject

NAN = float("nan")
STILL = WristSensor(noise_n=0.0, bias_n=0.0, delay_s=0.0)
DOOR = Turning(("x", "y", "yaw"), (NAN, NAN, 0.7), "x", hands_m=0.3)


class Pushes:
    """A partner who exerts a stated force (d,), the last at the lever."""

    def __init__(self, force):
        self.value, self.seen = np.array(force, dtype=float), []

    def reset(self, position):
        self.seen = [position.copy()]

    def force(self, time, position, velocity, out):
        self.seen.append(position.copy())
        out[:] = self.value if not callable(self.value) else self.value(time)


def run(plant, seconds, velocity=None):
    """(T, d) positions, velocities and sensor forces under a velocity command, a function of time."""
    d = len(plant.axes)
    obs, command, rows = Observation(d), Command(d), []
    plant.reset()
    for n in range(round(seconds / plant.dt)):
        plant.read(obs)
        rows.append(
            (obs.position.copy(), obs.velocity.copy(), obs.sensor_force.copy(), plant.channels["hand.true_force"][0].copy())
        )
        command.velocity[:] = 0.0 if velocity is None else velocity(n * plant.dt)
        plant.write(command)
        plant.advance()
    return [np.array(column) for column in zip(*rows, strict=True)]


def made(partner, turning=DOOR, **about):
    return RigidPlant(partner, turning, sensor=STILL, rng=np.random.default_rng(0), dt=0.001, **about)


def test_at_small_angles_it_is_the_beam():
    """Across the object, hand still: force and tilt as on the exact beam of the same inertia, stiffness and damping."""
    held = TurningObject(mass_kg=2.0, length_m=0.8, width_m=1e-6)
    plant = made(Pushes([0.0, 5.0, 0.0]), held=held)
    beam = Beam(wrist_damping_nms_per_rad=plant._damping)
    other = BeamPlant(Pushes([5.0]), beam=beam, sensor=STILL, axes=("y",), dt=0.001, rng=np.random.default_rng(0))
    one, two = run(plant, 0.5), run(other, 0.5)
    np.testing.assert_allclose(one[2][:, 1], two[2][:, 0], atol=1e-3)
    assert plant.channels["beam.tilt"][0][2] == pytest.approx(other.channels["beam.tilt"][0][0], rel=1e-4)
    assert one[3][-1, 1] == pytest.approx(5.0, abs=0.02)  # all of it is interaction: nothing is carried in a level plane
    assert one[2][-1, 2] == pytest.approx(5.0 * 0.8, rel=0.01)  # and at rest the torque is force times lever


def test_newton_and_euler_hold_at_any_angle():
    """Far turned, while hand and wrist move: forces add up to m a_c, moments about the hand to the change of spin."""
    turning = lambda t: np.array([0.3 * np.sin(2 * t), 0.2 * np.cos(3 * t), 1.2])  # noqa: E731
    partner = Pushes([1.0, -2.0, 0.4])
    plant = made(partner, start_position=np.array([0.1, -0.2, 0.5]))
    obs, command = Observation(3), Command(3)
    plant.reset()
    held, spin = plant.held, plant.held.across_kg_m2
    momentum, moments, forces = [], [], []
    for n in range(1500):
        command.velocity[:] = turning(n * plant.dt)
        plant.write(command)
        plant.advance()
        plant.read(obs)
        phi = plant._turned()
        rate = plant._v[2] + plant._twist_rate
        side, arm = np.array([-np.sin(phi), np.cos(phi)]), np.array([np.cos(phi), np.sin(phi)])
        centre, speed = np.array(plant._x[:2]) + 0.4 * arm, np.array(plant._v[:2]) + 0.4 * rate * side
        momentum.append([*(held.mass_kg * speed), spin * rate + held.mass_kg * (centre[0] * speed[1] - centre[1] * speed[0])])
        at = np.array(plant._x[:2])
        grip = at + held.length_m * arm
        push, hand = partner.value[:2], -obs.sensor_force[:2]
        forces.append(push + hand)
        moments.append(
            grip[0] * push[1]
            - grip[1] * push[0]
            + 0.3 * partner.value[2]
            + at[0] * hand[1]
            - at[1] * hand[0]
            - obs.sensor_force[2]
        )
    momentum = np.array(momentum)
    change = np.diff(momentum, axis=0) / plant.dt
    # over a whole second, as a sensor's impulse: the sub-step's own error is of first order
    np.testing.assert_allclose(np.array(forces)[1:].sum(axis=0) * plant.dt, momentum[-1, :2] - momentum[0, :2], atol=0.02)
    assert np.sum(moments[1:]) * plant.dt == pytest.approx(momentum[-1, 2] - momentum[0, 2], abs=0.02)
    assert np.abs(change[:, 2]).max() > 0.5
    assert abs(plant._turned()) > 1.5


def test_halving_the_step_halves_the_error():
    def ends(substep_s):
        plant = RigidPlant(
            Pushes([2.0, 3.0, 1.0]), DOOR, sensor=STILL, dt=0.01, substep_s=substep_s, rng=np.random.default_rng(0),
            held=TurningObject(wrist_stiffness_nm_per_rad=60.0),
        )  # fmt: skip
        run(plant, 1.0, lambda t: np.array([0.2, 0.3 * np.sin(4 * t), 1.0]))
        return np.array([plant._twist, plant._twist_rate])

    exact = ends(4e-5)
    coarse, fine = (np.abs(ends(h) - exact).max() for h in (1e-3, 5e-4))
    assert 1.6 < coarse / fine < 2.5


def test_a_hand_that_carries_feels_nothing_beyond_the_load():
    """A partner who exerts its share of what the motion takes gives F = T = 0; here there is no motion, in any plane."""
    tilt = Turning(("z", "pitch"), (NAN, 0.7), "x")
    weight = 0.5 * 2.0 * 9.80665
    plant = made(Pushes([weight, 0.0]), tilt, gravity=(-9.80665, 0.0))
    _, _, sensed, true = run(plant, 0.3)
    np.testing.assert_allclose(sensed[:, 0], -weight, atol=1e-6)
    np.testing.assert_allclose(true, 0.0, atol=1e-6)


def test_a_roll_turns_by_torque_alone():
    roll = Turning(("roll",), (0.25,))
    plant = made(Pushes([4.0]), roll)
    x, _, sensed, true = run(plant, 0.5, lambda t: np.array([0.8]))
    assert x[-1, 0] == pytest.approx(0.8 * (0.5 - 0.02), abs=2e-3)
    assert sensed[-1, 0] == pytest.approx(4.0 * 0.25, rel=1e-3)  # N m
    assert true[-1, 0] == pytest.approx(1.0, rel=1e-3)
    assert plant.units == ("rad",)


def test_where_the_partner_takes_hold_is_where_its_way_begins_and_leads():
    """`gripped` is the motion of the grip of an object that the hand turns by that much."""
    turned = np.array([0.3, 0.1, 1.1])
    found = DOOR.gripped(turned, 1.2)
    np.testing.assert_allclose(found, [0.3 + 1.2 * (np.cos(1.1) - 1.0), 0.1 + 1.2 * np.sin(1.1), 0.3 * 1.1])
    partner = Pushes([0.0, 0.0, 0.0])
    plant = made(partner, held=TurningObject(length_m=1.2), start_position=np.array([0.5, 0.2, 0.3]))
    run(plant, 1.0, lambda t: np.array([0.3, 0.1, 1.1]) / 0.98)
    np.testing.assert_allclose(partner.seen[0], [0.5, 0.2, 0.0])
    np.testing.assert_allclose(partner.seen[-1] - partner.seen[0], found, atol=5e-3)


def test_at_the_lever_power_is_the_same():
    one, two = made(Pushes([1.0, 2.0, 1.5])), AtLever(made(Pushes([1.0, 2.0, 1.5])))
    lever = np.array([1.0, 1.0, 0.7])
    a = run(one, 0.4, lambda t: np.array([0.2, 0.1, 0.9]))
    b = run(two, 0.4, lambda t: np.array([0.2, 0.1, 0.9]) * lever)
    np.testing.assert_allclose(b[0], a[0] * lever, atol=1e-12)
    np.testing.assert_allclose((b[1] * b[2]).sum(axis=1), (a[1] * a[2]).sum(axis=1), atol=1e-12)
    np.testing.assert_allclose((b[1] * b[3]).sum(axis=1), (a[1] * a[3]).sum(axis=1), atol=1e-12)


def test_two_runs_from_the_same_reset_are_equal():
    course = Course(((0.1, 1.0, (0.1, 0.2, 0.3)),))
    arm = Arm(200.0, 25.0, 0.0, Unsteadiness())
    rows = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        person = HumanLeader(course, arm, axes=DOOR.axes, carried=(0.0,) * 3, rng=rng)
        rows.append(run(RigidPlant(person, DOOR, rng=rng), 0.5)[2])
    np.testing.assert_array_equal(*rows)
    assert np.abs(rows[0]).max() > 0.1


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Turning(("x", "y"), (NAN, NAN)), "turns about one axis; got none of x, y"),
        (lambda: Turning(("a", "b"), (0.2, 0.3)), "turns about one axis; got a, b"),
        (lambda: Turning(("x", "yaw"), (NAN,)), r"levers_m has 1 entries; allowed: 2"),
        (lambda: TurningObject(length_m=0.0), "length_m must be positive; got 0"),
        (lambda: made(Pushes([0, 0, 0]), gravity=(0.0, 0.0, 1.0)), "no part along an angle"),
        (lambda: made(Pushes([0, 0, 0]), start_position=np.zeros(2)), "start_position needs 3 finite values"),
    ],
)
def test_what_cannot_be_is_refused(wrong, message):
    with pytest.raises(ParameterError, match=message):
        wrong()
