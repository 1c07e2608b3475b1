"""How a command ends: with a result, with one line about what went wrong, or with one line about Ctrl-C. Never with a traceback.

Exit codes: 0 done, 1 a claim or a part of the program failed, 2 input that cannot be used, 130 Ctrl-C.

Control-C is remembered besides being raised, because much of what runs here catches everything: an import that is cut short ends
as ImportError, a pool of processes as "a worker died". Whatever ends a command after Control-C, it ended by Control-C.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

TRACEBACK = "COMANIP_TRACEBACK"
AGAIN_S = 0.05  # after which a Control-C that a destructor or a callback has swallowed is raised once more
_asked = False
_kept: list[str] = []


def keeping(text: str) -> None:
    """States what would be left if Control-C came from now on; the last statement is the one that is printed."""
    _kept[:] = [text]


def ended_by(command: Callable[[], Any], wrong_usage: type[Exception]) -> int:
    """Runs a command to its end, says in one line why it ended if not well, and gives the exit code."""
    _kept.clear()
    from ..evaluation.shown import never_fails

    for stream in (sys.stdout, sys.stderr):
        never_fails(stream)
    with _listening():
        try:
            command()
            sys.stdout.flush()
            code = 130 if _asked else 0  # asked, and swallowed by somebody on the way
        except BaseException as error:
            code = _answer(error, wrong_usage)
        _silenced()
    if code == 130:
        _no_child_left()
        _say(f"interrupted: {_kept[0] if _kept else 'nothing was written'}")
    return code


def _answer(error: BaseException, wrong_usage: type[Exception]) -> int:
    from ..errors import ComanipError
    from .flag_words import in_flags

    if isinstance(error, BrokenPipeError) and not _asked:  # `| head` has read enough
        return 0
    if _asked or isinstance(error, KeyboardInterrupt):
        return 130
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 0 if error.code is None else 2
    if isinstance(error, (wrong_usage, ComanipError)):
        return _refused(in_flags(str(error)))
    if isinstance(error, OSError):
        where = error.filename if error.filename is not None else "output"
        return _refused(f"{os.fsdecode(where) if isinstance(where, (str, bytes)) else where}: {error.strerror or error}")
    if isinstance(error, MemoryError):
        return _refused("out of memory; give fewer or shorter recordings at once, or learn with --stream")
    return _defect(error)


def _refused(text: str) -> int:
    _say(f"error: {text}")
    return 2


def _defect(error: BaseException) -> int:
    """A fault of the program itself: one line that can be reported, and the whole trace for who asks for it."""
    if os.environ.get(TRACEBACK):
        traceback.print_exception(error)
    last = traceback.extract_tb(error.__traceback__)[-1]
    at = f"{os.path.basename(last.filename)}:{last.lineno}"
    _say(f"error: {type(error).__name__}: {error} ({at}): a defect of comanip, please report it; {TRACEBACK}=1 prints more")
    return 1


def _say(text: str) -> None:
    from ..evaluation.shown import plain_text

    with suppress(OSError, ValueError):  # nobody listens any more
        print(" ".join(plain_text(text).split()), file=sys.stderr, flush=True)


@contextmanager
def _listening() -> Iterator[None]:
    """Control-C is remembered, raised, and raised again where a destructor swallows it."""
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN  # nohup, or in the background
    if ignored or threading.current_thread() is not threading.main_thread():
        yield
        return
    hooks = sys.unraisablehook
    before = signal.signal(signal.SIGINT, _heard)
    sys.unraisablehook = lambda unraisable: (
        threading.Timer(AGAIN_S, signal.raise_signal, [signal.SIGINT]).start()
        if isinstance(unraisable.exc_value, KeyboardInterrupt)
        else hooks(unraisable)
    )
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if _asked else before)  # what is left to do is short, and must be done
        sys.unraisablehook = hooks


def _heard(number: int, frame: Any) -> None:
    global _asked
    _asked = True
    raise KeyboardInterrupt


_warned: set[str] = set()


def show_warning(message: Any, category: Any, *_: Any, **__: Any) -> None:
    """In place of Python's: one line, in flags, and each only once."""
    from .flag_words import in_flags

    text = in_flags(str(message))
    if text not in _warned:
        _warned.add(text)
        _say(f"warning: {text}")


def was_said(note: str) -> bool:
    """Whether this note has been printed as a warning: it need not be read twice."""
    from .flag_words import in_flags

    return in_flags(note) in _warned


def _silenced() -> None:
    """Flushes; an output that cannot take the rest (closed pipe, full disk) is put aside, or Python complains when it exits."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _no_child_left() -> None:
    """Ends the processes that work was shared out to: they were told to ignore Control-C, so that they print nothing."""
    from ..parallel import end_workers

    end_workers()


def leave(code: int) -> None:
    """Ends the process. After Control-C at once: threads and pools would wait for work that nobody wants any more."""
    if code == 130:
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
