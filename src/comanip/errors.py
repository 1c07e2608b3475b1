"""Every error comanip raises on purpose.

A message says what was wrong, what was given, what is allowed and what to try, in one line:
"channel 'hand.forse' is not in this recording; it has: hand.force, hand.position".
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from typing import Any

# Bidirectional marks reorder a line on the screen, so that a name reads as something else; the joiner U+200D belongs to words.
_REORDERS = frozenset("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\ufeff\u2028\u2029\u0085")


def plain(text: object, most: int = 4000) -> str:
    """What came out of a file or a name, as one line of harmless text: for every message, table and page that shows it.

    Line breaks and tabs become blanks; control characters, terminal escapes, bidirectional marks and lone surrogates are shown
    by their code ("\\x1b"). Longer text than `most` characters is cut, and says so. Markup ("[red]", "<b>") is left as it is:
    only the sink knows which markup it would believe.
    """
    line = str(text)
    if not (line.isascii() and line.isprintable()):
        line = "".join(map(_shown, line))
    return line if len(line) <= most else f"{line[:most]}... ({len(line) - most} more characters)"


def _shown(character: str) -> str:
    if character.isprintable() and character not in _REORDERS:
        return character
    if character in "\t\n\v\f\r\x85\u2028\u2029 \u00a0\u202f\u2009":
        return " "
    if unicodedata.category(character) == "Zs" or character == "\u200d" or character == "\u200c":
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class ComanipError(Exception):
    """Base of all errors a user can act on; the command line prints it as one line and exits with 2.

    Names out of files are in most messages, so a message is `plain` wherever it is printed.
    """

    def __str__(self) -> str:
        return plain(super().__str__())


class RecordingError(ComanipError):
    """A file or recording that cannot be read as it is: names file, channel, frame, time and value."""


class ChannelError(ComanipError):
    """A channel name, unit, frame or shape that does not fit; lists what there is."""


class TrainingError(ComanipError):
    """Data from which no model can be learned as asked: too short, constant, not finite."""


class SkillFileError(ComanipError):
    """A skill file that is damaged, foreign, newer than this program, or not what was asked for."""


class MismatchError(ComanipError):
    """A skill that was learned for another robot: other channels, units, axes, role or control period."""


class ParameterError(ComanipError):
    """A parameter outside what is allowed."""


class BackendError(ComanipError):
    """A cluster that was asked for and cannot be used: absent, unreachable, or of another version."""


class InternalError(ComanipError):
    """A law of the method was broken (for example a likelihood that fell): a defect of comanip, please report it."""


class ComanipWarning(UserWarning):
    """Something was suspicious, or was changed: said, never silent."""


def given(value: Any) -> str:
    """A wrong argument as an error shows it: short, in one line, with its type."""
    shape = getattr(value, "shape", None)
    kind = type(value).__name__
    return f"{kind} of shape {shape}" if isinstance(shape, tuple) else f"{plain(repr(value), 60)} ({kind})"


def check_generator(rng: Any, name: str = "rng") -> None:
    """ParameterError unless `rng` is a numpy Generator (None is the caller's to allow); the usual mistake is a seed."""
    if not (hasattr(rng, "standard_normal") and hasattr(rng, "integers")):
        seed = rng if isinstance(rng, int) else 0
        raise ParameterError(f"{name} is {given(rng)}; allowed: a numpy Generator, for example numpy.random.default_rng({seed})")


def check_has(part: Any, what: str, names: Iterable[str], socket: str) -> None:
    """ParameterError unless `part` has all of a socket's `names`; a class in place of its instance has none."""
    kind = type(part)  # a property that cannot answer yet is there all the same
    missing = [name for name in names if isinstance(part, type) or not (hasattr(kind, name) or hasattr(part, name))]
    if missing:
        raise ParameterError(f"{what} is {given(part)}; it has no {', '.join(missing)}; {socket} says what a {what} needs")
