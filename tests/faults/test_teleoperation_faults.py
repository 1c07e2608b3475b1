"""Faults of the teacher's side (catalogue O): device, cable, network, walls. The arm brakes, says why, and never jumps."""

from __future__ import annotations

import json
from math import inf, nan

import numpy as np
import pytest

from comanip.devices.link import Network
from comanip.devices.phantom import HeldHandle, phantom
from comanip.errors import ComanipWarning, ParameterError
from comanip.experiments.stability_map import SLIPPERY
from comanip.lessons.demonstration import demonstrations
from comanip.skills.passivity import Passive, PassivityLaw
from comanip.skills.teleoperation import CouplingLimits, Teleoperation
from comanip.teaching import PHANTOM, Coupling, teach
from haptics import FreeHand, Scripted, both_hold, driven, over, pulse, ripple

A_MAX = CouplingLimits().a_max_m_per_s2
SCALE = 1.3


def speed(recording):
    return recording["command.velocity"].values[:, 0]


def hold(recording):
    return recording["coupling.mode"].values[:, 0] == 1.0


def steps(recording):
    return np.abs(np.diff(speed(recording), prepend=0.0)).max()


def at(recording, t):
    return int(np.searchsorted(recording["hand.position"].time, t - 1e-9))


# O1, O2: the cable


def test_o1_an_unplugged_device_brakes_the_arm_and_the_take_is_kept_and_marked():
    run = driven(over(Scripted(lambda t: 0.3), Network(unplugged=((1.0, inf),))), duration=20.0)
    assert run.metadata["stop_reason"] == "device lost"
    assert run.metadata["notice"].startswith("HOLD: device lost")
    v, end = speed(run), at(run, 1.0)
    assert v[end - 2] == pytest.approx(SCALE * 0.3)
    assert not v[end + round(SCALE * 0.3 / A_MAX / 0.001) + 2 :].any()
    assert steps(run) <= A_MAX * 0.001 + 1e-12
    assert run["device.force"].values[-1] == pytest.approx(0.0, abs=1e-6)
    assert run.duration_s == pytest.approx(1.0 + CouplingLimits().patience_s, abs=0.01)


def test_o1_a_lesson_cut_short_says_so_when_it_is_learned_from():
    cut = teach("leader", 1, rng=np.random.default_rng(1), coupling=Coupling(network=Network(unplugged=((1.5, inf),))))
    whole = teach("leader", 1, rng=np.random.default_rng(1))
    assert cut[0].metadata["incomplete"] == "device lost"
    assert "incomplete" not in whole[0].metadata
    json.dumps(dict(cut[0].metadata))
    with pytest.warns(ComanipWarning, match=r"the take is incomplete \(device lost\)"):
        demonstrations([*cut, *whole], rate_hz=100.0)


def reconnected(clutch, back_to=0.0):
    """Lifted for 1 s, unplugged for 0.5 s while the handle moves 10 cm on, then `back_to` m from there; moved again at 4 s."""

    def velocity(t):
        return pulse(0.0, 1.0, 0.1)(t) + pulse(1.0, 1.5, 0.2)(t) + pulse(2.0, 3.0, back_to)(t) + pulse(4.0, 5.0, 0.1)(t)

    device = over(Scripted(velocity, clutch), Network(unplugged=((1.0, 1.5),)))
    return driven(device, duration=5.0, limits=CouplingLimits(patience_s=30.0))


@pytest.mark.parametrize(
    ("clutch", "back_to"),
    [
        (lambda t: True, 0.0),  # never released
        (lambda t: True, -0.1),
        (lambda t: not 3.2 < t < 3.4, 0.0),  # pressed again 10 cm off
        (lambda t: not 3.2 < t < 3.4, -0.07),  # 3 cm off
        (lambda t: t < 3.2, -0.1),  # not pressed again
    ],
)
def test_o2_a_reconnected_device_does_not_move_the_arm(clutch, back_to):
    run = reconnected(clutch, back_to)
    assert hold(run)[at(run, 1.01) :].all()
    assert not speed(run)[at(run, 1.1) :].any()


