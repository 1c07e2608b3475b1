"""A claim that can fail: what is said, what was measured, what it has to meet, and what would refute it."""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    text: str
    measured: float
    bound: str  # what `measured` has to meet, with its unit
    passed: bool
    refuted_by: str


def at_most(text: str, measured: float, bound: float, *, unit: str = "", refuted_by: str) -> Claim:
    """Holds when `measured` is finite and not above `bound`."""
    return Claim(text, float(measured), f"<= {bound:g} {unit}".rstrip(), bool(measured <= bound), refuted_by)


def at_least(text: str, measured: float, bound: float, *, unit: str = "", refuted_by: str) -> Claim:
    """Holds when `measured` is not below `bound`. Infinite counts: it is said of laws that are expected to run away."""
    return Claim(text, float(measured), f">= {bound:g} {unit}".rstrip(), bool(measured >= bound), refuted_by)
