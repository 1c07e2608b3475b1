"""Many roll-outs of a learned velocity law at once: what would the skill do from here, under these forces?

Position and force give the weights (eq. 4) and the velocity (eq. 5); Euler's step gives the next position. For validation over
hundreds of starts and forces; a robot runs a skill instead.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..errors import ChannelError, ParameterError
from ..interfaces import Array
from .filtering import ForwardFilter
from .gaussian import in_float32, suits_float32
from .gmr import Regression
from .hmm import Hmm

WIDEST_GATE = 60.0  # float32: a frame that only the gate explains keeps weights of 1e-26, with 12 digits of exponent behind them


class RollOuts(NamedTuple):
    """position [m] and velocity [m/s], (N, T, d): velocity[:, t] is what the law answers at position[:, t]."""

    position: Array
    velocity: Array


def roll_out(
    model: Hmm,
    start: Any,
    force: Any,
    *,
    dt: float,
    evidence: str | Iterable[str] | None = None,
    transition_floor: float = 1e-6,
    gate: float = 20.0,
    n_threads: int = 1,
    precision: str = "float64",
    out: RollOuts | None = None,
) -> RollOuts:
    """N roll-outs from start (N, d) [m] under force (T, f) [N], the same for all, or (N, T, f).

    evidence                channels that the weights listen to; default position and force. "velocity" is the one commanded last
    transition_floor, gate  as in `ForwardFilter`
    n_threads               of the compiled kernel; any number gives the same numbers
    precision               "float32" is for very many: up to twice as fast. 99 % of the positions are within 1e-6 of their range
                            from those of "float64", the others, where two states compete, within 1e-4. A channel far from
                            zero for its spread, a gate above 60 or a path that leaves float32 is for float64, as is all
                            without compiled kernels
    out                     arrays to write into and give back, float64 (N, T, d), C-contiguous: nothing is allocated for them

    The model's channels are position.*, force.* (or none) and velocity.*. A line of regression goes on for ever, so a start far
    from the lessons may run away: look at the positions.
    """
    if not (dt > 0.0 and np.isfinite(dt)):
        raise ParameterError(f"dt is a period above 0 s; got {dt!r}")
    single = in_float32(precision) and gate <= WIDEST_GATE
    single = single and suits_float32(model.whitening, model.means, model.covariances, 0.0)
    heard = evidence if evidence is None or isinstance(evidence, str) else tuple(evidence)
    weigher, source, regression = _prepared(model, heard, transition_floor, gate)
    d = model.n_channels - len(regression.inputs)
    x, f = _checked(start, force, d, model.n_channels - 2 * d)
    paths = _kept(out, (len(x), f.shape[-2], d))
    if kernels.native is None:
        _refuse_infinite(x, f)
        return _roll(x, f, dt, weigher, source, regression, paths)
    prepared = source, weigher.initial, weigher.chain, weigher.whitening.arrays, regression.gains, regression.offsets
    if not kernels.rollouts(x, f, *prepared, gate=gate, dt=dt, out=paths, n_threads=n_threads, single=single):
        _refuse_infinite(x, f)
        if single:
            kernels.rollouts(x, f, *prepared, gate=gate, dt=dt, out=paths, n_threads=n_threads)
    return paths


@lru_cache(maxsize=16)
def _prepared(
    model: Hmm, evidence: str | tuple[str, ...] | None, transition_floor: float, gate: float
) -> tuple[ForwardFilter, np.ndarray, Regression]:
    """Weights, which of (position, force, velocity) they listen to, and lines; kept, for they cost as much as 30,000 steps."""
    position, forces, velocity = (
        tuple(c for c in model.channels if c.split(".")[0] == group) for group in ("position", "force", "velocity")
    )
    if not position or len(velocity) != len(position) or len(position + forces + velocity) != len(model.channels):
        raise ChannelError(
            f"roll-outs want position.*, force.* and as many velocity.*; the model has {', '.join(model.channels)}"
        )
    inputs = position + forces
    weigher = ForwardFilter(model, inputs if evidence is None else evidence, transition_floor=transition_floor, gate=gate)
    source = np.array([(inputs + velocity).index(c) for c in weigher.channels], dtype=np.int64)
    return weigher, source, Regression(model, inputs, velocity)


def _roll(
    x: Array, force: Array, dt: float, weigher: ForwardFilter, source: np.ndarray, regression: Regression, out: RollOuts
) -> RollOuts:
    """The readable twin: all roll-outs side by side, one step of time after another."""
    n = len(x)
    x, v, predicted = x.copy(), np.zeros_like(x), np.tile(weigher.initial, (n, 1))
    for t in range(force.shape[-2]):
        f = np.broadcast_to(force[..., t, :], (n, force.shape[-1]))
        log_b = weigher.whitening.log_density(np.hstack([x, f, v])[:, source])
        lead = np.maximum(log_b - log_b.max(axis=1, keepdims=True), -weigher.gate)
        h = predicted * np.exp(lead)
        h /= np.maximum(h.sum(axis=1, keepdims=True), 1e-300)
        v = np.einsum("nk,nko->no", h, regression.means_per_state(np.hstack([x, f])))
        out.position[:, t], out.velocity[:, t] = x, v
        x = x + dt * v
        predicted = h @ weigher.chain
    return out


def _kept(out: RollOuts | None, shape: tuple[int, ...]) -> RollOuts:
    if out is None:
        return RollOuts(*np.empty((2, *shape)))  # together large enough for huge pages
    for name, path in zip(RollOuts._fields, out, strict=True):
        if path.shape != shape or path.dtype != np.float64 or not path.flags.c_contiguous or not path.flags.writeable:
            raise ParameterError(f"out.{name} must be float64 {shape}, C-contiguous and writeable; got {path.dtype} {path.shape}")
    return out


def _checked(start: Any, force: Any, d: int, n_forces: int) -> tuple[Array, Array]:
    x = np.ascontiguousarray(start, dtype=np.float64)
    f = np.ascontiguousarray(force, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != d or not len(x):
        raise ParameterError(f"start must be (N, {d}); got {x.shape}")
    if f.ndim not in (2, 3) or f.shape[-1] != n_forces or not f.shape[-2] or (f.ndim == 3 and len(f) != len(x)):
        raise ParameterError(f"force must be (T, {n_forces}) or ({len(x)}, T, {n_forces}); got {f.shape}")
    return x, f


def _refuse_infinite(start: Array, force: Array) -> None:
    if not (np.isfinite(start).all() and np.isfinite(force).all()):
        raise ParameterError("start and force of a roll-out must be finite")
