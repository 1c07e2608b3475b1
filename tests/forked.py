"""Commands of comanip, each in a process of its own that was forked from one which has imported everything.

A command's first half second is imports; here they are paid once by each worker of the tests. What is asked runs as
`python -m comanip` does: own folder, environment, exit code, standard output and error. Commands that are killed, timed, or
started in another environment than the imports saw are started as real processes: `run` does so by itself for the last.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import pkgutil
import runpy
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

AT_IMPORT = ("COMANIP_", "PYTHON", "OPENBLAS", "OMP_", "MPL", "LD_")  # variables that matter before the first line runs
LIBRARIES = (
    "numpy", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.special", "scipy.stats", "scipy.interpolate",
    "scipy.ndimage", "mcap.reader", "mcap.writer", "mcap_ros2.reader", "mcap_ros2.writer", "rich.console", "rich.progress",
    "rich.table", "joblib", "matplotlib.figure", "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg",
)  # fmt: skip
_servers: dict[Any, subprocess.Popen[str]] = {}


def run(*words: Any, cwd: Any = None, env: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """`comanip WORDS` in the folder `cwd`: returncode, stdout and stderr as text, with the environment of now.

    env   what else is in the environment: a process is kept for each that the imports would see differently
    """
    if os.name != "posix" or (env is None and _servers and _key(os.environ) not in _servers):
        return fresh(*words, cwd=cwd)
    return _answer({"words": [*map(str, words)], "script": None}, cwd, {**os.environ, **(env or {})})


def script(path: Any, *words: Any, cwd: Any = None) -> subprocess.CompletedProcess[str]:
    """The same of `python -W error::DeprecationWarning PATH WORDS`."""
    if os.name != "posix":
        command = [sys.executable, "-W", "error::DeprecationWarning", str(path), *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)
    return _answer({"words": [*map(str, words)], "script": str(path)}, cwd, dict(os.environ))


def _answer(asked: dict[str, Any], cwd: Any, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    server = _servers.get(_key(environment)) or _started(environment)
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps({**asked, "cwd": str(cwd or os.getcwd()), "env": environment, "said": folder}), file=server.stdin)
        server.stdin.flush()
        code = int(server.stdout.readline())
        out, err = (Path(folder, name).read_text() for name in ("out", "err"))
    return subprocess.CompletedProcess(asked["words"], code, out, err)


def _key(environment: Mapping[str, str]) -> tuple[Any, ...]:
    return (os.getpid(), *sorted((name, value) for name, value in environment.items() if name.startswith(AT_IMPORT)))


def fresh(*words: Any, cwd: Any = None) -> subprocess.CompletedProcess[str]:
    """The same in a process that imports everything anew."""
    command = [sys.executable, "-m", "comanip", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


def _started(environment: dict[str, str]) -> subprocess.Popen[str]:
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    server = subprocess.Popen([sys.executable, __file__], env=environment, **pipes)
    atexit.register(_stop, server)
    _servers[_key(environment)] = server
    return server


def _stop(server: subprocess.Popen[str]) -> None:
    server.stdin.close()
    server.wait()


def _preload() -> None:
    import comanip

    for name in LIBRARIES:
        importlib.import_module(name)
    for module in pkgutil.iter_modules(comanip.__path__):
        if module.ispkg:
            importlib.import_module(f"comanip.{module.name}")
    for room in ("commands", "formats", "learned", "trials", "evaluation", "people", "plants", "skills", "tasks", "safety"):
        path = importlib.import_module(f"comanip.{room}").__path__
        for module in pkgutil.iter_modules(path):
            if not module.ispkg:
                importlib.import_module(f"comanip.{room}.{module.name}")
    gc.collect()
    gc.freeze()  # a child that collects would copy all of it


def _asked(requests: int, answers: int) -> dict[str, Any] | None:
    """What a child is to run; None in the server itself, when nobody asks any more."""
    with open(requests, encoding="utf-8", closefd=False) as lines:
        for line in lines:
            if not (child := os.fork()):
                os.close(requests)
                os.close(answers)
                return dict(json.loads(line))
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            os.write(answers, f"{code}\n".encode())
    return None


def _enter(asked: Mapping[str, Any]) -> None:
    """Folder, environment, output and arguments as a new process has them."""
    os.chdir(asked["cwd"])
    for name, number in (("out", 1), ("err", 2)):
        to = os.open(Path(asked["said"], name), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        os.dup2(to, number)
        os.close(to)
    os.environ.clear()
    os.environ.update(asked["env"])
    sys.argv = [asked["script"] or "comanip", *asked["words"]]
    sys.path[0] = str(Path(asked["script"]).parent) if asked["script"] else asked["cwd"]


def _leave(code: int) -> None:
    """As the interpreter ends, but for taking apart what was imported, which costs half a second."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    requests, answers = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDWR), 0)
    os.dup2(2, 1)
    _preload()
    if asked := _asked(requests, answers):
        _enter(asked)
        try:
            if asked["script"]:
                warnings.filterwarnings("error", category=DeprecationWarning)
                runpy.run_path(asked["script"], run_name="__main__")
                _leave(0)
            runpy.run_module("comanip", run_name="__main__", alter_sys=True)
        except SystemExit as ended:
            _leave(int(ended.code or 0))
        except BaseException:
            traceback.print_exc()
            _leave(1)
