"""A skill of your own inside the safety envelope: whatever it commands, the hand stays within the limits."""

import numpy as np

from comanip import BeamPlant, Envelope, HumanLeader, Limits, TaringInteractionForce, run
from comanip.interfaces import Array, Command, Observation


class Eager:
    """Goes ten times too fast where it is pulled."""

    stop_reason = notice = ""
    diagnostics: dict[str, Array] = {}  # noqa: RUF012

    def reset(self, obs: Observation) -> None:
        """Nothing is remembered."""

    def step(self, obs: Observation, command: Command) -> None:
        command.velocity[:] = 0.5 * np.nan_to_num(obs.force)
        command.position[:] = obs.position


rng = np.random.default_rng(8)
plant = BeamPlant(HumanLeader(rng=rng), start_position=np.array([0.85]), rng=rng)
skill = Envelope(Eager(), axes=plant.axes, dt=plant.dt, limits=Limits(v_max_m_per_s=0.25, workspace_m=((0.7, 1.1),)))
recording = run(plant, skill, duration_s=6.0, estimator=TaringInteractionForce(plant.dt, gravity=[-9.80665]))
height = recording["hand.position"].values[:, 0]
speed = np.abs(recording["command.velocity"].values).max()
print(f"highest speed {speed:.3f} m/s (limit 0.25), highest place {height.max():.3f} m (wall 1.1); {skill.mode} {skill.reason}")
