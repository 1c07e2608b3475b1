"""The doors of the room: which format a path has, its reader and its writer, and one line for what cannot be used."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ..errors import ParameterError, RecordingError, given
from ..parts import FORMATS, Format
from ..recording import Recording
from .columns import Columns
from .packed import packing, unpacked
from .segments import segments, with_labels

_REFUSED = {
    b"#ROSBAG V": "a bag of ROS 1; convert it: pip install rosbags, then rosbags-convert --src X.bag --dst X",
    b"PK\x03\x04": "",
}
_HEAD = 512
_APPLE_DOUBLE = b"\x00\x05\x16\x07"


def read(path: str | Path, columns: Columns | None = None, *, recover: bool = False) -> tuple[Recording, ...]:
    """Every recording in a file or folder of any of `parts.FORMATS`: .mcap, .db3 and folders of bags, .csv and other text tables
    (packed, too), .npy, .npz, .mat, .hdf5, .parquet, LeRobot folders, folders of one CSV a topic.

    `columns` maps the columns of foreign files; on our own files it selects, renames and states what is missing.
    `recover` skips damaged parts of a file instead of refusing it; a file cut short is always read to the cut.
    What was assumed or changed is in each recording's metadata["notes"].

    Raises RecordingError for a file that cannot be read, ChannelError for a column that is not there.
    """
    path, columns = _path(path), _columns(columns)
    if columns.segment_by:
        whole = read(path, with_labels(columns), recover=recover)
        return tuple(piece for recording in whole for piece in segments(recording, columns.segment_by))
    try:
        return _of_folder(path, columns, recover) if path.is_dir() else _of_file(path, columns, recover)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except MemoryError:
        raise RecordingError(f"{path}: it takes more memory than there is: cut it into takes") from None


def _path(path: str | Path) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise ParameterError(f"the path is {given(path)}; allowed: a path, as text or pathlib.Path; one file at a time")
    return Path(path)


def _columns(columns: Columns | None) -> Columns:
    if columns is not None and not isinstance(columns, Columns):
        raise ParameterError(f"columns is {given(columns)}; allowed: Columns(position='z', force='Fz', ...)")
    return columns or Columns()


def _of_folder(path: Path, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    for form in FORMATS:
        if any(next(path.glob(mark), None) for mark in form.marks):
            return tuple(form.reader()(path, None, columns, recover))
    known = ", ".join(mark for form in FORMATS for mark in form.marks if not mark.startswith("*"))
    raise RecordingError(
        f"{path}: a directory without .csv files or anything else that is read; a folder holds {known}, or files"
    )


def _of_file(path: Path, columns: Columns, recover: bool) -> tuple[Recording, ...]:
    with path.open("rb") as stream:
        head, data = stream.read(_HEAD), None
    if not head:
        raise RecordingError(f"{path}: no frames: the file is empty")
    if head.startswith(_APPLE_DOUBLE):
        raise RecordingError(f"{path}: macOS's note beside a file (AppleDouble), no recording; leave it out")
    if packing(head):
        data = _unpacked(path)
        head = data[:_HEAD]
    form = format_of(path, head)
    size = path.stat().st_size if data is None else len(data)
    if size > form.limit_mb << 20:
        raise RecordingError(f"{path}: {size >> 20} MB; the limit for {form.name} is {form.limit_mb} MB: cut it into takes")
    if data is not None and not form.whole:
        raise RecordingError(f"{path}: a packed {form.name} file; unpack it first (packed text tables are read)")
    if form.whole and data is None:
        data = path.read_bytes()
    return tuple(form.reader()(path, data, columns, recover))


def _unpacked(path: Path) -> bytes:
    limit = next(form.limit_mb for form in FORMATS if "" in form.suffixes) << 20
    if path.stat().st_size > limit:
        raise RecordingError(f"{path}: {path.stat().st_size >> 20} MB packed; the limit is {limit >> 20} MB: cut it into takes")
    return unpacked(path, path.read_bytes(), limit)


def format_of(path: Path, head: bytes) -> Format:
    """By the first bytes (a file cut within them counts), then by the extension, else text."""
    suffix = inner_suffix(path)
    if suffix == ".mat" and not _is_text(head):  # by any first bytes: version 7.3 is HDF5
        return next(form for form in FORMATS if suffix in form.suffixes)
    for form in FORMATS:
        if any(head.startswith(magic[: len(head)]) and head[0] == magic[0] for magic in form.magic):
            return form
    if head.startswith(b"PK\x03\x04") and suffix == ".npz":
        return next(form for form in FORMATS if suffix in form.suffixes)
    for magic, remedy in _REFUSED.items():
        if head.startswith(magic):
            raise RecordingError(f"{path}: " + (remedy or f"not a recording: starts with {head[:4].hex()}"))
    if suffix == ".db3" and not _is_text(head):
        return next(form for form in FORMATS if suffix in form.suffixes)
    return next(form for form in FORMATS if "" in form.suffixes)


def inner_suffix(path: Path) -> str:
    """The extension, below that of a packer: ".npy" of lift.npy.gz."""
    suffix = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if suffix in (".gz", ".bz2", ".xz", ".zst") else suffix


def _is_text(head: bytes) -> bool:
    """Whether a .mat or .db3 holds a table (save -ascii) rather than its own layout."""
    return not head.translate(None, b"0123456789+-.eEdDnNaAiIfF,; \t\r\n")


def writable() -> dict[str, Format]:
    """Extension -> format, of all that are written."""
    return {suffix: form for form in FORMATS if form.writes for suffix in form.suffixes if suffix}


def write(recording: Recording, path: str | Path) -> None:
    """Stores a recording by the extension of `path`: .mcap (exact to 1 ns in time), .csv, .parquet, .hdf5, .lerobot (exact)."""
    write_all([recording], path)


def write_all(recordings: Sequence[Recording], path: str | Path) -> None:
    """Stores recordings in one file or folder. Raises ParameterError for an extension that is not written, RecordingError for
    recordings that the format cannot hold as they are."""
    path = _path(path)
    wrong = next((r for r in recordings if not isinstance(r, Recording)), None)
    if wrong is not None:
        raise ParameterError(f"got {given(wrong)} to write; allowed: a Recording")
    suffix = path.suffix.lower()
    form = writable().get(suffix)
    if form is None:
        shown = repr(suffix) if suffix else "'a name without extension'"
        raise ParameterError(f"{path}: no format for {shown}; allowed: {', '.join(writable())}")
    try:
        form.writer()(list(recordings), path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None


def only(recordings: Sequence[Recording], path: Path) -> Recording:
    """The one recording that a file of one can hold."""
    if len(recordings) != 1:
        raise ParameterError(f"{path}: {len(recordings)} recordings, and a {path.suffix} file holds one; write them one by one")
    return recordings[0]
