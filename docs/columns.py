"""Docstrings here give arguments as two columns, name and meaning; the site shows them as a list."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROW = re.compile(r"^(?P<name>\S[^:;]{0,40}?) {2,}(?P<text>\S.*)$")


def as_list(text: str) -> str:
    """Markdown of a docstring: each row of two columns an item, lines that go on with it joined to it."""
    lines: list[str] = []
    column = 0  # where the second one begins; 0 outside of a list
    for line in text.splitlines():
        row = ROW.match(line)
        if row:
            lines += [*([] if column else [""]), f"- **{row['name']}**: {row['text']}"]
            column = row.start("text")
        elif column and line[:1].strip() and line[column - 1 : column] == " " and line[column : column + 1].strip():
            lines.append(f"- **{line[:column].strip()}**: {line[column:]}")  # a name as wide as its column
        elif column and line.startswith("    "):
            lines[-1] += " " + line.strip()
        else:
            lines += [*([""] if column and line.strip() else []), line]
            column = 0
    return "\n".join(lines)


class Columns(griffe.Extension):
    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = as_list(obj.docstring.value)
