"""What `inspect` advises where a file needs more than a mapping: units, frames, rates, a force that is not there."""

from __future__ import annotations

import contextlib
import io
import warnings
from pathlib import Path

import numpy as np
import pytest

from comanip.commands.advising import given_flags, next_command, propose
from comanip.commands.flags import DataFlags
from comanip.commands.reading import preparation_of, read_recordings
from comanip.errors import ComanipError, ParameterError
from comanip.formats import write
from comanip.formats.listing import look
from comanip.lessons.checkup import checkup
from comanip.recording import Channel, Recording

T = np.arange(500) / 100.0
U = np.clip((T - 1.0) / 2.5, 0.0, 1.0)
Z = 0.8 + 0.3 * U**3 * (10 - 15 * U + 6 * U**2)
V = np.gradient(Z, T)
RNG = np.random.default_rng(11)
F = 18.0 * V + 0.05 * RNG.normal(size=len(T))


def advised(files, data=DataFlags()):
    files = [Path(f) for f in files]
    columns = tuple(c for f in files[:1] for c in look(f))
    return next_command(checkup(read_recordings(files, data), preparation_of(data)), files, data, columns).command


def table(path, names, *columns):
    path.write_text("\n".join([names, *(",".join(f"{v:.9g}" for v in row) for row in np.column_stack(columns))]) + "\n")
    return path


def own(path, z, unit="m", rate=1.0):
    channels = {
        "hand.position": Channel(T / rate, z[:, None], unit, "task", ("z",)),
        "hand.force": Channel(T / rate, F[:, None], "N", "task", ("z",)),
    }
    write(Recording(channels, {"name": path.stem, "role": "follower"}), path)
    return path


def test_a_length_and_its_velocity_in_millimetres_are_advised_together(tmp_path):
    line = advised([table(tmp_path / "a.csv", "t,z,vz,Fz", T, 2e5 * Z, 2e5 * V, F)])
    assert "--position-unit=mm" in line
    assert "--velocity-unit=mm/s" in line
    line = advised([table(tmp_path / "b.csv", "t,z,vz,Fz", T, 2e5 * Z, V, F)])  # already in m/s
    assert "--velocity-unit=mm/s" not in line


def test_a_file_that_states_its_units_is_taken_at_its_size(tmp_path):
    line = advised([own(tmp_path / "a.csv", 100.0 * Z)])
    assert "--any-size" in line
    assert "unit" not in line


def test_without_a_force_only_what_needs_none_is_learned(tmp_path):
    assert advised([table(tmp_path / "a.csv", "t,z,vz", T, Z, V)]).endswith("--no-force -o skill.json")
    line = advised([table(tmp_path / "b.csv", "t,z,vz,grip_load_raw", T, Z, V, F)])  # a force under a name of its own
    assert line.startswith("comanip inspect")
    assert "--force=grip_load_raw" in line


def test_recordings_of_several_rates_are_brought_to_the_slowest(tmp_path):
    line = advised([own(tmp_path / "a.csv", Z), own(tmp_path / "b.csv", Z + 0.001 * RNG.normal(size=len(Z)), rate=2.0)])
    assert "--resample-hz=100" in line


def test_a_frame_that_nothing_joins_is_taken_to_turn_with_the_hand_and_said(tmp_path):
    pytest.importorskip("rosbags")
    import bags

    bags.write_folder(tmp_path / "bag", bags.lifting(frames=("tool0", "base", "base"), duration=3.0))
    said = propose([tmp_path / "bag"], DataFlags(), look(tmp_path / "bag"))
    assert "--frame=tool0=hand" in said.command
    assert any("'tool0' is taken to turn with the hand" in note for note in said.notes)


def test_stamps_in_bursts_and_in_other_units_are_advised(tmp_path):
    bursts = np.repeat(T[::5], 5) + np.tile(np.arange(5) * 1e-4, 100)
    line = advised([table(tmp_path / "a.csv", "t,z,Fz", bursts, Z, F)])
    assert "--time=none" in line
    assert "--rate-hz=" in line
    assert "--time-unit=ms" in advised([table(tmp_path / "b.csv", "t,z,Fz", 1e3 * T, Z, F)])


def test_flags_are_quoted_for_a_shell():
    import shlex

    flags = DataFlags(position="a [deg],b [deg]", force="-Fz", rate_hz=99.8, frame=["x=hand", "y=same"], drop_bad=True)
    assert shlex.split(" ".join(given_flags(flags))) == [
        "--position=a [deg],b [deg]", "--force=-Fz", "--rate-hz=99.8", "--frame=x=hand", "--frame=y=same", "--drop-bad",
    ]  # fmt: skip


def test_tare_auto_says_what_it_chose_and_why(tmp_path):
    """A bias of its own in each take: taken off, on the command line too; two takes are too few to choose by."""
    from comanip.commands.reading import read_lessons

    takes = [np.column_stack([T, Z, V * (1 + 0.05 * i), F + 4.0 * (-1) ** i])[::4] for i in range(3)]
    files = [table(tmp_path / f"{i}.csv", "t,z,vz,Fz", rows) for i, rows in enumerate(takes)]
    said = _notes(lambda: read_lessons(files, DataFlags(tare_auto=True)))
    assert "force at rest taken off: error on lessons left out" in said
    assert "too few to choose by" in _notes(lambda: read_lessons(files[:2], DataFlags(tare_auto=True)))
    with pytest.raises(ParameterError, match="--tare-auto with --tare"):
        read_lessons(files, DataFlags(tare_auto=True, tare=True))


def _notes(call):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        call()
    return said.getvalue()


def test_who_learns_from_a_file_that_nobody_described_is_told_who_proposes_a_mapping(tmp_path):
    from comanip.commands.reading import read_lessons

    file = table(tmp_path / "a.csv", "t,tool_height,pull_force_z", T, Z, F)
    with pytest.raises(ComanipError, match="or let `comanip inspect` propose it"):
        read_lessons([file], DataFlags())
