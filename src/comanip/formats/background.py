"""Recordings that are stored while the next one is being made: encoding a lesson takes about as long as simulating half of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from ..errors import RecordingError
from ..parallel import deaf, end_with
from ..recording import Recording
from . import write


@contextmanager
def writing() -> Iterator[Callable[[Recording, Path], None]]:
    """Gives `formats.write` that returns at once; another process does it. All is on disk when the block ends.

    At most two recordings wait, so a crash loses no more. RecordingError for one that could not be stored comes with a later call
    or at the end. Control-C leaves the block after what was handed over is stored.
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
        with deaf():
            waiting.append((path, other.submit(write, recording, path)))

    with ProcessPoolExecutor(1, get_context("spawn"), end_with, (os.getpid(),)) as other:
        try:
            yield store
        finally:  # what could not be stored is said, whatever else went wrong
            settle(0)
