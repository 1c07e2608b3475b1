"""Recursions over segments, states that last, in the log domain and for several sequences side by side.

As in `chains`: `log_b` (S, T, K) of S sequences padded to the longest, `lengths` (S,). `log_durations` (K, L) holds log p_j(d) of
d = 1..L frames. A sequence begins where its first segment begins, and ends anywhere inside its last: how much longer that would
have lasted is summed over (right-censored).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from .chains import IMPOSSIBLE, LOG_ZERO, within
from .gaussian import log_sum_exp


class Expectations(NamedTuple):
    """What EM needs from one pass; the first three and the last as in `chains.Expectations`.

    durations   (K, L) expected number of segments of state j that last d frames, those beyond the end included
    """

    weights: Array
    transitions: Array
    first: Array
    durations: Array
    log_likelihood: Array


class Forward(NamedTuple):
    """entered, left (S, T, K): log-probability of the frames BEFORE t and of entering j at t, of those up to t and of j ending
    at t; and log p(ξ_1..ξ_T) (S,)."""

    entered: Array
    left: Array
    log_likelihood: Array


@np.errstate(under="ignore")
def forward(log_b: Array, lengths: Array, log_initial: Array, log_transition: Array, log_durations: Array) -> Forward:
    """α_t(j, r) = b_j(ξ_t) [α_{t-1}(j, r + 1) + p_j(r) Σ_i α_{t-1}(i, 1) a_ij]: state j with r frames left, this one included.

    Time inside a state needs no sum over where it began, so a frame costs K L + K². Only what enters and leaves is kept.
    """
    n_sequences, length, n_states = log_b.shape
    entered, left = np.full((2, n_sequences, length, n_states), LOG_ZERO)
    found = np.empty(n_sequences)
    alpha = np.full((n_sequences, *log_durations.shape), LOG_ZERO)
    for t in range(length):
        alive = lengths > t
        entered[alive, t] = log_sum_exp(left[alive, t - 1, :, None] + log_transition, axis=1) if t else log_initial
        alpha[:, :, :-1] = alpha[:, :, 1:]
        alpha[:, :, -1] = LOG_ZERO
        np.logaddexp(alpha, entered[:, t, :, None] + log_durations, out=alpha)
        alpha += log_b[:, t, :, None]
        left[alive, t] = alpha[alive, :, 0]
        if (ends := lengths == t + 1).any():
            found[ends] = log_sum_exp(log_sum_exp(alpha[ends]))
    return Forward(entered, left, found)


@np.errstate(under="ignore")
def expectations(log_b: Array, lengths: Array, log_initial: Array, log_transition: Array, log_durations: Array) -> Expectations:
    """The E-step over all sequences.

    Backwards B_t(j, d) = b_j(ξ_t) B_{t+1}(j, d - 1) is the probability of the frames from t on when j is entered at t for d
    frames, and behind the end it is 1. A posterior changes only by what enters and what leaves: γ_t = γ_{t-1} + P(enters at t)
    - P(left at t - 1).
    """
    entered, left, found = forward(log_b, lengths, log_initial, log_transition, log_durations)
    n_sequences, length, n_states = log_b.shape
    value, onward = np.full((2, n_sequences, length + 1, n_states), LOG_ZERO)  # of entering j at t, of leaving i at t
    durations = np.zeros_like(log_durations)
    behind = np.zeros((n_sequences, *log_durations.shape))
    for t in range(length - 1, -1, -1):
        onward[:, t] = log_sum_exp(log_transition + value[:, t + 1, None, :])
        behind[:, :, 1:] = behind[:, :, :-1]
        behind[:, :, 0] = onward[:, t]
        behind[lengths == t + 1] = 0.0
        behind += log_b[:, t, :, None]
        paths = log_durations + behind
        value[:, t] = log_sum_exp(paths)
        paths += (entered[:, t] - found[:, None])[:, :, None]
        durations += np.exp(np.minimum(paths, 0.0, out=paths)).sum(axis=0)
    share = found[:, None, None]
    enter = np.exp(np.minimum(entered + value[:, :-1] - share, 0.0))
    leave = np.exp(np.minimum(left + onward[:, :-1] - share, 0.0))
    gamma = np.cumsum(enter, axis=1)
    gamma[:, 1:] -= np.cumsum(leave, axis=1)[:, :-1]
    gamma = np.maximum(gamma[within(lengths)], 0.0)
    gamma /= np.maximum(gamma.sum(axis=1, keepdims=True), 1e-300)
    transitions = np.zeros_like(log_transition)
    for i, j in np.argwhere(log_transition > IMPOSSIBLE):
        steps = left[:, :-1, i] + log_transition[i, j] + value[:, 1:-1, j] - found[:, None]
        transitions[i, j] = np.exp(np.minimum(steps, 0.0))[within(lengths)[:, 1:]].sum()
    return Expectations(gamma, transitions, enter[:, 0].sum(axis=0), durations, found)


def best_path(log_b: Array, log_initial: Array, log_transition: Array, log_durations: Array) -> tuple[np.ndarray, float]:
    """The most likely segmentation as states (T,) of one sequence log_b (T, K), and the logarithm of its joint probability.

    Of the last segment only what was seen counts: that it lasts at LEAST so long. A state that is never left (a_jj = 1) is one
    segment to the end.
    """
    length, n_states = log_b.shape
    longest = log_durations.shape[1]
    at_least = np.logaddexp.accumulate(log_durations[:, ::-1], axis=1)[:, ::-1]
    absorbs = np.diagonal(log_transition) > IMPOSSIBLE
    onward = np.where(absorbs[:, None], LOG_ZERO, log_transition)
    running = np.full((n_states, longest), LOG_ZERO)  # by the frames that the segment has lasted
    stays, since = np.full(n_states, LOG_ZERO), np.zeros(n_states, dtype=np.intp)  # the same for states never left
    came_from, lasted = np.zeros((2, length, n_states), dtype=np.intp)
    enter = log_initial
    for t in range(length):
        running[:, 1:] = running[:, :-1]
        running[:, 0] = enter
        running += log_b[t, :, None]
        since = np.where(enter > stays, t, since)
        stays = np.maximum(enter, stays) + log_b[t]
        ended = running + log_durations
        lasted[t] = ended.argmax(axis=1)
        reach = ended.max(axis=1)[:, None] + onward
        came_from[t] = reach.argmax(axis=0)
        enter = reach.max(axis=0)
    censored = running + at_least
    final = np.where(absorbs, stays, censored.max(axis=1))
    state = int(final.argmax())
    n = length - since[state] if absorbs[state] else int(censored[state].argmax()) + 1
    path = np.empty(length, dtype=np.intp)
    end = length
    while True:
        path[end - n : end] = state
        end -= n
        if end == 0:
            return path, float(final.max())
        state = came_from[end - 1, state]
        n = int(lasted[end - 1, state]) + 1
