"""D23 to D33: what strangers found in lessons that were read without a word. Each with the right value."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comanip import GMM, learn  # noqa: F401  (README's first line imports both)
from comanip.errors import ChannelError, ComanipError, ComanipWarning, ParameterError, RecordingError
from comanip.formats import Columns, read, write
from comanip.lessons.alignment import align
from comanip.lessons.demonstration import check_set, demonstration, demonstrations
from comanip.lessons.faults import Plausible
from comanip.lessons.forces import rest_frames
from comanip.recording import Channel, Recording
from lifts import corrupt, lift, minimum_jerk


def stamped(recording, change):
    return Recording({n: replace(c, time=change(np.array(c.time))) for n, c in recording.channels.items()}, recording.metadata)


def without_velocity(recording):
    return corrupt(recording, "drop", "velocity")


def positions(recording, change):
    """The recording with other positions, and no velocity that could contradict them."""
    channel = recording["hand.position"]
    return without_velocity(recording).with_channels({"hand.position": replace(channel, values=change(np.array(channel.values)))})


def quiet(recording, **options):
    """The lesson, or a failure when anything was suspicious."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return demonstration(recording, **options)


# D23: the unit of time ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 500.0, 1000.0, 2000.0, 4000.0, 10_000.0])
@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("velocity", [True, False])
def test_d23_milli_micro_and_nanoseconds_are_never_seconds(rate_hz, factor, velocity):
    recording = stamped(lift(rate_hz=rate_hz), lambda t: t * factor)
    with pytest.raises(RecordingError, match=r"(milli|micro|nano)seconds"):
        demonstration(recording if velocity else without_velocity(recording))


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_d23_a_frame_counter_is_never_seconds(jitter):
    rng = np.random.default_rng(0)
    recording = stamped(lift(rate_hz=1000.0), lambda t: np.arange(len(t)) + jitter * rng.uniform(-1, 1, len(t)))
    with pytest.raises(RecordingError, match=r"state time_unit='ms'"):
        demonstration(without_velocity(recording))


