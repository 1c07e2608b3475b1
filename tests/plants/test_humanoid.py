"""The humanoid against statics, Newton and its sibling the beam; what it refuses, and how it ends when things go wrong."""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comanip.commands.app import main
from comanip.errors import ParameterError
from comanip.formats import read
from comanip.interfaces import STANDARD_GRAVITY
from comanip.loop import run
from comanip.people.partners import Arm, HumanLeader, Plan, minimum_jerk
from comanip.plants import makers
from comanip.plants.beam import BeamPlant, WristSensor
from comanip.plants.humanoid import load_robot
from comanip.plants.humanoid.self_collision import SelfCollision
from humanoids import HALF, QUIET, Follows, Pulling, lift, plant_of, still

mujoco = pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")


@pytest.fixture(scope="module")
def lifted():
    """The whole lift with a partner who carries exactly half."""
    plant = plant_of()
    return plant, run(plant, Follows(lift), duration_s=3.0)


def test_at_rest_it_stands_still_and_the_hand_feels_half_the_beam():
    recording = run(plant_of(), Follows(still), duration_s=1.0)
    assert recording["hand.position"].values[:, 0] == pytest.approx(0.85, abs=3e-4)
    assert recording["hand.sensor_force"].values[:, 0] == pytest.approx(-HALF, abs=0.05)
    assert recording["hand.true_force"].values[1:, 0] == pytest.approx(0.0, abs=0.05)
    assert np.degrees(np.abs(recording["beam.tilt"].values).max()) < 0.05
    assert recording.metadata["stop_reason"] == "duration"


def test_a_lift_keeps_the_beam_level_the_robot_upright_and_every_limit(lifted):
    plant, recording = lifted
    rise = recording["hand.position"].values[:, 0] - recording["hand.position"].values[0, 0]
    assert rise[-1] == pytest.approx(0.38, abs=2e-3)
    assert np.degrees(np.abs(recording["beam.tilt"].values).max()) < 2.0
    assert (recording["robot.limits"].values == 0).all()
    base = recording["robot.base"].values
    assert np.abs(base[:, :3] - base[0, :3]).max() < 0.005
    assert recording["robot.joints"].axes == plant.scene.joints


def test_the_hand_lags_its_command_like_the_beam_plant(lifted):
    paths = [lifted[1]["hand.velocity"].values[:, 0]]
    beam = BeamPlant(Pulling(), sensor=QUIET, rng=np.random.default_rng(0))
    paths.append(run(beam, Follows(lift), duration_s=3.0)["hand.velocity"].values[:, 0])
    assert np.abs(paths[0] - paths[1]).max() < 0.005


def test_joints_follow_their_reference(lifted):
    recording = lifted[1]
    apart = recording["robot.joints"].values - recording["robot.joint_reference"].values
    assert np.degrees(np.abs(apart).max()) < 0.3


def test_the_partner_lifts_and_the_force_is_positive():
    plant = plant_of(Pulling(lambda t: 6.0 * minimum_jerk(t - 0.2)[0]))
    recording = run(plant, Follows(still), duration_s=2.0)
    true, tilt = recording["hand.true_force"].values[-20:, 0], recording["beam.tilt"].values[-20:, 0]
    assert true == pytest.approx(6.0, abs=0.05)
    assert recording["hand.sensor_force"].values[-20:, 0] + HALF == pytest.approx(true, abs=0.05)  # eq. (3) at rest
    assert (tilt > 0).all()


def test_the_partner_pulls_at_the_far_handle():
    """Statics: 6 N at the handle is a moment of 6 N times its distance from each pitch axis of the arm."""
    plant = plant_of(Pulling(lambda t: 6.0 * minimum_jerk(t - 0.2)[0]))
    torque = run(plant, Follows(still), duration_s=2.0)["robot.torque"]
    wrist = torque.values[:, torque.axes.index("RARM5")]
    assert wrist[-20:].mean() - wrist[0] == pytest.approx(6.0 * (0.8 + 0.17), rel=0.01)


