"""The compiled tick of the default law says bit by bit what its readable twin says, and leaves it what is not plain."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.interfaces import Command, Observation
from comanip.models.hmm import Hmm
from comanip.skills import evidence
from comanip.skills.collaborate import CollaborativeLaw, CollaborativeSkill, Watch
from comanip.skills.evidence import RoleEvidence
from comanip.skills.reference import PhaseReference
from comanip.skills.roles import RolePolicy, RoleSkill
from toys import random_hmm, same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
KINDS = ("follower", "leader", "leader who may give way", "told nothing", "told nothing, hears nobody")


def reference(rng, d):
    """There, and sometimes back again."""
    s = np.linspace(-0.1, 1.0, 120).clip(0.0)[:, None]  # ten equal rows: of equally close phases the first
    shape = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    shape = shape if rng.integers(2) else np.sin(np.pi * shape)
    path = shape * rng.uniform(-0.4, 0.4, d)
    ends = path[-1] + rng.normal(scale=0.02, size=(3, d))
    made = PhaseReference(path, 2.0 * np.sin(np.pi * s) * rng.normal(size=d), 0.01, spread=0.004 + 0.01 * s[:, 0] ** 2, ends=ends)
    return made if ends[0, 0] > path[-1, 0] else made.tracked(4.0)


def make(kind, rng, d, dt=0.01, model_dt=0.01, *, deaf=False, policy=RolePolicy(start_patience_s=0.6, midway_patience_s=0.4)):
    groups = ("position", "velocity") if deaf else ("position", "force", "velocity")
    axes = tuple("xyzabcde"[:d])
    p = random_hmm(rng, 4, len(groups) * d)
    model = Hmm(p.initial, p.transition, p.means, p.covariances, tuple(f"{g}.{a}" for g in groups for a in axes))
    table = [reference(rng, d) for _ in range(int(rng.integers(1, 4)))]
    goal = int(rng.integers(len(table))) if rng.integers(2) else None
    if kind in KINDS[:2]:
        return CollaborativeSkill(model, table, role=kind, axes=axes, dt=dt, model_dt=model_dt, goal=goal)
    evidence = None
    if kind == KINDS[3]:
        p = [random_hmm(rng, 3, 3 * d) for _ in range(int(rng.integers(2, 4)))]
        names = tuple(f"{g}.{a}" for g in ("position", "force", "velocity") for a in axes)
        heard = {str(i): Hmm(one.initial, one.transition, one.means, one.covariances, names) for i, one in enumerate(p)}
        evidence = RoleEvidence(heard, dt=model_dt)
    return RoleSkill(
        Watch(model, model_dt, dt), table, leading=CollaborativeLaw.for_role("leader"),
        following=CollaborativeLaw.for_role("follower", shake_hz=3.0, max_acceleration_m_per_s2=4.0), axes=axes, dt=dt,
        leads=kind == KINDS[2], evidence=evidence, policy=policy, goal=goal,
    )  # fmt: skip


def pair(kind, seed, d, **about):
    """Two skills of the same numbers: compiled, and in Python alone."""
    one, other = (make(kind, np.random.default_rng(seed), d, **about) for _ in range(2))
    other._compiled = None
    return one, other


def course(rng, d, n, rough):
    """Positions and forces (n, d) of a hand somewhere near the lessons; rough ones lose samples and jump."""
    time = np.arange(n)[:, None] * 0.01
    x = 0.2 * np.sin(rng.uniform(0.5, 3.0, d) * time) + rng.uniform(-0.1, 0.1, d)
    force = rng.choice([0.2, 2.0, 4.5, 8.0]) * np.sin(rng.uniform(0.5, rng.choice([2.0, 30.0]), d) * time)
    force += 0.1 * rng.normal(size=(n, d)) + rng.choice([0.0, 2.0], d)
    if rough:
        for array in (x, force):
            for value in (np.nan, np.inf, 1e5, 1e7):
                array[rng.integers(1, n, size=2), rng.integers(d, size=2)] = value
    return x, force


def alike(one, other, where):
    """Whatever they remember, not only what they show."""
    for name in ("_memory", "_pace.memory", "_compliance.memory", "_watch.until", "_watch.seen", "_where.memory", "_where.goals"):
        same(attrgetter(name)(one), attrgetter(name)(other), err_msg=f"{name}, tick {where}")
    if foresight := getattr(one, "_foresight", None):
        same(foresight.memory, other._foresight.memory, err_msg=f"foresight, tick {where}")
    np.testing.assert_allclose(one._watch.weights, other._watch.weights, rtol=0.0, atol=1e-10)
    if heard := getattr(one, "evidence", None):
        for name in ("_p", "_until", "probabilities"):
            same(getattr(heard, name), getattr(other.evidence, name), err_msg=f"{name}, tick {where}")
        for a, b in zip(heard._filters, other.evidence._filters, strict=True):
            same(a.weights, b.weights, err_msg=f"tick {where}")
            same(a._state, b._state, err_msg=f"tick {where}")
    assert one.notice == other.notice


@settings(max_examples=45, deadline=None)
@given(st.sampled_from(KINDS), st.integers(1, 6), st.integers(0, 2**31), st.booleans(), st.sampled_from([0.001, 0.01, 0.04]))
def test_bit_by_bit(kind, d, seed, rough, dt):
    rng = np.random.default_rng(seed)
    about = {"dt": dt, "model_dt": float(rng.choice([0.005, 0.01, 0.02])), "deaf": bool(rng.integers(2))}
    one, other = pair(kind, seed, d, **about)
    xs, forces = course(rng, d, 250, rough)
    stiffness = rng.choice([0.0, 100.0, 1000.0])  # [N/m] of a partner who keeps his place
    obs, a, b = Observation(d), Command(d), Command(d)
    obs.position[:], obs.force[:] = xs[0], 0.0
    one.reset(obs), other.reset(obs)
    if kind in KINDS[2:]:
        one._bias[:] = other._bias[:] = rng.normal(size=d)
    for n, (x, force) in enumerate(zip(xs, forces, strict=True)):
        obs.position[:], obs.force[:] = x, force
        if stiffness:
            obs.position[:] = xs[0] + n * 0.01 * a.velocity
            obs.force += stiffness * (xs[0] - obs.position)
        one.step(obs, a), other.step(obs, b)
        for name in ("position", "velocity", "acceleration"):
            same(getattr(a, name), getattr(b, name), err_msg=f"{name}, tick {n}")
        alike(one, other, n)


@pytest.mark.parametrize(("seed", "d", "size", "pace"), [(3, 1, 1.0, 1.0), (4, 2, 0.8, 1.3), (5, 3, 1.2, 0.7), (6, 6, 1.0, 1.1)])
def test_what_is_foreseen_is_foreseen_alike(seed, d, size, pace):
    """A partner who goes along the path, farther and slower or not, rests at its end, turns back half way the second time."""
    one, other = pair("follower", seed, d)
    obs, a, b = Observation(d), Command(d), Command(d)
    path = one.reference
    start = path.position[0]
    obs.position[:], obs.force[:] = start, 0.0
    one.reset(obs), other.reset(obs)
    awake = 0
    for n in range(700):
        s = min(max(0.01 * (n % 350) - 0.6, 0.0), 2.0) * pace
        s = s if n < 350 or s < 0.5 else max(1.0 - s, 0.0)
        obs.position[:] = start + size * (path.at(path.position, s) - start)
        pull = size * pace * path.at(path.velocity, s)
        obs.force[:] = 1.5 * pull / max(np.linalg.norm(pull), 0.2)
        one.step(obs, a), other.step(obs, b)
        one._compliance.velocity[:] = other._compliance.velocity[:] = pull  # a hand that goes along
        same(a.velocity, b.velocity, err_msg=f"tick {n}")
        alike(one, other, n)
        awake += one._foresight.awake
    assert awake > 30


@pytest.mark.parametrize(
    ("policy", "gives_way"),
    [(RolePolicy(insist_n=1e3), True), (RolePolicy(insist_n=1e3, held_s=1e3), False), (RolePolicy(held_s=1e3), True)],
    ids=["held", "neither counts", "insists"],
)
def test_who_holds_a_leader_or_insists_is_counted_alike_and_given_way(policy, gives_way):
    one, other = pair(KINDS[2], 7, 1, policy=policy)
    obs, a, b = Observation(1), Command(1), Command(1)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs), other.reset(obs)
    for n in range(180):
        one.step(obs, a), other.step(obs, b)
        alike(one, other, n)
        obs.position[0] += 0.01 * a.velocity[0]
        obs.force[0] = -5000.0 * obs.position[0] - 20.0 * a.velocity[0]
    assert (one.notice == "follows") == gives_way


def test_any_number_of_strengths_makes_a_role(monkeypatch):
    monkeypatch.setattr(evidence, "GAINS", (0.1, 0.2, 0.4, 0.8, 1.6))
    one, other = pair(KINDS[3], 4, 1)
    obs, a, b = Observation(1), Command(1), Command(1)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs), other.reset(obs)
    for n in range(60):
        obs.position[0], obs.force[0] = 0.001 * n, 2.0 * np.sin(0.05 * n)
        one.step(obs, a), other.step(obs, b)
        alike(one, other, n)


@pytest.mark.parametrize("deaf", [True, False])
def test_long_nonsense_is_nonsense_for_both(deaf):
    """Pulls that no role explains and that count as missing, many in a row: no filter hears them twice."""
    one, other = pair(KINDS[3], 5, 1, deaf=deaf)
    obs, a, b = Observation(1), Command(1), Command(1)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs), other.reset(obs)
    for n in range(150):
        size = 1e4 if 30 < n < 60 else 1e7 if 60 < n < 90 else 2.0
        obs.position[0], obs.force[0] = 0.001 * n, size * np.sin(0.1 * n)
        one.step(obs, a), other.step(obs, b)
        alike(one, other, n)


@pytest.mark.parametrize("kind", KINDS)
def test_ordinary_ticks_are_compiled(kind):
    """Else all above would compare Python with itself."""
    one, _ = pair(kind, 1, 1)
    obs, command = Observation(1), Command(1)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs)
    in_python = []
    one._step = lambda *_: in_python.append(1)
    for n in range(100):
        obs.position[0], obs.force[0] = 0.001 * n, 2.0 * np.sin(0.05 * n)
        one.step(obs, command)
    assert not in_python


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["position", "force"])
def test_arrays_of_another_kind_are_for_the_twin(kind, name):
    """Another array at another tick, a slice with steps, a list's worth of whole numbers: the same answers."""
    one, other = pair(kind, 2, 2)
    obs, a, b = Observation(2), Command(2), Command(2)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs), other.reset(obs)
    for array in (np.zeros(4)[::2], np.zeros(2, dtype=np.int64), np.zeros(2), np.zeros(2, dtype=">f8"), np.full(2, 0.01)):
        setattr(obs, name, array)
        a.velocity, b.velocity = np.zeros(2), np.zeros(2)
        one.step(obs, a), other.step(obs, b)
        same(a.velocity, b.velocity)
        alike(one, other, array)


def test_an_array_that_goes_is_not_written_to():
    one, _ = pair("follower", 3, 1)
    obs, command = Observation(1), Command(1)
    obs.position[:] = obs.force[:] = 0.0
    one.reset(obs)
    one.step(obs, command)
    before, command.velocity = command.velocity, np.zeros(1)
    obs.force[:] = 20.0
    for _ in range(50):
        one.step(obs, command)
    assert before[0] == 0.0
    assert command.velocity[0] > 0.01
