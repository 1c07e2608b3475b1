"""What the field uses, behind the same socket, to be measured against.

MassDamper            M dv/dt = F - D v: the admittance of the paper's ref. [1]; with M = 0 constant damping
VariableDamping       the same with D low in motion and high at rest or against it (variable impedance, Ikeura and Inooka 1995)
RigidMinimumJerk      a minimum-jerk motion by the clock, and no compliance: the partner is not felt
MinimumJerkFollower   a minimum-jerk motion fitted to what the partner has done so far, and followed (the paper's refs [5], [6])
Homotopy              alpha times a leader, 1 - alpha times a follower, alpha fixed (the paper's ref. [12])
ActivePassive         a discrete HMM tells whether the partner is active or passive, and the robot does the other (ref. [15])
"""

from __future__ import annotations

from collections.abc import Mapping
from math import erf, exp, sqrt

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation, Skill
from ..models.gmm import Gmm
from .reference import PhaseReference


def _fill(command: Command, obs: Observation, velocity: Array, dt: float) -> None:
    command.velocity[:] = velocity
    command.position[:] = obs.position + dt * velocity
    command.acceleration[:] = 0.0


class _Plain:
    """What all share: no notices, no wish to stop, nothing to show."""

    notice = ""
    stop_reason = ""
    _dt: float

    @property
    def dt(self) -> float:
        """Control period that it was made for [s]."""
        return self._dt

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {}


class MassDamper(_Plain):
    """Admittance M dv/dt = F - D v. D alone (M = 0) is constant damping v = F / D."""

    def __init__(self, *, n_axes: int, dt: float, mass_kg: float = 2.0, damping_ns_per_m: float = 10.0) -> None:
        if not (mass_kg >= 0.0 and damping_ns_per_m > 0.0):
            raise ParameterError(f"mass >= 0 and damping > 0; got {mass_kg} kg and {damping_ns_per_m} N s/m")
        self._dt, self._mass, self._damping = dt, mass_kg, damping_ns_per_m
        self._velocity = np.zeros(n_axes)

    def reset(self, obs: Observation) -> None:
        self._velocity[:] = 0.0

    def step(self, obs: Observation, command: Command) -> None:
        self.move(np.where(np.isfinite(obs.force), obs.force, 0.0), self._damping)
        _fill(command, obs, self._velocity, self._dt)

    def move(self, force: Array, damping: float) -> Array:
        """One implicit step under `force` (d,) [N]; gives the velocity (d,)."""
        self._velocity[:] = (self._mass * self._velocity + self._dt * force) / (self._mass + self._dt * damping)
        return self._velocity


class VariableDamping(MassDamper):
    """Low damping while the partner accelerates the hand, high while he slows it down or it rests."""

    def __init__(self, *, n_axes: int, dt: float, mass_kg: float = 4.0, low_ns_per_m: float = 10.0, high_ns_per_m: float = 40.0):
        super().__init__(n_axes=n_axes, dt=dt, mass_kg=mass_kg, damping_ns_per_m=high_ns_per_m)
        self._low, self._high, self._now = low_ns_per_m, high_ns_per_m, high_ns_per_m

    def reset(self, obs: Observation) -> None:
        super().reset(obs)
        self._now = self._high

    def step(self, obs: Observation, command: Command) -> None:
        force = np.where(np.isfinite(obs.force), obs.force, 0.0)
        helped = float(force @ self._velocity) > 0.0 and float(np.abs(self._velocity).max()) > 0.02
        self._now += (1.0 - exp(-self._dt / 0.1)) * ((self._low if helped else self._high) - self._now)
        self.move(force, self._now)
        _fill(command, obs, self._velocity, self._dt)


