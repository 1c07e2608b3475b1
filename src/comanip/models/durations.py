"""How long a state lasts: the discrete Gamma distribution over d = 1..L frames, log p(d) = a log d − b d − log Σ_d.

Shape a + 1, mean about (a + 1) / b, spread about mean / sqrt(a + 1): five frames or five hundred are one family. Shape 1 is the
geometric distribution, so whatever a Markov chain says of durations is in it. It is an exponential family: the likelihood is
concave in (a, b), and its maximum is where E[log d] and E[d] are those of the data.
"""

from __future__ import annotations

import numpy as np

from ..interfaces import Array
from .gaussian import log_sum_exp


def table(parameters: Array, longest: int) -> Array:
    """p (K, L) of parameters (K, 2), a and b L: decay over the whole length, so that both are numbers of like size."""
    log_p = parameters @ _features(longest)
    return np.asarray(np.exp(log_p - log_sum_exp(log_p)[:, None]))


def of_mean(mean: Array, shape: float, longest: int) -> Array:
    """Parameters (K, 2) whose mean is about `mean` (K,) frames."""
    return np.column_stack([np.full(len(mean), shape - 1.0), shape * longest / mean])


def most_likely(counts: Array, before: Array, floor: float, *, most_steps: int = 50) -> Array:
    """M-step: parameters (K, 2) that maximise Σ_d counts(d) log p(d) for counts (K, L), with 1 ≤ shape ≤ 1 / floor².

    Newton's method from `before`, steps halved until nothing falls, so EM never falls even where it stops early. A state that was
    never visited keeps what it had.
    """
    x = _features(counts.shape[1])
    total = counts.sum(axis=1, keepdims=True)
    seen = counts @ x.T / np.maximum(total, 1e-300)
    most = 1.0 / floor**2 - 1.0

    def value(parameters: Array) -> Array:
        return (parameters * seen).sum(axis=1) - log_sum_exp(parameters @ x)

    found = np.column_stack([before[:, 0].clip(0.0, most), before[:, 1]])
    active = total[:, 0] > 1e-10
    for _ in range(most_steps):
        p = table(found, counts.shape[1])
        expected = p @ x.T
        apart = x[None] - expected[:, :, None]
        hessian = np.einsum("kl,kal,kbl->kab", p, apart, apart)
        gradient = seen - expected
        a = found[:, 0]
        held = ((a <= 0.0) & (gradient[:, 0] < 0.0)) | ((a >= most) & (gradient[:, 0] > 0.0))
        gradient[held, 0] = 0.0
        hessian[held, 0, 1] = hessian[held, 1, 0] = 0.0
        hessian += np.eye(2) * (1e-12 + 1e-12 * np.trace(hessian, axis1=1, axis2=2)[:, None, None])
        step = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        active &= (step * gradient).sum(axis=1) > 1e-13
        if not active.any():
            break
        now, size = value(found), np.ones(len(found))
        for _ in range(40):
            moved = found + size[:, None] * step
            moved[:, 0] = moved[:, 0].clip(0.0, most)
            worse = active & ~(value(moved) >= now)
            if not worse.any():
                break
            size[worse] *= 0.5
        found = np.where((active & ~worse)[:, None], moved, found)
    return found


def _features(longest: int) -> Array:
    """log d and −d / L, (2, L)."""
    d = np.arange(1.0, longest + 1.0)
    return np.stack([np.log(d), -d / longest])
