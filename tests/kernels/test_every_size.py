"""Twins agree to 1e-10 whatever the size: 1 to 60 channels, 1 to 64 states, any lengths, topology, threads, instruction set.

The models here are tame: states differ by about one nat a frame in any number of channels, so that many of them compete and every
number of every state can be seen in the result; where one state takes all, a wrong transition changes no digit.
"""

from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.fitting import baum_welch
from comanip.fitting import gmm as mixtures
from comanip.fitting.baum_welch import Chain
from comanip.models import hmm, hsmm
from comanip.models.chains import best_path, log_of
from comanip.models.filtering import ForwardFilter
from comanip.models.gaussian import whitening
from comanip.models.gmr import Regression
from comanip.models.hmm import Hmm
from comanip.models.hsmm import Hsmm
from comanip.models.rollout import roll_out
from kernels.test_twins import LEVELS, lessons_of
from toys import agree, random_hsmm, same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")

levels = st.sampled_from(LEVELS or ["absent"])
channels = st.integers(1, 60)
states = st.integers(1, 64)
topologies = st.sampled_from(["any to any", "left to right", "round"])
lengths = st.lists(st.integers(1, 90), min_size=1, max_size=20)
threads = st.sampled_from([1, 2, 3, 7])
seeds = st.integers(0, 10**6)


def examples(n):
    return settings(max_examples=n, deadline=None, derandomize=True)


@contextmanager
def running(level):
    """All compiled leaves run with this instruction set; "numpy" is the twins."""
    before, native = kernels.native.level(), kernels.native
    if level == "numpy":
        kernels.native = None
    else:
        native.use(level)
    try:
        yield
    finally:
        kernels.native = native
        native.use(before)


def tame_gaussians(rng, k, d):
    root = np.eye(d) + rng.normal(size=(k, d, d)) / (2 * d)
    return rng.normal(size=(k, d)) / np.sqrt(d), root @ np.swapaxes(root, 1, 2)


def tame_chain(rng, k, d, topology="any to any"):
    allowed = {
        "any to any": np.ones((k, k)),
        "left to right": np.eye(k) + np.eye(k, k=1),
        "round": np.minimum(np.eye(k) + np.roll(np.eye(k), 1, axis=1), 1.0),
    }[topology]
    rows = allowed * rng.uniform(0.2, 1.0, (k, k))
    initial = np.eye(k)[0] if topology == "left to right" else rng.dirichlet(np.ones(k))
    return Chain(initial, rows / rows.sum(axis=1, keepdims=True), *tame_gaussians(rng, k, d))


def tame_hmm(rng, k, d, topology="any to any", names=None):
    return Hmm(*tame_chain(rng, k, d, topology), names or tuple(f"c{i}" for i in range(d)))


@examples(50)
@given(levels, channels, states, lengths, topologies, threads, seeds)
def test_e_step(level, d, k, lengths, topology, n_threads, seed):
    rng = np.random.default_rng(seed)
    p, lessons = tame_chain(rng, k, d, topology), lessons_of(rng, lengths, d)
    white = whitening(p.means, p.covariances)
    with running(level):
        groups = kernels.planned(lessons.lengths)
        given = lessons.z, groups, p.initial, p.transition, white.arrays
        found = kernels.e_step(*given, n_threads=n_threads)
        weights, likelihood, _ = kernels.posteriors(*given, n_threads=n_threads)
    assert not found.failed.any()
    total, expected = baum_welch._expect(p, white, lessons.z, lessons.lengths)
    assert found.log_likelihood.sum() == pytest.approx(total, rel=1e-10)
    same(likelihood, found.log_likelihood)
    agree(weights, baum_welch.expectations_of(p, white, lessons.z, lessons.lengths).weights)
    for name in ("moments", "transitions", "first"):
        agree(getattr(found, name), getattr(expected, name))
    assert (found.transitions[p.transition == 0.0] == 0.0).all()


@examples(40)
@given(levels, channels, states, lengths, topologies, threads, seeds)
def test_likelihood_of_each_sequence(level, d, k, lengths, topology, n_threads, seed):
    rng = np.random.default_rng(seed)
    model, x = tame_hmm(rng, k, d, topology), 1.5 * rng.normal(size=(sum(lengths), d))
    white = whitening(model.means, model.covariances).arrays
    with running(level):
        groups = kernels.planned(np.array(lengths))
        found, failed = kernels.likelihoods(x, groups, model.initial, model.transition, white, n_threads=n_threads)
    assert not failed.any()  # or the twin would take what the kernel cannot, and nobody would see it
    np.testing.assert_allclose(found, hmm._log_likelihood(model, x, np.array(lengths)), rtol=1e-10)


@examples(60)
@given(levels, channels, states, lengths, topologies, threads, seeds)
def test_best_paths(level, d, k, lengths, topology, n_threads, seed):
    """Side by side, alone, and with their probabilities."""
    rng = np.random.default_rng(seed)
    model, x = tame_hmm(rng, k, d, topology), 1.5 * rng.normal(size=(sum(lengths), d))
    log_initial, log_transition, white = log_of(model.initial), log_of(model.transition), model.whitening
    with running(level):
        path, score = kernels.decode(x, np.array(lengths), log_initial, log_transition, white.arrays, n_threads=n_threads)
    parts = np.split(white.log_density(x), np.cumsum(lengths)[:-1])
    expected = [best_path(part, log_initial, log_transition) for part in parts]
    same(path, np.concatenate([p for p, _ in expected]))
    np.testing.assert_allclose(score, [s for _, s in expected], rtol=1e-10)


