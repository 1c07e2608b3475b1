"""Which lessons are of one recording, and how they are left out: what was cut from one take is left out together."""

from __future__ import annotations

from collections.abc import Sequence

from ..lessons.demonstration import Demonstration


def takes_of(lessons: Sequence[Demonstration]) -> list[tuple[str, str]]:
    """Which recording each lesson is of: pieces of one that was cut at gaps share theirs."""
    return [_take(lesson, i) for i, lesson in enumerate(lessons)]


def _take(lesson: Demonstration, number: int) -> tuple[str, str]:
    """Which recording a lesson is: its own, unless it is a fragment."""
    name, cut, _ = lesson.name.rpartition("#")
    return (lesson.source, name) if cut else (f"lesson {number}", "")


def folds_of(lessons: Sequence[Demonstration], most: int) -> list[list[int]]:
    """Numbers of the lessons that are left out together, every lesson once, in at most `most` folds; a take in one fold."""
    takes = takes_of(lessons)
    order = list(dict.fromkeys(takes))
    folds = min(most, len(order))
    return [[i for i, take in enumerate(takes) if order.index(take) % folds == f] for f in range(folds)]