def test_truth_is_half_the_difference_of_the_two_pulls(lifted):
    """From what the hand does to the beam (the sensor's path) comes the same F as from the partner and the beam's momentum."""
    recording = lifted[1]
    of_sensor = recording["hand.sensor_force"].values + 1.0 * (recording["hand.acceleration"].values + STANDARD_GRAVITY)
    assert of_sensor == pytest.approx(recording["hand.true_force"].values, abs=0.05)
    assert np.abs(recording["hand.true_force"].values).max() > 0.3  # there was something to agree about


def test_its_channels_are_those_of_the_beam_and_more(lifted):
    beam = BeamPlant(Pulling(), rng=np.random.default_rng(0))
    ours = {name: unit for name, (_, unit) in lifted[0].channels.items()}
    assert {name: unit for name, (_, unit) in beam.channels.items()}.items() <= ours.items()


def test_two_runs_from_one_seed_are_equal_and_resets_forget():
    def partner(rng):
        return HumanLeader(Plan(0.1, 1.0, 0.1), Arm(), rng=rng)

    def path(plant, seed):
        return run(plant, Follows(lambda t: lift(t, 0.1, 1.0)), duration_s=0.6)["hand.sensor_force"].values

    fresh = [path(plant_of(partner(rng), sensor=WristSensor(), rng=rng), 3) for rng in map(np.random.default_rng, (3, 3))]
    assert (fresh[0] == fresh[1]).all()
    plant = plant_of()
    once, again = path(plant, 0), path(plant, 0)
    assert (once == again).all()


def test_a_stance_that_is_remembered_is_the_one_that_was_taken_for_this_start_and_this_load():
    def resting(height, mass):
        plant = plant_of(start_position=np.array([height]), load_mass_kg=mass)
        return plant._data.qpos.copy(), plant._data.site_xpos[plant.scene.grasp_site][2]

    wanted = [(0.85, 2.0), (1.0, 2.0), (0.85, 3.0), (0.85, 2.0), (1.0, 2.0)]
    found = [resting(*each) for each in wanted]
    for (height, _), (_, reached) in zip(wanted, found, strict=True):
        assert reached == pytest.approx(height, abs=3e-4)
    assert (found[0][0] == found[3][0]).all()
    assert (found[1][0] == found[4][0]).all()
    assert not np.array_equal(found[0][0], found[2][0])


def test_bias_noise_and_delay_are_what_was_asked():
    felt = run(plant_of(sensor=WristSensor(0.3, 1.5, 0.0)), Follows(still), duration_s=6.0)["hand.sensor_force"].values
    assert felt.mean() == pytest.approx(1.5 - HALF, abs=0.05)
    assert felt.std() == pytest.approx(0.3, rel=0.15)
    jolt = Follows(lambda t: 0.1 * (t > 0.05))
    now, late = (
        run(plant_of(sensor=WristSensor(0.0, 0.0, s)), jolt, duration_s=0.3)["hand.sensor_force"].values for s in (0.0, 0.02)
    )
    assert late[2:] == pytest.approx(now[:-2], abs=0.005)  # turned into the world by the present attitude
    assert np.ptp(now) > 0.5


def test_three_axes_move_apart_from_each_other():
    axes = ("x", "y", "z")
    plant = plant_of(axes=axes)
    speed = np.array([0.03, -0.04, 0.10])
    recording = run(plant, Follows(lambda t: speed * minimum_jerk(t)[1] / 1.875), duration_s=1.4)
    moved = recording["hand.position"].values[-1] - recording["hand.position"].values[0]
    assert moved == pytest.approx(speed / 1.875, abs=1.5e-3)
    assert recording["hand.sensor_force"].values[-1] == pytest.approx([0.0, 0.0, -HALF], abs=0.1)
    assert np.degrees(np.abs(recording["beam.tilt"].values).max()) < 0.5


def test_a_haptic_period_of_a_millisecond_gives_the_same_motion():
    ends = [run(plant_of(dt=dt), Follows(lift), duration_s=1.0)["hand.position"].values[-1, 0] for dt in (0.01, 0.001)]
    assert ends[0] == pytest.approx(ends[1], abs=0.005)


def test_a_partner_without_a_number_ends_the_run_and_keeps_the_recording():
    recording = run(plant_of(Pulling(lambda t: np.nan if t > 0.3 else 0.0)), Follows(still), duration_s=2.0)
    assert "BADQACC" in recording.metadata["stop_reason"] or "not finite" in recording.metadata["stop_reason"]
    assert 0.25 < recording.duration_s < 0.4
    assert np.isfinite(recording["hand.position"].values[:-1]).all()


