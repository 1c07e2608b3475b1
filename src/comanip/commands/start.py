"""The first thing that runs: until the commands are there to answer, a tenth of a second, Control-C ends everything at once.

Nothing is imported here that takes time; `_signal` is what `signal` is made of.
"""

from _signal import SIG_IGN, SIGINT, getsignal, signal  # type: ignore[import-not-found]


def main() -> None:
    """Entry point of `comanip` and `python -m comanip`."""
    if getsignal(SIGINT) is not SIG_IGN:  # started by nohup or in the background: not for us
        signal(SIGINT, _at_once)
    from .app import main as commands

    commands()


def _at_once(number: int, frame: object) -> None:
    import os

    os.write(2, b"interrupted: nothing was written\n")
    os._exit(130)
