"""robot.toml: what is wrong is said in one line with file and key, before anything is connected."""

from __future__ import annotations

import math

import pytest

from comanip.errors import ParameterError
from comanip.robots.settings import ADAPTERS, load, presets

GOOD = """
adapter = "ros2"
rate_hz = 100
[wire]
connect = ["tcp/127.0.0.1:7447"]
[topics]
pose = "/pose"
wrench = "/wrench"
[command]
topic = "/twist"
[frames]
pose = "base"
turns.ft = "hand"
[axes]
up = [0, 0, 2]
[limits]
speed_m_per_s = 0.25
walls.up = [0.1, 0.6]
"""


def robot(tmp_path, text):
    path = tmp_path / "robot.toml"
    path.write_text(text)
    return path


def test_a_robot_in_twenty_lines(tmp_path):
    found = load(robot(tmp_path, GOOD))
    assert found.axes == {"up": (0.0, 0.0, 1.0)}
    assert found.walls_m == {"up": (0.1, 0.6)}
    assert found.command.topic.type == "geometry_msgs/TwistStamped"
    assert found.turns["ft"].with_hand
    assert found.real


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('adapter = "ros2"', 'adapter = "ros3"', "adapter is 'ros3'; allowed: ros2, franky"),
        ('adapter = "ros2"', "", "adapter is missing"),
        ("rate_hz = 100", "rate_hz = -1", "rate_hz is -1; allowed: a number of 20"),
        ("rate_hz = 100", "rate_hz = true", "rate_hz is True"),
        ("rate_hz = 100", "rate_hz = nan", "rate_hz is nan"),
        ("rate_hz = 100", "rate_hz = 1e400", "rate_hz is inf"),
        ("rate_hz = 100", "ratehz = 100", "ratehz is no key of a robot; did you mean 'rate_hz'"),
        ('pose = "/pose"', 'pose = "pose"', "topics.pose is 'pose'; allowed: a topic"),
        ('pose = "/pose"', "", "topics.pose is missing"),
        ('pose = "/pose"', 'pose = {name = "/p", type = "geometry_msgs/Wrench"}', "topics.pose: message type"),
        ('wrench = "/wrench"', 'wrenhc = "/w"', "topics.wrench is missing"),
        ('topic = "/twist"', "", "command.topic is missing"),
        ('topic = "/twist"', 'topic = "/twist"\nkind = "joints"', "command.kind is 'joints'; allowed: twist, pose, wrench"),
        ('topic = "/twist"', 'topic = "/twist"\ntype = "geometry_msgs/PoseStamped"', "command.type: message type"),
        ('topic = "/twist"', 'topic = "/twist"\nframe = "tool"', "command.frame is 'tool'; allowed: frames.pose"),
        ('turns.ft = "hand"', 'turns.ft = "head"', "frames.turns.ft: 'head' is no turn"),
        ('turns.ft = "hand"', 'turnes.ft = "hand"', "frames.turnes is no key of a robot; did you mean 'turns'"),
        ("up = [0, 0, 2]", "up = [0, 0, 0]", "axes.up is [0, 0, 0]; allowed: a direction, not zero"),
        ("up = [0, 0, 2]", "up = 3", "axes.up is 3; allowed: a direction"),
        ("up = [0, 0, 2]", "up = [0, 0, 1]\nside = [0, 1, 1]", "axes.side is not orthogonal to axes.up"),
        ("up = [0, 0, 2]", "", "[axes] is missing"),
        ("speed_m_per_s = 0.25", "", "limits.speed_m_per_s is missing"),
        ("speed_m_per_s = 0.25", 'speed_m_per_s = "fast"', "limits.speed_m_per_s is 'fast'"),
        ("walls.up = [0.1, 0.6]", "", "limits.walls.up is missing"),
        ("walls.up = [0.1, 0.6]", "walls.up = [0.6, 0.1]", "limits.walls.up is [0.6, 0.1]; allowed: [lowest, highest]"),
        ("walls.up = [0.1, 0.6]", "walls.up = [0.1, 0.6]\nwalls.z = [0, 1]", "limits.walls.z is no key"),
        ("[wire]", '[wire]\ntransport = "carrier pigeon"', "wire.transport is 'carrier pigeon'; allowed: zenoh"),
        ("[wire]", "[wire]\ndomain = 1.5", "wire.domain is 1.5"),
        ("[wire]", "wire = 3", ""),
        ("[limits]", "[rates]\nlate_s = 0.01\n[limits]", "rates.late_s is 0.01; allowed: at least two periods"),
        ("[limits]", "[payload]\nmass_kg = -1\n[limits]", "payload.mass_kg is -1"),
        ("rate_hz = 100", "rate_hz = 100\nforce_sign = 2", "force_sign is 2; allowed: 1"),
        ("rate_hz = 100", 'preset = "crips"', "preset is 'crips'; allowed: beam, crisp"),
        ("rate_hz = 100", "rate_hz = ", "robot.toml: "),
    ],
)
def test_each_mistake_is_one_line_with_file_and_key(tmp_path, old, new, said):
    path = robot(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ParameterError) as error:
        load(path)
    text = str(error.value)
    assert str(path) in text
    assert "\n" not in text
    assert said in text


def test_an_unknown_name_lists_the_presets():
    with pytest.raises(ParameterError, match="'beem' is unknown; there are: beam, crisp"):
        load("beem")
    with pytest.raises(ParameterError, match="no such file"):
        load("absent.toml")


@pytest.mark.parametrize("name", sorted(set(presets()) - {"beam", "humanoid", "fake"}))
def test_a_preset_needs_what_only_the_user_knows_and_is_whole_then(tmp_path, name):
    with pytest.raises(ParameterError, match=r"\[axes\]|limits|host"):
        load(name)
    own = f'preset = "{name}"\nhost = "172.16.0.2"\n' + GOOD[GOOD.index("[axes]") :]
    found = load(robot(tmp_path, own))
    assert found.adapter in ADAPTERS
    assert math.isclose(found.dt, 0.01)
    assert found.real


def test_what_a_file_states_stands_over_its_preset_and_axes_are_its_own(tmp_path):
    own = 'preset = "fake"\n[wire]\ndomain = 3\n[axes]\nx = [1, 0, 0]\n[limits]\nwalls.x = [0, 1]\n'
    found = load(robot(tmp_path, own))
    assert (found.wire.domain, found.wire.connect) == (3, ("tcp/127.0.0.1:7477",))
    assert list(found.axes) == ["x"]
    assert found.speed_m_per_s == 0.8
