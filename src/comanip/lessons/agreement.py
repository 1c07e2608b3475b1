"""What several lessons must have in common before one model is learned from them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ChannelError, ParameterError, RecordingError
from .faults import suspect

if TYPE_CHECKING:
    from .demonstration import Demonstration


ROLES = ("leader", "follower", "natural")  # what a hand may have been taught; natural: nobody was told a role


def check_role(role: str | None) -> None:
    """Raises ParameterError for a role that nobody can have; None and "" say that none is stated."""
    if role and role not in ROLES:
        raise ParameterError(f"role {role!r} is unknown; roles are: {', '.join(ROLES)}")


def missing(name: str, signals: Iterable[str], where: str) -> str:
    hint = "; learn without force: position and velocity only" if name == "force" else ""
    return f"{where}: no {name!r}; found {', '.join(signals) or 'nothing'}{hint}"


def require(lessons: Sequence[Demonstration], channels: Iterable[str], *, min_frames: int = 1) -> None:
    """Every lesson has these channels and frames; what `learn` calls first. Raises ChannelError, RecordingError."""
    for lesson in lessons:
        for name in channels:
            if not any(c == name or c.startswith(name + ".") for c in lesson.channels):
                raise ChannelError(missing(name.split(".")[0], lesson.signals, lesson.source or lesson.name))
        if len(lesson) < min_frames:
            raise RecordingError(f"{lesson.source or lesson.name}: {len(lesson)} frames; needs >= {min_frames}")


def check_set(lessons: Sequence[Demonstration], *, role: str | None = None) -> tuple[str, ...]:
    """Do these lessons belong together? Raises on different rates, axes, units or roles; warns of copies and outliers.

    Returns what it warned of.
    """
    notes: list[str] = []
    first = lessons[0]
    for other in lessons[1:]:
        for what, a, b in (
            ("rate", f"{1 / first.dt:g} Hz", f"{1 / other.dt:g} Hz"),
            ("axes", first.axes, other.axes),
            ("role", first.role or "not stated", other.role or "not stated"),
            ("channels", first.channels, other.channels),
            ("units", dict(first.units), dict(other.units)),
        ):
            if a != b:
                raise RecordingError(f"{other.name}: {what} {b}, while {first.name} has {a}; lessons must agree")
    if role and first.role != role:
        raise RecordingError(f"{first.name}: role {first.role or 'not stated'!r}, {role!r} was asked for")
    seen: dict[str, str] = {}
    for lesson in lessons:
        if (twin := seen.setdefault(lesson.sha256, lesson.name)) != lesson.name or _twice(lessons, lesson):
            suspect(notes, f"{twin} = {lesson.name}: the same lesson twice")
    _check_scale(lessons, notes)
    return tuple(notes)


def _twice(lessons: Sequence[Demonstration], lesson: Demonstration) -> bool:
    """Whether an earlier lesson of the same name holds the same data."""
    earlier = lessons[: next(i for i, other in enumerate(lessons) if other is lesson)]
    return any(other.name == lesson.name and other.sha256 == lesson.sha256 for other in earlier)


def _check_scale(lessons: Sequence[Demonstration], notes: list[str]) -> None:
    """One lesson whose force is some ten or a thousand times the others' was stored in another unit."""
    for name in ("force", "position"):
        if len(lessons) < 3 or name not in lessons[0].signals:
            continue
        sizes = np.array([float(np.ptp(x.signals[name], axis=0).max()) for x in lessons])
        typical = float(np.median(sizes))
        for lesson, size in zip(lessons, sizes.tolist(), strict=True):
            if typical > 0.0 and not typical / 7.0 < size < typical * 7.0:
                suspect(notes, f"{lesson.name}: {name} spans {size:.3g}, the others {typical:.3g}: another unit?")