class MinimumJerkFollower(MassDamper):
    """Fits x_0 + A mj((t - t_0) / T) to the partner's motion so far, and adds the acceleration that it foresees.

    Samples count from when the hand has moved 5 mm; which share of T had gone by then is searched over a grid together with T,
    because a minimum jerk creeps at first, and A follows by least squares. While nothing fits, the mass-damper is all there is.
    """

    def __init__(self, *, n_axes: int, dt: float, mass_kg: float = 6.0, damping_ns_per_m: float = 25.0, trust: float = 0.5):
        super().__init__(n_axes=n_axes, dt=dt, mass_kg=mass_kg, damping_ns_per_m=damping_ns_per_m)
        durations, gone = np.meshgrid(np.linspace(1.2, 5.0, 20), np.linspace(0.0, 0.24, 7))
        self._trust, self._durations, self._gone = trust, durations.ravel(), gone.ravel()

    def reset(self, obs: Observation) -> None:
        super().reset(obs)
        self._start = np.nan_to_num(obs.position).copy()
        self._times: list[float] = []
        self._places: list[Array] = []

    def step(self, obs: Observation, command: Command) -> None:
        force = np.where(np.isfinite(obs.force), obs.force, 0.0)
        moved = np.nan_to_num(obs.position - self._start)
        if self._times or float(np.abs(moved).max()) > 0.005:
            self._times.append(self._times[-1] + self._dt if self._times else 0.0)
            self._places.append(moved.copy())
        foreseen = self._foreseen()
        self.move(force + self._trust * (self._mass * foreseen[0] + self._damping * foreseen[1]), self._damping)
        _fill(command, obs, self._velocity, self._dt)

    def _foreseen(self) -> tuple[Array, Array]:
        """Acceleration and velocity (d,) of the fitted motion now; zero before 0.3 s of it, and after its end."""
        nothing = np.zeros_like(self._velocity)
        if not 30 <= len(self._times) <= 600:
            return nothing, nothing
        t, x = np.array(self._times[::3]), np.array(self._places[::3])
        s = np.clip(self._gone[:, None] + t[None, :] / self._durations[:, None], 0.0, 1.0)
        shape = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
        power = np.einsum("nt,nt->n", shape, shape)
        height = shape @ x / power[:, None]
        missed = ((x[None] - shape[:, :, None] * height[:, None, :]) ** 2).sum(axis=(1, 2))
        best = int(missed.argmin())
        duration, far = float(self._durations[best]), height[best]
        now = float(self._gone[best]) + self._times[-1] / duration
        if now >= 1.0:
            return nothing, nothing
        a = 60.0 * now * (1.0 - now) * (1.0 - 2.0 * now) / duration**2
        v = 30.0 * now * now * (1.0 - now) ** 2 / duration
        return far * a, far * v


class RigidMinimumJerk(_Plain):
    """Goes along `reference` by the clock, held to it as stiffly as a position-controlled arm, whatever the partner does.

    reference   with duration_s, and `at` over its tables `position` and `velocity`
    """

    def __init__(self, reference: PhaseReference, *, dt: float, start_delay_s: float = 0.5, stiffness_per_s: float = 10.0):
        self._reference, self._dt, self._delay, self._stiffness = reference, dt, start_delay_s, stiffness_per_s

    def reset(self, obs: Observation) -> None:
        self._phase = -self._delay
        self._offset = np.nan_to_num(obs.position) - self._reference.position[0]

    def step(self, obs: Observation, command: Command) -> None:
        one, self._phase = self._reference, self._phase + self._dt
        moving = 0.0 <= self._phase < one.duration_s
        keep = max(1.0 - max(self._phase, 0.0) / one.duration_s, 0.0)  # a start elsewhere is made good on the way
        velocity = one.at(one.velocity, self._phase) - self._offset / one.duration_s if moving else np.zeros_like(self._offset)
        error = np.nan_to_num(one.at(one.position, self._phase) + keep * self._offset - obs.position)
        _fill(command, obs, velocity + self._stiffness * error, self._dt)


