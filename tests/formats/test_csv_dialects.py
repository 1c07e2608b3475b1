"""Tables as spreadsheets, R, pandas, LabVIEW, Fortran and people write them: read with the right values, or refused with help."""

from __future__ import annotations

import bz2
import gzip
import lzma

import numpy as np
import pytest

from comanip.errors import ComanipError, RecordingError
from comanip.formats import Columns, read, write
from comanip.lessons.demonstration import demonstration
from lifts import lift, minimum_jerk

MAPPING = Columns(position="z", force="Fz")
TIME = np.arange(401) / 100
HEIGHT, SPEED, _ = minimum_jerk(TIME)
TABLE = np.column_stack([TIME, 0.9 + HEIGHT, 25.0 * SPEED])


def rows(form="{:.3f},{:.6f},{:.4f}"):
    return [form.format(*row) for row in TABLE.tolist()]


def text(head="t,z,Fz", lines=None):
    return "\n".join([head, *(rows() if lines is None else lines)]) + "\n"


def lesson_of(tmp_path, content, columns=MAPPING, **options):
    path = tmp_path / "a.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return demonstration(read(path, columns)[0], **options)


def holds_the_table(lesson, frames=401):
    assert len(lesson) == frames
    assert lesson.dt == 0.01
    assert np.abs(lesson.position[:, 0] - TABLE[:, 1]).max() < 1e-6
    assert np.abs(lesson.force[:, 0] - TABLE[:, 2]).max() < 1e-4


def with_cell(row, cell):
    lines = rows()
    lines[row] += cell
    return [line if i == row else line + "," for i, line in enumerate(lines)]


