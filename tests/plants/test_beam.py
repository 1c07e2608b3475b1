"""The beam against its own equations, energy and statics, and against a plain numerical integration."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import STANDARD_GRAVITY, Command, Observation
from comanip.people.partners import Arm, HumanFollower, HumanLeader, Plan, Unsteadiness, minimum_jerk
from comanip.plants.beam import Beam, BeamPlant, WristSensor
from comanip.signals.second_order import second_order_step

QUIET = WristSensor(noise_n=0.0, bias_n=0.0, delay_s=0.0)
STEADY = Unsteadiness(0.0, 0.0, 0.08, 0.0)


class Holding:
    """A partner who carries his share and pulls by a fixed extra force."""

    def __init__(self, extra, share=0.5 * 2.0 * STANDARD_GRAVITY, axes=("z",)):
        self.pull = np.array([share + extra if a == "z" else extra for a in axes])

    def reset(self, position):
        pass

    def force(self, time, position, velocity, out):
        out[:] = self.pull


def driven(plant, velocity_of, seconds):
    obs, command = Observation(len(plant.axes)), Command(len(plant.axes))
    plant.reset()
    rows = []
    for _ in range(round(seconds / plant.dt)):
        plant.read(obs)
        command.velocity[:] = velocity_of(obs)
        plant.write(command)
        rows.append((obs.time, obs.position[0], obs.velocity[0], obs.sensor_force[0], plant.channels["beam.tilt"][0][0]))
        plant.advance()
    return np.array(rows)


@pytest.mark.parametrize(("k", "c"), [(4700.0, 68.0), (100.0, 30.0), (0.0, 3.0), (9.0, 6.0), (50.0, 0.0), (0.0, 0.0)])
def test_an_exact_step_solves_its_equation(k, c):
    h, u, y, v = 0.01, 3.0, 0.2, -0.4
    one = second_order_step(k, c, h)
    exact = one.yy * y + one.yv * v + one.yu * u, one.vy * y + one.vv * v + one.vu * u
    n = 20_000
    for _ in range(n):  # symplectic Euler, step 5e-7 s
        v += h / n * (u - k * y - c * v)
        y += h / n * v
    assert exact == pytest.approx((y, v), rel=1e-4, abs=2e-5)


def test_two_steps_are_one_step_of_twice_the_length():
    a, b = second_order_step(300.0, 5.0, 0.004), second_order_step(300.0, 5.0, 0.008)
    y = a.yy * 0.1 + a.yv * 0.2 + a.yu * 1.5
    v = a.vy * 0.1 + a.vv * 0.2 + a.vu * 1.5
    assert a.yy * y + a.yv * v + a.yu * 1.5 == pytest.approx(b.yy * 0.1 + b.yv * 0.2 + b.yu * 1.5, rel=1e-12)


def test_at_rest_the_hand_feels_half_the_weight():
    rows = driven(BeamPlant(Holding(0.0), sensor=QUIET, rng=np.random.default_rng(0)), lambda obs: 0.0, 1.0)
    assert rows[:, 3] == pytest.approx(-0.5 * 2.0 * STANDARD_GRAVITY)
    assert rows[:, 4] == pytest.approx(0.0)


def test_a_lifting_partner_tilts_the_beam_and_gives_positive_interaction_force():
    beam = Beam()
    rows = driven(BeamPlant(Holding(5.0), sensor=QUIET, rng=np.random.default_rng(0)), lambda obs: 0.0, 2.0)
    assert rows[-1, 4] == pytest.approx(5.0 * beam.length_m / beam.wrist_stiffness_nm_per_rad, rel=1e-6)
    interaction = rows[-1, 3] + 0.5 * beam.mass_kg * STANDARD_GRAVITY  # eq. (3) at rest
    assert interaction == pytest.approx(5.0, rel=1e-6)
    assert interaction == pytest.approx(beam.wrist_stiffness_nm_per_rad * rows[-1, 4] / beam.length_m, rel=1e-6)


def test_a_soft_wrist_lets_the_interaction_force_vanish_and_the_beam_fall():
    soft = Beam(wrist_stiffness_nm_per_rad=20.0, wrist_damping_nms_per_rad=10.0)
    rows = driven(BeamPlant(Holding(5.0), beam=soft, sensor=QUIET, rng=np.random.default_rng(0)), lambda obs: 0.0, 0.3)
    assert abs(np.degrees(rows[-1, 4])) > 3.0


def test_energy_balance_of_a_shaken_beam():
    """Work of both hands = potential + kinetic energy + what the wrist's spring stores and its damper eats."""
    beam, dt = Beam(wrist_damping_nms_per_rad=0.0), 0.001
    plant = BeamPlant(Holding(3.0), beam=beam, sensor=QUIET, dt=dt, substep_s=0.0001, rng=np.random.default_rng(0))
    obs, command = Observation(1), Command(1)
    plant.reset()
    axis = plant._state[0]
    work = 0.0
    for n in range(2000):
        plant.read(obs)
        command.velocity[:] = 0.2 * np.sin(2 * np.pi * n * dt)
        plant.write(command)
        before = (axis.position, axis.tilt)
        force, moment = axis.sensor_force, beam.wrist_stiffness_nm_per_rad * axis.tilt
        plant.advance()
        force, moment = 0.5 * (force + axis.sensor_force), 0.5 * (moment + beam.wrist_stiffness_nm_per_rad * axis.tilt)
        rise, turn = axis.position - before[0], axis.tilt - before[1]
        partner = Holding(3.0).pull[0]
        work += -force * rise + partner * (rise + beam.length_m * turn) - moment * turn
    centre_speed = axis.velocity + 0.5 * beam.length_m * axis.tilt_rate
    kinetic = 0.5 * beam.mass_kg * centre_speed**2 + beam.mass_kg * beam.length_m**2 / 24.0 * axis.tilt_rate**2
    potential = beam.mass_kg * STANDARD_GRAVITY * (axis.position + 0.5 * beam.length_m * axis.tilt)
    assert work == pytest.approx(kinetic + potential, abs=0.02)


