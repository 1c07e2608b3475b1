"""Files on disk: `read` gives the recordings of a file or directory, `write` stores one.

A format is recognised by its first bytes, then by its extension. Foreign columns are mapped with `Columns`.
"""

from __future__ import annotations

import codecs
import os
from pathlib import Path

from ..errors import ParameterError, RecordingError, given
from ..recording import Recording
from .columns import Columns
from .packed import packing, unpacked

__all__ = ["Columns", "read", "write"]

# A file is read whole and takes several times its size meanwhile: these keep that near half a gigabyte.
MAX_BYTES = {"text": 48 << 20, "mcap": 96 << 20, "arrays": 256 << 20}
_MCAP = b"\x89MCAP0\r\n"
_ARRAYS = (b"\x93NUMPY", b"PK\x03\x04", b"MATLAB ")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_APPLE_DOUBLE = b"\x00\x05\x16\x07"
_FOREIGN_TEXT = ("<", "{\\rtf", "%PDF", "%!PS")


def read(path: str | Path, columns: Columns | None = None, *, recover: bool = False) -> tuple[Recording, ...]:
    """Every recording in a file (.mcap, .csv and other text tables, .npy, .npz, .mat) or directory of CSV files.

    `columns` maps the columns of foreign files; on our own files it selects, renames and states what is missing.
    `recover` skips damaged parts of an .mcap file instead of refusing it; a file cut short is always read to the cut.
    What was assumed or changed is in each recording's metadata["notes"].

    Raises RecordingError for a file that cannot be read, ChannelError for a column that is not there.
    """
    path, columns = _path(path), _columns(columns)
    try:
        if path.is_dir():
            return _read_directory(path, columns)
        return _read_bytes(path, _bytes(path), columns, recover)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None


def _path(path: str | Path) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise ParameterError(f"the path is {given(path)}; allowed: a path, as text or pathlib.Path; one file at a time")
    return Path(path)


def _columns(columns: Columns | None) -> Columns:
    if columns is not None and not isinstance(columns, Columns):
        raise ParameterError(f"columns is {given(columns)}; allowed: Columns(position='z', force='Fz', ...)")
    return columns or Columns()


def _bytes(path: Path) -> bytes:
    """The whole file, unless it is beyond what may be read whole."""
    with path.open("rb") as stream:
        head = stream.read(19)
        kind = "mcap" if head[:8] == _MCAP else "arrays" if head.startswith(_ARRAYS) else "text"
        size, limit = path.stat().st_size, MAX_BYTES[kind]
        if size > limit:
            raise RecordingError(f"{path}: {size >> 20} MB; the limit for {kind} is {limit >> 20} MB: cut it into takes")
        data = head + stream.read()
    if packing(data):
        return unpacked(path, data, MAX_BYTES["text"])
    return data


def _read_bytes(path: Path, data: bytes, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    from .array_file import read_mat, read_numpy
    from .assemble import assemble, remapped

    if not data:
        raise RecordingError(f"{path}: no frames: the file is empty")
    if data.startswith(_APPLE_DOUBLE):
        raise RecordingError(f"{path}: macOS's note beside a file (AppleDouble), no recording; leave it out")
    if data.startswith(_MCAP[: min(len(data), 8)]) and data[:1] == _MCAP[:1]:
        from .mcap_file import read_mcap

        return (remapped(path, read_mcap(path, data, recover=recover), columns),)
    suffix = _inner_suffix(path)
    if data.startswith(b"\x93NUMPY") or (data.startswith(b"PK\x03\x04") and suffix == ".npz"):
        return assemble(read_numpy(path, data), columns)
    if data[512:520] == _HDF5 or (data.startswith(_HDF5) and suffix == ".mat"):
        from .mat73_file import read_mat73

        return assemble(read_mat73(path), columns)
    if data.startswith(b"MATLAB 5.0") or (suffix == ".mat" and not _is_text(data)):
        return assemble(read_mat(path, data), columns)
    if data.startswith(_HDF5):
        raise RecordingError(f"{path}: HDF5 is not read; save it as MCAP, CSV or .npz")
    from .csv_file import CsvTable, is_own, read_own_csv

    text = _text(path, data)
    if is_own(text):
        return (remapped(path, read_own_csv(path, text), columns),)
    return assemble(CsvTable(path, text), columns)


def _inner_suffix(path: Path) -> str:
    """The extension, below that of a packer: ".npy" of lift.npy.gz."""
    suffix = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if suffix in (".gz", ".bz2", ".xz", ".zst") else suffix


def _is_text(data: bytes) -> bool:
    """Whether a .mat holds a table (save -ascii) rather than MATLAB's own layout."""
    return not data[:512].translate(None, b"0123456789+-.eEdDnNaAiIfF,; \t\r\n")


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
    from .assemble import assemble, title_of
    from .csv_file import CsvDirectory, CsvTable

    found = sorted(p for p in path.iterdir() if _inner_suffix(p) in (".csv", ".tsv"))
    files = [p for p in found if not p.name.startswith(("._", ".~lock"))]  # macOS's and LibreOffice's notes beside a file
    if not files:
        raise RecordingError(f"{path}: a directory without .csv files; name a file, or a directory of CSV files")
    return assemble(CsvDirectory(path, {title_of(f): CsvTable(f, _text(f, _bytes(f))) for f in files}), columns)


def write(recording: Recording, path: str | Path) -> None:
    """Stores a recording as .mcap (exact to 1 ns in time) or .csv (exact)."""
    path = _path(path)
    if not isinstance(recording, Recording):
        raise ParameterError(f"got {given(recording)} to write; allowed: a Recording")
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
