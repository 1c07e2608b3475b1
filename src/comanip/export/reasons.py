"""Reasons of the exported envelope, by number, beside what the Python says: one tells the number apart, the other says it."""

from __future__ import annotations

from ..safety.reasons import SAID as _SAID
from ..safety.reasons import number_of

__all__ = ["SAID", "number_of"]
SAID = {name.lower(): said for name, said in _SAID.items()}
