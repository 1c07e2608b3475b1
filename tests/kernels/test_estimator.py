"""The peers' interfaces run on the compiled kernels and answer as they do without them."""

import numpy as np
import pytest

from comanip import kernels
from comanip.models import gmm as mixtures
from comanip.models import hmm
from comanip.models.gmr import regress
from comanip.peers import gaussian_hmm
from comanip.peers import gmm as gmm_module
from comanip.peers.base import EstimatorError
from comanip.peers.gaussian_hmm import GaussianHMM
from comanip.peers.gmm import GMM
from toys import random_gmm, random_hmm

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")

LENGTHS = [40, 1, 73, 20, 20, 55, 31, 9, 64, 12]


def data(seed=0, spread=3.0):
    model = random_hmm(np.random.default_rng(seed), 3, 2, spread=spread)
    return np.concatenate([hmm.sample(model, n, np.random.default_rng(n)).frames for n in LENGTHS])


def learned(x, covariance_type="full", **options):
    return GaussianHMM(3, covariance_type, n_iter=4, tol=-np.inf, random_state=0, **options).fit(x, LENGTHS)


def everything(m, x):
    score, path = m.decode(x, LENGTHS)
    return {
        "startprob_": m.startprob_, "transmat_": m.transmat_, "means_": m.means_, "covars_": m.covars_,
        "history": list(m.monitor_.history), "score": m.score(x, LENGTHS), "proba": m.predict_proba(x, LENGTHS),
        "best": score, "path": path, "map": m.decode(x, LENGTHS, "map")[0],
    }  # fmt: skip


def same(found, expected, tolerance=1e-7):  # iterations far from zero make more of a last digit
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=tolerance, atol=tolerance, err_msg=name)


def no_twin(*_):
    raise AssertionError("the twin took what the kernels can")


@pytest.mark.parametrize(
    "options",
    [{"covariance_type": c} for c in ("spherical", "diag", "tied", "full")]
    + [{"means_prior": 1.5, "means_weight": 3.0, "covars_prior": 0.2}, {"params": "sc"}, {"params": "tm"}],
)
def test_all_is_as_without_them(level, options, monkeypatch):
    x = data() + 1e4
    with monkeypatch.context() as m:
        m.setattr(GaussianHMM, "_twin", no_twin)
        found = everything(learned(x, **options), x)
    monkeypatch.setattr(kernels, "native", None)
    same(found, everything(learned(x, **options), x))


def far_apart():
    """Three states a thousand of their own standard deviations apart, and a start near them."""
    rng = np.random.default_rng(3)
    means = 1e4 * np.array([[0.0, 1.0], [1.0, 0.0], [-1.0, -1.0]])
    labels = rng.integers(3, size=sum(LENGTHS))
    m = GaussianHMM(3, "full", n_iter=1, init_params="", covars_prior=0.0)
    m.startprob_, m.transmat_ = np.full(3, 1 / 3), np.full((3, 3), 1 / 3)
    m.means_, m.covars_ = means + 1.0, np.array([np.eye(2)] * 3)
    return m, means[labels] + rng.normal(size=(len(labels), 2)), labels


def test_covariances_of_states_far_apart_keep_their_digits():
    m, x, labels = far_apart()
    m.fit(x, LENGTHS)
    expected = np.array([np.cov(x[labels == k].T, bias=True) for k in range(3)])
    np.testing.assert_allclose(m.covars_, expected, rtol=1e-10)


def test_sums_of_all_frames_would_not_be_enough_there(monkeypatch):
    """Else nobody would notice when the frames are never asked."""
    m, x, labels = far_apart()
    monkeypatch.setattr(gaussian_hmm, "loses_digits", lambda _: False)
    m.fit(x, LENGTHS)
    expected = np.array([np.cov(x[labels == k].T, bias=True) for k in range(3)])
    assert np.abs(m.covars_ / expected - 1.0).max() > 1e-9


