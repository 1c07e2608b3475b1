"""The peers' own interfaces, asked in the same words: a fit as people write it, with its defaults, from data to a model."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from machine import Problem, alternated, median, problem, stay_on_one_core


def hmm(estimator: Any, p: Problem) -> Callable[[], Any]:
    return lambda: estimator(len(p.initial), "full", random_state=0).fit(p.frames, p.lengths)


def mixture(estimator: Any, p: Problem) -> Callable[[], Any]:
    return lambda: estimator(len(p.initial), random_state=0).from_samples(p.frames, n_iter=20, R_diff=0.0)


def responsibilities(estimator: Any, p: Problem) -> Callable[[], Any]:
    model = estimator(len(p.initial), np.full(len(p.initial), 1.0 / len(p.initial)), p.means, p.covariances)
    return lambda: model.to_responsibilities(p.frames)


def regression(estimator: Any, p: Problem) -> Callable[[], Any]:
    model = estimator(len(p.initial), np.full(len(p.initial), 1.0 / len(p.initial)), p.means, p.covariances)
    return lambda: model.predict(np.arange(4), p.frames[:, :4])


def measure() -> list[dict[str, Any]]:
    """Seconds of ours and of the peer's class, and what the model found gives the data a frame; mixtures find the same."""
    import comanip

    stay_on_one_core()
    logging.disable(logging.WARNING)
    rows = []

    def row(work: str, peer: str, calls: list[Callable[[], Any]], score: Callable[[Any], float] | None) -> None:
        answers = [call() for call in calls]
        if score is None:
            np.testing.assert_allclose(answers[0], answers[1], rtol=1e-6, atol=1e-6, err_msg=work)
        times = alternated({"ours": calls[0], "peer": calls[1]}, 5, 30.0)
        ours, theirs = median(times["ours"]), median(times["peer"])
        found = [None if score is None else score(a) for a in answers]
        rows.append({"work": work, "peer": peer, "s": [ours, theirs], "score": found})
        print(rows[-1], file=sys.stderr)

    try:
        from hmmlearn.hmm import GaussianHMM

        for name, lengths, d, k in (("10 × 300, D 3, K 5", [300] * 10, 3, 5), ("200 × 500, D 7, K 10", [500] * 200, 7, 10)):
            p = problem(lengths, d, k)
            calls = [hmm(comanip.GaussianHMM, p), hmm(GaussianHMM, p)]
            row(f"GaussianHMM.fit, {name}", "hmmlearn", calls, lambda m, p=p: m.score(p.frames, p.lengths) / len(p.frames))
    except ImportError:
        print("hmmlearn is absent", file=sys.stderr)
    try:
        from gmr import GMM

        p = problem([500] * 40, 7, 10)
        row("GMM.from_samples, 20,000, D 7, K 10", "gmr", [mixture(comanip.GMM, p), mixture(GMM, p)],
            lambda m: float(np.log(m.to_probability_density(p.frames)).mean()))  # fmt: skip
        row("GMM.to_responsibilities, the same", "gmr", [responsibilities(comanip.GMM, p), responsibilities(GMM, p)], None)
        row("GMM.predict, 4 to 3", "gmr", [regression(comanip.GMM, p), regression(GMM, p)], None)
    except ImportError:
        print("gmr is absent", file=sys.stderr)
    return rows


if __name__ == "__main__":
    measure()