@pytest.mark.parametrize("per_second", [1 / 60, 1 / 3600, 1 / 86400])
def test_d23_minutes_hours_and_days_are_never_seconds(per_second):
    with pytest.raises(RecordingError, match=r"days|hours|derived from position: velocity.z peaks|jumps .* time_unit"):
        demonstration(stamped(without_velocity(lift()), lambda t: t * per_second))


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_d23_stamps_since_1970_have_one_unit_that_makes_them_a_date(tmp_path, unit, factor):
    t, z = lift()["hand.position"].time, lift()["hand.position"].values[:, 0]
    lines = [f"{round((1764489600 + a) * factor)},{b}" for a, b in zip(t, z, strict=True)]
    (tmp_path / "a.csv").write_text("timestamp,z\n" + "\n".join(lines))
    lesson = demonstration(read(tmp_path / "a.csv")[0])
    assert (lesson.dt, len(lesson)) == (0.01, 401)
    assert any(f"taken to be {unit} since 1970" in n for n in lesson.notes)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_d23_a_stated_unit_is_taken(tmp_path, unit):
    t, z = lift()["hand.position"].time, lift()["hand.position"].values[:, 0]
    factor = {"ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    (tmp_path / "a.csv").write_text("t,z\n" + "\n".join(f"{a * factor:.0f},{b}" for a, b in zip(t, z, strict=True)))
    assert demonstration(read(tmp_path / "a.csv", Columns(time_unit=unit))[0]).dt == 0.01


# D24: positions that no hand goes through ----------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 100.0, 1000.0])
@pytest.mark.parametrize("where", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("offset", [0.8, 0.15])
def test_d24_a_dropped_frame_is_named_with_its_frame(rate_hz, where, offset):
    recording = lift(rate_hz=rate_hz, noise=0.3)
    frame = int(where * len(recording["hand.position"].time))

    def dropped(values):
        values += offset - 0.8
        values[frame] = 0.0
        return values

    with pytest.raises(RecordingError, match=rf"position.z jumps from .* to 0 m at frame {frame} \(t = .*a dropped frame"):
        demonstration(positions(recording, dropped))


@pytest.mark.parametrize("rate_hz", [20.0, 100.0, 1000.0])
def test_d24_an_angle_that_wraps_is_named(rate_hz):
    recording = positions(lift(rate_hz=rate_hz), lambda x: np.angle(np.exp(1j * (2.9 + 2.0 * (x - 0.8)))))
    recording = recording.with_channels({"hand.position": replace(recording["hand.position"], unit="rad", axes=("yaw",))})
    recording = recording.with_channels({"hand.force": replace(recording["hand.force"], unit="N m", axes=("yaw",))})
    with pytest.raises(RecordingError, match=r"position.yaw jumps from 3.1\d* to -3.1\d* rad .*numpy.unwrap"):
        demonstration(recording)


def test_d24_a_logical_column_is_named():
    with pytest.raises(RecordingError, match="takes only the values 0, 1 m: a logical column"):
        demonstration(positions(lift(), lambda x: (x > 0.9).astype(float)))


@pytest.mark.parametrize("held", [2, 10, 20])
def test_d24_positions_held_between_samples_are_no_jumps(held):
    recording = lift(rate_hz=1000.0, noise=0.0)
    steps = positions(recording, lambda x: 6.0 * x[np.arange(len(x)) // held * held])  # at most 2.8 m/s
    assert np.abs(quiet(steps).velocity).max() == pytest.approx(6.0 * 0.234, rel=0.1)


def test_d24_an_encoder_of_1_mm_is_no_logical_column():
    quiet(positions(lift(), lambda x: np.round(x, 3)))


def test_d24_a_dropped_frame_beside_a_good_velocity_is_named_too():
    recording = lift(noise=0.3)
    values = np.array(recording["hand.position"].values)
    values[250] = 0.0
    with pytest.raises(RecordingError, match="at frame 250"):
        demonstration(recording.with_channels({"hand.position": replace(recording["hand.position"], values=values)}))


@pytest.mark.parametrize("factor", [0.001, 60.0])
def test_d24_a_derived_velocity_is_held_against_what_is_plausible(factor):
    plausible = Plausible(position_span=(1e-9, 1e9), velocity_peak=(1e-3, 10.0))
    with pytest.raises(RecordingError, match=r"derived from position: velocity.z peaks at|jumps"):
        demonstration(positions(lift(noise=0.0), lambda x: x * factor), plausible=plausible)


# D30: a sensor that repeats itself -----------------------------------------------------------------------------------


def spoiled_force(recording, change):
    values = np.array(recording["hand.force"].values)
    change(recording["hand.force"].time, values)
    return recording.with_channels({"hand.force": replace(recording["hand.force"], values=values)})


@pytest.mark.parametrize(
    ("rate_hz", "start", "stop"), [(1000.0, 1.2, 1.8), (1000.0, 2.0, 2.3), (100.0, 1.5, 2.5), (50.0, 1.6, 2.2)]
)
@pytest.mark.parametrize("dead", [True, False])
def test_d30_a_dead_or_frozen_force_in_motion_is_said_with_its_times(rate_hz, start, stop, dead):
    def change(time, values):
        stretch = (time >= start - 1e-9) & (time <= stop + 1e-9)
        values[stretch] = 0.0 if dead else values[stretch][0]

    word = "reads exactly 0" if dead else "stays exactly still"
    with pytest.warns(ComanipWarning, match=rf"force: {word} t = {start:.3f}-{stop:.3f} s"):
        demonstration(spoiled_force(lift(rate_hz=rate_hz), change))


def test_d30_24_seconds_of_a_frozen_force_are_said_also_at_rest():
    recording = lift(rate_hz=100.0, duration_s=40.0)

    def change(time, values):
        values[(time > 10.0) & (time < 34.0)] = 0.7

    with pytest.warns(ComanipWarning, match=r"stays exactly still t = 10.010-33.990 s"):
        demonstration(spoiled_force(recording, change))


def test_d30_a_saturated_force_is_said_with_its_value():
    def change(time, values):
        np.minimum(values, 4.0, out=values)

    with pytest.warns(ComanipWarning, match=r"force.*t = 1.*saturated"):
        demonstration(spoiled_force(lift(rate_hz=1000.0), change))


@pytest.mark.parametrize("step", [0.05, 0.25, 0.5, 1.0])
def test_d30_a_coarse_force_is_noted_with_its_step(step):
    def change(time, values):
        values[:] = step * np.round(values / step)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        lesson = demonstration(spoiled_force(lift(rate_hz=100.0), change))
    assert any(f"force.z: measured in steps of {step:g} N" in n for n in lesson.notes)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_d30_an_honest_sensor_is_not_suspected(rate_hz, noise):
    lesson = quiet(lift(rate_hz=rate_hz, noise=noise))
    assert not any("steps of" in n for n in lesson.notes)


def test_d30_a_slower_sensor_held_between_its_samples_is_not_suspected():
    quiet(spoiled_force(lift(rate_hz=1000.0), lambda t, f: f.__setitem__(slice(None), f[np.arange(len(f)) // 8 * 8])))


# D32: short gaps, and rest -------------------------------------------------------------------------------------------


def cut_all(recording, frame, count):
    for signal in ("position", "velocity", "force"):
        recording = corrupt(recording, "cut", signal, frame, amount=count)
    return recording


@pytest.mark.parametrize(("rate_hz", "lost_ms"), [(1000.0, 14), (1000.0, 29), (1000.0, 48), (200.0, 15), (200.0, 40)])
def test_d32_a_short_gap_is_bridged_and_said(rate_hz, lost_ms):
    lost = round(lost_ms * 1e-3 * rate_hz)
    whole = lift(rate_hz=rate_hz)
    with pytest.warns(
        ComanipWarning, match=rf"1 short gap bridged linearly, the longest {(lost + 1) / rate_hz * 1e3:.3g} ms after"
    ):
        lesson = demonstration(cut_all(whole, 2 * int(rate_hz), lost))
    assert len(lesson) == len(whole["hand.position"].time)
    assert np.abs(lesson.position - whole["hand.position"].values).max() < 5e-4


@pytest.mark.parametrize(("rate_hz", "lost_ms"), [(1000.0, 55), (200.0, 60), (100.0, 60)])
def test_d32_a_longer_gap_is_refused(rate_hz, lost_ms):
    with pytest.raises(RecordingError, match=r"gap 0.0\d* s .*allowed: 3 periods or 50 ms; .*split_gaps"):
        demonstration(cut_all(lift(rate_hz=rate_hz), 2 * int(rate_hz), round(lost_ms * 1e-3 * rate_hz)))


def test_d32_two_periods_of_the_working_rate_are_bridged():
    with pytest.warns(ComanipWarning, match="bridged"):
        lesson = demonstration(cut_all(lift(rate_hz=1000.0), 2000, 90), rate_hz=20)
    assert lesson.dt == 0.05


def test_d32_three_rows_of_nan_cost_three_rows():
    recording = lift(rate_hz=200.0)
    for frame in (100, 101, 102):
        recording = corrupt(recording, "nan", "position", frame)
    with pytest.warns(ComanipWarning, match="dropped 3 frames"):
        lesson = demonstration(recording, drop_bad=True)
    assert np.abs(lesson.position - lift(rate_hz=200.0)["hand.position"].values).max() < 1e-3


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 1000.0])
@pytest.mark.parametrize(("position_noise", "velocity_noise"), [(2e-4, 3e-3), (2e-4, 1.2e-2), (0.0, 3e-3), (1e-3, 1e-2)])
def test_d32_a_piece_that_rests_is_not_held_to_its_velocity(rate_hz, position_noise, velocity_noise):
    rng = np.random.default_rng(3)
    recording = lift(rate_hz=rate_hz, noise=0.0)
    noisy = {}
    for name, sd in (("hand.position", position_noise), ("hand.velocity", velocity_noise)):
        channel = recording[name]
        noisy[name] = replace(channel, values=channel.values + sd * rng.normal(size=channel.values.shape))
    cut = cut_all(recording.with_channels(noisy), int(0.8 * rate_hz), round(0.15 * rate_hz))  # a gap before anything moves
    rests, moves = demonstrations([cut], split_gaps=True)
    assert rests.duration_s == pytest.approx(0.8, abs=0.03)
    assert np.ptp(moves.position) > 0.24


def test_d32_a_motion_as_slow_is_still_held_to_its_velocity():
    recording = lift(noise=0.0)
    slow = {
        n: replace(recording[n], values=k * recording[n].values) for n, k in (("hand.position", 0.02), ("hand.velocity", -0.02))
    }
    with pytest.raises(RecordingError, match="sign is flipped"):  # 5 mm up in 2 s
        demonstration(recording.with_channels(slow))


def test_d32_gaps_of_several_channels_that_overlap_are_one():
    recording = lift(rate_hz=100.0)
    recording = corrupt(recording, "cut", "position", 180, amount=30)
    recording = corrupt(recording, "cut", "force", 195, amount=30)
    pieces = demonstrations([corrupt(recording, "cut", "velocity", 205, amount=40)], split_gaps=True)
    assert [p.name for p in pieces] == ["lift0#0", "lift0#1"]
    assert [len(p) for p in pieces] == [180, 401 - 245]
    assert np.array_equal(pieces[1].force, lift()["hand.force"].values[245:])


# Stamps that jitter --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("jitter", [0.05, 0.2, 0.3])
@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
@pytest.mark.filterwarnings("ignore:.*stamps are up to", "ignore:.*bridged")
def test_the_rate_of_jittered_stamps_in_order_is_that_of_all_together(seed, jitter, rate_hz):
    rng = np.random.default_rng(seed)
    recording = stamped(
        without_velocity(lift(rate_hz=rate_hz)), lambda t: np.sort(t + jitter / rate_hz * rng.normal(size=len(t)))
    )
    lesson = demonstration(recording)
    assert lesson.dt == 1.0 / rate_hz
    assert abs(len(lesson) - (4 * rate_hz + 1)) <= 2
    assert not any("missing" in n for n in lesson.notes)


@pytest.mark.parametrize("size", [2, 3, 8])
def test_stamps_in_bursts_are_times_of_arrival(size):
    recording = stamped(
        lift(rate_hz=100.0), lambda t: (np.arange(len(t)) // size * size * 0.01) + np.arange(len(t)) % size * 1e-4
    )
    with pytest.raises(RecordingError, match=rf'about {size} frames at once.*time="none" and state rate_hz'):
        demonstration(recording)


# Bias ----------------------------------------------------------------------------------------------------------------


def noisy_bias(seed, bias=4.0, noise=0.012, axes=("z",), direction=(1.0,)):
    rng = np.random.default_rng(seed)
    base, along = lift(seed, rate_hz=200.0, noise=0.2), np.array(direction)
    channels = {n: replace(c, values=c.values[:, :1] * along, axes=axes) for n, c in base.channels.items()}
    velocity, force = channels["hand.velocity"], channels["hand.force"]
    channels["hand.velocity"] = replace(velocity, values=velocity.values + noise * rng.normal(size=velocity.values.shape))
    channels["hand.force"] = replace(force, values=force.values + bias * along / np.linalg.norm(along))
    return Recording(channels, base.metadata)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.012, 0.025])
def test_a_bias_shows_through_a_noisy_velocity(seed, noise):
    with pytest.warns(ComanipWarning, match=r"force at rest is (4.[01]|3.9)\d N.*tare, or force_bias_n"):
        demonstration(noisy_bias(seed, noise=noise))


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi, 9))
def test_a_bias_is_noticed_along_any_direction(angle):
    recording = noisy_bias(0, bias=1.8, axes=("x", "y"), direction=(np.cos(angle), np.sin(angle)))
    with pytest.warns(ComanipWarning, match="force at rest"):
        demonstration(recording)


@pytest.mark.parametrize("options", [{"tare": True}, {"force_bias_n": 4.0}, {"force_bias_n": (4.0,)}])
def test_a_bias_is_taken_off_when_asked_and_it_is_noted(options):
    lesson = quiet(noisy_bias(1), **options)
    true = lift(1, rate_hz=200.0, noise=0.2)["hand.force"].values
    assert np.abs(lesson.force - true).max() < 0.03
    assert any(n.startswith("force: ") and "subtracted" in n for n in lesson.notes)


def test_a_tare_is_the_recordings_also_for_pieces_that_begin_in_motion():
    cut = cut_all(noisy_bias(2), 500, 30)
    pieces = demonstrations([cut], split_gaps=True, tare=True)
    true = lift(2, rate_hz=200.0, noise=0.2)["hand.force"].values
    assert np.abs(pieces[1].force - true[530:]).max() < 0.05


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        (lambda r: r, {"tare": True, "force_bias_n": 4.0}, "both given"),
        (lambda r: r, {"force_bias_n": (1.0, 2.0)}, "force_bias_n has 2 numbers; allowed: one an axis, 1"),
        (lambda r: r, {"force_bias_n": "much"}, "allowed: one finite number an axis"),
        (lambda r: corrupt(r, "drop", "force"), {"tare": True}, "no force to take a bias off"),
        (lambda r: Recording({n: replace(c, time=c.time[450:], values=c.values[450:]) for n, c in r.channels.items()}),
         {"tare": True}, "nothing to tare by"),
    ],
)  # fmt: skip
def test_a_tare_that_cannot_be_is_refused(change, options, words):
    with pytest.raises(ComanipError, match=words):
        demonstration(change(lift(rate_hz=200.0)), **options)


@pytest.mark.parametrize("dt", [0.001, 0.005, 0.02])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.012])
def test_rest_ends_where_motion_begins_and_not_where_noise_does(dt, noise):
    time = np.arange(0.0, 4.0, dt)
    speed = minimum_jerk(time)[1][:, None] + noise * np.random.default_rng(0).normal(size=(len(time), 1))
    start, end = rest_frames(speed, dt)
    assert 0.85 <= start * dt <= 1.35  # it moves from 1 s to 3 s, slowly at first
    assert 0.85 <= end * dt <= 1.35


