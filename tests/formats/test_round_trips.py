"""Every format that is written, and every pair of them: what both can hold comes back to the last bit."""

from __future__ import annotations

import json
import re
import shutil
import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ComanipError, ParameterError, RecordingError
from comanip.formats import FORMATS, Columns, read, write, write_all
from comanip.formats.events import events, with_events
from comanip.lessons.demonstration import demonstrations
from comanip.recording import Channel, Recording
from lifts import lift

GOLDEN = Path(__file__).parents[1] / "golden"
EXACT = [".csv", ".parquet", ".hdf5", ".lerobot", ".mcap"]


def full(frames=120, rate_hz=100, start=2.0):
    """A recording with every group: pose, twist, wrench with torque, orientation, NaN, infinite and huge numbers, events."""
    rng = np.random.default_rng(5)
    time = start + np.arange(frames) / rate_hz
    turns = rng.normal(size=(frames, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    force = rng.normal(size=(frames, 3)) * 10.0 ** rng.integers(-300, 300, size=(frames, 3))
    force[3] = np.nan, np.inf, -0.0
    xyz = ("x", "y", "z")
    recording = Recording(
        {
            "hand.position": Channel(time, rng.normal(size=(frames, 3)), "m", "base", xyz),
            "hand.velocity": Channel(time, rng.normal(size=(frames, 3)), "m/s", "base", xyz),
            "hand.force": Channel(time, force, "N", "base", xyz),
            "hand.torque": Channel(time, rng.normal(size=(frames, 3)), "N m", "sensor", xyz),
            "hand.orientation": Channel(time, turns, "", "base", ("w", "x", "y", "z")),
            "joint ü": Channel(time, rng.normal(size=(frames, 2)), "rad", "", ("a/b", "c,d")),
        },
        {"role": "leader", "task": "lift", "name": "one", "seed": 3, "nested": {"a": [1, 2.5, None]}},
    )
    return with_events(
        recording, [(start, "start"), (start + 0.505, "leads: robot"), (start + 1.1, "mark <b>"), (start + 1.15, "start")]
    )


def assert_same(a, b, stamps=0.0):
    assert list(a.channels) == list(b.channels)
    for name, channel in a.channels.items():
        other = b[name]
        assert channel.values.tobytes() == other.values.tobytes() or np.array_equal(
            channel.values, other.values, equal_nan=True
        ), name
        assert np.abs(channel.time - other.time).max(initial=0.0) <= stamps, name
        assert (channel.unit, channel.frame, channel.axes) == (other.unit, other.frame, other.axes)
    assert events(a) == events(b) if not stamps else [e.label for e in events(a)] == [e.label for e in events(b)]
    assert {k: b.metadata[k] for k in a.metadata if k != "source"} == {k: v for k, v in a.metadata.items() if k != "source"}


@pytest.mark.parametrize(("first", "second"), product(EXACT, EXACT))
def test_every_format_to_every_other_keeps_everything(tmp_path, first, second):
    pytest.importorskip("pyarrow")
    pytest.importorskip("h5py")
    write(full(), tmp_path / f"a{first}")
    (there,) = read(tmp_path / f"a{first}")
    write(there, tmp_path / f"b{second}")
    (back,) = read(tmp_path / f"b{second}")
    assert_same(full(), back, 1e-9 if ".mcap" in (first, second) else 0.0)


@pytest.mark.parametrize("suffix", [s for s in EXACT if s != ".lerobot"])
def test_channels_of_several_rates_and_empty_ones_come_back(tmp_path, suffix):
    fast, slow = np.arange(500) / 1000, np.arange(40) / 100
    recording = Recording(
        {
            "hand.force": Channel(fast, np.sin(fast), "N", "base", ("z",)),
            "hand.position": Channel(slow, np.cos(slow), "m", "base", ("z",)),
            "empty": Channel([], np.empty((0, 2)), "rad", "", ("a", "b")),
        },
        {"name": "x"},
    )
    write(recording, tmp_path / f"a{suffix}")
    assert_same(recording, read(tmp_path / f"a{suffix}")[0], 1e-9)


def test_a_data_set_of_one_rate_refuses_several_and_says_how(tmp_path):
    pytest.importorskip("pyarrow")
    recording = lift().with_channels({"hand.force": Channel(np.arange(4001) / 1000, np.zeros(4001), "N", "task", ("z",))})
    with pytest.raises(RecordingError, match=r"hand.force and hand.position have different stamps.*--resample-hz"):
        write(recording, tmp_path / "a.lerobot")
    assert not (tmp_path / "a.lerobot").exists()
    with pytest.raises(RecordingError, match="100 Hz, 200 Hz; a data set has one rate"):
        write_all([lift(), lift(rate_hz=200)], tmp_path / "a.lerobot")


@pytest.mark.parametrize("suffix", [".hdf5", ".lerobot"])
def test_several_recordings_in_one_come_back_in_their_order(tmp_path, suffix):
    pytest.importorskip("pyarrow")
    pytest.importorskip("h5py")
    several = [lift(seed, duration_s=4.0 + 0.1 * seed) for seed in range(12)]
    write_all(several, tmp_path / f"a{suffix}")
    for a, b in zip(several, read(tmp_path / f"a{suffix}"), strict=True):
        assert_same(a, b)
    assert len(demonstrations(read(tmp_path / f"a{suffix}"))) == 12
    with pytest.raises(ParameterError, match=r"12 recordings, and a .csv file holds one"):
        write_all(several, tmp_path / "a.csv")


@pytest.mark.parametrize("suffix", [s for s in EXACT if s not in (".csv", ".mcap")])
def test_a_changed_number_is_noticed(tmp_path, suffix):
    """The file is well-formed, and one of its numbers is another."""
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    h5py = pytest.importorskip("h5py")
    path = tmp_path / f"a{suffix}"
    write(lift(), path)
    if suffix == ".hdf5":
        with h5py.File(path, "r+") as file:
            file["data/demo_0/obs/hand.force"][7] += 1e-12
    else:
        inner = path if path.is_file() else next(path.glob("data/**/*.parquet"))
        found = parquet.read_table(inner)
        name = "hand.force.z" if path.is_file() else "observation.state"
        column = found.column(name).to_pylist()
        column[7] = column[7] + 1e-12 if path.is_file() else [column[7][0], column[7][1] + 1e-12, *column[7][2:]]
        at = found.column_names.index(name)
        parquet.write_table(found.set_column(at, found.field(at), arrow.array(column, type=found.field(at).type)), inner)
    with pytest.raises(RecordingError, match=r"sha256.* does not match: some byte was changed"):
        read(path)


@pytest.mark.parametrize("suffix", [s for s in EXACT if s not in (".csv", ".lerobot")])
def test_a_flipped_bit_is_an_error_a_note_or_no_change(tmp_path, suffix):
    pytest.importorskip("pyarrow")
    pytest.importorskip("h5py")
    path, rng = tmp_path / f"a{suffix}", np.random.default_rng(4)
    write(lift(), path)
    (whole,) = read(path)
    data, refused = path.read_bytes(), 0
    for _ in range(150):
        bad = bytearray(data)
        bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
        path.write_bytes(bad)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                (found,) = read(path)
            except ComanipError as error:
                assert "\n" not in str(error)
                refused += 1
                continue
        if "notes" not in found.metadata:
            assert_same(whole, found)
    assert refused > 30


# Golden files: never written again; a new version of a format gets new ones -------------------------------------------------


def golden_recording():
    time = np.arange(5) / 100
    recording = Recording(
        {
            "hand.position": Channel(time, 0.8 + 0.125 * time, "m", "base", ("z",)),
            "hand.force": Channel(time, [[1.5], [-2.25], [0.1], [3e-300], [7.0]], "N", "base", ("z",)),
            "hand.torque": Channel(time, np.outer(time, [1.0, 2.0, -0.5]), "N m", "base", ("x", "y", "z")),
            "hand.orientation": Channel(time, np.tile([0.6, 0.8, 0.0, 0.0], (5, 1)), "", "base", ("w", "x", "y", "z")),
        },
        {"role": "follower", "name": "golden", "task": "lift"},
    )
    return with_events(recording, [(0.0, "start"), (0.03, "stop")])


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("recording-v*")), ids=lambda p: p.name)
def test_golden_files_of_every_version_are_read(path):
    if path.suffix in (".parquet", ".lerobot"):
        pytest.importorskip("pyarrow")
    if path.suffix == ".hdf5":
        pytest.importorskip("h5py")
    (found,) = read(path)
    assert_same(golden_recording(), found)


