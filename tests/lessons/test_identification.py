"""What a recording shows of its own force: right values on motions whose law, load and clock are known on paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ChannelError, ParameterError
from comanip.formats import Columns, read
from comanip.formats.frames import rotate
from comanip.lessons.admittance import admittance, units_of
from comanip.lessons.demonstration import Demonstration, Preparation, demonstration
from comanip.lessons.identification import identify, interaction_only
from comanip.lessons.wrench import carried, turned_by
from comanip.recording import Channel, Recording
from comanip.signals.links import linked

G0 = 9.80665
DT = 0.005
T = np.arange(0.0, 24.0, DT)
GRAVITY = np.array([0.0, 0.0, -G0])


def motion(t, seed, d, size=0.1):
    """(position, velocity, acceleration), (T, d): nine sines a channel between 0.2 and 2.5 Hz, known at any time."""
    rng = np.random.default_rng(seed)
    x, v, a = (np.zeros((len(t), d)) for _ in range(3))
    for axis in range(d):
        for hz in rng.uniform(0.2, 2.5, 9):
            w, phase, high = 2 * np.pi * hz, rng.uniform(0, 6.3), size * rng.uniform(0.2, 1.0) / hz
            x[:, axis] += high * np.sin(w * t + phase)
            v[:, axis] += high * w * np.cos(w * t + phase)
            a[:, axis] -= high * w * w * np.sin(w * t + phase)
    return x, v, a


def lesson(force, late_s=0.0, d=1, noise_n=0.0, noise_v=0.0, units=("m", "N", "m/s")):
    """A recording whose force, a function of (x, v, a), is stamped `late_s` too late."""
    rng = np.random.default_rng(1)
    x, v, _ = motion(T, 0, d)
    f = force(*motion(T - late_s, 0, d)) + noise_n * rng.normal(size=(len(T), d))
    signals = {"position": x, "force": f, "velocity": v + noise_v * rng.normal(size=v.shape)}
    axes = ("x", "y", "z")[:d]
    return Demonstration("made", DT, signals, axes, units=dict(zip(("position", "force", "velocity"), units, strict=True)))


@pytest.mark.parametrize("late_ms", [-23.0, 0.0, 7.3, 60.0])
def test_an_admittance_its_clock_and_its_bias_are_found(late_ms):
    made = lesson(lambda x, v, a: 2.0 * a + 15.0 * v + 80.0 * x + 3.0, late_ms * 1e-3, noise_n=0.5)
    found = admittance(made)
    assert found.terms == "M D K"
    assert (found.explains, found.offset_known, found.of_the_partner) == (True, True, False)
    assert found.offset.value * 1e3 == pytest.approx(late_ms, abs=1.0)
    for term, true in ((found.inertia, 2.0), (found.damping, 15.0), (found.stiffness, 80.0), (found.bias, 3.0)):
        assert term[0].value == pytest.approx(true, abs=max(4.0 * term[0].error, 0.01 * true))
        assert term[0].error < 0.1 * true


def test_errors_are_as_large_as_they_say_where_noise_repeats_itself():
    """Twenty recordings with a partner's slow force as the noise: the truth lies within two errors as often as it should."""
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(20):
        slow = np.convolve(rng.normal(size=len(T)), np.ones(60) / np.sqrt(60.0), "same")[:, None]
        found = admittance(lesson(lambda x, v, a, slow=slow: 2.0 * a + 15.0 * v + slow), offsets=False)
        inside.append(abs(found.damping[0].value - 15.0) < 2.0 * found.damping[0].error)
    assert 15 <= sum(inside) <= 20


@pytest.mark.parametrize(
    ("law", "terms"),
    [
        (lambda x, v, a: 15.0 * v, "D"),
        (lambda x, v, a: 300.0 * x, "K"),
        (lambda x, v, a: 2.0 * a, "M"),
        (lambda x, v, a: 2.0 * a + 15.0 * v, "M D"),
    ],
)
def test_no_term_is_taken_that_the_data_do_not_bear_out(law, terms):
    assert admittance(lesson(law, noise_n=1.0)).terms == terms


