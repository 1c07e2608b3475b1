"""ROS 2 by rclpy, where a workspace is sourced: one process with the rest of ROS, whatever its middleware.

rclpy comes with ROS and not from PyPI; comanip needs Python 3.11, so Jazzy (3.12) or later. Messages pass as bytes, as on the
other transports. NOT tried: no ROS was there; the functions used are faked in the tests.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

from .settings import Topic, Wiring
from .wire import Hears


def _class(topic: Topic) -> Any:
    package, name = topic.type.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class RclpyWire:
    """One node, spun on a thread of its own."""

    def __init__(self, wiring: Wiring, node: str) -> None:
        self._own = not rclpy.ok()
        if self._own:
            rclpy.init(domain_id=wiring.domain)
        self._node = rclpy.create_node(node)
        self._qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def subscribe(self, topic: Topic, hears: Hears) -> None:
        self._node.create_subscription(_class(topic), topic.name, hears, self._qos, raw=True)

    def advertise(self, topic: Topic) -> Callable[[bytes], None]:
        publish: Callable[[bytes], None] = self._node.create_publisher(_class(topic), topic.name, self._qos).publish
        return publish

    def readers(self, topic: Topic) -> int | None:
        return int(self._node.count_subscribers(topic.name))

    def seen(self) -> list[str]:
        return sorted(name for name, _ in self._node.get_topic_names_and_types())

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join(1.0)
        self._node.destroy_node()
        if self._own:
            rclpy.shutdown()
