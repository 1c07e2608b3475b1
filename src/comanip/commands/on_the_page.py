"""The command lines of page and study, for app.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def page(
    skill: Annotated[list[Path], Parameter(consume_multiple=True)] = [],
    /,
    *,
    task: Annotated[str | None, Parameter(help="What is carried (comanip tasks), or your own .toml; default lift.")] = None,
    study: Annotated[Path | None, Parameter(help="What a study on it compares, .toml (docs/page.md).")] = None,
    port: Annotated[int, Parameter(help="0: any that is free.")] = 0,
) -> None:
    """Serve the page of `export --to page` on 127.0.0.1; without skills, of simulated lessons. Ctrl-C ends it."""
    from . import lifting as command

    command.page(skill, task, study, port)


def study(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    plot: Annotated[Path | None, Parameter(help="Draw the differences into this .png, .svg or .pdf.")] = None,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="Keep every trial as .mcap in this folder.")] = None,
    overwrite: Annotated[bool, Parameter(negative="", help="Write over files that comanip did not make.")] = False,
    json: Annotated[bool, Parameter(name="--json", negative="", help="Print the result as one JSON document.")] = False,
) -> None:
    """Analyse studies done on the page, one file a person: comanip study *.jsonl --plot study.png"""
    from . import studying as command

    command.study(files, plot, out, overwrite, json)
