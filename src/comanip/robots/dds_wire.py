"""ROS 2 by DDS (Eclipse Cyclone), for machines that keep ROS 2's default middleware: topics under "rt/", types under "dds_".

The bytes are those of the other transports: Cyclone wants classes, which are made of the same definitions. Tried between
processes of our own; NOT tried against a node of ROS 2.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import make_dataclass
from functools import cache
from typing import Any

from cyclonedds.core import DDSException, Listener, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic

from ..errors import ParameterError
from ..formats.ros2 import definition, parsed
from .messages import dds_name
from .settings import Topic, Wiring
from .wire import Hears

_CODES = {
    "bool": bool, "byte": types.uint8, "char": types.uint8, "int8": types.int8, "uint8": types.uint8, "int16": types.int16,
    "uint16": types.uint16, "int32": types.int32, "uint32": types.uint32, "int64": types.int64, "uint64": types.uint64,
    "float32": types.float32, "float64": types.float64, "string": str,
}  # fmt: skip
_QOS = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(1))


@cache
def _class(kind: str) -> Any:
    """The class that Cyclone wants for a common type."""
    fields = parsed(kind, definition(kind) or "")[kind]
    return make_dataclass(
        kind.replace("/", "_"),
        [(name, _typed(of, length)) for name, of, length in fields],
        bases=(IdlStruct,),
        namespace={"__idl_typename__": dds_name(kind).replace("::", ".")},
    )


def _typed(of: str, length: int | None) -> Any:
    one = _CODES.get(of) or _class(of)
    if length is None:
        return one
    made: Any = types
    return made.sequence[one] if length == -1 else made.array[one, length]


class DdsWire:
    """One participant."""

    def __init__(self, wiring: Wiring, node: str) -> None:
        if wiring.connect or wiring.listen:
            raise ParameterError("wire.connect and wire.listen are zenoh's; DDS finds its peers itself (CYCLONEDDS_URI says how)")
        os.environ.setdefault("ROS_DOMAIN_ID", str(wiring.domain))
        try:
            self._participant = DomainParticipant(wiring.domain)
        except DDSException as error:
            raise ParameterError(f"dds: no participant in domain {wiring.domain}: {error}; is there a network?") from None
        self._kept: list[Any] = []
        self._writers: dict[str, Any] = {}
        self._lock = threading.Lock()

    def _topic(self, topic: Topic) -> Any:
        return DdsTopic(self._participant, f"rt/{topic.name.strip('/')}", _class(topic.type), qos=_QOS)

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        class Heard(Listener):
            def on_data_available(self, reader: Any) -> None:
                for sample in reader.take(8):
                    if getattr(sample, "sample_info", None) is None or sample.sample_info.valid_data:
                        hears(sample.serialize())

        self._kept.append(DataReader(self._participant, self._topic(topic), qos=_QOS, listener=Heard()))

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        writer, of = DataWriter(self._participant, self._topic(topic), qos=_QOS), _class(topic.type)
        self._writers[topic.name] = writer

        def publish(message: bytes) -> None:
            writer.write(of.deserialize(message))

        return publish

    def readers(self, topic: Topic) -> int | None:
        return len(self._writers[topic.name].get_matched_subscriptions())

    def seen(self) -> list[str]:
        return []

    def close(self) -> None:
        self._kept.clear()
        self._writers.clear()
        del self._participant
