"""A plant of your own: the socket that a real robot fills. Fill what you measure; what stays NaN is missing."""

import numpy as np

from comanip import TaringInteractionForce, demonstrations, learn, make_skill, run, teach
from comanip.interfaces import Array, Command, Observation


class MyRobot:
    """A hand that follows velocity within 30 ms, and a person's hand on a spring at the other side of a 2 kg box."""

    dt, axes, stop_reason = 0.01, ("z",), ""

    def __init__(self) -> None:
        self.reset()

    @property
    def channels(self) -> dict[str, tuple[Array, str]]:
        return {}

    def reset(self) -> None:
        self.time, self.z, self.v, self.wanted = 0.0, 0.85, 0.0, 0.0

    def read(self, obs: Observation) -> None:
        plan = 0.85 + 0.3 * float(np.clip((self.time - 1.0) / 2.5, 0.0, 1.0))
        pull = 120.0 * (plan - self.z) - 20.0 * self.v
        obs.time = self.time
        obs.position[0], obs.velocity[0] = self.z, self.v
        obs.sensor_force[0] = pull - 9.80665  # the wrist feels the weight of its half of the box, too

    def write(self, command: Command) -> None:
        self.wanted = float(command.velocity[0])

    def advance(self) -> None:
        for _ in range(10):
            self.v += 0.001 / 0.03 * (self.wanted - self.v)
            self.z += 0.001 * self.v
        self.time += self.dt


learned = learn(demonstrations(teach("follower", rng=np.random.default_rng(0)), rate_hz=100))
robot = MyRobot()
skill = make_skill(learned, axes=robot.axes, dt=robot.dt)
recording = run(robot, skill, duration_s=6.0, estimator=TaringInteractionForce(robot.dt, gravity=[-9.80665]))
height = recording["hand.position"].values[:, 0]
print(f"carried from {height[0]:.2f} m to {height[-1]:.3f} m; {recording.metadata['stop_reason']}")
