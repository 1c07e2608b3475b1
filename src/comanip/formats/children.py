"""Processes of our own: they run comanip and its libraries, never a file of the user's that happens to have a library's name.

`python -m` puts the working directory first among the places where modules are found, so a csv.py or mcap.py that lies there
would be executed in place of the library. Our children start isolated (-I) and find what is installed first, the parent's other
places last.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_START = (
    "import sys, runpy; sys.path.extend({places!r}); sys.argv[1:] = {arguments!r}; "
    "runpy.run_module({module!r}, run_name='__main__')"
)


def command(module: str, *arguments: str) -> list[str]:
    """The command line of a child that runs `module` of comanip."""
    return [sys.executable, "-I", "-c", _START.format(places=_places(), arguments=list(arguments), module=module)]


def _places() -> list[str]:
    """Where the parent finds modules: comanip's own place, then installed packages, then whatever else is neither the working
    directory nor the folder of the script that runs."""
    home = str(Path(__file__).resolve().parents[2])
    main = getattr(sys.modules.get("__main__"), "__file__", None)
    shadowing = {os.getcwd(), "", "."} | ({str(Path(main).resolve().parent)} if main else set())
    found = [home, *[p for p in sys.path if p not in shadowing and os.path.abspath(p) not in shadowing]]
    return list(dict.fromkeys(p for p in found if p))


@contextmanager
def safe_path() -> Iterator[None]:
    """While it lasts, processes that multiprocessing starts do not look for modules in the working directory first."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before