def test_rest_of_an_angle_is_not_hidden_by_a_faster_path_and_the_other_way_round():
    time = np.arange(0.0, 4.0, 0.01)
    turning = minimum_jerk(time, start=0.3, duration=1.0, height=0.02)[1]
    both = np.column_stack([minimum_jerk(time, start=2.0, duration=1.0, height=2.0)[1], turning])
    assert rest_frames(both, 0.01, "m/s, rad/s")[0] < 50
    assert rest_frames(both, 0.01, "m/s")[0] > 150


# D33: axes of different kinds ---------------------------------------------------------------------------------------


def door(tmp_path, head="t,x,y,yaw,vx,vy,wz,Fx,Fy,Tz", degrees=False):
    time = np.arange(0.0, 4.0, 0.01)
    s, ds, _ = minimum_jerk(time, height=1.0)
    turn = np.rad2deg(1.2) if degrees else 1.2
    columns = [time, 0.5 * s, 0.3 * s, turn * s, 0.5 * ds, 0.3 * ds, turn * ds, 5 * ds, 3 * ds, 2 * ds]
    np.savetxt(tmp_path / "door.csv", np.column_stack(columns), delimiter=",", header=head, comments="")
    return tmp_path / "door.csv"


DOOR = {"position": "x,y,yaw", "velocity": "vx,vy,wz", "force": "Fx,Fy,Tz"}


