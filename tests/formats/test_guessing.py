"""A file that nobody described: what `inspect` guesses of it, and that every command it advises works when it is pasted."""

from __future__ import annotations

import shlex

import numpy as np
import pytest

from comanip.errors import ChannelError
from comanip.formats import Columns, read, write
from comanip.formats.guessing import guess, labels, time_column, words_of
from comanip.formats.listing import Column, look
from comanip.lessons.demonstration import demonstrations
from lifts import lift

T = np.arange(500) / 100.0
S = np.clip((T - 1.0) / 2.5, 0.0, 1.0)
RNG = np.random.default_rng(5)
X = np.outer(10 * S**3 - 15 * S**4 + 6 * S**5, [0.1, -0.2, 0.3]) + np.array([0.4, -0.1, 0.8])
V = np.gradient(X, T, axis=0)
F = 18.0 * V + 0.05 * RNG.normal(size=V.shape)


def columns(**named):
    return [Column(name, "", np.asarray(values, dtype=float), str(len(values))) for name, values in named.items()]


def table(path, names, *parts, separator=","):
    rows = np.column_stack(parts)
    path.write_text("\n".join([separator.join(names), *(separator.join(f"{v:.9g}" for v in row) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("actual_TCP_pose_{i} actual_TCP_speed_{i} actual_TCP_force_{i}", None),
        ("EndEffectorPos{A} EndEffectorVel{A} ContactForce{A}", None),
        ("ee_pos_{a} ee_vel_{a} force_ext_{a}", None),
        ("p{a} dp{a} f{a}", None),
        ("tcp_{a} tcp_v{a} tcp_f{a}", None),
        ("handle.position.{a} handle.linear_velocity.{a} loadcell.force.{a}", None),
    ],
)
def test_names_of_other_labs_are_understood(names, expected):
    position, velocity, force = ([pattern.format(a="xyz"[i], A="XYZ"[i], i=i) for i in range(3)] for pattern in names.split(" "))
    mixed = dict(zip([*force, *velocity, *position], np.hstack([F, V, X]).T, strict=True))
    found = guess(columns(**mixed, time_ms=1e3 * T, desired_x=X[:, 0] * 1.01), stamped=False)
    assert found.signals == {"position": tuple(position), "velocity": tuple(velocity), "force": tuple(force)}
    assert found.time == "time_ms"


def test_where_the_hand_is_measured_goes_before_where_it_was_told_to_be():
    found = guess(columns(t=T, cmd_pos_z=X[:, 2], ee_pos_z=X[:, 2], raw_force_z=F[:, 2], filtered_force_z=F[:, 2]), stamped=False)
    assert found.signals == {"position": ("ee_pos_z",), "force": ("filtered_force_z",)}


def test_what_was_commanded_or_is_raw_is_taken_where_there_is_nothing_else():
    named = columns(t=T, target_pos_z=X[:, 2], pos_z=X[:, 2], force_z_raw=F[:, 2], force_z=F[:, 2])
    assert guess(named, stamped=False).signals == {"position": ("pos_z",), "force": ("force_z",)}
    alone = guess(columns(t=T, target_pos_z=X[:, 2], force_z_raw=F[:, 2]), stamped=False)
    assert alone.signals == {"position": ("target_pos_z",), "force": ("force_z_raw",)}


def test_a_column_that_happens_to_derive_from_another_far_from_it_makes_no_table():
    noise = RNG.normal(size=len(T))
    found = guess(columns(**{"0": T, "1": X[:, 0], "2": noise, "3": V[:, 0]}), stamped=False)
    assert found.why.startswith("by their order alone")


def test_a_turn_goes_with_its_torque_and_not_with_a_force():
    named = columns(t=T, elbow_angle=X[:, 2], elbow_speed=V[:, 2], grip_force=F[:, 0], elbow_torque=F[:, 2])
    found = guess(named, stamped=False)
    assert found.signals == {"position": ("elbow_angle",), "velocity": ("elbow_speed",), "force": ("elbow_torque",)}


def test_six_of_a_wrench_are_three_forces_and_three_torques():
    wrench = np.hstack([F, 0.01 * F])
    found = guess(
        columns(t=T, **{f"pos{i}": X[:, i] for i in range(3)}, **{f"ft_{i}": wrench[:, i] for i in range(6)}), stamped=False
    )
    assert found.signals["force"] == ("ft_0", "ft_1", "ft_2")


@pytest.mark.parametrize("places", [(12, 13, 14), (3, 7, 11)])
def test_a_pose_of_sixteen_numbers_is_found_by_its_row_of_zeros(places):
    pose = np.tile(np.eye(4).ravel(), (len(T), 1))
    pose[:, places] = X
    named = {f"O_T_EE_{i}": pose[:, i] for i in range(16)} | {f"O_F_ext_{i}": np.hstack([F, F])[:, i] for i in range(6)}
    assert guess(columns(**named), stamped=True).signals["position"] == tuple(f"O_T_EE_{i}" for i in places)


def test_a_table_without_names_is_told_by_what_derives_from_what():
    rows = np.column_stack([T, X, V, F])
    found = guess(columns(**{str(i): rows[:, i] for i in range(10)}), stamped=False)
    assert (found.time, found.why) == ("0", "by what the numbers do")
    assert found.signals == {"position": ("1", "2", "3"), "velocity": ("4", "5", "6"), "force": ("7", "8", "9")}
    swapped = np.column_stack([T, *(c for i in range(3) for c in (X[:, i], V[:, i])), F])  # x, vx, y, vy ...
    found = guess(columns(**{str(i): swapped[:, i] for i in range(10)}), stamped=False)
    assert found.signals["position"][0] == "1"
    assert found.signals["velocity"][0] == "2"


def test_a_velocity_tells_the_rate_where_there_are_no_stamps():
    found = guess(columns(pos_z=X[:, 2], vel_z=V[:, 2], fz=F[:, 2]), stamped=False)
    assert found.rate_hz == pytest.approx(100.0, rel=0.02)
    assert guess(columns(pos_z=X[:, 2], fz=F[:, 2]), stamped=False).rate_hz == 0.0


def test_time_only_grows_and_is_called_so():
    assert time_column(columns(frame=np.arange(500), clock=T, z=X[:, 2])).name == "clock"
    assert time_column(columns(time=T[::-1], z=X[:, 2])) is None
    assert time_column(columns(way=np.cumsum(np.abs(V[:, 0])))) is None


def test_labels_stay_for_long_and_change():
    steps = np.repeat([1.0, 2.0, 3.0, 3.0, 4.0], 100)
    named = columns(trial=steps, subject=np.ones(500), task_time=T, target=steps + 0.5, run_no=RNG.integers(0, 2, 500))
    assert labels(named) == ("trial",)


def test_words_of_a_name():
    assert words_of("EndEffector_Pos.x [mm]") == ["end", "effector", "pos", "x"]
    assert words_of("demos.dX") == ["demos", "dx"]


def test_what_is_no_motion_is_not_guessed():
    assert guess(columns(emg1=RNG.normal(size=50)), stamped=False) is None
    assert guess([], stamped=False) is None


def test_a_frame_that_was_lost_does_not_hide_the_hand_and_a_still_one_is_none():
    lost = X[:, 2].copy()
    lost[100] = np.nan
    assert guess(columns(t=T, pos_z=lost, fz=F[:, 2]), stamped=False).signals == {"position": ("pos_z",), "force": ("fz",)}
    for still in (np.full(len(T), 0.5), np.r_[np.nan, np.full(len(T) - 1, 0.5)]):
        found = guess(columns(t=T, pos_z=still, vel_z=0 * T, fz=0 * T), stamped=False)
        assert found is None or all(found.signals.values())
    half = guess(columns(t=T, pos_z=np.full(len(T), 0.5), vel_z=V[:, 2], fz=0 * T), stamped=False)
    assert all(half.signals.values())


def test_our_own_files_are_looked_at_as_recordings(tmp_path):
    write(lift(duration_s=0.5), tmp_path / "a.mcap")
    assert look(tmp_path / "a.mcap") == ()


def test_a_scope_is_listed_element_by_element_and_takes_all_at_once(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    one = {"time": T, "signals": [{"values": X[:, :2]}, {"values": F[:, :1]}]}
    takes = np.zeros(2, dtype=[("pos", "O"), ("f", "O")])
    for i in range(2):
        takes[i] = (X[: 400 + i].T, F[: 400 + i].T)
    scipy_io.savemat(tmp_path / "a.mat", {"scope": one})
    scipy_io.savemat(tmp_path / "b.mat", {"takes": takes})
    scope, several = [c.name for c in look(tmp_path / "a.mat")], [c.name for c in look(tmp_path / "b.mat")]
    assert scope == ["scope.time", "scope.signals[0].values[:,0]", "scope.signals[0].values[:,1]", "scope.signals[1].values"]
    assert several[0] == "takes.pos[0,:]"
    for name in (*scope, *several):
        where = tmp_path / ("a.mat" if name in scope else "b.mat")
        assert read(where, Columns(position=name, rate_hz=100.0))


def test_a_unit_may_stand_behind_a_column(tmp_path):
    file = table(tmp_path / "a.csv", ["t", "yaw_pos", "yaw_vel", "tau"], T, np.degrees(X[:, 2]), np.degrees(V[:, 2]), F[:, 2])
    (recording,) = read(file, Columns(position="yaw_pos [deg]", velocity="yaw_vel [deg/s]", force="tau"))
    assert recording["hand.position"].unit == "rad"
    assert recording["hand.position"].values[-1, 0] == pytest.approx(X[-1, 2])
    assert recording["hand.velocity"].values[250, 0] == pytest.approx(V[250, 2], rel=1e-6)
    (mixed,) = read(table(tmp_path / "m.csv", ["t", "x", "yaw"], T, 1e3 * X[:, 0], X[:, 2]), Columns(position="x [mm],yaw [rad]"))
    assert mixed["hand.position"].unit == "m, rad"


def test_a_column_really_called_so_keeps_its_name(tmp_path):
    file = table(tmp_path / "a.csv", ["t", "z [m]", "z [mm]", "Fz"], T, X[:, 2], 1e3 * X[:, 2], F[:, 2])
    (recording,) = read(file, Columns(position="z [mm]", force="Fz"))
    assert recording["hand.position"].values[0, 0] == pytest.approx(X[0, 2])


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ({"position": "x [mm],y"}, "others have none"),
        ({"position": "x [mm]", "position_unit": "mm"}, "position_unit says mm"),
        ({"position": "x [parsec]"}, "no column 'x \\[parsec\\]'"),
        ({"position": "x [N]"}, "no column 'x \\[N\\]'"),
    ],
)
def test_units_are_stated_once_and_for_each(tmp_path, mapping, said):
    file = table(tmp_path / "a.csv", ["t", "x", "y"], T, X[:, 0], X[:, 1])
    with pytest.raises(ChannelError, match=said):
        read(file, Columns(**mapping))


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """What a command prints, run here: a process for each takes seconds."""
    from comanip.commands.app import main

    def answer(line):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", shlex.split(line))
        monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
        try:
            code = main() or 0
        except SystemExit as end:
            code = end.code or 0
        out, err = capsys.readouterr()
        assert code == 0, (line, err)
        return out

    return answer


def _followed(said, start, most=5):
    """Commands from `start` to one that learns, each the one that the last advised."""
    line, seen = start, []
    for _ in range(most):
        seen.append(line)
        out = said(line)
        if line.startswith("comanip learn"):
            return seen
        (line,) = [one.removeprefix("next: ") for one in out.splitlines() if one.startswith("next: ")]
    raise AssertionError(f"no skill after {seen}")


def test_from_a_foreign_table_to_a_skill_by_pasting(tmp_path, said):
    """Degrees that nobody states, labels of takes, a column of stamps in milliseconds."""
    takes = [
        np.column_stack([np.full(len(T), k), 1e3 * (T + 5 * k), np.degrees(X[:, 2]), np.degrees(V[:, 2]), F[:, 2]])
        for k in range(3)
    ]
    file = table(tmp_path / "my data.csv", ["trial", "clock_ms", "knee_pos", "knee_vel", "knee_torque"], np.vstack(takes))
    seen = _followed(said, f"comanip inspect '{file}'")
    assert seen[1].split()[1] == "inspect"
    for flag in (
        "--position='knee_pos [deg]'",
        "--velocity='knee_vel [deg/s]'",
        "--force='knee_torque [N m]'",
        "--segment-by=trial",
    ):
        assert flag in seen[1], seen[1]
    assert (tmp_path / "skill.json").exists()


def test_from_a_file_without_stamps_to_a_skill_and_what_stands_for_the_rate_is_said(tmp_path, said):
    file = table(tmp_path / "a.csv", ["tool_x", "tool_y", "tool_z", "Fx", "Fy", "Fz"], X, F)
    assert "nothing says the rate: 100 Hz stands" in said(f"comanip inspect {file}")
    assert "--rate-hz=100" in _followed(said, f"comanip inspect {file}")[-1]


def test_takes_in_one_file_are_cut_by_their_labels_before_a_jump_between_them_is_let_pass(tmp_path, said):
    file = table(
        tmp_path / "a.csv", ["trial", "t", "z", "Fz"], np.repeat([0.0, 1.0, 2.0], len(T)), np.r_[T, T + 5, T + 10],
        np.tile(X[:, 2], 3), np.tile(F[:, 2], 3) + 0.05 * RNG.normal(size=3 * len(T)),
    )  # fmt: skip
    last = _followed(said, f"comanip inspect {file}")[-1]
    assert "--segment-by=trial" in last
    assert "--any-size" not in last


def test_entries_of_arrays_in_a_bag_take_one_set_of_axes(tmp_path):
    pytest.importorskip("rosbags")
    import bags

    layout = bags.make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    rows = np.hstack([X, F])
    messages = [
        ("/log", t, bags.make("std_msgs/msg/Float64MultiArray", layout=layout, data=row)) for t, row in zip(T, rows, strict=True)
    ]
    bags.write_folder(tmp_path / "bag", messages)
    (lesson,) = demonstrations(read(tmp_path / "bag", Columns(position="/log.data[0:3]", force="/log.data[3:6]")))
    assert lesson.axes == ("x", "y", "z")
    with pytest.raises(ChannelError, match="different axes"):
        demonstrations(read(tmp_path / "bag", Columns(position="/log.data[0:3]", force="/log.data[3:5]")))


def test_axes_that_are_called_by_their_names_are_never_renamed(tmp_path):
    pytest.importorskip("rosbags")
    import bags

    bags.write_folder(tmp_path / "bag", bags.lifting(duration=1.0))
    with pytest.raises(ChannelError, match=r"different axes \(position: z; force: x\)"):
        demonstrations(read(tmp_path / "bag", Columns(position="/ee_pose.pose.position.z", force="/ft.wrench.force.x")))
