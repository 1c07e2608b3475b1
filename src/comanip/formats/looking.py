"""A reader that is stopped where it would begin to map: what it found by then says what a file holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .columns import Columns


@dataclass(frozen=True)
class Look(Columns):
    """A mapping that maps nothing and stops the reader where it would begin to: see `listing.look`."""


class Looked(Exception):
    """What a reader had found when it was stopped: a Source of columns, or a Recording of topics."""

    def __init__(self, found: Any) -> None:
        self.found = found
