"""board: results of many trials as one table, in markdown or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from ..errors import ParameterError, plain
from ..trials.board import Entry, Row, entries, gathered, grid, why_not
from ..whole_file import write_whole
from .console import print_json
from .outputs import may_write

STYLE = "body{font-family:sans-serif}table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #bbb;padding:.3em}"
MARK = "<!-- comanip board -->"
RANKED = ("place", "law", "score", "worst in", "safe", "effort N²s", "of")
ROWS = (
    "task",
    "role",
    "law",
    "success",
    "95 %",
    "safe",
    "effort N²s",
    "time s",
    "peak N",
    "partners",
    "version",
    "cases",
    "file",
)
HOW = (
    "Score: share of the partners who behave with whom the judge calls the run a success, in the worst task and role. "
    "Safe: of those who misbehave. Rows with the same cases met the same partners."
)


def board(folder: Path, out: Path | None, overwrite: bool, json: bool) -> None:
    if out is not None and out.suffix.lower() not in (".md", ".html"):
        raise ParameterError(f"-o {out}: a board is written as .md or .html")
    if out is not None:
        may_write([out], overwrite=overwrite)
    rows = gathered(folder)
    ranked = entries(rows)
    if json:
        print_json({"entries": [_told(one) for one in ranked], "rows": [_row_told(row) for row in rows]})
        return
    tables = ((RANKED, _ranked(ranked)), _grid(rows), (ROWS, _rows(rows)))
    text = _html(tables) if out is not None and out.suffix.lower() == ".html" else _markdown(tables)
    if out is None:
        print(text)
        return
    write_whole(out, text.encode())
    print(out)


def _told(one: Entry) -> dict[str, Any]:
    low, high = one.worst.interval
    about = {"law": one.law, "score": one.worst.score, "interval": [low, high], "task": one.worst.task, "role": one.worst.role}
    return {**about, "safe": list(one.safe), "ranked": not one.lacks, "lacks": one.lacks}


def _row_told(row: Row) -> dict[str, Any]:
    return {
        **{name: getattr(row, name) for name in ("task", "role", "law", "score", "effort_n2s", "time_s", "peak_n", "source")},
        **{"interval": list(row.interval), "steady": list(row.steady), "safe": list(row.safe), "about": dict(row.made)},
    }


def _ranked(ranked: Sequence[Entry]) -> list[list[str]]:
    rows, place = [], 0
    for one in ranked:
        place += not one.lacks
        low, high = one.worst.interval
        score = f"{100 * one.worst.score:.1f} % ({100 * low:.0f}-{100 * high:.0f})"
        efforts = [row.effort_n2s for row in one.rows if row.effort_n2s is not None]
        effort = f"{sorted(efforts)[len(efforts) // 2]:.3g}" if efforts else "-"
        worst = f"{one.worst.task}, {one.worst.role}"
        rows.append(
            [str(place) if not one.lacks else "-", one.law, score, worst, _of(one.safe), effort, one.lacks or _tried(one)]
        )
    return rows


def _tried(one: Entry) -> str:
    tasks = dict.fromkeys(row.task for row in one.rows)
    return f"{len(tasks)} tasks x {len(one.roles)} roles"


def _grid(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Success of each law in each task and role, with its interval; a dash says why there is none."""
    cells, by_law = grid(rows)
    lines = [
        [law, *(_cell(row, why_not(law, role)) for row, (_, role) in zip(found, cells, strict=True))]
        for law, found in by_law.items()
    ]
    return ["success %", *(f"{task}, {role}" for task, role in cells)], lines


def _cell(row: Row | None, why: str) -> str:
    if row is None:
        return f"- ({why})"
    low, high = row.interval
    return f"{100 * row.score:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def _rows(rows: Sequence[Row]) -> list[list[str]]:
    ordered = sorted(rows, key=lambda row: (row.task, row.role, row.group, -row.score, row.law))
    return [
        [
            row.task,
            row.role,
            row.law,
            f"{100 * row.score:.1f} %",
            f"{100 * row.interval[0]:.0f}-{100 * row.interval[1]:.0f}",
            _of(row.safe),
            *(_shown(value) for value in (row.effort_n2s, row.time_s, row.peak_n)),
            str(row.steady[1] + row.safe[1]),
            str(row.made.get("comanip", "")),
            row.group[:8],
            Path(row.source).name,
        ]
        for row in ordered
    ]


def _of(counted: tuple[int, int]) -> str:
    return f"{counted[0]}/{counted[1]}" if counted[1] else "-"


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _markdown(tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]]) -> str:
    parts = [MARK, HOW]
    for columns, rows in tables:
        lines = [columns, ["---"] * len(columns), *rows]
        parts.append("\n".join("| " + " | ".join(plain(cell).replace("|", "\\|") for cell in line) + " |" for line in lines))
    return "\n\n".join(parts) + "\n"


def _html(tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]]) -> str:
    parts = []
    for columns, rows in tables:
        head = "".join(f"<th>{escape(name)}</th>" for name in columns)
        body = "".join("<tr>" + "".join(f"<td>{escape(plain(cell))}</td>" for cell in row) + "</tr>\n" for row in rows)
        parts.append(f"<table><thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>")
    style = (
        "body{font-family:sans-serif}table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #bbb;padding:.2em .5em}"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="comanip">'
        f"<title>comanip board</title><style>{style}</style></head>\n<body><p>{escape(HOW)}</p>\n"
        + "\n".join(parts)
        + "</body></html>\n"
    )
