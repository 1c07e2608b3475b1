"""Orientation and torque in a lesson: unit quaternions of one sign, their angular velocity, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ChannelError, RecordingError
from comanip.fitting.riemannian import fit_riemannian_hmm
from comanip.formats import read, write
from comanip.lessons.demonstration import demonstration, demonstrations
from comanip.models.riemannian import regress
from comanip.recording import Channel
from comanip.signals import sphere
from lifts import lift, minimum_jerk

AXIS = np.array([0.36, 0.48, 0.8])
BASE = sphere.quaternion(np.array([0.3, -1.0, 0.2]))


def tilted(seed=0, rate_hz=100.0, flips=False, axes="wxyz", torque=True):
    """A lift during which the hand turns by 1.2 rad about an axis of the task frame."""
    rng = np.random.default_rng([seed, 9])
    recording = lift(seed)
    time = np.arange(round(4.0 * rate_hz) + 1) / rate_hz
    angle, speed, _ = minimum_jerk(time, height=1.2)
    q = sphere.product(sphere.quaternion(np.outer(angle, AXIS)), BASE)
    if flips:
        q = q * rng.choice([-1.0, 1.0], size=(len(q), 1))
    more = {"hand.orientation": Channel(time, q[:, ["wxyz".index(a) for a in axes]], "", "task", tuple(axes))}
    if torque:
        more["hand.torque"] = Channel(time, np.outer(0.8 * speed, AXIS), "N m", "task", ("x", "y", "z"))
    return recording.with_channels(more), np.outer(speed, AXIS), q


def test_nothing_changes_for_who_does_not_ask():
    recording, *_ = tilted()
    assert demonstration(recording).channels == ("position.z", "force.z", "velocity.z")
    assert demonstration(recording).sha256 == demonstration(lift(0)).sha256


def test_orientation_torque_and_angular_velocity_come_along():
    recording, omega, _ = tilted()
    lesson = demonstration(recording, orientation=True)
    np.testing.assert_array_equal(lesson["orientation"], recording["hand.orientation"].values)
    np.testing.assert_array_equal(lesson["torque"], recording["hand.torque"].values)
    assert np.abs(lesson["angular_velocity"] - omega).max() < 0.02  # of 1.1 rad/s: what a low-pass at 10 Hz rounds off
    assert lesson.unit_of("angular_velocity.x") == "rad/s"
    assert lesson.unit_of("torque.z") == "N m"
    assert lesson.channels[3:7] == ("orientation.w", "orientation.x", "orientation.y", "orientation.z")
    assert sum("angular_velocity derived from orientation" in n for n in lesson.notes) == 1


def test_a_steady_turn_has_exactly_its_speed_in_the_task_frame():
    recording, *_ = tilted()
    time = recording["hand.orientation"].time
    q = sphere.product(sphere.quaternion(np.outer(2.0 * time, AXIS)), BASE)
    steady = recording.with_channels({"hand.orientation": replace(recording["hand.orientation"], values=q)})
    omega = demonstration(steady, orientation=True)["angular_velocity"]
    np.testing.assert_allclose(omega[30:-30], np.tile(2.0 * AXIS, (len(omega) - 60, 1)), atol=1e-3)


def test_torque_and_angular_velocity_are_in_one_frame_so_their_product_is_power():
    recording, omega, _ = tilted()
    lesson = demonstration(recording, orientation=True)
    work = (lesson["torque"] * lesson["angular_velocity"]).sum() * lesson.dt
    assert work == pytest.approx(0.8 * (omega**2).sum() * lesson.dt, rel=0.02)


def test_signs_that_flip_change_nothing_and_are_said():
    plain, flipped = (demonstration(tilted(flips=f)[0], orientation=True) for f in (False, True))
    assert sphere.distance(plain["orientation"], flipped["orientation"]).max() < 1e-7
    assert np.abs(np.diff(flipped["orientation"], axis=0)).max() < 0.02
    np.testing.assert_allclose(flipped["angular_velocity"], plain["angular_velocity"], atol=1e-9)
    assert any("sign of" in n for n in flipped.notes)
    assert not any("sign of" in n for n in plain.notes)


def test_another_order_of_columns_is_known_by_its_names():
    one, other = (demonstration(tilted(axes=a)[0], orientation=True) for a in ("wxyz", "xyzw"))
    np.testing.assert_array_equal(one["orientation"], other["orientation"])


def test_another_rate_gives_unit_quaternions_of_the_same_turn():
    lesson = demonstration(tilted(rate_hz=37.0, flips=True)[0], orientation=True, rate_hz=100.0)
    size = np.linalg.norm(lesson["orientation"], axis=1)
    np.testing.assert_allclose(size, 1.0, atol=1e-12)
    at = np.arange(len(lesson)) * lesson.dt
    angle = minimum_jerk(at, height=1.2)[0]
    expected = sphere.product(sphere.quaternion(np.outer(angle, AXIS)), BASE)
    assert sphere.distance(lesson["orientation"], expected).max() < 2e-3


def test_an_extra_quaternion_is_one_too():
    lesson = demonstration(tilted(rate_hz=37.0, flips=True)[0], extra=("hand.orientation",), rate_hz=100.0)
    np.testing.assert_allclose(np.linalg.norm(lesson["hand.orientation"], axis=1), 1.0, atol=1e-12)
    assert np.abs(np.diff(lesson["hand.orientation"], axis=0)).max() < 0.05


def spoiled(change, frame=50):
    recording, *_ = tilted()
    values = np.array(recording["hand.orientation"].values)
    change(values, frame)
    return recording.with_channels({"hand.orientation": replace(recording["hand.orientation"], values=values)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda q, k: q[k].__imul__(1.1), r"orientation: frame 50 \(t = 0\.5\d* s\) has length 1\.1.*allowed: 1 within"),
        (lambda q, k: q[k].__imul__(0.0), r"frame 50 .* has length 0.*an empty quaternion"),
        (lambda q, k: q[k:].__setitem__((slice(None), slice(None)), q[k:][:, [3, 0, 1, 2]]), r"turns by .* rad at frame 50"),
    ],
)
def test_what_is_no_orientation_is_refused_with_the_frame(change, message):
    with pytest.raises(RecordingError, match=message):
        demonstration(spoiled(change), orientation=True)


def test_a_length_that_rounding_left_is_made_one_and_said():
    lesson = demonstration(spoiled(lambda q, k: q.__imul__(1.0005)), orientation=True)
    np.testing.assert_allclose(np.linalg.norm(lesson["orientation"], axis=1), 1.0, atol=1e-12)
    assert any("normalised; lengths were 1.0005" in n for n in lesson.notes)


def test_what_is_missing_or_in_another_frame_is_refused():
    with pytest.raises(ChannelError, match=r"no 'hand\.orientation'; found"):
        demonstration(lift(), orientation=True)
    recording, *_ = tilted()
    other = recording.with_channels({"hand.torque": replace(recording["hand.torque"], frame="sensor")})
    with pytest.raises(ChannelError, match=r"different frames \(orientation: task; torque: sensor\)"):
        demonstration(other, orientation=True)
    wrong = recording.with_channels({"hand.torque": replace(recording["hand.torque"], unit="N")})
    with pytest.raises(ChannelError, match="allowed: x, y, z in N m"):
        demonstration(wrong, orientation=True)


def test_lessons_with_orientation_are_written_read_and_learned_from(tmp_path):
    files = [tmp_path / f"{n}.mcap" for n in range(3)]
    for n, file in enumerate(files):
        write(tilted(n, flips=True)[0], file)
    lessons = demonstrations([r for f in files for r in read(f)], orientation=True)
    channels = tuple(c for c in lessons[0].channels if c.split(".")[0] in ("position", "orientation", "torque"))
    model = fit_riemannian_hmm([x.array(channels) for x in lessons], 5, channels=channels).model
    height = np.array([[0.81], [0.92], [1.04]])
    found = regress(model, "position", "orientation", height)
    angle = 1.2 * (height - 0.8) / 0.25
    expected = sphere.product(sphere.quaternion(angle * AXIS), BASE)
    assert sphere.distance(found.mean, expected).max() < 0.06
