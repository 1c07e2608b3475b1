"""Arrays by path: structs, indices, and which dimension is time."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ChannelError, ParameterError
from comanip.formats import Columns, read

TIME = np.arange(200) / 100
POSITION = np.random.default_rng(0).normal(size=(200, 3))


@pytest.fixture
def structs(tmp_path):
    io = pytest.importorskip("scipy.io")
    takes = np.array([{"pos": POSITION.T + k, "t": TIME} for k in range(3)], dtype=object)
    io.savemat(tmp_path / "a.mat", {"take": takes, "log": {"signals": [{"v": POSITION}, {"v": 2 * POSITION}], "t": TIME}})
    return tmp_path / "a.mat"


def test_a_struct_array_is_several_recordings(structs):
    recordings = read(structs, Columns(position="take.pos", time="take.t"))
    assert [r.metadata["name"] for r in recordings] == ["a[0]", "a[1]", "a[2]"]
    for k, recording in enumerate(recordings):
        assert np.array_equal(recording["hand.position"].values, POSITION + k)
        assert any("(3, 200) read as 200 frames of 3 axes" in n for n in recording.metadata["notes"])


@pytest.mark.parametrize(
    ("expression", "want"),
    [
        ("take[1].pos", POSITION + 1),
        ("log.signals[1].v", 2 * POSITION),
        ("log.signals[1].v[:,2]", 2 * POSITION[:, 2:]),
        ("-log.signals[0].v[:,0:2]", -POSITION[:, :2]),
    ],
)
def test_indices_pick_parts(structs, expression, want):
    (recording,) = read(structs, Columns(position=expression, time="log.t"))
    assert np.array_equal(recording["hand.position"].values, want)


@pytest.mark.parametrize("expression", ["take.velocity", "log.signals[7].v", "log.signals[1].v[:,9]", "log", "nothing"])
def test_a_wrong_path_is_one_line_that_says_what_there_is(structs, expression):
    with pytest.raises(ChannelError) as error:
        read(structs, Columns(position=expression, rate_hz=100))
    assert "\n" not in str(error.value)
    assert "a.mat" in str(error.value)


def test_fewer_frames_than_axes_are_told_apart_by_the_stamps(tmp_path):
    np.savez(tmp_path / "a.npz", time=[0.0, 0.1], position=np.arange(6.0).reshape(2, 3))
    (recording,) = read(tmp_path / "a.npz")
    assert recording["hand.position"].values.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_a_bare_array_is_mapped_by_column(tmp_path):
    np.save(tmp_path / "a.npy", np.column_stack([TIME, POSITION]))
    (recording,) = read(tmp_path / "a.npy", Columns(time="0", position="3", force="[:,1:2]"))
    assert np.array_equal(recording["hand.position"].values[:, 0], POSITION[:, 2])
    assert np.array_equal(recording["hand.force"].values[:, 0], POSITION[:, 0])


def test_lengths_that_disagree_are_refused_with_both(tmp_path):
    np.savez(tmp_path / "a.npz", time=TIME, position=POSITION, force=POSITION[:-5])
    with pytest.raises(ChannelError, match=r"hand.force: got \(195, 3\), want \(200, d\)"):
        read(tmp_path / "a.npz", Columns(position="position", force="force"))


@pytest.mark.parametrize("wrong", [{"position_unit": "furlong"}, {"rate_hz": -1.0}, {"force_unit": "m"}, {"axes": "z,z"}])
def test_a_wrong_flag_lists_what_is_allowed(wrong):
    with pytest.raises(ParameterError):
        Columns(**wrong)


def test_commas_inside_brackets_do_not_split():
    assert Columns(position="a.b[:,0],c").position == ("a.b[:,0]", "c")
    assert Columns(position=("x,y", "z")).position == ("x", "y", "z")
