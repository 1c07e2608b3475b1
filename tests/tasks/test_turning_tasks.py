"""Tasks with an angle: as arcs at a lever they are lengths, and teaching, force estimate and trial run them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interaction import TurningInteractionForce
from comanip.interfaces import Command, Observation
from comanip.people.intent import Course
from comanip.plants.beam import WristSensor
from comanip.plants.rigid import AtLever, RigidPlant, Turning, TurningObject
from comanip.tasks import named, read_task, usual, way
from comanip.teaching import teach
from comanip.trials import draw_case

QUIET = WristSensor(noise_n=0.0, bias_n=0.0, delay_s=0.0)
HELD = TurningObject(mass_kg=6.0, length_m=1.2, width_m=0.5)


def door():
    task = named("door").in_arcs()
    return task, Turning(task.axes, task.levers_m, task.carried.along)


def test_a_task_in_arcs_is_the_same_way_with_angles_at_their_levers():
    for name in ("turn", "door"):
        task = named(name)
        arcs, scale = task.in_arcs(), np.where(np.isnan(task.levers_m), 1.0, task.levers_m)
        times = np.linspace(0.0, 6.0, 50)
        own, other = (way(t, usual(t)).course.sampled(times) for t in (task, arcs))
        np.testing.assert_allclose(other, own * scale, atol=1e-12)
        assert set(arcs.units) == {"m"}
        assert arcs.in_arcs() is arcs
        assert bool(arcs.needs) == (name == "door")
    assert named("lift").in_arcs() is named("lift")


def test_what_an_angle_alone_varies_is_at_its_lever_too():
    turn, arcs = named("turn"), named("turn").in_arcs()
    lever = turn.axes_[0].lever_m
    assert arcs.partners.size_m == pytest.approx(tuple(lever * x for x in turn.partners.size_m))
    assert arcs.lessons.place_sd_m == pytest.approx(lever * turn.lessons.place_sd_m)
    assert arcs.lessons.duration_sd_s == turn.lessons.duration_sd_s
    assert named("door").in_arcs().partners == named("door").partners  # its size is that of the lengths


def test_levers_are_read_and_a_length_has_none(tmp_path):
    text = '[axes.{0}]\nkind = "{1}"\nlever_m = {2}\n[[phases]]\nto = {{ {0} = 0.5 }}\nduration_s = 2.0\n'
    file = tmp_path / "mine.toml"
    file.write_text(text.format("pitch", "angle", 0.4))
    assert read_task(file).levers_m == (0.4,)
    file.write_text(text.format("z", "length", 0.4))
    with pytest.raises(ParameterError, match=r"axes\.z\.lever_m: only an angle has a lever"):
        read_task(file)
    file.write_text(text.format("pitch", "angle", 0.0))
    with pytest.raises(ParameterError, match=r"axes\.pitch\.lever_m: is 0; allowed: > 0"):
        read_task(file)
    two = replace(named("door"), axes_=(*named("door").axes_[:1], *[replace(a, kind="angle") for a in named("door").axes_[1:]]))
    with pytest.raises(ParameterError, match=r"turns the object about more than one axis \(y, yaw\)"):
        two.runnable()


def test_the_way_of_the_grip_is_that_of_a_rigid_object_and_back():
    task, turning = door()
    course = way(task, usual(task)).course
    grip = turning.course(course, 1.2)
    for t in (0.0, 1.3, 2.7, 4.9, 9.0):
        here, there = course.at(t)[0], grip.at(t)[0]
        yaw = here[2] / task.levers_m[2]
        np.testing.assert_allclose(there[:2], here[:2] + 1.2 * np.array([np.cos(yaw) - 1.0, np.sin(yaw)]), atol=1e-4)
        np.testing.assert_allclose(turning.ungripped(there, 1.2), here, atol=1e-3)
    later = turning.course(Course(((0.0, 1.0, (0.0, 0.0, 0.6)),)), 1.2, gone=np.array([0.1, 0.0, 0.6]))
    np.testing.assert_allclose(later.end[:2], 1.2 * np.array([np.cos(1.0) - np.cos(0.5), np.sin(1.0) - np.sin(0.5)]), atol=1e-9)


class Swings:
    def reset(self, position):
        pass

    def force(self, time, position, velocity, out):
        out[:] = min(time, 1.0) * np.array([3.0 * np.sin(3 * time), 2.0 * np.cos(2 * time), 4.0 * np.sin(2 * time)])


def felt(load_of, steps=300):
    """(T, d) estimate and truth of a hand that turns and carries, quietly, seen without noise at 1 kHz."""
    task, turning = door()
    plant = AtLever(RigidPlant(Swings(), turning, held=HELD, sensor=QUIET, dt=0.001, rng=np.random.default_rng(0)))
    estimator = TurningInteractionForce(
        0.001, load_of(turning.load(HELD, 0.5, task.gravity.tolist())), cutoff_hz=40.0, tare_s=0.01
    )
    obs, command, rows = Observation(3), Command(3), []
    plant.reset()
    estimator.reset()
    for n in range(10 * steps):
        plant.read(obs)
        estimator.step(obs)
        rows.append((obs.force.copy(), plant.channels["hand.true_force"][0].copy()))
        t = n * 0.001
        command.velocity[:] = 0.0 if t < 0.1 else np.array([0.2, 0.3, 0.8]) * (1.0 - np.cos(2.0 * (t - 0.1)))
        plant.write(command)
        plant.advance()
    return [np.array(column)[500:] for column in zip(*rows, strict=True)]


def test_the_estimate_on_line_is_what_the_partner_does_beyond_the_load():
    estimate, truth = felt(lambda load: load)
    assert np.abs(truth).max() > 2.5
    np.testing.assert_allclose(estimate[6:], truth[:-6], atol=0.25)  # the filter is 6 ms late


@pytest.mark.parametrize("planted", [{"centre_m": 0.0}, {"carried_kg": (3.0, 3.0, 3.0)}, {"carried_kg": (3.0, 3.0, 0.0)}])
def test_a_load_that_is_not_this_one_is_felt(planted):
    """The planted bugs: no lever of the centre of mass; a mass in place of the inertia; none."""
    estimate, truth = felt(lambda load: replace(load, **planted))
    assert np.abs(estimate[6:] - truth[:-6]).max() > 0.4


def test_a_bias_is_tared_and_a_missing_sample_is_missing():
    task, turning = door()
    estimator = TurningInteractionForce(0.01, turning.load(HELD, 0.5, task.gravity.tolist()))
    obs = Observation(3)
    obs.position[:], obs.velocity[:], obs.sensor_force[:] = 0.0, 0.0, [0.7, -0.4, 0.2]
    estimator.reset()
    for _ in range(60):
        estimator.step(obs)
    np.testing.assert_allclose(obs.force, 0.0, atol=1e-12)
    obs.sensor_force[1] = np.nan
    estimator.step(obs)
    assert np.isnan(obs.force[1])
    assert np.isfinite(obs.force[[0, 2]]).all()


def test_a_lesson_ends_where_it_was_meant_to_and_its_force_is_the_partners():
    (lesson,) = teach("leader", 1, task="turn", rng=np.random.default_rng(3))
    moved = lesson["hand.position"].values
    np.testing.assert_allclose(moved[-1] - moved[0], lesson.metadata["end_m"], atol=0.03)
    apart = lesson["hand.force"].values - lesson["hand.true_force"].values
    assert np.sqrt((apart[200:-200] ** 2).mean()) < 0.35  # noise of the sensor is 0.2 N; the torque's is less, at the lever more
    assert "incomplete" not in lesson.metadata
    assert lesson.metadata["levers_m"]


def test_a_case_asks_the_partner_where_the_grip_is_to_go():
    case = draw_case("follower", np.random.default_rng(4), task="door")
    end, grip = case.course.end, case.at_grip(case.course).end
    yaw = end[2] / case.task.levers_m[2]
    np.testing.assert_allclose(grip[:2], end[:2] + 1.2 * np.array([np.cos(yaw) - 1.0, np.sin(yaw)]), atol=1e-6)
    lift = draw_case("follower", np.random.default_rng(4))
    assert lift.at_grip(lift.course) is lift.course
