"""A robot of one's own: a model file and a small table are all it takes, standing or bolted down."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.loop import run
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
