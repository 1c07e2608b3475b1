"""One EM iteration: the same data, the same start, the same likelihood; nanoseconds a frame, and memory over the data."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import checkout
from comanip.fitting.baum_welch import Chain, expect, maximise
from comanip.fitting.coordinates import Lessons
from comanip.kernels import native
from machine import Problem, alternated, dgemm_gflops, flops_per_frame, median, on_all_cores, problem, stay_on_one_core

RAGGED = np.exp(np.random.default_rng(5).uniform(np.log(20.0), np.log(5000.0), size=120)).astype(int)
SIZES: dict[str, tuple[Any, int, int]] = {
    "10 × 300, D 3, K 5": ([300] * 10, 3, 5),
    "200 × 500, D 7, K 10": ([500] * 200, 7, 10),
    "2,000 × 500, D 7, K 10": ([500] * 2000, 7, 10),
    "1 × 100,000, D 7, K 10": ([100_000], 7, 10),
    "120 ragged, 20 to 5,000, D 7, K 10": (RAGGED, 7, 10),
}


def comanip(p: Problem, n_threads: int = 1, single: bool = False) -> Callable[[], float]:
    d = p.frames.shape[1]
    lessons = Lessons(p.frames, p.lengths, np.zeros(d), np.ones(d), tuple(f"c{i}" for i in range(d)))
    chain = Chain(p.initial, p.transition, p.means, p.covariances)

    def iterate() -> float:
        total, sums = expect(chain, lessons, n_threads, single)
        maximise(sums, chain, 1e-4, 0.0)
        return total

    return iterate


def comanip_numpy(p: Problem) -> Callable[[], float]:
    from comanip import kernels

    iterate = comanip(p)

    def without() -> float:
        kernels.native = None
        try:
            return iterate()
        finally:
            kernels.native = native

    return without


def hmmlearn(p: Problem) -> Callable[[], float]:
    from hmmlearn.hmm import GaussianHMM

    return fitted(GaussianHMM, p)


def comanip_estimator(p: Problem) -> Callable[[], float]:
    from comanip import GaussianHMM

    return fitted(GaussianHMM, p)


def fitted(estimator: Any, p: Problem) -> Callable[[], float]:
    """Scaling mode, hmmlearn's faster one; its floor and priors set to nothing, so that it does the same work."""

    def iterate() -> float:
        m = estimator(
            len(p.initial), "full", min_covar=0.0, covars_prior=0.0, covars_weight=0.0, n_iter=1, init_params="",
            implementation="scaling", tol=-np.inf,
        )  # fmt: skip
        m.startprob_, m.transmat_, m.means_ = p.initial, p.transition, p.means
        m.covars_ = p.covariances
        m.fit(p.frames, p.lengths)
        return float(m.monitor_.history[0])

    return iterate


def dynamax(p: Problem, single: bool = False) -> Callable[[], float]:
    """E-step and M-step in one compiled function (its own fit_em compiles at every call). Needs equal lengths."""
    import jax

    jax.config.update("jax_enable_x64", not single)
    import jax.numpy as jnp
    from dynamax.hidden_markov_model import GaussianHMM

    hmm = GaussianHMM(len(p.initial), p.frames.shape[1])
    params, props = hmm.initialize(
        initial_probs=jnp.array(p.initial), transition_matrix=jnp.array(p.transition), emission_means=jnp.array(p.means),
        emission_covariances=jnp.array(p.covariances),
    )  # fmt: skip
    batch = jnp.array(p.frames.reshape(len(p.lengths), p.lengths[0], -1))
    state = hmm.initialize_m_step_state(params, props)

    @jax.jit
    def step(params, batch):
        stats, lls = jax.vmap(lambda x: hmm.e_step(params, x))(batch)
        return hmm.m_step(params, props, stats, state)[0], lls.sum()

    def iterate() -> float:
        new, total = step(params, batch)
        jax.block_until_ready(new)
        return float(total)

    iterate()  # compiles: not counted
    return in_precision(iterate, single)


def in_precision(call: Callable[[], Any], single: bool) -> Callable[[], Any]:
    """JAX keeps its precision in a switch of the process, and compiles again where that has moved."""
    import jax

    def wrapped() -> Any:
        jax.config.update("jax_enable_x64", not single)
        return call()

    return wrapped


