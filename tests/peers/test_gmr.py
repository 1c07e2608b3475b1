"""gmr as an oracle: same parameters, same numbers; and its interface, used as its users do."""

import numpy as np
import pytest

from comanip import GMM, MVN, GaussianMixtureRegressor
from comanip.models.gmm import in_confidence_region, log_likelihood, responsibilities
from comanip.models.gmr import regress
from comanip.peers.gmm import covariance_initialization, kmeansplusplus_initialization, plot_error_ellipses
from toys import random_gmm

gmr = pytest.importorskip("gmr")


def both(model, seed=0):
    arguments = (model.n_states, model.weights, model.means, model.covariances)
    return GMM(*arguments, random_state=seed), gmr.GMM(*arguments, random_state=seed)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("inputs", [(0,), (1, 2), (0, 2, 3)])
def test_regression_equals_their_conditional(seed, inputs):
    rng = np.random.default_rng(seed)
    model = random_gmm(rng, 4, 5)
    x = 2.0 * rng.normal(size=(20, len(inputs)))
    mine, peer = both(model)
    names = [f"c{i}" for i in inputs]
    others = [f"c{i}" for i in range(5) if i not in inputs]
    found = regress(model, names, others, x, weights="mixture-with-priors")
    np.testing.assert_allclose(found.mean, peer.predict(np.array(inputs), x), atol=1e-10)
    np.testing.assert_allclose(mine.predict(np.array(inputs), x), found.mean, atol=1e-10)
    for n in range(3):
        whole = peer.condition(np.array(inputs), x[n]).to_mvn()
        np.testing.assert_allclose(found.mean[n], whole.mean, atol=1e-10)
        np.testing.assert_allclose(found.covariance[n], whole.covariance, atol=1e-9)
        mine_whole = mine.condition(np.array(inputs), x[n]).to_mvn()
        np.testing.assert_allclose(mine_whole.covariance, whole.covariance, atol=1e-9)


def test_densities_and_responsibilities_equal_theirs():
    rng = np.random.default_rng(1)
    model = random_gmm(rng, 3, 2)
    x = 2.0 * rng.normal(size=(50, 2))
    mine, peer = both(model)
    np.testing.assert_allclose(np.exp(log_likelihood(model, x)), peer.to_probability_density(x), rtol=1e-10)
    np.testing.assert_allclose(mine.to_probability_density(x), peer.to_probability_density(x), rtol=1e-10)
    np.testing.assert_allclose(responsibilities(model, x), peer.to_responsibilities(x), atol=1e-10)
    np.testing.assert_allclose(mine.to_responsibilities(x), peer.to_responsibilities(x), atol=1e-10)
    one, their_one = mine.extract_mvn(1), peer.extract_mvn(1)
    np.testing.assert_allclose(one.to_probability_density(x), their_one.to_probability_density(x), rtol=1e-10)
    distance = [their_one.squared_mahalanobis_distance(row) for row in x]
    np.testing.assert_allclose(mine.to_mahalanobis_distance(x)[:, 1] ** 2, distance, rtol=1e-9)
    factor, exponents = one.to_norm_factor_and_exponents(x)
    np.testing.assert_allclose(factor * np.exp(exponents), their_one.to_probability_density(x), rtol=1e-10)


def test_learning_from_the_same_start_finds_the_same_mixture():
    rng = np.random.default_rng(2)
    x = np.concatenate([rng.normal(size=(200, 2)), rng.normal(size=(200, 2)) * [0.5, 2.0] + [4.0, 1.0]])
    mine, peer = GMM(2, random_state=3).from_samples(x), gmr.GMM(2, random_state=3).from_samples(x)
    np.testing.assert_allclose(mine.priors, peer.priors, atol=1e-8)
    np.testing.assert_allclose(mine.means, peer.means, atol=1e-8)
    np.testing.assert_allclose(mine.covariances, peer.covariances, atol=1e-8)
    np.testing.assert_allclose(mine.sample(50), peer.sample(50), atol=1e-8)
    np.testing.assert_allclose(mine.to_mvn().covariance, np.cov(x.T, bias=True), atol=1e-3)
    shrunk = [g.from_samples(x, n_iter=3, oracle_approximating_shrinkage=True) for g in (mine, peer)]
    np.testing.assert_allclose(shrunk[0].covariances, shrunk[1].covariances, atol=1e-8)


def test_metres_against_millimetres_leave_responsibilities_alone():
    model = random_gmm(np.random.default_rng(3), 3, 4)
    x = np.random.default_rng(4).normal(size=(30, 4))
    scale = np.array([1e-7, 1.0, 1e6, 1e-3])
    small = GMM(3, model.weights, model.means * scale, model.covariances * np.outer(scale, scale))
    expected = responsibilities(model, x)
    np.testing.assert_allclose(small.to_responsibilities(x * scale), expected, atol=1e-9)


