"""What the exported C is proved on: people on the exact beam, hands with scenes of forces, and what goes wrong with sensors."""

from __future__ import annotations

import numpy as np

from ..export.controller import Controller
from ..interfaces import Array, Command, Observation
from ..robots.people import plant_of
from ..trials.cases import draw_case

SEEN = ("position", "velocity", "sensor_force")
SCENES = ("lifts", "pulls", "rest", "wall", "lets go", "empty-handed", "shakes", "bump", "stuck", "zero moves", "held fast")


class World:
    """A hand that goes where it is sent, and what pulls at the object, scene by scene. Numbers only: no physics is claimed."""

    def __init__(self, rng: np.random.Generator, made: Controller, path: Array) -> None:
        self.rng, self.dt, self.path, self.d = rng, made.dt, path, len(made.axes)
        felt = made.estimator
        mass = rng.choice([0.0, 0.4, 1.0, 2.0, 3.5])
        self.weight = felt._share * mass * np.array(felt._gravity)
        begins = rng.choice(["start", "start", "start", "along", "beside", "far"])
        row = 0 if begins == "start" else int(rng.integers(len(path)))
        off = {"start": 0.0, "along": 0.01, "beside": 0.05, "far": 0.5}[str(begins)]
        self.hand = path[row] + off * rng.normal(size=self.d)
        self.velocity, self.last = np.zeros(self.d), np.zeros(self.d)
        self.noise = rng.choice([0.0, 1e-6, 0.02, 0.1])
        self.time, self.left = float(rng.choice([0.0, 1e3, -5.0])), 0
        self.offset = np.zeros(self.d)

    def changes(self) -> None:
        """Another scene from the next tick on."""
        self.left = 0

    def _scene(self) -> None:
        rng, d = self.rng, self.d
        self.kind, self.left, self.n = str(rng.choice(SCENES)), int(rng.integers(10, 250)), 0
        if self.kind == "rest" and rng.random() < 0.3:
            self.left = int(rng.integers(300, 1200))  # until a robot that was told nothing offers to lead
        self.pull = rng.choice([0.1, 1.0, 2.5, 8.0, 25.0]) * rng.normal(size=d)
        self.hz, self.stiffness = rng.choice([0.3, 1.0, 3.0, 8.0]), rng.choice([40.0, 200.0, 800.0])
        self.goal, self.held = self.path[-1] + 0.02 * rng.normal(size=d), self.hand.copy()
        self.lasts = rng.uniform(0.8, 3.0)
        self.jump = rng.choice([0.0, 1.0, 3.0, 70.0]) * rng.normal(size=d)

    def _force(self) -> Array:
        """What the partner means [N]."""
        t, turn = self.n * self.dt, np.sin(2.0 * np.pi * self.hz * self.n * self.dt)
        if self.kind == "lifts":
            s = min(t / self.lasts, 1.0)
            place = self.held + (self.goal - self.held) * (s * s * s * (10.0 + s * (-15.0 + 6.0 * s)))
            return np.asarray(self.stiffness * (place - self.hand) - 10.0 * self.velocity)
        if self.kind == "wall":
            return np.asarray(self.stiffness * 5.0 * (self.held - self.hand))
        if self.kind == "lets go":
            return self.weight
        if self.kind in ("rest", "empty-handed", "zero moves"):
            return 0.01 * self.pull * turn
        if self.kind == "bump":
            return np.asarray(self.pull + (self.jump if self.n == 7 else 0.0))
        return np.asarray(self.pull if self.kind in ("stuck", "held fast") else self.pull * turn)

    def sees(self, obs: Observation) -> None:
        if self.left == 0:
            self._scene()
        self.left, self.n = self.left - 1, self.n + 1
        acceleration = (self.velocity - self.last) / self.dt
        if self.kind == "zero moves" and self.n == 12:
            self.offset = self.offset + self.jump / 20.0
        noise = 0.0 if self.kind == "stuck" else self.noise * self.rng.normal(size=self.d)
        obs.time, obs.force_time = self.time, np.nan
        obs.position[:], obs.velocity[:] = self.hand, self.velocity
        obs.sensor_force[:] = self.weight + self._force() - 0.2 * acceleration + self.offset + noise

    def goes(self, command: Command) -> None:
        self.last = self.velocity
        self.velocity = command.velocity.copy() if self.kind != "held fast" else np.zeros(self.d)
        self.hand = self.hand + self.dt * self.velocity
        self.time += self.dt * (self.rng.choice([0.4, 1.3, 2.0, 2.9]) if self.rng.random() < 0.01 else 1.0)


class Living:
    """A person on the exact beam, drawn as `trial` draws them; three in ten misbehave. The same three calls."""

    def __init__(self, rng: np.random.Generator, made: Controller, task: str) -> None:
        self._plant = plant_of("beam", draw_case(made.role, rng, task=task, misbehaving=0.3), made.dt)
        self._plant.reset()
        self._begun = False

    def changes(self) -> None:
        """A person goes on."""

    def sees(self, obs: Observation) -> None:
        if self._begun:
            self._plant.advance()
        self._begun = True
        self._plant.read(obs)

    def goes(self, command: Command) -> None:
        self._plant.write(command)


def spoil(rng: np.random.Generator, obs: Observation, dt: float, bits: bool) -> None:
    """What goes wrong at one tick: something missing, absurd, late, old, said twice; or any 64 bits at all."""
    what, i = rng.integers(8), int(rng.integers(len(obs.position)))
    if bits:
        value = float(np.frombuffer(rng.bytes(8), dtype=np.float64)[0])
        name = rng.choice(["time", "force_time", *SEEN])
        if name in SEEN:
            getattr(obs, name)[i] = value
        else:
            setattr(obs, name, value)
    elif what < 4:
        values = [np.nan, np.inf, -np.inf, 1e7, 61.0, -9.0, 0.0, -0.0, 5e-324, 1e308]
        getattr(obs, str(rng.choice(SEEN)))[i] = rng.choice(values)
    elif what == 4:
        obs.time += dt * rng.choice([-1.0, -0.9999, -1.5, 3.0, 20.0, -100.0])
    elif what == 5:
        obs.force_time = obs.time - rng.choice([0.0, 0.02, 0.049, 0.051, 0.2])
    elif what == 6:
        obs.position[i] += rng.choice([0.01, 0.03, 0.2])
    else:
        obs.sensor_force[:] = np.nan
