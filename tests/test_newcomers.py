"""What those who come with files of their own met: a message says what the file has besides, a cut recording has one goal."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ChannelError
from comanip.formats import Columns, read
from comanip.learned.skill import learn
from comanip.lessons.demonstration import demonstrations
from lifts import corrupt, lift, minimum_jerk


def table(path, head="t,z,vz,Fsz", cut=()):
    """A lift of 4 s at 100 Hz as a table; rows of `cut` are lost."""
    t = np.arange(400) / 100
    x, dx, _ = minimum_jerk(t)
    table = zip(t, 0.8 + x, dx, 25 * dx + 3, strict=True)
    rows = [f"{a:.3f},{b:.6f},{c:.6f},{d:.4f}" for i, (a, b, c, d) in enumerate(table) if i not in cut]
    path.write_text("\n".join([head, *rows]))
    return path


def test_a_missing_force_names_the_columns_that_may_be_it(tmp_path):
    path = table(tmp_path / "a.csv")
    with pytest.raises(ChannelError, match=r"no 'force'; found position, velocity; columns Fsz are not used: name them to use"):
        learn(demonstrations(read(path)), role="follower")
    with pytest.raises(ChannelError, match=r"no force to take a bias off; found .*; columns Fsz are not used: name them"):
        demonstrations(read(path), tare=True)


def test_a_missing_position_names_them_too_where_others_were_named(tmp_path):
    path = table(tmp_path / "a.csv")
    with pytest.raises(ChannelError, match=r"no 'hand\.position'; found hand\.sensor_force; columns z, vz are not used: name"):
        demonstrations(read(path, Columns(sensor_force="Fsz")))


def test_all_columns_named_leave_nothing_to_say(tmp_path):
    path = table(tmp_path / "a.csv")
    (recording,) = read(path, Columns(position="z", velocity="vz", force="-Fsz"))
    assert not [note for note in recording.metadata["notes"] if "not used" in note]


@pytest.mark.parametrize("first", [20, 120, 300])
def test_where_a_recording_was_cut_is_no_goal(tmp_path, first):
    paths = [table(tmp_path / f"{i}.csv", "t,z,vz,Fz", cut=range(first, first + 30)) for i in range(2)]
    lessons = demonstrations([one for path in paths for one in read(path)], split_gaps=True)
    assert len(lessons) == 4
    learned = learn(lessons, role="follower")
    assert len(learned.paths) == 1
    farthest = max(lessons, key=lambda one: np.ptp(one.position))
    assert learned.ends == pytest.approx(np.full((2, 1), farthest.position[-1, 0]))
    assert "fragments: the path to the goal is learned from the piece of each recording that goes farthest" in learned.notes


def test_whole_recordings_are_all_learned_from():
    learned = learn(demonstrations([lift(role="follower", seed=i) for i in range(3)]))
    assert len(learned.ends) == 3
    assert not [note for note in learned.notes if "fragments" in note]


def test_advice_on_a_bias_is_a_sentence_in_python_and_at_the_command_line():
    from comanip.commands.flag_words import in_flags

    biased = corrupt(lift(), "offset", "force", amount=4.0)
    with pytest.warns(match=r"take it off \(tare, or force_bias_n\)") as said:
        demonstrations([biased])
    assert "? take it off: --tare, --force-bias-n, or --tare-auto where" in in_flags(str(said[0].message))
