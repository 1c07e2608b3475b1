"""The envelope's memory, lent to the compiled tick (kernels/_guard.h) and taken back when the Python has to speak.

While it is lent, the names below are absent from the envelope, so nothing stale can be read: whoever asks for one takes all back.
"""

from __future__ import annotations

from math import nan
from operator import attrgetter
from typing import Any

import numpy as np

from .. import kernels
from ..interfaces import Array, Command, Observation
from ..kernels import layouts
from .reasons import number_of, said_of, same

LIMITS = layouts.BLOCKS["limits"][:-3]


def numbers_of(envelope: Any) -> Array:
    """The block "limits" of an envelope: what its `Limits` say, and the periods that it was made for."""
    own = (envelope._dt, envelope._late, envelope._stale)
    return np.array([*attrgetter(*LIMITS)(envelope.limits), *own], dtype=float)


GUARD, GUARDED = layouts.BLOCKS["guard"], layouts.BLOCKS["guarded"]
LEDGER, VECTORS = layouts.BLOCKS["scalars"], layouts.BLOCKS["vectors"]
AT = {name: n for n, name in enumerate(GUARD)}
NUMBERS = (*(name for name in GUARD if name.startswith("_")), *LEDGER)
ROWS = (*(name for name in GUARDED if name.startswith("_")), *VECTORS)
LENT = {name.split(".")[0] for name in (*NUMBERS, *ROWS)} | {"_reason", "_passed"}
COUNTS = {"_state", "_ticks", "_let_go._weighed", "_let_go.was_mistaken", "_jump._count"}  # whole numbers
JUMPED = ("before_jump", "jump", "jump_sum")
MOST_AXES = 6
RESTS, THINKS, RESUMES = range(3)  # what `senses` says of the skill; below: the tick is for the Python


class CompiledTick:
    """`senses` is a tick before the skill's own, `acts` and `rests` after it; `recovered` when the skill has begun again."""

    def __init__(self, envelope: Any) -> None:
        limits, checker, d = envelope.limits, envelope._checker, envelope._d
        let_go = envelope._let_go
        most = let_go._pulls.maxlen, let_go._before.maxlen
        rows = [len(GUARDED) + 3, len(VECTORS)]  # 3: the skill's wish
        sizes = [len(GUARD), rows[0] * MOST_AXES, len(LEDGER), 2, rows[1] * MOST_AXES, most[0] * d, most[1] * d]
        self._memory = np.zeros(sum(sizes))
        guard, guarded, ledger, self._counts, vectors, pulls, before = np.split(self._memory, np.cumsum(sizes)[:-1])
        guarded, vectors = (part.reshape(-1, MOST_AXES)[:, :d] for part in (guarded, vectors))
        self._guard, self._guarded, self._wish = guard, guarded[: len(GUARDED)], guarded[len(GUARDED) :]
        self._pulls, self._before = pulls.reshape(-1, d), before.reshape(-1, d)
        # all numbers and all vectors that have names of Python, as views in the order of NUMBERS and ROWS
        self._numbers = [(guard, n) for n, name in enumerate(GUARD) if name.startswith("_")] + [
            (ledger, n) for n in range(len(LEDGER))
        ]
        self._rows = [self._guarded[n] for n, name in enumerate(GUARDED) if name.startswith("_")] + list(vectors)
        numbers = numbers_of(envelope)
        rules = np.array([checker.v_max, checker.a_max, checker.dt, *np.ravel(checker.walls)])
        self.compiled = kernels.native.Envelope(
            numbers, rules, np.array(envelope._walls), self._memory, envelope._tank, envelope._mode, envelope._confidence, d,
            *most, let_go._swing,
        )  # fmt: skip
        self.senses, self.recovered = self.compiled.senses, self.compiled.recovered
        self.acts, self.rests = self.compiled.acts, self.compiled.rests
        self._limits = limits
        self.leads = ledger[LEDGER.index("_leads") :][:1]
        self._lent: dict[str, Any] = {}
        # (number, value, text) of the reason, and of what passed, as they were said last
        self._reason = self._passed = (0, nan, "")

    @property
    def late(self) -> bool:
        """Whether the period of this tick was too long."""
        return bool(self._guard[AT["late"]])

    def state(self) -> int:
        """RUN, COMPLY or HOLD, while it is lent."""
        return int(self._guard[AT["_state"]])

    def reason(self) -> str:
        """Why it is not in RUN, while it is lent."""
        self._reason = self._said(self._reason, "reason", "value")
        return self._reason[2]

    def passes(self) -> bool:
        """Whether that may pass by itself, while it is lent."""
        return bool(self._guard[AT["_state"]] and self._guard[AT["_passes"]])

    def _said(self, last: tuple[int, float, str], number: str, value: str) -> tuple[int, float, str]:
        now, about = int(self._guard[AT[number]]), float(self._guard[AT[value]])
        if same(now, about, *last[:2]):
            return last
        return now, about, said_of(now, about, float(self._guard[AT["limit_n"]]), self._limits)

    def lend(self, envelope: Any) -> bool:
        """False, with nothing changed, where it is stopped by what only the Python knows."""
        reason, passed = self._known(self._reason, envelope._reason), self._known(self._passed, envelope._passed)
        if reason[0] < 0 or passed[0] < 0:
            return False
        self._reason, self._passed, guard = reason, passed, self._guard
        for (array, n), name in zip(self._numbers, NUMBERS, strict=True):
            array[n] = _found(envelope, name)
        for row, name in zip(self._rows, ROWS, strict=True):
            row[:] = _found(envelope, name)
        guard[AT["reason"]], guard[AT["value"]] = reason[:2]
        guard[AT["passed"]], guard[AT["passed_value"]] = passed[:2]
        guard[AT["confidence"]] = envelope._confidence[0]
        inner = envelope._inner
        self._wish[:] = inner.position, inner.velocity, inner.acceleration
        self._lend_lists(envelope)
        self._lent = {name: envelope.__dict__.pop(name) for name in LENT}
        return True

    @staticmethod
    def _known(last: tuple[int, float, str], text: str) -> tuple[int, float, str]:
        return last if last[2] == text and last[0] == number_of(text) else (number_of(text), nan, text)

    def _lend_lists(self, envelope: Any) -> None:
        let_go, jump, guard = envelope._let_go, envelope._jump, self._guard
        for n, (rows, kept) in enumerate(((self._pulls, let_go._pulls), (self._before, let_go._before))):
            self._counts[n] = len(kept)
            if kept:
                rows[: len(kept)] = kept
        guard[AT["pending"]] = jump.pending is not None
        for name, values in zip(JUMPED, (*(jump.pending or (0.0, 0.0)), jump._sum or 0.0), strict=True):
            self._guarded[GUARDED.index(name)] = values

    def take_back(self, envelope: Any) -> None:
        envelope.__dict__.update(self._lent)
        self._lent = {}
        for (array, n), name in zip(self._numbers, NUMBERS, strict=True):
            _put(envelope, name, array[n].item())
        for row, name in zip(self._rows, ROWS, strict=True):
            _put(envelope, name, row.tolist())
        self._reason = self._said(self._reason, "reason", "value")
        self._passed = self._said(self._passed, "passed", "passed_value")
        envelope._reason, envelope._passed = self._reason[2], self._passed[2]
        envelope._confidence[0] = self._guard[AT["confidence"]]
        self._take_lists_back(envelope)

    def _take_lists_back(self, envelope: Any) -> None:
        let_go, jump = envelope._let_go, envelope._jump
        for n, (rows, kept) in enumerate(((self._pulls, let_go._pulls), (self._before, let_go._before))):
            kept.clear()
            kept.extend(rows[: int(self._counts[n])].tolist())
        before, change, jump_sum = (self._guarded[GUARDED.index(name)].tolist() for name in JUMPED)
        jump.pending = (before, change) if self._guard[AT["pending"]] else None
        jump._sum = jump_sum if jump.pending is not None or jump._count else []


