"""Time-domain passivity for the haptic handle (Hannaford and Ryu 2002, impedance form): a device around a device.

The teacher's hand is passive enough; what shakes it is energy that delay makes out of nothing. An account of it, exact for forces
that are held over a period: with f_2 = -F_m what the coupling asks of the hand, f_1 = f_2 + alpha v what is rendered,

    W(n) = W(n-1) + f_1(n-1) dx(n) + P dT         dx(n): way of the handle in the last period
    alpha(n) = -W(n)/(dT v(n)^2) if W(n) < 0 else 0

P is power that the object itself puts into the coupling at the robot's hand: a leading partner may pull the teacher along, delay
may not. Without P this is the one-port law, which takes a leading partner for a fault and brakes him.

Four repairs that the law needs in practice: no damping where v is near 0 (alpha would explode); a largest alpha (what is not
paid stays in W); what the account may hold is bounded (else the energy of a lift feeds minutes of shaking); and it starts with
that much, a credit of some F v T, because delay borrows energy in every honest lift and gives it back at its end. Without the
credit a following teacher is braked as he starts: over 50 ms his partner needed 9.7 N rms instead of 5.5 N. The force at rest,
the object's weight, is left out of the account: it is the same everywhere and gives back what it takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, HapticDevice


@dataclass(frozen=True)
class PassivityLaw:
    """Numbers of the controller."""

    # with velocity behind 20 Hz, alpha on a handle in a light hand (0.29 kg) still has damping ratio 0.32
    alpha_max_ns_per_m: float = 90.0
    rest_m_per_s: float = 0.003
    credit_j: float = 0.01  # W at the start, and its upper bound

    def __post_init__(self) -> None:
        if not (self.alpha_max_ns_per_m > 0 and self.rest_m_per_s > 0 and self.credit_j >= 0):
            raise ParameterError(
                "passivity needs alpha_max_ns_per_m > 0, rest_m_per_s > 0, credit_j >= 0; got "
                f"{self.alpha_max_ns_per_m}, {self.rest_m_per_s}, {self.credit_j}"
            )


class EnergyAccount:
    """The observer W and the damping alpha that keeps it from falling. Values as in the module's equations."""

    def __init__(self, law: PassivityLaw = PassivityLaw()) -> None:
        self.law = law
        self.reset()

    def reset(self) -> None:
        self.energy, self.alpha = self.law.credit_j, 0.0

    def book(self, given: float) -> None:
        """`given` [J] to the coupling since the last call, by hand and object."""
        self.energy = min(self.energy + given, self.law.credit_j)

    def damping(self, speed: float, period: float) -> float:
        """alpha [N s/m] for the coming `period` [s] at `speed` [m/s]."""
        self.alpha = 0.0
        if self.energy < 0.0 and speed > self.law.rest_m_per_s:
            self.alpha = min(-self.energy / (period * speed * speed), self.law.alpha_max_ns_per_m)
        return self.alpha


class Passive:
    """Wraps a `HapticDevice` on ITS side of any delay; has its socket. The device must measure device.position.

    Channels: the device's, and passivity.energy W [J], passivity.alpha [N s/m].
    """

    def __init__(self, device: HapticDevice, law: PassivityLaw = PassivityLaw(), *, n_axes: int = 1) -> None:
        if "device.position" not in device.channels:
            raise ParameterError(
                "passivity needs the channel device.position; the device has: " + (", ".join(device.channels) or "none")
            )
        self.device, self._account = device, EnergyAccount(law)
        self._position = device.channels["device.position"][0]
        self._applied = device.channels["device.applied"][0] if "device.applied" in device.channels else None
        self._last, self._velocity = np.zeros(n_axes), np.zeros(n_axes)
        self._force, self._weight = np.zeros(n_axes), np.zeros(n_axes)
        self._own = {"passivity.energy": (np.zeros(1), "J"), "passivity.alpha": (np.zeros(1), "N s/m")}

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return {**self.device.channels, **self._own}

    @property
    def problem(self) -> str:
        return self.device.problem

    @property
    def notice(self) -> str:
        return self.device.notice

    def reset(self) -> None:
        self.device.reset()
        self._account.reset()
        self._last[:] = self._position
        self._rendered: Array | None = None
        self._own["passivity.energy"][0][0], self._own["passivity.alpha"][0][0] = self._account.energy, 0.0

    def read(self, out: Array) -> None:
        self.device.read(out)

    def write(self, force: Array, duration: float, power: float = 0.0) -> None:
        if self._rendered is None and np.any(force):
            self._weight[:] = force
        self._rendered = force
        self.device.read(self._velocity)
        speed = float(np.sqrt(self._velocity @ self._velocity))
        alpha = self._account.damping(speed, duration)
        np.subtract(force, alpha * self._velocity, out=self._force)
        self.device.write(self._force, duration)
        rendered = self._force if self._applied is None else self._applied
        given = -float((rendered - self._weight) @ (self._position - self._last))
        asked = float(self._force @ self._force)
        share = float(rendered @ self._force) / asked if asked > 0.0 else 1.0  # what the device had no force for, nobody gave
        self._last[:] = self._position
        self._account.book(given + share * power * duration)
        self._own["passivity.energy"][0][0] = self._account.energy
        self._own["passivity.alpha"][0][0] = alpha