def test_a_law_on_axes_of_two_units_is_told_by_axis():
    law = np.array([[2.0, 0.3], [15.0, 1.5]])
    made = lesson(lambda x, v, a: law[0] * a + law[1] * v, d=2, units=("m, rad", "N, N m", "m/s, rad/s"), noise_n=0.05)
    found = admittance(made)
    assert [t.value for t in found.inertia] == pytest.approx(law[0], rel=0.02)
    assert [t.value for t in found.damping] == pytest.approx(law[1], rel=0.02)
    assert units_of(made, "M") == ("kg", "kg m²")
    assert units_of(made, "D") == ("N s/m", "N m s/rad")


def test_a_partner_who_answers_a_leading_hand_is_told_by_the_signs():
    found = admittance(lesson(lambda x, v, a: -1.5 * a - 20.0 * v, noise_n=0.3))
    assert found.of_the_partner


def test_a_force_that_nothing_links_to_the_motion_is_not_explained():
    rng = np.random.default_rng(2)
    slow = 3.0 * np.convolve(rng.normal(size=len(T)), np.ones(40) / np.sqrt(40.0), "same")[:, None]
    found = admittance(lesson(lambda x, v, a: slow))
    assert found.r2 < 0.2
    assert (found.explains, found.offset_known) == (False, False)
    assert np.isnan(found.offset.value)


def stroke(force, *, late_s=0.0, noise_m=0.0, noise_v=None, noise_n=0.05, seed=3):
    """One short stroke, as people record it: position, force, and velocity only with a `noise_v`."""
    rng, t = np.random.default_rng(seed), np.arange(500) * 0.01

    def at(time):
        u = np.clip((time - 1.2) / 2.3, 0.0, 1.0)
        rows = (u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2 / 2.3, 60 * u * (1 - u) * (1 - 2 * u) / 2.3**2)
        return [0.3 * row[:, None] for row in rows]

    x, v, _ = at(t)
    channels = {
        "hand.position": Channel(t, x + noise_m * rng.normal(size=x.shape), "m", "task", ("z",)),
        "hand.force": Channel(t, force(*at(t - late_s)) + noise_n * rng.normal(size=x.shape), "N", "task", ("z",)),
    }
    if noise_v is not None:
        channels["hand.velocity"] = Channel(t, v + noise_v * rng.normal(size=v.shape), "m/s", "task", ("z",))
    return demonstration(Recording(channels, {"name": "stroke"}))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("recorded", [{"noise_m": 1e-4}, {"noise_m": 1e-4, "noise_v": 1e-3}])
def test_the_lead_of_a_force_that_moves_a_mass_is_no_clock_that_is_off(recorded, seed):
    """2 kg and 18 N s/m: to first order a force that comes 111 ms early."""
    found = admittance(stroke(lambda x, v, a: 2.0 * a + 18.0 * v, seed=seed, **recorded))
    assert found.explains
    assert not found.offset_known or abs(found.offset.value) < max(0.02, 3.0 * found.offset.error)
    assert "M" in found.terms.split()
    assert found.inertia[0].value == pytest.approx(2.0, abs=max(0.4, 3.0 * found.inertia[0].error))


