"""Is the exported C the Python, to the last bit? Living partners, misbehaviour, faults of sensors, arbitrary bit patterns.

    python -m comanip.experiments.export_proof --ticks 1e7 leader.json follower.json

Each run drives the Python in closed loop: a hand that goes where it is sent, with somebody who lifts, holds, lets go, blocks or
shakes, or a sensor that lies. What it saw goes to the C, too. Command, felt force, mode, reason, energy, confidence, phase, blend
must be equal: one bit that differs is a failure. Weights of the model are compared to 1e-9.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..export.c_file import source
from ..export.controller import Controller, controller
from ..export.loaded import Loaded, cmd_type, compiled, obs_type
from ..export.reasons import number_of
from ..interfaces import Array, Command, Observation
from ..learned import file as skill_file

TICKS = 1500  # of one run
SEEN = ("position", "velocity", "sensor_force")
SCENES = ("lifts", "pulls", "rest", "wall", "lets go", "empty-handed", "shakes", "bump", "stuck", "zero moves", "held fast")
KINDS = ("well", "faults", "bits")
WORDS = {"follows": 0, "offers to lead": 1, "leads": 2}


class Told(NamedTuple):
    """What differs first in a run: tick, what, what the Python and the C say."""

    run: int
    tick: int
    what: str
    python: str
    c: str


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

    def _scene(self) -> None:
        rng, d = self.rng, self.d
        self.kind, self.left, self.n = str(rng.choice(SCENES)), int(rng.integers(10, 250)), 0
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


class Taken(NamedTuple):
    """What the Python saw and said in one run, and at which ticks it was asked to run again, with its answer."""

    obs: np.ndarray
    cmd: np.ndarray
    said: tuple[str, ...]
    rearmed: dict[int, str]
    weights: Array


def python_run(made: Controller, rng: np.random.Generator, kind: str, ticks: int = TICKS) -> Taken:
    d, skill, inner = len(made.axes), made.skill, made.skill.skill
    world = World(rng, made, inner._pace.references[0].position)  # type: ignore[attr-defined]
    obs, command = Observation(d), Command(d)
    seen, done, said, rearmed = np.zeros(ticks, obs_type(d)), np.zeros(ticks, cmd_type(d)), [], {}
    with np.errstate(all="ignore"):
        for n in range(ticks):
            world.sees(obs)
            if kind != "well" and rng.random() < (0.02 if n else 0.1):
                spoil(rng, obs, made.dt, kind == "bits")
            seen[n] = (obs.time, obs.force_time, obs.position, obs.velocity, obs.sensor_force)
            if n == 0:
                made.estimator.reset()
            made.estimator.step(obs)
            if n == 0:
                skill.reset(obs)
            skill.step(obs, command)
            _keep(done, n, made, obs, command)
            said.append(skill.reason)
            world.goes(command)
            if skill.mode != "RUN" and rng.random() < 0.03:
                world.left = 0
                rearmed[n] = skill.rearm(obs)
    return Taken(seen, done, tuple(said), rearmed, inner.diagnostics["weights"].copy())


def _keep(done: np.ndarray, n: int, made: Controller, obs: Observation, command: Command) -> None:
    skill: Any = made.skill
    inner = skill.skill
    shown = skill.diagnostics
    row = done[n]
    row["position"], row["velocity"], row["acceleration"] = command.position, command.velocity, command.acceleration
    row["force"], row["tank_j"], row["confidence"] = obs.force, shown["tank"][0], shown["confidence"][0]
    row["phase_s"], row["clock_rate"] = shown["phase"][0], shown["clock_rate"][0]
    row["mode"], row["passes"] = int(shown["mode"][0]), skill.passes
    row["reason"] = _number(skill.reason)
    if inner._complies_only:
        row["acts"] = 3
    else:
        row["acts"] = WORDS[inner._state] if hasattr(inner, "_state") else 2 * (inner.role == "leader")
    row["blend"] = inner._blend[0] if hasattr(inner, "_blend") else float(row["acts"] == 2)


@cache
def _number(said: str) -> int:
    return number_of(said)


def c_run(loaded: Loaded, taken: Taken) -> tuple[np.ndarray, list[int]]:
    """The same observations to the C, asked to run again at the same ticks."""
    loaded.init()
    out, answers, at = np.zeros(len(taken.obs), cmd_type(loaded.d)), [], 0
    for n in [*taken.rearmed, len(taken.obs) - 1]:
        if n + 1 > at:
            out[at : n + 1] = loaded.run(taken.obs[at : n + 1])
        at = n + 1
        if n in taken.rearmed:
            answers.append(loaded.rearm())
    return out, answers[: len(taken.rearmed)]


def differs(run: int, taken: Taken, found: np.ndarray, answers: Sequence[int]) -> Told | None:
    """The first difference, NaN being equal to NaN; None: all is equal."""
    first = len(found), ""
    for name in found.dtype.names or ():
        if name == "reason_value":
            continue
        a, b = taken.cmd[name].reshape(len(found), -1), found[name].reshape(len(found), -1)
        with np.errstate(invalid="ignore"):
            same = ((a == b) | ((a != a) & (b != b))).all(axis=1)
        if not same.all() and (n := int(np.argmin(same))) < first[0]:
            first = n, name
    if first[1]:
        n, name = first
        return Told(run, n, name, f"{taken.cmd[name][n]} {taken.said[n]}", f"{found[name][n]}")
    for (n, said), answer in zip(taken.rearmed.items(), answers, strict=True):
        if _number(said) != answer:
            return Told(run, n, "re-arming", said, str(answer))
    return None


def prove(
    make: Callable[[], Controller], ticks: int, *, seed: int = 0, flags: Sequence[str] = ("-O2",), runs_of: int = TICKS,
    told: Callable[[str], None] = lambda _: None, folder: Path | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Numbers of a proof over so many ticks; `differences` holds the first of each run that has any.

    make   a controller that has never run: one that has remembers where in the task it was
    """
    made = make()
    with tempfile.TemporaryDirectory() as temporary:
        text = source(made)
        loaded = Loaded(compiled(text, folder or Path(temporary), flags=flags), text.h)
        found: list[Told] = []
        done, spent, worst, counts = 0, 0.0, 0.0, Counter[str]()
        for run in _runs():
            if done >= ticks:
                break
            rng = np.random.default_rng((seed, run))
            taken = python_run(make(), rng, KINDS[run % len(KINDS)], runs_of)
            began = time.perf_counter()
            cmd, answers = c_run(loaded, taken)
            spent += time.perf_counter() - began
            if one := differs(run, taken, cmd, answers):
                found.append(one)
            worst = max(worst, float(np.abs(loaded.weights(len(taken.weights)) - taken.weights).max()))
            counts.update(Counter(taken.said))
            counts["re-armed"] += sum(not said for said in taken.rearmed.values())
            done += len(taken.obs)
            if run % 500 == 499:
                told(f"{made.role}, {len(made.axes)} axes: {done} ticks, {len(found)} runs differ")
    return {
        "role": made.role, "axes": len(made.axes), "dt_s": made.dt, "ticks": done,
        "differences": [one._asdict() for one in found],
        "state_bytes": text.state_bytes, "us_a_tick": 1e6 * spent / max(done, 1), "weights_apart": worst,
        "reasons": _by_reason(counts),
    }  # fmt: skip


def _by_reason(counts: Counter[str]) -> dict[str, int]:
    from ..export.c_file import reasons

    names, out = [name for name, _ in reasons()], Counter[str]()
    for said, n in counts.items():
        out["re-armed" if said == "re-armed" else names[_number(said)]] += n
    return dict(out.most_common())


def _runs() -> Iterator[int]:
    run = 0
    while True:
        yield run
        run += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("skills", nargs="+", type=Path, help="of a leader, of a follower, or of both for role auto")
    parser.add_argument("--ticks", type=float, default=1e5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--role")
    parser.add_argument("--dt", type=float, default=0.01)
    parser.add_argument("--flags", default="-O2")
    given = parser.parse_args()
    skills = [skill_file.load(path) for path in given.skills]
    make = partial(controller, skills, role=given.role, dt=given.dt, force_delay_s=0.013)
    said = prove(
        make, int(given.ticks), seed=given.seed, flags=given.flags.split(), told=lambda text: print(text, file=sys.stderr)
    )
    print(json.dumps(said, indent=1))
    sys.exit(1 if said["differences"] else 0)


if __name__ == "__main__":
    main()
