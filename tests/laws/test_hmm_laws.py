"""What must be true of a hidden Markov model whatever the implementation."""

import itertools
import warnings

import numpy as np
import pytest

from comanip.errors import ComanipWarning, InternalError
from comanip.fitting.climb import climb
from comanip.fitting.hmm import fit_hmm
from comanip.models import chains, hmm
from comanip.models.gaussian import log_density
from comanip.models.hmm import Hmm
from toys import CHANNELS, lifts, random_hmm


def every_path(model, x):
    """Joint probabilities of x with each of the K^T paths: the definition, written out."""
    b = np.exp(log_density(x, model.means, model.covariances))
    for path in itertools.product(range(model.n_states), repeat=len(x)):
        p = model.initial[path[0]] * b[0, path[0]]
        for t in range(1, len(x)):
            p *= model.transition[path[t - 1], path[t]] * b[t, path[t]]
        yield path, p


@pytest.mark.parametrize(("n_states", "length", "seed"), [(2, 6, 0), (3, 5, 1), (4, 4, 2), (3, 1, 3), (1, 5, 4)])
def test_forward_backward_equals_the_sum_over_every_path(n_states, length, seed):
    rng = np.random.default_rng(seed)
    model = random_hmm(rng, n_states)
    x = hmm.sample(model, length, rng).frames
    total, gamma, transitions = 0.0, np.zeros((length, n_states)), np.zeros((n_states, n_states))
    best, best_path = -1.0, ()
    for path, p in every_path(model, x):
        total += p
        gamma[np.arange(length), path] += p
        np.add.at(transitions, (path[:-1], path[1:]), p)
        if p > best:
            best, best_path = p, path
    found = hmm.posteriors(model, x)
    assert found.log_likelihood == pytest.approx(np.log(total), rel=1e-12)
    np.testing.assert_allclose(found.weights, gamma / total, rtol=1e-9, atol=1e-14)
    log_b = log_density(x, model.means, model.covariances)[None]
    e = chains.expectations(log_b, np.array([length]), np.log(model.initial), np.log(model.transition))
    np.testing.assert_allclose(e.transitions, transitions / total, rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(hmm.viterbi(model, x), best_path)


def test_sequences_of_different_length_side_by_side_equal_each_alone():
    rng = np.random.default_rng(5)
    model = random_hmm(rng)
    sequences = [hmm.sample(model, n, rng).frames for n in (1, 17, 4, 30)]
    together = hmm.log_likelihood(model, sequences)
    alone = [hmm.log_likelihood(model, [x])[0] for x in sequences]
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    lengths = np.array([len(x) for x in sequences])
    log_b = chains.padded(log_density(np.concatenate(sequences), model.means, model.covariances), lengths)
    e = chains.expectations(log_b, lengths, np.log(model.initial), np.log(model.transition))
    np.testing.assert_allclose(e.weights, np.concatenate([hmm.posteriors(model, x).weights for x in sequences]))
    assert e.transitions.sum() == pytest.approx((lengths - 1).sum())
    assert e.first.sum() == pytest.approx(4.0)


def random_lesson(rng, kind):
    data = [rng.normal(size=(rng.integers(12, 30), 2)).cumsum(axis=0) for _ in range(rng.integers(1, 4))]
    if kind == "quantised":
        return [np.round(x) for x in data]
    if kind == "rest":
        return [np.concatenate([np.zeros((40, 2)), x]) for x in data]
    if kind == "collinear":
        return [np.column_stack([x[:, 0], 3.0 * x[:, 0]]) for x in data]
    return data


@pytest.mark.parametrize("kind", ["plain", "quantised", "rest", "collinear"])
def test_em_never_falls_on_fifty_random_fits_of_each_kind(kind):
    for seed in range(50):
        rng = np.random.default_rng(seed)
        options = {
            "topology": ("left-right", "cyclic", "free")[seed % 3],
            "initial_guess": ("time", "kmeans")[seed % 2],
            "covariance_floor": 10.0 ** rng.integers(-6, -1),
            "transition_floor": (0.0, 1e-3)[seed % 2],
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ComanipWarning)
            fit = fit_hmm(
                random_lesson(rng, kind), int(rng.integers(1, 6)), channels=("a", "b"), rng=rng, tolerance=0.0,
                max_iterations=25, outlier_ratio=np.inf, **options,
            )  # fmt: skip
        rise = np.diff(fit.log_likelihood)
        if not any(note.startswith("removed") for note in fit.notes):  # the last entry is then of another model
            assert rise.min(initial=0.0) >= -1e-9 * np.abs(fit.log_likelihood).max(), (kind, seed, options)
        np.testing.assert_allclose(fit.model.transition.sum(axis=1), 1.0)


def test_a_likelihood_that_falls_is_an_internal_error_with_iteration_and_amount():
    values = iter([-10.0, -9.0, -9.5])
    with pytest.raises(InternalError, match=r"fell by 5\.000e-01 .* in iteration 2"):
        climb(0, lambda p: (next(values), p), lambda s, p: p, max_iterations=5, rise=0.0)


def test_permuting_the_states_changes_nothing():
    rng = np.random.default_rng(8)
    model = random_hmm(rng, 4)
    p = rng.permutation(4)
    other = Hmm(
        model.initial[p], model.transition[np.ix_(p, p)], model.means[p], model.covariances[p], model.channels
    )  # fmt: skip
    x = hmm.sample(model, 40, rng).frames
    first, second = hmm.posteriors(model, x), hmm.posteriors(other, x)
    assert first.log_likelihood == pytest.approx(second.log_likelihood, rel=1e-12)
    np.testing.assert_allclose(first.weights[:, p], second.weights, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(hmm.viterbi(model, x), p[hmm.viterbi(other, x)])


def test_the_order_of_demonstrations_changes_nothing():
    data = lifts(4)
    first = fit_hmm(data, 4, channels=CHANNELS)
    second = fit_hmm(data[::-1], 4, channels=CHANNELS)
    np.testing.assert_allclose(first.model.means, second.model.means, rtol=1e-7, atol=1e-9)
    assert first.log_likelihood[-1] == pytest.approx(second.log_likelihood[-1], rel=1e-10)


def test_the_order_of_channels_changes_nothing():
    data = lifts(4)
    order = [2, 0, 1]
    first = fit_hmm(data, 4, channels=CHANNELS).model
    second = fit_hmm([x[:, order] for x in data], 4, channels=[CHANNELS[i] for i in order]).model
    np.testing.assert_allclose(first.means[:, order], second.means, rtol=1e-7, atol=1e-9)


def test_learning_from_a_models_own_samples_finds_the_model():
    rng = np.random.default_rng(3)
    truth = Hmm(
        np.array([1.0, 0.0, 0.0]),
        np.array([[0.95, 0.05, 0.0], [0.0, 0.95, 0.05], [0.0, 0.0, 1.0]]),
        np.array([[0.0, 0.0], [3.0, -2.0], [6.0, 1.0]]),
        np.array([[[1.0, 0.6], [0.6, 1.0]], [[1.0, -0.4], [-0.4, 0.5]], [[0.3, 0.0], [0.0, 0.8]]]),
        ("a", "b"),
    )
    data = [hmm.sample(truth, 80, rng).frames for _ in range(60)]
    model = fit_hmm(data, 3, channels=("a", "b")).model
    np.testing.assert_allclose(model.means, truth.means, atol=0.12)
    np.testing.assert_allclose(model.covariances, truth.covariances, atol=0.12)
    np.testing.assert_allclose(model.transition, truth.transition, atol=0.02)


def test_samples_visit_the_states_as_often_as_the_chain_says():
    rng = np.random.default_rng(4)
    model = random_hmm(rng, 3)
    found = hmm.sample(model, 40_000, rng)
    values, vectors = np.linalg.eig(model.transition.T)
    stationary = np.real(vectors[:, np.argmax(np.real(values))])
    np.testing.assert_allclose(np.bincount(found.states) / 40_000, stationary / stationary.sum(), atol=0.02)
    for i in range(3):
        np.testing.assert_allclose(found.frames[found.states == i].mean(axis=0), model.means[i], atol=0.15)
