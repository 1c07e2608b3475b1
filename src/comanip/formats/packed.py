"""Files that were packed whole: .gz, .bz2, .xz, .zst. Unpacked to a limit, and told by their first bytes."""

from __future__ import annotations

import bz2
import lzma
import zlib
from pathlib import Path
from typing import Any

from ..errors import RecordingError

_HEADS = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd"}


def packing(data: bytes) -> str:
    """ "gzip", "bzip2", "xz", "zstd", or "" for bytes that are none of them."""
    return next((name for head, name in _HEADS.items() if data.startswith(head)), "")


def unpacked(path: Path, data: bytes, most: int) -> bytes:
    """What a packed file holds; RecordingError when it is damaged, cut, or more than `most` bytes."""
    kind = packing(data)
    out, rest = b"", data
    try:
        while rest:  # files may be packed one behind the other
            stream = _stream(kind)
            out += stream.decompress(rest, most + 1 - len(out))
            if len(out) > most:
                raise RecordingError(f"{path}: unpacks to more than {most >> 20} MB, the limit: cut it into takes")
            if not stream.eof:
                raise EOFError("it is cut")
            rest = stream.unused_data if packing(stream.unused_data) == kind else b""
    except (EOFError, OSError, zlib.error, lzma.LZMAError, ValueError) as error:
        raise RecordingError(f"{path}: not a recording: starts with {data[:4].hex()} ({kind}: {error})") from None
    return out


def _stream(kind: str) -> Any:
    if kind == "gzip":
        return zlib.decompressobj(wbits=31)
    if kind == "bzip2":
        return bz2.BZ2Decompressor()
    if kind == "xz":
        return lzma.LZMADecompressor(memlimit=128 << 20)
    return _Zstd()


class _Zstd:
    """zstandard, which came with mcap, in the manner of the others."""

    eof, unused_data = True, b""

    def decompress(self, data: bytes, most: int) -> bytes:
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(data, read_across_frames=True) as reader:
            try:
                return reader.read(most)
            except zstandard.ZstdError as error:
                raise ValueError(error) from None