def test_o2_clutch_and_matching_pose_go_on_and_fade_in():
    run = reconnected(lambda t: not 3.2 < t < 3.4, back_to=-0.1)
    assert hold(run)[at(run, 1.01) : at(run, 3.39)].all()
    assert not hold(run)[at(run, 3.42) :].any()
    assert speed(run)[at(run, 4.2)] == pytest.approx(SCALE * 0.1 * 0.8 / 1.5, rel=0.02)  # 0.8 s into a ramp of 1.5 s
    assert speed(run)[at(run, 4.99)] == pytest.approx(SCALE * 0.1, rel=0.01)
    assert steps(run) <= A_MAX * 0.001 + 1e-12


def fails_once(t, v):
    """A sample that cannot be, at 1 s."""
    return 300.0 if 1.0 <= t < 1.0015 else v


def test_o2_pressed_while_the_arm_still_brakes_it_goes_on_holding():
    device = Scripted(lambda t: 0.2, clutch=lambda t: not 1.003 < t < 1.006, sample=fails_once)
    run = driven(device, duration=2.0)
    assert hold(run)[at(run, 1.01) :].all()


def test_o2_pressed_at_the_wrong_place_the_clutch_must_be_released_once_more():
    """The handle is away when the clutch comes back, and comes back itself while it is pressed: that is no pressing."""

    def moves(t):
        return 0.4 if 1.2 <= t < 1.4 else -0.4 if 2.0 <= t < 2.2 else 0.0

    run = driven(Scripted(moves, clutch=lambda t: not 1.5 < t < 1.6, sample=fails_once), duration=3.0)
    assert run["coupling.mismatch"].values[at(run, 1.7), 0] > 0.05
    assert run["coupling.mismatch"].values[-1, 0] < 0.01
    assert hold(run)[at(run, 1.01) :].all()
    again = driven(Scripted(moves, clutch=lambda t: not (1.5 < t < 1.6 or 2.5 < t < 2.6), sample=fails_once), duration=3.0)
    assert not hold(again)[at(again, 2.62) :].any()


def test_o4_a_delay_that_grows_takes_feedback_away_at_once_and_gives_it_back_slowly():
    device = Scripted(lambda t: 0.0)
    delay = np.zeros(1)
    device.channels["device.delay"] = (delay, "s")

    def grows(obs, command):
        delay[0] = 0.1 if 0.995 < obs.time < 1.995 else 0.0

    run = driven(device, plant=FreeHand(force=lambda t, x: 5.0), duration=3.0, taps=[grows])
    gain = run["coupling.gain"].values[:, 0]
    assert gain[at(run, 0.99)] == 1.0
    assert gain[at(run, 1.002)] == pytest.approx(0.1)
    assert gain[at(run, 1.9)] == pytest.approx(0.1)
    back = gain[at(run, 2.002) : at(run, 2.05)]
    assert back.max() < 0.7
    assert (np.diff(back) > 0.0).all()
    assert gain[-1] == pytest.approx(1.0, abs=1e-3)


# O3: the first frame


def test_o3_a_handle_that_does_not_match_the_arm_at_the_start_is_refused():
    run = driven(Scripted(lambda t: 0.2, start=0.3), duration=2.0, home=np.zeros(1))
    assert not speed(run).any()
    assert run.metadata["notice"].startswith("HOLD: handle and arm do not match at the start (handle is")
    close = driven(Scripted(lambda t: 0.2, start=0.01), duration=1.0, home=np.zeros(1))
    assert speed(close)[-1] == pytest.approx(SCALE * 0.2)


@pytest.mark.parametrize("spike", [300.0, 2.9, -50.0])
def test_o3_a_jump_of_the_handle_is_no_jump_of_the_arm(spike):
    """0.3 m in the first period is a velocity of 300 m/s."""
    run = driven(Scripted(lambda t: 0.1, sample=lambda t, v: spike if t < 0.0015 else v), duration=1.0)
    assert steps(run) <= A_MAX * 0.001 + 1e-12
    assert np.abs(run["hand.position"].values[: at(run, 0.1)]).max() < 0.03
    if abs(spike) > 3.0:
        assert hold(run).all()
        assert "cannot be" in run.metadata["notice"]


# O4, O5: the network


