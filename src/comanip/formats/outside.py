"""Reading by libraries that a damaged file can crash (HDF5): in a process that may die, within bounds of memory and time.

One process serves all files; it is started with the first and ends with its parent, whose pipe it reads.
"""

from __future__ import annotations

import atexit
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import RecordingError
from ..interfaces import Array
from .children import command

MEMORY = 3 << 30  # bytes of address space of the child
PATIENCE_S = 30.0
_server: subprocess.Popen[bytes] | None = None
atexit.register(lambda: _stop())
_turn = threading.Lock()

Parts = dict[str, list[Array]]


def ask(reader: str, path: Path) -> tuple[Parts, dict[str, Any]]:
    """(arrays by name, facts) of a file as `reader` ("module:function") finds them in another process.

    RecordingError for what the reader says, and for a file on which the process dies or does not answer.
    """
    with _turn:
        for attempt in range(2):  # the process may have died of an earlier file, or been killed: a new one is asked again
            server = _running()
            clock = threading.Timer(PATIENCE_S, server.kill)
            clock.start()
            try:
                return _answer(server, reader, path)
            except (OSError, ValueError, EOFError):
                late = not clock.is_alive()
                _stop()
                if late or attempt:
                    why = f"took longer than {PATIENCE_S:g} s" if late else "ended the process that read it"
                    raise RecordingError(f"{path}: damaged: its library {why}") from None
            finally:
                clock.cancel()
    raise AssertionError("unreachable")


def _running() -> subprocess.Popen[bytes]:
    global _server
    if _server is None or _server.poll() is not None:
        _stop()
        _server = subprocess.Popen(
            command("comanip.formats.outside"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
    return _server


def _stop() -> None:
    global _server
    if _server is not None:
        _server.kill()
        for pipe in (_server.stdin, _server.stdout):
            if pipe is not None:
                with suppress(OSError):  # what it did not read any more
                    pipe.close()
        _server.wait()
        _server = None


def _answer(server: subprocess.Popen[bytes], reader: str, path: Path) -> tuple[Parts, dict[str, Any]]:
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(json.dumps([reader, str(path.resolve())]).encode() + b"\n")
    server.stdin.flush()
    line = server.stdout.readline()
    if not line:
        raise EOFError
    head = json.loads(line)
    if "error" in head:
        raise RecordingError(f"{path}: {head['error']}")
    parts: Parts = {}
    for name, shape, kind in head["arrays"]:
        count = int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize
        data = server.stdout.read(count)
        if len(data) < count:
            raise EOFError
        parts.setdefault(name, []).append(np.frombuffer(data, kind).reshape(shape))
    return parts, head["facts"]


def serve(source: BinaryIO, out: BinaryIO) -> None:
    """The other process: answers until its input ends."""
    _bound_memory()
    from importlib import import_module

    for line in source:
        reader, path = json.loads(line)
        module, _, name = reader.partition(":")
        try:
            arrays, facts = _called(getattr(import_module(f"comanip.formats.{module}"), name), Path(path))
        except RecordingError as error:
            out.write(json.dumps({"error": str(error)}).encode() + b"\n")
        else:
            listed = [(n, np.ascontiguousarray(a)) for n, several in arrays.items() for a in several]
            shapes = [[n, a.shape, a.dtype.str] for n, a in listed]
            out.write(json.dumps({"arrays": shapes, "facts": facts}).encode() + b"\n")
            for _, array in listed:
                out.write(array.tobytes())
        out.flush()


def _called(read: Callable[[Path], tuple[Parts, dict[str, Any]]], path: Path) -> tuple[Parts, dict[str, Any]]:
    try:
        return read(path)
    except RecordingError:
        raise
    except ImportError as error:
        raise RecordingError(f"reading it needs {error.name}: pip install 'comanip[hdf5]'") from None
    except MemoryError:
        raise RecordingError("it takes more memory than there is for one file: cut it into takes") from None
    except Exception as error:  # a library raises its own kinds on damaged input
        raise RecordingError(f"not readable: {' '.join(str(error).split())[:300] or type(error).__name__}") from None


def _bound_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows: no such bound; the sizes that the reader asks for are held against its own
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Control-C is the parent's: it ends its children by closing their pipes
    serve(sys.stdin.buffer, sys.stdout.buffer)
