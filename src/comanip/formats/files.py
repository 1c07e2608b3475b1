"""The bytes of a file: whole where it is small, as the system's own view of it where it is large, unpacked where it is packed."""

from __future__ import annotations

import json
import mmap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from ..recording import Recording

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


def header_of(recording: Recording, path: Path, version: int) -> str:
    """What a table of all channels over one column of stamps must state besides, as JSON: layout and metadata.

    RecordingError for stamps that do not increase, and for metadata that are no JSON.
    """
    for name, channel in recording.channels.items():
        if not (np.isfinite(channel.time).all() and (np.diff(channel.time) > 0).all()):
            raise RecordingError(f"{path}: channel {name!r} has stamps that do not increase; write it as .mcap")
    layout = {n: {"unit": c.unit, "frame": c.frame, "axes": list(c.axes)} for n, c in recording.channels.items()}
    try:
        return json.dumps({"version": version, "channels": layout, "metadata": dict(recording.metadata)})
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: the metadata must be plain JSON values: {error}") from None
