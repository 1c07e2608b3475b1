"""1,024 roll-outs of a learned velocity law at once: million steps a second."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from comanip import kernels
from comanip.models.gmr import Regression
from comanip.models.rollout import roll_out
from machine import alternated, median, on_all_cores, stay_on_one_core
from online import model

N, T, DT = 1024, 200, 0.01


def dynamax(m: Any, start: np.ndarray, force: np.ndarray, single: bool = False) -> Any:
    """The same recursion in JAX: a scan over time, a vmap over roll-outs, compiled. float32 in and out, when `single`."""
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
    chain = array((1.0 - 1e-6) * m.transition + 1e-6 / m.n_states)

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

        return jax.lax.scan(step, (x0, array(m.initial)), forces)[1]

    all_of_them = jax.jit(jax.vmap(one))
    x0, f = array(start), array(force)
    return lambda: [np.asarray(a) for a in jax.block_until_ready(all_of_them(x0, f))]


def measure() -> dict[str, float]:
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

    work = {
        "comanip": lambda: roll_out(m, start, force, dt=DT),
        "comanip, 2 threads": on_all_cores(lambda: roll_out(m, start, force, dt=DT, n_threads=2)),
        "comanip, float32": lambda: roll_out(m, start, force, dt=DT, precision="float32"),
        "comanip, float32, 2 threads": on_all_cores(lambda: roll_out(m, start, force, dt=DT, n_threads=2, precision="float32")),
        "comanip, numpy twin": twin,
    }
    try:
        work |= {"dynamax": dynamax(m, start, force), "dynamax, float32": dynamax(m, start, force, single=True)}
    except ImportError:
        print("dynamax is absent", file=sys.stderr)
    ends = {peer: call()[0][:, 10] for peer, call in work.items()}
    for peer, end in ends.items():
        tolerance = 1e-4 if "float32" in peer else 1e-6
        if not np.allclose(end, ends["comanip"], rtol=tolerance, atol=tolerance):
            raise AssertionError(f"{peer} goes elsewhere")
    rates = {peer: N * T / median(t) / 1e6 for peer, t in alternated(work, 15).items()}
    print({n: round(v, 2) for n, v in rates.items()}, file=sys.stderr)
    return rates


if __name__ == "__main__":
    print(measure())
