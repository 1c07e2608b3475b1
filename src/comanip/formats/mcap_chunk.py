"""The records of one chunk of an MCAP file: unpacked within limits, checksum held, pictures passed over without being held."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ..errors import RecordingError

if TYPE_CHECKING:
    from .mcap_walk import Walk

MAX_CHUNK = 16 << 20  # bytes that the records of a chunk may take, pictures aside
MAX_WITH_PICTURES = 1 << 30
MAX_MESSAGE = 64 << 10  # of other programs: larger ones are pictures and clouds, counted and not kept
_MESSAGE, _HEAD = 0x05, 22
_PASSED = 1 << 20


def records_of(chunk: Any, walk: Walk) -> Iterator[tuple[int, Any]]:
    """(kind, body) of each record; RecordingError for what does not unpack, is too much, or fails its checksum."""
    size = _declared(chunk)
    if size > MAX_CHUNK:
        yield from _streamed(chunk, walk, size)
        return
    inner = memoryview(_unpacked(chunk))
    at = 0
    while at + 9 <= len(inner):
        length = int.from_bytes(inner[at + 1 : at + 9], "little")
        if at + 9 + length > len(inner):
            raise RecordingError("a record inside is longer than the chunk")
        yield inner[at], inner[at + 9 : at + 9 + length]
        at += 9 + length


def _span(chunk: Any) -> str:
    return f"t = {chunk.message_start_time / 1e9:.3f}-{chunk.message_end_time / 1e9:.3f} s"


def _declared(chunk: Any) -> int:
    """Bytes that the chunk says it unpacks to, by its own head and by the head of the packed data, the larger."""
    declared = int(chunk.uncompressed_size)
    if chunk.compression == "zstd":
        import zstandard

        try:
            declared = max(declared, zstandard.frame_content_size(chunk.data))
        except zstandard.ZstdError as error:
            raise RecordingError(f"{_span(chunk)}: cannot be unpacked ({' '.join(str(error).split())})") from None
    return max(declared, len(chunk.data)) if chunk.compression == "" else declared


def _unpacked(chunk: Any) -> bytes:
    """All bytes of a chunk of at most MAX_CHUNK."""
    inner = b""
    try:
        if chunk.compression == "zstd":
            import zstandard

            inner = zstandard.decompress(chunk.data, max_output_size=MAX_CHUNK)
        elif chunk.compression == "lz4":
            import lz4.frame

            inner = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=MAX_CHUNK + 1)
        elif chunk.compression == "":
            inner = chunk.data
        else:
            raise RecordingError(f"{_span(chunk)}: compression {chunk.compression!r} is not known; allowed: zstd, lz4, none")
    except RecordingError:
        raise
    except Exception as error:  # each library raises its own kinds on damaged input
        raise RecordingError(f"{_span(chunk)}: cannot be unpacked ({' '.join(str(error).split())})") from None
    if len(inner) > MAX_CHUNK:
        raise _too_large(chunk, len(inner))
    if chunk.uncompressed_crc and zlib.crc32(inner) != chunk.uncompressed_crc:
        raise RecordingError(f"{_span(chunk)}: checksum does not match")
    return inner


def _too_large(chunk: Any, size: int) -> RecordingError:
    return RecordingError(f"{_span(chunk)}: chunk declares {size / 2**20:.4g} MB > {MAX_CHUNK >> 20} MB, and it is not pictures")


def _streamed(chunk: Any, walk: Walk, size: int) -> Iterator[tuple[int, Any]]:
    """Records of a chunk that is large for the pictures in it; anything else so large is refused at its first record."""
    if size > MAX_WITH_PICTURES:
        raise _too_large(chunk, size)
    stream = _Counted(_reader(chunk))
    held = 0
    try:
        while head := stream.take(9):
            opcode, length = head[0], int.from_bytes(head[1:], "little")
            if opcode not in (0x03, 0x04, _MESSAGE) or length > size:
                raise _too_large(chunk, size)
            if opcode == _MESSAGE and length > MAX_MESSAGE + _HEAD:
                body = stream.take(_HEAD)
                channel_id = int.from_bytes(body[:2], "little")
                if not walk.ours(channel_id):
                    walk.skip(channel_id, length - _HEAD)
                    walk.seen += 1
                    stream.pass_over(length - _HEAD)
                    continue
                body += stream.take(length - _HEAD)
            else:
                body = stream.take(length)
            held += length
            if held > MAX_CHUNK:
                raise _too_large(chunk, size)
            yield opcode, body
    except RecordingError:
        raise
    except Exception as error:  # each library raises its own kinds on damaged input
        raise RecordingError(f"{_span(chunk)}: cannot be unpacked ({' '.join(str(error).split())})") from None
    if chunk.uncompressed_crc and stream.crc != chunk.uncompressed_crc:
        raise RecordingError(f"{_span(chunk)}: checksum does not match")


def _reader(chunk: Any) -> Any:
    source = io.BytesIO(chunk.data)
    if chunk.compression == "zstd":
        import zstandard

        return zstandard.ZstdDecompressor().stream_reader(source)
    if chunk.compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameFile(source)
    if chunk.compression == "":
        return source
    raise RecordingError(f"{_span(chunk)}: compression {chunk.compression!r} is not known; allowed: zstd, lz4, none")


class _Counted:
    """Reads exactly as many bytes as asked, and sums their checksum."""

    def __init__(self, stream: Any) -> None:
        self._stream, self.crc = stream, 0

    def take(self, count: int) -> bytes:
        data = b""
        while len(data) < count and (more := self._stream.read(count - len(data))):
            data += more
        if 0 < len(data) < count:
            raise RecordingError("a record inside is longer than the chunk")
        self.crc = zlib.crc32(data, self.crc)
        return data

    def pass_over(self, count: int) -> None:
        while count:
            data = self.take(min(count, _PASSED))
            if not data:
                raise RecordingError("a record inside is longer than the chunk")
            count -= len(data)
