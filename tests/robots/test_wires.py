"""Each transport carries bytes as they are; keys and tokens are spelled as rmw_zenoh spells them; arms in process by fakes."""

from __future__ import annotations

import math
import socket
import sys
import threading
import time
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from arms import Clock, about, commanding

from comanip.errors import ParameterError
from comanip.robots import turns, wire
from comanip.robots.arm import Sensed
from comanip.robots.fake import Lossy
from comanip.robots.in_process import FrankyArm, PandaPyArm
from comanip.robots.messages import Writer, packed
from comanip.robots.settings import Topic, Wiring

TOPIC = Topic("/arm/pose", "geometry_msgs/PoseStamped")
MESSAGES = [Writer(TOPIC.type, "base").write(n, (float(n),) * 7) for n in range(1, 40)]


def port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def pair(transport):
    if transport == "loopback":
        both = wire.Loopback()
        return both, both
    if transport == "zenoh":
        pytest.importorskip("zenoh", reason="eclipse-zenoh is the ros extra")
        at = (f"tcp/127.0.0.1:{port()}",)
        return wire.opened(Wiring("zenoh", 9, (), at), "one"), wire.opened(Wiring("zenoh", 9, at), "other")
    pytest.importorskip("cyclonedds", reason="cyclonedds is the dds extra")
    return wire.opened(Wiring("dds", 43), "one"), wire.opened(Wiring("dds", 43), "other")


def until(true, seconds=5.0):
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    return true()


@pytest.mark.parametrize("transport", ["loopback", "zenoh", "dds"])
def test_bytes_arrive_as_they_were_sent_and_in_order(transport):
    one, other = pair(transport)
    heard = []
    other.subscribe(TOPIC, heard.append)
    say = one.advertise(TOPIC)
    assert until(lambda: one.readers(TOPIC) == 1)
    assert until(lambda: say(MESSAGES[0]) or heard)  # the first may come before the subscription is known there
    heard.clear()
    for message in MESSAGES[1:]:
        say(message)
        time.sleep(0.003)
    assert until(lambda: heard and heard[-1] == MESSAGES[-1])
    assert [m for m in heard if m != MESSAGES[0]] == MESSAGES[1:]
    one.close()
    other.close()


def test_zenoh_names_what_others_publish_and_refuses_another_type_of_the_same_name():
    zenoh_wire = pytest.importorskip("comanip.robots.zenoh_wire", reason="eclipse-zenoh is the ros extra")
    one, other = pair("zenoh")
    heard = []
    other.subscribe(TOPIC, heard.append)
    say = one.advertise(TOPIC)
    assert until(lambda: say(MESSAGES[0]) or heard)
    assert "/arm/pose" in other.seen()
    wrong = zenoh_wire.key(9, TOPIC, "RIHS01_" + "0" * 64)
    heard.clear()
    one._session.put(wrong, MESSAGES[1])
    assert until(lambda: any("RIHS01_0000" in text for text in other.seen()))
    assert MESSAGES[1] not in heard
    one.close()
    other.close()


def test_keys_and_tokens_are_spelled_as_rmw_zenoh_does():
    zenoh_wire = pytest.importorskip("comanip.robots.zenoh_wire", reason="eclipse-zenoh is the ros extra")
    hashed = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
    assert zenoh_wire.key(3, TOPIC) == f"3/arm/pose/geometry_msgs::msg::dds_::PoseStamped_/{hashed}"
    assert zenoh_wire.token(3, "ab12", 0, 0, "NN", "node") == "@ros2_lv/3/ab12/0/0/NN/%/%/node"
    assert zenoh_wire.token(3, "ab12", 0, 4, "MP", "node", TOPIC) == (
        f"@ros2_lv/3/ab12/0/4/MP/%/%/node/%arm%pose/geometry_msgs::msg::dds_::PoseStamped_/{hashed}/2::,1:,:,:,,"
    )


