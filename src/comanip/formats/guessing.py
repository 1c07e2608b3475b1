"""Which columns of a file that nobody described are probably the hand's: from their names, and from what the numbers do.

A guess is only ever shown, as a command to look at and to change: nothing is read by it unasked.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..interfaces import Array
from .columns import TIME_NAMES, unit_in
from .listing import Column

FORCE, TORQUE, VELOCITY, POSITION, TURN, TURN_RATE = "force", "torque", "velocity", "position", "turn", "turn rate"
# what a word of a name says the column is; the first kind with a word wins, so that "force_pos" is no position
_KINDS = {
    "other": "acc accel acceleration ddx ddq jerk norm mag magnitude emg current temp std cov err error quat quaternion qx qy qz "
    "qw q0 orientation seq secs nsecs sec nanosec dt enc power energy btn button gripper plot style plotstyle cap",
    FORCE: "force forces f fx fy fz frc ft wrench load cell loadcell kraft fh fe fext fhuman",
    TORQUE: "torque torques tau effort efforts moment moments mx my mz tx ty tz drehmoment",
    VELOCITY: "velocity velocities vel v vx vy vz speed speeds twist linear dot dx dy dz dq qd xd yd zd xdot ydot zdot lin "
    "linvel geschwindigkeit dp dpx dpy dpz dpos rate angvel",
    TURN: "roll pitch yaw rx ry rz rpy euler rot rotation angle angles theta phi psi joint joints q",
    POSITION: "position positions pos pose poses p px py pz x y z xyz translation point location loc disp displacement height "
    "weg cartesian coord coords",
}
_WORDS = {word: kind for kind, words in _KINDS.items() for word in words.split()}
_UNITS = {FORCE: {"N", "mN", "kN", "gf", "kgf", "lbf"}, TORQUE: {"N m", "mN m"}, VELOCITY: {"m/s", "cm/s", "mm/s"},
          POSITION: {"m", "cm", "mm"}, TURN: {"rad", "deg"}, TURN_RATE: {"rad/s", "deg/s"}}  # fmt: skip
_HINGES = {"knee", "elbow", "shoulder", "wrist", "hip", "ankle"}  # turn, unless the name has an axis: wrist_x is a place
_TURN_RATES = {"dq", "qd", "angvel"}
_ORDER = (*_KINDS, TURN_RATE)
_HAND = set(
    "ee eef tcp tool hand handle effector end object baton ext external user human interaction actual measured comp compensated "
    "filtered filt person".split()
)
_NOT_THE_HAND = set(
    "cmd command commanded desired des ref reference target goal setpoint action actions raw motor base wall res residual head "
    "camera".split()
)
_TURNS_MOST = 9.4  # [rad] one and a half turns: what spans more is in degrees
_LABELS = {"trial", "segment", "seg", "episode", "demo", "repetition", "rep", "task", "target", "block", "run", "take", "lift"}
_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_STILL = 0.02  # of the largest motion in its group: what moves less does not move
_FAMILY = re.compile(r"(.*?[A-Za-z\])])[_. \[]?(\d+)\]?")
_LIKE = 0.9  # correlation of one column with the derivative of another, from which it is its velocity
_LONGEST_STEP_S, _SHORTEST_PIECE = 0.5, 20


class Guess(NamedTuple):
    """Expressions by kind (position, velocity, force), the time column ("" where none is needed), labels that cut the file into
    takes, the rate at which velocity is the derivative of position [Hz] (0 where nothing says it), what it rests on, and the
    unit of angles where the file states none ("" for places)."""

    signals: dict[str, tuple[str, ...]]
    time: str
    labels: tuple[str, ...]
    rate_hz: float
    why: str
    angle: str = ""


class _Group(NamedTuple):
    """Columns of one kind that belong together: axis -> column."""

    kind: str
    stem: frozenset[str]
    clock: str
    axes: dict[str, Column]


def guess(columns: Sequence[Column], *, stamped: bool) -> Guess | None:
    """None where nothing looks like a motion. `stamped`: the file's channels have stamps of their own."""
    columns = _families([c for c in columns if not c.problem and len(c.values) >= 4 and np.isfinite(c.values).any()])
    time = None if stamped else time_column(columns)
    rest = [c for c in columns if time is None or c.name != time.name]
    found, why = _by_name(rest), "by their names"
    rest = rest if time is None or found else [c for c in rest if c.clock == time.clock]
    if not found:
        found, why = _by_numbers(rest), "by what the numbers do"
    if not found:  # LeRobot's name for where a robot is
        found, why = _by_name(rest, states=True), "by their names"
    if not found:
        found, why = _by_order(rest), "by their order alone: nothing says what they are"
    if not found:
        return None
    rate = 0.0 if time is not None or stamped else _rate(found)
    signals = {kind: tuple(c.name for c in several) for kind, several in found.items()}
    return Guess(_shortened(signals, rest), time.name if time else "", labels(rest), rate, why, _angle(found))


