"""The envelope's memory, lent to the compiled ordinary tick and taken back when the Python has to speak.

While it is lent, the names below are absent from the envelope, so nothing stale can be read: whoever asks for one takes all back.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from .. import kernels

# in the order of kernels/_envelope.h
LIMITS = (
    "v_max_m_per_s a_max_m_per_s2 force_limit_n energy_j stuck_s stuck_m moving_m_per_s position_jump_m drift_m blocked_n"
    " blocked_s alone_n alone_s steady_n_s stands_m_per_s sink_m pushed_n pushed_j let_go_n let_go_s held_n let_go_m_per_s"
    " tare_n jump_n jump_rest_s"
).split()
SCALARS = (
    "_period _time _stamp _age _elapsed _impact_s _blocked_ns _alone_s _rest_s _energy _held _sinks_s _let_go._for_s"
    " _let_go._weighed _sinking.sunk _sinking._peak _sinking._again_s _sinking._since_up_s _pushed.work _pushed._peak"
    " _jump._usual _jump._heard_s _jump._still_s _shaking._mean _shaking.amplitude"
).split()
VECTORS = (
    "_x _sent _at _v _force _wanted _asked _rate _felt _senses _let_go.weight _stuck.last _stuck.same_s _stuck._same_m"
    " _stuck._changes _stuck._least _stuck._usual _stuck._dead _jump.last _shaking._slow _checker.at _checker.last"
).split()
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
        numbers = np.array([*attrgetter(*LIMITS)(limits), envelope._dt, envelope._late], dtype=float)
        rules = np.array([checker.v_max, checker.a_max, checker.dt, *np.ravel(checker.walls)])
        compiled = kernels.native.Envelope(
            numbers, rules, np.array(envelope._walls), self._memory, envelope._tank, self._d, *self._most
        )
        self.sense, self.act = compiled.sense, compiled.act
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
