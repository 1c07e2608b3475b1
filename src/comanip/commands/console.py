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
    print(_json.dumps(plain(value), indent=1, ensure_ascii=False))


@cache
def say_if_slow() -> None:
    """Before learning, once: that nothing was compiled, for who wonders why it takes so long. Silent when numpy was asked for."""
    if kernels.missing:
        print(f"note: {kernels.missing}", file=sys.stderr)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], *, footer: Sequence[Any] | None = None) -> None:
    """A table on standard output; numbers right-aligned."""
    from rich.console import Console
    from rich.table import Table

    out = Table(title=title, title_justify="left", title_style="bold", show_footer=footer is not None)
    for i, name in enumerate(columns):
        out.add_column(name, justify="left" if i == 0 else "right", footer=str(footer[i]) if footer else "")
    for row in rows:
        out.add_row(*[str(cell) for cell in row])
    width = None if sys.stdout.isatty() else 120
    Console(width=width, highlight=False).print(out)


@contextmanager
def progress(text: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error while it is a terminal; a line at the end otherwise."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        print(f"{text}: done", file=sys.stderr)
        return
    bar = Progress(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"),
                   TimeElapsedColumn(), console=console)  # fmt: skip
    with bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def stages() -> Iterator[Callable[[str, int, int], None]]:
    """As `progress`, for work in several stages: a new bar for each, or a line a stage where nobody watches."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda stage, done, total: print(f"{stage}: {total} files", file=sys.stderr) if done == total else None
        return
    with Progress(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"),
                  TimeElapsedColumn(), console=console) as bar:  # fmt: skip
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage)
            bar.update(tasks[stage], completed=done, total=total)

        yield report
