"""Whatever runs goes on in its copy, to the last bit, and the two do not touch each other: every part of every socket."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import conformance as c
from comanip import kernels, parts
from comanip.interaction import CausalInteractionForce, TaringInteractionForce
from comanip.interfaces import Command, Observation
from comanip.kernels.copies import Copied
from comanip.people import Course, draw_body
from comanip.plants.beam import BeamPlant
from comanip.safety.envelope import Envelope
from test_conformance import LAWS

WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}
ways = pytest.mark.parametrize("way", WAYS.values(), ids=list(WAYS))
N = 60
LIFT = Course(((0.1, 1.0, (0.3,)),))


@pytest.fixture(scope="module")
def skill(skills):
    return c.skills(skills)


class Bench:
    """A hand that does what it is told and is pulled to and fro; `go_on` gives what was commanded and shown as bytes."""

    def __init__(self, skill):
        self.skill, self.obs, self.command, self.n = skill, Observation(1), Command(1), 0
        self.obs.position[:], self.obs.velocity[:], self.obs.force[:], self.obs.sensor_force[:] = 0.85, 0.0, 0.0, -9.8
        skill.reset(self.obs)

    def go_on(self, ticks, missing=""):
        told = []
        for _ in range(ticks):
            self.obs.time = 0.01 * self.n
            self.obs.force[:] = 3.0 * np.sin(0.05 * self.n)
            self.obs.sensor_force[:] = self.obs.force - 9.8
            if missing and self.n % 7 == 3:
                getattr(self.obs, missing)[:] = np.nan
            self.skill.step(self.obs, self.command)
            told.append([a.tobytes() for a in (*self._commanded(), *self.skill.diagnostics.values())])
            self.obs.position[:], self.obs.velocity[:] = self.command.position, self.command.velocity
            self.n += 1
        return told

    def _commanded(self):
        return self.command.position, self.command.velocity, self.command.acceleration


def goes_on(bench, way, ticks=N):
    """A copy in mid-run, and a copy of the copy, do what the original does, whichever of them goes first."""
    bench.go_on(ticks)
    other = way(bench)
    third = way(other)
    said = other.go_on(ticks)
    assert len({str(tick) for tick in said}) > ticks // 2, "a bench on which something happens"
    assert bench.go_on(ticks) == said
    assert third.go_on(ticks) == said
    said = other.go_on(ticks, "force")
    assert bench.go_on(ticks, "force") == said


@ways
@pytest.mark.parametrize("name", [*c.BASELINES, *LAWS])
def test_a_skill_goes_on_in_its_copy_within_the_envelope_and_without(name, skill, way):
    one = skill[name]()
    goes_on(Bench(one), way)
    if isinstance(one, Envelope):
        goes_on(Bench(one.skill), way)


@ways
def test_an_envelope_that_holds_and_is_armed_again_goes_on_in_its_copy(skill, way):
    bench = Bench(skill["default as follower"]())
    bench.go_on(40)
    bench.obs.position[:] += 0.5
    bench.go_on(2)
    assert bench.skill.mode == "HOLD"
    other = way(bench)
    assert (other.skill.mode, other.skill.reason) == (bench.skill.mode, bench.skill.reason)
    assert bench.skill.rearm(bench.obs) == other.skill.rearm(other.obs)
    assert bench.go_on(N) == other.go_on(N)


class Held:
    """The loop around a plant: the hand moves to and fro."""

    def __init__(self, plant):
        self.plant, self.obs, self.command, self.n = plant, Observation(len(plant.axes)), Command(len(plant.axes)), 0
        plant.reset()

    def go_on(self, ticks, _=""):
        told = []
        for _ in range(ticks):
            self.plant.read(self.obs)
            self.command.velocity[:] = 0.1 * np.sin(0.03 * self.n)
            self.plant.write(self.command)
            shown = [a for a, _ in self.plant.channels.values()]
            told.append([a.tobytes() for a in (self.obs.position, self.obs.velocity, self.obs.sensor_force, *shown)])
            self.plant.advance()
            self.n += 1
        return told


@ways
@pytest.mark.parametrize("name", c.plants())
def test_a_plant_goes_on_in_its_copy(name, way):
    goes_on(Held(c.plants()[name]()), way, 60)


def somebody(kind):
    """A person of this kind on the beam, leading where it can."""
    rng = np.random.default_rng(4)
    body, role = draw_body(rng, load_kg=2.0, axes_gravity=(-9.80665,)), c.KINDS[kind].roles[0]
    course = c.planned(kind, LIFT, rng) if role == "leading" else None
    person = c.make(kind, role=role, course=course, body=body, axes=("z",), rng=rng)
    return BeamPlant(person, start_position=np.array([0.85]), rng=rng)


@pytest.mark.parametrize("kind", [name for name, kind in c.KINDS.items() if not kind.robot])
@ways
def test_everybody_goes_on_in_a_copy_of_the_beam(kind, way):
    goes_on(Held(somebody(kind)), way, 40)


@ways
@pytest.mark.parametrize("name", c.PARTNERS)
def test_a_partner_goes_on_in_its_copy_where_nothing_is_compiled(name, way, monkeypatch):
    monkeypatch.setattr(kernels, "native", None)
    goes_on(Held(BeamPlant(c.PARTNERS[name](), rng=np.random.default_rng(1))), way, 40)


FORCES = {
    "known": lambda: CausalInteractionForce(0.01, mass_kg=2.0, gravity=(-9.80665,)),
    "tared": lambda: TaringInteractionForce(0.01, gravity=(-9.80665,), tare_s=0.1),
}


@ways
@pytest.mark.parametrize("name", FORCES)
@pytest.mark.parametrize("before", [3, 40], ids=["in the tare", "after it"])
def test_an_estimate_of_the_force_goes_on_in_its_copy(name, before, way):
    rng, obs, one = np.random.default_rng(1), Observation(1), FORCES[name]()

    def go_on(estimator, rows):
        told = []
        for velocity, force in rows:
            obs.position[:], obs.velocity[:], obs.sensor_force[:] = 0.85, velocity, force
            estimator.step(obs)
            told.append(obs.force.tobytes())
        return told

    rows = np.column_stack([0.001 * rng.standard_normal(80), 10.0 + rng.standard_normal(80)])
    one.reset()
    go_on(one, rows[:before])
    other = way(one)
    assert go_on(other, rows[before:]) == go_on(one, rows[before:])


class Rests:
    mass_kg = 0.5

    def reset(self):
        """Nothing to forget."""

    def force(self, time, position, velocity, felt):
        return [0.2] * len(position)


@ways
@pytest.mark.parametrize("name", parts.DEVICES)
def test_a_device_goes_on_in_its_copy(name, way):
    one = parts.DEVICES[name].load()(Rests(), axes=("z",), moves=np.linspace(0.0, 0.2, 5)[:, None])
    one.reset()

    def go_on(device):
        told = []
        for n in range(40):
            device.read(out := np.zeros(1))
            device.write(np.array([0.1 * np.sin(0.2 * n)]), 0.001)
            told.append([out.tobytes(), *(a.tobytes() for a, _ in device.channels.values())])
        return told

    go_on(one)
    other = way(one)
    assert go_on(other) == go_on(one)


class Windowed(Copied):
    """The smallest part that has a window and something made anew."""

    ANEW = ("made",)

    def __init__(self):
        self.memory = np.arange(6.0)
        self.rows, self.last = self.memory[:4].reshape(2, 2), self.memory[-1:]
        self.shown = {"first": (self.rows[0], "m")}
        self._link()

    def _link(self):
        self.made = memoryview(self.memory)


@pytest.mark.parametrize("way", [*WAYS.values(), copy.copy])
def test_windows_stay_windows_and_are_the_copys_own(way):
    one = Windowed()
    other = way(way(one))
    other.memory[:] = 7.0
    assert (other.rows == 7.0).all()
    assert other.last[0] == other.shown["first"][0][0] == other.made[5] == 7.0
    assert one.memory.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
