"""What can be said about stability before anybody holds the object.

Per state the regression is a line, v = v_0 + A (x - mu_x) + b (F - mu_F), so two questions have plain answers:

contraction   does the state's velocity field pull neighbouring motions together? The largest eigenvalue of (A + A^T) / 2 must be
              negative: the condition that SEDS (Khansari-Zadeh and Billard 2011) puts on every state
loop gain     a partner of stiffness K and damping B answers motion by F = -(B + K / s) v, and the robot answers F by b, late:
              L(s) = b (B + K / s) e^(-s tau) / ((1 + s T)(1 + s / w_c)). Nyquist: |L| where its phase is -180 deg must be
              below 1. b < 0, force answered the wrong way, is unstable with any spring

The default law answers force by its own mass-damper, 1 / (M s + D) in place of b, whatever was learned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Array
from .gmr import Regression
from .hmm import Hmm

Complex = NDArray[np.complexfloating[Any, Any]]
Answer = Callable[[Complex], Complex]  # s (N,) -> velocity per newton, without the delays


class PartnerImpedance(NamedTuple):
    """Who might hold the other end, in small motions."""

    stiffness_n_per_m: float
    damping_ns_per_m: float


PARTNERS = (PartnerImpedance(60.0, 8.0), PartnerImpedance(200.0, 17.0), PartnerImpedance(600.0, 33.0))  # damping ratio about 0.4


class Delays(NamedTuple):
    """What lies between force and motion: dead time, the robot's lag, the force's low-pass."""

    dead_s: float = 0.03
    lag_s: float = 0.02
    cutoff_hz: float = 40.0


class Stability(NamedTuple):
    """One row a state.

    contraction   (K,) [1/s] largest eigenvalue of the symmetric part of dv/dx; negative contracts
    slope         (K,) [m/(s N)] smallest eigenvalue of the symmetric part of dv/dF; NaN without force
    loop_gain     (K, P) with each partner; below 1 is stable, infinite when force is answered the wrong way
    """

    contraction: Array
    slope: Array
    loop_gain: Array


def stability(model: Hmm, partners: Sequence[PartnerImpedance] = PARTNERS, delays: Delays = Delays()) -> Stability:
    """Contraction and loop gain of eq. (5), state by state, in closed loop with each partner."""
    regression = Regression(model, [c for c in model.channels if not c.startswith("velocity.")], "velocity")
    position = [i for i, c in enumerate(regression.inputs) if c.startswith("position.")]
    force = [i for i, c in enumerate(regression.inputs) if c.startswith("force.")]
    contraction = _extreme(regression.gains[:, :, position], largest=True)
    k = model.n_states
    if not force:
        return Stability(contraction, np.full(k, np.nan), np.zeros((k, len(partners))))
    gains = regression.gains[:, :, force]
    slope, steepest = _extreme(gains, largest=False), _extreme(gains, largest=True)
    rows = [
        [np.inf if low < 0.0 else _gain_at_crossover(_constant(high), p, delays) for p in partners]
        for low, high in zip(slope, steepest, strict=True)
    ]
    return Stability(contraction, slope, np.array(rows))


def compliance_gain(
    mass_kg: float,
    damping_ns_per_m: float,
    partners: Sequence[PartnerImpedance] = PARTNERS,
    delays: Delays = Delays(),
) -> Array:
    """(P,) loop gain of a mass-damper 1 / (M s + D) with each partner; below 1 is stable."""
    return np.array([_gain_at_crossover(lambda s: 1.0 / (mass_kg * s + damping_ns_per_m), p, delays) for p in partners])


def _extreme(matrices: Array, *, largest: bool) -> Array:
    """Largest or smallest eigenvalue of the symmetric part of each (K, d, d)."""
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrices + np.swapaxes(matrices, 1, 2)))
    return np.asarray(eigenvalues[:, -1 if largest else 0])


def _constant(slope: float) -> Answer:
    return lambda s: slope * np.ones_like(s)


def _gain_at_crossover(answer: Answer, partner: PartnerImpedance, delays: Delays) -> float:
    """Largest |L(j w)| where the phase of L crosses -180 deg; 0 where it never does."""
    w = np.geomspace(0.05, 400.0, 4000)
    s = 1j * w
    chain = np.exp(-s * delays.dead_s) / ((1.0 + s * delays.lag_s) * (1.0 + s / (2.0 * np.pi * delays.cutoff_hz)))
    loop = answer(s) * (partner.damping_ns_per_m + partner.stiffness_n_per_m / s) * chain
    phase = np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * np.round((phase[0] + 0.5 * np.pi) / (2.0 * np.pi))  # at w -> 0 a spring turns by -90 to -180 deg
    crossings = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    return float(np.abs(loop[crossings]).max()) if len(crossings) else 0.0


def warnings_of(found: Stability, law: str, compliance: tuple[float, float]) -> list[str]:
    """What a teacher should know before anybody holds the other end, one line each; nothing where all is well.

    compliance   virtual mass [kg] of the default law, and the damping [N s/m] that it has when it shakes
    """
    if law != "paper":
        gains = zip(PARTNERS, compliance_gain(*compliance), strict=True)
        return [
            f"with a partner of {p.stiffness_n_per_m:g} N/m the compliance has a loop gain of {gain:.2g} and will oscillate "
            "(below 1 is stable): raise moving_damping_ns_per_m or shake_damping_ns_per_m_per_n"
            for p, gain in gains
            if gain >= 1.0
        ]
    told = []
    if wrong := np.flatnonzero(found.slope < 0.0).tolist():
        told.append(
            f"{_states(wrong)}: more force means less speed (in these lessons force was an effect of motion); with a living "
            "partner that is positive feedback: use the default law"
        )
    if tight := np.flatnonzero((found.slope >= 0.0) & (found.loop_gain.max(axis=1) >= 1.0)).tolist():
        told.append(
            f"{_states(tight)}: loop gain {found.loop_gain[tight].max():.2g} with a partner of "
            f"{PARTNERS[-1].stiffness_n_per_m:g} N/m: the two will oscillate (below 1 is stable)"
        )
    if spread := np.flatnonzero(found.contraction > 0.0).tolist():
        told.append(f"{_states(spread)}: the velocity field does not contract, so a deviation grows by itself")
    return told


def _states(which: list[int]) -> str:
    return f"state{'s' if len(which) > 1 else ''} {', '.join(map(str, which))}"
