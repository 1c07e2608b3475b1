"""A haptic device of your own: `read` gives the handle's velocity, `write` renders force. A script moves this one."""

import numpy as np

from comanip import BeamPlant, HumanFollower, Teleoperation, run
from comanip.interfaces import Array


class Scripted:
    """A handle that goes up by 0.2 m within two seconds, whatever it feels."""

    problem = notice = ""

    def __init__(self) -> None:
        self.reset()

    @property
    def channels(self) -> dict[str, tuple[Array, str]]:
        return {}

    def reset(self) -> None:
        self.time, self.felt_n = 0.0, 0.0

    def read(self, out: Array) -> None:
        s = float(np.clip((self.time - 0.5) / 2.0, 0.0, 1.0))
        out[0] = 0.2 / 2.0 * 30.0 * s**2 * (1.0 - s) ** 2

    def write(self, force: Array, duration: float, power: float = 0.0) -> None:
        self.time += duration
        self.felt_n = max(self.felt_n, abs(float(force[0])))


rng = np.random.default_rng(9)
device = Scripted()
plant = BeamPlant(HumanFollower(rng=rng), start_position=np.array([0.85]), dt=0.01, rng=rng)
recording = run(plant, Teleoperation(device, n_axes=1, dt=plant.dt), duration_s=4.0)
height = recording["hand.position"].values[:, 0]
print(f"the hand rose by {height[-1] - height[0]:.3f} m; the handle rendered at most {device.felt_n:.2f} N")
