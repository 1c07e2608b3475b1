"""A robot of one's own: a model file and a small table are all it takes, standing or bolted down."""

from __future__ import annotations

import re

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.loop import run
from comanip.plants.humanoid import scene
from comanip.plants.humanoid.scene import ranges_of
from humanoids import Follows, lift, plant_of

pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")

ARM = """
<mujoco model="bench arm">
  <worldbody>
    <body name="post" pos="0 0 1.2">
      <inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/>
      {links}
    </body>
  </worldbody>
</mujoco>
"""
LINKS = (("y", 0.0), ("x", 0.0), ("z", 0.0), ("y", -0.30), ("z", -0.28), ("y", 0.0))
TABLE = """
name = "bench arm"
model = "arm.xml"
arm = ["j0", "j1", "j2", "j3", "j4", "j5"]
hand = "link5"
sensor = "wrist"
grasp = "tool"
grasp_m = [0.45, 0.0, 0.85]
posture_deg = { j3 = -70, j5 = -20 }
[[site]]
name = "wrist"
body = "link5"
[[site]]
name = "tool"
body = "link5"
position = [0.0, 0.0, -0.10]
xyaxes = [0, 0, -1, 0, 1, 0]
[[servo]]
joints = "j."
stiffness = 6000
damping = 80
torque = 80
speed = 6
"""


def links(n=0):
    if n == len(LINKS):
        return ""
    axis, z = LINKS[n]
    vector = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[axis]
    return (
        f'<body name="link{n}" pos="0 0 {z}"><joint name="j{n}" axis="{vector}" range="-150 150" armature="0.1"/>'
        f'<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/>{links(n + 1)}</body>'
    )


@pytest.fixture
def table(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM.format(links=links()))
    path = tmp_path / "arm.toml"
    path.write_text(TABLE)
    return path


def test_an_arm_on_a_post_lifts_the_beam(table):
    plant = plant_of(robot=table)
    recording = run(plant, Follows(lambda t: lift(t, 0.25, 1.2)), duration_s=1.8)
    rise = np.ptp(recording["hand.position"].values)
    assert rise == pytest.approx(0.25, abs=2e-3)
    assert (recording["robot.limits"].values == 0).all()
    assert (recording["robot.base"].values == 0).all()  # it has none that moves
    of_sensor = recording["hand.sensor_force"].values + recording["hand.acceleration"].values + 9.80665
    assert of_sensor == pytest.approx(recording["hand.true_force"].values, abs=0.1)
    assert plant.scene.hand_kg == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('hand = "link5"', 'hand = "palm"', "no body 'palm' in arm.xml; it has: .*link5"),
        ('body = "link5"\nposition', 'body = "palm"\nposition', "no body 'palm'"),
        ('joints = "j."', 'joints = "k."', "no servo for joint 'j0'; patterns are: k."),
        ("stiffness = 6000", "stiffness = -1", "stiffness must be positive; got -1"),
        ("j3 = -70", "j9 = -70", "no joint 'j9'; the model's are: j0, j1"),
        ("grasp_m = [0.45, 0.0, 0.85]", "grasp_m = [0.95, 0.0, 0.85]", "cannot hold the beam level"),
        ("stiffness = 6000", "stifness = 6000", "does not describe a robot: .*stifness"),
    ],
)
def test_mistakes_in_the_table_are_named(table, old, new, message):
    assert old in TABLE
    table.write_text(TABLE.replace(old, new))
    with pytest.raises(ParameterError, match=message):
        plant_of(robot=table)


def test_a_joint_that_slides_is_refused(table):
    model = table.parent / "arm.xml"
    model.write_text(model.read_text().replace('name="j5"', 'name="j5" type="slide"'))
    with pytest.raises(ParameterError, match="joint 'j5' does not rotate"):
        plant_of(robot=table)


def built(tmp_path, arm=None, table=TABLE):
    """The plant of an arm that stands in files."""
    (tmp_path / "arm.xml").write_bytes((ARM.format(links=links()) if arm is None else arm).encode())
    (tmp_path / "arm.toml").write_bytes(table if isinstance(table, bytes) else table.encode())
    return plant_of(robot=tmp_path / "arm.toml")


