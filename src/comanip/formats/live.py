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
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import RecordingError
from ..interfaces import Command, Observation
from ..recording import Channel, Recorder, Recording

FLUSH_S = 0.1
SYNC_S = 1.0
BACKLOG = 200  # batches, 20 s: beyond that the disk is too slow to be waited for
INCOMPLETE = "the program ended before the recording did"


class LiveFile:
    """A tap that keeps the run in `path` (.mcap) as it goes. A tick costs a copy of one row; a slow disk costs none."""

    def __init__(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        self.path, self._metadata = path, {**(metadata or {}), "incomplete": INCOMPLETE}
        self.behind = False  # True when the disk did not keep up and rows were left out of the live file

    def begin(self, recorder: Recorder) -> None:
        """Called by the loop before the first tick. Raises RecordingError when the file cannot be made."""
        try:
            self.path.open("wb").close()
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror or error}; choose a directory that can be written to") from None
        self._recorder, self._rows, self._sent = recorder, bytearray(), time.monotonic()
        self._queue: queue.Queue[bytes | None] = queue.Queue(BACKLOG)
        self._writer = subprocess.Popen(
            [sys.executable, "-m", "comanip.formats.live", str(self.path)], stdin=subprocess.PIPE, start_new_session=True
        )
        header = json.dumps({"layout": recorder.layout, "frame": recorder.frame, "metadata": self._metadata})
        self._queue.put(header.encode() + b"\n")
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def __call__(self, obs: Observation, command: Command) -> None:
        self._rows += self._recorder.row.tobytes()
        now = time.monotonic()
        if now - self._sent >= FLUSH_S:
            self._sent = now
            self._send()

    def end(self) -> None:
        """Called by the loop after the last tick; waits until the file is closed."""
        self._send()
        self._queue.put(None)
        self._thread.join()
        self._writer.wait()

    def discard(self) -> None:
        """Removes the live file: the recording has been stored whole elsewhere."""
        self.path.unlink(missing_ok=True)

    def _send(self) -> None:
        try:
            self._queue.put_nowait(bytes(self._rows))
        except queue.Full:
            self.behind = True
        self._rows.clear()

    def _pump(self) -> None:
        pipe = self._writer.stdin
        assert pipe is not None
        try:
            while (batch := self._queue.get()) is not None:
                pipe.write(batch)
                pipe.flush()
            pipe.close()
        except OSError:  # the writer died (disk full): the run goes on, its Recording is whole
            self.behind = True
            while self._queue.get() is not None:
                pass


def keep(path: Path, source: BinaryIO) -> None:
    """The other process: rows from `source` into `path` until it ends."""
    from mcap.writer import CompressionType, Writer

    from . import mcap_file

    header = json.loads(source.readline())
    layout: dict[str, tuple[int, str, tuple[str, ...]]] = header["layout"]
    width = 1 + sum(columns for columns, _, _ in layout.values())
    with path.open("wb") as out:
        writer = Writer(out, chunk_size=mcap_file.CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="ros2", library="comanip")
        empty = Recording(_channels(np.empty((0, width)), layout, header["frame"]), header["metadata"])
        writer.add_metadata(mcap_file.RECORD, mcap_file.summary(path, empty, 0))
        ids, counts, synced = mcap_file.register(writer, empty.channels), dict.fromkeys(layout, 0), time.monotonic()
        rest = b""
        while batch := source.read1(1 << 16):  # type: ignore[attr-defined]
            batch = rest + batch
            whole = len(batch) // (8 * width) * 8 * width
            rest, rows = batch[whole:], np.frombuffer(batch[:whole]).reshape(-1, width)
            mcap_file.add(writer, ids, _channels(rows, layout, header["frame"]), counts)
            out.flush()
            if time.monotonic() - synced > SYNC_S:
                os.fsync(out.fileno())
                synced = time.monotonic()
        writer.finish()


def _channels(rows: Any, layout: Mapping[str, tuple[int, str, tuple[str, ...]]], frame: str) -> dict[str, Channel]:
    channels, at = {}, 1
    for name, (columns, unit, axes) in layout.items():
        channels[name] = Channel(rows[:, 0], rows[:, at : at + columns], unit, frame, tuple(axes))
        at += columns
    return channels


if __name__ == "__main__":
    keep(Path(sys.argv[1]), sys.stdin.buffer)
