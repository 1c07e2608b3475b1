"""One tick from Python: filter and regression, microseconds; what a 1 kHz loop has to wait for."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import checkout
from comanip import kernels
from comanip.models import hmm
from comanip.models.filtering import ForwardFilter
from comanip.models.gmr import Regression
from comanip.models.hmm import Hmm

SIZES = {"D 3, K 5": (1, 1, 5), "D 14, K 10": (5, 4, 10)}


def model(d: int, f: int, k: int) -> Hmm:
    rng = np.random.default_rng(0)
    channels = [f"{g}.{i}" for g, n in (("position", d), ("force", f), ("velocity", d)) for i in range(n)]
    n = len(channels)
    root = 0.4 * rng.normal(size=(k, n, n))
    transition = 0.9 * np.eye(k) + 0.1 / k
    return Hmm(np.full(k, 1 / k), transition / transition.sum(axis=1, keepdims=True), 2.0 * rng.normal(size=(k, n)),
               root @ root.swapaxes(1, 2) + 0.2 * np.eye(n), tuple(channels))  # fmt: skip


def comanip(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    forward, out = ForwardFilter(m), np.empty(m.n_channels - n_in)
    regression = Regression(m, m.channels[:n_in], m.channels[n_in:])
    return lambda xi, x: regression.mean(forward.step(xi), x, out)


def by_hand(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    """The same tick in JAX, compiled, written as ours is: factors prepared, densities by a triangular solve."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax.scipy.linalg import solve_triangular

    factor = jnp.linalg.cholesky(jnp.array(m.covariances))
    log_peak = -jnp.log(jnp.diagonal(factor, axis1=1, axis2=2)).sum(axis=1) - 0.5 * m.n_channels * np.log(2 * np.pi)
    regression = Regression(m, m.channels[:n_in], m.channels[n_in:])
    means, chain = jnp.array(m.means), jnp.array(m.transition)
    gains, offsets = jnp.array(regression.gains), jnp.array(regression.offsets)

    @jax.jit
    def tick(h, xi, x):
        z = jax.vmap(lambda factor, mean: solve_triangular(factor, xi - mean, lower=True))(factor, means)
        log_b = log_peak - 0.5 * (z**2).sum(axis=1)
        h = (h @ chain) * jnp.exp(log_b - log_b.max())
        h = h / h.sum()
        return h, jnp.einsum("k,ko->o", h, gains @ x + offsets)

    state = [jnp.array(m.initial)]

    def call(xi, x):
        state[0], y = tick(state[0], xi, x)
        return np.asarray(y)

    return call


def dynamax(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    """A tick of dynamax's own parts, compiled into one: its emission distribution, made once, and the two steps of its filter."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from dynamax.hidden_markov_model import GaussianHMM
    from dynamax.hidden_markov_model.inference import _condition_on, _predict

    initial, chain = jnp.array(m.initial), jnp.array(m.transition)
    hmm = GaussianHMM(m.n_states, m.n_channels)
    params, _ = hmm.initialize(
        initial_probs=initial, transition_matrix=chain, emission_means=jnp.array(m.means),
        emission_covariances=jnp.array(m.covariances),
    )  # fmt: skip
    emission = hmm.emission_distribution(params, jnp.arange(m.n_states))
    regression = Regression(m, m.channels[:n_in], m.channels[n_in:])
    gains, offsets = jnp.array(regression.gains), jnp.array(regression.offsets)

    @jax.jit
    def tick(prior, xi, x):
        h, _ = _condition_on(prior, emission.log_prob(xi))
        return _predict(h, chain), jnp.einsum("k,ko->o", h, gains @ x + offsets)

    state = [initial]

    def call(xi, x):
        state[0], y = tick(state[0], xi, x)
        return np.asarray(y)

    return call


def pbdlib(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    """`online_forward_message`, and `condition` of its mixtures with those weights: its HMM's own starts a message anew."""
    hmm = checkout.model(m.initial, m.transition, m.means, m.covariances)
    condition = checkout.package().GMM.condition
    inputs, outputs = slice(0, n_in), slice(n_in, m.n_channels)
    return lambda xi, x: condition(hmm, x[None], inputs, outputs, h=hmm.online_forward_message(xi)[:, None])[0]


def gmr(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    """Its predict: mixture weights instead of a filter, so less work."""
    from gmr import GMM

    mixture = GMM(m.n_states, np.full(m.n_states, 1 / m.n_states), m.means, m.covariances)
    indices = np.arange(n_in)
    return lambda xi, x: mixture.predict(indices, x[None])


def numpy_twin(m: Hmm, n_in: int) -> Callable[[np.ndarray, np.ndarray], Any]:
    native, kernels.native = kernels.native, None
    try:
        return comanip(m, n_in)
    finally:
        kernels.native = native


PEERS = {
    "comanip": comanip, "comanip, numpy twin": numpy_twin, "JAX, hand-written": by_hand, "dynamax": dynamax, "pbdlib": pbdlib,
    "gmr": gmr,
}  # fmt: skip
AGREEING = ("comanip, numpy twin", "JAX, hand-written", "dynamax")


def measure(n_ticks: int = 20_000) -> list[dict[str, Any]]:
    rows = []
    for name, (d, f, k) in SIZES.items():
        m, n_in = model(d, f, k), d + f
        frames = hmm.sample(m, 2_000, np.random.default_rng(1)).frames
        ticks = [(xi.copy(), xi[:n_in].copy()) for xi in frames]
        calls = {}
        for peer, make in PEERS.items():
            try:
                calls[peer] = make(m, n_in)
            except ImportError:
                print(f"{peer} is absent", file=sys.stderr)
        answers = {p: np.array([np.ravel(call(*tick)).copy() for tick in ticks]) for p, call in calls.items() if p != "gmr"}
        agrees = {
            peer: np.isclose(found, answers["comanip"], rtol=1e-4, atol=1e-4).all(axis=1) for peer, found in answers.items()
        }
        for peer in AGREEING:
            if peer in agrees and not agrees[peer].all():
                at = int(np.argmin(agrees[peer]))
                raise AssertionError(f"{peer} answers {answers[peer][at]} at tick {at}, comanip {answers['comanip'][at]}")
        times: dict[str, list[float]] = {peer: [] for peer in calls}
        for start in range(0, n_ticks, len(ticks)):
            for peer, call in calls.items():
                for xi, x in ticks if peer not in ("gmr", "pbdlib") or start < 2_000 else []:
                    before = time.perf_counter()
                    call(xi, x)
                    times[peer].append(time.perf_counter() - before)
        us = {peer: (float(np.median(t)) * 1e6, float(np.quantile(t, 0.999)) * 1e6) for peer, t in times.items()}
        rows.append({"size": name, "us": us})
        if "pbdlib" in calls:
            calls["pbdlib"](*(1e6 + a for a in ticks[0]))
            finite = bool(np.isfinite(calls["pbdlib"](*ticks[0])).all())
            rows[-1] |= {"pbdlib_agrees": float(agrees["pbdlib"].mean()), "pbdlib_comes_back": finite}
        print(name, {n: (round(a, 2), round(b, 1)) for n, (a, b) in us.items()}, file=sys.stderr)
    return rows


if __name__ == "__main__":
    print(measure())
