"""hmmlearn as an oracle: same parameters, same numbers; and its interface, used as its users do."""

import logging

import numpy as np
import pytest

from comanip import GaussianHMM
from comanip.fitting.baum_welch import most_likely_rows
from comanip.fitting.hmm import fit_hmm
from comanip.fitting.m_step import weighted_gaussians
from comanip.models import chains, hmm
from comanip.models.gaussian import log_density
from toys import CHANNELS, lifts, random_hmm

hmmlearn_hmm = pytest.importorskip("hmmlearn.hmm")


def theirs(model, **options):
    peer = hmmlearn_hmm.GaussianHMM(model.n_states, "full", init_params="", **options)
    peer.startprob_, peer.transmat_ = model.initial, model.transition
    peer.means_, peer.covars_ = model.means, model.covariances
    return peer


def ours(peer, **options):
    mine = GaussianHMM(peer.n_components, peer.covariance_type, init_params="", **options)
    mine.startprob_, mine.transmat_ = peer.startprob_, peer.transmat_
    mine.means_, mine.covars_ = peer.means_, peer._covars_
    return mine


@pytest.mark.parametrize("seed", range(4))
def test_likelihood_posteriors_and_best_path_equal_theirs(seed):
    rng = np.random.default_rng(seed)
    model = random_hmm(rng, 4, 3)
    x = hmm.sample(model, 200, rng).frames
    peer = theirs(model)
    log_likelihood, weights = peer.score_samples(x)
    found = hmm.posteriors(model, x)
    assert found.log_likelihood == pytest.approx(log_likelihood, rel=1e-10)
    np.testing.assert_allclose(found.weights, weights, atol=1e-8)
    np.testing.assert_array_equal(hmm.viterbi(model, x), peer.predict(x))
    lengths = [80, 1, 119]
    parts = np.split(x, np.cumsum(lengths)[:-1])
    assert hmm.log_likelihood(model, parts).sum() == pytest.approx(peer.score(x, lengths), rel=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_one_em_step_equals_theirs(seed):
    rng = np.random.default_rng(seed)
    model = random_hmm(rng, 3, 2)
    lengths = np.array([60, 40, 50])
    x = np.concatenate([hmm.sample(model, n, rng).frames for n in lengths])
    start = random_hmm(np.random.default_rng(seed + 100), 3, 2)
    peer = theirs(start, n_iter=1, covars_prior=np.zeros((3, 2, 2)), covars_weight=0)
    peer.fit(x, lengths)
    log_b = chains.padded(log_density(x, start.means, start.covariances), lengths)
    e = chains.expectations(log_b, lengths, np.log(start.initial), np.log(start.transition))
    means, covariances = weighted_gaussians(x, e.weights, 1e-12, (start.means, start.covariances))
    np.testing.assert_allclose(means, peer.means_, atol=1e-8)
    np.testing.assert_allclose(covariances, peer.covars_, atol=1e-8)
    np.testing.assert_allclose(e.first / 3.0, peer.startprob_, atol=1e-8)
    rows = most_likely_rows(e.transitions, start.transition, 0.0)
    np.testing.assert_allclose(rows, peer.transmat_, atol=1e-8)


@pytest.mark.parametrize("covariance_type", ["spherical", "diag", "tied", "full"])
def test_the_estimator_learns_what_theirs_learns_from_the_same_start(covariance_type):
    rng = np.random.default_rng(7)
    lengths = [100, 80, 120]
    x = hmm.sample(random_hmm(rng, 3, 2, spread=3.0), 300, rng).frames
    options = {"n_iter": 5, "tol": 0.0, "random_state": 0, "covars_prior": 1e-2}
    if covariance_type in ("tied", "full"):  # theirs adds a scalar prior to every entry, ours to the diagonal
        options["covars_prior"] = 1e-2 * np.eye(2)
    start = hmmlearn_hmm.GaussianHMM(3, covariance_type, random_state=0)
    start._init(x, lengths)
    peer = hmmlearn_hmm.GaussianHMM(3, covariance_type, init_params="", **options)
    mine = ours(start, **options)
    for name in ("startprob_", "transmat_", "means_"):
        setattr(peer, name, getattr(start, name).copy())
    peer.covars_ = start._covars_[:, 0] if covariance_type == "spherical" else start._covars_
    peer.fit(x, lengths)
    mine.fit(x, lengths)
    for name in ("startprob_", "transmat_", "means_"):
        np.testing.assert_allclose(getattr(mine, name), getattr(peer, name), atol=1e-8, err_msg=name)
    learned = peer._covars_[:, 0] if covariance_type == "spherical" else peer._covars_  # theirs repeats it per feature
    np.testing.assert_allclose(mine._covars_, learned, atol=1e-8)
    np.testing.assert_allclose(list(mine.monitor_.history), list(peer.monitor_.history), rtol=1e-9)
    peer.covars_ = learned
    assert mine.score(x, lengths) == pytest.approx(peer.score(x, lengths), rel=1e-9)
    assert mine.bic(x, lengths) == pytest.approx(peer.bic(x, lengths), rel=1e-9)
    assert mine.aic(x, lengths) == pytest.approx(peer.aic(x, lengths), rel=1e-9)
    for algorithm in ("viterbi", "map"):
        score, states = peer.decode(x, lengths, algorithm=algorithm)
        mine_score, mine_states = mine.decode(x, lengths, algorithm=algorithm)
        np.testing.assert_array_equal(mine_states, states)
        if algorithm == "viterbi":
            assert mine_score == pytest.approx(score, rel=1e-9)
    np.testing.assert_allclose(mine.get_stationary_distribution(), peer.get_stationary_distribution(), atol=1e-8)


def test_a_small_scalar_prior_does_not_correlate_small_channels():
    rng = np.random.default_rng(1)
    x = 1e-3 * rng.normal(size=(400, 2))  # 1 mm of independent noise
    mine = GaussianHMM(1, "full", random_state=0).fit(x)
    correlation = mine.covars_[0, 0, 1] / mine.covars_[0, 0, 0]
    assert abs(correlation) < 0.05
    peer = hmmlearn_hmm.GaussianHMM(1, "full", random_state=0).fit(x)
    assert peer.covars_[0, 0, 1] / peer.covars_[0, 0, 0] > 0.9  # why ours differs; if this fails they mended it


def test_an_offset_of_a_million_and_an_empty_state_are_no_trouble():
    rng = np.random.default_rng(2)
    x = np.concatenate([rng.normal(size=(50, 2)), rng.normal(size=(50, 2)) + 8.0])
    mine = GaussianHMM(2, "full", random_state=0, n_iter=30).fit(x + 1e6)
    plain = GaussianHMM(2, "full", random_state=0, n_iter=30).fit(x)
    np.testing.assert_allclose(mine.means_ - 1e6, plain.means_, atol=1e-6)
    empty = GaussianHMM(2, "full", init_params="", covars_prior=0.0)
    empty.startprob_, empty.transmat_ = [1.0, 0.0], [[1.0, 0.0], [0.0, 1.0]]
    empty.means_, empty.covars_ = x[[0, 99]], np.array([np.eye(2)] * 2)
    empty.fit(x)
    assert np.isfinite(empty.means_).all()
    np.testing.assert_allclose(empty.transmat_.sum(axis=1), 1.0)


def test_a_start_by_time_ends_above_their_random_starts():
    data = lifts(3, n_frames=100)
    fit = fit_hmm(data, 5, channels=CHANNELS, covariance_floor=1e-6)
    x, lengths = np.concatenate(data), [len(x) for x in data]
    logging.getLogger("hmmlearn").setLevel(logging.ERROR)
    for seed in range(3):
        peer = hmmlearn_hmm.GaussianHMM(5, "full", random_state=seed, n_iter=20, covars_prior=np.zeros((5, 3, 3)))
        with np.errstate(all="ignore"):
            peer.fit(x, lengths)
            assert fit.log_likelihood[-1] > peer.score(x, lengths)


def test_attributes_that_will_be_overwritten_and_data_too_few_are_logged(caplog):
    x = np.random.default_rng(0).normal(size=(100, 3))
    model = GaussianHMM(3)
    model.startprob_ = np.full(3, 1.0 / 3.0)
    model.fit(x)
    assert any("will be overwritten" in r.getMessage() for r in caplog.records)
    caplog.clear()
    GaussianHMM(3).fit(x[:5])
    assert any("degenerate solution" in r.getMessage() for r in caplog.records)


def test_sampling_can_go_on_from_a_state_and_a_seed_repeats_it():
    model = GaussianHMM(2, random_state=3).fit(np.random.default_rng(0).normal(size=(60, 2)))
    x, states = model.sample(20, random_state=5)
    again, _ = model.sample(20, random_state=5)
    np.testing.assert_array_equal(x, again)
    assert model.sample(5, currstate=1)[1][0] == 1
    assert x.shape == (20, 2)
    assert states.shape == (20,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"covariance_type": "round"}, "covariance_type must be one of"),
        ({"n_components": 0}, "whole number of at least 1"),
        ({"algorithm": "guess"}, "'viterbi' or 'map'"),
    ],
)
def test_wrong_arguments_are_value_errors(change, message):
    x = np.random.default_rng(0).normal(size=(30, 2))
    with pytest.raises(ValueError, match=message):
        GaussianHMM(**change).fit(x).predict(x)
    with pytest.raises(ValueError, match="sum to 30 samples"):
        GaussianHMM(1).fit(x).score(x, [10, 10])
    broken = GaussianHMM(2, init_params="mc")
    broken.startprob_, broken.transmat_ = [1.0, 1.0], np.eye(2)
    with pytest.raises(ValueError, match="must sum to 1"):
        broken.fit(x)