def test_a_router_that_is_not_there_is_one_line():
    pytest.importorskip("zenoh", reason="eclipse-zenoh is the ros extra")
    with pytest.raises(ParameterError, match=r"^zenoh: tcp/127.0.0.1:\d+ cannot be reached .*rmw_zenohd") as error:
        wire.opened(Wiring("zenoh", 0, (f"tcp/127.0.0.1:{port()}",)), "one")
    assert "\n" not in str(error.value)


def test_a_transport_that_is_not_installed_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.delitem(sys.modules, "comanip.robots.rclpy_wire", raising=False)
    with pytest.raises(ParameterError, match=r"'rclpy' is not here .*Jazzy or later"):
        wire.opened(Wiring("rclpy"), "one")


def test_rclpy_is_asked_for_bytes_by_the_functions_that_it_has(monkeypatch):
    """A fake of exactly the functions used; nothing of ROS is here."""
    made = SimpleNamespace(subscriptions=[], published=[], over=[])
    node = SimpleNamespace(
        create_subscription=lambda kind, topic, hears, qos, raw: made.subscriptions.append((kind, topic, hears, raw)),
        create_publisher=lambda kind, topic, qos: SimpleNamespace(publish=made.published.append),
        count_subscribers=lambda topic: 2,
        get_topic_names_and_types=lambda: [("/b", ["x"]), ("/a", ["y"])],
        destroy_node=lambda: made.over.append("node"),
    )
    ended = threading.Event()
    executor = SimpleNamespace(add_node=lambda n: None, spin=ended.wait, shutdown=ended.set)
    modules = {
        "rclpy": {"ok": lambda: False, "init": lambda domain_id: None, "create_node": lambda name: node,
                  "shutdown": lambda: made.over.append("rclpy")},
        "rclpy.executors": {"SingleThreadedExecutor": lambda: executor},
        "rclpy.qos": {"QoSProfile": lambda **about: about, "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2)},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"PoseStamped": "PoseStamped"},
    }  # fmt: skip
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "comanip.robots.rclpy_wire", raising=False)
    one = wire.opened(Wiring("rclpy"), "comanip")
    heard = []
    one.subscribe(TOPIC, heard.append)
    one.advertise(TOPIC)(MESSAGES[0])
    kind, name, hears, raw = made.subscriptions[0]
    hears(MESSAGES[1])
    assert (kind, name, raw) == ("PoseStamped", "/arm/pose", True)
    assert (heard, made.published) == ([MESSAGES[1]], [MESSAGES[0]])
    assert (one.readers(TOPIC), one.seen()) == (2, ["/a", "/b"])
    one.close()
    assert made.over == ["node", "rclpy"]
    sys.modules.pop("comanip.robots.rclpy_wire")


def test_a_lossy_wire_loses_its_share_and_brings_the_rest_late():
    under = wire.Loopback()
    heard = []
    under.subscribe(TOPIC, heard.append)
    lossy = Lossy(under, 0.3, 0.02, np.random.default_rng(1))
    say = lossy.advertise(TOPIC)
    for message in MESSAGES * 5:
        say(message)
    assert not heard or len(heard) < 150
    time.sleep(0.3)
    assert 0.6 * 195 < len(heard) < 0.8 * 195
    lossy.close()


# arms in this process, by fakes of exactly the functions used


def state(**more):
    q = (math.cos(0.5), 0.0, math.sin(0.5), 0.0)
    m = np.eye(4)
    m[:3, :3] = np.column_stack([turns.turned(q, e) for e in np.eye(3)])
    m[:3, 3] = (0.4, 0.1, 0.6)
    return SimpleNamespace(
        O_F_ext_hat_K=[1.0, 2.0, 3.0, 0.0, 0.0, 0.0], time=SimpleNamespace(to_sec=lambda: 77.5), q=[0.1 * n for n in range(7)],
        matrix=m,
        quaternion=q, **more,
    )  # fmt: skip


def sensed(arm):
    out = Sensed()
    arm.sense(out)
    return out


