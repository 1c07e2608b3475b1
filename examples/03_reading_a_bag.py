"""A ROS 2 bag: pose and wrench come with their own rates and stamps, and are brought to one rate."""

from pathlib import Path

import numpy as np
from mcap_ros2.writer import Writer

from comanip import Columns, demonstrations, read

POSE = """std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w"""
WRENCH = """std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z"""


def header(t: float) -> dict[str, object]:
    return {"stamp": {"sec": int(t), "nanosec": round((t % 1.0) * 1e9)}, "frame_id": "base"}


def record(path: Path) -> None:
    """As `ros2 bag record -s mcap` would: poses at 100 Hz, wrenches at 500 Hz."""
    rng = np.random.default_rng(0)
    with path.open("wb") as stream:
        writer = Writer(stream)
        pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
        wrench = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
        for k in range(2000):
            t, stamp = 0.002 * k, 1_700_000_000_000_000_000 + 2_000_000 * k
            z = 0.85 + 0.3 / (1.0 + np.exp(-4.0 * (t - 2.0)))
            nothing = {"x": 0.0, "y": 0.0, "z": 0.0}
            pull = {"x": 0.0, "y": 0.0, "z": 5.0 * np.exp(-((t - 1.8) ** 2)) + rng.normal(0.0, 0.05)}
            writer.write_message("/ft", wrench, {"header": header(t), "wrench": {"force": pull, "torque": nothing}}, stamp, stamp)
            if k % 5 == 0:
                at = {"position": {"x": 0.5, "y": 0.0, "z": z}, "orientation": {**nothing, "w": 1.0}}
                writer.write_message("/ee_pose", pose, {"header": header(t), "pose": at}, stamp, stamp)
        writer.finish()


path = Path("out/example_bag.mcap")
path.parent.mkdir(exist_ok=True)
record(path)
columns = Columns(position="/ee_pose.pose.position.z", force="/ft.wrench.force.z")
(lesson,) = demonstrations(read(path, columns), rate_hz=100)
print(lesson)
for note in lesson.notes:
    print("-", note)
