"""Files on disk: `read` gives the recordings of a file or directory, `write` stores one.

A format is recognised by its first bytes, then by its extension. Foreign columns are mapped with `Columns`.
"""

from __future__ import annotations

import codecs
from pathlib import Path

from ..errors import ComanipError, ParameterError, RecordingError
from ..recording import Recording
from .columns import Columns

__all__ = ["Columns", "read", "write"]

# A file is read whole and takes several times its size meanwhile: these keep that near half a gigabyte.
MAX_BYTES = {"text": 48 << 20, "mcap": 96 << 20, "arrays": 256 << 20}
_MCAP = b"\x89MCAP0\r\n"
_ARRAYS = (b"\x93NUMPY", b"PK\x03\x04", b"MATLAB 5.0")
_FOREIGN_TEXT = ("<", "{\\rtf", "%PDF", "%!PS")


def read(path: str | Path, columns: Columns | None = None, *, recover: bool = False) -> tuple[Recording, ...]:
    """Every recording in a file (.mcap, .csv and other text tables, .npy, .npz, .mat) or directory of CSV files.

    `columns` maps the columns of foreign files; on our own files it selects, renames and states what is missing.
    `recover` skips damaged parts of an .mcap file instead of refusing it; a file cut short is always read to the cut.
    What was assumed or changed is in each recording's metadata["notes"].

    Raises RecordingError for a file that cannot be read, ChannelError for a column that is not there.
    """
    path, columns = Path(path), columns or Columns()
    try:
        if path.is_dir():
            return _read_directory(path, columns)
        return _read_bytes(path, _bytes(path), columns, recover)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except ComanipError as error:
        if "\n" not in str(error):
            raise
        raise type(error)(" ".join(str(error).splitlines())) from None  # a file name may hold a line break


def _bytes(path: Path) -> bytes:
    """The whole file, unless it is beyond what may be read whole."""
    with path.open("rb") as stream:
        head = stream.read(19)
        kind = "mcap" if head[:8] == _MCAP else "arrays" if head.startswith(_ARRAYS) else "text"
        size, limit = path.stat().st_size, MAX_BYTES[kind]
        if size > limit:
            raise RecordingError(f"{path}: {size >> 20} MB; the limit for {kind} is {limit >> 20} MB: cut it into takes")
        return head + stream.read()


def _read_bytes(path: Path, data: bytes, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    from .array_file import read_mat, read_numpy
    from .assemble import assemble, remapped

    if not data:
        raise RecordingError(f"{path}: no frames: the file is empty")
    if data.startswith(_MCAP[: min(len(data), 8)]) and data[:1] == _MCAP[:1]:
        from .mcap_file import read_mcap

        return (read_mcap(path, data, columns, recover=recover),)
    if data.startswith(b"\x93NUMPY") or (data.startswith(b"PK\x03\x04") and path.suffix.lower() == ".npz"):
        return assemble(read_numpy(path), columns)
    if data.startswith(b"MATLAB 5.0") or (path.suffix.lower() == ".mat" and not data.startswith(b"\x89HDF")):
        return assemble(read_mat(path), columns)
    if data.startswith(b"\x89HDF"):
        raise RecordingError(f"{path}: HDF5 (MATLAB 7.3?) is not read; save it with -v7, or as CSV")
    from .csv_file import SIGNATURE, CsvTable, read_own_csv

    text = _text(path, data)
    if text.startswith(SIGNATURE):
        return (remapped(path, read_own_csv(path, text), columns),)
    return assemble(CsvTable(path, text), columns)


def _text(path: Path, data: bytes) -> str:
    """The file as text; RecordingError when it is something else."""
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    strange = sum(c < " " and c not in "\t\r\n\f" for c in text[:4096])
    if strange or text.lstrip()[:5].startswith(_FOREIGN_TEXT) or not any(c.isdigit() for c in text):
        raise RecordingError(f"{path}: not a recording: starts with {data[:4].hex()}")
    return text


def _read_directory(path: Path, columns: Columns) -> tuple[Recording, ...]:
    from .assemble import assemble
    from .csv_file import CsvDirectory, CsvTable

    files = sorted(p for p in path.iterdir() if p.suffix.lower() in (".csv", ".tsv"))
    if not files:
        raise RecordingError(f"{path}: a directory without .csv files; name a file, or a directory of CSV files")
    return assemble(CsvDirectory(path, {f.stem: CsvTable(f, _text(f, _bytes(f))) for f in files}), columns)


def write(recording: Recording, path: str | Path) -> None:
    """Stores a recording as .mcap (exact to 1 ns in time) or .csv (exact)."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".mcap", ".csv"):
        raise ParameterError(f"{path}: no format for {suffix or 'a name without extension'!r}; allowed: .mcap, .csv")
    try:
        if suffix == ".csv":
            from .csv_file import write_csv

            write_csv(recording, path)
        else:
            from .mcap_file import write_mcap

            write_mcap(recording, path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
