"""Teach five lessons, learn from them, and lift with a partner who answers. Everything is simulated, to the end."""

import numpy as np

from comanip import BeamPlant, HumanLeader, TaringInteractionForce, demonstrations, learn, make_skill, run, teach

rng = np.random.default_rng(4)
lessons = teach("follower", rng=np.random.default_rng(0))
learned = learn(demonstrations(lessons, rate_hz=100))
print(learned)

plant = BeamPlant(HumanLeader(rng=rng), start_position=np.array([0.85]), rng=rng)
skill = make_skill(learned, axes=plant.axes, dt=plant.dt)
recording = run(plant, skill, duration_s=6.0, estimator=TaringInteractionForce(plant.dt, gravity=[-9.80665]))

height = recording["hand.position"].values[:, 0]
force = recording["hand.true_force"].values[:, 0]
print(f"lifted {height[-1] - height[0]:.3f} m; the partner felt at most {np.abs(force).max():.1f} N")
