"""1,024 roll-outs of a learned velocity law at once: million steps a second."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import checkout
from comanip import kernels
from comanip.models.gmr import Regression
from comanip.models.rollout import RollOuts, roll_out
from machine import alternated, median, on_all_cores, stay_on_one_core
from online import model

N, T, DT = 1024, 200, 0.01


def floored(p: np.ndarray) -> np.ndarray:
    """The transition floor of `roll_out`, for a chain or for where it starts."""
    return (1.0 - 1e-6) * p + 1e-6 / p.shape[-1]


def by_hand(m: Any, start: np.ndarray, force: np.ndarray, single: bool = False) -> Any:
    """Our recursion in JAX: a scan over time, a vmap over roll-outs, compiled. float32 in and out, when `single`."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    def array(a: Any) -> Any:
        return jnp.array(a, dtype=jnp.float32 if single else jnp.float64)

    inputs = [c for c in m.channels if not c.startswith("velocity")]
    regression = Regression(m, inputs, "velocity")
    i = regression.input_index
    factor = array(np.linalg.inv(np.linalg.cholesky(m.covariances[:, i[:, None], i[None, :]])))
    log_peak = jnp.log(jnp.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    means, gains, offsets = array(m.means[:, i]), array(regression.gains), array(regression.offsets)
    initial, chain = array(floored(m.initial)), array(floored(m.transition))

    def one(x0, forces):
        def step(carry, f):
            x, prior = carry
            xi = jnp.concatenate([x, f])
            z = jnp.einsum("kij,kj->ki", factor, xi - means)
            log_b = log_peak - 0.5 * (z**2).sum(axis=1)
            h = prior * jnp.exp(jnp.maximum(log_b - log_b.max(), -20.0))
            h = h / h.sum()
            v = jnp.einsum("k,ko->o", h, gains @ xi + offsets)
            return (x + DT * v, h @ chain), (x, v)

        return jax.lax.scan(step, (x0, initial), forces)[1]

    all_of_them = jax.jit(jax.vmap(one))
    x0, f = array(start), array(force)
    return lambda: [np.asarray(a) for a in jax.block_until_ready(all_of_them(x0, f))]


def dynamax(m: Any, start: np.ndarray, force: np.ndarray, single: bool = False) -> Any:
    """dynamax's own parts in a scan under a vmap: its emission distribution, made once, and the two steps of its filter.

    It has no gate; `measure` sees that none acts.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from dynamax.hidden_markov_model import GaussianHMM
    from dynamax.hidden_markov_model.inference import _condition_on, _predict

    def array(a: Any) -> Any:
        return jnp.array(a, dtype=jnp.float32 if single else jnp.float64)

    regression = Regression(m, [c for c in m.channels if not c.startswith("velocity")], "velocity")
    i = regression.input_index
    initial, chain = array(floored(m.initial)), array(floored(m.transition))
    hmm = GaussianHMM(m.n_states, len(i))
    params, _ = hmm.initialize(
        initial_probs=initial, transition_matrix=chain, emission_means=array(m.means[:, i]),
        emission_covariances=array(m.covariances[:, i[:, None], i[None, :]]),
    )  # fmt: skip
    emission = hmm.emission_distribution(params, jnp.arange(m.n_states))
    gains, offsets = array(regression.gains), array(regression.offsets)

    def one(x0, forces):
        def step(carry, f):
            x, prior = carry
            xi = jnp.concatenate([x, f])
            h, _ = _condition_on(prior, emission.log_prob(xi))
            v = jnp.einsum("k,ko->o", h, gains @ xi + offsets)
            return (x + DT * v, _predict(h, chain)), (x, v)

        return jax.lax.scan(step, (x0, initial), forces)[1]

    all_of_them = jax.jit(jax.vmap(one))
    x0, f = array(start), array(force)
    return lambda: [np.asarray(a) for a in jax.block_until_ready(all_of_them(x0, f))]


def pbdlib(m: Any, start: np.ndarray, force: np.ndarray) -> Any:
    """All roll-outs side by side, one step of time after another: `obs_likelihood` of the inputs, `condition` of its mixtures.

    Its on-line message holds one sequence, so the one line of it is repeated here for all of them.
    """
    hmm = checkout.model(m.initial, m.transition, m.means, m.covariances)
    condition = checkout.package().GMM.condition
    d, n_in = start.shape[1], start.shape[1] + force.shape[2]
    inputs, outputs = slice(0, n_in), slice(n_in, n_in + d)
    initial, chain = floored(m.initial), floored(m.transition)

    def roll() -> Any:
        position, velocity = np.empty((N, T, d)), np.empty((N, T, d))
        x, prior = start, np.tile(initial[:, None], (1, N))
        for t in range(T):
            frame = np.hstack([x, force[:, t]])
            h = prior * hmm.obs_likelihood(frame, marginal=inputs)[0]
            h /= h.sum(axis=0)
            v = condition(hmm, frame, inputs, outputs, h=h)[0]
            position[:, t], velocity[:, t] = x, v
            x, prior = x + DT * v, chain.T @ h
        return position, velocity

    return roll


def measure() -> dict[str, Any]:
    """Million steps a second of each, how far the gate moves any roll-out, and the share of pbdlib's that go where ours do."""
    stay_on_one_core()
    rng = np.random.default_rng(0)
    m = model(2, 3, 10)
    start, force = rng.normal(size=(N, 2)), rng.normal(size=(N, T, 3))

    def twin() -> Any:
        native, kernels.native = kernels.native, None
        try:
            return roll_out(m, start, force, dt=DT)
        finally:
            kernels.native = native

    def ours(**options: Any) -> Any:
        out = RollOuts(np.empty((N, T, 2)), np.empty((N, T, 2)))
        return lambda: roll_out(m, start, force, dt=DT, out=out, **options)

    work = {
        "comanip": ours(),
        "comanip, 2 threads": on_all_cores(ours(n_threads=2)),
        "comanip, float32": ours(precision="float32"),
        "comanip, float32, 2 threads": on_all_cores(ours(precision="float32", n_threads=2)),
        "comanip, fresh memory each time": lambda: roll_out(m, start, force, dt=DT),
        "comanip, numpy twin": twin,
    }
    peers = {
        "JAX, hand-written": by_hand,
        "JAX, hand-written, float32": lambda *a: by_hand(*a, single=True),
        "dynamax": dynamax,
        "dynamax, float32": lambda *a: dynamax(*a, single=True),
        "pbdlib": pbdlib,
    }
    for peer, make in peers.items():
        try:
            work[peer] = make(m, start, force)
        except ImportError:
            print(f"{peer} is absent", file=sys.stderr)
    paths = {peer: call()[0] for peer, call in work.items()}
    ends = {peer: path[:, 10] for peer, path in paths.items()}
    for peer, end in ends.items():
        if peer == "pbdlib":
            continue
        tolerance = 1e-4 if "float32" in peer else 1e-6
        if not np.allclose(end, ends["comanip"], rtol=tolerance, atol=tolerance):
            raise AssertionError(f"{peer} goes elsewhere")
    gate_m = float(np.abs(roll_out(m, start, force, dt=DT, gate=np.inf).position - paths["comanip"]).max())
    if gate_m > 1e-6:
        raise AssertionError(f"the gate moves a roll-out by {gate_m:.1e} m: those without one do other work")
    rates = {peer: N * T / median(t) / 1e6 for peer, t in alternated(work, 9).items()}
    found: dict[str, Any] = {"rates": rates, "gate_m": gate_m}
    if "pbdlib" in paths:
        found["pbdlib_agrees"] = float(np.isclose(paths["pbdlib"], paths["comanip"], atol=1e-6).all(axis=(1, 2)).mean())
    print({n: round(v, 2) for n, v in rates.items()}, file=sys.stderr)
    return found


if __name__ == "__main__":
    print(measure())
