"""Every check that learning makes of recordings, once each, ranked, without stopping at the first.

Where a check refuses a recording, the finding is kept, the remedy that its message names is applied, and the recording is looked
at again: so one look tells all that stands between a file and a skill.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import ComanipError, ComanipWarning
from ..recording import Recording
from .admittance import admittance
from .agreement import check_set
from .demonstration import Demonstration, Preparation, demonstrations
from .faults import kinds_of_axes, period

STOPS, SUSPICIOUS, TOLD = 0, 1, 2  # rank: what learning refuses, what it warns of, what it assumes or does
_FRAGMENT_FRAMES, _FRAGMENT_S = 8, 0.25
_CUT_SPEED = 0.2  # of the peak: a lesson that begins faster than this was cut by the experiment, not by rest
_LATE_S = 0.005


class Finding(NamedTuple):
    """rank (0 refused, 1 suspicious, 2 told), what is the matter, and what would mend it: a flag, or nothing."""

    rank: int
    text: str
    remedy: str = ""


@dataclass(frozen=True, eq=False)
class Checkup:
    """findings, the worst first; the lessons that could be made, with the remedies applied; the preparation that made them."""

    findings: tuple[Finding, ...]
    lessons: tuple[Demonstration, ...]
    preparation: Preparation

    @property
    def remedies(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(f.remedy for f in self.findings if f.remedy))

    @property
    def recognised(self) -> dict[str, str]:
        """Kind -> columns, as the notes say that they were recognised: "position" -> "x,y,z"."""
        notes = (n for lesson in self.lessons for n in lesson.notes)
        found = (match for n in notes if (match := _RECOGNISED.fullmatch(n)))
        return {match[2]: match[1].replace(", ", ",") for match in found}


# words of a refusal -> (flag, field of the preparation that mends it)
_MENDS = (
    ("not finite", "--drop-bad", {"drop_bad": True}),
    (": gap ", "--split-gaps", {"split_gaps": True}),
    ("plausible", "--any-size", {"plausible": None}),
    ("no piece between", "", {"min_frames": 2}),
    ("integrate_position makes one", "--integrate-position", {"integrate_position": True}),
)
# words of a refusal that nothing but another reading of the file mends -> the flag
_READ_AGAIN = (
    (re.compile(r"state time_unit='(\w+)'"), "--time-unit={}"),
    (re.compile(r'time="none" and state rate_hz \(([\d.]+) Hz on average'), "--rate-hz={}"),
)
# what a refused size is taken for -> the flag that says so; where it may be several units, the size alone is let pass
_UNITS = {
    "millimetres? state": "--position-unit=mm",
    "degrees? state position": "--position-unit=deg",
    "millimetres per second? state": "--velocity-unit=mm/s",
    "degrees? state velocity": "--velocity-unit=deg/s",
}
_NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")
_RATE = re.compile(r"is the rate .* right \(([\d.]+) Hz would agree\)")
_RECOGNISED = re.compile(r"(?:columns )?(\S.*) taken as (?:hand\.)?(position|force|velocity)(?:, instead.*)?")
_VELOCITY = "leave out --velocity: it is derived from position"


def checkup(recordings: Sequence[Recording], preparation: Preparation | None = None, *, clocks: bool = True) -> Checkup:
    """What `demonstrations` and `learn` would say of these recordings, and what is seen in the lessons besides.

    `clocks`: also whether force has another clock than motion, which takes ten times as long as everything else.
    """
    chosen = preparation or Preparation()
    found: list[Finding] = []
    lessons: list[Demonstration] = []
    for recording in recordings:
        made, chosen, more = _looked_at(recording, chosen)
        lessons += made
        found += more
    for lesson in lessons:
        found += _of_lesson(lesson, clocks)
    found += _of_set(lessons, chosen.role)
    return Checkup(_once_each(found), tuple(lessons), chosen)


def _once_each(found: Sequence[Finding]) -> tuple[Finding, ...]:
    """The worst first; what differs in nothing but numbers is said once, with how often it was found."""
    alike: dict[str, list[Finding]] = {}
    for finding in sorted(found, key=lambda f: f.rank):
        alike.setdefault(_NUMBER.sub("#", finding.text), []).append(finding)
    kept = [(several[0], len({f.text for f in several}) - 1) for several in alike.values()]
    return tuple(
        one._replace(text=f"{one.text} (and {more} more like it)") if more and one.rank < TOLD else one for one, more in kept
    )


def _looked_at(recording: Recording, chosen: Preparation) -> tuple[tuple[Demonstration, ...], Preparation, list[Finding]]:
    found: list[Finding] = []
    for _ in range(len(_MENDS) + 2):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                lessons = demonstrations([recording], chosen)
            except ComanipError as refused:
                mended = _mended(str(refused), recording, chosen)
                found.append(Finding(STOPS, str(refused), mended[2] if mended else _read_again(str(refused))))
                if mended is None:
                    return (), chosen, found
                recording, chosen = mended[0], mended[1]
                continue
        warned = [str(w.message) for w in caught if issubclass(w.category, ComanipWarning)]
        found += [Finding(SUSPICIOUS, text, _flag_for(text, recording)) for text in warned]
        found += [Finding(TOLD, note) for lesson in lessons for note in lesson.notes if note not in warned]
        return lessons, chosen, found
    return (), chosen, found


def _mended(message: str, recording: Recording, chosen: Preparation) -> tuple[Recording, Preparation, str] | None:
    """(recording, preparation, flag) with which the next check is reached; None where nothing helps."""
    if "leave the velocity out" in message or "d(position)/dt is" in message:
        if "hand.velocity" not in recording:
            return None
        rest = {n: c for n, c in recording.channels.items() if n != "hand.velocity"}
        return Recording(rest, recording.metadata), chosen, _VELOCITY
    for words, flag, change in _MENDS:
        if words in message and any(getattr(chosen, name) != value for name, value in change.items()):
            return recording, replace(chosen, **change), next((f for guess, f in _UNITS.items() if guess in message), flag)
    return None


def _read_again(refusal: str) -> str:
    return next((flag.format(match[1]) for pattern, flag in _READ_AGAIN if (match := pattern.search(refusal))), "")


def _flag_for(warning: str, recording: Recording) -> str:
    """What mends a suspicion; "" where nothing is to be done.

    Where the file has stamps of its own these are believed before a velocity that disagrees: somebody divided by another period.
    """
    if agrees := _RATE.search(warning):
        return _VELOCITY if stamped(recording) else f"--rate-hz={float(agrees[1]):.4g}"
    return "--tare" if "force at rest is" in warning else ""


def stamped(recording: Recording) -> bool:
    """Whether its time is what the file says, and no rate that the caller stated."""
    notes = [str(note) for note in recording.metadata.get("notes", ())]
    return not any(note.startswith(("no stamps: frame i", "the file's stamps are ignored")) for note in notes)


def _of_lesson(lesson: Demonstration, clocks: bool) -> list[Finding]:
    """What `learn` does not look at: pieces too short to teach, cuts through a motion, a force on another clock."""
    found = []
    where = lesson.name
    if len(lesson) <= _FRAGMENT_FRAMES or lesson.duration_s < _FRAGMENT_S:
        found.append(Finding(SUSPICIOUS, f"{where}: {len(lesson)} frames, {lesson.duration_s:.2g} s: a fragment; leave it out"))
        return found
    found += [Finding(SUSPICIOUS, f"{where}: {text}") for text in _cuts(lesson)]
    if clocks and "force" in lesson.signals and (late := _late(lesson)):
        found.append(Finding(SUSPICIOUS, f"{where}: {late}", "doctor-force"))
    return found


def _cuts(lesson: Demonstration) -> list[str]:
    found = []
    for unit, columns in kinds_of_axes(lesson.units.get("velocity", ""), lesson.velocity.shape[1]).items():
        speed = np.linalg.norm(lesson.velocity[:, columns], axis=1)
        few = max(1, min(3, len(speed) // 10))
        for name, end in (("begins", speed[:few].mean()), ("ends", speed[-few:].mean())):
            if end > _CUT_SPEED * speed.max() > 0.0:
                found.append(
                    f"{name} in motion ({end:.3g} {unit}, {100 * end / speed.max():.0f} % of its peak): cut by the experiment"
                )
    return found


def _late(lesson: Demonstration) -> str:
    try:
        law = admittance(lesson)
    except ComanipError:
        return ""
    if not law.offset_known or abs(law.offset.value) < max(_LATE_S, 0.5 * lesson.dt, 3.0 * law.offset.error):
        return ""
    return f"force is stamped {1e3 * law.offset.value:+.1f} ± {1e3 * law.offset.error:.1f} ms late (as {law.terms} explains it)"


def _of_set(lessons: Sequence[Demonstration], role: str | None) -> list[Finding]:
    """Copies, scales, rates and roles; and a lesson far shorter than the others."""
    if len(lessons) < 2:
        return []
    lengths = np.array([lesson.duration_s for lesson in lessons])
    short = [x.name for x, s in zip(lessons, lengths, strict=True) if s < 0.2 * float(np.median(lengths))]
    found = [Finding(SUSPICIOUS, f"{', '.join(short)}: under a fifth of the usual {np.median(lengths):.2g} s")] if short else []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_set(lessons, role=role)
        except ComanipError as refused:
            found.append(Finding(STOPS, str(refused), _common_rate(lessons)))
    return found + [Finding(SUSPICIOUS, str(w.message)) for w in caught]


def _common_rate(lessons: Sequence[Demonstration]) -> str:
    rates = {1.0 / lesson.dt for lesson in lessons}
    return f"--resample-hz={min(rates):.6g}" if len(rates) > 1 else ""


class Stretch(NamedTuple):
    """A stretch of time [s] and what is there: "rest" or "gap"."""

    kind: str
    start_s: float
    stop_s: float


def stretches(recording: Recording) -> list[Stretch]:
    """Rest of the hand and holes in any channel, for a picture."""
    from .faults import gaps
    from .forces import moving_at

    found = []
    for channel in recording.channels.values():
        if len(channel.time) >= 4:
            found += [Stretch("gap", before, after) for _, before, after in gaps(channel)]
    if "hand.position" in recording and len(recording["hand.position"].time) >= 8:
        position = recording["hand.position"]
        still = ~moving_at(position.time, position)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
        least = 0.15 / period(position)
        found += [
            Stretch("rest", float(position.time[a]), float(position.time[b - 1]))
            for a, b in zip(edges[::2], edges[1::2], strict=True)
            if b - a > least
        ]
    return found
