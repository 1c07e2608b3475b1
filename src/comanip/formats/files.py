"""The bytes of a file: whole where it is small, as the system's own view of it where it is large, unpacked where it is packed."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

WHOLE = 96 << 20  # bytes up to which a file is read rather than mapped


@contextmanager
def mapped_bytes(path: Path) -> Iterator[Any]:
    """Bytes of a file of any size; a large one takes no memory beyond what is looked at."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if size <= WHOLE:
            yield stream.read()
            return
        view = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            yield view
        finally:
            with suppress(BufferError):  # an error on its way out still looks at it; it goes with the error
                view.close()