@pytest.mark.parametrize(("delay_s", "share"), [(0.0, 1.0), (0.01, 1.0), (0.02, 0.5), (0.05, 0.2), (0.1, 0.1), (0.2, 0.0)])
def test_o4_stable_at_every_delay_with_the_gain_reduced_and_shown(delay_s, share):
    for stiffness, damping in ((20.0, 8.0), (100.0, 18.0), (500.0, 35.0)):
        run = both_hold(
            0.15, delay_s, stiffness=stiffness, damping=damping, duration=2.5, limits=CouplingLimits(), handle=SLIPPERY
        )
        assert ripple(run, 0.5) < 0.01
        assert not hold(run).any()
        assert (np.abs(run["hand.velocity"].values).max() > 1e-4) == (share > 0.0)  # it was disturbed, where force comes back
    assert run["coupling.gain"].values[-1, 0] == pytest.approx(share)
    assert run["device.delay"].values[-1, 0] == pytest.approx(delay_s, abs=0.0015)  # measured
    if share == 0.0:
        assert "force feedback off: delay 200 ms" in run.metadata["notice"]
        assert not run["device.force"].values.any()
    elif share < 1.0:
        assert f"force feedback at {100 * share:.0f} %: delay {1000 * delay_s:.0f} ms" in run.metadata["notice"]


def test_o4_without_the_reduction_some_of_these_shake():
    assert ripple(both_hold(0.15, 0.1, "light", stiffness=500.0, damping=35.0, duration=2.5), 0.5) > 0.05


LIFT = pulse(0.5, 1.5, 0.2)
BAD_NETWORKS = {
    "1 %": Network(loss=0.01),
    "5 %": Network(loss=0.05),
    "20 %": Network(loss=0.2),
    "bursts of 10": Network(loss=0.05, burst=10),
    "reordered": Network(to_robot_s=0.005, jitter_s=0.02),
    "duplicated": Network(duplicates=0.5, jitter_s=0.01),
}


@pytest.mark.parametrize("name", BAD_NETWORKS)
def test_o5_loss_reordering_and_duplicates_cost_millimetres(name):
    runs = [driven(over(Scripted(LIFT), BAD_NETWORKS[name], seed=s), duration=2.0) for s in range(4)]
    for run in runs:
        assert not hold(run).any()
        assert run["hand.position"].values[-1, 0] == pytest.approx(SCALE * 0.2, abs=0.01)
        assert steps(run) <= A_MAX * 0.001 + 1e-12


def test_o5_what_comes_late_is_dropped_not_played_back():
    link = over(Scripted(lambda t: t), Network(to_robot_s=0.005, jitter_s=0.03, duplicates=0.3))
    run = driven(link, duration=1.0)
    assert (np.diff(run["device.velocity"].values[:, 0]) >= 0.0).all()


def test_o5_a_burst_of_more_than_50_ms_holds_and_a_shorter_one_coasts():
    for silent, held in ((0.045, False), (0.055, True)):
        device = Scripted(lambda t: 0.2, sample=lambda t, v, s=silent: nan if 1.0 <= t < 1.0 + s else v)
        run = driven(device, duration=1.5)
        assert hold(run)[at(run, 1.2)] == held
        assert speed(run)[at(run, 1.2)] == (0.0 if held else pytest.approx(SCALE * 0.2))
    assert "no sample from the device for 51 ms" in run.metadata["notice"]


def test_o5_a_device_that_hears_nothing_lets_its_force_go():
    device = Scripted(lambda t: 0.0)
    link = over(device, Network(unplugged=((0.5, inf),)))
    driven(link, plant=FreeHand(lambda t, x: 10.0), duration=0.7)
    assert device.forces[400] == pytest.approx(1.5)
    assert device.forces[-1] == pytest.approx(0.0)


# O6, O7: limits of force and space


class Pushing:
    """Somebody who moves his hand along `path(t)` [m] with a firm arm."""

    mass_kg = 0.5

    def __init__(self, path):
        self.path = path

    def reset(self):
        pass

    def force(self, time, position, velocity, felt):
        return [300.0 * (self.path(time) - position[0]) - 25.0 * velocity[0]]