@pytest.mark.parametrize(
    ("head", "degrees", "flags"),
    [
        ("t,x,y,yaw,vx,vy,wz,Fx,Fy,Tz", False, {}),
        ("t,x,y,yaw,vx,vy,wz,Fx,Fy,Tz", False, {"position_unit": "m, m, rad"}),
        ("t,x,y,yaw,vx,vy,wz,Fx,Fy,Tz", True, {"position_unit": "m,m,deg", "velocity_unit": "m/s,m/s,deg/s"}),
        ("t,x [m],y [m],yaw [deg],vx [m/s],vy [m/s],wz [deg/s],Fx [N],Fy [N],Tz [Nm]", True, {}),
        ("t,x,y,yaw_deg,vx,vy,wz_deg_s,Fx,Fy,Tz", True, {"position": "x,y,yaw_deg", "velocity": "vx,vy,wz_deg_s"}),
    ],
)
def test_d33_an_angle_among_the_axes_keeps_its_unit(tmp_path, head, degrees, flags):
    lesson = quiet(read(door(tmp_path, head, degrees), Columns(**{**DOOR, **flags}))[0])
    assert lesson.axes[:2] == ("x", "y")
    assert lesson.axes[2].startswith("yaw")
    assert dict(lesson.units) == {"position": "m, m, rad", "velocity": "m/s, m/s, rad/s", "force": "N, N, N m"}
    assert lesson.unit_of(f"velocity.{lesson.axes[2]}") == "rad/s"
    assert lesson.unit_of("position.x") == "m"
    assert lesson.position[-1] == pytest.approx([0.5, 0.3, 1.2], abs=1e-9)


