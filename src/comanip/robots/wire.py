"""How messages travel: bytes under a topic's name and type. Three transports, and one inside this process for tests."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Protocol

from ..errors import ParameterError
from .settings import Topic, Wiring

Hears = Callable[[bytes], None]
_MADE_BY = {
    "zenoh": ("zenoh_wire:ZenohWire", "pip install 'comanip[ros]'"),
    "dds": ("dds_wire:DdsWire", "pip install 'comanip[dds]'"),
    "rclpy": ("rclpy_wire:RclpyWire", "source your ROS 2 first (Jazzy or later: Humble's Python is older than 3.11)"),
}


class Wire(Protocol):
    """Publishes and subscribes. What is heard arrives on a thread of the transport's own."""

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        """Calls `hears` with each message's bytes."""
        ...

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        """What publishes bytes under this topic; it does not wait, and drops what nobody takes."""
        ...

    def readers(self, topic: Topic) -> int | None:
        """How many listen to what was advertised; None where the transport cannot know."""
        ...

    def seen(self) -> list[str]:
        """Topics that others publish, as far as the transport knows, for error messages."""
        ...

    def close(self) -> None: ...


def opened(wiring: Wiring, node: str) -> Wire:
    """The transport asked for. ParameterError says what to install or where nothing answers."""
    module, _, name = _MADE_BY[wiring.transport][0].partition(":")
    try:
        made: Any = getattr(import_module(f"comanip.robots.{module}"), name)
    except ImportError as error:
        raise ParameterError(f"transport {wiring.transport!r} is not here ({error}): {_MADE_BY[wiring.transport][1]}") from None
    wire: Wire = made(wiring, node)
    return wire


class Loopback:
    """A transport inside this process: messages arrive at once, on the thread that sends them."""

    def __init__(self) -> None:
        self._hears: dict[str, list[Hears]] = {}
        self._said: set[str] = set()

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        self._hears.setdefault(topic.name, []).append(hears)

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        self._said.add(topic.name)

        def publish(message: bytes) -> None:
            for hears in self._hears.get(topic.name, ()):
                hears(message)

        return publish

    def readers(self, topic: Topic) -> int | None:
        return len(self._hears.get(topic.name, ()))

    def seen(self) -> list[str]:
        return sorted(self._said)

    def close(self) -> None:
        self._hears.clear()