def _angle(found: dict[str, list[Column]]) -> str:
    place = found.get(POSITION, [])
    read = [_read(c, [c], False) for c in place if c.place < 0]
    if not read or any(one is None or one[0] != TURN for one in read) or any(c.unit for c in place):
        return ""
    return "deg" if max(_span(c.values) for c in place) > _TURNS_MOST else "rad"


def _families(columns: Sequence[Column]) -> list[Column]:
    """Columns "pose_0", "pose_1", "pose_2" as the entries of one vector."""
    several: dict[str, list[tuple[int, Column]]] = {}
    for column in columns:
        if column.place < 0 and (match := _FAMILY.fullmatch(column.name)):
            several.setdefault(match[1], []).append((int(match[2]), column))
    found: dict[str, Column] = {}
    for name, members in several.items():
        first = min(number for number, _ in members)
        if len(members) > 1 and first <= 1:
            found |= {c.name: c._replace(group=name, place=number - first) for number, c in members}
    return [found.get(c.name, c) for c in columns]


def words_of(name: str) -> list[str]:
    """ "EndEffector_Pos.x [mm]" -> end, effector, pos, x."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", unit_in(name)[0])
    words = [w for w in re.split(r"[^a-z0-9]+", spaced.lower()) if w]
    for i in reversed(range(len(words) - 1)):
        if words[i] == "d" and f"d{words[i + 1]}" in _WORDS:  # dX
            words[i : i + 2] = [f"d{words[i + 1]}"]
    return words


def time_column(columns: Sequence[Column]) -> Column | None:
    """Stamps: a column that only grows, in steps that are alike, under a name that says time; else none."""
    named = set(TIME_NAMES) | {"stamp", "clock", "elapsed", "tout", "zeit", "ms", "us", "ns", "nsec", "secs", "temps", "tiempo",
                                "when", "date", "datetime"}  # fmt: skip
    growing = [c for c in columns if _grows(c.values)]
    hits = [
        c
        for c in columns
        if _grows(c.values, restarts=0.01)
        and named & {*words_of(c.name), "".join(words_of(c.name)), re.sub(r"[^a-z]", "", c.name.lower())}
    ]
    if hits:
        return min(hits, key=lambda c: len(c.name))  # "scope.time" before "env_est2.time"
    nameless = [c for c in growing if c.place == 0 or c.name.isdigit()]  # a table without header begins with its stamps
    return next((c for c in nameless if 0.0 < np.median(np.diff(c.values)) < _LONGEST_STEP_S), None)


def _grows(values: Array, restarts: float = 0.0) -> bool:
    """Whether it only grows, but for a share of `restarts`: takes below each other that each begin at 0."""
    steps = np.diff(values)
    fine = len(steps) > 2 and bool(np.isfinite(steps).all())
    return fine and bool((steps < 0.0).mean() <= restarts and (steps > 0.0).mean() > 0.9)


def _by_name(columns: Sequence[Column], *, states: bool = False) -> dict[str, list[Column]]:
    groups = _groups(columns, states)
    moves, rates = (POSITION, TURN), (VELOCITY, TURN_RATE)
    chosen = _best([g for g in groups if g.kind in moves]) or _best([g for g in groups if g.kind in rates])
    if chosen is None:
        return {}
    axes, turning = _moving(chosen), chosen.kind in (TURN, TURN_RATE)
    wanted = {
        POSITION: [chosen] if chosen.kind in moves else [],
        VELOCITY: [g for g in groups if g.kind == rates[turning]],
        FORCE: [g for g in groups if g.kind == (FORCE, TORQUE)[turning]] or [g for g in groups if g.kind in (FORCE, TORQUE)],
    }
    found: dict[str, list[Column]] = {}
    for kind, several in wanted.items():
        fit = [g for g in several if all(a in g.axes for a in axes)] or [g for g in several if len(g.axes) == len(axes) == 1]
        if best := _best(fit, beside=chosen):
            found[kind] = [best.axes[a] for a in axes] if all(a in best.axes for a in axes) else list(best.axes.values())
    return found if axes else {}


def _span(values: Array) -> float:
    """Of what is finite: a frame that was lost does not stop a hand."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _moving(group: _Group) -> list[str]:
    """Its axes along which something moves."""
    spans = {axis: _span(c.values) for axis, c in group.axes.items()}
    return [axis for axis, span in spans.items() if span > _STILL * max(spans.values())]


