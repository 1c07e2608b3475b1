"""Trials: a skill in closed loop with many partners it has never met, some of whom misbehave, and what came of it."""

from ..parts import LAWS
from .cases import MISBEHAVIOURS, Case, draw_case, partner_of
from .comparing import paired
from .contestants import ABLATION, contestant
from .judging import Bounds, Verdict, bounds, judge, success_interval
from .running import run_case, run_cases

__all__ = [
    "ABLATION",
    "LAWS",
    "MISBEHAVIOURS",
    "Bounds",
    "Case",
    "Verdict",
    "bounds",
    "contestant",
    "draw_case",
    "judge",
    "paired",
    "partner_of",
    "run_case",
    "run_cases",
    "success_interval",
]
