"""Motions in a plane for Figs. 3 and 4: lessons around a curve, the law's terms as fields, and runs from new starts.

Position and velocity only (the paper's footnote 3). The hand starts in motion and comes to rest, as a pen does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from comanip.interfaces import Array
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import Demonstration
from comanip.loop import run, unbroken
from comanip.models.gaussian import log_density, marginal, normalised
from comanip.models.gmr import Regression
from comanip.plants.replay import ReplayPlant
from comanip.skills.paper import ConfidenceGain, PaperLaw, PaperSkill, taught_range

AXES = ("x", "y")
DT = 0.01  # [s], the paper's
DURATION_S = 2.0
EASE = 1.8  # s(t) = 1 - (1 - t/T)^1.8: starts at 1.8 times the mean speed, ends at rest
REST_S = 0.2


def curve(knots: list[tuple[float, float]]) -> CubicSpline:
    """A smooth path through knots [m], as a function of the share of its length."""
    points = np.array(knots)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return CubicSpline(length / length[-1], points)


def lessons(path: CubicSpline, n: int, spread_m: float, rng: np.random.Generator) -> list[Demonstration]:
    """`n` lessons along `path`: each shifted by a smooth offset of standard deviation `spread_m` and 10 % faster or slower."""
    found = []
    for number in range(n):
        duration = DURATION_S * rng.uniform(0.9, 1.1)
        time = np.arange(0.0, duration + REST_S, DT)
        share = 1.0 - (1.0 - np.clip(time / duration, 0.0, 1.0)) ** EASE
        offset = CubicSpline(np.linspace(0.0, 1.0, 4), rng.normal(0.0, spread_m, (4, 2)))
        position = path(share) + offset(share)
        signals = {"position": position, "velocity": np.gradient(position, DT, axis=0)}
        units = {"position": "m", "velocity": "m/s"}
        found.append(Demonstration(f"lesson {number + 1}", DT, signals, AXES, units=units))
    return found


def workspace(path: CubicSpline, room_m: float = 0.12) -> Array:
    """(2, 2) the box W of eq. (9): the path and `room_m` around it."""
    points = path(np.linspace(0.0, 1.0, 200))
    return np.column_stack([points.min(axis=0) - room_m, points.max(axis=0) + room_m])


class Run(NamedTuple):
    position: Array  # (T, 2) [m]
    gain: Array  # (T,) kappa^P / kappa^P_max


def reproduce(skill: LearnedSkill, start: tuple[float, float], law: PaperLaw, box: Array, duration_s: float = 3.0) -> Run:
    """A free hand from `start` under `law`. A run that leaves for good is cut at 10 m so that it can be drawn and measured."""
    plant = ReplayPlant(np.zeros((1, 2)), dt=DT, start_position=np.array(start), axes=AXES)
    law_runs = PaperSkill(skill.model, axes=AXES, dt=DT, model_dt=skill.dt, workspace=box, law=law)
    with np.errstate(all="ignore"):
        recording = unbroken(run(plant, law_runs, duration_s=duration_s))
    most = law.attraction_per_s / DT
    gain = recording["skill.position_gain"].values[:, 0] / most if most > 0.0 else np.zeros(len(recording["loop.late"].time))
    return Run(np.clip(np.nan_to_num(recording["hand.position"].values, nan=10.0), -10.0, 10.0), np.asarray(gain))


class Field(NamedTuple):
    """Velocities (N, 2) [m/s] that the two terms of eq. (8) ask for at N positions, from rest: kappa^V = 1/dt makes them add."""

    velocity_term: Array
    position_term: Array


def field(skill: LearnedSkill, x: Array, law: PaperLaw) -> Field:
    """The terms without memory: weights of eq. (7) from position. x (N, 2)."""
    model = skill.model
    forward, backward = Regression(model, "position", "velocity"), Regression(model, "velocity", "position")
    columns = [model.channels.index(f"position.{a}") for a in AXES]
    h = normalised(log_density(x, *marginal(model.means, model.covariances, columns)))
    free = (np.array(-np.inf), np.array(np.inf))
    groups = ("position", "velocity")
    reach, speeds = (taught_range(model, [f"{g}.{a}" for a in AXES]) if law.bounded else free for g in groups)
    v_hat = np.clip(forward.predict(h, np.clip(x, *reach)).mean, *speeds)
    x_hat = np.clip(backward.predict(h, v_hat).mean, *reach)
    share = np.array([ConfidenceGain(model)(row) for row in x])
    return Field(v_hat, law.attraction_per_s * share[:, None] * (x_hat - x))


def follow_position_term(skill: LearnedSkill, start: tuple[float, float], law: PaperLaw, duration_s: float = 3.0) -> Array:
    """(T, 2) a run on the position term alone."""
    x = np.array([start], dtype=float)
    path = [x[0].copy()]
    for _ in range(round(duration_s / DT)):
        x = x + DT * field(skill, x, law).position_term
        path.append(x[0].copy())
    return np.array(path)


def distance(points: Array, path: CubicSpline) -> Array:
    """(T,) distance of points (T, 2) to the closest point of the path [m]."""
    dense = path(np.linspace(0.0, 1.0, 400))
    return np.asarray(np.linalg.norm(points[:, None] - dense[None], axis=2).min(axis=1))


def progress(points: Array, path: CubicSpline) -> Array:
    """(T,) share of the path at its point closest to each of points (T, 2)."""
    dense = path(np.linspace(0.0, 1.0, 400))
    return np.asarray(np.linalg.norm(points[:, None] - dense[None], axis=2).argmin(axis=1) / 399.0)
