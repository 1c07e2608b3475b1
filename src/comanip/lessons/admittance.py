"""Does a mass, a damper and a spring explain a recording? F = M a + D v + K x - K x0 on each axis, from the motion itself.

A robot under admittance control moves exactly so; then the recording is of the robot's law, and nothing in it says how a person
answers. With all signs turned it is the partner who answers like that to a hand that leads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..recording import axis_units
from ..signals.filters import MAX_CUTOFF, differentiate, smooth
from ..signals.links import Link, linked, of_each_axis
from .demonstration import DERIVED, Demonstration
from .faults import noise_gain, white_noise

REACH_S = 0.2  # offsets beyond this are another fault: two recordings, or a clock that was never set
EXPLAINED = 0.9  # R² from which a law explains a recording
RATE_PER_CUTOFF = 12.0  # frames a period of the cutoff: more say nothing new
TERMS: Mapping[str, tuple[str, ...]] = {"M": ("M",), "D": ("D",), "K": ("K",), "M D": ("M", "D"), "D K": ("D", "K"),
                                        "M K": ("M", "K"), "M D K": ("M", "D", "K")}  # fmt: skip
LEAST_UNEXPLAINED = 1e-4  # of the variance: less is how a derivative was taken, and no term of a law
# By how much of BIC (150 to 1) another law must explain more once force is shifted: M a + D v looks like D v(t + M / D).
EVIDENCE = 10.0
SMALL_S = 0.01  # an offset below this bends no law, and needs no such evidence
HIDDEN = 3.0  # times the estimated noise: its estimate, from second differences, is that rough
SURE_S = 0.02  # an offset with a larger standard error is not known


class Term(NamedTuple):
    value: float
    error: float

    @property
    def sure(self) -> bool:
        """Beyond three standard errors from zero."""
        return abs(self.value) > 3.0 * self.error


class Admittance(NamedTuple):
    """What explains the force best, by axis.

    terms        "M D", ...: which terms it takes; more are not borne out by the data
    inertia, damping, stiffness  by axis, SI; None where the law does without
    bias         by axis [N, N m]: the force that this law leaves at rest at x = 0; with a spring that is bias and rest position
                 together, which nothing can tell apart
    offset       how much later force is stamped than motion [s]; nan where the motion does not show it
    r2           over all axes; r2_by_axis
    residual_n   (T, d) force that the law does not explain, and its RMS by axis
    noise_share  by axis: how much of the acceleration is the sensor's noise; M comes out too small by about that share
    """

    terms: str
    inertia: tuple[Term, ...] | None
    damping: tuple[Term, ...] | None
    stiffness: tuple[Term, ...] | None
    bias: tuple[Term, ...]
    offset: Term
    r2: float
    r2_by_axis: tuple[float, ...]
    residual: Array
    residual_rms: tuple[float, ...]
    noise_share: tuple[float, ...]

    @property
    def explains(self) -> bool:
        return self.r2 >= EXPLAINED

    @property
    def of_the_partner(self) -> bool:
        """Whether all sure terms are negative: the partner answers a hand that leads."""
        sure = [t.value for group in (self.inertia, self.damping, self.stiffness) if group for t in group if t.sure]
        return bool(sure) and max(sure) < 0.0

    @property
    def offset_known(self) -> bool:
        """Whether the law explains enough, and sharply enough, to say which clock is late."""
        return self.r2 >= EXPLAINED and self.offset.error <= SURE_S and abs(self.offset.value) < 0.98 * REACH_S


def admittance(lesson: Demonstration, *, cutoff_hz: float = 10.0, offsets: bool = True) -> Admittance:
    """The simplest of M, D, K and their sums that explains the lesson's force; simplest by BIC over independent samples.

    All signals pass one zero-phase low-pass first. ParameterError where the lesson is too short, or has no force.
    """
    cutoff = min(cutoff_hz, 0.8 * MAX_CUTOFF / lesson.dt)
    signals, dt = _prepared(lesson, cutoff)
    if not np.ptp(lesson.force, axis=0).any():
        raise ParameterError(f"{lesson.name}: the force never changes: nothing to explain")
    if len(signals["F"]) * dt < 2.5 * REACH_S:
        least = 2.5 * REACH_S
        raise ParameterError(f"{lesson.name}: {lesson.duration_s:.2g} s are too short to identify anything; needs >= {least:g} s")
    noise_share = _noise_share(lesson, cutoff)
    steady = _simplest(signals, dt, cutoff, offsets=False)
    late = _simplest(signals, dt, cutoff, offsets=True) if offsets else steady
    if offsets and not _as_a_mass(late, steady, signals, noise_share):
        if late.name != steady.name and late.cost > steady.cost - EVIDENCE:
            late = _fitted(signals, steady.name, dt, cutoff, offsets=True)
        found = _told(late.name, late.link, signals, noise_share)
        shows = late.cost < steady.cost - EVIDENCE or abs(found.offset.value) < SMALL_S
        if found.offset_known and shows:  # an offset that is not known would only bend the law
            return found
    return _told(steady.name, steady.link, signals, noise_share)


class _Fit(NamedTuple):
    name: str
    link: Link
    cost: float


def _simplest(signals: Mapping[str, Array], dt: float, cutoff: float, offsets: bool) -> _Fit:
    fits = (_fitted(signals, name, dt, cutoff, offsets, errors=False) for name in TERMS)
    return _fitted(signals, min(fits, key=lambda fit: fit.cost).name, dt, cutoff, offsets)


def _fitted(signals: Mapping[str, Array], name: str, dt: float, cutoff: float, offsets: bool, *, errors: bool = True) -> _Fit:
    """The law with these terms, and its BIC; an offset costs as much as a term."""
    independent = max(8.0, len(signals["F"]) * dt * cutoff)
    link = _linked(signals, TERMS[name], dt, offsets, errors=errors)
    cost = independent * math.log(max(1.0 - link.r2, LEAST_UNEXPLAINED))
    return _Fit(name, link, cost + (len(TERMS[name]) + 1 + offsets) * math.log(independent))


def _as_a_mass(late: _Fit, steady: _Fit, signals: Mapping[str, Array], noise_share: tuple[float, ...]) -> bool:
    """Whether a force that comes early may be that of a mass, M = -D offset, seen through the noise of the acceleration: where
    the law without an offset leaves no more than this noise hides, nothing tells one from the other."""
    if late.link.offset_s >= 0.0 or "D" not in late.name.split():
        return False
    terms, d = TERMS[late.name], signals["F"].shape[1]
    damping = late.link.values.reshape(d, len(terms) + 1)[:, terms.index("D")]
    hidden = (damping * late.link.offset_s) ** 2 * np.array(noise_share) * signals["M"].var(axis=0)
    return HIDDEN * float(hidden.sum()) > (late.link.r2 - steady.link.r2) * float(signals["F"].var(axis=0).sum())


def _prepared(lesson: Demonstration, cutoff: float) -> tuple[dict[str, Array], float]:
    """Low-passed M, D, K columns and F, thinned to what the cutoff leaves."""

    def passed(values: Array) -> Array:  # a velocity that was derived passed the low-pass once already: so does all else
        return smooth(smooth(values, lesson.dt, cutoff) if _derived(lesson) else values, lesson.dt, cutoff)

    v = smooth(lesson.velocity, lesson.dt, cutoff)
    signals = {"M": differentiate(v, lesson.dt), "D": v, "K": passed(lesson.position), "F": passed(lesson.force)}
    step = max(1, int(1.0 / (lesson.dt * cutoff * RATE_PER_CUTOFF)))
    return {n: values[::step] for n, values in signals.items()}, lesson.dt * step


def _linked(signals: Mapping[str, Array], terms: tuple[str, ...], dt: float, offsets: bool, *, errors: bool = True) -> Link:
    columns = of_each_axis([*(signals[t] for t in terms), np.ones_like(signals["F"])])
    return linked(columns, signals["F"], dt, reach_s=REACH_S if offsets else 0.0, errors=errors)


def _told(name: str, link: Link, signals: Mapping[str, Array], noise_share: tuple[float, ...]) -> Admittance:
    terms, d = TERMS[name], signals["F"].shape[1]
    values, errors = (x.reshape(d, len(terms) + 1) for x in (link.values, link.errors))

    def of(term: str) -> tuple[Term, ...] | None:
        if term not in terms:
            return None
        k = terms.index(term)
        return tuple(Term(float(v), float(e)) for v, e in zip(values[:, k], errors[:, k], strict=True))

    rest = link.residual[slice(*link.inside)]
    force = signals["F"][slice(*link.inside)]
    spread = ((force - force.mean(axis=0)) ** 2).sum(axis=0)
    by_axis = tuple(float(1.0 - r / s) if s > 0.0 else math.nan for r, s in zip((rest**2).sum(axis=0), spread, strict=True))
    return Admittance(
        name, of("M"), of("D"), of("K"),
        tuple(Term(float(v), float(e)) for v, e in zip(values[:, -1], errors[:, -1], strict=True)),
        Term(link.offset_s, link.offset_error_s), link.r2, by_axis, link.residual,
        tuple(np.sqrt((rest**2).mean(axis=0)).tolist()), noise_share,
    )  # fmt: skip


def _noise_share(lesson: Demonstration, cutoff: float) -> tuple[float, ...]:
    """By axis, of the low-passed acceleration's variance."""
    acceleration = differentiate(smooth(lesson.velocity, lesson.dt, cutoff), lesson.dt)
    if _derived(lesson):
        noise = white_noise(lesson.position) * _twice_derived(len(lesson), lesson.dt, cutoff)
    else:
        noise = white_noise(lesson.velocity) * noise_gain(len(lesson), lesson.dt, cutoff, slope=True)
    variance = (acceleration**2).mean(axis=0)
    return tuple(float(min(1.0, n**2 / v)) if v > 0.0 else 0.0 for n, v in zip(noise, variance, strict=True))


def _derived(lesson: Demonstration) -> bool:
    return any(note.startswith(DERIVED) for note in lesson.notes)


def _twice_derived(frames: int, dt: float, cutoff: float) -> float:
    """RMS of unit white noise of a position behind two low-passes and two derivatives."""
    impulse = np.zeros(min(frames, max(64, math.ceil(16.0 / (cutoff * dt)))))
    impulse[len(impulse) // 2] = 1.0
    slope = differentiate(smooth(impulse, dt, cutoff), dt)
    return float(np.sqrt((differentiate(smooth(slope, dt, cutoff), dt) ** 2).sum()))


def units_of(lesson: Demonstration, term: str) -> tuple[str, ...]:
    """The SI unit of a term on each axis."""
    d = len(lesson.axes)
    per = {"M": " s²", "D": " s", "K": ""}[term]
    force, place = axis_units(lesson.units.get("force", "N"), d), axis_units(lesson.units.get("position", "m"), d)
    return tuple(
        {"N s²/m": "kg", "N m s²/rad": "kg m²"}.get(text, text)
        for text in (f"{f}{per}/{p}" for f, p in zip(force, place, strict=True))
    )
