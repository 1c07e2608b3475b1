"""A claim that can fail: what is said, what was measured, what it has to meet, and what would refute it."""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    text: str
    measured: float
    bound: str  # what `measured` has to meet, with its unit
    passed: bool
    refuted_by: str
    known: str = ""  # why it does not hold yet; "" for one that has to

    @property
    def as_known(self) -> bool:
        """Whether it holds, or fails as is known. One that holds and is said to fail is no better: its note is out of date."""
        return self.passed != bool(self.known)

    @property
    def verdict(self) -> str:
        """ "pass", "FAIL", or for what is known to fail, why."""
        if self.passed:
            return "pass" + (f" (no longer known to fail: {self.known})" if self.known else "")
        return f"known to fail ({self.known})" if self.known else "FAIL"


def at_most(text: str, measured: float, bound: float, *, unit: str = "", refuted_by: str, known: str = "") -> Claim:
    """Holds when `measured` is finite and not above `bound`."""
    return Claim(text, float(measured), f"<= {bound:g} {unit}".rstrip(), bool(measured <= bound), refuted_by, known)


def at_least(text: str, measured: float, bound: float, *, unit: str = "", refuted_by: str, known: str = "") -> Claim:
    """Holds when `measured` is not below `bound`. Infinite counts: it is said of laws that are expected to run away."""
    return Claim(text, float(measured), f">= {bound:g} {unit}".rstrip(), bool(measured >= bound), refuted_by, known)
