"""A watchdog for what must never wait: no limit of speed, but a loop that waits for a dead disk is told from a slow machine."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def hanging_is_an_error(after_s: float = 60.0) -> Iterator[None]:
    """TimeoutError in the main thread where what is inside still runs after `after_s`; nothing without POSIX's timers."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def hangs(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"it hangs: not done after {after_s:g} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, after_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
