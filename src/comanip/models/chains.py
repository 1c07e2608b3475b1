"""Recursions over a Markov chain in the log domain, for several sequences side by side.

Arrays in, arrays out: `log_b` (S, T, K) holds log b_i(ξ_t) of S sequences padded to the longest, `lengths` (S,) their
true lengths. The log domain is what survives a left-right chain: a state left long ago has a weight below 1e-308 within
a fraction of a second, and may still be the one that explains the future.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..interfaces import Array

LOG_ZERO = -1e200  # log of a forbidden transition: finite (no inf - inf), and below any sum of densities
IMPOSSIBLE = -1e99  # a log-likelihood below this means that no allowed path explains the data


class Expectations(NamedTuple):
    """What EM needs from one pass.

    weights         (N, K) γ, posterior of each state at each frame, sequences stacked
    transitions     (K, K) expected number of transitions, summed over frames and sequences
    first           (K,)   posterior of the first frames, summed over sequences
    log_likelihood  (S,)   one number a sequence
    """

    weights: Array
    transitions: Array
    first: Array
    log_likelihood: Array


def log_of(probabilities: Array) -> Array:
    """Logarithms with LOG_ZERO in place of -inf."""
    p = np.asarray(probabilities)
    return np.where(p > 0.0, np.log(np.where(p > 0.0, p, 1.0)), LOG_ZERO)


def padded(stacked: Array, lengths: Sequence[int] | Array) -> Array:
    """(N, K) rows of S sequences one after another -> (S, T, K), zeros behind the shorter ones."""
    out = np.zeros((len(lengths), int(max(lengths)), stacked.shape[1]))
    out[within(lengths)] = stacked
    return out


def within(lengths: Sequence[int] | Array) -> np.ndarray:
    """(S, T) mask of the frames that exist."""
    lengths = np.asarray(lengths)
    return np.arange(int(lengths.max()))[None, :] < lengths[:, None]


@np.errstate(under="ignore")  # weights that vanish are meant to
def forward_backward(log_b: Array, lengths: Array, log_initial: Array, log_transition: Array) -> tuple[Array, Array, Array]:
    """log α, log β (S, T, K) and log p(ξ_1..ξ_T) (S,).

    Eq. (4): α_t(j) = [Σ_i α_{t-1}(i) a_ij] b_j(ξ_t), α_1(i) = Π_i b_i(ξ_1).

    The paper prints α without its start and unnormalised, which leaves float64 within a second; logarithms do not.
    β_t(i) b_i(ξ_t) obeys the same recursion as α backwards in time with the transposed chain, so both run in one loop.
    Behind the end of a sequence the values mean nothing.
    """
    n_sequences, length, n_states = log_b.shape
    rows = np.arange(n_sequences)[:, None]
    backwards = np.clip(lengths[:, None] - 1 - np.arange(length)[None, :], 0, None)  # frame seen at step t from the end
    both = np.empty((length, n_sequences, 2 * n_states))  # α in the first K columns, β b backwards in the others
    both[:, :, :n_states] = log_b.transpose(1, 0, 2)
    both[:, :, n_states:] = log_b[rows, backwards].transpose(1, 0, 2)
    both[0, :, :n_states] += log_initial
    source, weight = _arrivals(log_transition)
    terms = np.empty((n_sequences, *source.shape))
    gathered = terms.reshape(n_sequences, -1)
    top = np.empty((n_sequences, 1, 2 * n_states))
    total = np.empty((n_sequences, 2 * n_states))
    flat = source.reshape(-1)
    for t in range(1, length):
        np.take(both[t - 1], flat, axis=1, out=gathered, mode="clip")
        terms += weight
        np.maximum.reduce(terms, axis=1, keepdims=True, out=top)
        terms -= top
        np.exp(terms, out=terms)
        np.add.reduce(terms, axis=1, out=total)
        np.log(total, out=total)
        total += top[:, 0]
        both[t] += total
    log_alpha = both[:, :, :n_states].transpose(1, 0, 2)
    log_beta = both[backwards.T, rows.T, n_states:].transpose(1, 0, 2) - log_b
    last = log_alpha[np.arange(n_sequences), lengths - 1]
    peak = last.max(axis=1)
    return log_alpha, log_beta, peak + np.log(np.exp(last - peak[:, None]).sum(axis=1))


def _arrivals(log_transition: Array) -> tuple[np.ndarray, Array]:
    """Where each state can be reached from: sources and log-weights (M, 2 K), forwards in the first K columns.

    M is the most that any state has, 2 for a left-right chain of any length: forbidden transitions cost no time.
    """
    n_states = len(log_transition)
    sides = [log_transition, log_transition.T]
    m = max(1, max(int((side > IMPOSSIBLE).sum(axis=0).max()) for side in sides))
    source = np.empty((m, 2 * n_states), dtype=np.intp)
    weight = np.empty((m, 2 * n_states))
    for k, side in enumerate(sides):
        best = np.argsort(-side, axis=0, kind="stable")[:m]
        columns = slice(k * n_states, (k + 1) * n_states)
        source[:, columns] = best + k * n_states
        weight[:, columns] = np.take_along_axis(side, best, axis=0)
    return source, weight


@np.errstate(under="ignore")
def expectations(log_b: Array, lengths: Array, log_initial: Array, log_transition: Array) -> Expectations:
    """The E-step over all sequences."""
    log_alpha, log_beta, log_likelihood = forward_backward(log_b, lengths, log_initial, log_transition)
    mask = within(lengths)
    log_gamma = log_alpha + log_beta - log_likelihood[:, None, None]
    gamma = np.exp(np.minimum(log_gamma[mask], 0.0))
    gamma /= np.maximum(gamma.sum(axis=1, keepdims=True), 1e-300)
    transitions = np.zeros_like(log_transition)
    ahead = log_b + log_beta - log_likelihood[:, None, None]
    here, there = log_alpha[:, :-1][mask[:, 1:]], ahead[:, 1:][mask[:, 1:]]
    i, j = np.nonzero(log_transition > IMPOSSIBLE)
    block = max(1, 1_000_000 // len(i))  # frames at a time: at most some 20 MB of ξ_t(i, j)
    for start in range(0, len(here), block):
        xi = here[start : start + block, i] + log_transition[i, j] + there[start : start + block, j]
        shares = np.exp(np.minimum(xi, 0.0))
        shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-300)  # logarithms of 1e5 have no more than 11 digits behind
        transitions[i, j] += shares.sum(axis=0)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    return Expectations(gamma, transitions, gamma[starts].sum(axis=0), log_likelihood)


def best_path(log_b: Array, log_initial: Array, log_transition: Array) -> tuple[np.ndarray, float]:
    """Viterbi: the most likely states (T,) of one sequence log_b (T, K), and the logarithm of its joint probability."""
    length, n_states = log_b.shape
    came_from = np.empty((length, n_states), dtype=np.intp)
    score = log_initial + log_b[0]
    states = np.arange(n_states)
    for t in range(1, length):
        reach = score[:, None] + log_transition
        came_from[t] = reach.argmax(axis=0)
        score = reach[came_from[t], states] + log_b[t]
    path = np.empty(length, dtype=np.intp)
    path[-1] = int(score.argmax())
    for t in range(length - 1, 0, -1):
        path[t - 1] = came_from[t, path[t]]
    return path, float(score.max())