def test_a_lesson_that_ends_so_is_kept_in_its_file_with_the_reason(tmp_path, monkeypatch, capsys):
    """Through the command line, and the lessons after it are still recorded."""

    class Lost:
        def __init__(self, partner, number):
            self.partner, self.number = partner, number

        def reset(self, position):
            self.partner.reset(position)

        def force(self, time, position, velocity, out):
            self.partner.force(time, position, velocity, out)
            if self.number == 1 and time > 1.0:
                out[:] = np.nan

    numbers = itertools.count()
    humanoid = makers.humanoid_plant
    monkeypatch.setattr(
        makers, "humanoid_plant", lambda partner, *, task, **rest: humanoid(Lost(partner, next(numbers)), task=task, **rest)
    )
    words = "comanip teach --plant humanoid --role leader --lessons 3 -o".split()
    monkeypatch.setattr(sys, "argv", [*words, str(tmp_path), "--json"])
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # `main` has its own
    warnings.simplefilter("always")
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    said = capsys.readouterr()
    files = [Path(f) for f in json.loads(said.out)["files"]]
    taken = [read(f)[0] for f in files]
    assert "incomplete" not in taken[0].metadata
    assert "incomplete" not in taken[2].metadata
    assert re.search(r"BADQACC|not finite", taken[1].metadata["incomplete"])
    assert taken[1].metadata["incomplete"] in said.err
    assert taken[1].duration_s == pytest.approx(1.0, abs=0.01)
    assert np.isfinite(taken[1]["hand.position"].values[:-6]).all()
    assert np.isfinite(taken[1]["hand.sensor_force"].values[:900]).all()


@pytest.mark.parametrize(("axis", "force"), [("x", 120.0), ("y", 80.0), ("z", -120.0)])
def test_a_robot_that_is_pushed_over_says_so(axis, force):
    partner = Pulling(lambda t: force * (t > 0.2), axes=(axis,))
    recording = run(plant_of(partner, axes=(axis,)), Follows(still), duration_s=6.0)
    assert "fell" in recording.metadata["stop_reason"]
    assert recording.duration_s < 5.0


def test_a_pull_that_drives_the_beam_into_the_leg_says_so_before_the_fall():
    recording = run(plant_of(Pulling(lambda t: -400.0 * (t > 0.2))), Follows(still), duration_s=6.0)
    assert "beam touches RLEG2" in recording.metadata["stop_reason"]
    assert recording.duration_s < 0.5


def test_an_arm_that_bends_into_the_body_ends_the_run_and_names_the_links(tmp_path):
    """Its own joint ranges keep this robot from it; with a looser shoulder, moving the hand left brings the elbow to the hip."""
    ours = load_robot()
    loose = ours.model.read_text().replace('"RARM1" axis="1 0 0" range="-95 10"', '"RARM1" axis="1 0 0" range="-95 90"')
    (tmp_path / "loose.xml").write_text(loose)
    robots = {"loose": replace(ours, model=tmp_path / "loose.xml"), "ours": ours}
    runs = {
        name: run(plant_of(robot=robot, axes=("y", "z")), Follows(lambda t: np.array([0.2, 0.0])), duration_s=0.6)
        for name, robot in robots.items()
    }
    assert "the robot hits itself at 0.3" in runs["loose"].metadata["stop_reason"]
    assert "BODY touches RARM3" in runs["loose"].metadata["stop_reason"]
    assert runs["ours"].metadata["stop_reason"] == "duration"


@pytest.mark.parametrize(
    ("posture_deg", "links"),
    [
        ({"LARM0": -30, "LARM1": 0, "LARM2": -90, "LARM3": -120}, {"CHEST1", "LARM"}),
        ({"RARM0": 0, "RARM1": 0, "RARM2": 60, "RARM3": -20, "RARM5": 0}, {"RHAND", "RLEG2"}),
        ({"LLEG1": -20, "RLEG1": 20}, {"LLEG", "RLEG"}),
    ],
    ids=["left arm and chest", "right hand and leg", "legs"],
)
def test_links_that_touch_are_named(lifted, posture_deg, links):
    scene = lifted[0].scene
    look, positions = SelfCollision(scene), lifted[0]._data.qpos.copy()
    assert look.look(positions) == ""
    for joint, angle in posture_deg.items():
        positions[scene.position_at[scene.joints.index(joint)]] = np.radians(angle)
    assert all(link in look.look(positions) for link in links)


