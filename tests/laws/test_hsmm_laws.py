"""What must be true of a hidden semi-Markov model whatever the implementation."""

import itertools
import warnings

import numpy as np
import pytest

from comanip.errors import ComanipWarning
from comanip.fitting.hmm import fit_hmm
from comanip.fitting.hsmm import fit_hsmm
from comanip.models import hmm, hsmm
from comanip.models.durations import most_likely, of_mean, table
from comanip.models.gaussian import log_density
from comanip.models.hmm import Hmm
from comanip.models.hsmm import Hsmm, durations_s, explicit_durations
from toys import CHANNELS, lifts, random_hmm, random_hsmm


def every_segmentation(model, x):
    """Joint probabilities of x and each way to cut it into segments (state, frames): the definition, written out."""
    b = np.exp(log_density(x, model.means, model.covariances))
    forever = np.diagonal(model.transition) == 1.0

    def go_on(t, chances, before, p):
        for j in np.flatnonzero(chances):
            for d in range(1, len(x) - t + 1):
                seen = p * chances[j] * b[t : t + d, j].prod()
                if t + d == len(x):
                    at_least = 1.0 if forever[j] else model.durations[j, d - 1 :].sum()
                    yield [*before, (j, d)], seen * at_least
                elif d <= model.longest and not forever[j]:
                    yield from go_on(t + d, model.transition[j], [*before, (j, d)], seen * model.durations[j, d - 1])

    yield from go_on(0, model.initial, [], 1.0)


TINY = [(2, 6, 3, 0, False), (3, 6, 2, 1, False), (3, 5, 7, 2, False), (4, 5, 1, 3, False), (1, 5, 2, 4, False),
        (3, 7, 4, 5, True), (2, 1, 3, 6, False)]  # fmt: skip