def check(out, q):
    assert out.position == pytest.approx((0.4, 0.1, 0.6))
    assert out.orientation == pytest.approx(q)
    assert out.force == (-1.0, -2.0, -3.0)  # libfranka says what the robot does to its surroundings
    assert out.joints["joint3"] == pytest.approx(0.2)


def franky(moves):
    one = state()
    w, x, y, z = one.quaternion
    one.O_T_EE = SimpleNamespace(translation=[0.4, 0.1, 0.6], quaternion=[x, y, z, w])
    robot = SimpleNamespace(
        state=one, move=lambda motion, asynchronous: moves.append((motion, asynchronous)), join_motion=lambda: None
    )
    lib = SimpleNamespace(
        Robot=lambda host: robot, Twist=lambda v, w: ("twist", v, w), Duration=lambda ms: ms,
        CartesianVelocityMotion=lambda twist, duration: (twist, duration),
    )  # fmt: skip
    return lib, robot, one


def test_franky_moves_at_a_cartesian_velocity():
    moves = []
    lib, robot, one = franky(moves)
    arm = FrankyArm(about(sign=-1.0, adapter="franky"), Clock(), library=lib)
    assert arm.missing() == ""
    check(sensed(arm), one.quaternion)
    arm.send((0.1, 0.0, -0.2), (0.0, 0.0, 0.0), turns.NONE, (0.0, 0.0, 0.0))
    assert moves == [((("twist", [0.1, 0.0, -0.2], [0.0, 0.0, 0.0]), 50), True)]

    def fails(*_, **__):
        raise RuntimeError("communication_constraints_violation")

    robot.move = fails
    arm.send((0.1, 0.0, -0.2), (0.0, 0.0, 0.0), turns.NONE, (0.0, 0.0, 0.0))
    assert arm.problem == "the arm: communication_constraints_violation"


def test_panda_py_is_given_a_target_and_starts_its_controller_only_then():
    one, did = state(), []
    one.O_T_EE = one.matrix.T.ravel().tolist()  # by columns
    panda = SimpleNamespace(
        get_state=lambda: one, start_controller=lambda c: did.append("started"), stop_controller=lambda: did.append("stopped")
    )
    controller = SimpleNamespace(set_control=lambda position, orientation: did.append((position, orientation)))
    lib = SimpleNamespace(Panda=lambda host: panda, controllers=SimpleNamespace(CartesianImpedance=lambda: controller))
    settings = about(sign=-1.0, adapter="panda-py", command=commanding("pose"))
    arm = PandaPyArm(settings, Clock(), library=lib)
    check(sensed(arm), one.quaternion)
    arm.close()
    assert did == []
    arm.send((0.0, 0.0, 0.0), (0.4, 0.1, 0.61), (0.5, 0.1, 0.2, 0.3), (0.0, 0.0, 0.0))
    assert did[-1] == ([0.4, 0.1, 0.61], [0.1, 0.2, 0.3, 0.5])
    assert did.count("started") == 1
    assert did.index("started") > 0
    arm.close()
    assert did[-1] == "stopped"
    with pytest.raises(ParameterError, match=r"command.kind is 'twist'; adapter 'panda-py' takes 'pose'"):
        PandaPyArm(replace(settings, command=commanding("twist")), Clock(), library=lib)


def test_a_state_that_stands_still_is_the_same_sample():
    lib, _robot, _one = franky([])
    clock = Clock()
    arm = FrankyArm(about(sign=-1.0), clock, library=lib)
    out = Sensed()
    arm.sense(out)
    before = out.time
    clock.now += 1.0
    arm.sense(out)
    assert out.time == before


def test_the_joints_of_a_message_that_has_other_numbers_are_refused():
    settings = about(topics={**about().topics, "joints": Topic("/j", "sensor_msgs/JointState")})
    from comanip.robots.ros2 import Ros2Arm

    both = wire.Loopback()
    arm = Ros2Arm(both, settings, Clock())
    both.advertise(settings.topics["joints"])(packed("sensor_msgs/JointState", {"name": ["a", "b"], "position": [1.0]}))
    assert "1 positions for 2 joints" in arm.notice
