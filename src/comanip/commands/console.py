"""Printing: results to standard output, progress to standard error."""

from __future__ import annotations

import json as _json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from .. import kernels
from ..evaluation.shown import plain_text
from .ending import was_said
from .flag_words import in_flags


def plain(value: Any) -> Any:
    """JSON-ready: numpy becomes Python, numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_json(value: Any) -> None:
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    print(_json.dumps(plain(value), indent=1, ensure_ascii=not unicode))


@cache
def say_if_slow() -> None:
    """Before learning, once: that nothing was compiled, for who wonders why it takes so long. Silent when numpy was asked for."""
    if kernels.missing:
        note(kernels.missing)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], *, footers: Sequence[Sequence[Any]] = ()) -> None:
    """A table on standard output; numbers right-aligned. What stands in it is text, whatever a file is named."""
    from rich.console import Console
    from rich.table import Table

    out = Table(title=_text(title), title_justify="left", title_style="bold")
    for i, name in enumerate(columns):
        out.add_column(_text(name), justify="left" if i == 0 else "right", overflow="fold")
    for row in rows:
        out.add_row(*[_text(cell) for cell in row])
    if footers:
        out.add_section()
    for row in footers:
        out.add_row(*[_text(cell) for cell in row], style="bold")
    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    with console.capture() as printed:
        console.print(out)
    lines = printed.get().split("\n")
    sys.stdout.write("\n".join(line.rstrip() for line in lines))


def _text(cell: Any) -> Any:
    from rich.text import Text

    return Text(plain_text(cell))


def say(text: str) -> None:
    """A line of the result on standard output."""
    print(plain_text(text))


def note(text: str) -> None:
    """A line about the work on standard error."""
    print(f"note: {plain_text(text)}", file=sys.stderr)


def print_notes(notes: Sequence[str]) -> None:
    """Notes that travel with data or skill, without those that have just been printed as warnings."""
    for one in notes:
        if not was_said(one):
            say(f"note: {in_flags(one)}")


def _bar(console: Any) -> Any:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    shown = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.completed}/{task.total}")
    return Progress(*shown, TimeElapsedColumn(), console=console)


@contextmanager
def progress(text: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error while it is a terminal; a line at the end otherwise."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        print(f"{text}: done", file=sys.stderr)
        return
    bar = _bar(console)
    with bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def stages() -> Iterator[Callable[[str, int, int], None]]:
    """As `progress`, for work in several stages: a new bar for each, or a line a stage where nobody watches."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda stage, done, total: print(f"{stage}: {total} files", file=sys.stderr) if done == total else None
        return
    with _bar(console) as bar:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage)
            bar.update(tasks[stage], completed=done, total=total)

        yield report
