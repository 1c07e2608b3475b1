"""MATLAB's files against scipy's reader, and arrays with what nobody asked for in them."""

from __future__ import annotations

import io
import sys
from subprocess import DEVNULL, PIPE, Popen

import numpy as np
import pytest

from comanip.errors import ChannelError, ComanipError, RecordingError
from comanip.formats import Columns, outside, read
from comanip.formats.mat73_file import read_mat73
from comanip.formats.mat_file import LeftOut, mat_variables
from comanip.lessons.demonstration import demonstration
from fuzz_tables import READERS, faults
from lifts import lift

scipy_io = pytest.importorskip("scipy.io")
RNG = np.random.default_rng(0)
VALUES = {
    "column": RNG.normal(size=(200, 1)),
    "row": RNG.normal(size=(1, 200)),
    "table": RNG.normal(size=(200, 3)),
    "cube": RNG.normal(size=(4, 3, 2)),
    "single": RNG.normal(size=(5, 2)).astype(np.float32),
    "integers": np.arange(-5, 300, dtype=np.int16),
    "bytes": np.arange(20, dtype=np.uint8),
    "whole": np.array([3.0, 70000.0, -4.0]),  # stored as integers
    "number": 4.25,
    "logical": np.array([True, False, True]),
    "nothing": np.empty((0, 0)),
}


def stored(values, **options):
    out = io.BytesIO()
    scipy_io.savemat(out, values, **options)
    return out.getvalue()


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"oned_as": "column"}, {"format": "4"}])
def test_every_array_is_what_scipy_reads(tmp_path, options):
    values = {n: v for n, v in VALUES.items() if options.get("format") != "4" or (n not in ("cube", "logical") and np.size(v))}
    data = stored(values, **options)
    found = mat_variables(tmp_path, data)
    oracle = scipy_io.loadmat(io.BytesIO(data), squeeze_me=True)
    for name in values:
        if np.size(values[name]) == 0:
            assert np.size(found[name]) == 0
            continue
        assert np.array_equal(np.asarray(found[name], dtype=float), np.asarray(oracle[name], dtype=float)), name
        assert np.shape(found[name]) == np.shape(oracle[name]), name


def test_structs_cells_and_texts_are_what_was_stored(tmp_path):
    time = np.arange(30.0)
    takes = np.array([{"pos": time + k, "name": f"take {k}"} for k in range(3)], dtype=object)
    data = stored(
        {"log": {"inner": {"t": time}, "word": "lift"}, "takes": takes, "cell": np.array([time, "x", 2.0], dtype=object)}
    )
    found = mat_variables(tmp_path, data)
    assert np.array_equal(found["log"]["inner"]["t"], time)
    assert found["log"]["word"] == "lift"
    assert [take["name"] for take in found["takes"]] == ["take 0", "take 1", "take 2"]
    assert np.array_equal(found["takes"][2]["pos"], time + 2)
    assert np.array_equal(found["cell"][0], time)


def test_what_is_not_read_is_named_when_it_is_asked_for(tmp_path):
    sparse = pytest.importorskip("scipy.sparse")
    path = tmp_path / "a.mat"
    path.write_bytes(stored({"s": sparse.eye(3).tocsc(), "c": np.array([1 + 2j, 3.0]), "t": np.arange(9.0), "z": np.arange(9.0)}))
    assert isinstance(mat_variables(path, path.read_bytes())["s"], LeftOut)
    assert read(path)[0]["hand.position"].values.shape == (9, 1)
    with pytest.raises(ChannelError, match=r"'s' is not read: it is a sparse matrix"):
        read(path, Columns(position="s", time="t"))
    with pytest.raises(ChannelError, match=r"'c' is not read: it is complex"):
        read(path, Columns(position="c", time="t"))


def test_an_altered_mat_file_is_refused_and_the_process_lives(tmp_path):
    path, refused = tmp_path / "a.mat", 0
    intact = stored({"t": np.arange(50.0), "z": np.arange(50.0), "s": {"a": np.arange(5.0)}})
    for at in range(128, len(intact), 3):
        data = bytearray(intact)
        data[at] ^= 0x81
        path.write_bytes(data)
        try:
            read(path)
        except ComanipError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 20


def arrays():
    recording = lift()
    return recording["hand.force"].time, *(recording[f"hand.{n}"].values[:, 0] for n in ("position", "velocity", "force"))


def test_a_pickled_entry_that_nobody_asked_for_does_no_harm(tmp_path):
    t, z, vz, force = arrays()
    path = tmp_path / "a.npz"
    np.savez(path, t=t, z=z, vz=vz, Fz=force, config=np.array({"a": 1}, dtype=object))
    assert np.array_equal(demonstration(read(path)[0]).force[:, 0], force)
    with pytest.raises(ChannelError, match=r"'config' is not read: it is a pickled Python object, which is never run"):
        read(path, Columns(position="config"))
    np.savez(path, data=np.array([{"t": t}], dtype=object))
    with pytest.raises(RecordingError, match=r"nothing in it is read: 'data' is a pickled .* np.savez\(path, t=t, z=z\)"):
        read(path)


