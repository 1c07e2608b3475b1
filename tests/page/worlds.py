"""The same lift in the page's WebAssembly and in Python: same skill, same seed, same trace of the pointer."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from comanip.interaction import TaringInteractionForce
from comanip.interfaces import Observation, Skill
from comanip.loop import run
from comanip.page.export import ROBOT
from comanip.page.numbers import EXPECTED_DELAY_S
from comanip.page.person import Hand, Handle, PageNoise, carried_by
from comanip.plants.beam import Beam, BeamPlant, WristSensor
from comanip.recording import Recording
from comanip.tasks import Task
from page.node import array, ran

DT, SEED = 0.01, 7
REPLAY = """
const engine = await Engine.from(fs.readFileSync(given.wasm)), world = new World(engine);
world.set(given.world);
if (given.skill) world.skill(array("numbers"));
world.begin();
keep("rows", world.replay(array("trace")));
"""


class Rearmed:
    """A skill whose user re-arms at the ticks in `at`, before the skill's own step."""

    def __init__(self, skill: Any, at: set[int]) -> None:
        self.skill, self._at, self._n = skill, at, 0
        self.axes, self.dt = skill.axes, skill.dt

    def __getattr__(self, name: str) -> Any:
        return getattr(self.skill, name)

    def reset(self, obs: Observation) -> None:
        self._n = 0
        self._before = None
        self.skill.reset(obs)

    def step(self, obs: Observation, command: Any) -> None:
        if self._n in self._at and self._before is not None:
            self.skill.rearm(self._before)
        self._n += 1
        self.skill.step(obs, command)
        self._before = _copied(obs)


def _copied(obs: Observation) -> Observation:
    kept = Observation(len(obs.position))
    kept.time, kept.force_time = obs.time, obs.force_time
    for name in ("position", "velocity", "sensor_force", "force"):
        getattr(kept, name)[:] = getattr(obs, name)
    return kept


def in_page(
    folder: Path, task: Task, trace: np.ndarray, *, holds: np.ndarray, numbers: np.ndarray | None, seed: int = SEED, **world: Any
) -> dict[str, np.ndarray]:
    """Columns (ticks, d) of the page's rows; mode, tank and reason (ticks,)."""
    d = len(task.axes)
    given = {
        **ROBOT, **asdict(Hand()), "axes": d, "mass_kg": task.carried.mass_kg, "stated_mass_kg": task.carried.mass_kg,
        "length_m": task.carried.length_m, "share": task.carried.share, "seed": seed, "robot": 0 if numbers is not None else 1,
        "holds": 1, "gravity": task.gravity.tolist(), "axial": [float(a == task.carried.along) for a in task.axes],
        "start": task.start.tolist(), **world,
    }  # fmt: skip
    arrays = {"trace": np.column_stack([trace, holds]), **({} if numbers is None else {"numbers": numbers})}
    ran(folder, REPLAY, modules={"engine": "Engine, World"}, arrays=arrays, world=given, skill=numbers is not None)
    rows = array(folder, "rows").reshape(-1, 5 * d + 3)
    names = ("hand.position", "hand.velocity", "hand.sensor_force", "hand.force", "command.velocity")
    found = {name: rows[:, n * d : (n + 1) * d] for n, name in enumerate(names)}
    return {**found, "mode": rows[:, -3], "tank": rows[:, -2], "reason": rows[:, -1]}


def in_python(task: Task, trace: np.ndarray, *, holds: np.ndarray, skill: Skill, seed: int = SEED) -> Recording:
    handle = Handle(trace, carried=carried_by(task.carried.mass_kg, task.gravity, task.carried.share), holds=np.abs(holds))
    plant = BeamPlant(
        handle, beam=Beam(mass_kg=task.carried.mass_kg, length_m=task.carried.length_m), sensor=WristSensor(ROBOT["noise_n"], ROBOT["bias_n"], ROBOT["delay_s"]),
        axes=task.axes, axial=task.carried.along, gravity=task.gravity, dt=DT, start_position=task.start, rng=PageNoise(seed),
    )  # fmt: skip
    estimator = TaringInteractionForce(
        DT,
        gravity=task.gravity.tolist(),
        mass_kg=task.carried.mass_kg,
        load_share=task.carried.share,
        force_delay_s=EXPECTED_DELAY_S + 0.5 * DT,
    )
    return run(plant, skill, duration_s=len(trace) * 1e-3, estimator=estimator)


def wandering(task: Task, seconds: float, rng: np.random.Generator, *, way: np.ndarray) -> np.ndarray:
    """(T, d) of a pointer that goes along `way` (d,) and back, by minimum jerk, every two seconds somewhere else."""
    n = round(1000 * seconds)
    t = np.arange(n) * 1e-3
    places = rng.uniform(-0.05, 1.1, size=int(seconds / 2) + 3)
    places[0] = 0.0
    k = (t / 2).astype(int)
    s = (t - 2 * k) / 2
    u = s**3 * (10 + s * (-15 + 6 * s))
    return task.start + (places[k] + (places[k + 1] - places[k]) * u)[:, None] * way
