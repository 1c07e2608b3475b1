"""Who leads? Evidence from the learned models, in force, motion and place.

`RoleEvidence` keeps a probability over what the robot is just now: the leader (force as in the leader's lessons), the follower
(as in the follower's), sharing (as in natural lessons, if there are any), or neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from ..errors import MismatchError
from ..interfaces import Array
from ..kernels.copies import Copied
from ..models.filtering import ForwardFilter
from ..models.hmm import Hmm
from ..signals.exponential import exponential, logarithm
from ..signals.vectors import plain_sum
from .collaborate import ABSURD

GAINS = (0.1, 0.2, 0.4, 0.8)  # how strong this partner is beside those of the lessons
GROUPS = ("position", "force", "velocity")


@dataclass(frozen=True)
class Doubts:
    """What a tick is worth as evidence. A living partner pulls 2 N where a teacher pulled 9: only the pattern tells the role."""

    force_n: float = 1.0  # noise, bias and tremor of the force
    velocity_m_per_s: float = 0.05
    position_share: float = 0.125  # of the taught range: other people lift from elsewhere to elsewhere
    memory_s: float = 0.1  # samples closer than this repeat each other
    switch_s: float = 3.0  # roles change no oftener than about this
    gate: float = 20.0  # [nats] most that one sample may say


class RoleEvidence(Copied):
    """Probability of each role, updated tick by tick: a bank of forward filters, one a role and partner's strength.

    Each filter is the role's HMM with its forces scaled by a gain and its covariance widened by the doubts; its predictive
    log-likelihood, tempered by memory, is the evidence. "neither" is a broad Gaussian around all roles.

    models   role -> Hmm with channels "position.*", "force.*", "velocity.*" of the same axes
    names    the roles, then "neither"; probabilities (len(names),) are in this order
    """

    ANEW = ("bank",)

    def __init__(self, models: Mapping[str, Hmm], *, dt: float, doubts: Doubts = Doubts()) -> None:
        channels = {m.channels for m in models.values()}
        if len(channels) != 1:
            raise MismatchError(f"roles can be compared only over the same channels; got {sorted(channels)}")
        self.names = (*models, "neither")
        self._dt, self._doubts = dt, doubts
        means = np.concatenate([m.means for m in models.values()])
        variances = np.concatenate([np.einsum("kii->ki", m.covariances) for m in models.values()])
        order = next(iter(models.values())).channels
        groups = np.array([c.split(".")[0] for c in order])
        self._centre = means.mean(axis=0)
        self._spread = np.sqrt(2.25 * _of_group(groups, means.var(axis=0) + variances.mean(axis=0)))
        noise = self._noise(groups, means)
        self._filters = [ForwardFilter(_heard(model, gain, noise), GROUPS) for model in models.values() for gain in GAINS]
        place = [order.index(c) for c in self._filters[0].channels]
        self._centre, self._spread = self._centre[place], self._spread[place]
        n = len(self._filters) + 1
        self._prior = np.full(n, 1.0 / (len(self.names) * len(GAINS)))
        self._prior[-1] = 1.0 / len(self.names)
        self._p, self._until = self._prior.copy(), np.zeros(1)
        self.probabilities = np.zeros(len(self.names))
        self._link()
        self.reset()

    def _link(self) -> None:
        self.bank, dt, doubts = None, self._dt, self._doubts  # all of this for a compiled tick
        if all(one.compiled is not None for one in self._filters):
            numbers = np.array([dt, dt / doubts.switch_s, dt / doubts.memory_s, doubts.gate])
            filters = tuple(one.compiled for one in self._filters)
            self.bank = (filters, self._prior, self._centre, self._spread, numbers, self._p, self.probabilities, self._until)

    def _noise(self, groups: Array, means: Array) -> Array:
        places = means[:, groups == "position"]
        range_m = float(np.linalg.norm(places[:, None] - places[None], axis=2).max())  # of one axis: the range of its centres
        size = {"force": self._doubts.force_n, "velocity": self._doubts.velocity_m_per_s}
        return np.array([size.get(group, self._doubts.position_share * range_m) for group in groups])

    def reset(self) -> None:
        for one in self._filters:
            one.reset()
        self._p[:] = self._prior
        self._until[0] = 0.0
        self._tell()

    def step(self, seen: Array, elapsed_s: float) -> None:
        """Takes in position, force and velocity, (3 d,) in this order, NaN for missing; `elapsed_s` since the last call."""
        self._until[0] -= elapsed_s
        if self._until[0] > 1e-9:
            return
        seen = np.where(np.abs(seen) < ABSURD, seen, np.nan)  # counts as missing
        while self._until[0] <= 1e-9:  # a slower loop says each sample for all the time that it stood for
            self._until[0] += self._dt
            self._hear(seen)
        self._tell()

    def _hear(self, seen: Array) -> None:
        for one in self._filters:
            one.step(seen)
        said = [*(one.last_log_likelihood for one in self._filters), self._of_neither(seen.tolist())]
        best, doubts = max(said), self._doubts
        change, worth = self._dt / doubts.switch_s, self._dt / doubts.memory_s
        p = [
            ((1.0 - change) * p + change * prior) * exponential(max(log_l - best, -doubts.gate) * worth)
            for p, prior, log_l in zip(self._p.tolist(), self._prior.tolist(), said, strict=True)
        ]
        total = plain_sum(p)
        self._p[:] = [one / total for one in p]

    def _of_neither(self, seen: list[float]) -> float:
        """Log-density of the broad Gaussian, missing channels integrated out."""
        log_density = 0.0
        for x, centre, spread in zip(seen, self._centre.tolist(), self._spread.tolist(), strict=True):
            if isfinite(x):
                off = (x - centre) / spread
                log_density -= 0.5 * off * off + logarithm(2.5066 * spread)
        return log_density

    def _tell(self) -> None:
        """A role's probability is that of all its strengths."""
        p, n = self._p.tolist(), len(GAINS)
        self.probabilities[:] = [plain_sum(p[i : i + n]) for i in range(0, len(p), n)]


def _of_group(groups: Array, variances: Array) -> Array:
    """The mean variance of a channel's group, for each channel: the same however the axes are turned."""
    return np.array([variances[groups == group].mean() for group in groups])


def _heard(model: Hmm, gain: float, noise: Array) -> Hmm:
    """The role's model as a partner of this strength would sound, `noise` (D,) added."""
    scale = np.array([gain if c.startswith("force.") else 1.0 for c in model.channels])
    covariances = model.covariances * scale[:, None] * scale + np.diag(noise**2)
    return replace(model, means=model.means * scale, covariances=covariances)