def test_o6_force_beyond_the_device_is_clipped_shown_and_makes_no_energy():
    """The hand runs into a wall of 100 N: 15 N for the handle, which has 8.5 N."""
    law = PassivityLaw()
    handle = HeldHandle(Pushing(lambda t: 0.125 * np.sin(2 * np.pi * 0.5 * t)), phantom())
    wall = FreeHand(lambda t, x: -min(4000.0 * max(x - 0.05, 0.0), 100.0))
    run = driven(Passive(handle, law), plant=wall, duration=4.0)
    asked, applied = run["device.force"].values, run["device.applied"].values
    assert np.abs(asked).max() == pytest.approx(15.0)
    assert np.abs(applied).max() == pytest.approx(8.5)
    assert run["passivity.energy"].values.min() > -0.01  # of 0.3 J that went in and out
    stopped = driven(HeldHandle(Pushing(lambda t: 0.1), phantom()), plant=FreeHand(lambda t, x: -100.0), duration=0.5)
    assert "handle force clipped: 15.0 N asked, the device gives 8.5 N" in stopped.metadata["notice"]


def test_o6_a_force_above_the_continuous_limit_is_warned_of():
    warm = driven(HeldHandle(Pushing(lambda t: 0.0), phantom()), plant=FreeHand(lambda t, x: -40.0), duration=2.0)
    assert "device gets warm" in warm.metadata["notice"]
    cool = driven(HeldHandle(Pushing(lambda t: 0.0), phantom()), plant=FreeHand(lambda t, x: -8.0), duration=2.0)
    assert "notice" not in cool.metadata


def there_and_back(t):
    """0.33 m up in 2 s: 0.2 m beyond the upper half of the device's height; back down from 2.5 s on."""
    return 0.33 * min(t / 2.0, 1.0) - 0.33 * min(max(t - 2.5, 0.0) / 2.0, 1.0)


def test_o7_the_edge_of_the_device_is_a_wall_and_coming_back_moves_the_arm_at_once():
    run = driven(HeldHandle(Pushing(there_and_back), phantom()), duration=4.5)
    handle, x = run["device.position"].values[:, 0], run["hand.position"].values[:, 0]
    assert handle.max() < 0.5 * 0.267 + 0.04
    assert x == pytest.approx(SCALE * handle, abs=0.01)
    leaving = np.flatnonzero(handle > handle.max() - 0.005)[-1]
    assert speed(run)[leaving + 60] < -0.02
    said = driven(HeldHandle(Pushing(there_and_back), phantom()), duration=2.4)
    assert "edge of its workspace" in said.metadata["notice"]


def test_o7_the_edge_of_the_arm_stops_it_and_does_not_wind_up():
    limits = CouplingLimits(workspace_m=((-0.1, 0.2),))
    velocity = lambda t: 0.3 if t < 1.5 else -0.3  # 0.38 m beyond, then back  # noqa: E731
    run = driven(Scripted(velocity), duration=2.0, limits=limits)
    x = run["hand.position"].values[:, 0]
    assert 0.19 < x.max() <= 0.2
    assert speed(run)[at(run, 1.5) + round(2 * SCALE * 0.3 / A_MAX / 0.001)] == pytest.approx(-SCALE * 0.3, rel=0.01)
    assert "edge of its workspace" in driven(Scripted(velocity), duration=1.4, limits=limits).metadata["notice"]


def test_the_clutch_stops_the_arm_and_takes_up_elsewhere():
    run = driven(Scripted(lambda t: 0.2 if t < 1.0 or t > 2.0 else -0.2, clutch=lambda t: not 1.0 <= t < 2.0), duration=3.0)
    x = run["hand.position"].values[:, 0]
    assert x[at(run, 1.9)] - x[at(run, 1.1)] == 0.0
    assert x[-1] == pytest.approx(2 * SCALE * 0.2, abs=0.02)
    assert run["coupling.mismatch"].values[-1, 0] < 0.005
    assert not hold(run).any()


# O10, O11: settings and samples


@pytest.mark.parametrize(
    "u",
    [np.diag([1.0, -1.0]), np.array([[1.0, 0.1], [0.0, 1.0]]), 2.0 * np.eye(2), np.eye(3), np.full((2, 2), nan)],
    ids=["mirror", "shear", "scale", "shape", "nan"],
)
def test_o10_a_wrong_u_is_an_error_at_the_start(u):
    with pytest.raises(ParameterError, match=r"rotation U must be orthonormal \(2, 2\) with determinant \+1"):
        Teleoperation(Scripted(lambda t: 0.0), n_axes=2, dt=0.001, rotation=u)


