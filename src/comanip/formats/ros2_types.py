"""Definitions of the message types that most bags are made of: bags of ROS 2 Humble and older (SQLite) bring none."""

from __future__ import annotations

_XYZ = "float64 x\nfloat64 y\nfloat64 z"
_HEADER = "std_msgs/Header header\n"
_LAYOUT = "std_msgs/MultiArrayLayout layout\n"

DEFINITIONS: dict[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/Bool": "bool data",
    "std_msgs/Float32": "float32 data",
    "std_msgs/Float64": "float64 data",
    **{f"std_msgs/{sign}Int{bits}": f"{sign.lower()}int{bits} data" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float32MultiArray": f"{_LAYOUT}float32[] data",
    "std_msgs/Float64MultiArray": f"{_LAYOUT}float64[] data",
    "std_msgs/Int32MultiArray": f"{_LAYOUT}int32[] data",
    "geometry_msgs/Vector3": _XYZ,
    "geometry_msgs/Point": _XYZ,
    "geometry_msgs/Quaternion": f"{_XYZ}\nfloat64 w",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Accel": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
    "geometry_msgs/PointStamped": f"{_HEADER}Point point",
    "geometry_msgs/Vector3Stamped": f"{_HEADER}Vector3 vector",
    "geometry_msgs/QuaternionStamped": f"{_HEADER}Quaternion quaternion",
    "geometry_msgs/PoseStamped": f"{_HEADER}Pose pose",
    "geometry_msgs/TwistStamped": f"{_HEADER}Twist twist",
    "geometry_msgs/AccelStamped": f"{_HEADER}Accel accel",
    "geometry_msgs/WrenchStamped": f"{_HEADER}Wrench wrench",
    "geometry_msgs/PoseWithCovarianceStamped": f"{_HEADER}PoseWithCovariance pose",
    "geometry_msgs/TwistWithCovarianceStamped": f"{_HEADER}TwistWithCovariance twist",
    "geometry_msgs/TransformStamped": f"{_HEADER}string child_frame_id\nTransform transform",
    "nav_msgs/Odometry": f"{_HEADER}string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/JointState": f"{_HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    "sensor_msgs/Imu": f"{_HEADER}geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}

# (struct, field) -> unit, by REP 103
UNITS: dict[tuple[str, str], str] = {
    ("geometry_msgs/Pose", "position"): "m",
    ("geometry_msgs/Transform", "translation"): "m",
    ("geometry_msgs/PointStamped", "point"): "m",
    ("geometry_msgs/Twist", "linear"): "m/s",
    ("geometry_msgs/Twist", "angular"): "rad/s",
    ("geometry_msgs/Accel", "linear"): "m/s^2",
    ("geometry_msgs/Accel", "angular"): "rad/s^2",
    ("geometry_msgs/Wrench", "force"): "N",
    ("geometry_msgs/Wrench", "torque"): "N m",
    ("sensor_msgs/Imu", "angular_velocity"): "rad/s",
    ("sensor_msgs/Imu", "linear_acceleration"): "m/s^2",
}
