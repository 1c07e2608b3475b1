"""Messages against rosbags, which nobody of us wrote; turns and stamps against what they must be."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comanip.errors import ParameterError, RecordingError
from comanip.formats.ros2_types import DEFINITIONS
from comanip.robots import turns
from comanip.robots.messages import HASHES, PATHS, Reader, Writer, packed
from comanip.robots.stamps import Arrivals

NUMBERS = tuple(0.1 * n - 0.25 for n in range(7))


@pytest.fixture(scope="module")
def store():
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags writes the messages to compare with")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


@pytest.mark.parametrize("kind", sorted(HASHES))
def test_the_hash_of_each_type_is_that_of_ros(store, kind):
    assert store.hash_rihs01(kind.replace("/", "/msg/")) == HASHES[kind]


@pytest.mark.parametrize("kind", sorted(PATHS))
@pytest.mark.parametrize("frame", ["", "base", "panda_hand_tcp"])
def test_what_is_written_is_what_ros_reads_and_the_other_way_round(store, kind, frame):
    numbers = NUMBERS[: len(PATHS[kind])]
    message = Writer(kind, frame).write(1_700_000_000_123_456_789, numbers)
    theirs = store.deserialize_cdr(message, kind.replace("/", "/msg/"))
    for path, number in zip(PATHS[kind], numbers, strict=True):
        value = theirs
        for name in path.split("."):
            value = getattr(value, name)
        assert value == number
    again = bytes(store.serialize_cdr(theirs, kind.replace("/", "/msg/")))
    heard = Reader(kind).read(again)
    assert heard.numbers == numbers
    if hasattr(theirs, "header"):
        assert (theirs.header.stamp.sec, theirs.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
        assert heard.frame == frame == theirs.header.frame_id
        assert heard.stamp == pytest.approx(1_700_000_000.123456789, abs=1e-6)
    else:
        assert math.isnan(heard.stamp)


@pytest.mark.parametrize("names", [("a",), ("joint_1", "j2", "third")])
def test_joint_states_are_told_by_name(store, names):
    content = {"header": {"frame_id": "x"}, "name": names, "position": [1.5 * n for n in range(len(names))], "effort": [7.0]}
    message = packed("sensor_msgs/JointState", content)
    theirs = store.deserialize_cdr(message, "sensor_msgs/msg/JointState")
    assert tuple(theirs.name) == names
    assert theirs.position.tolist() == content["position"]
    _, numbers, said = Reader("sensor_msgs/JointState").arrays(message)
    assert said == names
    assert list(numbers["position"]) == content["position"]


@pytest.mark.parametrize("kind", sorted(DEFINITIONS))
def test_an_empty_message_of_each_common_type_is_one_of_ros(store, kind):
    store.deserialize_cdr(packed(kind, {}), kind.replace("/", "/msg/"))


@given(st.binary(max_size=200))
def test_no_bytes_do_more_than_be_refused(data):
    for kind in ("geometry_msgs/PoseStamped", "sensor_msgs/JointState"):
        reader = Reader(kind)
        with contextlib.suppress(RecordingError):
            reader.arrays(data) if kind.startswith("sensor") else reader.read(data)


quaternions = st.tuples(*[st.floats(-1, 1) for _ in range(4)]).filter(lambda q: math.hypot(*q) > 0.1)


@given(quaternions, quaternions, st.tuples(*[st.floats(-10, 10) for _ in range(3)]))
def test_turns_keep_lengths_and_follow_each_other(p, q, v):
    p, q = (tuple(np.array(one) / math.hypot(*one)) for one in (p, q))
    assert math.hypot(*turns.turned(q, v)) == pytest.approx(math.hypot(*v), abs=1e-9)
    assert turns.turned(turns.back(q), turns.turned(q, v)) == pytest.approx(v, abs=1e-9)
    assert turns.turned(turns.after(p, q), v) == pytest.approx(turns.turned(p, turns.turned(q, v)), abs=1e-9)


def test_a_quarter_turn_about_z_takes_x_to_y():
    assert turns.turned((math.cos(math.pi / 4), 0, 0, math.sin(math.pi / 4)), (1, 0, 0)) == pytest.approx((0, 1, 0))


WRONG = ["hnad", [1, 0, 0], [2, 0, 0, 0], "hand 1 0 0", None, [math.nan, 0, 0, 1], "same same", [], True]


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_turn_is_refused_with_what_is_allowed(text):
    with pytest.raises(ParameterError, match=r"allowed: .*hand"):
        turns.parsed(text)


def test_stamps_of_another_clock_age_as_they_travel():
    """Its clock is 1000 s ahead; a message that took 20 ms longer than the fastest is 20 ms old."""
    arrivals = Arrivals()
    assert arrivals.time(1000.0, 0.001) == pytest.approx(0.001)
    assert arrivals.time(1000.01, 0.031) == pytest.approx(0.011)


def test_a_message_that_was_overtaken_is_old_and_a_clock_that_was_set_back_is_believed():
    arrivals = Arrivals()
    arrivals.time(100.0, 0.0)
    assert arrivals.time(99.99, 0.005) is None
    assert arrivals.time(100.0, 0.006) is None
    assert arrivals.time(3.0, 0.5) == pytest.approx(0.5)  # the node restarted, its clock begins anew
    assert arrivals.time(3.1, 0.6) == pytest.approx(0.6)


@given(st.lists(st.tuples(st.floats(0, 1e9), st.floats(0, 1.0)), max_size=30))
def test_times_never_go_back(pairs):
    arrivals, now, last = Arrivals(), 0.0, -math.inf
    for stamp, later in pairs:
        now += later
        made = arrivals.time(stamp, now)
        if made is not None:
            assert last <= made <= now + 1e-6
            last = made
