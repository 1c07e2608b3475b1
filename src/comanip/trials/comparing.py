"""Two laws with the same partners: paired differences, and how sure they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import check_generator
from ..interfaces import Array
from .judging import Verdict

RESAMPLES = 2000
SURE = (2.5, 97.5)  # percentiles of a 95 % interval
MEASURES = {"effort": "effort_n2s", "time_s": "duration_s", "vibration_n": "vibration_n", "peak_force_n": "peak_force_n"}


def paired(first: Sequence[Verdict], second: Sequence[Verdict], rng: np.random.Generator) -> dict[str, Any]:
    """`first` minus `second`, partner by partner: {measure: [mean difference, low, high]} with 95 % bootstrap intervals.

    Success counts over all partners. Effort, time, vibration and peak force are compared where BOTH succeeded, for a law that
    does not do the task has no effort with it; "both" says how many those are. None where there are fewer than two.
    """
    check_generator(rng)
    won = np.array([[a.success, b.success] for a, b in zip(first, second, strict=True)], dtype=float).reshape(-1, 2)
    both = won.all(axis=1)
    found: dict[str, Any] = {"success": _difference(won[:, 0] - won[:, 1], rng), "both": int(both.sum())}
    for name, field in MEASURES.items():
        values = np.array([[getattr(a, field), getattr(b, field)] for a, b in zip(first, second, strict=True)]).reshape(-1, 2)
        found[name] = _difference((values[:, 0] - values[:, 1])[both], rng)
    return found


def _difference(apart: Array, rng: np.random.Generator) -> list[float] | None:
    if len(apart) < 2 or not np.isfinite(apart).all():
        return None
    means = apart[rng.integers(len(apart), size=(RESAMPLES, len(apart)))].mean(axis=1)
    low, high = np.percentile(means, SURE)
    return [float(apart.mean()), float(low), float(high)]
