"""Which phase of the task is it now? The forward variable of eq. (4), one tick at a time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np

from .. import kernels
from ..errors import ParameterError
from ..interfaces import Array
from ..kernels.copies import Copied
from ..recording import expand
from .gaussian import Whitening, marginal, whitening
from .hmm import Hmm
from .hsmm import Hsmm

UNBELIEVABLE = 1e100  # an input farther out than this is no measurement: treated like NaN
FRESH, HOPELESS_TICKS, RESTARTS, LAST, SUM = range(5)  # StateFilter._state
HOPELESS = 20.0  # [nats] evidence for a state that the dynamics exclude this clearly speaks against the weights


class StateFilter(Copied, ABC):
    """Weights h_t(i) ∝ prediction_t(i) N(ξ_t; μ_i, Σ_i), normalised, robust against what sensors do.

    All of a tick but the dynamics: `_predict` says what the weights would be without evidence. A tick is written around the best
    state, h ∝ exp(log prediction + log density − maximum), so 0/0 cannot happen.

    channels          which channels are evidence, by name; the others are integrated out. `xi` of `step` has these, in
                      the order of `filter.channels`
    transition_floor  ε: each tick forgets a little, A ← (1 − ε) A + ε/K, so a left-right chain can run a second time
    gate              [nats] most that one tick may favour one state over another, at once the worst an outlier can do
    patience          [ticks] after so many in a row whose best state the dynamics exclude, weights start afresh from
                      the evidence; with a transition floor above 1e-9 nothing is excluded, and it never comes to that

    gate = 20 and ε = 1e-6 belong together: 20 > −log(ε/K) for K ≤ 400, so a state ruled out by one bad tick is back
    after one good tick; and no weight falls below e⁻²⁰ ε/K ≈ 1e-16, far from underflow. Between neighbouring states of
    a demonstration the gate is idle: 20 nats are 6 standard deviations. For eq. (4) to the letter: transition_floor=0,
    gate=numpy.inf.

    NaN is a missing channel: the density of the others is used; with none the weights move on by the dynamics alone.
    """

    ANEW = ("compiled", "_tick")

    def __init__(
        self,
        model: Hmm | Hsmm,
        channels: str | Iterable[str] | None = None,
        *,
        transition_floor: float = 1e-6,
        gate: float = 20.0,
        patience: int = 3,
    ) -> None:
        if not 0.0 <= transition_floor <= 1.0:
            raise ParameterError(f"transition_floor is a probability; got {transition_floor!r}")
        if not gate > 0.0:
            raise ParameterError(f"gate must be above 0 nats; got {gate!r}")
        self.model = model
        self.channels = model.channels if channels is None else expand(channels, model.channels)
        self.gate, self.patience = float(gate), int(patience)
        self._columns = np.array([model.channels.index(c) for c in self.channels], dtype=np.intp)
        k, d = model.n_states, len(self.channels)
        self._initial = (1.0 - transition_floor) * model.initial + transition_floor / k
        self._marginals: dict[bytes, Whitening] = {}
        self._all = self._prepared(np.ones(d, dtype=bool))
        # one product for the whole whitening: [L⁻¹, −L⁻¹(μ − origin)] @ [ξ − origin, 1]
        self._affine = np.column_stack([self._all.factors, -self._all.centres])
        self._centred = np.ones(d + 1)
        self._minus_half = np.full(d, -0.5)
        self._nothing_is_zero = transition_floor > 0.0
        self._z, self._log_b, self._log_h = np.empty(k * d), np.empty(k), np.empty(k)
        self._weights, self._predicted = np.empty(k), np.empty(k)
        self._state = np.zeros(5)  # what else a tick remembers, in one array that the compiled tick shares
        self._offset = self._centred[:-1]
        self._z_by_state = self._z.reshape(self.n_states, -1)

    @abstractmethod
    def _link(self) -> None:
        """Sets `compiled` and `_tick`, in C and over this filter's arrays; None where nothing could be compiled."""

    @property
    def n_states(self) -> int:
        return self.model.n_states

    @property
    def weights(self) -> Array:
        """h (K,), the array that `step` rewrites; before the first step it is Π."""
        return self._weights

    def reset(self) -> None:
        """Forgets everything: the next step is the first."""
        self._weights[:] = self._initial
        self._state[:] = 0.0
        self._state[FRESH] = 1.0

    @property
    def initial(self) -> Array:
        """Π (K,) as this filter uses it, with its floor."""
        return self._initial

    @property
    def whitening(self) -> Whitening:
        """Densities of `channels`, none missing."""
        return self._all

    @property
    def restarts(self) -> int:
        """How often patience ran out since the reset."""
        return int(self._state[RESTARTS])

    @property
    def last_log_likelihood(self) -> float:
        """log p(ξ_t | ξ_1..ξ_{t-1}) of the last tick, after the gate."""
        return float(self._state[LAST])

    @property
    def log_likelihood(self) -> float:
        """The sum of `last_log_likelihood` since the reset."""
        return float(self._state[SUM])

    @abstractmethod
    def _predict(self, predicted: Array) -> None:
        """Fills `predicted` (K,) from the weights of the tick before; not asked for the first tick, which has Π."""

    def _step(self, xi: Array) -> Array:
        """The tick to read; the compiled one leaves it what is missing, hopeless or beyond float64 without logarithms."""
        predicted, state = self._predicted, self._state
        if state[FRESH]:
            predicted[:] = self._initial
            state[FRESH] = 0.0
        else:
            self._predict(predicted)
        log_b = self._evidence(xi)
        if log_b is None:
            self._weights[:] = predicted
            state[LAST] = 0.0
            return self._weights
        best = float(np.maximum.reduce(log_b))
        h = np.maximum(log_b, best - self.gate, out=self._log_h)
        if not self._nothing_is_zero:
            np.maximum(predicted, 1e-300, out=predicted)
        h += np.log(predicted, out=predicted)
        top = float(np.maximum.reduce(h))
        h -= top
        np.exp(h, out=h)
        total = float(np.add.reduce(h))
        state[LAST] = top + math.log(total)
        state[SUM] += state[LAST]
        state[HOPELESS_TICKS] = state[HOPELESS_TICKS] + 1.0 if top < best - HOPELESS else 0.0
        if state[HOPELESS_TICKS] >= self.patience:
            state[HOPELESS_TICKS] = 0.0
            state[RESTARTS] += 1.0
            np.exp(log_b - best, out=h)
            total = float(np.add.reduce(h))
        return np.divide(h, total, out=self._weights)

    def _evidence(self, xi: Array) -> Array | None:
        """log N(ξ; μ_i, Σ_i) (K,) of what is present; None when nothing is."""
        white, offset = self._all, self._offset
        np.subtract(xi, white.origin, out=offset)
        if not math.hypot(*offset.tolist()) < UNBELIEVABLE:  # NaN compares false, so one test finds both
            return self._partial_evidence(np.asarray(xi, dtype=np.float64))
        z = np.dot(self._affine, self._centred, out=self._z)
        np.multiply(z, z, out=z)
        log_b = np.dot(self._z_by_state, self._minus_half, out=self._log_b)
        log_b += white.log_peak
        return log_b

    def _partial_evidence(self, xi: Array) -> Array | None:
        present = np.abs(xi - self._all.origin) < UNBELIEVABLE
        if not present.any():
            return None
        return self._prepared(present).log_density(xi[None, present])[0]

    def _prepared(self, present: np.ndarray) -> Whitening:
        """Densities of the channels that are present, prepared when a pattern is first seen."""
        pattern = present.tobytes()
        if pattern not in self._marginals:
            columns = self._columns[present]
            self._marginals[pattern] = whitening(*marginal(self.model.means, self.model.covariances, columns))
        return self._marginals[pattern]