@pytest.mark.parametrize(("n_states", "length", "longest", "seed", "left_right"), TINY)
def test_everything_equals_the_sum_over_every_segmentation(n_states, length, longest, seed, left_right):
    rng = np.random.default_rng(seed)
    model = random_hsmm(rng, n_states, longest=longest, left_right=left_right)
    x = hsmm.sample(model, length, rng).frames
    total, gamma, transitions = 0.0, np.zeros((length, n_states)), np.zeros((n_states, n_states))
    durations = np.zeros((n_states, longest))
    best, best_path = -1.0, []
    ends = np.diagonal(model.transition) == 0.0
    for parts, p in every_segmentation(model, x):
        path = [j for j, d in parts for _ in range(d)]
        total += p
        gamma[np.arange(length), path] += p
        for (i, d), (j, _) in itertools.pairwise(parts):
            transitions[i, j] += p
            durations[i, d - 1] += p
        j, d = parts[-1]
        if ends[j] and p > 0.0:  # what was cut short is shared out among all durations that are at least so long
            tail = model.durations[j] * (np.arange(longest) >= d - 1)
            durations[j] += p * tail / tail.sum()
        if p > best:
            best, best_path = p, path
    found = hsmm.posteriors(model, x)
    assert found.log_likelihood == pytest.approx(np.log(total), rel=1e-12)
    assert hsmm.log_likelihood(model, [x])[0] == pytest.approx(np.log(total), rel=1e-12)
    np.testing.assert_allclose(found.weights, gamma / total, rtol=1e-9, atol=1e-13)
    e = hsmm.segment_sums(model, x, np.array([length]))
    np.testing.assert_allclose(e.first, gamma[0] / total, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(e.transitions[:, ends][ends], (transitions / total)[:, ends][ends], rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(e.durations[ends], (durations / total)[ends], rtol=1e-9, atol=1e-13)
    np.testing.assert_array_equal(hsmm.viterbi(model, x), best_path)


@pytest.mark.parametrize("left_right", [False, True])
@pytest.mark.parametrize("n_states", [1, 2, 4])
def test_with_geometric_durations_it_is_the_hmm(n_states, left_right):
    rng = np.random.default_rng(n_states)
    model = random_hmm(rng, n_states)
    if left_right:
        rows = (model.transition + 0.5 * np.eye(n_states)) * np.tri(n_states, k=1) * np.tri(n_states).T
        model = Hmm(np.eye(n_states)[0], rows / rows.sum(axis=1, keepdims=True), model.means, model.covariances, model.channels)
    other = explicit_durations(model, 400)
    sequences = [hmm.sample(model, n, rng).frames for n in (1, 2, 40, 25)]
    np.testing.assert_allclose(hsmm.log_likelihood(other, sequences), hmm.log_likelihood(model, sequences), rtol=1e-9)
    for x in sequences:
        np.testing.assert_allclose(hsmm.posteriors(other, x).weights, hmm.posteriors(model, x).weights, atol=1e-9)


def test_sequences_of_different_length_side_by_side_equal_each_alone():
    rng = np.random.default_rng(5)
    model = random_hsmm(rng, longest=9)
    sequences = [hsmm.sample(model, n, rng).frames for n in (1, 17, 4, 30)]
    alone = [hsmm.log_likelihood(model, [x])[0] for x in sequences]
    np.testing.assert_allclose(hsmm.log_likelihood(model, sequences), alone, rtol=1e-12)
    e = hsmm.segment_sums(model, np.concatenate(sequences), np.array([1, 17, 4, 30]), weights=True)
    np.testing.assert_allclose(e.weights, np.concatenate([hsmm.posteriors(model, x).weights for x in sequences]), atol=1e-12)
    assert e.first.sum() == pytest.approx(4.0)
    assert e.durations.sum() == pytest.approx(e.transitions.sum() + 4.0)  # every segment was entered once


def test_frames_far_from_everything_still_give_numbers():
    rng = np.random.default_rng(6)
    for left_right in (False, True):
        model = random_hsmm(rng, 4, longest=20, left_right=left_right)
        x = hsmm.sample(model, 60, rng).frames
        x[[5, 20, 21, 40]] = 1e5
        found = hsmm.posteriors(model, x)
        assert np.isfinite(found.log_likelihood)
        np.testing.assert_allclose(found.weights.sum(axis=1), 1.0, rtol=1e-9)
        x[30] = np.nan
        assert np.isfinite(hsmm.log_likelihood(model, [x])[0])


def random_lesson(rng, kind):
    data = [rng.normal(size=(rng.integers(12, 30), 2)).cumsum(axis=0) for _ in range(rng.integers(1, 4))]
    if kind == "quantised":
        return [np.round(x) for x in data]
    if kind == "rest":
        return [np.concatenate([np.zeros((40, 2)), x]) for x in data]
    return data


@pytest.mark.parametrize("kind", ["plain", "quantised", "rest"])
def test_em_never_falls_on_thirty_random_fits_of_each_kind(kind):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        options = {
            "topology": ("left-right", "cyclic", "free")[seed % 3],
            "initial_guess": ("time", "kmeans")[seed % 2],
            "covariance_floor": 10.0 ** rng.integers(-6, -1),
            "duration_floor": (0.02, 0.1, 0.5)[seed // 3 % 3],
            "longest": (None, 9)[seed % 2],
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ComanipWarning)
            fit = fit_hsmm(
                random_lesson(rng, kind), int(rng.integers(1, 6)), channels=("a", "b"), rng=rng, tolerance=0.0,
                max_iterations=15, outlier_ratio=np.inf, **options,
            )  # fmt: skip
        rise = np.diff(fit.log_likelihood)
        if not any(note.startswith("removed") for note in fit.notes):  # the last entry is then of another model
            assert rise.min(initial=0.0) >= -1e-9 * np.abs(fit.log_likelihood).max(), (kind, seed, options)
        np.testing.assert_allclose(fit.model.durations.sum(axis=1), 1.0)


def test_going_on_from_an_hmm_begins_at_its_likelihood_and_only_rises():
    data = lifts(4, n_frames=100)
    first = fit_hmm(data, 4, channels=CHANNELS)
    fit = fit_hsmm(data, 4, channels=CHANNELS, initial_guess=first.model, longest=2000, max_iterations=5)
    assert fit.log_likelihood[0] == pytest.approx(first.log_likelihood[-1], rel=1e-9)
    assert fit.log_likelihood[-1] > first.log_likelihood[-1] + 1.0


def test_learning_from_a_models_own_samples_finds_its_durations():
    """Sequences are cut anywhere: without the share of what was cut short, durations would come out too short."""
    rng = np.random.default_rng(3)
    gamma = np.column_stack([[3.0, 24.0, 8.0], np.array([4.0 / 12.0, 25.0 / 30.0, 9.0 / 20.0]) * 100])
    truth = Hsmm(
        np.full(3, 1 / 3),
        np.roll(np.eye(3), 1, axis=1),
        table(gamma, 100),
        np.array([[0.0, 0.0], [3.0, -2.0], [6.0, 1.0]]),
        np.tile(0.5 * np.eye(2), (3, 1, 1)),
        ("a", "b"),
    )
    data = [hsmm.sample(truth, 50, rng).frames for _ in range(200)]
    guess = Hsmm(truth.initial, truth.transition, table(of_mean(np.full(3, 20.0), 2.0, 100), 100), truth.means, truth.covariances,
                 truth.channels)  # fmt: skip
    found = fit_hsmm(data, 3, channels=("a", "b"), topology="cyclic", initial_guess=guess, longest=100).model
    np.testing.assert_allclose(durations_s(found, 1.0).mean_s, durations_s(truth, 1.0).mean_s, rtol=0.06)
    np.testing.assert_allclose(durations_s(found, 1.0).std_s, durations_s(truth, 1.0).std_s, rtol=0.2)
    np.testing.assert_allclose(found.means, truth.means, atol=0.1)


@pytest.mark.parametrize(("mean", "shape"), [(5.0, 1.0), (5.0, 20.0), (80.0, 3.0), (500.0, 90.0), (1.2, 2.0)])
def test_the_most_likely_durations_have_the_moments_of_the_data(mean, shape):
    p = table(of_mean(np.array([mean]), shape, 1000), 1000)
    d = np.arange(1.0, 1001.0)
    q = table(most_likely(7.0 * p, of_mean(np.array([50.0]), 4.0, 1000), 0.1), 1000)
    np.testing.assert_allclose(q @ d, p @ d, rtol=1e-5)
    np.testing.assert_allclose(q @ np.log(d), p @ np.log(d), rtol=1e-5, atol=1e-6)


def test_durations_never_come_out_narrower_than_the_floor():
    counts = np.zeros((1, 200))
    counts[0, 99] = 5.0
    for floor in (0.05, 0.1, 0.3):
        p = table(most_likely(counts, of_mean(np.array([20.0]), 4.0, 200), floor), 200)[0]
        d = np.arange(1.0, 201.0)
        assert p @ d == pytest.approx(100.0, rel=1e-3)
        assert np.sqrt(p @ d**2 - (p @ d) ** 2) == pytest.approx(100.0 * floor, rel=0.05)


def test_samples_last_as_long_as_the_durations_say():
    rng = np.random.default_rng(4)
    model = random_hsmm(rng, 3, longest=6)
    states = hsmm.sample(model, 60_000, rng).states
    cuts = np.flatnonzero(np.diff(states)) + 1
    for i in range(3):
        runs = np.diff(cuts)[states[cuts[:-1]] == i]
        np.testing.assert_allclose(np.bincount(runs, minlength=7)[1:] / len(runs), model.durations[i], atol=0.02)
