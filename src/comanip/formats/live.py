"""A recording that reaches the disk while the run goes on: after `kill -9` all but the last tenth of a second is there.

    run(plant, skill, duration_s=60.0, taps=[LiveFile(Path("take.live.mcap"))])

The tick copies its row into memory. Each tenth of a second the rows go through a thread and a pipe to a process of their own,
which encodes them in chunks of 1 KiB and flushes: encoding in a thread would hold the interpreter, and a tick, for milliseconds.
When the run's process dies the other one closes the file properly. The file says that it is incomplete; a run that ends by itself
gives a Recording, which `formats.write` stores whole, and then the live file may go (`discard`).
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import ComanipWarning, RecordingError
from ..interfaces import Command, Observation
from ..recording import Channel, Recorder, Recording
from .children import command
from .locks import Lock

FLUSH_S = 0.1
SYNC_S = 1.0
BACKLOG = 200  # batches, 20 s: beyond that the disk is too slow to be waited for
PATIENCE_S = 20.0  # for what is still to be written when the run is over
LITTLE_ROOM = 1 << 30  # bytes free on the disk below which a take is warned of before it begins
INCOMPLETE = "the program ended before the recording did"
STOPPED = 3  # exit code of the writer that could not write on


class LiveFile:
    """A tap that keeps the run in `path` (.mcap) as it goes. A tick costs a copy of one row; a slow disk costs none.

    behind   the disk did not keep up, and rows were left out of the live file
    stopped  why the file was ended before the run ("No space left on device"); "" while all is well. The run goes on
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        self.path, self._metadata = Path(path), {**(metadata or {}), "incomplete": INCOMPLETE}
        self.behind, self.stopped = False, ""
        self._left_out = 0  # rows
        self._lock = Lock(self.path)

    def begin(self, recorder: Recorder) -> None:
        """Called by the loop before the first tick. Raises RecordingError when the file cannot be made or is in use.

        What an earlier run left behind under this name is kept under another, and said.
        """
        try:
            self._claim()
        except OSError as error:
            self._lock.free()
            raise RecordingError(f"{self.path}: {error.strerror or error}; choose a directory that can be written to") from None
        self._recorder, self._rows, self._sent = recorder, bytearray(), time.monotonic()
        self._queue: queue.Queue[bytes | None] = queue.Queue(BACKLOG)
        share: dict[str, Any] = {"pass_fds": (self._lock.fileno(),)} if os.name == "posix" else {}
        self._writer = subprocess.Popen(
            command("comanip.formats.live", str(self.path)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            **share,
        )  # the writer holds the lock, too: after a crash the file is its own until it is closed
        header = json.dumps({"layout": recorder.layout, "frame": recorder.frame, "metadata": self._metadata})
        self._queue.put(header.encode() + b"\n")
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def _claim(self) -> None:
        self._lock.take()
        if self._lock.left_by:
            _say(f"{self.path}: the lock of pid {self._lock.left_by}, which is gone, was taken over")
        if self.path.exists() and self.path.stat().st_size:
            kept = _free_name(self.path)
            self.path.rename(kept)
            _say(f"{self.path}: an earlier run left it behind; kept as {kept.name} (comanip recover {kept.name})")
        self.path.open("wb").close()
        free = shutil.disk_usage(self.path.parent or Path(".")).free
        if free < LITTLE_ROOM:
            _say(f"{self.path}: {free >> 20} MB left on the disk: a minute at 1 kHz takes about 10 MB")

    def __call__(self, obs: Observation, command: Command) -> None:
        self._rows += self._recorder.row.tobytes()
        now = time.monotonic()
        if now - self._sent >= FLUSH_S:
            self._sent = now
            self._send()

    def end(self) -> None:
        """Called by the loop after the last tick; waits until the file is closed, but not for a disk that hangs."""
        self._send()
        until = time.monotonic() + PATIENCE_S
        try:
            self._queue.put(None, timeout=PATIENCE_S)
            self._thread.join(PATIENCE_S)
            self._writer.wait(max(until - time.monotonic(), 0.1))
        except (queue.Full, subprocess.TimeoutExpired):
            self.stopped = self.stopped or f"the disk took no data for {PATIENCE_S:g} s"
            self._writer.kill()
        self._hear()
        self._lock.free()
        if self.stopped:
            _say(f"{self.path}: recording stopped: {self.stopped}; what was written is kept")
        elif self.behind:
            _say(f"{self.path}: recording behind: the disk did not keep up, {self._left_out} rows are not in the live file")

    def _hear(self) -> None:
        """Why the writer ended, if not because all was written."""
        if self._writer.poll() not in (0, None) and not self.stopped:
            said = b"" if self._writer.stdout is None or self._writer.poll() != STOPPED else self._writer.stdout.read(400)
            self.stopped = said.decode("utf-8", "replace").strip() or "the process that writes it ended"

    def discard(self) -> None:
        """Removes the live file: the recording has been stored whole elsewhere."""
        self.path.unlink(missing_ok=True)

    def _send(self) -> None:
        try:
            self._queue.put_nowait(bytes(self._rows))
        except queue.Full:
            self.behind = True
            self._left_out += len(self._rows) // self._recorder.row.nbytes
        self._rows.clear()

    def _pump(self) -> None:
        pipe = self._writer.stdin
        assert pipe is not None
        try:
            while (batch := self._queue.get()) is not None:
                pipe.write(batch)
                pipe.flush()
            pipe.close()
        except OSError:  # the writer ended (disk full): the run goes on, its Recording is whole
            self.behind = True
            while self._queue.get() is not None:
                pass


def _say(text: str) -> None:
    warnings.warn(text, ComanipWarning, stacklevel=4)


def _free_name(path: Path) -> Path:
    """take.live.mcap -> take.live-1.mcap, the first that is free."""
    number = 1
    while (other := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists():
        number += 1
    return other


def keep(path: Path, source: BinaryIO) -> None:
    """The other process: rows from `source` into `path` until it ends. OSError (disk full) leaves the file cut after a whole
    record."""
    from mcap.writer import CompressionType, Writer

    from . import mcap_file

    header = json.loads(source.readline())
    layout: dict[str, tuple[int, str, tuple[str, ...]]] = header["layout"]
    width = 1 + sum(columns for columns, _, _ in layout.values())
    with path.open("wb", buffering=0) as out:
        whole: Any = _Whole(out)
        try:
            writer = Writer(whole, chunk_size=mcap_file.CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(profile="ros2", library="comanip")
            empty = Recording(_channels(np.empty((0, width)), layout, header["frame"]), header["metadata"])
            writer.add_metadata(mcap_file.RECORD, mcap_file.summary(path, empty, 0))
            ids, counts, synced = mcap_file.register(writer, empty.channels), dict.fromkeys(layout, 0), time.monotonic()
            rest = b""
            while batch := source.read1(1 << 16):  # type: ignore[attr-defined]
                batch = rest + batch
                end = len(batch) // (8 * width) * 8 * width
                rest, rows = batch[end:], np.frombuffer(batch[:end]).reshape(-1, width)
                mcap_file.add(writer, ids, _channels(rows, layout, header["frame"]), counts)
                whole.flush()
                if time.monotonic() - synced > SYNC_S:
                    os.fsync(out.fileno())
                    synced = time.monotonic()
            writer.finish()
            whole.flush()
        except OSError:
            with suppress(OSError):
                out.truncate(whole.sure)  # half a record would be damage; a whole one less is a cut
            raise


class _Whole:
    """A stream that knows up to where everything was written: `sure` [bytes] is moved on only by a flush that went through."""

    def __init__(self, raw: Any) -> None:
        self._raw, self._waiting = raw, bytearray()
        self.sure = 0

    def write(self, data: Any) -> int:
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        return self.sure + len(self._waiting)

    def flush(self) -> None:
        at = 0
        while at < len(self._waiting):
            at += self._raw.write(memoryview(self._waiting)[at:]) or 0
        self.sure += at
        self._waiting = bytearray()


def _channels(rows: Any, layout: Mapping[str, tuple[int, str, tuple[str, ...]]], frame: str) -> dict[str, Channel]:
    channels, at = {}, 1
    for name, (columns, unit, axes) in layout.items():
        channels[name] = Channel(rows[:, 0], rows[:, at : at + columns], unit, frame, tuple(axes))
        at += columns
    return channels


def main() -> int:
    try:
        keep(Path(sys.argv[1]), sys.stdin.buffer)
    except OSError as error:
        print(error.strerror or error, flush=True)
        return STOPPED
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