def test_samples_on_two_lines_without_noise_are_learned():
    x = np.linspace(0.0, 2.0, 200)[:, None]
    y = np.where(x < 1.0, 3.0 * x + 1.0, -3.0 * x + 7.0)
    mixture = GMM(2, random_state=0).from_samples(np.hstack([x, y]))
    np.testing.assert_allclose(mixture.priors, 0.5, atol=0.01)
    assert np.mean((mixture.predict([0], x) - y) ** 2) < 0.01
    line = MVN().from_samples(np.hstack([x, 3.0 * x + 1.0]))
    found = line.predict([0], x)
    np.testing.assert_allclose(found.mean, 3.0 * x + 1.0, atol=1e-6)
    assert found.covariance[0, 0] < 1e-10


@pytest.mark.parametrize("alpha", [0.5, 0.6827, 0.95])
def test_the_peers_region_is_kept_and_the_exact_one_is_larger(alpha):
    model = random_gmm(np.random.default_rng(5), 1, 3)
    mine, peer = both(model)
    inside = 0
    for x in mine.sample(300):
        assert mine.is_in_confidence_region(x, alpha) == peer.is_in_confidence_region(x, alpha)
        inside += mine.is_in_confidence_region(x, alpha)
        assert in_confidence_region(model, x[None], alpha)[0] >= mine.is_in_confidence_region(x, alpha)
    for x in mine.sample_confidence_region(20, alpha):
        assert mine.is_in_confidence_region(x, alpha)


def test_the_interval_of_one_dimension_is_cut_at_the_standard_deviation():
    one = MVN(mean=[0.0], covariance=[[0.01]])
    assert one.is_in_confidence_region([0.099], 0.6827)
    assert not one.is_in_confidence_region([0.101], 0.6827)


def test_marginals_conditionals_and_ellipses_of_one_gaussian_equal_theirs():
    rng = np.random.default_rng(6)
    model = random_gmm(rng, 1, 3)
    mine, peer = MVN(model.means[0], model.covariances[0]), gmr.MVN(model.means[0], model.covariances[0])
    kept, theirs = mine.marginalize([0, 2]), peer.marginalize(np.array([0, 2]))
    np.testing.assert_allclose(kept.covariance, theirs.covariance)
    for a, b in zip(kept.to_ellipse(2.0), theirs.to_ellipse(2.0), strict=True):
        assert a == pytest.approx(b, abs=1e-12)
    given, their_given = mine.condition([1], [0.3]), peer.condition(np.array([1]), np.array([0.3]))
    np.testing.assert_allclose(given.mean, their_given.mean, atol=1e-10)
    np.testing.assert_allclose(given.covariance, their_given.covariance, atol=1e-10)
    points = mine.sigma_points(alpha=0.7, kappa=2.0)
    turned = points @ rng.normal(size=(3, 2))
    found = mine.estimate_from_sigma_points(turned, alpha=0.7, kappa=2.0)
    expected = peer.estimate_from_sigma_points(turned, alpha=0.7, kappa=2.0)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-9)
    np.testing.assert_allclose(found.mean, expected.mean, atol=1e-9)


def test_first_guesses_equal_theirs_where_nothing_is_drawn():
    x = np.random.default_rng(7).normal(size=(40, 3))
    np.testing.assert_allclose(covariance_initialization(x, 3), gmr.covariance_initialization(x, 3), rtol=1e-9)
    centres = kmeansplusplus_initialization(x, 5, 0)
    assert len(np.unique(centres, axis=0)) == 5
    for n in (0, 41):
        with pytest.raises(ValueError, match="n_components must be from 1 to the 40 samples"):
            kmeansplusplus_initialization(x, n, 0)


@pytest.mark.parametrize("call", ["sample", "to_probability_density", "to_ellipses", "to_mvn", "extract_mvn"])
def test_a_mixture_that_was_not_set_says_so(call):
    arguments = {"sample": (5,), "to_probability_density": (np.ones((1, 2)),), "extract_mvn": (0,)}.get(call, ())
    with pytest.raises(ValueError, match="have not all been set"):
        getattr(GMM(2, priors=[0.5, 0.5]), call)(*arguments)
    with pytest.raises(ValueError, match="have not been set"):
        MVN(mean=[0.0]).sample(3)


def test_ellipses_are_drawn_for_every_component_and_factor():
    pytest.importorskip("matplotlib")

    class Axis:
        drawn = 0

        def add_artist(self, artist):
            self.drawn += 1

    axis = Axis()
    plot_error_ellipses(axis, both(random_gmm(np.random.default_rng(8), 2, 2))[0], colors=["r", "g"])
    assert axis.drawn == 16


def test_the_regressor_predicts_in_the_shape_of_its_target():
    x = np.linspace(0.0, 2.0, 200)[:, None]
    y = np.where(x < 1.0, 3.0 * x + 1.0, -3.0 * x + 7.0) + 0.01 * np.random.default_rng(0).normal(size=x.shape)
    regressor = GaussianMixtureRegressor(2, random_state=0).fit(x, y)
    assert np.mean((regressor.predict(x) - y) ** 2) < 0.01
    assert GaussianMixtureRegressor(2, random_state=0).fit(x, y[:, 0]).predict(x).shape == (200,)
