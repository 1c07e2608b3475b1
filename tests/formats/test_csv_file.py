"""Text tables as people write them: generous where nothing is ambiguous, strict where it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comanip.errors import ChannelError, RecordingError
from comanip.formats import Columns, read, write
from comanip.lessons.demonstration import demonstration
from comanip.recording import Channel, Recording
from lifts import lift, minimum_jerk

MAPPING = Columns(position="z", velocity="vz", force="Fz", rate_hz=100)


def table(frames=401):
    time = np.arange(frames) / 100
    x, dx, _ = minimum_jerk(time)
    return np.column_stack([time, 0.8 + x, dx, 25.0 * dx])


def text(header="time,z,vz,Fz", separator=",", decimal=".", end="\n"):
    rows = [separator.join(repr(v).replace(".", decimal) for v in row) for row in table().tolist()]
    return end.join([header.replace(",", separator), *rows]) + end


@pytest.mark.parametrize(
    "content",
    [
        text(),
        text(separator=";"),
        text(separator="\t"),
        text(separator=" "),
        text(separator="   "),
        text(end="\r\n"),
        text(separator=";", decimal=","),
        "\ufeff" + text(),
        "# lifted on Monday; by two\n% and so on\n" + text(),
        text("# time,z,vz,Fz"),
        text("Time [s],Z [m],VZ [m/s],FZ [N]"),
        text("time (s),z (m),vz (m/s),Fz (N)"),
        text("t,pos_z,vel_z,force_z"),
        text("timestamp,position,velocity,force"),
        text('"time","z","vz","Fz"'),
        text().replace("time,z,vz,Fz\n", "time,z,vz,Fz\ns,m,m/s,N\n"),
        "\n" + text() + "\n\n",
    ],
)
def test_obvious_tables_need_no_mapping(tmp_path, content):
    path = tmp_path / "a.csv"
    path.write_bytes(content.encode())
    (recording,) = read(path)
    for name, column in (("position", 1), ("velocity", 2), ("force", 3)):
        assert np.array_equal(recording[f"hand.{name}"].values[:, 0], table()[:, column])
        assert recording[f"hand.{name}"].axes == ("z",)
    assert demonstration(recording).dt == 0.01
    assert any("taken as force" in n for n in recording.metadata["notes"])


def test_an_index_column_does_no_harm(tmp_path):
    path = tmp_path / "a.csv"
    lines = text().splitlines()
    path.write_text("\n".join([f",{lines[0]}", *(f"{i},{line}" for i, line in enumerate(lines[1:]))]))
    assert np.array_equal(read(path)[0]["hand.force"].values[:, 0], table()[:, 3])


def test_columns_of_words_do_no_harm(tmp_path):
    path = tmp_path / "a.csv"
    lines = text().splitlines()
    path.write_text("\n".join([f"{lines[0]},phase", *(f"{line},lift" for line in lines[1:])]))
    assert demonstration(read(path)[0]).dt == 0.01


def test_utf16_of_a_spreadsheet_is_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text(separator="\t"), encoding="utf-16")
    assert np.array_equal(read(path)[0]["hand.force"].values[:, 0], table()[:, 3])


def test_headers_in_other_words_are_mapped_and_said(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text("Zeit,Hoehe,Tempo,Kraft"))
    with pytest.raises(RecordingError, match=r"no time column among Zeit, Hoehe, Tempo, Kraft"):
        read(path)
    columns = Columns(position="Hoehe", velocity="Tempo", force="-Kraft", time="Zeit", role="leader")
    (recording,) = read(path, columns)
    assert np.array_equal(recording["hand.force"].values[:, 0], -table()[:, 3])
    assert recording.metadata["role"] == "leader"
    assert any("taken to be in N" in n for n in recording.metadata["notes"])


def test_columns_may_be_numbers_when_there_is_no_header(tmp_path):
    path = tmp_path / "a.txt"
    np.savetxt(path, table())
    (recording,) = read(path, Columns(time="0", position="1", velocity="2", force="3"))
    assert np.array_equal(recording["hand.velocity"].values[:, 0], table()[:, 2])


def test_without_stamps_the_stated_rate_makes_them(tmp_path):
    path = tmp_path / "a.csv"
    np.savetxt(path, table()[:, 1:], delimiter=",", header="z,vz,Fz", comments="")
    with pytest.raises(RecordingError, match=r"state the rate"):
        read(path, Columns(position="z"))
    lesson = demonstration(read(path, MAPPING)[0])
    assert lesson.dt == 0.01
    assert lesson.channels == ("position.z", "force.z", "velocity.z")
    assert any("frame i is taken to be at i / 100 s" in n for n in lesson.notes)


def test_jittered_stamps_are_put_on_a_regular_grid_and_said(tmp_path):
    path, rng = tmp_path / "a.csv", np.random.default_rng(1)
    rows = table()
    rows[:, 0] += 0.003 * rng.uniform(-1, 1, len(rows))
    x, dx, _ = minimum_jerk(rows[:, 0])
    rows[:, 1:] = np.column_stack([0.8 + x, dx, 25 * dx])
    np.savetxt(path, rows, delimiter=",", header="time,z,vz,Fz", comments="")
    lesson = demonstration(read(path)[0])
    assert lesson.dt == 0.01
    assert any("with stamps up to 3" in n or "with stamps up to 2" in n for n in lesson.notes)
    grid = rows[0, 0] + lesson.dt * np.arange(len(lesson))
    assert np.abs(lesson.position[:, 0] - 0.8 - minimum_jerk(grid)[0]).max() < 1e-4


def test_a_frame_counter_is_not_taken_for_seconds(tmp_path):
    path = tmp_path / "a.csv"
    rows = table()
    rows[:, 0] = np.arange(len(rows))
    np.savetxt(path, rows, delimiter=",", header="t,z,vz,Fz", comments="")
    with pytest.raises(RecordingError, match="frame counter"):
        demonstration(read(path, MAPPING)[0])
    lesson = demonstration(read(path, Columns(position="z", force="Fz", rate_hz=100, time="none"))[0])
    assert np.array_equal(lesson.position[:, 0], rows[:, 1])


@pytest.mark.parametrize(
    ("header", "flags"),
    [
        ("time,z,vz,Fz", {"position_unit": "mm", "force_unit": "mN", "velocity_unit": "mm/s", "time_unit": "ms"}),
        ("time [ms],z [mm],vz [mm/s],Fz [mN]", {}),
        ("time_ms,z_mm,vz_mm_s,Fz_mN", {}),
    ],
)
def test_units_are_converted_and_said(tmp_path, header, flags):
    path = tmp_path / "a.csv"
    np.savetxt(path, 1e3 * table(), delimiter=",", header=header, comments="")
    (recording,) = read(path, Columns(**flags))
    assert np.allclose(recording["hand.force"].values[:, 0], table()[:, 3], rtol=1e-12)
    assert (recording["hand.position"].unit, recording["hand.force"].unit) == ("m", "N")
    assert demonstration(recording).dt == 0.01
    assert any("hand.position converted from mm to m" in n for n in recording.metadata["notes"])


def test_the_unit_in_a_header_counts_however_the_column_is_named(tmp_path):
    path = tmp_path / "a.csv"
    np.savetxt(path, 1e3 * table(), delimiter=",", header="time [ms],z [mm],vz [mm/s],Fz [mN]", comments="")
    for position, force, time in (
        ("z", "Fz", "time"),
        ("Z", "fz", "TIME"),
        ("1", "3", "0"),
        ("z [mm]", "Fz [mN]", "time [ms]"),
    ):
        (recording,) = read(path, Columns(position=position, force=force, time=time))
        assert np.allclose(recording["hand.position"].values[:, 0], table()[:, 1], rtol=1e-12)
        assert np.allclose(recording["hand.force"].values[:, 0], table()[:, 3], rtol=1e-12)
        assert np.allclose(recording["hand.force"].time, table()[:, 0], rtol=1e-12)


def test_a_header_in_a_comment_may_use_other_separators(tmp_path):
    path = tmp_path / "a.csv"
    np.savetxt(path, table(), delimiter=",", header="time z vz Fz")
    assert np.array_equal(read(path)[0]["hand.force"].values[:, 0], table()[:, 3])


def test_a_wrong_name_lists_the_columns_and_guesses(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text())
    with pytest.raises(ChannelError, match=r"a.csv: no column 'Fx'; did you mean 'Fz'\? there are: time, z, vz, Fz"):
        read(path, Columns(position="z", force="Fx"))


def test_a_cell_that_is_no_number_is_named_with_line_and_frame(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,z\n0,1\n0.1,oops\n")
    with pytest.raises(RecordingError, match=r"column 'z', frame 1 \(line 3\): 'oops' is not a number"):
        read(path)


def test_two_columns_of_one_name_are_not_guessed(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,z,z\n0,1,2\n0.1,1,2\n")
    with pytest.raises(ChannelError, match="both"):
        read(path)
    with pytest.raises(ChannelError, match=r"2 columns are called 'z'; use the index: \[1, 2\]"):
        read(path, Columns(position="z"))
    assert read(path, Columns(position="2"))[0]["hand.position"].values[0, 0] == 2.0


def test_three_axes_and_a_vertical_force_make_a_vertical_lesson(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,z,Fz\n0,1,2,3,4\n0.1,1,2,3,4\n")
    (recording,) = read(path)
    assert recording["hand.position"].axes == ("z",)
    assert any("only axes z" in n for n in recording.metadata["notes"])


def test_our_own_csv_comes_back_exactly_with_several_rates(tmp_path):
    recording = lift(operator="A. B.", seed=3).with_channels({"hand.force": lift(rate_hz=300.0)["hand.force"]})
    write(recording, tmp_path / "a.csv")
    (back,) = read(tmp_path / "a.csv")
    for name, channel in recording.channels.items():
        assert np.array_equal(back[name].time, channel.time)
        assert np.array_equal(back[name].values, channel.values)
        assert (back[name].unit, back[name].frame, back[name].axes) == (channel.unit, channel.frame, channel.axes)
    assert back.metadata["operator"] == "A. B."


NAMES = st.text(min_size=1, max_size=12).filter(lambda s: s.isprintable())
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(names=st.lists(NAMES, min_size=1, max_size=3, unique=True), values=st.lists(VALUES, min_size=1, max_size=5))
def test_any_names_and_values_come_back(tmp_path, names, values):
    time = np.arange(len(values)) / 7.0
    recording = Recording({n: Channel(time, values, "N", "task", ("ä,",)) for n in names}, {"who": names})
    write(recording, tmp_path / "a.csv")
    (back,) = read(tmp_path / "a.csv")
    assert list(back.channels) == names
    assert all(np.array_equal(back[n].values[:, 0], values, equal_nan=True) for n in names)
    assert all(np.array_equal(back[n].time, time) for n in names)
    assert back.metadata["who"] == names