@pytest.mark.parametrize("name", ["yaw", "rz", "theta_z", "rot_z", "joint_3", "door_angle", "q1"])
def test_d33_no_angle_becomes_the_vertical(tmp_path, name):
    head = f"t,x,y,{name},vx,vy,wz,Fx,Fy,Tz"
    (recording,) = read(door(tmp_path, head), Columns(**{**DOOR, "position": f"x,y,{name}"}))
    assert recording["hand.position"].unit == "m, m, rad"
    assert "z" not in recording["hand.position"].axes


def test_d33_three_columns_without_names_are_said_to_be_x_y_z(tmp_path):
    (recording,) = read(door(tmp_path, "a,b,c,d,e,f,g,h,i,j"), Columns(time="a", position="b,c,d"))
    assert recording["hand.position"].axes == ("x", "y", "z")
    assert any("axes taken to be x, y, z, z up: nothing names them" in n for n in recording.metadata["notes"])


def test_d33_an_error_names_the_unit_of_its_axis(tmp_path):
    path = door(tmp_path, degrees=True)
    with pytest.raises(RecordingError, match=r"position.yaw spans 68.75 rad; plausible: 0.001 to 20 rad: degrees\?"):
        demonstration(read(path, Columns(**DOOR))[0])


def test_d33_a_derived_velocity_and_a_stored_file_keep_the_units(tmp_path):
    (recording,) = read(door(tmp_path), Columns(position="x,y,yaw", force="Fx,Fy,Tz"))
    assert demonstration(recording).units["velocity"] == "m/s, m/s, rad/s"
    for path in (tmp_path / "a.csv", tmp_path / "a.mcap"):
        write(recording, path)
        assert read(path)[0]["hand.position"].unit == "m, m, rad"


