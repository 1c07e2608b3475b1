"""Single keys from a terminal while the loop runs, on a thread that sleeps until one comes."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

POLLED_S = 0.2


@contextmanager
def keys(does: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Calls what a key does; nothing where standard input is no terminal, or the system has none of POSIX's."""
    try:
        import select
        import termios
        import tty

        before = termios.tcgetattr(sys.stdin) if sys.stdin.isatty() else None
    except (ImportError, OSError, ValueError):
        before = None
    if before is None:
        yield
        return
    over = threading.Event()

    def listen() -> None:
        while not over.is_set():
            if select.select([sys.stdin], [], [], POLLED_S)[0]:
                does.get(sys.stdin.read(1).lower(), lambda: None)()

    tty.setcbreak(sys.stdin)
    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(2.0 * POLLED_S)
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