def test_o10_other_settings_that_cannot_be_are_named():
    device = Scripted(lambda t: 0.0)
    for options, words in (
        ({"force_gain": -0.1}, "K_f must be >= 0"),
        ({"force_gain": np.zeros(3)}, "K_f must be >= 0"),
        ({"velocity_scale": 0.0}, "s_v must be positive"),
        ({"limits": CouplingLimits(workspace_m=((0.0, 1.0),) * 2)}, "workspace_m needs 1 rows"),
    ):
        with pytest.raises(ParameterError, match=words):
            Teleoperation(device, n_axes=1, dt=0.001, **options)
    with pytest.raises(ParameterError, match=r"full_feedback_s must be below"):
        CouplingLimits(full_feedback_s=0.2)
    with pytest.raises(ParameterError, match="loss < 1"):
        Network(loss=1.0)
    with pytest.raises(ParameterError, match="lowest < highest"):
        phantom(workspace_m=((0.1, 0.1),))
    with pytest.raises(ParameterError, match="outside the device's workspace"):
        HeldHandle(Pushing(lambda t: 0.0), phantom(), start_m=np.array([0.2]))
    with pytest.raises(ParameterError, match="there are: ideal, phantom"):
        Coupling(device="omni")


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e308])
def test_o11_a_sample_that_is_no_number_never_reaches_the_arm(bad):
    short = driven(Scripted(lambda t: 0.2, sample=lambda t, v: bad if 0.5 <= t < 0.52 else v), duration=1.0)
    assert np.isfinite(speed(short)).all()
    assert np.abs(speed(short)).max() <= SCALE * 0.2 + 1e-9
    assert hold(short).any() == (bad == 1e308)  # a number that cannot be is a fault, no number is a lost sample
    for_good = driven(Scripted(lambda t: 0.2, sample=lambda t, v: bad if t >= 0.5 else v), duration=1.0)
    assert speed(for_good)[-1] == 0.0


@pytest.mark.parametrize("bad", [nan, inf])
def test_o11_a_force_that_is_no_number_is_not_rendered_and_holds_in_the_end(bad):
    device = Scripted(lambda t: 0.2)
    run = driven(device, plant=FreeHand(lambda t, x: bad if t >= 0.5 else 10.0), duration=1.0)
    assert np.isfinite(device.forces).all()
    assert "force 51 ms old" in run.metadata["notice"]


def test_o11_a_loop_at_100_hz_gives_the_same_path():
    paths = [driven(Scripted(LIFT), plant=FreeHand(dt=dt), duration=2.0)["hand.position"].values for dt in (0.001, 0.01)]
    assert paths[1][:, 0] == pytest.approx(paths[0][::10, 0], abs=0.005)


# the whole chain


def test_lessons_on_a_phantom_over_a_network_hold_every_channel_and_arrive():
    coupling = Coupling(velocity_scale=1.6, device="phantom", network=Network(0.01, 0.01, loss=0.01), passivity=True)
    for role in ("leader", "follower"):
        (lesson,) = teach(role, 1, rng=np.random.default_rng(3), coupling=coupling)
        z = lesson["hand.position"].values[:, 0]
        assert z[-1] - z[0] == pytest.approx(lesson.metadata["lift_m"], abs=0.04)
        assert "incomplete" not in lesson.metadata
        for name in ("position", "velocity", "force", "applied", "clutch", "warmth", "delay"):
            assert np.isfinite(lesson[f"device.{name}"].values).all()
        assert {"passivity.energy", "passivity.alpha", "coupling.gain", "hand.sensor_force", "partner.force"} <= set(
            lesson.channels
        )
        json.dumps(dict(lesson.metadata))
    with pytest.raises(ParameterError, match="a teacher who feels nothing cannot yield"):
        teach("follower", 1, rng=np.random.default_rng(3), coupling=Coupling(network=Network(0.1, 0.1)))
    assert "gets warm" not in teach("leader", 1, rng=np.random.default_rng(3), coupling=PHANTOM)[0].metadata.get("notice", "")
