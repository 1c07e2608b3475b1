"""Bags of ROS 2, MCAP and SQLite: every type by path, one clock, one frame, nothing lost."""

from __future__ import annotations

import sqlite3
import struct
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bags
from bags import T0, lifting, make, pose, quaternion, transform, twist, vector, wrench, write_folder
from comanip.errors import ChannelError, ParameterError, RecordingError
from comanip.formats import Columns, read
from comanip.formats.events import events
from comanip.formats.ros2 import Decoder, parsed, table, values
from comanip.formats.ros2_types import DEFINITIONS
from comanip.lessons.demonstration import demonstrations
from lifts import minimum_jerk

BOTH = pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])


def notes_of(recording):
    return "\n".join(recording.metadata["notes"])


@BOTH
def test_a_bag_opens_without_a_flag(tmp_path, plugin):
    write_folder(tmp_path / "bag", lifting(), plugin)
    (recording,) = read(tmp_path / "bag")
    x, dx, _ = minimum_jerk(np.arange(401) / 100)
    assert recording["hand.position"].axes == ("z",)
    assert np.allclose(recording["hand.position"].values[:, 0], 0.8 + x, atol=1e-15)
    assert np.allclose(recording["hand.velocity"].values[:, 0], dx, atol=1e-15)
    assert recording["hand.force"].values.shape == (2001, 1)
    assert np.allclose(recording["hand.force"].values[::5, 0], 25 * dx, atol=1e-12)
    assert np.abs(recording["hand.force"].time - (T0 + np.arange(2001) / 500)).max() < 3e-7
    assert recording["hand.torque"].values[7].tolist() == [0.1, 0.2, 0.3]
    assert recording["hand.orientation"].axes == ("w", "x", "y", "z")
    assert {recording[n].frame for n in ("hand.position", "hand.force", "hand.velocity", "hand.torque")} == {"base"}
    assert "axis x, y left out" in notes_of(recording)
    (lesson,) = demonstrations([recording])
    assert lesson.channels == ("position.z", "force.z", "velocity.z")
    assert not any("no frame is stored" in note for note in lesson.notes)


def other_types():
    joints = {"name": ["a", "b"], "velocity": np.zeros(2), "effort": np.array([5.0, 6.0])}
    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    found = []
    for i in range(20):
        t = i / 10
        found += [
            (
                "/joints",
                t,
                make("sensor_msgs/msg/JointState", header=bags.header(t), position=np.array([i, -i], float), **joints),
            ),
            ("/numbers", t, make("std_msgs/msg/Float64MultiArray", layout=layout, data=np.arange(16.0) + i)),
            ("/one", t, make("std_msgs/msg/Float64", data=i / 3)),
            ("/word", t, make("std_msgs/msg/String", data="lead" if i < 10 else "follow")),
        ]
    return found


@BOTH
def test_joints_arrays_numbers_and_words_are_found_by_path(tmp_path, plugin):
    write_folder(tmp_path / "bag", other_types(), plugin)
    extra = {
        "joint": "joints.position.b",
        "array": "/numbers.data[14]",
        "several": "numbers.data[2:4]",
        "one": "/one",
        "effort": "effort.a",
    }
    (recording,) = read(tmp_path / "bag", Columns(extra={n: (e,) for n, e in extra.items()}))
    assert recording["joint"].values[:, 0].tolist() == [-i for i in range(20)]
    assert recording["array"].values[:, 0].tolist() == [14 + i for i in range(20)]
    assert recording["several"].values[3].tolist() == [5.0, 6.0]
    assert recording["one"].values[:, 0].tolist() == [i / 3 for i in range(20)]
    assert recording["effort"].values[0, 0] == 5.0
    assert [e.label for e in events(recording)] == ["lead"] * 10 + ["follow"] * 10
    assert events(recording)[10].time_s == pytest.approx(T0 + 1.0)


FRANKA = """std_msgs/Header header
float64[16] O_T_EE
float64[6] O_F_ext_hat_K
Inner[2] sides
float64 time
================================================================================
MSG: franka_msgs/Inner
float32 load
string label
geometry_msgs/WrenchStamped w
"""