def test_d33_a_robot_that_moves_in_metres_refuses_the_skill(tmp_path):
    from comanip import make_skill
    from comanip.errors import MismatchError

    lesson = demonstration(read(door(tmp_path), Columns(**DOOR))[0])
    learned = learn(
        [lesson, replace(lesson, name="b", signals={n: 1.01 * v for n, v in lesson.signals.items()})], role="follower"
    )
    with pytest.raises(MismatchError, match="'m, m, rad'"):
        make_skill(learned, axes=("x", "y", "yaw"), dt=0.01)


# Roles, copies, names ------------------------------------------------------------------------------------------------


def unstated(seed):
    recording = lift(seed)
    return Recording(recording.channels, {"name": f"lift{seed}"})


def test_the_snippet_of_the_readme_works_on_own_recordings():
    learned = learn(demonstrations([unstated(k) for k in range(3)], rate_hz=100), role="follower")
    assert learned.role == "follower"
    assert any("the role is taken to be 'follower'" in n for n in learned.notes)


def test_a_role_sets_what_is_not_stated_and_contradicts_nothing():
    lessons = demonstrations([unstated(0), lift(1)], role="follower")
    assert [x.role for x in lessons] == ["follower", "follower"]
    mixed = [demonstration(unstated(0)), demonstration(lift(1))]
    assert learn(mixed, role="follower").role == "follower"
    with pytest.raises(RecordingError, match="role 'follower', 'leader' was asked for"):
        learn(mixed, role="leader")
    with pytest.raises(RecordingError, match="lessons must agree"):
        learn(mixed)


