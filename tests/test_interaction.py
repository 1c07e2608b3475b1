"""Eq. (3): weight and inertia of the load vanish, the partner's intent stays; off line and tick by tick alike."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ChannelError, ParameterError
from comanip.interaction import (
    CausalInteractionForce,
    Payload,
    RigidLoad,
    TaringInteractionForce,
    TurningInteractionForce,
    TurningLoad,
    gravity_along,
    identify_payload,
    interaction_force,
    mean_and_error,
)
from comanip.interfaces import STANDARD_GRAVITY, Observation
from comanip.lessons.demonstration import demonstration
from comanip.recording import Channel
from comanip.signals.filters import Lowpass, differentiate, smooth
from lifts import lift, minimum_jerk

DT, MASS = 0.01, 5.0
TIME = np.arange(0, 5, DT)
GRAVITY = gravity_along(("z",))


def carried(intent=0.0):
    """(x, dx, ddx, F_s) of a 5 kg object shared by two: the hand carries half of its weight and inertia."""
    x, dx, ddx = minimum_jerk(TIME)
    return x, dx, ddx, intent - 0.5 * MASS * (ddx + STANDARD_GRAVITY)


def test_at_rest_the_weight_vanishes():
    sensed = np.full((10, 1), -0.5 * MASS * STANDARD_GRAVITY)
    force = interaction_force(sensed, np.zeros((10, 1)), mass_kg=MASS, gravity=GRAVITY)
    assert np.abs(force).max() < 1e-12


def test_carrying_the_load_needs_no_partner():
    _, _, ddx, sensed = carried()
    force = interaction_force(sensed[:, None], ddx[:, None], mass_kg=MASS, gravity=GRAVITY)
    assert np.abs(force).max() < 1e-12


def test_a_partner_who_lifts_is_felt_upwards():
    _, _, ddx, sensed = carried(intent=7.0)
    force = interaction_force(sensed[:, None], ddx[:, None], mass_kg=MASS, gravity=GRAVITY)
    assert np.allclose(force, 7.0, atol=1e-12)


def test_weight_acts_along_z_alone():
    gravity = gravity_along(("x", "y", "z"))
    force = interaction_force(np.zeros(3), np.array([1.0, 2.0, 0.0]), mass_kg=2.0, load_share=1.0, gravity=gravity)
    assert np.allclose(force, [2.0, 4.0, 2.0 * STANDARD_GRAVITY], rtol=1e-15)


def test_a_recording_of_the_raw_force_becomes_interaction_force():
    recording = lift(noise=0.0)
    _, _, ddx = minimum_jerk(recording["hand.position"].time)
    intent = recording["hand.force"].values[:, 0]
    sensed = intent - 0.5 * MASS * (ddx + STANDARD_GRAVITY) + 0.3
    raw = Channel(recording["hand.force"].time, sensed, "N", "task", ("z",))
    channels = {n: c for n, c in recording.channels.items() if n != "hand.force"} | {"hand.sensor_force": raw}
    recording = type(recording)(channels, recording.metadata)
    with pytest.raises(ChannelError, match="needs the payload"):
        demonstration(recording)
    lesson = demonstration(recording, payload=Payload(MASS, force_bias_n=(0.3,)))
    assert np.abs(lesson.force[:, 0] - intent).max() < 0.15
    assert any("force from eq. (3): mass 5 kg, share 0.5" in n for n in lesson.notes)
    stated = recording.with_metadata(payload={"mass_kg": MASS, "force_bias_n": [0.3]})
    assert demonstration(stated).sha256 == lesson.sha256
    whole = recording.with_metadata(load_mass_kg=0.5 * MASS, load_share=1.0)
    assert np.allclose(demonstration(whole).force - 0.3, lesson.force, atol=1e-9)


def estimate(sensed, dx, **options):
    """The causal force over a whole run, (T,)."""
    estimator = CausalInteractionForce(DT, mass_kg=MASS, gravity=GRAVITY, **options)
    obs, out = Observation(1), []
    for f, v in zip(sensed, dx, strict=True):
        obs.sensor_force[0], obs.velocity[0] = f, v
        estimator.step(obs)
        out.append(float(obs.force[0]))
    return np.array(out)


def test_on_line_the_load_stays_unfelt_within_millinewtons():
    _, dx, _, sensed = carried()
    assert np.abs(estimate(sensed, dx)).max() < 5e-3


@pytest.mark.parametrize(("dt", "expected_hz"), [(0.001, 40.0), (0.01, 40.0), (0.02, 20.0)])
def test_a_low_pass_is_as_fast_as_the_loop_allows(dt, expected_hz):
    """Who asks for none gets it: at 15 Hz an arm of 1 kg on its grip shakes with the robot."""
    rng, obs = np.random.default_rng(1), Observation(1)
    usual, asked = (CausalInteractionForce(dt, mass_kg=0.0, gravity=GRAVITY, **o) for o in ({}, {"cutoff_hz": expected_hz}))
    obs.velocity[0] = 0.0
    for force in rng.normal(size=50):
        obs.sensor_force[0] = force
        usual.step(obs)
        found = float(obs.force[0])
        asked.step(obs)
        assert found == float(obs.force[0])


def test_a_sensor_that_averages_is_half_a_tick_later():
    """Mean over a tick, 10 ms late: 15 ms; then no inertia is left over, where 10 ms would leave some."""
    fine = np.arange(0.0, 3.0, 0.001)
    a, v = np.sin(9.0 * fine), (1.0 - np.cos(9.0 * fine)) / 9.0
    felt = -0.5 * MASS * (np.concatenate([np.zeros(10), a[:-10]]) + STANDARD_GRAVITY)
    means = np.array([felt[n - 9 : n + 1].mean() for n in range(10, len(felt), 10)])
    speeds = v[10::10]
    left = [np.abs(estimate(means, speeds, force_delay_s=late)[50:]).max() for late in (0.010, 0.0145, 0.015)]
    assert left[1] < 0.2 * left[0]
    assert left[2] < 0.2 * left[0]


def test_on_line_is_off_line_seen_late():
    """The causal twin equals the exact force put through the same low-pass, half a tick late."""
    _, dx, ddx, _ = carried()
    intent = 8.0 * np.sin(2 * np.pi * 0.7 * TIME)
    online = estimate(intent - 0.5 * MASS * (ddx + STANDARD_GRAVITY), dx, cutoff_hz=10.0)
    lowpass = Lowpass(10.0, DT)
    expected = np.array([lowpass.step(v) for v in np.interp(TIME - 0.5 * DT, TIME, intent)])
    assert np.abs(online - expected)[20:].max() < 0.02
    offline = smooth(intent, DT, 10.0)
    delays = np.arange(0, 12)
    errors = [np.abs(online[50:] - offline[50 - k : len(offline) - k]).max() for k in delays]
    assert delays[int(np.argmin(errors))] in (2, 3)  # 0.225 / 10 Hz + dt / 2 = 27 ms


@pytest.mark.parametrize("delay", [0.004, 0.005, 0.012, 0.02])
def test_a_known_sensor_delay_is_matched(delay):
    _, dx, _, _ = carried()
    _, _, late = minimum_jerk(TIME - delay)
    sensed = -0.5 * MASS * (late + STANDARD_GRAVITY)
    matched = np.abs(estimate(sensed, dx, force_delay_s=delay)).max()
    assert matched < 0.01
    assert matched < 0.3 * np.abs(estimate(sensed, dx)).max()


@pytest.mark.parametrize("channel", ["sensor_force", "velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
def test_one_bad_tick_gives_one_nan_and_is_forgotten(channel, value):
    _, dx, _, sensed = carried(intent=3.0)
    spoiled = {"sensor_force": sensed.copy(), "velocity": dx.copy()}
    if channel == "velocity" and value == 1e308:
        value = -np.inf
    spoiled[channel][130] = value
    force = estimate(spoiled["sensor_force"], spoiled["velocity"])
    assert np.flatnonzero(np.isnan(force)).tolist() == [130]
    good = estimate(sensed, dx)
    assert np.nanmax(np.abs(force - good)) < 0.03
    assert np.abs(force - good)[200:].max() < 1e-6


def test_reset_makes_two_runs_equal():
    estimator = CausalInteractionForce(DT, mass_kg=MASS, gravity=GRAVITY, force_delay_s=0.02)
    _, dx, _, sensed = carried(intent=2.0)
    runs = []
    for _ in range(2):
        estimator.reset()
        obs, out = Observation(1), []
        for f, v in zip(sensed, dx, strict=True):
            obs.sensor_force[0], obs.velocity[0] = f, v
            estimator.step(obs)
            out.append(float(obs.force[0]))
        runs.append(out)
    assert runs[0] == runs[1]


def noise(size, rng, tau=10):
    """Sensor noise that remembers itself for about `tau` samples."""
    white, out = rng.normal(size=size), np.empty(size)
    keep, state = np.exp(-1.0 / tau), 0.0
    for i, w in enumerate(white):
        state = keep * state + np.sqrt(1 - keep**2) * w
        out[i] = state
    return out[:, None]


def test_the_error_of_a_mean_counts_the_memory_of_the_noise():
    rng = np.random.default_rng(0)
    means, errors = zip(*(mean_and_error(noise(1000, rng)) for _ in range(200)), strict=True)
    true = np.std(means)
    assert 0.8 * true < np.mean(errors) < 1.2 * true
    assert true > 3.0 / np.sqrt(1000)  # treating samples as independent would be more than 3 times too sure


def test_mass_from_rest_is_footnote_2_and_its_error_is_honest():
    rng, off = np.random.default_rng(1), []
    for _ in range(100):
        payload = identify_payload(-0.5 * MASS * STANDARD_GRAVITY + 0.3 * noise(600, rng), gravity=GRAVITY)
        off.append((payload.mass_kg - MASS) / payload.mass_std_kg)
    assert 0.7 < np.std(off) < 1.4
    assert abs(np.mean(off)) < 0.4


def test_two_windows_give_bias_and_mass_one_gives_either():
    rng = np.random.default_rng(2)
    empty = 1.7 + 0.1 * noise(500, rng)
    holding = 1.7 - 0.5 * MASS * STANDARD_GRAVITY + 0.1 * noise(500, rng)
    both = identify_payload(holding, gravity=GRAVITY, empty=empty)
    assert abs(both.mass_kg - MASS) < 4 * both.mass_std_kg < 0.1
    assert abs(both.force_bias_n[0] - 1.7) < 0.1
    bias = identify_payload(holding, gravity=GRAVITY, mass_kg=MASS)
    assert abs(bias.force_bias_n[0] - 1.7) < 0.1
    with pytest.raises(ParameterError, match="one of"):
        identify_payload(holding, gravity=GRAVITY, mass_kg=MASS, empty=empty)


def test_a_mass_that_pulls_upwards_is_a_sign_error():
    with pytest.raises(ParameterError, match="flip the column's sign"):
        identify_payload(np.full((100, 1), 24.5), gravity=GRAVITY)
    with pytest.raises(ParameterError, match="vertical"):
        identify_payload(np.full((100, 1), 24.5), gravity=gravity_along(("x",)))


def test_derivative_and_filter_have_no_delay_off_line():
    wave = np.sin(2 * np.pi * 1.0 * TIME)
    slope = 2 * np.pi * np.cos(2 * np.pi * 1.0 * TIME)
    assert np.abs(smooth(wave, DT, 10.0) - wave)[50:-50].max() < 1e-3
    assert np.abs(differentiate(wave, DT) - slope).max() < 0.02


def test_halving_the_step_quarters_the_derivative_error():
    def error(dt):
        time = np.arange(0, 2, dt)
        return np.abs(differentiate(np.sin(3 * time), dt) - 3 * np.cos(3 * time)).max()

    assert 3.5 < error(0.02) / error(0.01) < 4.5


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 45.0, 60.0, np.nan])
def test_a_cutoff_that_cannot_be_is_refused(cutoff):
    with pytest.raises(ParameterError, match="allowed: 0 < cutoff < 45 Hz"):
        Lowpass(cutoff, DT)


def test_the_low_pass_has_butterworth_attenuation_and_unit_gain():
    signal = pytest.importorskip("scipy.signal")
    from comanip.signals.filters import lowpass_coefficients

    b, a = signal.butter(2, 10.0, fs=100.0)
    b0, b1, b2, a1, a2 = lowpass_coefficients(10.0, DT)
    assert np.allclose([b0, b1, b2, 1.0, a1, a2], [*b, *a], rtol=1e-12)
    section = Lowpass(10.0, DT)
    assert all(abs(section.step(3.7) - 3.7) < 1e-12 for _ in range(100))


@pytest.mark.parametrize("mass_kg", [0.5, 3.0])
def test_what_is_weighed_on_line_is_the_mass_that_inertia_is_taken_from(mass_kg):
    estimator, obs = TaringInteractionForce(0.01, gravity=[-STANDARD_GRAVITY]), Observation(1)
    obs.position[:] = obs.velocity[:] = 0.0
    obs.sensor_force[:] = -0.5 * mass_kg * STANDARD_GRAVITY
    for _ in range(30):
        estimator.step(obs)
    assert estimator.payload_kg == pytest.approx(mass_kg)


def test_what_is_weighed_at_rest_is_mass_along_gravity_and_bias_across_it():
    taring, obs = TaringInteractionForce(DT, gravity=(6.0, 0.0, -8.0)), Observation(3)
    bias = np.array([0.4, -0.2, 0.3])  # across gravity, which these axes are turned against
    for n in range(40):
        obs.time, obs.velocity[:], obs.sensor_force[:] = n * DT, 0.0, 0.5 * 3.0 * np.array([6.0, 0.0, -8.0]) + bias
        taring.step(obs)
    assert taring.payload_kg == pytest.approx(3.0)
    assert obs.force == pytest.approx(np.zeros(3), abs=1e-9)


def turned(ticks, moves_at, bias=0.5):
    """F of an arc that weighs nothing and reads `bias`, then 2 N more from `moves_at` on, where it also moves."""
    load = TurningLoad(carried_kg=(1.0, 1.0), gravity=(-9.8, 0.0), angle=1, lever_m=0.4)
    force, obs, seen = TurningInteractionForce(DT, load), Observation(2), []
    for n in range(ticks):
        moves = n >= moves_at
        obs.time, obs.position[:], obs.velocity[:] = n * DT, 0.0, (0.0, 0.05 if moves else 0.0)
        obs.sensor_force[:] = -9.8 + bias + 2.0 * moves, bias + 2.0 * moves
        force.step(obs)
        seen.append(obs.force.copy())
    return np.array(seen)


def test_a_turning_object_is_tared_by_the_mean_of_a_quarter_second_at_rest():
    still = turned(40, moves_at=40)
    assert np.abs(still).max() < 1e-9
    early = turned(60, moves_at=10)  # the window ends where it begins to move
    assert early[-1] == pytest.approx([2.0, 2.0], abs=1e-3)
    after = turned(80, moves_at=30)
    assert after[-1] == pytest.approx([2.0, 2.0], abs=1e-3)


def test_a_load_s_centre_is_at_the_hand_unless_stated():
    assert RigidLoad(2.0).centre_m == (0.0, 0.0, 0.0)
    load = TurningLoad(carried_kg=(1.0, 1.0), gravity=(0.0, 0.0), angle=1, lever_m=0.4, across=0)
    assert load.centre_velocity(np.array([0.0, 0.1]), np.array([0.3, 0.2])) == pytest.approx([0.3, 0.2])
