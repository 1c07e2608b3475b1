"""Where results may go: never over what was read, nor over what comanip did not make. Asked before the work begins, not after."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path

from ..errors import ParameterError

# what stands near the beginning or, in a PDF, the end of a file that comanip wrote, by its suffix
_OURS = {
    ".json": (b'"comanip.skill"',),
    ".mcap": (b"\7\0\0\0comanip",),
    ".csv": (b"# comanip recording {",),
    ".png": (b"Software\0comanip",),
    ".svg": (b"<dc:title>comanip</dc:title>",),
    ".pdf": (b"/Creator (comanip)",),
    ".html": (b'name="generator" content="comanip"',),
    **{suffix: (b"ade by comanip",) for suffix in (".c", ".h", ".py", ".cpp", ".hpp", ".xml", ".txt", ".yaml")},  # exports
    ".md": (b"<!-- comanip board -->", b"<!-- made by comanip"),
}
_NEAR_BYTES = 2048


def may_write(targets: Iterable[Path], *, inputs: Sequence[Path] = (), overwrite: bool = False, flag: str = "-o") -> None:
    """Refuses, in one line, targets that are folders, inputs of the same command, or files that something else made.

    overwrite   the user takes the file away himself; a folder stays refused
    """
    for target in targets:
        if target.is_dir():
            raise ParameterError(f"{target}: is a folder; name a file, for example {flag} {target / 'name'}")
        if not target.exists():
            _reachable(target)
        elif not target.is_file():
            raise ParameterError(f"{target}: is no ordinary file; results are written whole or not at all: name another")
        elif not overwrite:
            _not_lost(target, inputs, flag)


def may_draw(picture: Path | None, *, inputs: Sequence[Path] = (), overwrite: bool = False, flag: str = "--plot") -> None:
    """As `may_write` for a picture, which needs matplotlib besides, and a suffix that it knows."""
    if picture is None:
        return
    must_draw(flag)
    if picture.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ParameterError(f"{flag} {picture}: pictures are .png, .svg or .pdf")
    may_write([picture], inputs=inputs, overwrite=overwrite, flag=flag)


def must_draw(what: str) -> None:
    """Says before the work, not after it, that there is nothing to draw with."""
    if find_spec("matplotlib") is None:
        raise ParameterError(f"{what} draws, and matplotlib is absent: pip install 'comanip[plot]'")


def must_store(recording: Path, flag: str = "-o") -> None:
    """Says before the run, not after it, that a recording cannot be stored under that name."""
    if recording.suffix.lower() not in (".mcap", ".csv"):
        raise ParameterError(f"{flag} {recording}: recordings are stored as .mcap or .csv")


def may_fill(folder: Path, names: Iterable[str], *, overwrite: bool = False, flag: str = "-o") -> None:
    """As `may_write` for files in a folder that need not exist yet."""
    if folder.exists() and not folder.is_dir():
        raise ParameterError(f"{folder}: is a file; {flag} names a folder")
    may_write([folder / name for name in names], overwrite=overwrite, flag=flag)


def _reachable(target: Path) -> None:
    parent = next(p for p in target.absolute().parents if p.exists())
    if not parent.is_dir():
        raise ParameterError(f"{target}: {parent} is a file, no folder; name a place in a folder")


def _not_lost(target: Path, inputs: Sequence[Path], flag: str) -> None:
    for given in inputs:
        if given.exists() and (target.samefile(given) or (given.is_dir() and given.resolve() in target.resolve().parents)):
            raise ParameterError(f"{target}: is one of the inputs; name another file with {flag}, or use --overwrite")
    if not is_ours(target):
        raise ParameterError(f"{target}: exists and was not made by comanip; name another file with {flag}, or use --overwrite")


def is_ours(file: Path) -> bool:
    """Whether comanip made this file, so that it may make it again; an empty file is nobody's."""
    with file.open("rb") as stream:
        ends = stream.read(_NEAR_BYTES)
        stream.seek(max(0, file.stat().st_size - _NEAR_BYTES))
        ends += stream.read()
    return not ends or any(mark in ends for mark in _OURS.get(file.suffix.lower(), ()))