@pytest.mark.parametrize("seed", range(4))
def test_a_force_that_comes_late_cannot_be_a_mass_s_and_is_said(seed):
    found = admittance(stroke(lambda x, v, a: 18.0 * v, late_s=0.08, noise_m=1e-4, seed=seed))
    assert found.offset_known
    assert found.offset.value == pytest.approx(0.08, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_damper_beside_a_spring_is_no_spring_that_is_early(seed):
    """100 N/m and 5 N s/m: to first order a spring's force that comes 50 ms early."""
    found = admittance(stroke(lambda x, v, a: 100.0 * x + 5.0 * v, noise_m=1e-4, noise_v=1e-3, noise_n=0.3, seed=seed))
    assert not found.offset_known or abs(found.offset.value) < 3.0 * found.offset.error
    assert found.damping[0].value == pytest.approx(5.0, abs=max(0.5, 3.0 * found.damping[0].error))


def test_force_and_a_derived_velocity_pass_one_low_pass():
    """Without noise the law is exact, whether velocity was recorded or derived."""
    found = admittance(stroke(lambda x, v, a: 2.0 * a + 18.0 * v, noise_n=0.0), offsets=False)
    assert (found.terms, found.r2 > 0.9999) == ("M D", True)


def test_noise_in_the_acceleration_is_told():
    clean, noisy = (admittance(lesson(lambda x, v, a: 2.0 * a, noise_v=n)) for n in (0.0, 0.4))
    assert clean.noise_share[0] < 0.01 < 0.1 < noisy.noise_share[0]
    assert noisy.inertia[0].value == pytest.approx(2.0 * (1.0 - noisy.noise_share[0]), rel=0.1)


def test_what_cannot_be_identified_is_refused():
    still = lesson(lambda x, v, a: 0.0 * x + 4.0)
    with pytest.raises(ParameterError, match="never changes"):
        admittance(still)
    short = Demonstration("short", DT, {n: v[:40] for n, v in lesson(lambda x, v, a: v).signals.items()}, ("x",))
    with pytest.raises(ParameterError, match="too short"):
        admittance(short)


def test_units_change_no_result():
    """Millimetres: K a thousandth, offset and R² the same."""
    made = lesson(lambda x, v, a: 2.0 * a + 15.0 * v, 0.013, noise_n=0.2)
    other = {n: v * (1.0 if n == "force" else 1e3) for n, v in made.signals.items()}
    a, b = admittance(made), admittance(Demonstration("mm", DT, other, ("x",)))
    assert (b.offset.value, b.r2) == pytest.approx((a.offset.value, a.r2), abs=1e-6)
    assert 1e3 * b.damping[0].value == pytest.approx(a.damping[0].value, rel=1e-6)


def test_a_weight_on_one_axis_is_told_from_its_inertia():
    """F_s = m (g - a) + b without rotation: only acceleration tells mass from bias."""
    x, v, a = motion(T, 3, 3)
    force = 1.4 * (GRAVITY - a) + np.array([0.5, -1.0, 2.0]) + 0.1 * np.random.default_rng(0).normal(size=x.shape)
    load = carried(force, v, DT, gravity=GRAVITY)
    assert load.mass_kg[0] == pytest.approx(1.4, abs=0.005)  # central differences take a little off
    assert load.mass_kg[1] < 0.05
    assert load.bias[0] == pytest.approx([0.5, -1.0, 2.0], abs=0.1)
    assert {"centre", "gravity", "mount"} <= set(load.unknown)


def test_a_mass_that_never_accelerates_is_unknown():
    rng = np.random.default_rng(0)
    force = 1.4 * GRAVITY + 0.1 * rng.normal(size=(len(T), 3))
    load = carried(force, 1e-4 * rng.normal(size=force.shape), DT, gravity=GRAVITY)
    assert (load.mass_kg, load.bias) == (None, None)
    assert "shake" in load.unknown["mass"]


def tumbling(turn=1.2):
    """(T, 4) w, x, y, z: a hand that turns about all axes."""
    angles = turn * motion(T, 9, 3, size=0.5)[0]
    half = 0.5 * np.linalg.norm(angles, axis=1, keepdims=True)
    return np.hstack([np.cos(half), angles * 0.5 * np.sinc(half / np.pi)])


def sensed(mass, bias, centre, torque_bias, mount=np.eye(3), late_s=0.0, noise=0.05):
    """(force, torque, velocity, orientation) of an object that is turned and accelerated."""
    rng = np.random.default_rng(4)
    q = tumbling()
    _, v, a = motion(T, 3, 3)
    pull = rotate(q * [1, -1, -1, -1], mass * (GRAVITY - a)) @ mount.T
    force, torque = pull + bias, np.cross(centre, pull) + torque_bias
    late = [np.interp(T - late_s, T, column) for column in np.hstack([force, torque]).T]
    wrench = np.stack(late, axis=1) + noise * rng.normal(size=(len(T), 6)) * [1, 1, 1, 0.02, 0.02, 0.02]
    return wrench[:, :3], wrench[:, 3:], v, q


BIAS, CENTRE, TORQUE_BIAS = np.array([2.0, -1.0, 4.0]), np.array([0.02, -0.01, 0.08]), np.array([0.1, 0.0, -0.2])


def test_a_hand_that_turns_shows_mass_bias_gravity_and_the_centre_of_mass():
    force, torque, v, q = sensed(1.4, BIAS, CENTRE, TORQUE_BIAS, late_s=0.012)
    load = carried(force, v, DT, gravity=GRAVITY, orientation=np.where(T[:, None] > 10.0, -q, q), torque=torque)
    assert load.mass_kg[0] == pytest.approx(1.4, abs=0.01)
    assert load.bias[0] == pytest.approx(BIAS, abs=0.1)
    assert load.gravity[0] == pytest.approx(GRAVITY, abs=0.1)
    assert load.centre_m[0] == pytest.approx(CENTRE, abs=2e-3)
    assert load.torque_bias[0] == pytest.approx(TORQUE_BIAS, abs=0.02)
    assert load.offset_s[0] == pytest.approx(0.012, abs=1e-3)
    assert load.r2 > 0.99


def test_gravity_is_found_wherever_the_world_has_it():
    tilted = np.array([0.0, 6.0, 0.0]) + GRAVITY * 0.8
    q = tumbling()
    force = rotate(q * [1, -1, -1, -1], np.tile(1.1 * tilted, (len(T), 1)))
    load = carried(force, np.zeros_like(force), DT, gravity=GRAVITY, orientation=q)
    assert load.gravity[0] / np.linalg.norm(load.gravity[0]) == pytest.approx(tilted / np.linalg.norm(tilted), abs=0.01)


def test_a_sensor_mounted_at_an_angle_is_found():
    c, s = np.cos(0.9), np.sin(0.9)
    mount = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    force, torque, v, q = sensed(1.4, BIAS, CENTRE, TORQUE_BIAS, mount=mount)
    load = carried(force, v, DT, gravity=GRAVITY, orientation=q, torque=torque)
    assert load.mount == pytest.approx(mount, abs=0.02)
    assert load.mount_angle_rad[0] == pytest.approx(0.9, abs=0.02)
    assert load.mass_kg[0] == pytest.approx(1.4, abs=0.03)
    assert load.centre_m[0] == pytest.approx(CENTRE, abs=3e-3)


def test_an_orientation_that_hardly_changes_says_what_it_cannot_show():
    force, torque, v, _ = sensed(1.4, BIAS, CENTRE, TORQUE_BIAS)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
    load = carried(1.4 * GRAVITY + 0.0 * force, 0.0 * v, DT, gravity=GRAVITY, orientation=still, torque=torque)
    assert (load.gravity, load.mount, load.centre_m) == (None, None, None)
    assert "turns by 0°" in load.unknown["gravity"]


def test_two_signs_of_a_quaternion_are_one_turn():
    q = tumbling()
    assert turned_by(np.where(np.arange(len(q))[:, None] % 2 == 0, q, -q)) == pytest.approx(turned_by(q))
    assert turned_by(np.tile(q[:1], (50, 1))) == pytest.approx(0.0, abs=1e-6)


def test_what_a_person_pulls_is_the_rest():
    """Residual = the partner's force, on the motion's clock, which is what clean means."""
    rng = np.random.default_rng(8)
    _, v, a = motion(T, 3, 1)
    person = 2.0 * np.convolve(rng.normal(size=len(T)), np.ones(80) / np.sqrt(80.0), "same")[:, None]
    load = carried(1.4 * (GRAVITY[2:] - a) + person, v, DT, gravity=GRAVITY[2:])
    middle = slice(200, -200)
    assert np.corrcoef(load.residual[middle, 0], person[middle, 0])[0, 1] > 0.97


def test_too_few_frames_are_refused():
    with pytest.raises(ParameterError, match="too few"):
        linked(np.ones((6, 1, 2)), np.ones((6, 1)), DT)


def recorded(force, position, velocity, name="hand.force", frame="task", **more):
    channels = {"hand.position": (position, "m"), "hand.velocity": (velocity, "m/s"), name: (force, "N"), **more}
    axes = ("x", "y", "z")[-position.shape[1] :]
    return Recording(
        {n: Channel(T, v, u, frame, ("w", "x", "y", "z") if n == "hand.orientation" else axes) for n, (v, u) in channels.items()},
        {"name": "made", "role": "follower"},
    )


@pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
def test_the_clean_force_of_an_admittance_is_on_the_motions_clock_and_without_its_bias():
    x, v, a = motion(T, 0, 1)
    _, late_v, late_a = motion(T - 0.015, 0, 1)
    found = identify(recorded(2.0 * late_a + 15.0 * late_v + 3.0, x, v))
    clean = interaction_only(found)
    middle = slice(100, -100)
    assert clean["hand.force"].values[middle] == pytest.approx((2.0 * a + 15.0 * v)[middle], abs=0.15)
    assert (clean["hand.force_recorded"].values == found.lesson.force).all()
    assert any("moved by -15" in n for n in clean.metadata["notes"])
    assert demonstration(clean).force == pytest.approx(clean["hand.force"].values)


@pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
def test_the_clean_force_of_a_raw_sensor_is_what_the_partner_pulls():
    rng = np.random.default_rng(8)
    x, v, a = motion(T, 3, 1)
    person = 2.0 * np.convolve(rng.normal(size=len(T)), np.ones(80) / np.sqrt(80.0), "same")[:, None]
    found = identify(recorded(1.4 * (GRAVITY[2:] - a) + person, x, v, name="hand.sensor_force"))
    assert found.raw
    assert found.load.mass_kg[0] == pytest.approx(1.4, abs=0.05)
    middle = slice(200, -200)
    left = interaction_only(found)["hand.force"].values[middle] - (person - person.mean())[middle]
    assert np.abs(left).mean() < 0.4


@pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
def test_a_wrench_that_was_turned_into_the_world_is_weighed_in_the_hand():
    """Same frame as the position: a bias of the sensor turns with the hand there, and only in the hand it stands still."""
    x = motion(T, 3, 3)[0]
    force, _, v, q = sensed(1.4, BIAS, CENTRE, TORQUE_BIAS)
    world = rotate(q, force)
    found = identify(recorded(world, x, v, name="hand.sensor_force", **{"hand.orientation": (q, "")}))
    assert found.load.mass_kg[0] == pytest.approx(1.4, abs=0.02)
    assert found.load.bias[0] == pytest.approx(BIAS, abs=0.1)
    assert np.abs(interaction_only(found)["hand.force"].values[200:-200]).mean() < 0.1


def test_a_recording_without_force_is_refused():
    x = motion(T, 0, 1)[0]
    with pytest.raises(ChannelError, match="no force to identify"):
        identify(Recording({"hand.position": Channel(T, x, "m", "task", ("x",))}))


@pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
def test_the_law_of_an_exoskeleton_is_found():
    """Its authors state I 0.01, B 0.03 a degree; their integrator's half step makes the force 2 ms late."""
    path = Path(__file__).resolve().parents[3] / "shared/data/asu_reaches/TaskClass_data2.csv"
    if not path.exists():
        pytest.skip("the real recording ../shared/data/asu_reaches is not here")
    pair = {"position": "ADMI_{}_pos", "velocity": "ADMI_{}_vel", "force": "{}_torque"}
    names = {n: tuple(form.format(axis) for axis in ("pitch", "yaw")) for n, form in pair.items()}
    columns = Columns(**names, time="time_stamp", axes="pitch,yaw", position_unit="deg", velocity_unit="deg/s", force_unit="N m")
    law = identify(read(path, columns)[0], Preparation(plausible=None)).law
    assert (law.terms, law.explains) == ("M D", True)
    for axis in range(2):
        assert np.radians(law.inertia[axis].value) == pytest.approx(0.01, rel=0.03)
        assert np.radians(law.damping[axis].value) == pytest.approx(0.03, rel=0.01)
    assert law.offset.value == pytest.approx(0.002, abs=5e-4)
