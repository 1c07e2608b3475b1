"""Files that hold many takes are cut where a label changes, every channel at the same time, and nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ChannelError, ComanipError
from comanip.formats import Columns, read, write
from comanip.formats.mapping_file import mapping_file
from lifts import lift

TASKS, TARGETS = (1, 1, 2, 1), (3, 4, 4, 4)


@pytest.fixture
def labelled(tmp_path):
    """Four runs of 40, 50, 60 and 10 frames at 100 Hz, a number of the frame as position."""
    rows, at = [], 0
    for task, target, frames in zip(TASKS, TARGETS, (40, 50, 60, 10), strict=True):
        for _ in range(frames):
            rows.append(f"{at / 100:.2f},{at / 1000},{at % 7},{task},{target}")
            at += 1
    path = tmp_path / "many.csv"
    path.write_text("t,z,Fz,task,target\n" + "\n".join(rows) + "\n")
    return path


def test_a_file_is_cut_where_any_label_changes_and_nothing_is_lost(labelled):
    (whole,) = read(labelled)
    found = read(labelled, Columns(segment_by="task,target"))
    assert [len(r["hand.position"].time) for r in found] == [40, 50, 60, 10]
    assert np.array_equal(np.concatenate([r["hand.position"].values for r in found]), whole["hand.position"].values)
    assert np.array_equal(np.concatenate([r["hand.force"].time for r in found]), whole["hand.force"].time)
    assert [r.metadata["name"] for r in found][2] == "many[2] task=2 target=4"
    assert all(set(r.channels) == {"hand.position", "hand.force"} for r in found)
    assert all("extra" not in r.metadata for r in found)


def test_a_value_keeps_only_what_has_it_and_says_which_there_are(labelled):
    found = read(labelled, Columns(segment_by=("task=1", "target")))
    assert [len(r["hand.position"].time) for r in found] == [40, 50, 10]
    with pytest.raises(ComanipError, match=r"many.csv: nothing has task=5; there are task 1, 2$"):
        read(labelled, Columns(segment_by="task=5"))


def test_names_and_values_that_are_none_are_said(labelled):
    with pytest.raises(ChannelError, match="no column 'tsk'; did you mean 'task'"):
        read(labelled, Columns(segment_by="tsk"))
    with pytest.raises(ComanipError, match="segment_by 'task=a': 'a' is no number"):
        read(labelled, Columns(segment_by="task=a"))


def test_further_channels_stay_and_a_mapping_may_say_it(labelled, tmp_path):
    (tmp_path / "m.toml").write_text('position = "z"\nforce = "Fz"\nsegment_by = ["task=2"]\n[extra]\nwhere = "target"\n')
    (found,) = read(labelled, mapping_file(tmp_path / "m.toml"))
    assert found.metadata["extra"] == ["where"]
    assert (found["where"].values == 4.0).all()


def test_channels_of_other_clocks_are_cut_at_the_same_times(tmp_path):
    """Our own file, labels at 100 Hz and force at 250 Hz."""
    from dataclasses import replace

    from comanip.recording import Channel

    recording = lift(duration_s=1.0)
    time = np.arange(100) / 100.0
    force = recording["hand.force"]
    fast = np.arange(250) / 250.0
    recording = recording.with_channels(
        {
            "hand.force": replace(force, time=fast, values=np.interp(fast, force.time, force.values[:, 0])[:, None]),
            "part": Channel(time, np.repeat([0.0, 1.0], 50)[:, None], "", "task", ("",)),
        }
    )
    write(recording, tmp_path / "a.mcap")
    first, second = read(tmp_path / "a.mcap", Columns(segment_by="part"))
    assert first["hand.force"].time[-1] < 0.5 <= second["hand.force"].time[0]
    assert len(first["hand.force"].time) + len(second["hand.force"].time) == 250


def test_takes_that_each_begin_at_zero_are_cut_by_frames(tmp_path):
    rows = [f"{k},{i / 100:.2f},{i * 0.001:.3f},{k}" for k in range(3) for i in range(50)]
    (tmp_path / "a.csv").write_text("\n".join(["trial,t,z,Fz", *rows]))
    pieces = read(tmp_path / "a.csv", Columns(segment_by="trial"))
    assert [len(p["hand.position"].time) for p in pieces] == [50, 50, 50]
    assert [p["hand.force"].values[0, 0] for p in pieces] == [0.0, 1.0, 2.0]
    assert all(p["hand.position"].time[0] == 0.0 for p in pieces)


def test_frames_without_a_label_are_one_piece_of_their_own_and_not_one_a_frame(tmp_path):
    labels = ["1"] * 20 + ["nan"] * 20 + ["2"] * 20
    rows = [f"{i / 100:.2f},{i * 0.001:.3f},0,{label}" for i, label in enumerate(labels)]
    (tmp_path / "a.csv").write_text("\n".join(["t,z,Fz,trial", *rows]))
    assert [len(p["hand.position"].time) for p in read(tmp_path / "a.csv", Columns(segment_by="trial"))] == [20, 20, 20]
