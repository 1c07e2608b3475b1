"""What must be true before a robot moves: measured on the resting arm, while nothing is commanded.

    samples, rates, lateness -> at rest -> sensor alive and steady -> tare, bias and payload -> place and walls -> envelope

A check that fails says what was found, what is allowed and what to try, in one line. Good engineering, not a certified function.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError
from ..interaction import CausalInteractionForce, Payload, identify_payload, mean_and_error
from ..interfaces import Array, Observation, Plant
from ..loop import Clock
from ..safety.limits import Limits
from .settings import Settings

REST_M_PER_S = 0.02
REST_M = 0.005
STALE_TICKS, STALE_S = 5.0, 0.050  # the envelope's: samples older than this are a HOLD
LATE_SHARE = 0.01  # of the ticks may be late by a period
PULLED_N = 3.0  # across gravity: more is a sensor that was not tared, or somebody who pulls
OTHER_N = 4.0  # between the weight that is stated and the one that is felt
DRIFT_N = 1.0  # between the first and the second half
SLOWEST_M_PER_S = 0.05  # a hand that may not even do this does nothing
LEAST_TICKS = 20


class Check(NamedTuple):
    """One line of the pre-flight."""

    name: str
    passed: bool
    said: str


@dataclass(frozen=True, eq=False)
class Measured:
    """What the plant said over some seconds at rest: (T,) or (T, d) a tick, NaN where nothing came.

    late    (T,) how late each tick was [s]; rates: of each signal (a second, longest gap [s]), where the plant knows them
    """

    time: Array
    force_time: Array
    position: Array
    velocity: Array
    force: Array
    late: Array
    rates: dict[str, tuple[float, float]]


def measured(plant: Plant, seconds: float, clock: Clock) -> Measured:
    """Reads for so long, and never writes."""
    ticks, d = max(LEAST_TICKS, round(seconds / plant.dt)), len(plant.axes)
    obs, rows, late = Observation(d), np.full((ticks, 2 + 3 * d), np.nan), np.zeros(ticks)
    rates = getattr(plant, "rates", None)
    plant.reset()
    if rates is not None:
        rates()
    clock.start(plant.dt)
    for n in range(ticks):
        plant.read(obs)
        rows[n, 0], rows[n, 1] = obs.time, obs.force_time
        rows[n, 2:] = np.concatenate([obs.position, obs.velocity, obs.sensor_force])
        plant.advance()
        late[n] = clock.wait()
    x, v, f = (rows[:, 2 + i * d : 2 + (i + 1) * d] for i in range(3))
    return Measured(rows[:, 0], rows[:, 1], x, v, f, late, rates() if rates is not None else {})


def checks(
    found: Measured,
    *,
    settings: Settings,
    axes: Sequence[str],
    gravity: Array,
    dt: float,
    limits: Limits,
    learned: Sequence[Any],
) -> tuple[list[Check], Payload]:
    """Every check, and the payload (mass and bias) that was weighed."""
    lines = [*_signals(found, settings, dt, limits), _late(found, dt, limits)]
    if not lines[0].passed:
        return lines, Payload(0.0)
    lines += [_rest(found), _alive(found, axes), _steady(found)]
    payload, weighed = weigh(found, settings, gravity)
    lines += [*weighed, *_place(found, axes, limits, learned)]
    return lines, payload


def _signals(found: Measured, settings: Settings, dt: float, limits: Limits) -> list[Check]:
    """Samples are there, finite, and come often enough."""
    stale = limits.stale_s or max(STALE_S, STALE_TICKS * dt)
    lines = []
    for what, values in (("position", found.position), ("velocity", found.velocity), ("force", found.force)):
        share = float(np.isfinite(values).all(axis=1).mean())
        slow = what == "force" and share > 0.0  # a sensor slower than the ticks may say nothing between its samples
        if share < 1.0 and not slow:
            return [Check("samples", False, f"{what} is missing in {1.0 - share:.0%} of the ticks: is its topic published?")]
    lines.append(Check("samples", True, f"position, velocity and force for {len(found.late) * dt:.3g} s"))
    stamps = np.where(np.isfinite(found.force_time), found.force_time, found.time)
    heard = {"pose": seen(found.time), "wrench": seen(stamps[np.isfinite(found.force).all(axis=1)])} | found.rates
    for name, least in (("pose", settings.pose_hz), ("wrench", settings.wrench_hz)):
        rate, gap = heard[name]
        ok = rate >= least and gap <= stale
        asked = f"{least:g} a second, " if least else ""
        needs = "" if ok else f"; needs {asked}no gap above {1e3 * stale:.0f} ms: a faster publisher, or a cable"
        lines.append(Check(f"{name} rate", ok, f"{rate:.0f} samples a second, longest gap {1e3 * gap:.0f} ms{needs}"))
    return lines


def seen(stamps: Array) -> tuple[float, float]:
    """(samples a second, longest gap [s]) of stamps as ticks saw them: one that stands still is the same sample."""
    new = stamps[np.concatenate([[True], np.diff(stamps) > 0.0])] if len(stamps) else stamps
    if len(new) < 2:
        return 0.0, np.inf
    return float((len(new) - 1) / (new[-1] - new[0])), float(np.diff(new).max())


def _late(found: Measured, dt: float, limits: Limits) -> Check:
    allowed = limits.late_s or max(0.030, 3.0 * dt)
    often, most = float((found.late > dt).mean()), float(found.late.max())
    ok = most + dt <= allowed and often <= LATE_SHARE
    median, nearly = 1e3 * np.percentile(found.late, (50, 99))
    said = f"median {median:.2f} ms, 99 % {nearly:.2f} ms, most {1e3 * most:.1f} ms"
    needs = "" if ok else f"; a period may last {1e3 * allowed:.0f} ms: end other programs, or lower rate_hz"
    return Check("lateness", ok, said + needs)


def _rest(found: Measured) -> Check:
    speed = float(np.nanmax(np.linalg.norm(found.velocity, axis=1)))
    moved = float(np.linalg.norm(np.ptp(found.position, axis=0)))
    ok = speed <= REST_M_PER_S and moved <= REST_M
    needs = "" if ok else f"; allowed {REST_M_PER_S:g} m/s and {1e3 * REST_M:g} mm: let arm and object rest"
    return Check("at rest", ok, f"moved {1e3 * moved:.1f} mm, at most {speed:.3f} m/s{needs}")


def _alive(found: Measured, axes: Sequence[str]) -> Check:
    force = found.force[np.isfinite(found.force).all(axis=1)]
    still = [name for name, column in zip(axes, force.T, strict=True) if np.ptp(column) == 0.0]
    if still:
        return Check("sensor", False, f"force {', '.join(still)} said {force[0].tolist()} N bit for bit all the time: is it on?")
    return Check("sensor", True, f"noise {float(np.linalg.norm(force.std(axis=0))):.2f} N")


def _steady(found: Measured) -> Check:
    force = found.force[np.isfinite(found.force).all(axis=1)]
    half = len(force) // 2
    drift = float(np.linalg.norm(force[:half].mean(axis=0) - force[half:].mean(axis=0)))
    ok = drift <= DRIFT_N
    return Check("steady", ok, f"{drift:.2f} N between both halves" + ("" if ok else f"; allowed {DRIFT_N:g} N: hold it still"))


def weigh(found: Measured, settings: Settings, gravity: Array) -> tuple[Payload, list[Check]]:
    """Mass and bias from F_s at rest, both holding; the mass that is stated is believed, and held against what is felt."""
    force, share = found.force[np.isfinite(found.force).all(axis=1)], settings.share
    mean, error = mean_and_error(force)
    g2 = float(gravity @ gravity)
    if g2 == 0.0 or share == 0.0:
        payload = Payload(settings.mass_kg or 0.0, 0.0, tuple(mean.tolist()), tuple(error.tolist()))
        return payload, [_tare(mean)]
    along = float(mean @ gravity) / (share * g2)  # [kg] of the whole object
    across = mean - gravity * float(mean @ gravity) / g2
    if settings.mass_kg is not None:
        payload = identify_payload(force, gravity=gravity, load_share=share, mass_kg=settings.mass_kg)
        off = abs(along - settings.mass_kg) * share * g2**0.5
        ok = off <= OTHER_N
        said = f"feels {along:.2f} kg, payload.mass_kg says {settings.mass_kg:g}"
        needs = "" if ok else f": {off:.1f} N apart, allowed {OTHER_N:g} N: another object, or not tared while empty"
        return payload, [Check("payload", ok, said + needs), _tare(across)]
    if along < 0.0:
        said = f"weighs {along:.2f} kg: F_s must be the force of the object on the hand: turn force_sign, or it was not tared"
        return Payload(0.0), [Check("payload", False, said), _tare(across)]
    kept = Payload(along, float(np.linalg.norm(error)) / (share * g2**0.5), tuple(across.tolist()), tuple(error.tolist()))
    return kept, [
        Check("payload", True, f"{along:.2f} +- {kept.mass_std_kg:.2f} kg (a bias along gravity counts as weight)"),
        _tare(across),
    ]


def _tare(bias: Array) -> Check:
    size = float(np.linalg.norm(bias))
    ok = size <= PULLED_N
    needs = "" if ok else f"; allowed {PULLED_N:g} N: let nobody pull, or not tared while empty"
    return Check("tare", ok, f"bias {size:.2f} N, taken out{needs}")


def _place(found: Measured, axes: Sequence[str], limits: Limits, learned: Sequence[Any]) -> list[Check]:
    at = found.position[-1]
    assert limits.workspace_m is not None
    lines = []
    for name, x, (low, high) in zip(axes, at.tolist(), limits.workspace_m, strict=True):
        if not low <= x <= high:
            lines.append(Check("walls", False, f"{name} is {x:.3f} m; this arm and the lessons allow {low:.3f} to {high:.3f} m"))
    if not lines:
        room = ", ".join(f"{n} {low:.2f} to {high:.2f} m" for n, (low, high) in zip(axes, limits.workspace_m, strict=True))
        lines.append(Check("walls", True, f"{room}; the hand is at {', '.join(f'{x:.3f}' for x in at)} m"))
    tops = f"{limits.v_max_m_per_s:.3g} m/s, {limits.force_limit_n:g} N, {limits.energy_j:.3g} J"
    tops += f", brakes at {limits.a_max_m_per_s2:g} m/s^2"
    return [*lines, _envelope(limits, tops)]


def _envelope(limits: Limits, tops: str) -> Check:
    """It is on, and leaves a speed: what can be braked within its energy, were a period as long as it may be."""
    late, brake = limits.late_s or 0.0, limits.a_max_m_per_s2
    speed = (2.0 * brake * limits.energy_j / limits.force_limit_n) ** 0.5 - 0.5 * brake * late
    if speed < SLOWEST_M_PER_S:
        said = f"on, and allows {max(speed, 0.0):.2g} m/s: periods of {1e3 * late:g} ms cannot be braked; lower rates.late_s"
        return Check("envelope", False, said)
    return Check("envelope", True, f"on: {tops}")


def estimator(
    payload: Payload, *, settings: Settings, gravity: Array, dt: float, delay_s: float, wrench_hz: float = 0.0
) -> CausalInteractionForce:
    """Eq. (3) with what the pre-flight weighed."""
    period = 1.0 / wrench_hz if isfinite(wrench_hz) and 0.0 < wrench_hz < 0.9 / dt else 0.0
    return CausalInteractionForce(
        dt,
        mass_kg=payload.mass_kg,
        gravity=gravity.tolist(),
        load_share=settings.share,
        bias=payload.force_bias_n,
        cutoff_hz=min(settings.cutoff_hz, 0.4 / dt),
        force_delay_s=delay_s,
        sensor_period_s=period,
    )


def require(lines: Sequence[Check], source: str) -> None:
    """ParameterError with the first check that failed."""
    for one in lines:
        if not one.passed:
            more = sum(not other.passed for other in lines) - 1
            others = f" (and {more} more)" if more else ""
            raise ParameterError(f"{source}: pre-flight: {one.name}: {one.said}{others}")
