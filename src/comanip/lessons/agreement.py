"""What several lessons must have in common before one model is learned from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import ChannelError, ParameterError, RecordingError, given
from ..recording import check_role
from .faults import kinds_of_axes, suspect
from .lesson import Demonstration, missing


def take_of(lesson: Demonstration, number: int) -> tuple[str, str]:
    """Which recording a lesson is: its own (`number`), unless it is a fragment of one that was cut at gaps ("lift#0")."""
    name, cut, _ = lesson.name.rpartition("#")
    return (lesson.source, name) if cut else (f"lesson {number}", "")


def to_the_goal(lessons: Sequence[Demonstration], notes: list[str]) -> list[Demonstration]:
    """Of fragments of one recording the one that goes farthest: where the others begin and end is where the recording was cut,
    and no goal. `notes` says so."""
    takes: dict[tuple[str, str], list[Demonstration]] = {}
    for number, lesson in enumerate(lessons):
        takes.setdefault(take_of(lesson, number), []).append(lesson)
    if len(takes) < len(lessons):
        notes.append("fragments: the path to the goal is learned from the piece of each recording that goes farthest")
    return [max(pieces, key=_way_m) for pieces in takes.values()]


def _way_m(lesson: Demonstration) -> float:
    return float(np.linalg.norm(lesson.position - lesson.position[0], axis=1).max())


def require(lessons: Sequence[Demonstration], channels: Iterable[str], *, min_frames: int = 1) -> None:
    """Every lesson has these channels and frames; what `learn` calls first. Raises ChannelError, RecordingError."""
    for lesson in lessons_only(lessons):
        for name in channels:
            if not any(c == name or c.startswith(name + ".") for c in lesson.channels):
                raise ChannelError(missing(name.split(".")[0], lesson.signals, lesson.source or lesson.name, lesson.notes))
        if len(lesson) < min_frames:
            raise RecordingError(f"{lesson.source or lesson.name}: {len(lesson)} frames; needs >= {min_frames}")


def listed(values: Any, kind: type, allowed: str) -> list[Any]:
    """`values` as a list of `kind`, or ParameterError: the mistakes are a path, an array, one value instead of several."""
    wrong = values
    if isinstance(values, Iterable) and not isinstance(values, str | bytes | np.ndarray | Mapping):
        values = list(values)
        wrong = next((x for x in values if not isinstance(x, kind)), None)
        if wrong is None:
            return values
    raise ParameterError(f"got {given(wrong)}; allowed: {allowed}")


def lessons_only(lessons: Any) -> list[Demonstration]:
    """The lessons as a list; ParameterError for anything else."""
    found = listed(lessons, Demonstration, "a list of lessons, as demonstrations(read(path)) gives it")
    if not found:
        raise RecordingError("no lessons; give at least one")
    return found


def check_set(lessons: Sequence[Demonstration], *, role: str | None = None) -> tuple[str, ...]:
    """Do these lessons belong together? Raises on different rates, axes, units or roles; warns of copies and outliers.

    `role` is what lessons that state none are taken to be; one that states another is refused. Returns what it warned of;
    what a lesson's notes say already is not said again.
    """
    check_role(role)
    notes: list[str] = []
    first = (lessons := lessons_only(lessons))[0]
    for lesson in lessons:
        if role and lesson.role and lesson.role != role:
            raise RecordingError(f"{lesson.name}: role {lesson.role!r}, {role!r} was asked for; use lessons of that role")
    for other in lessons[1:]:
        for what, a, b in (
            ("rate", f"{1 / first.dt:g} Hz", f"{1 / other.dt:g} Hz"),
            ("axes", first.axes, other.axes),
            ("role", first.role or role or "not stated", other.role or role or "not stated"),
            ("channels", first.channels, other.channels),
            ("units", dict(first.units), dict(other.units)),
        ):
            if a != b:
                raise RecordingError(f"{other.name}: {what} {b}, while {first.name} has {a}; lessons must agree")
    if role and not all(lesson.role for lesson in lessons):
        notes.append(f"the role is taken to be {role!r}: not every lesson states one")
    known = {note for lesson in lessons for note in lesson.notes}
    for _, message in _suspicions(lessons):
        if message not in known:
            suspect(notes, message)
            known.add(message)
    return tuple(notes)


def few_frames(n_frames: int, n_states: int, n_channels: int) -> list[str]:
    """A word where there is less to learn from than is asked for: twice as many frames a state as its Gaussian has means and a
    covariance to bear is the least that says anything."""
    least = 2 * (n_channels + 1) * n_states
    if n_frames >= least:
        return []
    fits = max(1, n_frames // (2 * (n_channels + 1)))
    notes: list[str] = []
    suspect(
        notes,
        f"{n_frames} frames for {n_states} states of {n_channels} channels; least {least}: covariances would be mostly floor; "
        f"record more, or learn with n_states={fits}",
    )
    return notes


def noted(lessons: Sequence[Demonstration], said: Sequence[str]) -> tuple[Demonstration, ...]:
    """The lessons, each with what `check_set` said of it among its notes, so that learning from them does not say it again."""
    more: dict[int, list[str]] = {}
    for i, message in _suspicions(lessons):
        if message in said and message not in more.setdefault(i, []):
            more[i].append(message)
    return tuple(replace(x, notes=(*x.notes, *more[i])) if i in more else x for i, x in enumerate(lessons))


def _suspicions(lessons: Sequence[Demonstration]) -> list[tuple[int, str]]:
    return [*_copies(lessons), *_out_of_scale(lessons)]


def _copies(lessons: Sequence[Demonstration]) -> list[tuple[int, str]]:
    """(lesson, message) for each one that was there before, under its own or another name."""
    seen: dict[str, str] = {}
    found = []
    for i, lesson in enumerate(lessons):
        if (digest := lesson.sha256) in seen:
            found.append((i, f"{seen[digest]} = {lesson.name}: the same lesson twice"))
        seen.setdefault(digest, lesson.name)
    return found


def _out_of_scale(lessons: Sequence[Demonstration]) -> list[tuple[int, str]]:
    """(lesson, message) for one whose force is some ten or a thousand times the others': it was stored in another unit."""
    found: list[tuple[int, str]] = []
    for name in ("force", "position"):
        if len(lessons) < 3 or name not in lessons[0].signals:
            continue
        spans = np.array([np.ptp(x.signals[name], axis=0) for x in lessons])  # (lessons, d)
        for columns in kinds_of_axes(lessons[0].units.get(name, ""), spans.shape[1]).values():
            sizes = spans[:, columns].max(axis=1)
            typical = float(np.median(sizes))
            for i, size in enumerate(sizes.tolist()):
                if typical > 0.0 and not typical / 7.0 < size < typical * 7.0:
                    found.append((i, f"{lessons[i].name}: {name} spans {size:.3g}, the others {typical:.3g}: another unit?"))
    return found