def test_there_is_a_golden_file_for_every_format_that_is_written():
    written = {form.suffixes[0] for form in FORMATS if form.writes}
    assert {p.suffix for p in GOLDEN.glob("recording-v*")} == written


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".hdf5", ".lerobot"])
def test_a_file_of_a_newer_version_says_so(tmp_path, suffix):
    pytest.importorskip("pyarrow")
    path = tmp_path / f"a{suffix}"
    write(lift(), path)
    if suffix == ".csv":
        path.write_text(re.sub(r'"version": \d', '"version": 9', path.read_text(), count=1))
    elif suffix == ".lerobot":
        side = json.loads((path / "meta/comanip.json").read_text())
        (path / "meta/comanip.json").write_text(json.dumps({**side, "version": 9}))
    elif suffix == ".hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "r+") as file:
            head = bytes(file["comanip"][()]).replace(b'"version": 1', b'"version": 9')
            del file["comanip"]
            file["comanip"] = np.frombuffer(head, dtype=np.uint8)
    else:
        parquet = pytest.importorskip("pyarrow.parquet")
        table = parquet.read_table(path)
        head = {k: v.replace(b'"version": 1', b'"version": 9') for k, v in table.schema.metadata.items()}
        parquet.write_table(table.replace_schema_metadata(head), path)
    with pytest.raises(RecordingError, match="written as version 9; this comanip reads up to"):
        read(path)


