"""A finished model at work: log-likelihood, best path and posteriors of sequences, ns a frame."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from comanip.models import hmm
from comanip.models.hmm import Hmm
from machine import Problem, alternated, median, problem, stay_on_one_core

SIZES: dict[str, tuple[list[int], int, int]] = {
    "10 × 300, D 3, K 5": ([300] * 10, 3, 5),
    "200 × 500, D 7, K 10": ([500] * 200, 7, 10),
    "1 × 100,000, D 7, K 10": ([100_000], 7, 10),
}
WORK = ("log-likelihood", "best path", "posteriors")


def comanip(p: Problem) -> dict[str, Callable[[], Any]]:
    model = Hmm(p.initial, p.transition, p.means, p.covariances, tuple(f"c{i}" for i in range(p.frames.shape[1])))
    return {
        "log-likelihood": lambda: float(hmm.log_likelihood(model, p.sequences).sum()),
        "best path": lambda: np.concatenate(hmm.viterbi_of_all(model, p.sequences)),
        "posteriors": lambda: np.concatenate([found.weights for found in hmm.posteriors_of_all(model, p.sequences)]),
    }


def hmmlearn(p: Problem) -> dict[str, Callable[[], Any]]:
    """In scaling mode, its faster one, where it has a choice."""
    from hmmlearn.hmm import GaussianHMM

    model = GaussianHMM(len(p.initial), "full", implementation="scaling")
    model.startprob_, model.transmat_, model.means_, model.n_features = p.initial, p.transition, p.means, p.frames.shape[1]
    model.covars_ = p.covariances
    return {
        "log-likelihood": lambda: model.score(p.frames, p.lengths),
        "best path": lambda: model.predict(p.frames, p.lengths),
        "posteriors": lambda: model.predict_proba(p.frames, p.lengths),
    }


def dynamax(p: Problem) -> dict[str, Callable[[], Any]]:
    """Each compiled into one function over all sequences, which are of equal length here."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from dynamax.hidden_markov_model import GaussianHMM

    model = GaussianHMM(len(p.initial), p.frames.shape[1])
    params, _ = model.initialize(
        initial_probs=jnp.array(p.initial), transition_matrix=jnp.array(p.transition), emission_means=jnp.array(p.means),
        emission_covariances=jnp.array(p.covariances),
    )  # fmt: skip
    batch = jnp.array(p.frames.reshape(len(p.lengths), p.lengths[0], -1))
    likelihood = jax.jit(jax.vmap(lambda x: model.marginal_log_prob(params, x)))
    path = jax.jit(jax.vmap(lambda x: model.most_likely_states(params, x)))
    smoothed = jax.jit(jax.vmap(lambda x: model.smoother(params, x).smoothed_probs))
    return {
        "log-likelihood": lambda: float(likelihood(batch).sum()),
        "best path": lambda: np.ravel(path(batch)),
        "posteriors": lambda: np.asarray(smoothed(batch)).reshape(len(p.frames), -1),
    }


def measure() -> list[dict[str, Any]]:
    """ns a frame of each peer, for each size and kind of work. All answers agree, or the run stops."""
    stay_on_one_core()
    rows = []
    for size, (lengths, d, k) in SIZES.items():
        p = problem(lengths, d, k)
        peers: dict[str, dict[str, Callable[[], Any]]] = {}
        for name, make in {"comanip": comanip, "hmmlearn": hmmlearn, "dynamax": dynamax}.items():
            try:
                peers[name] = make(p)
            except ImportError:
                print(f"{name} is absent", file=sys.stderr)
        for kind in WORK:
            answers = {peer: calls[kind]() for peer, calls in peers.items()}
            for peer, answer in answers.items():
                if not np.allclose(answer, answers["comanip"], rtol=1e-8, atol=1e-8):
                    raise AssertionError(f"{kind}, {size}: {peer} finds something else")
            times = alternated({peer: calls[kind] for peer, calls in peers.items()}, 7, 3.0)
            ns = {peer: median(t) / len(p.frames) * 1e9 for peer, t in times.items()}
            rows.append({"kind": kind, "size": size, "ns": ns})
            print(kind, size, {n: round(v, 1) for n, v in ns.items()}, file=sys.stderr)
    return rows


if __name__ == "__main__":
    print(measure())