class ForwardFilter(StateFilter):
    """Eq. (4): h_t(i) ∝ [Σ_j h_{t-1}(j) a_ji] N(ξ_t; μ_i, Σ_i); options as in StateFilter."""

    def __init__(
        self,
        model: Hmm,
        channels: str | Iterable[str] | None = None,
        *,
        transition_floor: float = 1e-6,
        gate: float = 20.0,
        patience: int = 3,
    ) -> None:
        super().__init__(model, channels, transition_floor=transition_floor, gate=gate, patience=patience)
        self._chain = np.ascontiguousarray((1.0 - transition_floor) * model.transition + transition_floor / model.n_states)
        self._link()
        self.reset()

    def _link(self) -> None:
        self.compiled = None  # the same tick in C, for this step and for a compiled law
        if kernels.native is not None and len(self.channels) <= 256:
            self.compiled = kernels.native.Filter(*self.numbers, self._weights, self._state, self.gate, self.patience)
        self._tick = self.compiled and self.compiled.step

    @property
    def chain(self) -> Array:
        """A (K, K) as this filter uses it, with its floor."""
        return self._chain

    @property
    def numbers(self) -> tuple[Array, ...]:
        """All that a tick computes with, as the compiled kernels take it: origin, factors, centres, peaks, initial, chain."""
        return *self._all.arrays, self._initial, self._chain

    def step(self, xi: Array) -> Array:
        """Takes in one tick xi (D,) and gives the weights (K,): a view that the next step overwrites."""
        if self._tick is not None and self._tick(xi):
            return self._weights
        return self._step(xi)

    def _predict(self, predicted: Array) -> None:
        np.dot(self._weights, self._chain, out=predicted)


