"""Files of columns, opened as `formats.FORMATS` asks: text, numpy, MATLAB; and folders of files that are read one by one."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import RecordingError
from ..recording import Recording
from .array_file import read_mat, read_numpy
from .assemble import assemble, remapped
from .columns import Columns
from .csv_file import CsvTable, is_own, read_own_csv, write_csv
from .doors import only, read

_HDF5 = b"\x89HDF\r\n\x1a\n"
_FOREIGN_TEXT = ("<", "{\\rtf", "%PDF", "%!PS")
_EACH = (".mcap", ".db3", ".parquet", ".npz", ".npy", ".mat", ".hdf5", ".h5")


def open_text(path: Path, data: bytes, columns: Columns, recover: bool) -> Sequence[Recording]:
    text = text_of(path, data)
    if is_own(text):
        return (remapped(path, read_own_csv(path, text), columns),)
    return assemble(CsvTable(path, text), columns)


def text_of(path: Path, data: bytes) -> str:
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


def write_text(recordings: Sequence[Recording], path: Path) -> None:
    write_csv(only(recordings, path), path)


def open_numpy(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    return assemble(read_numpy(path, data), columns)


def open_mat(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    if data[512:520] == _HDF5 or data.startswith(_HDF5):
        from .mat73_file import read_mat73

        return assemble(read_mat73(path), columns)
    return assemble(read_mat(path, data), columns)


def open_each(path: Path, data: Any, columns: Columns, recover: bool) -> Sequence[Recording]:
    """Every file of a folder that is a recording of its own."""
    files = sorted(p for p in path.iterdir() if p.suffix.lower() in _EACH and not p.name.startswith("."))
    if not files:
        raise RecordingError(f"{path}: no file that is read (files whose names begin with a dot are left out)")
    return [recording for file in files for recording in read(file, columns, recover=recover)]