def _found(envelope: Any, name: str) -> Any:
    return attrgetter(name)(envelope)


def _put(envelope: Any, name: str, value: Any) -> None:
    owner, _, last = name.rpartition(".")
    holder = attrgetter(owner)(envelope) if owner else envelope
    kind = type(getattr(holder, last))
    setattr(holder, last, value if kind is int and name not in COUNTS else kind(value))  # a limit may be stated as 5, not 5.0


class Lending:
    """A part of `Envelope`."""

    def _step_compiled(self: Any, obs: Observation, command: Command) -> bool:
        """False, with nothing changed, for an observation of other shapes or kinds."""
        tick = self._compiled
        tick.leads[0] = self._leading[0]
        does = tick.senses(obs.time, obs.force_time, obs.position, obs.force, obs.velocity, obs.sensor_force, self._taught)
        if does < RESTS:
            return False
        if does == RESUMES:
            does = self._resumed(obs, command)
        if does == THINKS:
            self._think_within(obs, command)
        elif does == RESTS:
            tick.rests(command.position, command.velocity, command.acceleration)
        return True

    def _resumed(self: Any, obs: Observation, command: Command) -> int:
        """What the skill is to do once it has begun again; RESUMES where the tick was done meanwhile, in Python."""
        problem = self._resumes(obs)
        if not problem and self._is_lent:
            return int(self._compiled.recovered())
        self._take_back()
        late = self._compiled.late
        if problem:
            self._fault(problem)
        else:  # it has looked at its envelope
            self._recovered()
            self._think(obs, self._period, True)
        self._send(command, self._period, True, late)
        return RESUMES

    def _think_within(self: Any, obs: Observation, command: Command) -> None:
        inner = self._inner
        try:
            self.skill.step(obs, inner)
        except Exception as error:
            self._remark(repr(error), command)
            return
        if not self._is_lent or not self._compiled.acts(  # not lent any more: the skill has looked at its envelope
            inner.position, inner.velocity, inner.acceleration, command.position, command.velocity, command.acceleration
        ):
            self._remark(self._unfit(), command)
        elif self._frozen is not None:
            self._show()

    def _remark(self: Any, problem: str, command: Command) -> None:
        """What is left of a tick whose command has a problem, or whose skill asked for what was lent."""
        self._take_back()
        self._heed(problem, float(self._confidence[0]))
        self._send(command, self._period, True, self._compiled.late)

    def _lends(self: Any) -> bool:
        """Whether the compiled tick has the memory; it gets it, unless something is under way that only the Python knows."""
        if self._compiled is None or self._tells is not None or self._timer is not None:
            return False
        if not self._is_lent:
            self._is_lent = self._compiled.lend(self)
        return self._is_lent

    def _take_back(self: Any) -> None:
        if self._is_lent and self._compiled is not None:
            self._is_lent = False
            self._compiled.take_back(self)
