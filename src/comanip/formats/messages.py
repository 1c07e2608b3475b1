"""Topics of messages, from whatever file they were stored in, as channels: "/ft.wrench.force" has the axes x, y, z.

Units are stated where the struct that holds the numbers says them (geometry_msgs, SI by REP 103), frames where a header is around
them. Stamps come from the headers, unless these are absent or stand still, or the log's are asked for (time="log").
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError, RecordingError
from ..interfaces import Array
from ..recording import Channel, Recording
from .events import EVENTS, coded
from .ros2 import Block, Decoder, Shape, frame_of, leaves, plain, table, values
from .ros2_types import UNITS

CLOCKS = ("header", "log", "publish")


class Message(NamedTuple):
    """One message as it was stored; times [ns]."""

    log: int
    publish: int
    sequence: int
    data: bytes


@dataclass
class Topic:
    """Messages of one type under one name, perhaps of several writers."""

    name: str
    type: str
    definition: str
    messages: list[Message] = field(default_factory=list)


class Transforms(NamedTuple):
    """Turns between frames over time: stamps (n,) [s], quaternions (n, 4) w, x, y, z that turn `child` vectors into `parent`."""

    parent: str
    child: str
    time: Array
    turns: Array


def joined(topics: Iterable[Topic]) -> list[Topic]:
    """One topic per name and type, its messages of all writers together; a name with two types keeps both, apart."""
    found: dict[tuple[str, str], Topic] = {}
    for topic in topics:
        key = topic.name, plain(topic.type)
        if key in found:
            found[key].messages.extend(topic.messages)
        else:
            found[key] = Topic(topic.name, topic.type, topic.definition, list(topic.messages))
    names: dict[str, int] = {}
    for topic in found.values():
        names[topic.name] = names.get(topic.name, 0) + 1
        if names[topic.name] > 1:
            topic.name = f"{topic.name}:{plain(topic.type).rsplit('/', 1)[-1]}"
    return list(found.values())


def recording(path: Path, topics: Sequence[Topic], clock: str | None, notes: list[str]) -> tuple[Recording, list[Transforms]]:
    """Every number of every topic as channels, and the turns of /tf; what is left out is in the notes."""
    if clock not in (None, "none", *CLOCKS):
        raise ParameterError(
            f"{path}: time {clock!r} is no clock of a bag; allowed: {', '.join(CLOCKS)}, or none with a rate (rate_hz=...)"
        )
    channels: dict[str, Channel] = {}
    turns: list[Transforms] = []
    labels: list[str] = []
    marks: list[tuple[float, str]] = []
    for topic in joined(topics):
        if not topic.messages:
            notes.append(f"{topic.name} left out: no messages")
            continue
        _sort(topic, notes)
        try:
            _read(topic, clock, channels, turns, marks, notes)
        except RecordingError as error:
            notes.append(f"{topic.name} left out: {error}")
    if marks:
        channels[EVENTS], labels = coded(sorted(marks, key=lambda mark: mark[0]))
    if not channels and not any(t.messages for t in topics):
        raise RecordingError(f"{path}: no frames: the bag is empty{_left_out(notes)}")
    if not channels:
        raise RecordingError(f"{path}: no message with numbers in it{_left_out(notes)}")
    return Recording(channels, {"notes": notes, **({"events": labels} if labels else {})}), turns


def _left_out(notes: Sequence[str]) -> str:
    return f"; {'; '.join(notes[:8])}" if notes else ""


def _sort(topic: Topic, notes: list[str]) -> None:
    """By log time, as every reader of bags plays them: recorders with several threads write them as they come."""
    stamps = np.array([m.log for m in topic.messages], dtype=np.uint64)
    late = int((stamps[1:] < stamps[:-1]).sum())
    if late:
        topic.messages.sort(key=lambda m: m.log)
        notes.append(f"{topic.name}: {late} messages were not in order of log time: sorted")


def _read(
    topic: Topic,
    clock: str | None,
    channels: dict[str, Channel],
    turns: list[Transforms],
    marks: list[tuple[float, str]],
    notes: list[str],
) -> None:
    decoder = Decoder(topic.type, topic.definition)
    groups = decoder.grouped([m.data for m in topic.messages])
    if decoder.name == "tf2_msgs/TFMessage":
        turns += _turns(topic, groups)
        return
    time = _time(topic, groups, clock, notes)
    if decoder.name == "std_msgs/String":
        marks += [(float(time[i]), shape.texts.get("data", "")) for shape, rows in groups for i in rows]
        return
    if decoder.name in _TURNING:
        turns += _own_turns(topic, groups, time, _TURNING[decoder.name])
    parts = _by_joints(groups) if decoder.name == "sensor_msgs/JointState" else {"": groups}
    for joints, part in parts.items():
        name = f"{topic.name}/{joints}" if joints else topic.name
        found = _channels(name, topic, part, time, notes)
        if not found:
            notes.append(f"{name} left out: its messages hold no numbers of a signal")
        channels.update(found)


Groups = list[tuple[Shape, list[int]]]


def _time(topic: Topic, groups: Groups, clock: str | None, notes: list[str]) -> Array:
    """Stamps (n,) [s] by the clock asked for, or the best there is, and which it was."""
    if clock in ("log", "publish"):
        notes.append(f"{topic.name}: stamps of the {clock}, as asked")
        return np.array([(m.log if clock == "log" else m.publish) / 1e9 for m in topic.messages])
    stamps = _header_stamps(topic, groups)
    still = len(stamps) > 1 and bool((stamps == stamps[0]).all()) and stamps[0] != 0.0
    absent = bool((stamps == 0.0).any())
    if clock == "header" and absent:
        raise RecordingError('time="header" was asked for, and its messages have no stamps; try time="log"')
    if clock == "header" or not (still or absent):
        notes.append(f"{topic.name}: stamps from the headers")
        return stamps
    why = f": its headers stand still at {stamps[0]:.3f} s" if still else ""
    notes.append(f"{topic.name}: stamps from the log{why}")
    return np.array([m.log / 1e9 for m in topic.messages])


def _header_stamps(topic: Topic, groups: Groups) -> Array:
    """(n,) [s]; 0 where a message has none."""
    stamps = np.zeros(len(topic.messages))
    for shape, rows in groups:
        pair = shape.stamp_at("header.stamp")
        if pair:
            block = table(shape, [topic.messages[i].data for i in rows])
            stamps[rows] = values(block, pair[0])[:, 0] + values(block, pair[1])[:, 0] / 1e9
    return stamps


def _by_joints(groups: Groups) -> dict[str, Groups]:
    """Messages of several robots on one topic, apart: by the names of their joints, the first named alone where there is one
    set."""
    parts: dict[tuple[str, ...], Groups] = {}
    for shape, rows in groups:
        names = tuple(text for path, text in shape.texts.items() if path.startswith("name["))
        parts.setdefault(names, []).append((shape, rows))
    if len(parts) == 1:
        return {"": groups}
    return {"+".join(names)[:80] or "unnamed": part for names, part in parts.items()}


def _channels(name: str, topic: Topic, groups: Groups, time: Array, notes: list[str]) -> dict[str, Channel]:
    """Channels of the groups of numbers that all messages have; their rows in the order of the messages."""
    found: dict[str, tuple[tuple[str, ...], str]] = {}
    dropped: set[str] = set()
    for shape, _ in groups:
        here = {group: (axes, unit) for group, axes, unit, _ in _grouped(shape)}
        dropped |= {g for g in found.keys() | here.keys() if g in found and found[g] != here.get(g)}
        dropped |= (here.keys() - found.keys()) if found else set()
        found = {**here, **found}
    notes += [f"{_under(name, g)} left out: its length changes from message to message" for g in sorted(dropped)]
    order = np.argsort(np.concatenate([rows for _, rows in groups]), kind="stable")
    columns: dict[str, list[Array]] = {}
    frames: dict[str, set[str]] = {}
    for shape, rows in groups:
        block = table(shape, [topic.messages[i].data for i in rows])
        for group, _, _, blocks in _grouped(shape):
            if group not in dropped:
                columns.setdefault(group, []).append(np.hstack([values(block, b) for b in blocks]))
                frames.setdefault(group, set()).add(frame_of(shape, group))
    at = np.sort(np.concatenate([rows for _, rows in groups]))
    return {
        _under(name, g): Channel(time[at], np.concatenate(parts)[order], found[g][1], _frame(frames[g]), found[g][0])
        for g, parts in columns.items()
    }


def _frame(frames: set[str]) -> str:
    """The one frame; several, joined by " | ", are no frame that anything else is in."""
    return " | ".join(sorted(frames))


def _under(topic: str, group: str) -> str:
    return f"{topic}.{group}" if group else topic


def _grouped(shape: Shape) -> list[tuple[str, tuple[str, ...], str, list[Block]]]:
    """(group, axes, unit, blocks) of a shape."""
    singles: dict[str, list[tuple[str, Block]]] = {}
    found: list[tuple[str, tuple[str, ...], str, list[Block]]] = []
    for group, axis, block in leaves(shape):
        if axis:
            singles.setdefault(group, []).append((axis, block))
        else:
            found.append((group, _array_axes(shape, group, block.length or 0), "", [block]))
    for group, pairs in singles.items():
        unit = _unit(shape, group)
        axes, blocks = [a for a, _ in pairs], [b for _, b in pairs]
        if set(axes) == set("wxyz"):  # w first, as everywhere in comanip
            blocks = [dict(pairs)[a] for a in "wxyz"]
            axes = list("wxyz")
        found.append((group, tuple(axes), unit, blocks))
    return found


def _array_axes(shape: Shape, group: str, count: int) -> tuple[str, ...]:
    """Joint names beside an array of as many numbers; else indices."""
    parent = group.rpartition(".")[0]
    names = [text for path, text in shape.texts.items() if path.startswith(f"{parent}.name[".lstrip("."))]
    if len(names) == count and len(set(names)) == count and all(names):
        return tuple(names)
    return tuple(str(i) for i in range(count))


def _unit(shape: Shape, group: str) -> str:
    parent, _, leaf = group.rpartition(".")
    return UNITS.get((shape.types.get(parent, ""), leaf), "")


def _turns(topic: Topic, groups: Groups) -> list[Transforms]:
    """Every transform of a /tf topic, by (parent, child)."""
    found: dict[tuple[str, str], list[tuple[float, Array]]] = {}
    for shape, rows in groups:
        block = table(shape, [topic.messages[i].data for i in rows])
        at = {b.path: b for b in shape.blocks}
        for path in [p for p in shape.types if p.startswith("transforms[") and "." not in p]:
            pair, turn = shape.stamp_at(f"{path}.header.stamp"), [at.get(f"{path}.transform.rotation.{a}") for a in "wxyz"]
            if pair is None or None in turn:
                continue
            stamps = values(block, pair[0])[:, 0] + values(block, pair[1])[:, 0] / 1e9
            quaternions = np.hstack([values(block, b) for b in turn if b])
            key = shape.texts[f"{path}.header.frame_id"].lstrip("/"), shape.texts[f"{path}.child_frame_id"].lstrip("/")
            found.setdefault(key, []).extend(zip(stamps.tolist(), quaternions, strict=True))
    return [_in_order(parent, child, pairs) for (parent, child), pairs in found.items()]


_TURNING = {"geometry_msgs/TransformStamped": "transform.rotation", "nav_msgs/Odometry": "pose.pose.orientation"}


def _own_turns(topic: Topic, groups: Groups, time: Array, where: str) -> list[Transforms]:
    found: dict[tuple[str, str], list[tuple[float, Array]]] = {}
    for shape, rows in groups:
        block = table(shape, [topic.messages[i].data for i in rows])
        at = {b.path: b for b in shape.blocks}
        quaternions = np.hstack([values(block, at[f"{where}.{a}"]) for a in "wxyz"])
        parent = shape.texts["header.frame_id"]
        key = parent.lstrip("/"), (shape.texts["child_frame_id"] or f"child of {parent}").lstrip("/")
        found.setdefault(key, []).extend(zip(time[rows].tolist(), quaternions, strict=True))
    return [_in_order(parent, child, pairs) for (parent, child), pairs in found.items()]


def _in_order(parent: str, child: str, pairs: list[tuple[float, Array]]) -> Transforms:
    pairs = sorted(pairs, key=lambda pair: pair[0])
    return Transforms(parent, child, np.array([t for t, _ in pairs]), np.array([q for _, q in pairs]).reshape(-1, 4))
