"""One EM iteration and one tick with explicit durations: the compiled kernel and its numpy twin.

No peer: hmmlearn, dynamax, pomegranate and gmr have no explicit durations; pbdlib counts them on Viterbi's path after the EM of a
plain chain.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from comanip import kernels
from comanip.models import hsmm
from comanip.models.durations import of_mean, table
from comanip.models.filtering import DurationFilter
from comanip.models.hsmm import Hsmm
from machine import alternated, median, problem, stay_on_one_core

SIZES = {"10 × 300, D 3, K 5, L 100": ([300] * 10, 3, 5, 100), "200 × 500, D 7, K 10, L 100": ([500] * 200, 7, 10, 100)}
N_TICKS = 2_000


def without_native(call: Callable[[], Any]) -> Callable[[], Any]:
    native = kernels.native

    def wrapped() -> Any:
        kernels.native = None
        try:
            return call()
        finally:
            kernels.native = native

    return wrapped


def measure() -> list[dict[str, Any]]:
    rows = []
    stay_on_one_core()
    for name, (lengths, d, k, longest) in SIZES.items():
        p = problem(lengths, d, k)
        onward = p.transition * ~np.eye(k, dtype=bool)
        durations = table(of_mean(np.full(k, lengths[0] / k), 4.0, longest), longest)
        m = Hsmm(p.initial, onward / onward.sum(axis=1, keepdims=True), durations, p.means, p.covariances,
                 tuple(f"c{i}" for i in range(d)))  # fmt: skip

        def e_step(m: Hsmm = m, p: Any = p) -> Any:
            return hsmm.segment_sums(m, p.frames, p.lengths)

        def ticks(one: DurationFilter, frames: np.ndarray = p.frames[:N_TICKS]) -> None:
            for xi in frames:
                one.step(xi)

        native, twin = e_step(), without_native(e_step)()
        if not np.allclose(native.log_likelihood, twin.log_likelihood, rtol=1e-9):
            raise AssertionError(f"the twin computes something else: {twin.log_likelihood} and {native.log_likelihood}")
        filters = DurationFilter(m), without_native(lambda m=m: DurationFilter(m))()
        times = alternated({"comanip": e_step, "comanip, numpy twin": without_native(e_step)}, 15, 10.0)
        on_line = alternated({"comanip": lambda f=filters: ticks(f[0]), "comanip, numpy twin": lambda f=filters: ticks(f[1])}, 5)
        ns = {peer: median(t) / len(p.frames) * 1e9 for peer, t in times.items()}
        us = {peer: median(t) / N_TICKS * 1e6 for peer, t in on_line.items()}
        rows.append({"size": name, "ns": ns, "us": us})
        print(name, {n: round(v) for n, v in ns.items()}, {n: round(v, 2) for n, v in us.items()}, file=sys.stderr)
    return rows


if __name__ == "__main__":
    print(measure())
