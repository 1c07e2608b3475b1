"""What a line does to packets: late, lost in bursts, overtaken, twice, and silence; each as often and as long as was asked."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.devices.link import SILENCE_S, Link, Network

DT = 0.001


class Handle:
    """Says how many times it was asked, and keeps what it was told."""

    problem = notice = ""
    mass_kg = 0.1

    def __init__(self):
        self.channels = {"device.position": (np.zeros(1), "m")}
        self.told, self.powers = [], []

    def reset(self):
        self.told.clear()
        self.powers.clear()

    def write(self, force, duration, power=0.0):
        self.told.append(float(force[0]))
        self.powers.append(power * duration)

    def read(self, out):
        out[:] = len(self.told)


def driven(network, n=2000, force=lambda k: float(k + 1), power=lambda k: 0.0, seed=0):
    """(the handle, what came back each tick) of `n` ticks; the force of tick k is its number."""
    handle = Handle()
    link = Link(handle, network, rng=np.random.default_rng(seed))
    heard = []
    for k in range(n):
        link.write(np.array([force(k)]), DT, power(k))
        link.read(out := np.zeros(1))
        heard.append(float(out[0]))
    return handle, np.array(heard), link


def test_a_line_is_as_late_each_way_as_it_is_asked_and_says_the_round_trip():
    handle, heard, link = driven(Network(to_device_s=0.02, to_robot_s=0.03))
    assert handle.told[500] == 481.0
    assert heard[500] == 471.0
    assert link.channels["device.delay"][0][0] == pytest.approx(0.05, abs=1e-9)


def test_a_packet_that_was_overtaken_is_dropped():
    """With 20 ms of jitter many are: what the handle is told never goes back, and is late by up to as much."""
    handle, _, _ = driven(Network(to_device_s=0.005, jitter_s=0.02))
    told = np.array(handle.told)
    assert (np.diff(told) >= 0.0).all()
    late = np.arange(1, 2001)[100:] - told[100:]
    assert 5.0 <= late.min() <= late.max() <= 26.0
    assert late.std() > 0.5, "jitter is no constant delay"


@pytest.mark.parametrize(("loss", "burst"), [(0.2, 1), (0.2, 8), (0.05, 4)])
def test_as_many_packets_are_lost_as_asked_and_in_bursts_as_long(loss, burst):
    handle, _, _ = driven(Network(loss=loss, burst=burst), n=40_000)
    told = np.array(handle.told)
    lost = np.concatenate([[False], np.diff(told) == 0.0])
    assert lost.mean() == pytest.approx(loss, rel=0.15)
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    lengths = edges[1::2] - edges[::2][: len(edges[1::2])]
    assert lengths.min() == burst


def test_the_account_of_energy_is_whole_though_packets_are_lost():
    """0.5 W for 2 s are 1 J, of which a lost packet loses nothing; only what is still under way is missing."""
    handle, _, _ = driven(Network(to_device_s=0.01, loss=0.3, burst=5), power=lambda k: 0.5)
    assert sum(handle.powers) == pytest.approx(1.0, abs=0.02)
    exact, _, _ = driven(Network(), power=lambda k: 0.5)
    assert sum(exact.powers) == pytest.approx(1.0, abs=1e-9)


def test_a_handle_that_hears_nothing_is_let_loose_after_the_silence_and_not_before():
    off = Network(unplugged=((0.5, 0.9),))
    handle, heard, link = driven(off, force=lambda k: 3.0)
    told = np.array(handle.told)
    gone = 500 + round(SILENCE_S / DT)
    assert (told[: gone - 2] == 3.0).all()
    assert (told[gone + 3 : 899] == 0.0).all()
    assert (told[905:] == 3.0).all()
    assert np.isnan(heard[505:899]).all()
    assert link.problem == ""
