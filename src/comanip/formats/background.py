"""Recordings that are stored while the next one is being made: encoding a lesson takes about as long as simulating half of it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path

from ..errors import RecordingError
from ..parallel import deaf
from ..recording import Recording
from .children import safe_path
from .doors import write

_storing = threading.Lock()


@contextmanager
def writing() -> Iterator[Callable[[Recording, Path], None]]:
    """Gives `formats.write` that returns at once; another process does it. All is on disk when the block ends.

    At most two recordings wait, so a crash loses no more. RecordingError for one that could not be stored comes with a later call
    or at the end. Control-C leaves the block after what was handed over is stored. When the parent is killed, the other process
    stores what it is at and ends.
    """
    waiting: list[tuple[Path, Future[None]]] = []

    def settle(most: int) -> None:
        while len(waiting) > most:
            path, stored = waiting.pop(0)
            try:
                stored.result()
            except BrokenProcessPool:
                raise RecordingError(f"{path}: the process that stores recordings died; out of memory?") from None

    def store(recording: Recording, path: Path) -> None:
        settle(1)
        with deaf(), safe_path():  # the process is started with the first call
            waiting.append((path, other.submit(_store, recording, path)))

    with ProcessPoolExecutor(1, get_context("spawn"), _begin) as other:
        try:
            yield store
        finally:  # what could not be stored is said, whatever else went wrong
            settle(0)


def _store(recording: Recording, path: Path) -> None:
    with _storing:
        write(recording, path)


def _begin() -> None:
    """In the other process: Control-C is the parent's to answer, and nobody waits for a parent that is dead."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        with _storing:  # what is being stored is stored
            os._exit(1)
