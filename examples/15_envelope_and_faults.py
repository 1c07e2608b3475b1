"""What the envelope does when a sensor fails in mid-lift: it brakes, stays stiff, and says why."""

import numpy as np

from comanip import BeamPlant, HumanLeader, TaringInteractionForce, demonstrations, learn, make_skill, run, teach
from comanip.interfaces import Observation


class Failing(BeamPlant):
    """From 2.5 s on the force sensor says nothing."""

    def read(self, obs: Observation) -> None:
        super().read(obs)
        if self.time > 2.5:
            obs.sensor_force[:] = np.nan


learned = learn(demonstrations(teach("follower", rng=np.random.default_rng(0)), rate_hz=100))
rng = np.random.default_rng(15)
plant = Failing(HumanLeader(rng=rng), start_position=np.array([0.85]), rng=rng)
skill = make_skill(learned, axes=plant.axes, dt=plant.dt)
recording = run(plant, skill, duration_s=5.0, estimator=TaringInteractionForce(plant.dt, gravity=[-9.80665]))
speed = np.abs(recording["command.velocity"].values[:, 0])
print(f"{skill.mode}: {skill.reason}")
print(f"moving until {recording['command.velocity'].time[np.flatnonzero(speed > 1e-3)[-1]]:.2f} s")