def _groups(columns: Sequence[Column], states: bool) -> list[_Group]:
    """Columns with one kind and one stem, by axis; vectors by the place of their entries."""
    vectors: dict[str, list[Column]] = {}
    for column in columns:
        vectors.setdefault(column.group, []).append(column)
    found: dict[tuple[str, frozenset[str], str], _Group] = {}
    for column in columns:
        if (read := _read(column, vectors[column.group] if column.group else [column], states)) is not None:
            kind, axis, stem = read
            group = found.setdefault((kind, stem, column.clock), _Group(kind, stem, column.clock, {}))
            group.axes.setdefault(axis, column)
    return list(found.values())


def _read(column: Column, vector: Sequence[Column], states: bool) -> tuple[str, str, frozenset[str]] | None:
    """(kind, axis, what is left of the name); None for a column that says nothing, or says what it is not."""
    words = [part for word in words_of(column.name) for part in _split(word)]
    kinds = [_WORDS[w] for w in words if w in _WORDS and not w.isdigit()]
    if states and not kinds and "state" in words:
        kinds = [POSITION]
    stem = frozenset(w for w in words if w not in _WORDS and w not in _AXES and not w.isdigit())
    if len(vector) == 16 and (at := _in_matrix(vector)):
        return (POSITION, "xyz"[at.index(column.place)], stem) if column.place in at else None
    kinds = kinds or [kind for kind, units in _UNITS.items() if column.unit in units]
    if not kinds or "other" in kinds:
        return None
    kind = min(kinds, key=_ORDER.index)
    kind = TORQUE if kind == FORCE and kinds[-1] == TORQUE else kind
    own = column.name[len(column.group) :] if column.place >= 0 else column.name
    axis = next((a for w in reversed(words_of(own)) for part in reversed(_split(w)) if (a := _axis(part))), "")
    hinge = not axis and column.place < 0 and not _HINGES.isdisjoint(words)
    turning = hinge or TURN in kinds or not _TURN_RATES.isdisjoint(words)
    kind = {VELOCITY: TURN_RATE, POSITION: TURN}.get(kind, kind) if turning and (hinge or kind == VELOCITY) else kind
    if column.place >= 0 and not axis:
        kind, axis = (kind, f"{column.place}") if turning else _entry(column.place, kind, len(vector))
    return (kind, axis, stem) if kind != "other" else None


def _in_matrix(vector: Sequence[Column]) -> tuple[int, int, int] | None:
    """Where the position stands in 16 numbers that are a turned frame (a row or column of 0, 0, 0, 1)."""
    ends = [tuple(round(float(vector[i].values[0]), 6) for i in places) for places in ((3, 7, 11, 15), (12, 13, 14, 15))]
    for end, at in zip(ends, ((12, 13, 14), (3, 7, 11)), strict=True):
        if end == (0.0, 0.0, 0.0, 1.0):
            return at
    return None


def _split(word: str) -> list[str]:
    """ "tcpfx" is no word: "tcp", "fx"; "pos3" is "pos", "3"."""
    if word in _WORDS or word in _HAND:
        return [word]
    if match := re.fullmatch(r"([a-z]+?)(\d+)", word):
        return [*_split(match[1]), match[2]]
    for head in sorted(_HAND, key=len, reverse=True):
        if word.startswith(head) and word[len(head) :] in _WORDS:
            return [head, word[len(head) :]]
    return [word]


def _axis(word: str) -> str:
    if word in _AXES:
        return word
    return word[-1] if word in _WORDS and len(word) <= 4 and word[-1] in "xyz" and word[:-1] not in ("r", "q") else ""


def _entry(place: int, kind: str, width: int) -> tuple[str, str]:
    """(kind, axis) of an entry that names no axis: of 6, three are along and three about the axes."""
    if width in (6, 7) and kind in (POSITION, VELOCITY, FORCE, TORQUE):
        about = {POSITION: TURN, FORCE: TORQUE, TORQUE: TORQUE}.get(kind, "other")
        return (kind, "xyz"[place]) if place < 3 else (about, "xyz"[(place - 3) % 3])
    return kind, "xyz"[place] if width <= 3 and kind != TURN else f"{place}"


def _best(groups: Sequence[_Group], beside: _Group | None = None) -> _Group | None:
    """The one that moves, sounds like a measured hand, and shares its name with what was chosen already."""

    def score(group: _Group) -> float:
        words = {w for c in group.axes.values() for w in words_of(c.name)}
        points = len(words & _HAND) - 3.0 * len(words & _NOT_THE_HAND)
        points += 1.0 * (group.kind == POSITION) + 0.25 * len(group.axes) * (group.kind != TURN)
        if beside is not None:
            points += (
                2.0 * len(group.stem & beside.stem) - 0.2 * len(group.stem ^ beside.stem) + 0.5 * (group.clock == beside.clock)
            )
        return points

    alive = [g for g in groups if any(_span(c.values) > 0.0 for c in g.axes.values())]
    return max(alive, key=score, default=None)


