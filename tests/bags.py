"""Bags as other programs write them: rosbag2 folders (rosbags), and single MCAP files message by message (mcap_ros2)."""

from __future__ import annotations

import numpy as np
import pytest

from lifts import minimum_jerk

T0 = 1_700_000_000
ROSBAGS = pytest.importorskip("rosbags.rosbag2")
STORES = pytest.importorskip("rosbags.typesys")
TYPES = STORES.get_typestore(STORES.Stores.ROS2_HUMBLE)


def make(kind, **fields):
    """A message: make("geometry_msgs/msg/Vector3", x=1.0, y=0.0, z=2.0); fields left out are zero."""
    return TYPES.types[kind](**fields)


def vector(x=0.0, y=0.0, z=0.0, kind="Vector3"):
    return make(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=float(z))


def quaternion(w=1.0, x=0.0, y=0.0, z=0.0):
    return make("geometry_msgs/msg/Quaternion", w=float(w), x=float(x), y=float(y), z=float(z))


def header(t, frame="base"):
    ns = round(t * 1e9)
    stamp = make("builtin_interfaces/msg/Time", sec=T0 + ns // 10**9, nanosec=ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose(t, position, turn=(1.0, 0.0, 0.0, 0.0), frame="base"):
    inner = make("geometry_msgs/msg/Pose", position=vector(*position, kind="Point"), orientation=quaternion(*turn))
    return make("geometry_msgs/msg/PoseStamped", header=header(t, frame), pose=inner)


def twist(t, linear, angular=(0.0, 0.0, 0.0), frame="base"):
    inner = make("geometry_msgs/msg/Twist", linear=vector(*linear), angular=vector(*angular))
    return make("geometry_msgs/msg/TwistStamped", header=header(t, frame), twist=inner)


def wrench(t, force, torque=(0.0, 0.0, 0.0), frame="base"):
    inner = make("geometry_msgs/msg/Wrench", force=vector(*force), torque=vector(*torque))
    return make("geometry_msgs/msg/WrenchStamped", header=header(t, frame), wrench=inner)


def transform(t, parent, child, turn):
    inner = make("geometry_msgs/msg/Transform", translation=vector(), rotation=quaternion(*turn))
    return make("geometry_msgs/msg/TransformStamped", header=header(t, parent), child_frame_id=child, transform=inner)


def write_folder(path, messages, plugin="MCAP", version=9):
    """`messages`: (topic, stamp [s since T0], message)."""
    plugin = ROSBAGS.enums.StoragePlugin[plugin] if hasattr(ROSBAGS, "enums") else None
    with ROSBAGS.Writer(path, version=version, storage_plugin=plugin) as bag:
        connections = {}
        for topic, t, message in messages:
            kind = message.__msgtype__
            if (topic, kind) not in connections:
                connections[topic, kind] = bag.add_connection(topic, kind, typestore=TYPES)
            bag.write(connections[topic, kind], T0 * 10**9 + round(t * 1e9), TYPES.serialize_cdr(message, kind))


def lifting(frames=("base", "base", "base"), turn=lambda t: (1.0, 0.0, 0.0, 0.0), force_turn=None, duration=4.0):
    """A lift along z as (topic, t, message): pose 100 Hz, twist 100 Hz, wrench 500 Hz, with 25 N s/m along the motion and a
    torque.

    `force_turn` maps (t, force in base) to what a turned sensor reads.
    """
    found = []
    for i in range(round(duration * 500) + 1):
        t = i / 500
        x, dx, _ = (float(v) for v in minimum_jerk(np.array(t)))
        force = np.array([0.5, -0.25, 25.0 * dx])
        found.append(("/ft", t, wrench(t, force if force_turn is None else force_turn(t, force), (0.1, 0.2, 0.3), frames[0])))
        if i % 5 == 0:
            found.append(("/ee_pose", t, pose(t, (0.5, 0.0, 0.8 + x), turn(t), frames[1])))
            found.append(("/ee_twist", t, twist(t, (0.0, 0.0, dx), frame=frames[2])))
    return found