def test_too_much_force_is_counted_as_torque_at_its_limit():
    recording = run(plant_of(Pulling(lambda t: 40.0 * (t > 0.2))), Follows(still), duration_s=0.8)
    counted = dict(zip(recording["robot.limits"].axes, recording["robot.limits"].values[-1], strict=True))
    assert counted["torque"] > 10


def test_out_of_reach_the_hand_stops_and_the_slowing_is_counted():
    recording = run(plant_of(), Follows(lambda t: 0.3), duration_s=3.5)
    assert recording["robot.limits"].values[-1, 3] > 50
    assert np.abs(recording["hand.velocity"].values[-20:]).max() < 0.02
    assert recording.metadata["stop_reason"] == "duration"


def test_a_second_robot_lifts_the_same_beam_with_the_same_commands():
    pytest.importorskip("jvrc_description", reason="JVRC-1 comes with: pip install jvrc-description")
    recording = run(plant_of(robot="jvrc1"), Follows(lift), duration_s=2.6)
    rise = recording["hand.position"].values[-1, 0] - recording["hand.position"].values[0, 0]
    assert rise == pytest.approx(0.38, abs=2e-3)
    assert np.degrees(np.abs(recording["beam.tilt"].values).max()) < 2.0
    assert (recording["robot.limits"].values == 0).all()
    true = recording["hand.true_force"].values
    of_sensor = recording["hand.sensor_force"].values + recording["hand.acceleration"].values + STANDARD_GRAVITY
    assert of_sensor == pytest.approx(true, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robot": "hal9000"}, "robot 'hal9000' is unknown; there are: hrp2-class, jvrc1"),
        ({"dt": 0.0015}, "allowed are multiples of 0.001 s"),
        ({"axes": ("w",)}, "allowed are some of x, y, z"),
        ({"start_position": np.zeros(2)}, "start_position needs 1 values"),
        ({"start_position": np.array([1.9])}, "cannot hold the beam level at"),
        ({"load_mass_kg": 0.0}, "load_mass_kg 0, length_m 0.8; allowed"),
        ({"robot": replace(load_robot(), arm=("RARM9",))}, "no joint 'RARM9'; the model's are"),
        ({"robot": replace(load_robot(), grasp="nose")}, "no site 'nose'; it has"),
        ({"robot": replace(load_robot(), servos=())}, "no servo for joint"),
    ],
)
def test_impossible_parameters_are_named(settings, message):
    with pytest.raises(ParameterError, match=message.replace("(", r"\(")):
        plant_of(**settings)


def test_a_description_that_is_not_one_is_refused(tmp_path):
    (tmp_path / "mine.toml").write_text("name = 'mine'\nmodel = 'mine.xml'\n")
    with pytest.raises(ParameterError, match=r"model file 'mine.xml' is not there"):
        load_robot(tmp_path / "mine.toml")
    (tmp_path / "mine.xml").write_text("<mujoco/>")
    with pytest.raises(ParameterError, match=r"mine.toml does not describe a robot: 'arm'; compare hrp2_class.toml"):
        load_robot(tmp_path / "mine.toml")
    (tmp_path / "mine.toml").write_text("package = 'no_such_robot'\nmodel = 'a.urdf'\n")
    with pytest.raises(ParameterError, match="pip install no-such-robot"):
        load_robot(tmp_path / "mine.toml")


def test_without_the_simulator_the_error_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ParameterError, match=r"pip install comanip\[humanoid\]"):
        plant_of()


def test_the_simulator_is_not_loaded_before_it_is_needed():
    code = "import comanip.plants.humanoid, sys; assert 'mujoco' not in sys.modules and 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_model_weighs_what_its_class_does_and_has_thirty_joints(lifted):
    model = lifted[0].scene.model
    assert len(lifted[0].scene.joints) == 30
    assert float(model.body_mass.sum()) - 2.0 == pytest.approx(58.0, abs=0.1)
