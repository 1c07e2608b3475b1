"""The envelope's memory, lent to the compiled ordinary tick and taken back when the Python has to speak.

While it is lent, the names below are absent from the envelope, so nothing stale can be read: whoever asks for one takes all back.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from .. import kernels
from ..kernels import layouts

LIMITS, SCALARS, VECTORS = layouts.BLOCKS["limits"][:-3], layouts.BLOCKS["scalars"], layouts.BLOCKS["vectors"]
LENT = {name.split(".")[0] for name in (*SCALARS, *VECTORS)}
MOST_AXES = 6


class Ordinary:
    """`sense` and `act` are an ordinary tick before and after the skill's; False, with nothing changed, where it is not."""

    def __init__(self, envelope: Any) -> None:
        limits, checker, self._d = envelope.limits, envelope._checker, len(envelope._x)
        self._most = envelope._let_go._pulls.maxlen, envelope._let_go._before.maxlen
        n, rows = len(SCALARS) + 2, len(VECTORS)
        self._memory = np.zeros(n + rows * MOST_AXES + sum(self._most) * self._d)
        self._scalars, self._counts = self._memory[: n - 2], self._memory[n - 2 : n]
        self._vectors = self._memory[n : n + rows * MOST_AXES].reshape(rows, MOST_AXES)[:, : self._d]
        self._pulls, self._before = np.split(self._memory[n + rows * MOST_AXES :].reshape(-1, self._d), self._most[:1])
        numbers = np.array([*attrgetter(*LIMITS)(limits), envelope._dt, envelope._late, envelope._stale], dtype=float)
        rules = np.array([checker.v_max, checker.a_max, checker.dt, *np.ravel(checker.walls)])
        self.compiled = kernels.native.Envelope(
            numbers, rules, np.array(envelope._walls), self._memory, envelope._tank, self._d, *self._most, envelope._let_go._swing
        )
        self.sense, self.act = self.compiled.sense, self.compiled.act
        self.leads = self._scalars[SCALARS.index("_leads") :][:1]
        self._lent: dict[str, Any] = {}

    def lend(self, envelope: Any) -> None:
        self._scalars[:] = attrgetter(*SCALARS)(envelope)
        self._vectors[:] = attrgetter(*VECTORS)(envelope)
        let_go = envelope._let_go
        for n, (rows, kept) in enumerate(((self._pulls, let_go._pulls), (self._before, let_go._before))):
            self._counts[n] = len(kept)
            if kept:
                rows[: len(kept)] = kept
        self._lent = {name: envelope.__dict__.pop(name) for name in LENT}

    def take_back(self, envelope: Any) -> None:
        envelope.__dict__.update(self._lent)
        self._lent = {}
        for name, value in zip((*SCALARS, *VECTORS), (*self._scalars.tolist(), *self._vectors.tolist()), strict=True):
            owner, _, last = name.rpartition(".")
            holder = attrgetter(owner)(envelope) if owner else envelope
            setattr(holder, last, type(getattr(holder, last))(value))
        let_go = envelope._let_go
        for n, (rows, kept) in enumerate(((self._pulls, let_go._pulls), (self._before, let_go._before))):
            kept.clear()
            kept.extend(rows[: int(self._counts[n])].tolist())
