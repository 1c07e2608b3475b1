"""The bytes of a file: whole where it is small, as the system's own view of it where it is large, unpacked where it is packed."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import RecordingError

WHOLE = 96 << 20  # bytes up to which a file is read rather than mapped


@contextmanager
def mapped_bytes(path: Path) -> Iterator[Any]:
    """Bytes of a file of any size; a large one takes no memory beyond what is looked at."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if size <= WHOLE:
            yield stream.read()
            return
        view = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            yield view
        finally:
            with suppress(BufferError):  # an error on its way out still looks at it; it goes with the error
                view.close()


def unpacked(path: Path, data: bytes, limit: int) -> bytes:
    """The contents of a .gz, .bz2, .xz or .zst file, by its first bytes; anything else as it is."""
    try:
        return _inflated(path, data, limit)
    except RecordingError:
        raise
    except Exception as error:  # each library raises its own kinds on damaged input
        why = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: not a recording: starts with {data[:4].hex()} and cannot be unpacked ({why})") from None


def _inflated(path: Path, data: bytes, limit: int) -> bytes:
    stream: Any
    if data[:2] == b"\x1f\x8b":
        import gzip
        import io

        stream = gzip.GzipFile(fileobj=io.BytesIO(data))
    elif data[:3] == b"BZh":
        import bz2
        import io

        stream = bz2.BZ2File(io.BytesIO(data))
    elif data[:6] == b"\xfd7zXZ\0":
        import io
        import lzma

        stream = lzma.LZMAFile(io.BytesIO(data))  # noqa: SIM115
    elif data[:4] == b"\x28\xb5\x2f\xfd":
        import io

        import zstandard

        stream = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data), read_across_frames=True)
    else:
        return data
    found = bytearray()
    while part := stream.read(1 << 20):
        found += part
        if len(found) > limit:
            raise RecordingError(
                f"{path}: unpacks to more than {limit >> 20} MB; the limit is {limit >> 20} MB: cut it into takes"
            )
    return bytes(found)
