"""An arm that says what a test tells it to, and remembers what it was sent."""

from __future__ import annotations

from dataclasses import replace

from comanip.robots.hand import HandPlant
from comanip.robots.settings import Commanding, Topic, load, settings

WRENCH, POSE, TWIST = "geometry_msgs/WrenchStamped", "geometry_msgs/PoseStamped", "geometry_msgs/TwistStamped"


class Still:
    """An arm that rests at a place; a test moves it, or lets it fall silent."""

    joints = ()
    problem = notice = ""

    def __init__(self, clock):
        self.clock, self.sent, self.closed = clock, [], False
        self.position, self.orientation, self.force = (0.1, 0.2, 0.85), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -9.8)
        self.time = None

    def missing(self):
        return ""

    def sense(self, out):
        out.time = out.force_time = self.clock() if self.time is None else self.time
        out.position, out.orientation, out.force = self.position, self.orientation, self.force

    def send(self, velocity, target, orientation, measured):
        self.sent.append((velocity, target, orientation))

    def listener(self):
        return ""

    def close(self):
        self.closed = True


class Clock:
    """Time that passes when somebody sleeps."""

    def __init__(self):
        self.now = 5.0

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


def about(axes=None, **more):
    """Settings of a ROS arm; `more` replaces fields."""
    axes = axes or {"z": [0, 0, 1]}
    content = {
        "adapter": "ros2",
        "axes": axes,
        "topics": {"pose": "/pose", "wrench": "/wrench"},
        "command": {"topic": "/twist"},
        "frames": {"pose": "base", "turns": {"ft": "hand"}},
        "limits": {"speed_m_per_s": 0.5, "walls": {key: [-2.0, 2.0] for key in axes}},
    }
    return replace(settings(content, "robot.toml"), **more)


def hand(**more):
    """(plant, arm, clock) of an arm that is still."""
    clock = Clock()
    arm = Still(clock)
    return HandPlant(arm, about(**more), now=clock, sleep=clock.sleep), arm, clock


def commanding(kind, **more):
    types = {"twist": TWIST, "pose": POSE, "wrench": WRENCH}
    return Commanding(topic=Topic("/command", types[kind]), kind=kind, **more)


__all__ = ["about", "commanding", "hand", "load"]
