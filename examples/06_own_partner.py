"""A partner of your own is two functions; the same laws are tried with it."""

import numpy as np

from comanip import BeamPlant, MassDamper, TaringInteractionForce, demonstrations, learn, make_skill, run, teach
from comanip.interfaces import Array


class Stepper:
    """Lifts by 10 cm, rests for a second, and lifts again: on a spring, with the weight of one end in hand."""

    def reset(self, position: Array) -> None:
        self.start = float(position[0])

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        wanted = sum(0.1 * float(np.clip(time - begin, 0.0, 1.0)) for begin in (1.0, 3.0, 5.0))
        out[0] = 9.80665 + 150.0 * (self.start + wanted - position[0]) - 25.0 * velocity[0]


learned = learn(demonstrations(teach("follower", rng=np.random.default_rng(0)), rate_hz=100))
laws = {
    "what was learned": lambda: make_skill(learned, axes=("z",), dt=0.01),
    "mass-damper": lambda: MassDamper(n_axes=1, dt=0.01),
}
for name, make in laws.items():
    plant = BeamPlant(Stepper(), start_position=np.array([0.85]), rng=np.random.default_rng(6))
    skill = make()
    recording = run(plant, skill, duration_s=8.0, estimator=TaringInteractionForce(0.01, gravity=[-9.80665]))
    force = recording["hand.true_force"].values[:, 0]
    height = recording["hand.position"].values[:, 0]
    said = getattr(skill, "notice", "") or "no notice"
    print(f"{name:17} lifted {height[-1] - height[0]:.3f} m; effort {np.sum(force**2) * 0.01:.1f} N^2 s; {said}")
