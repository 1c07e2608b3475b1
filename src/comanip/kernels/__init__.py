"""Compiled leaves, and the choice between them and their readable twins in comanip.models.

`native` is the compiled module, or None where nothing could be compiled or COMANIP_KERNELS=numpy asks for the twins: then
everything runs, slower. COMANIP_KERNELS=avx512, avx2 or plain asks for one instruction set. `comanip doctor` says which one runs.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError
from . import layouts
from .plan import WHOLE, Seating, plan

ABSENT = "numpy: the compiled kernels are absent (no C compiler when comanip was installed), so all works, 10 to 50 times slower"
NOT_LOADABLE = (
    "numpy: the compiled kernels are there and cannot be loaded here ({}), so all works, 10 to 50 times slower; "
    "install comanip again on this machine"
)
ASKED_FOR = ("avx512", "avx2", "plain", "native")


def _load() -> tuple[Any, str, str]:
    """The compiled module or None, what runs, and why nothing compiled does although nobody asked for that."""
    wanted = os.environ.get("COMANIP_KERNELS", "").strip().lower()
    if wanted == "numpy":
        return None, "numpy, as COMANIP_KERNELS asks", ""
    try:
        from . import _native
    except ImportError as error:
        missing = ABSENT if find_spec(f"{__name__}._native") is None else NOT_LOADABLE.format(" ".join(str(error).split()))
        if wanted:
            what = "asks for compiled kernels" if wanted in ASKED_FOR else "is no choice"
            raise ParameterError(
                f"COMANIP_KERNELS={wanted!r} {what}; allowed here: numpy, or nothing. {missing.removeprefix('numpy: ')}"
            ) from None
        return None, missing, missing.removeprefix("numpy: ")
    layouts.check(_native.layouts() if hasattr(_native, "layouts") else {})
    if wanted in _native.levels():
        _native.use(wanted)
    elif wanted not in ("", "native"):
        raise ParameterError(f"COMANIP_KERNELS={wanted!r}; allowed here: numpy, native, {', '.join(_native.levels())}")
    return _native, f"native, {_native.level()}", ""


native, description, missing = _load()


class Sums(NamedTuple):
    """What one E-step over S sequences gives.

    moments         (K, D + 1, D + 1) Σ_t γ_t(i) (ξ_t − origin, 1)(ξ_t − origin, 1)ᵀ: occupancy, sums and products in one
    transitions     (K, K) expected number of transitions
    first           (K,) posterior of the first frames, summed
    log_likelihood  (S,)
    failed          (S,) sequences in which scaling ran out of float64: absent from the sums, and for the twin to add
    """

    moments: np.ndarray
    transitions: np.ndarray
    first: np.ndarray
    log_likelihood: np.ndarray
    failed: np.ndarray


def planned(lengths: np.ndarray, *, single: bool = False) -> Seating:
    """Groups for `e_step`, made once for the same sequences; float32 has twice the lanes."""
    return Seating(lengths, native.lanes() * (1 + single))


def e_step(
    frames: np.ndarray,
    groups: Seating,
    initial: np.ndarray,
    transition: np.ndarray,
    white: tuple[np.ndarray, ...],
    *,
    n_threads: int = 1,
    single: bool = False,
    faintest: float = -np.inf,
) -> Sums:
    """E-step over frames (N, D); `white` is (origin, factors, centres, log_peak) of the states' densities.

    Threads share groups of sequences; the sums are added in the same order whatever their number, so the bits are the same.
    `single` computes in float32, in which more sequences fail; the groups must be planned for it. A sequence fails, too, with a
    frame to which every state gives a log-density below `faintest`.
    """
    d, k, s = len(white[0]), len(white[3]), len(groups.plan.first) - 1
    out = Sums(np.empty((k, d + 1, d + 1)), np.empty((k, k)), np.empty(k), np.empty(s), np.empty(s, dtype=bool))
    _e_step(frames, groups, (initial, transition, *white), (*out, None), n_threads, single, faintest)
    return out


def posteriors(frames: np.ndarray, groups: Seating, initial: np.ndarray, transition: np.ndarray, white: tuple[np.ndarray, ...],
               *, n_threads: int = 1, single: bool = False, faintest: float = -np.inf,
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """γ (N, K), log-likelihood (S,) of each sequence, and (S,) whether it failed and is for the twin."""
    found, failed = np.empty(len(groups.plan.first) - 1), np.empty(len(groups.plan.first) - 1, dtype=bool)
    weights = np.zeros((len(frames), len(initial)))
    _e_step(
        frames, groups, (initial, transition, *white), (None, None, None, found, failed, weights), n_threads, single, faintest
    )
    return weights, found, failed


def likelihoods(frames: np.ndarray, groups: Seating, initial: np.ndarray, transition: np.ndarray, white: tuple[np.ndarray, ...],
                *, n_threads: int = 1, single: bool = False, faintest: float = -np.inf,
                ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The same without γ."""
    found, failed = np.empty(len(groups.plan.first) - 1), np.empty(len(groups.plan.first) - 1, dtype=bool)
    _e_step(frames, groups, (initial, transition, *white), (None, None, None, found, failed, None), n_threads, single, faintest)
    return found, failed


