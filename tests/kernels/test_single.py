"""float32 on request: close to float64 on ordinary data, handed to float64 where it ends, and never NaN."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.errors import InternalError, ParameterError
from comanip.fitting import baum_welch
from comanip.fitting import gmm as mixtures
from comanip.fitting.baum_welch import Chain
from comanip.fitting.climb import climb_fast_first
from comanip.fitting.gmm import fit_gmm
from comanip.fitting.hmm import fit_hmm
from comanip.models import hmm
from comanip.models.gaussian import whitening
from comanip.models.hmm import Hmm
from comanip.models.rollout import roll_out
from kernels.test_twins import LEVELS, chain, lessons_of
from toys import agree, random_gmm, random_hmm, same

native_only = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")


def check_expectations(p, lessons, *, tolerance=3e-5):
    """Sums agree relative to their largest entry, and log-likelihoods to 1e-5 a frame beside their size."""
    total, found = baum_welch.expect(p, lessons, single=True)
    expected_total, expected = baum_welch.expect(p, lessons)
    assert abs(total - expected_total) <= 1e-5 * lessons.n_frames + 1e-6 * abs(expected_total)
    for a, b in zip(found, expected, strict=True):
        assert np.isfinite(a).all()
        agree(a, b, tolerance=tolerance)
    return expected_total


@native_only
@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.integers(1, 300), min_size=1, max_size=40),
    st.integers(1, 20),
    st.integers(1, 20),
    st.integers(0, 10**6),
    st.booleans(),
)
def test_expectations_for_all_sizes_and_ragged_lengths(lengths, d, k, seed, left_right):
    rng = np.random.default_rng(seed)
    for name in LEVELS:
        kernels.native.use(name)
        check_expectations(chain(rng, k, d, left_right), lessons_of(rng, lengths, d))
    kernels.native.use(LEVELS[0])


@native_only
@pytest.mark.parametrize("lengths", [[500] * 40, [5000], [300] * 9 + [20] * 50])
def test_weights_and_threads(level, lengths):
    rng = np.random.default_rng(2)
    lessons, p = lessons_of(rng, lengths, 4), chain(rng, 7, 4)
    white = whitening(p.means, p.covariances).arrays
    given = p.initial, p.transition, white
    for ask in (kernels.e_step, kernels.posteriors):
        one, two = [ask(lessons.z, lessons.narrow_groups, *given, n_threads=n, single=True) for n in (1, 2)]
        for a, b in zip(one, two, strict=True):
            same(a, b)
    weights, _, failed = one
    assert not failed.any()
    agree(weights, kernels.posteriors(lessons.z, lessons.groups, *given)[0], tolerance=1e-4)


@native_only
@pytest.mark.parametrize("lengths", [[100_000], [60_000, 60_000]])
def test_long_sequences_lose_no_digits(level, lengths):
    rng = np.random.default_rng(3)
    check_expectations(chain(rng, 5, 3), lessons_of(rng, lengths, 3), tolerance=1e-4)


@native_only
def test_where_float32_ends_float64_takes_the_sequence(level):
    """Left-right: the second lesson goes back to where only a state of the past could be, 18 digits of probability away."""
    p = Chain(np.eye(2)[0], np.array([[0.5, 0.5], [0.0, 1.0]]), np.array([[0.0], [11.0]]), np.ones((2, 1, 1)))
    there, back = [0.0] * 20 + [11.0] * 20, [0.0] * 20 + [11.0] * 20 + [0.0] * 5
    lessons = replace(lessons_of(np.random.default_rng(0), [40, 45], 1), z=np.array(there + back)[:, None])
    white = whitening(p.means, p.covariances).arrays
    sums = kernels.e_step(lessons.z, lessons.narrow_groups, p.initial, p.transition, white, single=True)
    assert sums.failed.tolist() == [False, True]
    assert not kernels.e_step(lessons.z, lessons.groups, p.initial, p.transition, white).failed.any()
    check_expectations(p, lessons)
    model = Hmm(p.initial, p.transition, p.means, p.covariances, ("x",))
    sequences = [lessons.z[:40], lessons.z[40:]]
    found = hmm.log_likelihood(model, sequences, precision="float32")
    np.testing.assert_allclose(found, hmm.log_likelihood(model, sequences), rtol=1e-6)


@native_only
@pytest.mark.parametrize("far", [1e3, 1e5, 1e20, 1e60])
def test_outliers_give_the_numbers_of_float64(level, far):
    rng = np.random.default_rng(0)
    for lengths in ([50, 60, 70] * 12, [500]):
        for left_right in (False, True):
            lessons, p = lessons_of(rng, lengths, 3), chain(rng, 5, 3, left_right)
            lessons.z[[5, 100, 333], 1] = far
            check_expectations(p, lessons)
            total, sums = mixtures._expect(mixtures._Mixture(p.initial, p.means, p.covariances), lessons.z, single=True)
            expected, other = mixtures._expect(mixtures._Mixture(p.initial, p.means, p.covariances), lessons.z)
            assert total == pytest.approx(expected, rel=1e-6)
            agree(sums.moments, other.moments, tolerance=1e-6)


@native_only
def test_a_state_that_nothing_visits(level):
    rng = np.random.default_rng(1)
    p, lessons = chain(rng, 4, 3), lessons_of(rng, [200] * 10, 3)
    means = p.means.copy()
    means[2] = 1e7
    check_expectations(p._replace(means=means), lessons)


@native_only
@pytest.mark.parametrize(("d", "k", "n"), [(1, 1, 1), (3, 5, 129), (7, 10, 9001), (20, 20, 3000)])
def test_mixtures(level, d, k, n):
    rng = np.random.default_rng(n)
    model, z = random_gmm(rng, k, d), 2.0 * rng.normal(size=(n, d))
    p = mixtures._Mixture(model.weights, model.means, model.covariances)
    (total, found), (expected_total, expected) = (
        mixtures._expect(p, z, gamma=True, single=True),
        mixtures._expect(p, z, gamma=True),
    )
    assert abs(total - expected_total) <= 1e-5 * n + 1e-6 * abs(expected_total)
    agree(found.moments, expected.moments, tolerance=3e-5)
    agree(found.gamma, expected.gamma, tolerance=1e-3)


def reaching(rng, n_lessons, *, offset=0.0, noise=0.01):
    time = np.linspace(0.0, 1.0, 200)
    x = np.stack([time**2, np.sin(6.0 * time), np.gradient(time**2)], axis=1)
    return [offset + (1.0 + 0.05 * rng.normal()) * x + noise * rng.normal(size=x.shape) * x.std(axis=0) for _ in range(n_lessons)]


@pytest.mark.parametrize("topology", ["left-right", "cyclic", "free"])
@pytest.mark.parametrize(("offset", "noise"), [(0.0, 0.01), (0.0, 0.0), (1e6, 0.01)])
def test_learning_arrives_where_float64_does(topology, offset, noise):
    sequences = reaching(np.random.default_rng(0), 12, offset=offset, noise=noise)
    one, other = [
        fit_hmm(sequences, 6, channels=list("xyz"), topology=topology, precision=precision)
        for precision in ("float32", "float64")
    ]
    assert one.converged
    assert other.converged
    assert one.log_likelihood[-1] == pytest.approx(other.log_likelihood[-1], rel=0.0, abs=1e-3 * one.n_frames)
    np.testing.assert_allclose(one.log_likelihood[-1], hmm.log_likelihood(one.model, sequences).sum(), rtol=1e-9)


def test_learning_a_mixture_arrives_where_float64_does():
    sequences = reaching(np.random.default_rng(0), 12)
    one, other = [fit_gmm(sequences, 6, channels=list("xyz"), precision=precision) for precision in ("float32", "float64")]
    assert one.log_likelihood[-1] == pytest.approx(other.log_likelihood[-1], rel=0.0, abs=1e-3 * one.n_frames)


def test_iterations_are_counted_together():
    sequences = reaching(np.random.default_rng(0), 3)
    with pytest.warns(UserWarning, match="not converged"):
        assert fit_hmm(sequences, 3, channels=list("xyz"), max_iterations=4, tolerance=0.0, precision="float32").n_iterations == 4


@pytest.mark.parametrize(("d", "k"), [(1, 1), (3, 5), (20, 20)])
def test_likelihoods(d, k):
    rng = np.random.default_rng(k)
    model = random_hmm(rng, k, d)
    lengths = (1, 2, 300, 77)
    sequences = [hmm.sample(model, n, rng).frames for n in lengths]
    found, expected = (hmm.log_likelihood(model, sequences, precision=p) for p in ("float32", "float64"))
    assert (np.abs(found - expected) <= 1e-5 * np.array(lengths) + 1e-6 * np.abs(expected)).all()


def law(offset=0.0):
    rng = np.random.default_rng(0)
    channels = ("position.x", "position.y", "force.x", "velocity.x", "velocity.y")
    p = random_hmm(rng, 5, 5)
    return Hmm(p.initial, p.transition, p.means + offset, p.covariances, channels)


@native_only
@pytest.mark.parametrize("n", [1, 70, 300])
@pytest.mark.parametrize("length", [1, 30, 33])
def test_roll_outs(level, n, length):
    rng = np.random.default_rng(n)
    model, start, force = law(), rng.normal(size=(n, 2)), rng.normal(size=(n, length, 1))
    one, two = [roll_out(model, start, force, dt=0.01, n_threads=m, precision="float32") for m in (1, 2)]
    for a, b, c in zip(one, two, roll_out(model, start, force, dt=0.01), strict=True):
        same(a, b)
        agree(a, c, tolerance=1e-4)
        assert (np.abs(a - c) > 0.0).any()  # float32 it was


@pytest.mark.parametrize("why", ["a channel far from zero", "a wide gate", "away beyond 1e38"])
def test_roll_outs_that_float32_cannot_take(why):
    rng = np.random.default_rng(0)
    model = law(1e6 if why == "a channel far from zero" else 0.0)
    start, force = model.means[:3, :2] + 0.1 * rng.normal(size=(3, 2)), rng.normal(size=(100, 1))
    options = {"dt": 0.01, "gate": np.inf if why == "a wide gate" else 20.0}
    if why == "away beyond 1e38":
        start, options["dt"] = start * 1e36, 1e3
        force = force[:6]
    found, expected = (roll_out(model, start, force, precision=p, **options) for p in ("float32", "float64"))
    for a, b in zip(found, expected, strict=True):
        assert np.isfinite(a).all()
        same(a, b)


def test_without_kernels_both_are_float64(monkeypatch):
    monkeypatch.setattr(kernels, "native", None)
    sequences = reaching(np.random.default_rng(0), 3)
    one, other = [fit_hmm(sequences, 3, channels=list("xyz"), precision=precision) for precision in ("float32", "float64")]
    same(one.log_likelihood, other.log_likelihood)


def test_another_precision_is_refused():
    model, sequences = random_hmm(np.random.default_rng(0), 2, 3), reaching(np.random.default_rng(0), 1)
    for call in (
        lambda: fit_hmm(sequences, 2, channels=list("xyz"), precision="half"),
        lambda: fit_gmm(sequences, 2, channels=list("xyz"), precision="half"),
        lambda: hmm.log_likelihood(model, sequences, precision="half"),
        lambda: roll_out(law(), np.zeros((1, 2)), np.zeros((1, 1)), dt=0.01, precision="half"),
    ):
        with pytest.raises(ParameterError, match=r"float64.*float32.*half"):
            call()


def test_channels_that_repeat_each_other():
    """Almost singular: float64 has the digits, float32 has not."""
    rng = np.random.default_rng(0)
    model = random_hmm(rng, 3, 2)
    root = np.array([[1.0, 0.0], [1.0, 1e-5]])
    model = Hmm(model.initial, model.transition, model.means, np.tile(root @ root.T, (3, 1, 1)), model.channels)
    sequences = [hmm.sample(model, 200, rng).frames]
    found, expected = (hmm.log_likelihood(model, sequences, precision=p) for p in ("float32", "float64"))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("t", [0, 20, 39])
def test_what_is_not_finite_is_refused_wherever_it_stands(precision, value, t):
    start, force = np.zeros((70, 2)), np.zeros((70, 40, 1))
    force[65, t] = value
    with pytest.raises(ParameterError, match="finite"):
        roll_out(law(), start, force, dt=0.01, precision=precision)
    start[3, 1] = value
    with pytest.raises(ParameterError, match="finite"):
        roll_out(law(), start, np.zeros((40, 1)), dt=0.01, precision=precision)


@native_only
@pytest.mark.parametrize("lengths", [[200_000], [100_000, 100_000]])
def test_sums_of_very_many_equal_numbers_lose_no_digits(level, lengths):
    """What float32 adds to a sum of 1e5 is rounded to the same side each time."""
    p = Chain(np.ones(1), np.ones((1, 1)), np.zeros((1, 1)), np.ones((1, 1, 1)))
    lessons = lessons_of(np.random.default_rng(0), lengths, 1)
    lessons.z[:] = 1.1
    check_expectations(p, lessons, tolerance=1e-4)


def test_a_fall_in_float32_is_rounding_and_in_float64_a_defect():
    def climb_over(narrow, wide):
        scores = {True: iter(narrow), False: iter(wide)}
        return climb_fast_first(
            0, lambda p, single: (next(scores[single]), None), lambda e, p: p + 1, single=True, max_iterations=9, rise=0.1
        )

    parameters, trace, converged = climb_over([-10.0, -9.0, -9.5], [-9.0, -8.0, -8.0])
    assert (parameters, trace.tolist(), converged) == (4, [-10.0, -9.0, -9.0, -8.0, -8.0], True)
    with pytest.raises(InternalError, match="fell"):
        climb_over([-10.0, -10.0], [-9.0, -9.5])


@native_only
def test_weights_of_two_near_states_have_six_digits(level):
    """Log-densities are small here, so what is wrong is the exponential."""
    z = np.linspace(-3.0, 3.0, 1001)[:, None]
    p = mixtures._Mixture(np.full(2, 0.5), np.array([[-1.0], [1.0]]), np.ones((2, 1, 1)))
    found, expected = (mixtures._expect(p, z, gamma=True, single=single)[1].gamma for single in (True, False))
    np.testing.assert_allclose(found, expected, rtol=3e-6)