def franka(path, count=30):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    outer, inner = FRANKA.split("=" * 80 + "\nMSG: franka_msgs/Inner\n")
    store.register(get_types_from_msg(inner, "franka_msgs/msg/Inner"))
    store.register(get_types_from_msg(outer, "franka_msgs/msg/FrankaState"))
    kinds = store.types
    with bags.ROSBAGS.Writer(path, version=9, storage_plugin=bags.ROSBAGS.enums.StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/franka_state", "franka_msgs/msg/FrankaState", typestore=store)
        for i in range(count):
            sides = [
                kinds["franka_msgs/msg/Inner"](
                    load=0.5 * k, label="ab"[k] * (3 + k), w=wrench(i / 100, (1, 2, i), frame=f"side{k}")
                )
                for k in range(2)
            ]
            message = kinds["franka_msgs/msg/FrankaState"](
                header=bags.header(i / 100, "panda_link0"), O_T_EE=i + np.arange(16) / 16,
                O_F_ext_hat_K=np.array([0.0, 0, i, 0, 0, 0]),
                sides=sides, time=0.1 * i,
            )  # fmt: skip
            bag.write(connection, T0 * 10**9 + i * 10**7, store.serialize_cdr(message, "franka_msgs/msg/FrankaState"))


def test_nested_arrays_of_a_robots_own_message_are_found_by_path(tmp_path):
    franka(tmp_path / "a.mcap")
    (recording,) = read(tmp_path / "a.mcap", Columns(position="franka_state.O_T_EE[14]", force="O_F_ext_hat_K[2]"))
    assert recording["hand.position"].values[:, 0].tolist() == [i + 14 / 16 for i in range(30)]
    assert recording["hand.force"].values[:, 0].tolist() == list(range(30))
    assert recording["/franka_state.sides[1].w.wrench.force"].values[4].tolist() == [1.0, 2.0, 4.0]
    assert recording["/franka_state.sides[1].w.wrench.force"].frame == "side1"
    assert recording["/franka_state.sides[1].w.wrench.force"].unit == "N"
    assert recording["hand.position"].frame == "panda_link0"


def test_a_short_name_that_two_topics_have_is_asked_back(tmp_path):
    franka(tmp_path / "a.mcap")
    with pytest.raises(ChannelError, match=r"'wrench.force.z' may be /franka_state.sides\[0\].*; say which"):
        read(tmp_path / "a.mcap", Columns(position="wrench.force.z"))
    (recording,) = read(tmp_path / "a.mcap")
    with pytest.raises(ChannelError, match=r"no 'hand.position'"):
        demonstrations([recording])


def test_what_two_topics_could_be_is_not_guessed(tmp_path):
    write_folder(tmp_path / "bag", [*lifting(), *[("/ft_raw", t, m) for topic, t, m in lifting() if topic == "/ft"]])
    (recording,) = read(tmp_path / "bag")
    assert "hand.force" not in recording
    with pytest.raises(ChannelError, match=r"/ft.wrench.force.x and /ft_raw.wrench.force.x could both be the force; say which"):
        demonstrations([recording])
    (mapped,) = read(tmp_path / "bag", Columns(position="pose.position.z", force="/ft_raw.wrench.force.z"))
    assert mapped["hand.force"].values.shape == (2001, 1)


# Time ---------------------------------------------------------------------------------------------------------------------


def raw_bag(path, rows, twice=False, summary=True):
    """A bag of poses and forces, written in the order of `rows`: (log [s], header [s], number)."""
    from mcap.writer import IndexType, Writer

    with path.open("wb") as out:
        more = {} if summary else {
            "use_statistics": False, "use_summary_offsets": False, "index_types": IndexType.NONE, "repeat_channels": False,
            "repeat_schemas": False,
        }  # fmt: skip
        writer = Writer(out, **more)
        writer.start(profile="ros2", library="somebody")
        kinds = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/WrenchStamped")
        schemas = [writer.register_schema(k, "ros2msg", bags.TYPES.generate_msgdef(k, ros_version=2)[0].encode()) for k in kinds]
        pairs = [
            [writer.register_channel(t, "cdr", s) for t, s in zip(("/pose", "/ft"), schemas, strict=True)]
            for _ in range(1 + twice)
        ]
        for n, (log, stamp, number) in enumerate(rows):
            ids = pairs[twice and n >= len(rows) // 2]
            two = pose(stamp, (0, 0, number)), wrench(stamp, (0, 0, -number))
            for channel, message in zip(ids, two, strict=True):
                data = bytes(bags.TYPES.serialize_cdr(message, message.__msgtype__))
                writer.add_message(channel, log_time=round((T0 + log) * 1e9), publish_time=7, data=data)
        writer.finish()


Z = {"position": "/pose.pose.position.z", "force": "/ft.wrench.force.z"}


def test_two_writers_of_one_topic_are_one_channel(tmp_path):
    raw_bag(tmp_path / "a.mcap", [(i / 10, i / 10, i) for i in range(40)], twice=True)
    (recording,) = read(tmp_path / "a.mcap", Columns(**Z))
    assert recording["hand.position"].values[:, 0].tolist() == list(range(40))
    assert recording["hand.force"].values[:, 0].tolist() == [-i for i in range(40)]


def test_messages_out_of_log_order_are_sorted_and_it_is_said(tmp_path):
    rows = [(i / 10, i / 10, i) for i in range(40)]
    rows[10], rows[11], rows[30], rows[33] = rows[11], rows[10], rows[33], rows[30]
    raw_bag(tmp_path / "a.mcap", rows)
    (recording,) = read(tmp_path / "a.mcap", Columns(**Z))
    assert recording["hand.position"].values[:, 0].tolist() == list(range(40))
    assert (np.diff(recording["hand.position"].time) > 0).all()
    assert "/pose: 3 messages were not in order of log time: sorted" in notes_of(recording)


def test_headers_that_stand_still_give_way_to_the_log_and_the_clock_can_be_asked_for(tmp_path):
    raw_bag(tmp_path / "a.mcap", [(i / 10, 3.0, i) for i in range(40)])
    (recording,) = read(tmp_path / "a.mcap", Columns(**Z))
    assert np.allclose(recording["hand.position"].time, T0 + np.arange(40) / 10, atol=1e-6)
    assert "its headers stand still" in notes_of(recording)
    (asked,) = read(tmp_path / "a.mcap", Columns(**Z, time="header"))
    assert set(asked["hand.position"].time) == {T0 + 3.0}


def test_the_clock_of_the_log_and_no_clock_are_what_was_asked_for(tmp_path):
    raw_bag(tmp_path / "a.mcap", [(i / 10, i / 20, i) for i in range(40)])
    for clock, time in ((None, T0 + np.arange(40) / 20), ("log", T0 + np.arange(40) / 10), ("none", np.arange(40) / 50)):
        rate = 50.0 if clock == "none" else None
        (recording,) = read(tmp_path / "a.mcap", Columns(**Z, time=clock, rate_hz=rate))
        assert np.allclose(recording["hand.position"].time, time, atol=1e-6), clock
    with pytest.raises(ParameterError, match="time 'z' is no clock of a bag; allowed: header, log, publish, or none"):
        read(tmp_path / "a.mcap", Columns(**Z, time="z"))
    with pytest.raises(ParameterError, match="state the rate"):
        read(tmp_path / "a.mcap", Columns(**Z, time="none"))


def test_no_clock_is_refused_where_channels_have_different_numbers_of_frames(tmp_path):
    write_folder(tmp_path / "bag", lifting())
    with pytest.raises(ChannelError, match="different numbers of frames"):
        read(tmp_path / "bag", Columns(position="pose.position.z", force="wrench.force.z", time="none", rate_hz=100))


def test_a_file_without_a_summary_is_whole(tmp_path):
    raw_bag(tmp_path / "a.mcap", [(i / 10, i / 10, i) for i in range(40)], summary=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (recording,) = read(tmp_path / "a.mcap", Columns(**Z))
    assert len(recording["hand.position"].time) == 40


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_picture_that_nobody_asked_for_is_passed_over(tmp_path, compression):
    from mcap.writer import CompressionType, Writer

    kind = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}[compression]
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = Writer(out, compression=kind, chunk_size=64 << 20)
        writer.start(profile="ros2", library="somebody")
        image = writer.register_channel("/camera", "cdr", writer.register_schema("my/msg/Blob", "ros2msg", b"uint8[] data"))
        one = writer.register_channel("/z", "cdr", writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data"))
        for i in range(10):
            writer.add_message(one, log_time=i * 10**8, publish_time=0, data=b"\0\1\0\0" + np.float64(i).tobytes())
            if i == 5:
                writer.add_message(
                    image,
                    log_time=i * 10**8,
                    publish_time=0,
                    data=b"\0\1\0\0" + (17 << 20).to_bytes(4, "little") + bytes(17 << 20),
                )
        writer.finish()
    (recording,) = read(tmp_path / "a.mcap", Columns(position="/z"))
    assert recording["hand.position"].values[:, 0].tolist() == list(range(10))
    assert "/camera: messages of up to 17 MB left out" in notes_of(recording)


def test_an_empty_bag_is_called_empty(tmp_path):
    raw_bag(tmp_path / "a.mcap", [])
    with pytest.raises(RecordingError, match="the bag is empty"):
        read(tmp_path / "a.mcap")


# Frames -------------------------------------------------------------------------------------------------------------------


def about_x(angle):
    return (np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0)


def seen_by(angle, vector):
    """A vector as a sensor reads it that is turned about x by `angle`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) @ vector


def swinging(frames):
    """The hand turns about x while it lifts, and the sensor turns with it."""
    angle = lambda t: 0.4 * np.sin(t)  # noqa: E731
    return lifting(frames, turn=lambda t: about_x(angle(t)), force_turn=lambda t, f: seen_by(angle(t), f))


def test_a_wrench_in_the_sensors_frame_is_turned_by_the_recorded_orientation(tmp_path):
    write_folder(tmp_path / "bag", swinging(("sensor", "base", "base")))
    (refused,) = read(tmp_path / "bag")
    with pytest.raises(ChannelError, match=r"is in frame 'sensor', the position in 'base'.*--frame sensor="):
        demonstrations([refused])
    (recording,) = read(tmp_path / "bag", Columns(frames={"sensor": "hand"}))
    _, dx, _ = minimum_jerk(np.arange(2001) / 500)
    assert np.allclose(recording["/ft.wrench.force"].values, np.column_stack([0.5 + 0 * dx, -0.25 + 0 * dx, 25 * dx]), atol=1e-4)
    assert recording["hand.force"].frame == "base"
    assert "force /ft.wrench.force turned into frame base (sensor -> base)" in notes_of(recording)
    demonstrations([recording])


def test_a_turn_and_its_negative_are_one_turn(tmp_path):
    angle = lambda t: 0.4 * np.sin(t)  # noqa: E731

    def either(t):  # recorders write q or -q as it comes: here two of each, in turn
        sign = -1.0 if round(100 * t) // 2 % 2 else 1.0
        return tuple(sign * part for part in about_x(angle(t)))

    rows = lifting(("sensor", "base", "base"), turn=either, force_turn=lambda t, f: seen_by(angle(t), f))
    write_folder(tmp_path / "bag", rows)
    (recording,) = read(tmp_path / "bag", Columns(frames={"sensor": "hand"}))
    _, dx, _ = minimum_jerk(np.arange(2001) / 500)
    turned = recording["/ft.wrench.force"].values
    assert np.allclose(turned, np.column_stack([0.5 + 0 * dx, -0.25 + 0 * dx, 25 * dx]), atol=1e-4)


def test_a_stated_turn_is_held_fast_and_its_inverse_is_not(tmp_path):
    write_folder(tmp_path / "bag", lifting(("sensor", "base", "base"), force_turn=lambda t, f: seen_by(0.7, f)))
    (recording,) = read(tmp_path / "bag", Columns(frames={"sensor": ",".join(map(str, about_x(0.7)))}))
    _, dx, _ = minimum_jerk(np.arange(2001) / 500)
    assert np.allclose(recording["/ft.wrench.force"].values[:, 2], 25 * dx, atol=1e-12)
    (wrong,) = read(tmp_path / "bag", Columns(frames={"sensor": ",".join(map(str, about_x(-0.7)))}))
    assert np.abs(wrong["/ft.wrench.force"].values[:, 2] - 25 * dx).max() > 1.0
    with pytest.raises(ParameterError, match="allowed: same, hand, or a quaternion"):
        read(tmp_path / "bag", Columns(frames={"sensor": "sideways"}, position="pose.position.z", force="wrench.force.z"))


def test_transforms_in_the_bag_turn_along_their_chain(tmp_path):
    tf = [("/tf_static", 0.0, make("tf2_msgs/msg/TFMessage", transforms=[transform(0.0, "hand", "sensor", about_x(0.3))]))]
    tf += [
        ("/tf", t, make("tf2_msgs/msg/TFMessage", transforms=[transform(t, "hand", "base", about_x(-0.5 * t))]))
        for t in np.arange(0, 4.01, 0.02)
    ]
    write_folder(tmp_path / "bag", [*lifting(("sensor", "base", "base"), force_turn=lambda t, f: seen_by(0.5 * t + 0.3, f)), *tf])
    (recording,) = read(tmp_path / "bag")
    _, dx, _ = minimum_jerk(np.arange(2001) / 500)
    assert np.allclose(recording["/ft.wrench.force"].values[:, 2], 25 * dx, atol=1e-5)
    assert "(sensor -> hand -> base)" in notes_of(recording)


def test_three_frames_are_refused_and_the_twist_of_odometry_is_the_childs(tmp_path):
    write_folder(tmp_path / "three", lifting(("ft", "base", "tcp")))
    with pytest.raises(ChannelError, match="is in frame 'tcp', the position in 'base'"):
        read(tmp_path / "three", Columns(position="pose.position.z", velocity="twist.linear.z"))
    rows = []
    for i in range(50):
        body = make("geometry_msgs/msg/PoseWithCovariance", covariance=np.zeros(36), pose=make(
            "geometry_msgs/msg/Pose", position=vector(0, 0, i, kind="Point"),
            orientation=quaternion(*about_x(np.pi / 2))))  # fmt: skip
        speed = make("geometry_msgs/msg/TwistWithCovariance", covariance=np.zeros(36), twist=twist(0, (0, 1, 0)).twist)
        rows.append(("/odom", i / 10, make(
            "nav_msgs/msg/Odometry", header=bags.header(i / 10, "odom"), child_frame_id="body",
            pose=body, twist=speed)))  # fmt: skip
    write_folder(tmp_path / "odom", rows)
    (recording,) = read(tmp_path / "odom")
    assert np.allclose(recording["hand.velocity"].values, 1.0)  # y of the body is up
    assert recording["hand.velocity"].frame == "odom"


def test_our_own_recordings_in_two_frames_are_no_lesson(tmp_path):
    from dataclasses import replace

    from comanip.formats import write
    from lifts import lift

    recording = lift()
    recording = recording.with_channels({"hand.force": replace(recording["hand.force"], frame="wrist")})
    write(recording, tmp_path / "a.mcap")
    with pytest.raises(ChannelError, match="different frames"):
        demonstrations(read(tmp_path / "a.mcap"))


# Files of a bag -----------------------------------------------------------------------------------------------------------


def test_a_bag_of_sqlite_without_definitions_and_without_metadata_is_read(tmp_path):
    write_folder(tmp_path / "bag", lifting(), "SQLITE3", version=8)
    (file,) = (tmp_path / "bag").glob("*.db3")
    base = sqlite3.connect(file)
    base.execute("DROP TABLE IF EXISTS message_definitions")
    base.commit()
    base.close()
    (recording,) = read(file)
    assert len(recording["hand.force"].time) == 2001


def test_a_bag_that_misses_a_file_or_messages_is_refused(tmp_path):
    write_folder(tmp_path / "bag", lifting(), "SQLITE3")
    (file,) = (tmp_path / "bag").glob("*.db3")
    base = sqlite3.connect(file)
    base.execute("DELETE FROM messages WHERE id > 2000")
    base.commit()
    base.close()
    with pytest.raises(RecordingError, match=r"metadata.yaml says 2803 messages, 2000 are in the files; recover=True"):
        read(tmp_path / "bag")
    with pytest.warns(match="2000 are in the files"):
        assert "hand.force" in read(tmp_path / "bag", recover=True)[0]
    file.unlink()
    with pytest.raises(RecordingError, match="which is not there"):
        read(tmp_path / "bag")


def test_files_of_a_split_bag_are_one_recording(tmp_path):
    rows = [row for row in lifting() if row[0] == "/ee_pose"]
    write_folder(tmp_path / "bag", rows[:200])
    write_folder(tmp_path / "second", rows[200:])
    (second,) = (tmp_path / "second").glob("*.mcap")
    second.rename(tmp_path / "bag" / "bag_1.mcap")
    path = tmp_path / "bag" / "metadata.yaml"
    name = next(p.name for p in (tmp_path / "bag").glob("*.mcap") if p.name != "bag_1.mcap")
    path.write_text(
        path.read_text()
        .replace(f"  - {name}\n", f"  - {name}\n  - bag_1.mcap\n")
        .replace("message_count: 200", "message_count: 401")
    )
    (recording,) = read(tmp_path / "bag")
    assert np.allclose(recording["hand.position"].values[:, 0], 0.8 + minimum_jerk(np.arange(401) / 100)[0], atol=1e-15)


@pytest.mark.parametrize("name", ["../x.mcap", "/etc/passwd"])
def test_metadata_that_point_elsewhere_are_refused(tmp_path, name):
    write_folder(tmp_path / "bag", lifting()[:50])
    path = tmp_path / "bag" / "metadata.yaml"
    (file,) = (tmp_path / "bag").glob("*.mcap")
    path.write_text(path.read_text().replace(file.name, name))
    with pytest.raises(RecordingError, match="allowed: files beside it"):
        read(tmp_path / "bag")


def test_other_databases_are_named(tmp_path):
    base = sqlite3.connect(tmp_path / "a.db3")
    base.execute("CREATE TABLE shop (id INTEGER)")
    base.commit()
    base.close()
    with pytest.raises(RecordingError, match="without the tables of a bag"):
        read(tmp_path / "a.db3")


# The decoder --------------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(frame=st.text(max_size=9), names=st.lists(st.text(max_size=5), max_size=4), numbers=st.lists(st.floats(), max_size=5))
def test_every_message_is_read_as_others_write_it(frame, names, numbers):
    frame, names = frame.replace("\0", ""), [n.replace("\0", "").encode("utf-8", "ignore").decode() for n in names]
    frame = frame.encode("utf-8", "ignore").decode()
    empty = np.array([], dtype=float)
    message = make(
        "sensor_msgs/msg/JointState", header=bags.header(1.5, frame), name=names, position=np.array(numbers, float),
        velocity=empty,
        effort=np.array(numbers[::-1], float),
    )  # fmt: skip
    for little in (True, False):
        data = bytes(bags.TYPES.serialize_cdr(message, message.__msgtype__, little_endian=little))
        shape = Decoder("sensor_msgs/msg/JointState", DEFINITIONS["sensor_msgs/JointState"]).shape(data)
        found = {b.path: values(table(shape, [data]), b)[0] for b in shape.blocks}
        assert np.array_equal(found.get("position", empty), message.position, equal_nan=True)
        assert np.array_equal(found.get("effort", empty), message.effort, equal_nan=True)
        assert found["header.stamp.sec"][0] == T0 + 1
        assert shape.texts["header.frame_id"] == frame
        assert [shape.texts[f"name[{i}]"] for i in range(len(names))] == names


def test_a_message_cut_anywhere_or_with_a_lying_length_is_an_error():
    data = bytes(bags.TYPES.serialize_cdr(pose(0, (1, 2, 3)), "geometry_msgs/msg/PoseStamped"))
    for cut in range(len(data)):
        with pytest.raises(RecordingError):
            Decoder("geometry_msgs/msg/PoseStamped", DEFINITIONS["geometry_msgs/PoseStamped"]).shape(data[:cut])
    lying = data[:12] + b"\xff\xff\xff\x7f" + data[16:]
    with pytest.raises(RecordingError, match="declares 2147483647 entries"):
        Decoder("geometry_msgs/msg/PoseStamped", DEFINITIONS["geometry_msgs/PoseStamped"]).shape(lying)


def test_two_sequences_that_change_places_are_two_shapes():
    """As many bytes, other lengths: read by the first one's shape, b would begin with a's last number."""
    decoder = Decoder("x/msg/Two", "float64[] a\nfloat64[] b\n")

    def message(a, b):
        parts = (
            struct.pack("<I", len(n)) + b"\0" * (-(4 + at) % 8) + struct.pack(f"<{len(n)}d", *n)
            for at, n in ((0, a), (8 * len(a), b))
        )
        return b"\0\1\0\0" + b"".join(parts)

    for a, b in (([1.0], [2.0, 3.0]), ([1.0, 2.0], [3.0]), ([4.0], [5.0, 6.0])):
        shape = decoder.shape(message(a, b))
        found = {block.path: values(table(shape, [message(a, b)]), block)[0].tolist() for block in shape.blocks}
        assert found == {"a": a, "b": b}


@pytest.mark.parametrize(("kind", "length"), [("float64[<=3]", -1), ("float64[]", -1), ("float64[3]", 3), ("float64", None)])
def test_a_bounded_sequence_is_a_sequence_and_no_array(kind, length):
    (field,) = parsed("x/msg/One", f"{kind} a")["x/One"]
    assert (field.name, field.type, field.length) == ("a", "float64", length)
