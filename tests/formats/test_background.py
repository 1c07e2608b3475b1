"""Recordings that another process stores: the same bytes, nothing lost, errors said."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import RecordingError
from comanip.formats import write
from comanip.formats.background import writing
from comanip.recording import Channel, Recording


def recording(n: int) -> Recording:
    time = 0.01 * np.arange(40)
    return Recording({"hand.position": Channel(time, np.sin(time + n)[:, None], "m", "task", ("z",))}, {"lesson": n})


def keep(files: list[Path], *, interrupted: bool = False) -> None:
    with writing() as store:
        for n, file in enumerate(files):
            store(recording(n), file)
        if interrupted:
            raise KeyboardInterrupt


def test_all_is_stored_byte_for_byte_as_without(tmp_path):
    keep([tmp_path / f"{n}.mcap" for n in range(4)])
    for n in range(4):
        write(recording(n), tmp_path / "direct.mcap")
        assert (tmp_path / f"{n}.mcap").read_bytes() == (tmp_path / "direct.mcap").read_bytes()


@pytest.mark.parametrize("last", [0, 2])
def test_what_could_not_be_stored_is_said_with_its_file_and_the_others_are_kept(tmp_path, last):
    files = ["good.mcap", "absent/bad.mcap", *(f"{n}.mcap" for n in range(last))]
    with pytest.raises(RecordingError, match=r"absent.+bad\.mcap"):
        keep([tmp_path / name for name in files])
    assert (tmp_path / "good.mcap").exists()


def test_what_was_handed_over_is_stored_when_the_work_is_interrupted(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        keep([tmp_path / "a.mcap"], interrupted=True)
    assert (tmp_path / "a.mcap").exists()


def test_what_could_not_be_stored_is_said_when_the_work_is_interrupted(tmp_path):
    with pytest.raises(RecordingError, match=r"bad\.mcap"):
        keep([tmp_path / "absent" / "bad.mcap"], interrupted=True)


def test_a_recording_goes_to_another_process_whole():
    again = pickle.loads(pickle.dumps(recording(3)))
    assert again.metadata == {"lesson": 3}
    np.testing.assert_array_equal(again["hand.position"].values, recording(3)["hand.position"].values)
    with pytest.raises(TypeError):
        again.metadata["lesson"] = 4