def _e_step(
    frames: np.ndarray, groups: Seating, model: tuple[np.ndarray, ...], out: Any, n_threads: int, single: bool, faintest: float
) -> None:
    """Where pieces of a sequence disagree at a seam, all is done once more, with that sequence cut more carefully."""
    options = (n_threads, single, faintest)
    while native.e_step(*_in_order(frames, *groups.plan, *model), *out, options) and groups.mend(out[4]):
        pass


class SegmentSums(NamedTuple):
    """What one E-step of a semi-Markov model gives: as Sums, and durations (K, L), expected number of segments of d frames."""

    moments: np.ndarray
    transitions: np.ndarray
    first: np.ndarray
    durations: np.ndarray
    log_likelihood: np.ndarray
    failed: np.ndarray
    weights: np.ndarray | None


def segments(
    frames: np.ndarray,
    lengths: np.ndarray,
    initial: np.ndarray,
    transition: np.ndarray,
    durations: np.ndarray,
    white: tuple[np.ndarray, ...],
    *,
    weights: bool = False,
    n_threads: int = 1,
) -> SegmentSums:
    """E-step over segments: frames (N, D) of sequences one after another, durations (K, L).

    Any number of threads gives the same bits.
    """
    n, d, k, s, longest = len(frames), len(white[0]), len(white[3]), len(lengths), durations.shape[1]
    starts, table = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64), in_eights(durations)
    out = SegmentSums(
        np.empty((k, d + 1, d + 1)), np.empty((k, k)), np.empty(k), np.empty_like(table), np.empty(s), np.empty(s, dtype=bool),
        np.zeros((n, k)) if weights else None,
    )  # fmt: skip
    native.segments(*_in_order(frames, starts, initial, transition, table, *white), *out, n_threads)
    return out._replace(durations=out.durations[:, :longest])


def in_eights(durations: np.ndarray) -> np.ndarray:
    """(K, L) with columns of zeros behind, so that at every level a row is whole vectors."""
    return np.pad(durations, ((0, 0), (0, -durations.shape[1] % 8)))


def mixture(frames: np.ndarray, log_weights: np.ndarray, white: tuple[np.ndarray, ...], *, weights: bool = False,
            n_threads: int = 1, single: bool = False) -> tuple[float, np.ndarray, np.ndarray | None]:  # fmt: skip
    """The E-step without dynamics: log-likelihood of all frames (N, D), moments as in Sums, and γ (N, K) when asked for.

    In float32 (`single`) the log-likelihood is NaN where it failed.
    """
    n, d, k = len(frames), len(white[0]), len(white[3])
    moments, gamma = np.empty((k, d + 1, d + 1)), np.empty((n, k)) if weights else None
    total = native.mixture(*_in_order(frames, log_weights, *white), moments, gamma, n_threads, single)
    return total, moments, gamma


def decode(frames: np.ndarray, lengths: np.ndarray, log_initial: np.ndarray, log_transition: np.ndarray,
           white: tuple[np.ndarray, ...], *, n_threads: int = 1) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Viterbi: the best states (N,) of all frames, and the logarithm (S,) of each sequence's joint probability with them."""
    path, score = np.empty(len(frames), dtype=np.int64), np.empty(len(lengths))
    groups = plan(lengths, native.lanes(), np.full(len(lengths), WHOLE))
    native.decode(*_in_order(frames, *groups, log_initial, log_transition, *white), path, score, n_threads)
    return path, score


def rollouts(start: np.ndarray, force: np.ndarray, source: np.ndarray, initial: np.ndarray, chain: np.ndarray,
             white: tuple[np.ndarray, ...], gains: np.ndarray, offsets: np.ndarray, *, gate: float, dt: float,
             out: tuple[np.ndarray, np.ndarray], n_threads: int = 1, single: bool = False) -> bool:  # fmt: skip
    """Into `out`, positions and velocities (N, T, d) from start (N, d) under force (T, f) or (N, T, f); False if not finite.

    `source` (D,) says which of (position, force, velocity) each channel of the densities is; gains (K, d, d + f), offsets (K, d).
    """
    (n, d), (k, _, n_in) = start.shape, gains.shape
    columns = (k + d * (1 + n_in) + 1) // 2 * 2
    matrix = np.zeros((k, columns), dtype=np.float32 if single else np.float64)  # all that the weights are multiplied by
    matrix[:, :k] = chain
    matrix[:, k : k + d * (1 + n_in)] = np.dstack([offsets[:, :, None], gains]).reshape(k, -1)
    given = _in_order(start, force, source, initial, *white, matrix)
    finite: bool = native.rollouts(d, force.shape[-1], n, force.shape[-2], *given, gate, dt, *out, n_threads, single)
    return finite


def _in_order(*arrays: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(a) for a in arrays]
