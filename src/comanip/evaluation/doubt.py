"""How far a recording may lie beside the lessons and still be foreseen by them."""

from __future__ import annotations

from ..learned.skill import LearnedSkill

# doubt in position, shares of the range that the lessons cover: a state at rest is a millimetre wide, and other recordings start
# a centimetre beside it. As evidence for the state position is worth little; as input of the regression nearly all
WEIGHT_DOUBT, INPUT_DOUBT = 0.13, 0.033


def doubt(learned: LearnedSkill, share: float) -> dict[str, float]:
    """Variance by position channel: `share` of the range that the lessons cover, squared. (W is that range, twice as wide.)"""
    ranges = 0.5 * (learned.workspace[:, 1] - learned.workspace[:, 0])
    return {f"position.{axis}": float((share * r) ** 2) for axis, r in zip(learned.axes, ranges, strict=True)}
