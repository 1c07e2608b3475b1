"""Text of others, made fit to be shown: a name or a note out of a file is text everywhere, and nothing else.

A file may be called "[red]x", carry a terminal's escape sequence, a tag of HTML, a formula of TeX, or marks that turn the
direction of writing, so that "gpj.exe" reads as "exe.jpg". Whoever shows such text takes it from here: terminal, report, picture.
"""

from __future__ import annotations

import codecs
import html
import unicodedata
from typing import Any, TextIO

# "Cc" control, "Cf" format (direction of writing, joiners, byte order marks), "Cs" lone surrogates of undecodable file names
_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")
_JOINERS = "\u200c\u200d"  # they belong to words of Persian and to emoji, and turn nothing
_BLANKS = str.maketrans("\t\n\r\v\f", "     ")


def plain_text(text: Any) -> str:
    """`text` on one line, in which every character can be seen: what cannot stands as its code, for example \\x1b or \\u202e."""
    line = str(text).translate(_BLANKS)
    if line.isascii() and line.isprintable():
        return line
    return "".join(c if c in _JOINERS or unicodedata.category(c) not in _UNSEEN else _code(c) for c in line)


def for_html(text: Any) -> str:
    """`text` as it may stand between tags and inside attributes."""
    return html.escape(plain_text(text))


def for_drawing(text: Any) -> str:
    """`text` as matplotlib shows it letter by letter: no formulas, and nothing that a legend takes for "leave me out"."""
    line = plain_text(text).replace("$", r"\$")
    return f" {line}" if line.startswith("_") else line


def _code(c: str) -> str:
    return c.encode("unicode_escape", "surrogatepass").decode()


# our own signs, for an output that has no letters for them: a Windows pipe in cp1252, a log in ASCII
_SPELLED = {
    "∫": "int ", "²": "^2", "°": " deg", "∂": "d", "±": "+-", "·": "*", "×": "x", "−": "-", "–": "-", "—": "-", "…": "...",
    "π": "pi",
    "λ": "lambda", "α": "alpha", "σ": "sigma", "μ": "u", "ξ": "xi", "∞": "inf", "≤": "<=", "≥": ">=", "→": "->", "√": "sqrt",
}  # fmt: skip


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_SPELLED.get(c, "") or _code(c) for c in error.object[error.start : error.end]), error.end


codecs.register_error("comanip.spelled", _spelled)


def never_fails(stream: TextIO) -> None:
    """From now on a letter that this stream's encoding lacks is spelled out; printing it was an error."""
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="comanip.spelled")
