"""MCAP: exact values, nanosecond stamps, opened by the tools that people have."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comanip.errors import ChannelError, RecordingError
from comanip.formats import Columns, read, write
from comanip.recording import Channel, Recording
from lifts import lift


def several():
    """Channels of every message type, at two rates, one empty."""
    rng, slow, fast = np.random.default_rng(3), np.arange(50) / 100, np.arange(500) / 1000
    return Recording(
        {
            "hand.position": Channel(slow, rng.normal(size=(50, 1)), "m", "task", ("z",)),
            "hand.velocity": Channel(slow, rng.normal(size=(50, 2)), "m/s", "task", ("z", "x")),
            "hand.force": Channel(fast, rng.normal(size=(500, 3)), "N", "wrist", ("x", "y", "z")),
            "skill.weights": Channel(slow, rng.normal(size=(50, 5)), "", "", ()),
            "empty": Channel(np.empty(0), np.empty((0, 2)), "rad", "task", ("a", "b")),
        },
        {"role": "leader", "operator": "Ω", "payload": {"mass_kg": 5.0}, "seed": 7, "notes": ["one"]},
    )


def assert_same(a, b):
    assert set(a.channels) == set(b.channels)
    for name, channel in a.channels.items():
        assert np.array_equal(b[name].values, channel.values, equal_nan=True)
        late = np.abs(b[name].time - channel.time).max(initial=0.0)
        assert late < 0.6e-9 + 2e-16 * np.abs(channel.time).max(initial=0.0)
        assert (b[name].unit, b[name].frame, b[name].axes) == (channel.unit, channel.frame, channel.axes)


def test_a_recording_comes_back_with_every_rate_and_all_metadata(tmp_path):
    write(several(), tmp_path / "a.mcap")
    (back,) = read(tmp_path / "a.mcap")
    assert_same(several(), back)
    assert {k: back.metadata[k] for k in several().metadata} == dict(several().metadata)


def test_decimal_stamps_are_exact(tmp_path):
    write(several(), tmp_path / "a.mcap")
    assert np.array_equal(read(tmp_path / "a.mcap")[0]["hand.force"].time, np.arange(500) / 1000)


def test_stamps_before_zero_and_since_1970_survive(tmp_path):
    for start in (-2.5, 1.7e9):
        time = start + np.arange(20) / 100
        recording = Recording({"hand.position": Channel(time, time, "m", "task", ("z",))})
        write(recording, tmp_path / "a.mcap")
        assert np.abs(read(tmp_path / "a.mcap")[0]["hand.position"].time - time).max() < 3e-7  # float64 at 1.7e9


def test_frames_keep_their_order_when_a_clock_jumps_back(tmp_path):
    time = np.array([0.0, 0.1, 0.05, 0.2])
    write(Recording({"a": Channel(time, [1, 2, 3, 4], "m"), "b": Channel(time, [5, 6, 7, 8], "m")}), tmp_path / "a.mcap")
    (back,) = read(tmp_path / "a.mcap")
    assert back["a"].time.tolist() == time.tolist()
    assert back["a"].values[:, 0].tolist() == [1, 2, 3, 4]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    names=st.lists(st.text(min_size=1, max_size=9), min_size=1, max_size=3, unique=True),
    axes=st.sampled_from([("z",), ("x", "z"), ("y", "x", "z"), ("q", "ü"), ("a b", "c,d", "e")]),
    unit=st.sampled_from(["m", "N", "m/s", "", "rad"]),
    frames=st.integers(0, 4),
    data=st.data(),
)
def test_any_names_values_and_axes_come_back(tmp_path, names, axes, unit, frames, data):
    names = [n.encode("utf-8", "ignore").decode() or "n" for n in names]
    floats = st.floats(allow_nan=True, allow_infinity=True)
    size = frames * len(axes)
    values = np.array(data.draw(st.lists(floats, min_size=size, max_size=size))).reshape(frames, len(axes))
    time = np.sort(data.draw(st.lists(st.floats(0, 1e5), min_size=frames, max_size=frames)))
    recording = Recording({n: Channel(time, values, unit, n[:3], axes) for n in names}, {"names": names})
    write(recording, tmp_path / "a.mcap")
    (back,) = read(tmp_path / "a.mcap")
    assert_same(recording, back)


def test_rosbags_opens_it(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    write(several(), tmp_path / "a.mcap")
    with highlevel.AnyReader([tmp_path / "a.mcap"]) as bag:
        forces = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages() if c.topic == "/hand/force"]
        types = {c.topic: c.msgtype for c in bag.connections}
        weights = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages() if c.topic == "/skill/weights"]
    assert types["/hand/position"] == "geometry_msgs/msg/PointStamped"
    assert types["/hand/velocity"] == "geometry_msgs/msg/Vector3Stamped"
    got = np.array([[f.wrench.force.x, f.wrench.force.y, f.wrench.force.z] for f in forces])
    assert np.array_equal(got, several()["hand.force"].values)
    assert forces[123].header.frame_id == "wrist"
    assert (forces[123].header.stamp.sec, forces[123].header.stamp.nanosec) == (0, 123_000_000)
    assert np.array_equal([w.data for w in weights], several()["skill.weights"].values)
    assert weights[0].layout.dim[0].label == "0,1,2,3,4"


def test_the_ros2_decoder_reads_an_absent_axis_as_nan(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    write(several(), tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as stream:
        bag = reader.make_reader(stream, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        points = [m.point for _, _, _, m in bag.iter_decoded_messages(topics="/hand/position")]
    assert np.array_equal([p.z for p in points], several()["hand.position"].values[:, 0])
    assert np.isnan([p.x for p in points]).all()


def test_a_bag_of_another_program_is_mapped_like_a_table(tmp_path):
    writer = pytest.importorskip("mcap_ros2.writer")
    from comanip.formats.cdr import SCHEMAS

    with (tmp_path / "bag.mcap").open("wb") as stream:
        bag = writer.Writer(stream)
        schema = bag.register_msgdef("geometry_msgs/msg/WrenchStamped", SCHEMAS["geometry_msgs/msg/WrenchStamped"])
        for i in range(40):
            stamp = {"sec": 1 + i // 10, "nanosec": i % 10 * 100_000_000}
            force, torque = ({"x": 1.0 * i, "y": 0.0, "z": 2.0 * i}, {"x": 0.0, "y": 0.0, "z": 0.5})
            message = {"header": {"stamp": stamp, "frame_id": "ft"}, "wrench": {"force": force, "torque": torque}}
            bag.write_message("/ft", schema, message, log_time=i)
        bag.finish()
    (raw,) = read(tmp_path / "bag.mcap")
    assert raw["/ft.wrench.force"].unit == "N"
    (mapped,) = read(tmp_path / "bag.mcap", Columns(force="-/ft.wrench.force.z"))
    assert np.array_equal(mapped["hand.force"].values[:, 0], -2.0 * np.arange(40))
    assert np.allclose(mapped["hand.force"].time, 1 + np.arange(40) / 10)
    with pytest.raises(ChannelError, match=r"did you mean '/ft.wrench.force.z'\?"):
        read(tmp_path / "bag.mcap", Columns(force="/ft.wrench.forc.z"))


def test_metadata_that_is_not_json_is_refused_and_nothing_is_left(tmp_path):
    for name in ("a.mcap", "a.csv"):
        with pytest.raises(RecordingError, match="plain JSON"):
            write(lift().with_metadata(model=object()), tmp_path / name)
    assert [p.name for p in tmp_path.iterdir() if p.stat().st_size] == []


def test_a_newer_file_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("comanip.formats.mcap_file.VERSION", 2)
    write(lift(), tmp_path / "a.mcap")
    monkeypatch.undo()
    with pytest.raises(RecordingError, match="written as version 2; this comanip reads up to 1"):
        read(tmp_path / "a.mcap")


def test_reading_needs_no_heavy_import():
    code = (
        "import sys, comanip.lessons.demonstration, comanip.formats, comanip.interaction, comanip.lessons.alignment\n"
        "print([m for m in ('scipy', 'mcap', 'mcap_ros2', 'rosbags', 'zstandard') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
