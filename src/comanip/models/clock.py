"""The clock: when things happen, as one more channel of the same joint density.

A left-right HMM knows the order of its states but forgets how long it has been in one (a geometric duration). Here each lesson
is aligned to the states' median durations, the aligned time is called `phase` [s], and every state's Gaussian is taken over
(phase, position, force, velocity) with the weights that Baum-Welch found. GMR from phase then gives what is EXPECTED at any
moment of the task: where the hand is, how fast, and which force it feels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..interfaces import Array
from .gaussian import floored
from .gmm import Gmm
from .hmm import Hmm, posteriors

PHASE = "phase"


def aligned_phase(weights: Sequence[Array], dt: float) -> list[Array]:
    """Phase [s] of every frame of every lesson, from the posteriors (T, K) of each.

    A lesson that spends n_k frames in state k moves through it at median(n_k) / n_k: fast lessons are slowed down and slow ones
    hurried, state by state, until all agree. The median, because one lesson with a long rest must not stretch the task.
    """
    occupancy = np.array([h.sum(axis=0) for h in weights])
    usual = np.median(occupancy, axis=0)
    return [np.cumsum(h @ (usual / np.maximum(n, 1e-9))) * dt for h, n in zip(weights, occupancy, strict=True)]


def learn_clock(model: Hmm, lessons: Sequence[Array], dt: float, *, covariance_floor: float = 1e-4) -> Gmm:
    """Joint density of (phase, the model's channels) with the states of `model`: lessons are (T, D) in its channel order."""
    weights = [posteriors(model, lesson).weights for lesson in lessons]
    phases = aligned_phase(weights, dt)
    data = np.concatenate([np.column_stack([p, x]) for p, x in zip(phases, lessons, strict=True)])
    h = np.concatenate(weights)
    centre, scale = data.mean(axis=0), np.maximum(data.std(axis=0), 1e-12)
    z = (data - centre) / scale
    total = np.maximum(h.sum(axis=0), 1e-9)
    means = h.T @ z / total[:, None]
    apart = z[:, None, :] - means
    covariances = np.einsum("nk,nki,nkj->kij", h, apart, apart) / total[:, None, None]
    covariances = floored(covariances, covariance_floor)
    return Gmm(
        total / total.sum(),
        means * scale + centre,
        covariances * scale[:, None] * scale,
        (PHASE, *model.channels),
    )