class DurationFilter(StateFilter):
    """The same with the durations of an Hsmm, on a clock that its owner sets; options as in StateFilter.

    Beside the weights it keeps how long each state will still last: left (K, L), the chance of r = 1..L more frames given that
    this is the state. Evidence chooses between states and never touches it; only time does.

    Who leads lets durations run: rate 1 in `step`, less while the partner holds back. Who follows waits for evidence: at rate 0
    no state ends by the clock, and evidence alone moves the weights on, at once where it is clear. A partner slower than taught
    outlasts a state: evidence then brings it back for another duration.
    """

    def __init__(
        self,
        model: Hsmm,
        channels: str | Iterable[str] | None = None,
        *,
        transition_floor: float = 1e-6,
        gate: float = 20.0,
        patience: int = 3,
    ) -> None:
        super().__init__(model, channels, transition_floor=transition_floor, gate=gate, patience=patience)
        self._forgets = float(transition_floor)
        self._durations, self._transition = kernels.in_eights(model.durations), model.transition
        self._left, self._moved = np.empty((2, *self._durations.shape))
        self._time = np.zeros(2)  # rate of the next tick, and what has gone by of the present frame
        self._frames = np.arange(1.0, self._durations.shape[1] + 1.0)
        self._link()
        self.reset()

    def _link(self) -> None:
        self._tick = None
        if kernels.native is not None and len(self.channels) <= 256:
            self._tick = kernels.native.DurationFilter(
                *self._all.arrays, self._initial, self._transition, self._durations, self._weights, self._left, self._time,
                self._state, self.gate, self._forgets, self.patience,
            ).step  # fmt: skip

    def reset(self) -> None:
        super().reset()
        self._left[:] = self._durations
        self._time[:] = 0.0

    @property
    def remaining(self) -> Array:
        """How many more frames each state is expected to last if this is it, the present one included, (K,)."""
        return np.asarray(self._left @ self._frames)

    def step(self, xi: Array, rate: float = 1.0) -> Array:
        """As `ForwardFilter.step`; `rate` frames have gone by inside durations since the tick before: 0 holds their clock."""
        if self._tick is not None and self._tick(xi, rate):
            return self._weights
        self._time[0] = rate
        before = self._state[RESTARTS]
        weights = self._step(xi)
        if self._state[RESTARTS] > before:
            self._left[:] = self._durations  # a state that the dynamics excluded begins now
        return weights

    def _predict(self, predicted: Array) -> None:
        rate, passed = self._time.tolist()
        passed += min(rate, len(self._frames)) if rate > 0.0 else 0.0  # NaN is no time
        whole = int(passed + 1e-9)  # ten times 0.1 are one frame
        self._time[1] = passed - whole
        predicted[:] = self._weights
        for _ in range(max(whole, 1)):
            self._move(predicted, whole > 0)

    def _move(self, h: Array, ends: bool) -> None:
        """h(j, r) ← (1 − ε) [h(j, r + 1) + p_j(r) Σ_i h(i, 1) a_ij] + ε/K p_j(r); without a frame of time only the forgetting."""
        left, moved, stay = self._left, self._moved, 1.0 - self._forgets
        entered = np.full(len(h), self._forgets / len(h))
        if ends:
            entered += stay * ((h * left[:, 0]) @ self._transition)
            moved[:, :-1], moved[:, -1] = left[:, 1:], 0.0
        else:
            moved[:] = left
        moved *= stay * h[:, None]
        moved += entered[:, None] * self._durations
        np.add.reduce(moved, axis=1, out=h)
        np.divide(moved, h[:, None], out=left, where=h[:, None] > 1e-300)
