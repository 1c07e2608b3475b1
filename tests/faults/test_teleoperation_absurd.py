"""O12: what no sensor measures and no driver means never reaches a hand or an arm."""

import numpy as np
import pytest

from comanip import Teleoperation
from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.skills.teleoperation import CouplingLimits

DT = 0.001


class Driver:
    """A handle that says `velocity(t)`, and where it is if it `measures` that."""

    problem = notice = ""

    def __init__(self, velocity, n_axes=1, measures=True, force_limit_n=None):
        self.velocity, self.n, self.felt, self.time = velocity, n_axes, [], 0.0
        self.place = np.zeros(n_axes)
        self.channels = {"device.clutch": (np.ones(1), ""), **({"device.position": (self.place, "m")} if measures else {})}
        if force_limit_n is not None:
            self.force_limit_n = force_limit_n

    def reset(self):
        self.felt.clear()

    def read(self, out):
        out[:] = self.velocity(self.time)

    def write(self, force, duration, power=0.0):
        self.felt.append(force.copy())
        self.time += duration


def driven(device, force, *, seconds=0.5, **options):
    """Runs a coupling on a hand that feels `force(t)`; the skill, and where the hand was commanded to (n, d)."""
    skill = Teleoperation(device, n_axes=device.n, dt=DT, **options)
    obs, command, hand, way = Observation(device.n), Command(device.n), np.ones(device.n), []
    for k in range(round(seconds / DT)):
        obs.time, obs.position[:], obs.velocity[:], obs.sensor_force[:] = k * DT, hand, command.velocity, force(k * DT)
        if k == 0:
            skill.reset(obs)
        skill.step(obs, command)
        hand = hand + DT * command.velocity
        way.append(hand.copy())
    return skill, np.array(way)


@pytest.mark.parametrize("absurd", [251.0, 2000.0, -2000.0, 1e9, -1e9, 1e308, np.inf, np.nan])
@pytest.mark.parametrize("at", [0.0, 0.2])
def test_an_absurd_force_is_a_fault_and_never_rendered(absurd, at):
    device = Driver(lambda t: 0.0)
    skill, _ = driven(device, lambda t: absurd if t >= at else 20.0)
    assert max(abs(f[0]) for f in device.felt) <= 0.15 * 20.0 + 1e-9
    assert "cannot be" in skill.fault if np.isfinite(absurd) else "ms old" in skill.fault
    assert abs(device.felt[-1][0]) < 0.3  # and what was felt before has faded


def test_one_absurd_sample_is_enough():
    device = Driver(lambda t: 0.0)
    skill, _ = driven(device, lambda t: 1e9 if abs(t - 0.2) < DT / 2 else 20.0)
    assert skill.fault == "a force of 1e+09 N cannot be (a sensor here gives up to 250 N)"
    assert max(abs(f[0]) for f in device.felt) <= 3.0 + 1e-9


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * np.pi, 9))
def test_what_is_absurd_does_not_depend_on_how_axes_are_turned(angle):
    direction = np.array([np.cos(angle), np.sin(angle)])
    for size, fault in ((249.0, False), (251.0, True)):
        device = Driver(lambda t: np.zeros(2), n_axes=2)
        skill, _ = driven(device, lambda t, size=size: size * direction, seconds=0.05)
        assert bool(skill.fault) == fault
    device = Driver(lambda t: np.array([0.5, 0.5]) * (1.0 + 1e-3 * t), n_axes=2)
    _, way = driven(device, lambda t: np.zeros(2), rotation=[[direction[0], -direction[1]], [direction[1], direction[0]]])
    speeds = np.linalg.norm(np.diff(way, axis=0), axis=1) / DT
    assert speeds.max() <= CouplingLimits().v_max_m_per_s + 1e-9


@pytest.mark.parametrize(("own", "allowed"), [(None, 40.0), (8.5, 8.5), (100.0, 40.0)])
def test_the_handle_never_gets_more_than_it_may_have_and_it_is_said(own, allowed):
    device = Driver(lambda t: 0.0, force_limit_n=own)
    skill, _ = driven(device, lambda t: 200.0, force_gain=0.5)
    assert max(abs(f[0]) for f in device.felt) == pytest.approx(allowed)
    assert skill.fault == ""
    assert f"handle force limited: 100 N asked, {allowed:g} N given" in skill.notice


def test_the_weight_comes_into_the_hand_within_a_tenth_of_a_second_and_not_at_once():
    device = Driver(lambda t: 0.0)
    driven(device, lambda t: -100.0)
    felt = -np.array(device.felt)[:, 0]
    assert felt[0] <= 0.15 + 1e-9
    assert np.diff(felt).max() <= 0.15 + 1e-9
    assert felt[105] == pytest.approx(15.0)
    carried = Driver(lambda t: 0.0)
    driven(carried, lambda t: -100.0, carried=True)
    assert carried.felt[0][0] == pytest.approx(-15.0)


def test_a_driver_that_repeats_its_last_sample_is_silent():
    device = Driver(lambda t: 0.2 + 1e-3 * np.sin(100.0 * t) if t < 0.2 else 0.2)
    device.write = lambda force, duration, power=0.0: (
        device.felt.append(force.copy()),
        setattr(device, "time", device.time + duration),
        device.place.__iadd__(duration * 0.2 if device.time < 0.2 else 0.0),
    )
    skill, way = driven(device, lambda t: 0.0, seconds=5.0)
    assert "repeats one sample" in skill.fault
    assert way[-1, 0] - way[200, 0] < 0.06
    assert way[-1, 0] == way[-1000, 0]
    assert "repeats one sample" in skill.stop_reason


def test_one_that_measures_no_position_is_given_half_a_second():
    skill, way = driven(Driver(lambda t: 0.2, measures=False), lambda t: 0.0, seconds=3.0)
    assert "repeats one sample" in skill.fault
    assert way[-1, 0] - 1.0 < 0.2
    assert not driven(Driver(lambda t: 0.0, measures=False), lambda t: 0.0, seconds=3.0)[0].fault  # a hand at rest


def test_a_force_limit_that_is_none_is_refused():
    with pytest.raises(ParameterError, match="positive and finite"):
        Teleoperation(Driver(lambda t: 0.0, force_limit_n=np.inf), n_axes=1, dt=DT)