def pomegranate(p: Problem) -> Callable[[], float]:
    """float32, the only one it holds throughout; one summarize over all sequences: its E-step."""
    import torch
    from pomegranate.distributions import Normal
    from pomegranate.hmm import DenseHMM

    torch.set_num_threads(1)

    def as_tensor(a: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(a).float()

    distributions = [Normal(as_tensor(m), as_tensor(s), min_cov=0.0) for m, s in zip(p.means, p.covariances, strict=True)]
    x = as_tensor(p.frames.reshape(len(p.lengths), p.lengths[0], -1))

    def iterate() -> float:
        m = DenseHMM(distributions, edges=as_tensor(p.transition), starts=as_tensor(p.initial), ends=None)
        m.summarize(x)
        return float("nan")  # ends are part of its likelihood, so there is nothing to compare

    return iterate


def pbdlib(p: Problem) -> Callable[[], float]:
    """One step of its `em`, from a fresh model each time; that it has not converged it would say aloud."""
    start = p.initial, p.transition, p.means, p.covariances
    total = -float(np.sum(checkout.model(*start).score(p.sequences)))  # its score has the other sign

    def iterate() -> float:
        m = checkout.model(*start)
        with contextlib.redirect_stdout(io.StringIO()):
            m.em(p.sequences, nb_max_steps=1)
        return total

    return iterate


def measure() -> list[dict[str, Any]]:
    rows = []
    stay_on_one_core()
    for name, (lengths, d, k) in SIZES.items():
        p = problem(lengths, d, k)
        equal = len(set(p.lengths)) == 1
        makers: dict[str, Any] = {
            "comanip": comanip,
            "comanip, 2 threads": lambda p: on_all_cores(comanip(p, 2)),
            "comanip, float32": lambda p: comanip(p, single=True),
            "comanip, numpy twin": comanip_numpy,
            "comanip.GaussianHMM": comanip_estimator,
            "hmmlearn": hmmlearn,
        }
        if equal:
            makers |= {"dynamax": dynamax, "dynamax, float32": lambda p: dynamax(p, single=True)}
        if equal and len(p.frames) < 50_000:
            makers["pomegranate"] = pomegranate
        if len(p.frames) <= 100_000:
            makers["pbdlib"] = pbdlib
        work = {}
        for peer, make in makers.items():
            try:
                work[peer] = make(p)
            except ImportError:
                print(f"{peer} is absent", file=sys.stderr)
        likelihood = {peer: call() for peer, call in work.items()}
        for peer, value in likelihood.items():
            rtol = 1e-6 if "float32" in peer else 1e-8
            if np.isfinite(value) and "dynamax" not in peer and not np.isclose(value, likelihood["comanip"], rtol=rtol):
                raise AssertionError(f"{peer} computes something else: {value} and {likelihood['comanip']}")
        gemm = [dgemm_gflops()]
        times = alternated(work, 7, 12.0)
        gemm.append(dgemm_gflops())
        ns = {peer: median(t) / len(p.frames) * 1e9 for peer, t in times.items()}
        floor = flops_per_frame(d, k) / float(np.mean(gemm))
        agrees = bool(np.isclose(likelihood.get("dynamax", likelihood["comanip"]), likelihood["comanip"], rtol=1e-4))
        rows.append({"size": name, "ns": ns, "floor_ns": floor, "gflops": float(np.mean(gemm)), "dynamax_agrees": agrees})
        print(name, {n: round(v, 1) for n, v in ns.items()}, f"floor {floor:.1f}", file=sys.stderr)
    return rows


def memory_over_data() -> float:
    """MB of peak memory that an iteration over 10^6 frames adds, on Linux; making the data took more, so the peak is reset."""
    p = problem([500] * 2000, 7, 10)
    iterate = comanip(p)
    Path("/proc/self/clear_refs").write_text("5")
    before = _resident_mb("VmRSS")
    iterate()
    return _resident_mb("VmHWM") - before


def _resident_mb(what: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith(what))) / 1024.0


if __name__ == "__main__":
    print(memory_over_data() if "memory" in sys.argv else measure())
