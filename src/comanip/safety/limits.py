"""The numbers of the envelope, and those that follow from what was taught."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan
from typing import Any

import numpy as np

from ..errors import ParameterError

ISO_SLOW_M_PER_S = 0.25  # reduced speed of ISO 10218-1 with a person in reach: Limits(v_max_m_per_s=ISO_SLOW_M_PER_S)
SPEED_MARGIN = 1.6  # the fastest partners whom a skill met in trials moved 1.5 times as fast as the fastest lesson
LED_N = 6.0  # what leads a hand under the default law, which yields to all that lasts; or, where that is more,
LED_SHARE = 1.0  # of what led a teacher: strokes are led with more
BESIDE_M = 0.25  # from here a leader moves over to what was taught, 0.3 m with the margin of the walls
WALL_MARGIN_M = 0.05  # beyond the learned workspace: who starts a little beside it is not refused


@dataclass(frozen=True)
class Limits:
    """Numbers of the envelope. Speed, force and energy are of vectors: they do not depend on how the axes are turned."""

    v_max_m_per_s: float = 0.8
    a_max_m_per_s2: float = 10.0
    force_limit_n: float = 60.0
    workspace_m: tuple[tuple[float, float], ...] | None = None  # (lowest, highest) of each axis, may be infinite; None: as taught
    begins_beside_m: float | None = None  # so far outside of it may the arm begin, and then that place belongs to it
    energy_j: float = 3.0  # E_0 = E_max: what the robot may give in one task; only the person or re-arming refills it
    comply_damping_ns_per_m: float = 150.0  # more than 50 ms of delay times the 2.4 kN/m of wall, object and wrist
    fade_s: float = 0.5  # from COMPLY back to RUN; the other way is at once
    late_s: float | None = None  # T, longest period allowed; None: 3 periods, at least 30 ms
    stale_s: float | None = None  # age of a sample to coast on; None: 5 periods, at least 50 ms
    stuck_s: float = 0.2  # the same force reading, bit by bit, of a sensor that never repeats itself
    stuck_m: float = 0.25  # the same of any other: one with coarse steps or a dead band rightly repeats itself for so far
    moving_m_per_s: float = 0.01
    position_jump_m: float = 0.02  # beyond what 2 v_max explains
    drift_m: float = 0.05  # between where the hand was sent and where it is
    rest_m_per_s: float = 0.02  # measured speed up to which re-arming counts as at rest
    pull_n: float = 3.0  # above this somebody pulls: no re-arming, and what stopped the hand has not passed
    blocked_n: float = 20.0  # against the motion
    blocked_s: float = 0.03  # sooner by as much as it is more: a hand at 0.5 m/s presses 12 N more into a wall with every 10 ms
    impact_s: float = 0.2  # so long after, the force may pass its limit while it gives way: a HOLD would keep pressing
    impact_n: float = 180.0
    load_n: float = 22.0  # the hand's share of the object, 4.5 kg for two: beyond it the default law shakes with many people
    alone_n: float = 2.2  # within this, and a third of its share, of carrying the whole object alone, the partner's end is free
    alone_s: float = 0.15
    steady_n_s: float = 8.0  # and the pull changes no faster, as it does where somebody, or a wall, answers the hand's motion
    stands_m_per_s: float = 0.06
    feel_s: float = 0.25  # a hand that stands gives way so long first: a wall lets it, and is then no more felt
    sink_m: float = 0.022  # so far down at most while the partner carries less than most of a fair share
    pushed_n: float = 10.0  # nobody leads with more than this for long; under a law that yields, `LED_N`:
    pushed_j: float = 0.25  # so much work beyond it is a sensor that lies, or a weight
    let_go_n: float = 0.3  # less than this is nobody, where the object weighs nothing along the axes
    let_go_s: float = 0.4
    held_n: float = 2.0  # more than this, in this motion, was somebody
    let_go_m_per_s: float = 0.08
    passed_s: float = 0.5  # what stopped the hand is over for so long: it offers to go on
    offer_s: float = 2.0  # over which it then comes back to full speed where it was blocked,
    offer_n: float = 2.0  # unless it is still in the way
    shake_n: float = 6.0  # amplitude above 1 Hz from which shaking is said
    tare_n: float = 1.5  # mean force at rest from which tare is doubted
    jump_n: float = 0.8  # and 6 times the usual change: from one sample to the next, at rest for `jump_rest_s`, and
    jump_rest_s: float = 0.3
    jump_stays_s: float = 0.05  # still there so long after

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name == "workspace_m":
                if value is not None:
                    walls = tuple((float(low), float(high)) for low, high in value)
                    object.__setattr__(self, name, walls)
                    if not all(low < high and not isnan(high - low) for low, high in walls):
                        raise ParameterError(f"workspace_m needs lowest < highest on each axis; got {walls}")
            elif value is not None and not (value > 0 and isfinite(value)):
                raise ParameterError(f"{name} must be positive and finite; got {value}")


def taught_walls(learned: Any) -> tuple[tuple[float, float], ...]:
    """The walls of a LearnedSkill: its workspace, `WALL_MARGIN_M` farther out."""
    return tuple((float(low) - WALL_MARGIN_M, float(high) + WALL_MARGIN_M) for low, high in learned.workspace)


def taught_speed(learned: Any) -> float:
    """The fastest that a LearnedSkill's lessons moved [m/s], as a vector: mean and two deviations of its fastest state."""
    model = learned.model
    at = [n for n, channel in enumerate(model.channels) if channel.startswith("velocity.")]
    mean, spread = np.abs(model.means[:, at]), np.sqrt(np.diagonal(model.covariances, axis1=1, axis2=2)[:, at])
    return float((np.linalg.norm(mean, axis=1) + 2.0 * np.linalg.norm(spread, axis=1)).max())


def taught_pull(learned: Any) -> float:
    """The most that the partner of a LearnedSkill's lessons pulled along the motion [N], mean of the lessons."""
    most = 0.0
    for path in learned.paths:
        velocity = np.gradient(path.position, path.step_s, axis=0)
        speed = np.linalg.norm(velocity, axis=1)
        along = (path.force * velocity).sum(axis=1) / np.maximum(speed, 1e-9)
        most = max(most, float(along.max(where=speed > Limits.moving_m_per_s, initial=0.0)))
    return most


PULL_N = 10.0  # of work along the way that a task may ask for


def as_taught(learned: Sequence[Any], limits: Limits | None = None, *, yields: bool = False) -> Limits:
    """`limits` with the walls of these skills where it states none; None: their speed, with a margin, and their work as well.

    One lift of 0.3 m has 3 J, 10 N over its way (docs/safety.md); five turns of a crank are ten times that way.

    yields   whether the law yields to all that lasts, as the default law does: then little force along the motion is believed
    """
    walls = [taught_walls(one) for one in learned]
    box = tuple((min(low for low, _ in axis), max(high for _, high in axis)) for axis in zip(*walls, strict=True))
    if limits is not None:
        return limits if limits.workspace_m is not None else replace(limits, workspace_m=box)
    fastest = SPEED_MARGIN * max(taught_speed(one) for one in learned)
    pulled = LED_SHARE * max(taught_pull(one) for one in learned)
    pushed = max(LED_N, pulled) if yields else Limits.pushed_n
    work_j = PULL_N * max((path.length_m for one in learned for path in one.paths), default=0.0)
    return Limits(
        workspace_m=box,
        begins_beside_m=BESIDE_M,
        v_max_m_per_s=min(fastest, Limits.v_max_m_per_s),
        pushed_n=pushed,
        energy_j=max(Limits.energy_j, work_j),
    )
