"""Section D of the catalogue of faults: what a user must see when a recording is wrong."""

from __future__ import annotations

import struct
import tracemalloc
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ChannelError, ComanipError, ComanipWarning, RecordingError
from comanip.formats import Columns, read, write
from comanip.lessons.demonstration import check_set, demonstration, demonstrations, require
from comanip.lessons.faults import Plausible
from comanip.recording import Channel, Recording
from lifts import corrupt, lift

SIGNALS = ("position", "velocity", "force")


def one_line(error):
    text = str(error.value)
    assert text
    assert "\n" not in text
    return text


@pytest.fixture(scope="module")
def mcap(tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "lift.mcap"
    write(lift(), path)
    return path.read_bytes()


# D1 -----------------------------------------------------------------------------------------------------------------


def test_d1_a_file_cut_anywhere_opens_to_the_cut_and_recovers_no_less_as_the_cut_moves_right(mcap, tmp_path):
    path, found = tmp_path / "cut.mcap", []
    cuts = np.unique(np.linspace(1, len(mcap) - 1, 300).astype(int))
    for cut in cuts:
        path.write_bytes(mcap[:cut])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                (recording,) = read(path)
                found.append(sum(len(c.time) for c in recording.channels.values()))
                assert recording.metadata["notes"]
            except ComanipError as error:
                assert "\n" not in str(error)
                found.append(0)
    assert (np.diff(found) >= 0).all()
    assert found[-1] == 3 * 401
    middle = found[np.searchsorted(cuts, len(mcap) // 2)]
    assert middle > 0.3 * 3 * 401


def test_d1_a_cut_says_how_much_was_recovered(mcap, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(mcap[: len(mcap) // 2])
    with pytest.warns(ComanipWarning, match=r"recovered \d\.\d s of 4\.0 s \(last \d\.\d s lost\)"):
        read(path)


# D2 -----------------------------------------------------------------------------------------------------------------


def same(a, b):
    return dict(a.metadata) == dict(b.metadata) and all(
        np.array_equal(a[n].values, b[n].values)
        and np.array_equal(a[n].time, b[n].time)
        and (a[n].unit, a[n].frame, a[n].axes) == (b[n].unit, b[n].frame, b[n].axes)
        for n in a.channels | b.channels
    )


def test_d2_a_flipped_bit_is_an_error_or_a_note_never_a_silent_change(mcap, tmp_path):
    path, rng = tmp_path / "flip.mcap", np.random.default_rng(2)
    path.write_bytes(mcap)
    (whole,) = read(path)
    refused = 0
    for _ in range(300):
        data = bytearray(mcap)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                (recording,) = read(path)
            except ComanipError as error:
                assert "\n" not in str(error)
                refused += 1
                continue
        assert "notes" in recording.metadata or same(recording, whole)
    assert refused > 150


def test_d2_a_damaged_chunk_is_named_with_its_time_and_the_rest_can_be_read(mcap, tmp_path):
    path, data = tmp_path / "flip.mcap", bytearray(mcap)
    data[len(data) // 3] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"flip.mcap: chunk \d+, t = \d\.\d+-\d\.\d+ s: .*recover"):
        read(path)
    with pytest.warns(ComanipWarning, match="left out"):
        (recording,) = read(path, recover=True)
    assert 380 < len(recording["hand.force"].time) < 401


# D3 -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("signal", SIGNALS)
@pytest.mark.parametrize("frame", [0, 200, 400])
@pytest.mark.parametrize("kind", ["nan", "inf"])
def test_d3_a_frame_that_is_not_finite_is_named(signal, frame, kind):
    with pytest.raises(RecordingError, match=rf"{signal}: frame {frame} \(t = {frame / 100:.6f} s\) is {kind}.*drop_bad"):
        demonstration(corrupt(lift(), kind, signal, frame))


@pytest.mark.parametrize(("frame", "frames"), [(0, 400), (200, 401), (400, 400)])
def test_d3_drop_bad_trims_and_says_so(frame, frames):
    with pytest.warns(ComanipWarning, match="dropped 1 frames that are not finite"):
        lesson = demonstration(corrupt(lift(), "nan", "force", frame), drop_bad=True)
    assert len(lesson) == frames
    assert any("dropped 1" in n for n in lesson.notes)
    assert np.isfinite(lesson.array(SIGNALS)).all()
    if frame == 200:
        assert any("linear" in n for n in lesson.notes)


def test_d3_drop_bad_never_bridges_a_long_hole():
    spoiled = lift()
    for frame in range(200, 210):
        spoiled = corrupt(spoiled, "nan", "force", frame)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(RecordingError, match=r"gap 0.11 s after frame 199"):
            demonstration(spoiled, drop_bad=True)


# D4 -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("signal", SIGNALS)
@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_d4_a_wrong_unit_is_refused_with_a_guess(signal, factor):
    with pytest.raises(RecordingError, match=rf"{signal}.*{signal}_unit"):
        demonstration(corrupt(lift(), "scale", signal, amount=factor))


def test_d4_a_known_workspace_shows_what_the_numbers_are():
    box = Plausible(position_span=(1e-3, 1e6), workspace=((0.6, 1.2),))
    with pytest.raises(RecordingError, match=r"z spans 800-1050 m; workspace is 0.6-1.2 m: millimetres\?"):
        demonstration(corrupt(lift(), "scale", "position", amount=1e3), plausible=box)


def test_d4_a_force_in_grams_is_refused():
    with pytest.raises(RecordingError, match="grams"):
        demonstration(corrupt(lift(), "scale", "force", amount=1e3 / 9.81))


def test_d4_a_force_in_kilograms_stands_out_among_the_others():
    odd = corrupt(lift(seed=4), "scale", "force", amount=1.0 / 9.81)
    with pytest.warns(ComanipWarning, match=r"lift4: force spans .* another unit"):
        demonstrations([*(lift(seed=k) for k in range(4)), odd])


def test_d4_velocity_and_position_in_different_units_are_refused_by_their_factor():
    with pytest.raises(RecordingError, match="units"):
        demonstration(corrupt(lift(), "scale", "velocity", amount=1e-2))


def test_d4_stamps_in_milliseconds_are_refused(tmp_path):
    recording = lift()
    slow = {n: replace(c, time=c.time * 1e3) for n, c in recording.channels.items()}
    with pytest.raises(RecordingError, match="milliseconds"):
        demonstration(Recording(slow, recording.metadata))


# D5, D6, D7 ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", [0, 150, 399])
def test_d5_time_that_goes_backwards_is_named(frame):
    with pytest.raises(RecordingError, match=rf"position: time goes backwards at frame {frame + 1} .*dt = -0.010 s"):
        demonstration(corrupt(lift(), "swap", "position", frame))


def test_d6_one_stamp_with_two_values_is_refused():
    with pytest.raises(RecordingError, match=r"frames 150 and 151 have one stamp \(t = 1.500000 s\) and different values"):
        demonstration(corrupt(lift(), "repeat", "position", 150, amount=0.1))


def test_d6_an_exact_copy_of_a_frame_is_dropped_and_counted():
    with pytest.warns(ComanipWarning, match="dropped 1 exact copies"):
        lesson = demonstration(corrupt(lift(), "repeat", "position", 150, amount=0.0))
    assert np.array_equal(lesson.position, demonstration(lift()).position)


def cut_all(recording, frame, count):
    for signal in SIGNALS:
        recording = corrupt(recording, "cut", signal, frame, amount=count)
    return recording


def test_d7_a_gap_is_named_with_its_length_and_frame():
    with pytest.raises(RecordingError, match=r"gap 0.43 s after frame 88 \(t = 0.880 s\).*split_gaps"):
        demonstration(cut_all(lift(), 89, 42))


def test_d7_split_gaps_makes_one_lesson_of_each_piece():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pieces = demonstrations([cut_all(lift(), 189, 42)], split_gaps=True)
    assert [p.name for p in pieces] == ["lift0#0", "lift0#1"]
    assert [len(p) for p in pieces] == [189, 170]
    assert np.array_equal(pieces[1].position, lift()["hand.position"].values[231:])


def test_d7_two_lost_frames_are_bridged_and_said():
    lesson = demonstration(cut_all(lift(), 89, 2))
    assert len(lesson) == 401
    assert any("resampled" in n for n in lesson.notes)


# D8 -----------------------------------------------------------------------------------------------------------------


def mixed(seed=0, pose_hz=100.0, force_hz=1000.0):
    pose, force = lift(seed, pose_hz, noise=0.0), lift(seed, force_hz, noise=0.0)
    return pose.with_channels({"hand.force": force["hand.force"]})


def test_d8_mixed_rates_become_one_stated_rate():
    lesson = demonstration(mixed())
    reference = demonstration(lift(noise=0.0))
    assert lesson.dt == 0.01
    assert any("force: resampled from 1000 Hz to 100 Hz (zero-phase low-pass 40 Hz" in n for n in lesson.notes)
    assert np.abs(lesson.force - reference.force).max() < 0.05


def test_d8_lessons_of_50_100_and_1000_hz_agree_at_one_rate():
    slow, middle, fast = demonstrations([lift(0, 50.0), lift(1, 100.0), lift(2, 400.0)])
    assert slow.dt == middle.dt == fast.dt == 0.02
    for lesson in (middle, fast):
        assert np.abs(lesson.position - slow.position).max() < 5e-4
        assert np.abs(lesson.velocity - slow.velocity).max() < 0.01


@pytest.mark.parametrize("force_hz", [1100.0, 2000.0])
def test_d8_more_than_ten_times_apart_is_refused(force_hz):
    with pytest.raises(RecordingError, match=r"force at .* Hz and position at 100 Hz: more than 10 times"):
        demonstration(mixed(force_hz=force_hz))


# D9, D10 ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1.9, 0.5])
def test_d9_stamps_at_a_wrong_rate_are_warned_of_with_the_factor(factor):
    recording = lift()
    stamped = {n: replace(c, time=c.time / factor) for n, c in recording.channels.items()}
    with pytest.warns(ComanipWarning, match=rf"velocity channel disagrees with d\(position\)/dt by z {factor:g}"):
        demonstration(Recording(stamped, recording.metadata))


def test_d10_a_flipped_velocity_is_refused_with_its_correlation():
    with pytest.raises(RecordingError, match=r"correlation -(1.00|0.99).*sign is flipped"):
        demonstration(corrupt(lift(), "scale", "velocity", amount=-1.0))


@pytest.mark.parametrize("frames", [8, -8])
def test_d10_a_late_or_early_velocity_is_refused_with_its_lag(frames):
    with pytest.raises(RecordingError, match=rf"shifted by {frames * 10} ms.*{'late' if frames > 0 else 'early'}"):
        demonstration(corrupt(lift(), "shift", "velocity", amount=frames))


# D11, D12 -----------------------------------------------------------------------------------------------------------


def test_d11_a_missing_force_is_named_by_learning_with_the_way_out():
    lesson = demonstration(corrupt(lift(), "drop", "force"))
    with pytest.raises(ChannelError, match=r"no 'force'; found position, velocity; learn without force"):
        require([lesson], ["position", "force"])


def test_d12_a_bias_at_rest_is_warned_of_with_its_size():
    with pytest.warns(ComanipWarning, match=r"force at rest is (5.0|4.9)\d N"):
        demonstration(corrupt(lift(), "offset", "force", amount=5.0))


@pytest.mark.parametrize("role", ["follower", ""])
def test_d12_a_flipped_force_is_warned_of(role):
    with pytest.warns(ComanipWarning, match=r"against the motion \(correlation -.*sign flipped"):
        demonstration(corrupt(lift(role=role), "scale", "force", amount=-1.0))


@pytest.mark.parametrize("seed", range(5))
def test_d12_a_good_lesson_gives_no_warning(seed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        demonstration(lift(seed))


# D13, D14 -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(3, 500), (499, 1), (2, 3, 500)])
def test_d13_a_wrong_shape_is_refused_with_both_shapes(shape):
    with pytest.raises(ChannelError, match=str(shape[0])):
        Channel(np.arange(500) / 100, np.zeros(shape), "m", "task")


@pytest.mark.parametrize("row", ["0.5,1", "0.5,1,2,3"])
def test_d13_a_ragged_table_is_refused_with_its_line(tmp_path, row):
    path = tmp_path / "ragged.csv"
    path.write_text(f"t,z,vz\n0,1,2\n0.1,1,2\n{row}\n0.3,1,2\n")
    with pytest.raises(RecordingError, match=r"ragged.csv: line 4 has [24] cells, want 3"):
        read(path)


@pytest.mark.parametrize("frames", [0, 1, 2, 5])
def test_d14_too_few_frames_are_refused_with_the_number_needed(frames):
    recording = lift()
    short = {n: replace(c, time=c.time[:frames], values=c.values[:frames]) for n, c in recording.channels.items()}
    with pytest.raises(RecordingError, match=rf"{frames} frames; needs >= 6"):
        demonstration(Recording(short, recording.metadata), min_frames=6)


@pytest.mark.parametrize("content", ["", "time,z,vz,Fz\n", "# nothing\n", "\ufeff", "\n\n"])
def test_d14_an_empty_file_is_refused(tmp_path, content):
    path = tmp_path / "empty.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RecordingError, match=r"empty.csv: (no frames|not a recording)"):
        read(path)


# D15 ----------------------------------------------------------------------------------------------------------------


def bytes_read():
    """By this process since its start, 0 where nobody counts."""
    counted = Path("/proc/self/io")
    return int(counted.read_text().split("rchar: ")[1].split()[0]) if counted.exists() else 0


@pytest.mark.parametrize(("name", "head"), [("a.csv", b"t,z\n0,1\n"), ("a.mcap", b"\x89MCAP0\r\n"), ("a.npy", b"\x93NUMPY")])
def test_d15_a_huge_file_is_refused_with_the_limit_before_it_is_read(tmp_path, name, head):
    path = tmp_path / name
    with path.open("wb") as out:
        out.write(head)
        out.truncate(10 << 30)  # sparse: takes no room
    before = bytes_read()
    with pytest.raises(RecordingError, match=r"10240 MB; the limit for \w+ is \d+ MB"):
        read(path)
    assert bytes_read() - before < 1 << 20


def test_d15_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("z.npy", bytes(300 << 20))
    with pytest.raises(RecordingError, match="unpacks to 300 MB; the limit is 256 MB"):
        read(path, Columns(position="z", rate_hz=100))


# D16, D17 -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["lift ü 持ち上げ.mcap", "with space.csv", "רמה.mcap", "a\nb.csv", "x" * 240 + ".mcap"])
def test_d16_any_name_that_the_disk_takes_works(tmp_path, name):
    write(lift(), tmp_path / name)
    (recording,) = read(tmp_path / name)
    assert np.array_equal(recording["hand.force"].values, lift()["hand.force"].values)


def test_d16_an_error_stays_on_one_line_whatever_the_name(tmp_path):
    path = tmp_path / "a\nb.csv"
    path.write_text("t,z\n0,1,2\n")
    with pytest.raises(RecordingError) as error:
        read(path)
    one_line(error)


def test_d16_a_name_that_the_disk_refuses_is_an_error(tmp_path):
    with pytest.raises(RecordingError):
        write(lift(), tmp_path / ("x" * 500 + ".mcap"))
    with pytest.raises(RecordingError):
        read(tmp_path / ("x" * 500 + ".mcap"))


MAGIC = {
    "zip": b"PK\x03\x04\x14\x00\x00\x00\x08\x00",
    "html": b"<!DOCTYPE html><html>1</html>",
    "png": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR",
    "gzip": b"\x1f\x8b\x08\x00\x00\x00\x00\x00",
    "pdf": b"%PDF-1.7\n1 0 obj\n",
    "elf": b"\x7fELF\x02\x01\x01\x00",
    "text": b"Dear robot, please lift the beam.\n",
    "pickle": b"\x80\x04\x95\x1a\x00\x00\x00",
}


@pytest.mark.parametrize("kind", MAGIC)
@pytest.mark.parametrize("suffix", ["mcap", "csv", ""])
def test_d17_a_foreign_file_is_named_by_its_first_bytes(tmp_path, kind, suffix):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(MAGIC[kind])
    with pytest.raises(RecordingError, match=f"not a recording: starts with {MAGIC[kind][:4].hex()}"):
        read(path)


class Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_d17_a_pickle_among_arrays_is_never_run(tmp_path, suffix):
    path, sprung = tmp_path / f"a.{suffix}", tmp_path / "sprung"
    trap = np.array([Trap(sprung)], dtype=object)
    np.savez(path, position=trap) if suffix == "npz" else np.save(path, trap)
    with pytest.raises(ComanipError) as error:
        read(path, Columns(position="position", rate_hz=100))
    one_line(error)
    assert not sprung.exists()


# D18, D19 -----------------------------------------------------------------------------------------------------------


def record(opcode, body):
    return bytes([opcode]) + struct.pack("<Q", len(body)) + body


def chunk(data, size, compression=b"zstd"):
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(compression)) + compression
    return b"\x89MCAP0\r\n" + record(0x01, struct.pack("<II", 0, 0)) + record(0x06, head + struct.pack("<Q", len(data)) + data)


@pytest.mark.parametrize("declared", [256 << 20, 100])
def test_d18_a_decompression_bomb_is_refused_before_it_is_unpacked(tmp_path, declared):
    import zstandard

    path = tmp_path / "bomb.mcap"
    path.write_bytes(chunk(zstandard.compress(bytes(256 << 20)), declared))
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError, match="declares 256 MB > 16 MB"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 32 << 20
    finally:
        tracemalloc.stop()


def test_d18_a_bomb_in_lz4_is_refused(tmp_path):
    import lz4.frame

    path = tmp_path / "bomb.mcap"
    path.write_bytes(chunk(lz4.frame.compress(bytes(64 << 20)), 100, b"lz4"))
    with pytest.raises(RecordingError, match="> 16 MB"):
        read(path)


@pytest.mark.parametrize("opcode", [0x01, 0x03, 0x05, 0x06, 0x0C, 0x77, 0xFF])
def test_d19_a_lying_length_or_unknown_record_is_an_error(tmp_path, opcode):
    path = tmp_path / "lie.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes([opcode]) + struct.pack("<Q", 2**62) + b"abc")
    with pytest.raises(RecordingError) as error:
        read(path)
    one_line(error)
    path.write_bytes(b"\x89MCAP0\r\n" + record(opcode, b"\xff" * 40))
    with pytest.raises(RecordingError) as error:
        read(path)
    one_line(error)


def test_d19_a_chunk_in_a_chunk_is_not_followed(tmp_path):
    inner = record(0x06, b"\0" * 60)
    path = tmp_path / "nested.mcap"
    path.write_bytes(chunk(inner * 3, len(inner) * 3, b""))
    with pytest.raises(RecordingError):
        read(path)


def test_d19_a_damaged_npz_or_mat_is_an_error(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, position=np.arange(100.0))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data[: len(data) - 10])
    with pytest.raises(RecordingError) as error:
        read(path, Columns(position="position", rate_hz=100))
    one_line(error)
    mat = tmp_path / "a.mat"
    mat.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(ComanipError) as error:
        read(mat, Columns(position="position", rate_hz=100))
    one_line(error)


def test_d20_a_zip_of_recordings_is_not_unpacked(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../../evil.csv", "t,z\n0,1\n")
    with pytest.raises(RecordingError, match="not a recording: starts with 504b0304"):
        read(path)
    assert [p.name for p in tmp_path.iterdir()] == ["a.zip"]


# D21, D22 -----------------------------------------------------------------------------------------------------------


def test_d21_the_same_lesson_twice_is_warned_of_with_both_names():
    first = lift()
    with pytest.warns(ComanipWarning, match="lift0 = copy: the same lesson twice"):
        demonstrations([first, first.with_metadata(name="copy"), lift(1)])


def test_d21_a_lesson_of_another_role_is_refused():
    with pytest.raises(RecordingError, match="role is 'leader', 'follower' was asked for"):
        demonstration(lift(role="leader"), role="follower")
    with pytest.raises(RecordingError, match="role"):
        check_set([demonstration(lift(0)), demonstration(corrupt(lift(1, role="leader"), "scale", "force", amount=-1.0))])


@pytest.mark.parametrize("signal", SIGNALS)
def test_d22_a_recording_without_units_asks_for_them(signal):
    recording = lift()
    name = f"hand.{signal}"
    stripped = recording.with_channels({name: replace(recording[name], unit="")})
    with pytest.raises(RecordingError, match=rf"{name.split('.')[1]}: no unit is stored; state units.*{signal}_unit"):
        demonstration(stripped)


def test_d22_a_flag_states_the_units_that_a_file_lacks(tmp_path):
    recording = lift()
    stripped = {n: replace(c, unit="", values=c.values * (1e3 if "pos" in n else 1)) for n, c in recording.channels.items()}
    write(Recording(stripped), tmp_path / "a.mcap")
    (said,) = read(tmp_path / "a.mcap", Columns(position_unit="mm", velocity_unit="m/s", force_unit="N", role="follower"))
    lesson = demonstration(said)
    assert np.allclose(lesson.position, recording["hand.position"].values, rtol=1e-12)
    assert any("hand.position is taken to be in mm, converted to m" in n for n in lesson.notes)
    assert lesson.role == "follower"
