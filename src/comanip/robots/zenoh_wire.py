"""ROS 2 by zenoh, as rmw_zenoh speaks it: no ROS is installed here, and the robot's machine runs
RMW_IMPLEMENTATION=rmw_zenoh_cpp.

    key         <domain>/<topic>/<pkg>::msg::dds_::<Type>_/<RIHS01 hash>
    attachment  sequence number (int64), source timestamp (int64, ns), the publisher's id (16 bytes and their count)
    liveliness  @ros2_lv/<domain>/<session>/<node>/<entity>/NN|MP|MS/%/%/<node>[/<topic>/<type>/<hash>/<qos>], with / as %

Written from rmw_zenoh's published design. Tried between processes of our own; NOT tried against a node of ROS 2: there was none.
"""

from __future__ import annotations

import itertools
import os
import struct
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import zenoh

from ..errors import ParameterError
from .messages import HASHES, dds_name
from .settings import Topic, Wiring
from .wire import Hears

QOS = "2::,1:,:,:,,"  # best effort, volatile, keep the last one: the next sample makes this one old
LISTED_S = 1.0


def key(domain: int, topic: Topic, hashed: str | None = None) -> str:
    """Where a topic travels; any hash with "*"."""
    return f"{domain}/{topic.name.strip('/')}/{dds_name(topic.type)}/{hashed or HASHES[topic.type]}"


def token(domain: int, session: str, node: int, entity: int, kind: str, name: str, topic: Topic | None = None) -> str:
    """The liveliness of a node ("NN"), of a publisher ("MP") or a subscription ("MS") of it."""
    parts: Sequence[Any] = ("@ros2_lv", domain, session, node, entity, kind, "%", "%", name)
    if topic is not None:
        parts = (*parts, topic.name.replace("/", "%"), dds_name(topic.type), HASHES[topic.type], QOS)
    return "/".join(map(str, parts))


class ZenohWire:
    """One session, which is one node of ROS."""

    def __init__(self, wiring: Wiring, node: str) -> None:
        self._domain, self._node = wiring.domain, node
        self._ids, self._kept, self._lock = itertools.count(1), [], threading.Lock()  # type: ignore[var-annotated]
        self._strangers: set[str] = set()
        try:
            self._session = zenoh.open(_config(wiring))
        except zenoh.ZError as error:
            where = ", ".join(wiring.connect or wiring.listen) or "the router on this machine"
            said = str(error).split(" at ")[0]
            raise ParameterError(f"zenoh: {where} cannot be reached ({said}); does rmw_zenohd run there?") from None
        self._name = str(self._session.zid())
        self._declare("NN", 0)

    def _declare(self, kind: str, entity: int, topic: Topic | None = None) -> None:
        at = token(self._domain, self._name, 0, entity, kind, self._node, topic)
        self._kept.append(self._session.liveliness().declare_token(at))

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        right = HASHES[topic.type]

        def heard(sample: Any) -> None:
            hashed = str(sample.key_expr).rsplit("/", 1)[-1]
            if hashed != right and hashed.startswith("RIHS01_"):  # Humble says TypeHashNotSupported
                self._strangers.add(f"{topic.name} is {hashed[:15]}..., not the {topic.type} of {right[:15]}...")
                return
            hears(sample.payload.to_bytes())

        self._kept.append(self._session.declare_subscriber(key(self._domain, topic, "*"), heard))
        self._declare("MS", next(self._ids), topic)

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        publisher = self._session.declare_publisher(
            key(self._domain, topic), congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        self._kept.append(publisher)
        self._declare("MP", next(self._ids), topic)
        numbers, gid = itertools.count(1), bytes([16]) + os.urandom(16)

        def publish(message: bytes) -> None:
            publisher.put(message, attachment=struct.pack("<qq", next(numbers), time.time_ns()) + gid)

        return publish

    def readers(self, topic: Topic) -> int | None:
        pattern = f"@ros2_lv/{self._domain}/*/*/*/MS/*/*/*/{topic.name.replace('/', '%')}/**"
        return len(self._tokens(pattern))

    def seen(self) -> list[str]:
        tokens = self._tokens(f"@ros2_lv/{self._domain}/*/*/*/MP/**")
        return sorted({t.split("/")[9].replace("%", "/") for t in tokens if t.count("/") > 9} | self._strangers)

    def _tokens(self, pattern: str) -> list[str]:
        replies = self._session.liveliness().get(pattern, timeout=LISTED_S)
        return [str(r.ok.key_expr) for r in replies if r.ok is not None]

    def close(self) -> None:
        for one in reversed(self._kept):
            one.undeclare()
        self._session.close()


def _config(wiring: Wiring) -> Any:
    """A peer that goes where it is told, and to the router of this machine where it is told nothing; nothing is scouted."""
    config = zenoh.Config()
    connect = list(wiring.connect) if wiring.connect or wiring.listen else ["tcp/localhost:7447"]
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", str(connect).replace("'", '"'))
    config.insert_json5("listen/endpoints", str(list(wiring.listen)).replace("'", '"'))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "false")
    if wiring.listen:
        return config
    config.insert_json5("connect/timeout_ms", "3000")
    config.insert_json5("connect/exit_on_failure", "true")
    return config