def test_physics_does_not_depend_on_the_substep():
    ends = [
        driven(
            BeamPlant(
                HumanLeader(
                    Plan(onset_s=0.1, duration_s=1.0), Arm(unsteadiness=STEADY), rng=np.random.default_rng(0), substep_s=h
                ),
                sensor=QUIET,
                substep_s=h,
                rng=np.random.default_rng(0),
            ),
            lambda obs: 0.3 * np.sin(obs.time) ** 2,
            1.5,
        )[-1, [1, 3, 4]]
        for h in (0.001, 0.00025)
    ]
    assert ends[0] == pytest.approx(ends[1], rel=0.02)


def test_along_the_beam_force_arrives_whole_and_nothing_tilts():
    plant = BeamPlant(Holding(4.0, axes=("x",)), axes=("x",), sensor=QUIET, rng=np.random.default_rng(0))
    rows = driven(plant, lambda obs: 0.0, 0.5)
    assert rows[-1, 3] == pytest.approx(4.0)
    assert rows[:, 4] == pytest.approx(0.0)


def test_three_axes_are_three_single_axes():
    plant = BeamPlant(Holding(2.0, axes=("x", "y", "z")), axes=("x", "y", "z"), sensor=QUIET, rng=np.random.default_rng(0))
    obs, command = Observation(3), Command(3)
    for _ in range(100):
        plant.read(obs)
        plant.write(command)
        plant.advance()
    plant.read(obs)
    assert obs.sensor_force == pytest.approx([2.0, 2.0, 2.0 - 0.5 * 2.0 * STANDARD_GRAVITY], abs=0.05)


def test_sensor_bias_noise_and_delay_are_what_was_asked():
    plant = BeamPlant(Holding(0.0), sensor=WristSensor(0.3, 1.5, 0.0), rng=np.random.default_rng(1))
    felt = driven(plant, lambda obs: 0.0, 20.0)[:, 3]
    assert felt.mean() == pytest.approx(1.5 - STANDARD_GRAVITY, abs=0.03)
    assert felt.std() == pytest.approx(0.3, rel=0.1)
    paths = [
        driven(BeamPlant(Holding(0.0), sensor=WristSensor(0.0, 0.0, late), dt=0.001, rng=np.random.default_rng(0)),
               lambda obs: 0.1 * (obs.time > 0.1), 0.4)[:, 3]
        for late in (0.0, 0.02)
    ]  # fmt: skip
    assert paths[1][20:] == pytest.approx(paths[0][:-20], abs=1e-9)


def test_two_runs_from_one_seed_are_equal_and_resets_forget():
    def path(plant):
        return driven(plant, lambda obs: 0.01 * obs.sensor_force[0] + 0.1, 1.0)

    def build():
        rng = np.random.default_rng(5)
        return BeamPlant(HumanFollower(rng=rng), rng=rng)

    assert (path(build()) == path(build())).all()


def test_a_human_leader_ends_where_he_meant_to_and_a_follower_goes_where_he_is_led():
    rng = np.random.default_rng(2)
    leader = HumanLeader(Plan(0.25, 1.5, 0.2), Arm(unsteadiness=STEADY), rng=rng)
    speed = np.zeros(1)

    def admittance(obs):
        speed[:] += 0.01 * (obs.sensor_force + STANDARD_GRAVITY - 10.0 * speed) / 5.0
        return speed

    rows = driven(BeamPlant(leader, sensor=QUIET, rng=rng), admittance, 6.0)
    assert rows[-1, 1] == pytest.approx(0.25, abs=0.01)
    follower = HumanFollower(arm=Arm(90.0, 22.0, unsteadiness=STEADY), rng=rng)
    plant = BeamPlant(follower, sensor=QUIET, rng=rng)
    rows = driven(plant, lambda obs: 0.3 * minimum_jerk(obs.time / 2.0)[1] / 2.0, 5.0)
    felt = rows[:, 3] + 0.5 * 2.0 * STANDARD_GRAVITY
    assert felt[50:120].mean() < -1.0  # he hangs back while led up: the hand feels him below
    assert abs(felt[-20:].mean()) < 2.0


def test_impossible_parameters_are_named():
    with pytest.raises(ParameterError, match="mass_kg must be positive"):
        Beam(mass_kg=0.0)
    with pytest.raises(ParameterError, match="start_position needs 1 values"):
        BeamPlant(Holding(0.0), start_position=np.zeros(2), rng=np.random.default_rng(0))
    with pytest.raises(ParameterError, match="stiffness > 0"):
        Arm(stiffness_n_per_m=-1.0)