def test_a_structured_array_is_a_table_with_names(tmp_path):
    t, z, vz, force = arrays()
    table = np.rec.fromarrays([t, z, vz, force], names="t,z,vz,Fz")
    np.save(tmp_path / "a.npy", table)
    np.savez(tmp_path / "a.npz", log=table)
    assert np.array_equal(demonstration(read(tmp_path / "a.npy")[0]).force[:, 0], force)
    (recording,) = read(tmp_path / "a.npz", Columns(position="log.z", force="log.Fz", time="log.t"))
    assert np.array_equal(recording["hand.force"].values[:, 0], force)


@pytest.mark.parametrize("kind", ["datetime64[ns]", "datetime64[us]", "timedelta64[ms]"])
def test_dates_are_seconds_since_the_first(tmp_path, kind):
    t, z, _, force = arrays()
    since = (t * 1e9).round().astype("timedelta64[ns]")
    stamps = np.datetime64("2024-05-01T12:00:00", "ns") + since if kind.startswith("date") else since
    np.savez(tmp_path / "a.npz", t=stamps.astype(kind), z=z, Fz=force)
    lesson = demonstration(read(tmp_path / "a.npz")[0])
    assert (lesson.dt, len(lesson)) == (0.01, 401)
    assert any("'t' holds times: read as seconds" in n for n in lesson.notes)


def test_matlabs_ascii_files_are_tables(tmp_path):
    t, z, _, force = arrays()
    path = tmp_path / "a.mat"
    path.write_text("\n".join(f"  {a:.7e}  {b:.7e}  {c:.7e}" for a, b, c in zip(t, z, force, strict=True)))
    (recording,) = read(path, Columns(time="0", position="1", force="2"))
    assert np.abs(recording["hand.force"].values[:, 0] - force).max() < 1e-6


def test_matlab_7_3_is_read(tmp_path):
    pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    path.write_bytes(READERS["mat 7.3"][1]())
    lesson = demonstration(read(path)[0])
    assert np.array_equal(lesson.force, lift(duration_s=1.5)["hand.force"].values)


def test_matlab_7_3_without_h5py_says_what_to_do(tmp_path, monkeypatch):
    pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    path.write_bytes(READERS["mat 7.3"][1]())
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(RecordingError, match=r"MATLAB 7.3.*-v7.*or install h5py"):
        read(path)


def mat73(path, fill):
    """A file of version 7.3 with what `fill(h5py, file)` puts into it."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(h5py, file)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    return path


def test_matlab_7_3_keeps_whole_numbers_whole(tmp_path):
    stamps = 1_764_489_600_000_000_000 + 10_000_001 * np.arange(5)

    def fill(_, file):
        file["t"], file["run/on"], file["run/z"] = stamps[None], np.array([[True, False]]), np.float32([[1.5, 2.5]])

    tree = read_mat73(mat73(tmp_path / "a.mat", fill))._tree
    assert tree["t"].dtype == np.int64
    assert tree["t"].tolist() == stamps.tolist()
    assert tree["run"]["on"].tolist() == [True, False]
    assert tree["run"]["z"].tolist() == [1.5, 2.5]


def test_matlab_7_3_takes_no_numbers_from_other_files(tmp_path):
    (tmp_path / "secret.bin").write_bytes(np.arange(4.0).tobytes())

    def fill(_, file):
        file["t"] = np.arange(4.0)
        file.create_dataset("z", (4,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 32)])

    assert isinstance(read_mat73(mat73(tmp_path / "a.mat", fill))._tree["z"], LeftOut)


def test_cells_that_hold_themselves_end(tmp_path):
    def fill(h5py, file):
        cell = file.create_dataset("c", (40,), h5py.ref_dtype)
        cell[:] = [cell.ref] * 40  # 40 cells of 40 cells of ... is 40^24 of them

    with pytest.raises(RecordingError, match=r"a\.mat: not readable as MATLAB 7\.3: it holds more than 20000 arrays, the limit"):
        read_mat73(mat73(tmp_path / "a.mat", fill))


def test_a_file_of_matlab_on_which_its_library_dies_ends_nothing_here(tmp_path, monkeypatch):
    path = mat73(tmp_path / "a.mat", lambda _, file: file.update({"t": np.arange(4.0)}))
    dying = Popen([sys.executable, "-c", "import os; os.abort()"], stdin=PIPE, stdout=PIPE, stderr=DEVNULL)
    dying.wait()
    monkeypatch.setattr(outside, "_running", lambda: dying)
    with pytest.raises(RecordingError, match=r"a\.mat: not readable as MATLAB 7\.3: damaged: its library ended the process"):
        read_mat73(path)
    monkeypatch.undo()
    assert read_mat73(path)._tree["t"].tolist() == [0, 1, 2, 3]


HUGE = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999,), }"


@pytest.mark.parametrize("header", [HUGE, b"{" * 3000, b"(" * 5000, b"1"])
def test_a_npy_header_that_lies_is_refused(tmp_path, header):
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(800))
    with pytest.raises(RecordingError, match="not readable as numpy arrays"):
        read(path, Columns(position="0", rate_hz=100))


@pytest.mark.parametrize("reader", READERS)
def test_altered_files_are_read_or_refused_in_one_line(reader):
    if reader == "mat 7.3":
        pytest.importorskip("h5py")
    assert faults(reader, 60, seed=1) == []