def test_a_joint_that_turns_on_and_on_has_no_ends(tmp_path):
    free = ARM.format(links=links()).replace('<joint name="j5" axis="0 1 0" range="-150 150"', '<joint name="j5" axis="0 1 0"')
    assert free != ARM.format(links=links())
    plant = built(tmp_path, free)
    recording = run(plant, Follows(lambda t: lift(t, 0.25, 1.2)), duration_s=1.8)
    assert recording.metadata["stop_reason"] == "duration"
    assert np.ptp(recording["hand.position"].values) == pytest.approx(0.25, abs=2e-3)
    assert (recording["robot.limits"].values == 0).all()
    assert np.isinf(ranges_of(plant.scene.model, ["j5"])).all()
    np.testing.assert_allclose(ranges_of(plant.scene.model, ["j4"]), np.radians([[-150.0, 150.0]]))


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [(np.nan, "is not finite"), (np.inf, "is not finite"), (-np.inf, "is not finite"), (1e300, r"asks for 1e\+300 m/s")],
)
def test_a_command_that_cannot_be_ends_the_run_and_keeps_the_recording(table, wrong, reason):
    recording = run(plant_of(robot=table), Follows(lambda t: wrong if t > 0.5 else 0.0), duration_s=1.2)
    assert re.fullmatch(rf"the command {reason} at 0\.5\d* s", recording.metadata["stop_reason"])
    assert 0.5 <= recording["hand.position"].time[-1] < 0.6
    assert np.isfinite(recording["hand.position"].values).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_partner_whose_force_cannot_be_ends_the_run_too(table, wrong):
    plant = plant_of(robot=table)
    felt = plant.partner.force

    def force(time, position, velocity, out):
        felt(time, position, velocity, out)
        if time > 0.3:
            out[:] = wrong

    plant.partner.force = force
    recording = run(plant, Follows(lambda t: 0.0), duration_s=1.0)
    assert recording.metadata["stop_reason"].startswith("the partner's force is not finite at 0.30")
    assert np.isfinite(recording["hand.position"].values).all()


GOOD = ARM.format(links=links())


@pytest.mark.parametrize(
    "arm",
    [
        "<mujoco><worldbody>",
        "",
        "not xml at all",
        "<html/>",
        GOOD.replace('mass="1"', 'mass="0"'),
        GOOD.replace("<worldbody>", "<worldbody><nonsense/>"),
        GOOD.replace('axis="0 1 0"', 'axis="0 0 0"'),
        GOOD.replace('<body name="link3"', '<body name="link2"'),
        "<mujoco>" * 3000,
        GOOD.replace("</mujoco>", '<include file="arm.xml"/></mujoco>'),
    ],
    ids=lambda text: text[:20],
)
def test_a_model_that_is_none_is_one_line_that_names_it(tmp_path, arm):
    for geometry in ("", "geometry = false\n"):
        with pytest.raises(ParameterError, match=r"arm\.xml") as error:
            built(tmp_path, arm, geometry + TABLE)
        assert "\n" not in str(error.value)


def test_a_mesh_that_is_not_there_is_named_unless_shapes_are_left_out(tmp_path):
    arm = GOOD.replace("</mujoco>", '<asset><mesh name="m" file="/nowhere/at_all.stl"/></asset></mujoco>')
    with pytest.raises(ParameterError, match=r"arm\.xml.*at_all\.stl"):
        built(tmp_path, arm)
    built(tmp_path, arm, "geometry = false\n" + TABLE)


def test_a_model_that_kills_the_simulator_is_refused_by_a_process_that_may_die(table, monkeypatch):
    monkeypatch.setattr(scene, "_TRY", "import os; os.abort()")
    scene._survives.cache_clear()
    with pytest.raises(ParameterError, match=r"arm\.xml is no model that MuJoCo reads: MuJoCo dies of it \(signal 6\)"):
        plant_of(robot=table)
    scene._survives.cache_clear()


def test_a_model_is_tried_once_and_again_when_it_changed(tmp_path, monkeypatch):
    built(tmp_path)
    before = scene._survives.cache_info().misses
    plant_of(robot=tmp_path / "arm.toml")
    assert scene._survives.cache_info().misses == before
    built(tmp_path, GOOD + "\n")
    assert scene._survives.cache_info().misses == before + 1


@pytest.mark.parametrize(
    "table",
    [
        TABLE.replace('"j."', '"j("'),
        TABLE.replace('"j."', "3"),
        TABLE.replace("stiffness = 6000", 'stiffness = "much"'),
        TABLE.replace("stiffness = 6000", "stiffness = nan"),
        TABLE.replace("speed = 6", "speed = inf"),
        TABLE.replace("[0.45, 0.0, 0.85]", "[0.45, 0.0]"),
        TABLE.replace("[0.45, 0.0, 0.85]", '[0.45, 0.0, "up"]'),
        TABLE.replace("[0.45, 0.0, 0.85]", "[0.45, nan, 0.85]"),
        TABLE.replace("j3 = -70", 'j3 = "down"'),
        TABLE.replace("posture_deg = { j3 = -70, j5 = -20 }", "posture_deg = 3"),
        TABLE.replace("xyaxes = [0, 0, -1, 0, 1, 0]", "xyaxes = [0, 0, -1]"),
        TABLE.replace("position = [0.0, 0.0, -0.10]", "position = [0.0, nan, -0.10]"),
        TABLE.replace('arm = ["j0",', "arm = [0,"),
        TABLE.replace("[[servo]]", "[servo]"),
        TABLE.replace("[[site]]", "[[sight]]"),
        'package = "a.b.c"\n' + TABLE,
        'package = ""\n' + TABLE.replace('"arm.xml"', '"nowhere.xml"'),
        'packaged = true\npackage = "numpy"\n' + TABLE,
        TABLE.replace('"arm.xml"', "3"),
        TABLE + "= = =",
        "[" * 5000,
        b"\xff\xfe name",
    ],
    ids=range(22),
)
def test_a_table_that_is_none_is_one_line_that_names_it(tmp_path, table):
    with pytest.raises(ParameterError, match=r"arm") as error:
        built(tmp_path, table=table)
    assert "\n" not in str(error.value)
