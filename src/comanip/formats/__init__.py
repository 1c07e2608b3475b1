"""Files on disk: `read` gives the recordings of a file or folder, `write` stores one, `write_all` several.

A format is recognised by its first bytes, then by its extension, a folder by what lies in it. Foreign columns are mapped with
`Columns`. A new format costs its file and one line of `parts.FORMATS`.
"""

from __future__ import annotations

from pathlib import Path

from ..parts import FORMATS, Format
from ..recording import Recording
from .columns import Columns
from .doors import format_of, only, read, writable, write, write_all

__all__ = ["FORMATS", "Columns", "Format", "format_of", "only", "read", "recover", "writable", "write", "write_all"]


def recover(path: str | Path, out: str | Path | None = None) -> tuple[Path, Recording]:
    """What a damaged or cut recording still holds, as a whole file; see `recovery.recover`."""
    from .recovery import recover as recovered

    return recovered(path, out)