def _by_numbers(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """Position, its derivative, and a force, from a table whose names do not say it: some columns are the derivatives of others;
    the force is what is called so, or stands behind them."""
    columns = [c for c in columns if _span(c.values) > 0.0 and not {*words_of(c.name)} & _NOT_THE_HAND]
    named = [c for c in columns if FORCE in (_WORDS.get(w) for w in words_of(c.name))]
    columns = [c for c in columns if c not in named]
    pairs = _derivatives(columns)
    if not pairs:
        return {}
    found = {POSITION: [columns[i] for i in pairs], VELOCITY: [columns[j] for j in pairs.values()]}
    left = named or [c for k, c in enumerate(columns) if k not in pairs and k not in pairs.values()]
    if len(left) >= len(pairs):
        found[FORCE] = left[: len(pairs)]
    return found


def _by_order(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """The first column that moves, and the first of the next array, where there are at least two."""
    alive = [c for c in columns if _span(c.values) > 0.0]
    if len(alive) < 2:
        return {}
    force = next(
        (c for c in alive[1:] if len(c.values) == len(alive[0].values) and (not c.group or c.group != alive[0].group)), None
    )
    return {POSITION: alive[:1], **({FORCE: [force]} if force else {})}


def _derivatives(columns: Sequence[Column]) -> dict[int, int]:
    """Position -> its velocity, by number: as many pairs as stand at one distance from each other, the best ones."""
    slopes = [np.gradient(c.values) for c in columns]
    best: tuple[float, dict[int, int]] = (0.0, {})
    for apart in range(1, len(columns)):
        near = range(len(columns) - apart)
        like = {i: abs(_correlation(slopes[i], columns[i + apart].values)) for i in near}
        pairs = {i: i + apart for i in near if like[i] > _LIKE}
        pairs = {i: j for i, j in pairs.items() if i not in pairs.values()}  # no velocity has a velocity
        if apart not in (1, len(pairs)):  # x, y, vx, vy or x, vx, y, vy
            continue
        best = max(best, (sum(like[i] for i in pairs), pairs), key=lambda one: one[0])
    return best[1]


def _correlation(a: Array, b: Array) -> float:
    if len(a) != len(b) or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return 0.0
    a, b = _slow(a), _slow(b)
    spread = float(a.std() * b.std())
    return float(((a - a.mean()) * (b - b.mean())).mean()) / spread if spread > 0.0 else 0.0


def _slow(values: Array) -> Array:
    """A moving mean over nine frames: differences of neighbours are mostly noise."""
    return np.convolve(values, np.ones(9) / 9.0, mode="valid") if len(values) > 40 else values


def _rate(found: dict[str, list[Column]]) -> float:
    """The rate at which velocity is the derivative of position [Hz]; 0 where there is no velocity."""
    pairs = list(zip(found.get(POSITION, ()), found.get(VELOCITY, ()), strict=False))
    parts = [
        (_slow(np.diff(x.values)), _slow(0.5 * (v.values[1:] + v.values[:-1])))
        for x, v in pairs
        if len(x.values) == len(v.values)
    ]
    below = sum(float(dx @ dx) for dx, _ in parts)
    rate = sum(float(v @ dx) for dx, v in parts) / below if below > 0.0 else 0.0
    return float(f"{rate:.3g}") if 1.0 < rate < 1e5 else 0.0


def labels(columns: Sequence[Column]) -> tuple[str, ...]:
    """Columns at whose changes a file of many takes is cut."""
    return tuple(c.name for c in columns if not c.problem and _is_label(c))


def _is_label(column: Column) -> bool:
    """Whole numbers that stay for long and change, under a name that says trial, task, target ..."""
    values = column.values
    if not _LABELS & set(words_of(column.name)) or not np.array_equal(values, np.round(values)):
        return False
    changes = int(np.count_nonzero(np.diff(values)))
    return changes > 0 and len(values) >= _SHORTEST_PIECE * (changes + 1)


def _shortened(signals: dict[str, tuple[str, ...]], columns: Sequence[Column]) -> dict[str, tuple[str, ...]]:
    """A whole array by its own name, where all of its columns are meant."""
    of = {c.name: c for c in columns}
    found = {}
    for kind, names in signals.items():
        group = of[names[0]].group
        whole = tuple(c.name for c in columns if c.group == group) == names
        plain = group and all(c.name.startswith(f"{group}[") for c in columns if c.group == group)
        found[kind] = (group,) if whole and plain and len(names) > 1 else names
    return found
