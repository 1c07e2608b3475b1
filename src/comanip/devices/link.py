"""A network between the robot and a haptic device: delay, jitter, loss, bursts, duplicates, and a cable that comes off.

Both directions carry numbered packets. Whoever receives keeps the newest number and drops what comes late, so reordering and
duplicates cost nothing but freshness. The device's end gives zero force when it has heard nothing for 50 ms. Each packet back
carries the stamp of the force that it answers: the round trip is measured, not assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, isnan, nan

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Array, HapticDevice

SILENCE_S = 0.050  # the device's watchdog


@dataclass(frozen=True)
class Network:
    """What happens to a packet, each direction by itself. Shares are of all packets, in [0, 1].

    jitter_s    up to this much more delay, uniform: later packets overtake earlier ones
    burst       packets that are lost in a row
    unplugged   (from, to) [s] when the cable is off
    """

    to_device_s: float = 0.0
    to_robot_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    burst: int = 1
    duplicates: float = 0.0
    unplugged: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("to_device_s", "to_robot_s", "jitter_s"):
            if not (getattr(self, name) >= 0 and isfinite(getattr(self, name))):
                raise ParameterError(f"network: {name} must be finite and not negative; got {getattr(self, name)}")
        if not (0.0 <= self.loss < 1.0 and 0.0 <= self.duplicates <= 1.0 and self.burst >= 1.0):
            raise ParameterError(
                f"network: 0 <= loss < 1, 0 <= duplicates <= 1, burst >= 1; got {self.loss}, {self.duplicates}, {self.burst}"
            )


class _Line:
    """One direction: packets on their way, and the newest that arrived."""

    def __init__(self, delay: float, network: Network, rng: np.random.Generator) -> None:
        self._delay, self._network, self._rng = delay, network, rng
        self.reset()

    def reset(self) -> None:
        self._under_way: list[tuple[float, int, tuple[float, ...]]] = []
        self._number, self._newest, self._losing = 0, 0, 0

    def send(self, now: float, packet: tuple[float, ...]) -> None:
        self._number += 1
        if self._lost():
            return
        copies = 2 if self._network.duplicates and self._rng.random() < self._network.duplicates else 1
        for _ in range(copies):
            extra = self._network.jitter_s * self._rng.random() if self._network.jitter_s else 0.0
            self._under_way.append((now + self._delay + extra, self._number, packet))

    def _lost(self) -> bool:
        """Bursts begin at random, as often as makes the share of lost packets what was asked: after 1/share - 1 times as many."""
        network = self._network
        if self._losing:
            self._losing -= 1
            return True
        if network.loss and self._rng.random() < network.loss / (network.loss + network.burst * (1.0 - network.loss)):
            self._losing = network.burst - 1
            return True
        return False

    def receive(self, now: float) -> tuple[float, ...] | None:
        """The newest packet that arrived since the last call; None if there is none."""
        fresh = None
        waiting = []
        for arrival, number, packet in self._under_way:
            if arrival > now + 1e-9:
                waiting.append((arrival, number, packet))
            elif number > self._newest:
                self._newest, fresh = number, packet
        self._under_way = waiting
        return fresh

    def cut(self) -> None:
        self._under_way = []


class Link:
    """Wraps any `HapticDevice`; has its socket. All randomness comes from `rng`.

    Channels: the device's, as they were when sent, and device.delay, the measured round trip [s].
    """

    def __init__(self, device: HapticDevice, network: Network = Network(), *, n_axes: int = 1, rng: np.random.Generator) -> None:
        self.device, self.network = device, network
        check_generator(rng)
        self._there, self._back = _Line(network.to_device_s, network, rng), _Line(network.to_robot_s, network, rng)
        self._n, self._sample = n_axes, np.zeros(n_axes)
        self._delay = np.zeros(1)
        self._channels = {name: (array.copy(), unit) for name, (array, unit) in device.channels.items()}
        self._channels["device.delay"] = (self._delay, "s")
        self.reset()

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return self._channels

    @property
    def problem(self) -> str:
        return "device lost" if self._off() else self.device.problem

    @property
    def notice(self) -> str:
        return self.device.notice

    def _off(self) -> bool:
        return any(start <= self.time < end for start, end in self.network.unplugged)

    def reset(self) -> None:
        self.device.reset()
        self._there.reset()
        self._back.reset()
        self.time = self._heard = 0.0
        self._stamp, self._period, self._energy, self._arrived = nan, 0.0, 0.0, 0.0
        self._rendered = np.zeros(self._n)
        self._delay[:] = self.network.to_device_s + self.network.to_robot_s  # the handshake's, before the first answer
        for name, (array, _) in self.device.channels.items():
            self._channels[name][0][:] = array

    def write(self, force: Array, duration: float, power: float = 0.0) -> None:
        if self._period == 0.0:  # both ends begin with the force at rest: that much they have agreed upon before
            self._rendered[:] = force
        self._period = duration
        self._energy += power * duration  # the whole account travels, so that a lost packet loses none of it
        if self._off():
            self._there.cut()
            self._back.cut()
        else:
            self._there.send(self.time, (self.time, self._energy, *force.tolist()))
        packet = self._there.receive(self.time)
        arrived = 0.0
        if packet is not None:
            arrived, self._arrived = packet[1] - self._arrived, packet[1]
            self._stamp, self._heard = packet[0], self.time
            self._rendered[:] = packet[2:]
        elif self.time - self._heard > SILENCE_S:
            self._rendered[:] = 0.0
        self.device.write(self._rendered, duration, arrived / duration)
        self.time += duration
        if not self._off():
            self.device.read(self._sample)
            more = [x for array, _ in self.device.channels.values() for x in array.tolist()]
            self._back.send(self.time, (self.time, self._stamp, *self._sample.tolist(), *more))

    def read(self, out: Array) -> None:
        packet = self._back.receive(self.time)
        if packet is None:
            out[:] = np.nan
            return
        if not isnan(packet[1]):  # the device had heard from us; answering takes one period anyway
            self._delay[0] = max(0.0, self.time - packet[1] - self._period)
        out[:] = packet[2 : 2 + self._n]
        at = 2 + self._n
        for name in self.device.channels:
            array = self._channels[name][0]
            array[:] = packet[at : at + len(array)]
            at += len(array)
