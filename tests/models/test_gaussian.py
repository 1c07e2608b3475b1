import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.models import gaussian
from toys import random_covariances

RNG = np.random.default_rng(0)
MEANS = RNG.normal(size=(3, 2))
COVARIANCES = random_covariances(RNG, 3, 2)


def test_log_densities_are_those_of_the_formula():
    x = RNG.normal(size=(10, 2))
    found = gaussian.log_density(x, MEANS, COVARIANCES)
    for k in range(3):
        apart = x - MEANS[k]
        distance = np.einsum("ni,ij,nj->n", apart, np.linalg.inv(COVARIANCES[k]), apart)
        expected = -0.5 * (distance + np.log(np.linalg.det(2.0 * np.pi * COVARIANCES[k])))
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-10)


def test_densities_do_not_lose_digits_a_million_metres_away():
    x = MEANS + 1e-3
    near = gaussian.log_density(x, MEANS, COVARIANCES * 1e-6)
    far = gaussian.log_density(x + 1e6, MEANS + 1e6, COVARIANCES * 1e-6)
    np.testing.assert_allclose(near.max(axis=1), far.max(axis=1), rtol=1e-4)


def test_missing_channels_give_the_marginal_and_nothing_gives_no_evidence():
    x = np.array([[0.3, np.nan], [np.nan, -0.2], [np.nan, np.nan], [0.1, 0.2]])
    found = gaussian.log_density(x, MEANS, COVARIANCES)
    for row, column in ((0, 0), (1, 1)):
        variance = COVARIANCES[:, column, column]
        expected = -0.5 * ((x[row, column] - MEANS[:, column]) ** 2 / variance + np.log(2.0 * np.pi * variance))
        np.testing.assert_allclose(found[row], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[2], 0.0)
    np.testing.assert_array_equal(found[3], gaussian.log_density(x[3:], MEANS, COVARIANCES)[0])


@pytest.mark.parametrize("value", [1e5, 1e150, 1e308])
def test_densities_of_what_no_sensor_says_are_finite(value):
    assert np.isfinite(gaussian.log_density(np.array([[value, -value]]), MEANS, COVARIANCES)).all()


def test_the_floor_raises_small_eigenvalues_and_leaves_the_others():
    turned = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    covariance = turned @ np.diag([1e-9, 0.5, 2.0]) @ turned.T
    found = gaussian.floored(covariance[None], 1e-4)[0]
    np.testing.assert_allclose(np.linalg.eigvalsh(found), [1e-4, 0.5, 2.0], rtol=1e-9)
    assert gaussian.floored(COVARIANCES, 1e-12) is COVARIANCES


def test_the_floor_is_the_most_likely_covariance_above_it():
    scatter = np.diag([1e-3, 1.0])

    def log_likelihood(sigma):
        return -np.linalg.slogdet(sigma)[1] - np.trace(np.linalg.solve(sigma, scatter))

    best = log_likelihood(gaussian.floored(scatter[None], 0.01)[0])
    rng = np.random.default_rng(1)
    for _ in range(300):
        root = rng.normal(size=(2, 2))
        assert log_likelihood(0.01 * np.eye(2) + root @ root.T * rng.uniform(0.0, 2.0)) <= best


def test_a_covariance_that_is_none_names_its_state():
    broken = COVARIANCES.copy()
    broken[2] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(ParameterError, match="state 2 is not positive definite"):
        gaussian.whitening(MEANS, broken)