def test_a_format_costs_its_file_and_one_line(tmp_path, monkeypatch):
    import sys
    import types

    from comanip import formats

    module = types.ModuleType("comanip_test_format")
    module.load = lambda path, data, columns, recover: [lift().with_metadata(name=path.stem)]
    module.store = lambda recordings, path: path.write_bytes(b"TEST")
    monkeypatch.setitem(sys.modules, "a.comanip_test_format", module)
    form = formats.Format("test", "a.comanip_test_format:load", "a.comanip_test_format:store", (b"TEST",), (".test",))
    monkeypatch.setattr(formats.doors, "FORMATS", (form, *formats.FORMATS))
    write(lift(), tmp_path / "a.test")
    assert read(tmp_path / "a.test")[0].metadata["name"] == "a"
    with pytest.raises(ParameterError, match=r"allowed: \.test, \.mcap"):
        write(lift(), tmp_path / "a.nothing")


def test_a_file_that_is_there_is_not_half_replaced_when_writing_fails(tmp_path):
    pytest.importorskip("pyarrow")
    for suffix in (".parquet", ".hdf5", ".mcap"):
        path = tmp_path / f"a{suffix}"
        write(lift(), path)
        before = path.read_bytes()
        with pytest.raises(RecordingError, match="plain JSON"):
            write(lift().with_metadata(bad=object()), path)
        assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.hdf5", "a.mcap", "a.parquet"]


def test_time_none_reaches_our_own_files(tmp_path):
    pytest.importorskip("pyarrow")
    for suffix in EXACT:
        write(lift(), tmp_path / f"a{suffix}")
        (found,) = read(tmp_path / f"a{suffix}", Columns(time="none", rate_hz=50))
        assert np.array_equal(found["hand.force"].time, np.arange(401) / 50), suffix
    shutil.rmtree(tmp_path / "a.lerobot")
    assert replace(found["hand.force"], unit="N").unit == "N"
