"""What every part of a socket has in common; the parts are in `conformance`."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import conformance as c
from comanip import parts
from comanip.formats import read, write
from comanip.interfaces import Command, Observation, Partner, Plant, Skill
from comanip.models import gmm, hmm, hsmm
from comanip.recording import Channel, Recording

LAWS = [f"{law} as {role}" for law, p in parts.LAWS.items() for role in ("leader", "follower", *(["auto"] if p.untold else []))]
LIKELIHOOD = {"Hmm": hmm.log_likelihood, "Hsmm": hsmm.log_likelihood}


@pytest.fixture(scope="module")
def skill(request, skills):
    return c.skills(skills)


def walked(skill, ticks=80, missing=()):
    """Commands and diagnostics of some ticks from a reset; `missing` are names that are NaN in every third tick."""
    obs, command, told = Observation(1), Command(1), []
    for n in range(ticks):
        obs.time, obs.position[:], obs.velocity[:] = 0.01 * n, 0.85 + 1e-3 * n, 0.1
        obs.force[:] = obs.sensor_force[:] = 2.0 * np.sin(0.1 * n)
        if n % 3 == 1:
            for name in missing:
                getattr(obs, name)[:] = np.nan
        if n == 0:
            skill.reset(obs)
        skill.step(obs, command)
        told.append([command.position.copy(), command.velocity.copy(), command.acceleration.copy()])
    return np.array(told)


@pytest.mark.parametrize("name", [*c.BASELINES, *LAWS])
def test_skills(name, skill):
    one = skill[name]()
    assert isinstance(one, Skill)
    assert type(one).__doc__
    first, shapes = walked(one), {n: a.shape for n, a in one.diagnostics.items()}
    assert np.isfinite(first).all()
    assert np.array_equal(first, walked(one)), "two runs from the same reset are equal"
    for missing in ("position", "velocity", "force", "sensor_force"):
        assert np.isfinite(walked(one, missing=(missing,))[:, 1]).all(), missing
    assert np.isfinite(walked(one, missing=("position", "velocity", "force", "sensor_force"))[:, 1]).all()
    assert {n: a.shape for n, a in one.diagnostics.items()} == shapes
    assert np.array_equal(first, walked(one)), "what was missing once is forgotten by a reset"


@pytest.mark.parametrize("name", c.plants())
def test_plants(name):
    plant = c.plants()[name]()
    assert isinstance(plant, Plant)
    assert type(plant).__doc__
    runs, obs, command = [], Observation(1), Command(1)
    for _ in range(2):
        plant.reset()
        rows, shapes = [], {n: a.shape for n, (a, _) in plant.channels.items()}
        for _ in range(60):
            plant.read(obs)
            command.velocity[:] = 0.05
            plant.write(command)
            rows.append([obs.time, *obs.position, *obs.velocity])
            plant.advance()
        assert {n: a.shape for n, (a, _) in plant.channels.items()} == shapes
        runs.append(np.array(rows))
    assert np.isfinite(runs[0]).all()
    assert np.all(np.diff(runs[0][:, 0]) > 0.0)
    assert np.array_equal(runs[0][:, 0], runs[1][:, 0])
    assert np.array_equal(runs[0][0, 1:], runs[1][0, 1:])


@pytest.mark.parametrize("name", c.PARTNERS)
def test_partners(name):
    one = c.PARTNERS[name]()
    assert isinstance(one, Partner)
    assert type(one).__doc__
    out = np.zeros(1)
    for value in (0.85, np.nan):
        one.reset(np.array([0.85]))
        for n in range(50):
            one.force(0.001 * n, np.array([value]), np.zeros(1), out)
        assert np.isfinite(out).all() == np.isfinite(value)


@pytest.mark.parametrize("name", parts.DEVICES)
def test_devices(name):
    class Rests:
        mass_kg = 0.5

        def reset(self):
            """Nothing to forget."""

        def force(self, time, position, velocity, felt):
            return [0.2] * len(position)

    device = parts.DEVICES[name].load()(Rests(), axes=("z",), moves=np.linspace(0.0, 0.2, 5)[:, None])
    runs = []
    for _ in range(2):
        device.reset()
        told = []
        for _ in range(50):
            out = np.zeros(1)
            device.read(out)
            device.write(np.array([0.1]), 0.001)
            told.append(float(out[0]))
        runs.append(told)
    assert np.isfinite(runs[0]).all()
    assert runs[0] == runs[1]
    assert device.problem == ""
    assert {"device.position"} <= set(device.channels)


@pytest.mark.parametrize("form", c.WRITTEN, ids=lambda form: form.name)
def test_formats(form, tmp_path):
    pytest.importorskip("pyarrow")
    pytest.importorskip("h5py")
    time = np.arange(200) * 0.01
    values = np.sin(time)[:, None]
    units = {"hand.position": "m", "hand.velocity": "m/s", "hand.force": "N"}
    recording = Recording({n: Channel(time, values + k, u, ("z",)) for k, (n, u) in enumerate(units.items())}, {"role": "leader"})
    for suffix in form.suffixes:
        if not suffix:
            continue
        write(recording, tmp_path / f"one{suffix}")
        (back,) = read(tmp_path / f"one{suffix}")
        for name, channel in recording.channels.items():
            assert np.array_equal(back[name].values, channel.values), (suffix, name)
            assert np.abs(back[name].time - channel.time).max() < 2e-9
            assert (back[name].unit, back[name].axes) == (channel.unit, channel.axes)
        assert back.metadata["role"] == "leader"


@pytest.mark.parametrize("name", c.MODELS)
def test_models(name):
    """The density of one frame integrates to 1: the mean of p/q over draws of a wider Gaussian q."""
    model = c.MODELS[name]()
    assert type(model).__doc__
    rng = np.random.default_rng(0)
    scale = np.array([0.35, 2.8, 0.35])
    x = np.array([0.1, 0.0, 0.15]) + scale * rng.standard_normal((40_000, 3))
    log_q = -0.5 * (((x - [0.1, 0.0, 0.15]) / scale) ** 2).sum(axis=1) - np.log(scale).sum() - 1.5 * np.log(2 * np.pi)
    known = LIKELIHOOD.get(type(model).__name__)
    log_p = gmm.log_likelihood(model, x) if known is None else known(model, [row[None] for row in x])
    assert np.exp(log_p - log_q).mean() == pytest.approx(1.0, abs=0.03)
    for again in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert all(np.array_equal(getattr(again, a), getattr(model, a)) for a in parts.MODELS[name].arrays)


@pytest.mark.parametrize("name", c.ESTIMATORS)
def test_estimators(name):
    """A filter's weights are a distribution whatever it is told; a reset forgets; a copy in mid-run goes on alike."""
    one = c.ESTIMATORS[name]()
    frames = np.column_stack([np.linspace(0.0, 0.2, 60), np.linspace(1.0, -1.0, 60)])
    bad = frames.copy()
    bad[::3, 0], bad[1::4, 1], bad[30] = np.nan, np.nan, [1e300, -1e300]
    told = []
    for run in (frames, bad, frames):
        one.reset()
        told.append([])
        for row in run:
            one.step(row)
            assert one.weights.sum() == pytest.approx(1.0)
            assert (one.weights >= 0.0).all()
            told[-1].append(one.weights.copy())
    assert np.array_equal(told[0], told[2])
    other = pickle.loads(pickle.dumps(one))
    for row in bad:
        one.step(row)
        other.step(row)
        assert np.array_equal(one.weights, other.weights)
