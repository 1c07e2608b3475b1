"""One writer a take: a lock beside the file says which process has it, and goes with that process.

The lock is the operating system's (flock, or msvcrt on Windows), so that a crash frees it; the number in the file is for people.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO, Any

from ..errors import RecordingError

_FAR = 1 << 20  # the byte that Windows locks lies behind the text, which others must be able to read


class Lock:
    """Held from `take` to `free`. A lock file that a dead process left is taken over: `left_by` is its number."""

    def __init__(self, path: Path) -> None:
        self.path = path.with_name(path.name + ".lock")
        self.left_by: str | None = None
        self._file: IO[Any] | None = None

    def take(self) -> None:
        """Raises RecordingError when another process has it."""
        while True:
            there = self.path.exists()
            file = self.path.open("a+", encoding="ascii", errors="replace")
            file.seek(0)
            holder = file.read(64).strip()
            if not _lock(file):
                file.close()
                raise RecordingError(
                    f"{self.path.with_suffix('')}: in use by pid {holder or '?'}; give another name, or end that process"
                )
            if self.path.exists() and os.path.samestat(os.fstat(file.fileno()), self.path.stat()):
                break
            file.close()  # its holder removed it meanwhile: another try
        self.left_by = holder if there and holder else None
        file.seek(0)
        file.truncate()
        file.write(f"{os.getpid()}\n")
        file.flush()
        self._file = file

    def fileno(self) -> int:
        """For a child that shall hold the lock, too."""
        assert self._file is not None
        return self._file.fileno()

    def free(self) -> None:
        if self._file is None:
            return
        self.path.unlink(missing_ok=True)
        self._file.close()
        self._file = None


def _lock(file: IO[Any]) -> bool:
    try:
        import fcntl
    except ImportError:  # Windows
        return _lock_windows(file)
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _lock_windows(file: IO[Any]) -> bool:
    import msvcrt

    file.seek(_FAR)
    try:
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError:
        return False
    return True
