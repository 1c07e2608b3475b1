"""Recordings of real hands, measured by others; skipped where they are not at hand (see their README)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ComanipError, ComanipWarning
from comanip.formats import Columns, read
from comanip.lessons.demonstration import demonstration

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared(name):
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"the real recording ../shared/data/{name} is not here")
    return path


PANDA = Columns(position="symbol_data.pos", velocity="symbol_data.vel", force="symbol_data.F", rate_hz=1000)


@pytest.fixture(scope="module")
def panda():
    return read(shared("panda_comanip/symbol_17.mat"), PANDA)


def test_the_panda_file_holds_six_recordings_of_three_axes(panda):
    assert len(panda) == 6
    for recording in panda:
        assert recording["hand.position"].axes == ("x", "y", "z")
        assert len({len(c.time) for c in recording.channels.values()}) == 1
    assert len(panda[0]["hand.force"].time) == 5520
    assert panda[0]["hand.position"].values[0, 0] == pytest.approx(-0.52062329, rel=1e-8)


def test_the_panda_file_needs_no_names(panda):
    for a, b in zip(read(shared("panda_comanip/symbol_17.mat"), Columns(rate_hz=1000)), panda, strict=True):
        assert all(np.array_equal(a[n].values, b[n].values) for n in b.channels)


def test_the_panda_rate_is_found_to_be_wrong_by_1_4(panda):
    for recording in panda:
        with pytest.warns(ComanipWarning, match=r"disagrees with d\(position\)/dt by x 1\.4\d*x, y 1\.4\d*x") as said:
            demonstration(recording)
        assert len([w for w in said if "disagrees" in str(w.message)]) == 1  # two begin with 2 N at rest, which is said too


def test_at_the_rate_that_would_agree_nothing_is_suspicious():
    columns = Columns(position=PANDA.position, velocity=PANDA.velocity, force=PANDA.force, rate_hz=694)
    lesson = demonstration(read(shared("panda_comanip/symbol_17.mat"), columns)[0])
    assert not any("disagrees" in n for n in lesson.notes)


@pytest.mark.parametrize("sample", ["sample_new", "sample_old"])
def test_a_directory_of_tables_is_one_handover(sample):
    axes = "xyz"
    columns = Columns(
        position=tuple(f"baton_pose_saved.{a}" for a in axes),
        force=tuple(f"Wrench_taker_saved.F{a}" for a in axes),
        rate_hz=120,
        extra={"giver.force": tuple(f"Wrench_giver_saved.F{a}" for a in axes)},
    )
    (recording,) = read(shared(f"kth_handover/{sample}"), columns)
    lesson = demonstration(recording)
    assert len(lesson) == 801
    assert lesson.dt == pytest.approx(1 / 120, rel=1e-12)
    assert lesson.channels[-3:] == ("giver.force.x", "giver.force.y", "giver.force.z")
    giver, taker = lesson.array("giver.force.z"), lesson.array("force.z")
    assert abs(giver[:50].mean()) > 10.0 > abs(taker[:50].mean())  # first the giver carries the baton,
    assert abs(taker[-50:].mean()) > abs(giver[-50:].mean())  # in the end the taker


@pytest.mark.parametrize("clip", ["question1b_spring", "own_ctrl_pop", "m2_question1b_free_motion"])
def test_a_scope_of_a_bilateral_rig_is_read_by_path(clip):
    columns = Columns(
        position="scope.signals[0].values[:,0]",
        force="scope.signals[1].values[:,0]",
        time="scope.time",
        position_unit="rad",
        force_unit="N m",
        axes="lever",
    )
    (recording,) = read(shared(f"tue_bilateral_1dof/{clip}.mat"), columns)
    lesson = demonstration(recording, cutoff_hz=30.0)
    assert lesson.dt == 0.0005
    assert lesson.channels == ("position.lever", "force.lever", "velocity.lever")
    assert lesson.units["velocity"] == "rad/s"
    assert any("zero-phase low-pass 30 Hz" in n for n in lesson.notes)
    assert np.abs(lesson.velocity).max() < 60.0


# Two axes that turn, in deg, with stamps since 1970 and a first column without a name


REACHES = Columns(
    position=("ADMI_pitch_pos", "ADMI_yaw_pos"),
    velocity=("ADMI_pitch_vel", "ADMI_yaw_vel"),
    force=("pitch_torque", "yaw_torque"),
    position_unit="deg",
    velocity_unit="deg/s",
    force_unit="N*m",
)


@pytest.mark.parametrize("file", ["TaskClass_data1.csv", "TaskClass_data2.csv"])
def test_a_person_who_turns_an_exoskeleton_opens_with_a_name_a_channel(file):
    (recording,) = read(shared(f"asu_reaches/{file}"), REACHES)
    position = recording["hand.position"]
    assert position.unit == "rad"
    assert position.time[0] > 1.7e9  # found by itself: the column is called time_stamp
    assert np.median(np.diff(position.time)) == pytest.approx(1 / 245, rel=0.05)
    assert np.abs(position.values[0]) == pytest.approx(np.radians([45.0, 70.0]), abs=1e-5)


def test_degrees_that_are_called_nothing_are_asked_for():
    without = replace(REACHES, position_unit=None, velocity_unit=None)
    with pytest.raises(ComanipError, match=r"degrees\? state position_unit"):
        demonstration(read(shared("asu_reaches/TaskClass_data1.csv"), without)[0])


def test_a_push_into_a_wall_in_millimetres_opens_with_its_unit():
    (recording,) = read(shared("delta_wall/pHRI_test_experiment_dataset.csv"), Columns(position_unit="mm"))
    assert recording["hand.position"].axes == recording["hand.force"].axes == ("x", "y", "z")
    assert recording["hand.position"].values[0, 2] == pytest.approx(-0.04752524559852447)