DIALECTS = {
    "Excel's separator line": "sep=;\n" + text().replace(",", ";"),
    "Excel's separator line, quoted, with tabs": '"sep=\t"\n' + text().replace(",", "\t"),
    "a preamble": "LabVIEW Measurement\nSeparator,Comma\n***End_of_Header***\n" + text(),
    "a preamble with an empty line and units": "Instrument: 3\nDate,Monday\n\n" + text("t,z,Fz\ns,m,N"),
    "a preamble of semicolons above commas": "Serial;17\nOperator;A. B.;day 2\n" + text(),
    "Fortran's exponents": text(lines=[r.replace("E", "D") for r in rows("{:.9E},{:.9E},{:.9E}")]),
    "commas at the end of rows": text(lines=[r + "," for r in rows()]),
    "commas at the end of all lines": text("t,z,Fz,", [r + "," for r in rows()]),
    "a header that ends with a comma": text("t,z,Fz,"),
    "R's row names": text("t z Fz", [f'"{i + 1}" ' + r.replace(",", " ") for i, r in enumerate(rows())]),
    "R's quoted names": text('"t" "z" "Fz"', [r.replace(",", " ") for r in rows()]),
    "pipes": text().replace(",", "|"),
    "a line break in a cell": text("t,z,Fz,note", with_cell(99, ',"two\nlines"')),
    "quotes in a cell": text("t,z,Fz,note", with_cell(99, ',"a ""good"" one"')),
    "a comma in a cell": text("t,z,Fz,note", with_cell(99, ',"here, too"')),
    "quoted numbers": text(lines=['"' + r.replace(",", '","') + '"' for r in rows()]),
    "ISO dates": text("time,z,Fz", [f"2024-05-01 12:00:{t:06.3f},{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "ISO dates with T and zone": text("time,z,Fz", [f"2024-05-01T12:00:{t:06.3f}+02:00,{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "American dates": text("time,z,Fz", [f"5/1/2024 11:59:{50 + t:06.3f} PM,{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "times of day": text("time,z,Fz", [f"12:00:{t:06.3f},{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "minutes and seconds": text("time,z,Fz", [f"03:{t:06.3f},{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "an index of dates without a name": text(",z,Fz", [f"2024-05-01 12:00:{t:06.3f},{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "an index of seconds without a name": text(",z,Fz"),
    "nanoseconds since 1970": text(
        "timestamp,z,Fz", [f"{1764489600 * 10**9 + round(t * 1e9)},{z:.6f},{f:.4f}" for t, z, f in TABLE]
    ),
    "milliseconds since 1970": text("timestamp,z,Fz", [f"{1764489600000 + t * 1e3:.3f},{z:.6f},{f:.4f}" for t, z, f in TABLE]),
    "a minus of a typesetter": text(lines=[r.replace("-", "\u2212") for r in rows()]),
    "gzip": gzip.compress(text().encode()),
    "bzip2": bz2.compress(text().encode()),
    "xz": lzma.compress(text().encode()),
    "two gzip files in one": gzip.compress(text()[:2000].encode()) + gzip.compress(text()[2000:].encode()),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_table_is_read_with_its_values_whoever_wrote_it(tmp_path, dialect):
    holds_the_table(lesson_of(tmp_path, DIALECTS[dialect]))


def test_midnight_in_iso_dates_is_no_step_back(tmp_path):
    lines = [f"2024-05-01 23:59:{58 + t:06.3f}" if t < 2 else f"2024-05-02 00:00:{t - 2:06.3f}" for t in TIME.tolist()]
    content = text("time,z,Fz", [f"{stamp},{z:.6f},{f:.4f}" for stamp, (_, z, f) in zip(lines, TABLE.tolist(), strict=True)])
    holds_the_table(lesson_of(tmp_path, content))


def test_what_was_left_out_above_a_table_is_said(tmp_path):
    lesson = lesson_of(tmp_path, DIALECTS["a preamble"])
    assert "3 lines above the table left out, the first 'LabVIEW Measurement'" in lesson.notes


@pytest.mark.parametrize("word", ["NA", "n/a", "NULL", "#N/A", "-", "<NA>", "None", "1.#QNAN", ""])
def test_a_word_for_nothing_is_a_frame_to_drop_and_not_a_crash(tmp_path, word):
    lines = rows()
    lines[50] = lines[50].rsplit(",", 1)[0] + "," + word
    with pytest.raises(RecordingError, match=r"force: frame 50 \(t = 0.500000 s\) is nan.*drop_bad"):
        lesson_of(tmp_path, text(lines=lines))
    with pytest.warns(match="dropped 1 frames"):
        lesson = lesson_of(tmp_path, text(lines=lines), drop_bad=True)
    assert len(lesson) == 401
    assert np.abs(lesson.position[:, 0] - TABLE[:, 1]).max() < 1e-6


# Thousands and decimal commas ---------------------------------------------------------------------------------------


def millimetres(form, separator=";"):
    return "\n".join(["t;z;Fz".replace(";", separator), *(form(t, 1e3 * z, f) for t, z, f in TABLE.tolist())])


MM = Columns(position="z", force="Fz", position_unit="mm")


@pytest.mark.parametrize(
    "content",
    [
        millimetres(lambda t, z, f: f"{t:.3f};{round(z):,};{f:.4f}"),
        millimetres(lambda t, z, f: f"{t:.3f};{z:,.1f};{f:.4f}"),
        millimetres(lambda t, z, f: f'{t:.3f},"{round(z):,}",{f:.4f}', ","),
        millimetres(lambda t, z, f: f"{t:.3f};{round(z):,};{f:.4f}".translate(str.maketrans(",.", ".,"))),
        millimetres(lambda t, z, f: f"{t:.3f};{z:,.1f};{f:.4f}".translate(str.maketrans(",.", ".,"))),
        millimetres(lambda t, z, f: f"{t:.3f};{round(z):,};{f:.4f}".replace(",", "'")),
        millimetres(lambda t, z, f: f"{t:.3f};{round(z):,};{f:.4f}".replace(",", "\u202f")),
    ],
)
def test_thousands_are_told_from_decimals(tmp_path, content):
    lesson = lesson_of(tmp_path, content, MM)
    assert lesson.position[0, 0] == pytest.approx(0.9, abs=1e-9)
    assert lesson.position[-1, 0] == pytest.approx(1.15, abs=1e-9)  # read as decimals, 1,150 mm would be 1.15 mm
    assert np.abs(lesson.force[:, 0] - TABLE[:, 2]).max() < 1e-4


def test_commas_that_may_be_either_are_decimal_where_semicolons_part_the_cells_and_it_is_said(tmp_path):
    (tmp_path / "a.csv").write_text(
        "z;Fz\n" + "\n".join(f"{z:.3f};{k % 7}".replace(".", ",") for k, (_, z, _) in enumerate(1 + TABLE))
    )
    (recording,) = read(tmp_path / "a.csv", Columns(position="z", force="Fz", rate_hz=100))
    assert np.abs(recording["hand.position"].values[:, 0] - 1 - TABLE[:, 1]).max() < 6e-4
    assert "decimal commas read as points" in recording.metadata["notes"]


def test_a_file_with_decimal_commas_and_points_is_refused_with_both(tmp_path):
    content = millimetres(lambda t, z, f: f"{t:.3f};{z / 1e3:.4f};{f:.4f}".replace(".", ",", 1))
    with pytest.raises(RecordingError, match=r"'0,000' has a decimal comma, '0.9000' a decimal point"):
        lesson_of(tmp_path, content)


# Headers of pandas --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("head", "index"), [("0,1", False), (",0,1", True)])
def test_pandas_header_of_columns_without_names_is_no_frame(tmp_path, head, index):
    lines = [f"{f:.4f},{z:.6f}" for _, z, f in TABLE.tolist()]
    lines = [f"{i},{line}" for i, line in enumerate(lines)] if index else lines
    lesson = lesson_of(tmp_path, text(head, lines), Columns(position="1", force="0", rate_hz=100))
    holds_the_table(lesson)
    assert any("read as a header" in n for n in lesson.notes)


def test_a_first_frame_that_counts_is_a_frame_where_the_next_ones_go_on_counting(tmp_path):
    lines = [f"{i},{1 + i // 100}" for i in range(400)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (recording,) = read(tmp_path / "a.csv", Columns(position="1", rate_hz=100))
    assert len(recording["hand.position"].time) == 400


def test_a_first_frame_with_a_word_is_a_frame(tmp_path):
    (tmp_path / "a.csv").write_text("\n".join(f"up,{t},{z}" for t, z, _ in TABLE.tolist()))
    (recording,) = read(tmp_path / "a.csv", Columns(time="1", position="2"))
    assert np.array_equal(recording["hand.position"].values[:, 0], TABLE[:, 1])


# Refusals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (text("t,z,Fz,note", [r + (',"grasp' if i == 99 else ",") for i, r in enumerate(rows())]), "line 101 opens a quote"),
        (text().replace("0.010,", '"0.010,', 1), "line 3 opens a quote"),
        (text(lines=[*rows()[:9], "9,9", *rows()[9:]]), "line 11 has 2 cells, want 3"),
        ("1,2\n" + text(), "line 1 has 2 cells, want 3"),
        (text(lines=[r.replace("0.900", "1_0", 1) for r in rows()]), "is not a number"),
        (
            text("time,z,Fz", [f"{1 + i % 28:02d}.05.2024 12:00,{r}" for i, r in enumerate(rows("{:.3f},{:.4f}"))]),
            "ragged|number",
        ),
    ],
)
def test_what_is_no_table_is_refused_with_its_line(tmp_path, content, words):
    with pytest.raises(RecordingError, match=words):
        lesson_of(tmp_path, content)


def test_a_cell_beyond_the_limit_is_refused_with_its_line(tmp_path):
    with pytest.raises(RecordingError, match=r"line 3 is no row of a table: field larger than field limit"):
        lesson_of(tmp_path, text("t,z,Fz,note", with_cell(1, ',"' + "x" * 140_000 + '"')))


def test_a_packed_bomb_or_a_cut_one_is_refused(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(bytes(100 << 20)))
    with pytest.raises(RecordingError, match="unpacks to more than 48 MB"):
        read(path)
    path.write_bytes(gzip.compress(text().encode())[:-20])
    with pytest.raises(RecordingError, match=r"not a recording: starts with 1f8b0800"):
        read(path)


def test_the_name_of_a_packed_recording_is_that_of_the_file_in_it(tmp_path):
    path = tmp_path / "lift.csv.gz"
    path.write_bytes(gzip.compress(text().encode()))
    assert read(path, MAPPING)[0].metadata["name"] == "lift"


def test_what_macos_lays_beside_a_file_is_left_alone(tmp_path):
    (tmp_path / "pose.csv").write_text(text())
    (tmp_path / "force.csv").write_text(text("t,up,Fz"))
    (tmp_path / "._pose.csv").write_bytes(b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X")
    (recording,) = read(tmp_path, Columns(position="pose.z", force="force.Fz", time="pose.t"))
    assert recording["hand.force"].values.shape == (401, 1)
    with pytest.raises(RecordingError, match="AppleDouble"):
        read(tmp_path / "._pose.csv")


def test_columns_that_are_not_used_are_said(tmp_path):
    lesson = lesson_of(tmp_path, text("t,z,Fz,yaw", [r + ",0.5" for r in rows()]), Columns())
    assert any("columns yaw are not used" in n for n in lesson.notes)


# Our own ------------------------------------------------------------------------------------------------------------


def test_a_flipped_digit_in_our_own_csv_is_refused_wherever_it_is(tmp_path):
    path = tmp_path / "a.csv"
    write(lift(duration_s=1.0, operator="A. B."), path)
    intact, refused = path.read_bytes(), 0
    rng = np.random.default_rng(0)
    for at in [3, 21, 40, *rng.integers(len(intact), size=150).tolist()]:
        data = bytearray(intact)
        data[at] ^= 1 << int(rng.integers(7))
        path.write_bytes(data)
        try:
            read(path)
        except RecordingError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused == 153


@pytest.mark.parametrize("change", [lambda t: t.replace("\n", "\r\n"), lambda t: "\ufeff" + t])
def test_line_endings_and_byte_order_marks_do_not_count(tmp_path, change):
    path = tmp_path / "a.csv"
    write(lift(duration_s=1.0), path)
    path.write_bytes(change(path.read_text()).encode())
    assert np.array_equal(read(path)[0]["hand.force"].values, lift(duration_s=1.0)["hand.force"].values)


def test_our_csv_without_its_checksum_is_read_and_it_is_said(tmp_path):
    path = tmp_path / "a.csv"
    write(lift(duration_s=1.0), path)
    first, _, rest = path.read_text().split("\n", 2)
    path.write_text(f"{first}\n{rest}")
    assert any("checksum was taken out" in n for n in read(path)[0].metadata["notes"])
    old = first.replace('"version": 2', '"version": 1')  # as comanip 0.1 wrote it
    path.write_text(f"{old}\n{rest}")
    assert "notes" not in read(path)[0].metadata


@pytest.mark.filterwarnings("ignore:.*velocity channel disagrees")
def test_the_stamps_of_our_own_files_can_be_ignored(tmp_path):
    for path in (tmp_path / "a.csv", tmp_path / "a.mcap"):
        write(lift(rate_hz=100.0), path)
        lesson = demonstration(read(path, Columns(time="none", rate_hz=200))[0])
        assert lesson.dt == 0.005
        assert np.array_equal(lesson.force, lift()["hand.force"].values)
        with pytest.raises(ComanipError, match="state the rate"):
            read(path, Columns(time="none"))


def test_stamps_of_our_own_files_are_not_ignored_where_the_channels_differ(tmp_path):
    write(lift().with_channels({"hand.force": lift(rate_hz=300.0)["hand.force"]}), tmp_path / "a.csv")
    with pytest.raises(ComanipError, match=r"different numbers of frames .*hand.position 401.*hand.force 1201"):
        read(tmp_path / "a.csv", Columns(time="none", rate_hz=100))


# What stands around the numbers ----------------------------------------------------------------------------------------


def test_a_row_of_units_below_the_names_is_what_the_numbers_are_in(tmp_path):
    """Height in mm and time in ms by the second line alone: without it they would be a lift of 300 m within an hour."""
    lines = ["ms,mm,N", *[f"{1e3 * t:.0f},{1e3 * z:.3f},{f:.4f}" for t, z, f in TABLE]]
    holds_the_table(lesson_of(tmp_path, text("t,z,Fz", lines)))


def test_only_a_remark_just_above_the_numbers_names_the_columns(tmp_path):
    numbers = rows()
    named = lesson_of(tmp_path, "\n".join(["# t z Fz", *numbers]) + "\n")
    holds_the_table(named)
    above = "\n".join(["# t z Fz", "# taken on a Monday", *numbers]) + "\n"
    with pytest.raises(RecordingError, match=r"no time column among 0, 1, 2"):
        lesson_of(tmp_path, above)


def test_a_row_with_one_cell_too_many_is_told_by_its_line_unless_the_cell_is_empty(tmp_path):
    lines = rows()
    lines[200] += ","
    holds_the_table(lesson_of(tmp_path, text(lines=lines)))
    lines[200] += "7.0"
    with pytest.raises(RecordingError, match=r"line 202 has 4 cells, want 3: ragged table"):
        lesson_of(tmp_path, text(lines=lines))