@pytest.mark.parametrize("frame", [0, 41, sum(LENGTHS) - 1])
def test_scaling_refuses_a_frame_that_no_state_explains_and_log_takes_it(level, frame, monkeypatch):
    x = data()
    m = learned(x)
    m.implementation, m.init_params = "scaling", ""
    assert m.score(x, LENGTHS) == pytest.approx(learned(x).score(x, LENGTHS), rel=1e-12)
    x[frame] += 300.0
    for call in (m.score, m.predict_proba, m.fit):
        with pytest.raises(EstimatorError, match=f"cannot represent frame {frame}, which no state explains"):
            call(x, LENGTHS)
    m = learned(data())
    found = everything(m, x)
    monkeypatch.setattr(kernels, "native", None)
    same(found, everything(m, x))


def test_what_leaves_float64_goes_to_the_twin(monkeypatch):
    """Left-right, and the second sequence ends where only the first state could be: every path has a weight below 1e-308."""
    x = np.repeat([0.0, 50.0, 100.0, 0.0, 50.0, 100.0, 0.0, 0.0, 50.0, 100.0], 10)[:, None]
    x = x + np.random.default_rng(0).normal(size=x.shape)
    lengths = [30, 40, 30]

    def ask():
        m = GaussianHMM(3, "full", n_iter=2, tol=-np.inf, init_params="")
        m.startprob_, m.transmat_ = np.eye(3)[0], np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]])
        m.means_, m.covars_ = np.array([[0.0], [50.0], [100.0]]), np.ones((3, 1, 1))
        before = m.score(x, lengths), *m.score_samples(x, lengths), *m.decode(x, lengths)
        m.fit(x, lengths)
        return *before, m.means_, m.covars_, m.transmat_, list(m.monitor_.history)

    calls, twin = [], GaussianHMM._twin
    with monkeypatch.context() as patch:
        patch.setattr(GaussianHMM, "_twin", lambda *a: calls.append(a[3].tolist()) or twin(*a))
        found = ask()
    assert calls[:3] == [[False, True, False]] * 3
    monkeypatch.setattr(kernels, "native", None)
    for a, b in zip(found, ask(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("options", [{}, {"oracle_approximating_shrinkage": True}, {"init_params": "kmeans++"}])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_a_mixture_is_as_without_them(level, options, offset, monkeypatch):
    x = data() + offset

    def ask():
        m = GMM(3, random_state=0).from_samples(x, n_iter=6, R_diff=0.0, **options)
        return m.priors, m.means, m.covariances, m.to_responsibilities(x), m.predict([1], x[:, 1:])

    with monkeypatch.context() as patch:
        patch.setattr(gmm_module, "normalised", no_twin)
        found = ask()
    monkeypatch.setattr(kernels, "native", None)
    for a, b in zip(found, ask(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


def test_a_mixture_of_components_far_apart_keeps_its_digits():
    _, x, labels = far_apart()
    start = np.array([x[labels == k][0] for k in range(3)])
    m = GMM(3, np.full(3, 1 / 3), start, np.array([np.eye(2)] * 3)).from_samples(x, n_iter=1)
    expected = np.array([np.cov(x[labels == k].T, bias=True) for k in range(3)])
    np.testing.assert_allclose(m.covariances, expected, rtol=1e-10)


def test_shares_with_something_missing_are_those_of_the_twin(level, monkeypatch):
    rng = np.random.default_rng(1)
    model = random_gmm(rng, 4, 3)
    x = rng.normal(size=(70, 3))
    whole = mixtures.responsibilities(model, x), regress(model, "c0", "c1", x[:, :1], weights="mixture-with-priors").mean
    x[5, 1] = np.nan
    found = mixtures.responsibilities(model, x)
    np.testing.assert_allclose(np.delete(found, 5, axis=0), np.delete(whole[0], 5, axis=0), rtol=1e-10)
    monkeypatch.setattr(kernels, "native", None)
    np.testing.assert_array_equal(found, mixtures.responsibilities(model, x))
    twin = regress(model, "c0", "c1", x[:, :1], weights="mixture-with-priors").mean
    np.testing.assert_allclose(whole[1], twin, rtol=1e-10)
    assert mixtures.responsibilities(model, np.empty((0, 3))).shape == (0, 4)