class Homotopy(_Plain):
    """v = alpha v_leader + (1 - alpha) v_follower (Evrard and Kheddar 2009), alpha fixed."""

    def __init__(self, leader: Skill, follower: Skill, *, n_axes: int, dt: float, alpha: float = 0.5) -> None:
        if not 0.0 <= alpha <= 1.0:
            raise ParameterError(f"alpha must lie in [0, 1]; got {alpha}")
        self._parts, self._alpha, self._dt = (leader, follower), alpha, dt
        self._commands = (Command(n_axes), Command(n_axes))

    def reset(self, obs: Observation) -> None:
        for part in self._parts:
            part.reset(obs)

    def step(self, obs: Observation, command: Command) -> None:
        for part, wanted in zip(self._parts, self._commands, strict=True):
            part.step(obs, wanted)
        lead, follow = self._commands
        _fill(command, obs, self._share() * lead.velocity + (1.0 - self._share()) * follow.velocity, self._dt)

    def _share(self) -> float:
        return self._alpha


class ActivePassive(Homotopy):
    """Leads a partner who is passive and follows one who is active, as a two-state discrete HMM over (F, v) symbols tells.

    passive, active   mixtures over channels "force.<axis>" and "velocity.<axis>", of lessons in which the partner was so: how
                      often each symbol is to be expected
    patience_s        without force or motion for so long, the partner counts as passive; until then as active
    """

    _FORCE, _SPEED = (-3.0, -0.7, 0.7, 3.0), (-0.03, 0.03)

    def __init__(
        self,
        leader: Skill,
        follower: Skill,
        *,
        passive: Gmm,
        active: Gmm,
        axis: str,
        n_axes: int,
        dt: float,
        place: int = 0,
        patience_s: float = 6.5,
    ) -> None:
        super().__init__(leader, follower, n_axes=n_axes, dt=dt)
        self._emission = np.array([self._expected(mixture, axis) for mixture in (passive, active)])
        stay = 1.0 - dt / 2.0
        self._chain = np.array([[stay, 1.0 - stay], [1.0 - stay, stay]])
        self._place, self._role = place, np.array([0.1, 0.9, 0.0])
        self._blend, self._patience, self._quiet_s = 0.0, patience_s, 0.0

    def _expected(self, mixture: Gmm, axis: str) -> Array:
        """Probability of each symbol, force and velocity independent within a state."""
        table = np.zeros((len(self._FORCE) + 1, len(self._SPEED) + 1))
        for weight, mean, covariance in zip(mixture.weights, mixture.means, mixture.covariances, strict=True):
            shares = []
            for name, edges in ((f"force.{axis}", self._FORCE), (f"velocity.{axis}", self._SPEED)):
                c = mixture.channels.index(name)
                below = [0.5 * (1.0 + erf((e - mean[c]) / sqrt(2.0 * covariance[c, c]))) for e in edges]
                shares.append(np.diff([0.0, *below, 1.0]))
            table += weight * np.outer(*shares)
        return np.asarray((table.ravel() + 1e-3) / (table.sum() + 1e-3 * table.size))

    def _symbol(self, force: float, speed: float) -> int:
        return int(np.searchsorted(self._FORCE, force)) * (len(self._SPEED) + 1) + int(np.searchsorted(self._SPEED, speed))

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {"role": self._role}

    def reset(self, obs: Observation) -> None:
        super().reset(obs)
        self._role[:] = (0.1, 0.9, 0.0)
        self._blend = self._quiet_s = 0.0

    def step(self, obs: Observation, command: Command) -> None:
        force, speed = float(obs.force[self._place]), float(obs.velocity[self._place])
        if force == force and speed == speed:
            symbol = self._symbol(force, speed)
            if symbol == self._symbol(0.0, 0.0):
                self._quiet_s += self._dt
            else:
                self._quiet_s = 0.0
                seen = (self._role[:2] @ self._chain) * self._emission[:, symbol] ** 0.1  # samples repeat each other
                self._role[:2] = seen / seen.sum()
            if self._quiet_s >= self._patience:
                self._role[:2] = (0.9, 0.1)
        wanted = 1.0 if self._role[0] > 0.5 else 0.0
        self._blend += min(max(wanted - self._blend, -2.0 * self._dt), 2.0 * self._dt)
        super().step(obs, command)

    def _share(self) -> float:
        return self._blend
