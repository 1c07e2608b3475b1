"""Robots: what stands between a skill and an arm.

    robot.toml -> settings -> plant (ros2, franky, panda-py, a simulated one, your own) -> pre-flight -> the loop

    settings     what robot.toml may say, each error one line with file and key
    arm, hand    the socket of an arm in three dimensions, and the Plant around it: axes, gravity, leash, braking
    wire, ...    ROS 2 messages without ROS: zenoh, DDS, or rclpy where it is sourced
    preflight    what must be true before anything moves
    guard        re-arming, braking, slow start and shadow around a skill
    fake         a robot node for tests: the exact beam and a person behind the same wire
    robot        from a name or a file to something that can be driven

Nobody has tried any of this on a real arm yet: what was tried is said in each module, and in docs/robot.md.
"""