@pytest.mark.parametrize(
    "use",
    [
        lambda role: learn(demonstrations([unstated(0), unstated(1)]), role=role),
        lambda role: demonstrations([unstated(0)], role=role),
        lambda role: Columns(role=role),
        lambda role: check_set([demonstration(unstated(0))], role=role),
    ],
)
def test_an_unknown_role_is_refused_with_the_list(use):
    with pytest.raises(ParameterError, match="role is 'folower'; allowed: leader, follower, natural; did you mean 'follower'"):
        use("folower")


def test_a_repeated_lesson_is_told_once():
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        learned = learn(demonstrations([lift(0), lift(0).with_metadata(name="copy"), lift(1)]))
    assert len([w for w in said if "the same lesson twice" in str(w.message)]) == 1
    assert [n for n in learned.notes if "twice" in n] == ["lift0 = copy: the same lesson twice"]


def test_lessons_of_different_rates_are_suspected_once():
    biased = corrupt(lift(0), "offset", "force", amount=5.0)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        demonstrations([biased, lift(1, rate_hz=50.0)])
    assert len([w for w in said if "force at rest" in str(w.message)]) == 1


@pytest.mark.parametrize("name", ["position", "hand.force", "force", "sensor_force"])
def test_an_extra_channel_takes_no_signals_place(tmp_path, name):
    write(lift().with_channels({"other": lift()["hand.force"]}), tmp_path / "a.mcap")
    with pytest.raises(ChannelError, match=rf"an extra channel is called '{name}'"):
        read(tmp_path / "a.mcap", Columns(extra={name: "other"}))


def test_two_columns_of_one_name_in_two_channels_are_not_told_apart_silently(tmp_path):
    time = np.arange(200) / 100
    channels = {"a": Channel(time, time, "m", "task", ("b.c",)), "a.b": Channel(time, 2 * time, "m", "task", ("c",))}
    write(Recording(channels), tmp_path / "a.csv")
    with pytest.raises(ChannelError, match=r"two columns are called 'a.b.c'"):
        read(tmp_path / "a.csv", Columns(position="a.b.c"))


def test_a_mapping_that_replaces_a_channel_of_our_own_says_so(tmp_path):
    write(lift().with_channels({"other": lift(3)["hand.force"]}), tmp_path / "a.csv")
    (recording,) = read(tmp_path / "a.csv", Columns(force="other"))
    assert np.array_equal(recording["hand.force"].values, lift(3)["hand.force"].values)
    assert any("other taken as hand.force, instead of the file's own hand.force" in n for n in recording.metadata["notes"])


WRONG = {
    "a path for recordings": lambda: demonstrations("lift.mcap"),
    "a Path for recordings": lambda: demonstrations(Path("lift.mcap")),
    "paths for recordings": lambda: demonstrations(["a.csv", "b.csv"]),
    "an array for recordings": lambda: demonstrations(np.zeros((100, 3))),
    "one recording for several": lambda: demonstrations(lift()),
    "a path for a recording": lambda: demonstration("lift.mcap"),
    "a number for a path": lambda: read(3),
    "several paths": lambda: read(["a.csv", "b.csv"]),
    "a dict for columns": lambda: read("a.csv", {"position": "z"}),
    "lessons to write": lambda: write([lift()], "a.csv"),
    "a path for lessons": lambda: learn("lift.mcap"),
    "a Path for lessons": lambda: learn(Path("lift.mcap")),
    "an array for lessons": lambda: learn(np.zeros((100, 3))),
    "arrays for lessons": lambda: learn([np.zeros((100, 3))]),
    "recordings for lessons": lambda: learn([lift()]),
    "nothing for lessons": lambda: learn(None),
    "recordings to align": lambda: align([lift(), lift(1)]),
    "an int for a Generator": lambda: learn(demonstrations([lift(), lift(1)]), rng=1),
    "a text for a rate": lambda: Columns(rate_hz="100"),
    "a dict for a preparation": lambda: demonstrations([lift()], {"rate_hz": 100}),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_wrong_type_is_one_line_that_says_what_is_allowed(mistake):
    with pytest.raises(ComanipError) as error:
        WRONG[mistake]()
    assert "\n" not in str(error.value)
    assert "allowed" in str(error.value)
