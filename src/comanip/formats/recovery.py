"""What a crash, a full disk or a damaged byte left of a recording, as a whole file of its own."""

from __future__ import annotations

import warnings
from pathlib import Path

from ..errors import ComanipWarning, ParameterError, RecordingError
from ..recording import Recording
from .doors import read, writable, write
from .live import INCOMPLETE
from .locks import Lock


def recover(path: str | Path, out: str | Path | None = None) -> tuple[Path, Recording]:
    """(the new file, what it holds). `path` stays as it is; `out` is beside it by default ("take.live.mcap" ->
    "take.recovered.mcap").

    What is lost is in the recording's metadata["notes"] and "recovered". RecordingError when nothing can be read, when the file
    is being written by another process, or when `out` is there already.
    """
    path = Path(path)
    target = Path(out) if out is not None else _beside(path)
    if target.suffix.lower() not in writable():
        raise ParameterError(f"{target}: no format for {target.suffix!r}; allowed: {', '.join(writable())}")
    if target.exists():
        raise RecordingError(f"{target}: is there already; give another name (out=...)")
    lock = Lock(path)
    stale = lock.path.exists()
    if stale:
        lock.take()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ComanipWarning)  # what they say is in the notes
            found = read(path, recover=True)
        if len(found) != 1 or not any(len(c.time) for c in found[0].channels.values()):
            raise RecordingError(f"{path}: {len(found)} recordings with frames in them; recover takes one file of one recording")
        notes = [
            *found[0].metadata.get("notes", ()),
            *([f"the lock of pid {lock.left_by}, which is gone, was removed"] if lock.left_by else []),
        ]
        recording = found[0].with_metadata(notes=notes, recovered=_said(found[0]))
        write(recording, target)
    finally:
        lock.free()
    return target, recording


def _beside(path: Path) -> Path:
    stem = path.name.removesuffix(path.suffix).removesuffix(".live")
    return path.with_name(f"{stem}.recovered{path.suffix or '.mcap'}")


def _said(recording: Recording) -> str:
    notes = recording.metadata.get("notes", ())
    lost = [n for n in notes if "cut short" in n or "left out" in n or "damaged" in n]
    if lost:
        return "; ".join(lost)
    return "whole; the run it was written by did not end" if recording.metadata.get("incomplete") == INCOMPLETE else "whole"