@examples(40)
@given(levels, channels, states, st.one_of(st.integers(1, 300), st.integers(4090, 4200)), threads, seeds)
def test_mixture(level, d, k, n, n_threads, seed):
    """4096 frames are one piece of work; a few more are a second, short one."""
    rng = np.random.default_rng(seed)
    p, z = mixtures._Mixture(rng.dirichlet(np.full(k, 5.0)), *tame_gaussians(rng, k, d)), 1.5 * rng.normal(size=(n, d))
    with running(level):
        white = whitening(p.means, p.covariances).arrays
        total, moments, gamma = kernels.mixture(z, np.log(p.weights), white, weights=True, n_threads=n_threads)
    with running("numpy"):
        expected_total, expected = mixtures._expect(p, z, gamma=True)
    assert total == pytest.approx(expected_total, rel=1e-10)
    agree(moments, expected.moments)
    agree(gamma, expected.gamma)


@examples(50)
@given(
    levels, st.integers(1, 15), st.integers(0, 30), states, st.integers(1, 70), st.integers(1, 70), threads,
    st.sampled_from([None, "position", ("position", "velocity")]), st.booleans(), seeds,
)  # fmt: skip
def test_roll_outs(level, d, f, k, n, length, n_threads, evidence, same, seed):
    """Up to 2 · 15 + 30 channels; one force for all or each its own; not whole runs of steps and not whole blocks of lanes."""
    rng = np.random.default_rng(seed)
    names = tuple(f"{g}.{i}" for g, m in (("position", d), ("force", f), ("velocity", d)) for i in range(m))
    model = tame_hmm(rng, k, len(names), names=names)
    start, force = rng.normal(size=(n, d)), rng.normal(size=(length, f) if same else (n, length, f))
    with running(level):
        found = roll_out(model, start, force, dt=0.05, evidence=evidence, n_threads=n_threads)
    with running("numpy"):
        expected = roll_out(model, start, force, dt=0.05, evidence=evidence)
    for one, other in zip(found, expected, strict=True):
        agree(one, other)


def watched(rng, d):
    """40 frames with a glitch, a hole, and something that no number is for."""
    x = 1.5 * rng.normal(size=(40, d))
    x[7] += 20.0  # more would leave its log-density fewer than 10 digits behind the point
    x[20:22, rng.integers(d)] = np.nan
    x[30] = 1e300
    return x


@examples(50)
@given(levels, channels, states, topologies, st.sampled_from([1e-3, 0.0]), st.sampled_from([12.0, np.inf]), seeds)
def test_a_tick(level, d, k, topology, floor, gate, seed):
    """Without a floor an excluded state has a weight of 1e-300 by convention only, so a chain with zeros has a floor here."""
    rng = np.random.default_rng(seed)
    model, x = tame_hmm(rng, k, d, topology), watched(rng, d)
    floor = floor if topology == "any to any" else 1e-3
    with running(level):
        native = ForwardFilter(model, transition_floor=floor, gate=gate)
        found = [(native.step(xi).copy(), native.last_log_likelihood) for xi in x]
    with running("numpy"):
        twin = ForwardFilter(model, transition_floor=floor, gate=gate)
        for (weights, log_likelihood), xi in zip(found, x, strict=True):
            agree(weights, twin.step(xi))
            assert log_likelihood == pytest.approx(twin.last_log_likelihood, rel=1e-10, abs=1e-10)
    assert native.log_likelihood == pytest.approx(twin.log_likelihood, rel=1e-10)
    assert native.restarts == twin.restarts


@examples(40)
@given(levels, st.integers(1, 59), st.integers(1, 30), states, seeds)
def test_a_line_of_regression(level, n_in, n_out, k, seed):
    rng = np.random.default_rng(seed)
    n_out = min(n_out, 60 - n_in)
    model = tame_hmm(rng, k, n_in + n_out)
    h, x = rng.dirichlet(np.ones(k)), rng.normal(size=n_in)
    with running(level):
        found = Regression(model, model.channels[:n_in], model.channels[n_in:]).mean(h, x).copy()
    with running("numpy"):
        agree(found, Regression(model, model.channels[:n_in], model.channels[n_in:]).mean(h, x))


@examples(30)
@given(
    levels,
    channels,
    states,
    st.integers(1, 30),
    st.lists(st.integers(1, 60), min_size=1, max_size=8),
    st.booleans(),
    threads,
    seeds,
)
def test_e_step_over_segments(level, d, k, longest, lengths, left_right, n_threads, seed):
    rng = np.random.default_rng(seed)
    p = random_hsmm(rng, k, d, longest=longest, left_right=left_right)
    model = Hsmm(p.initial, p.transition, p.durations, *tame_gaussians(rng, k, d), p.channels)
    frames = 1.5 * rng.normal(size=(sum(lengths), d))
    white = whitening(model.means, model.covariances)
    given = frames, np.array(lengths), model.initial, model.transition, model.durations, white.arrays
    with running(level):
        found = kernels.segments(*given, weights=True, n_threads=n_threads)
    assert not found.failed.any()
    expected = hsmm._twin(model, white, frames, np.array(lengths))
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-10)
    for name in ("moments", "transitions", "first", "durations", "weights"):
        agree(getattr(found, name), getattr(expected, name))
