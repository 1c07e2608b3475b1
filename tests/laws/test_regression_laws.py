"""What must be true of Gaussian mixture regression whatever the implementation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.fitting.gmm import fit_gmm
from comanip.models import gmm
from comanip.models.gmm import Gmm
from comanip.models.gmr import Regression, conditional_lines, regress
from toys import random_gmm


def mapped(model, matrix, shift):
    """The model of matrix @ ξ + shift."""
    return Gmm(
        model.weights, model.means @ matrix.T + shift, matrix @ model.covariances @ matrix.T, model.channels
    )  # fmt: skip


def test_one_state_is_linear_regression():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 2))
    y = x @ np.array([[1.0, -2.0], [0.5, 3.0]]) + 4.0 + 0.1 * rng.normal(size=(300, 2))
    with pytest.warns(match="only one demonstration"):
        model = fit_gmm([np.hstack([x, y])], 1, channels=("x.a", "x.b", "y.a", "y.b"), covariance_floor=1e-9).model
    design = np.column_stack([x, np.ones(300)])
    coefficients, *_ = np.linalg.lstsq(design, y, rcond=None)
    found = regress(model, "x", "y", x)
    np.testing.assert_allclose(found.mean, design @ coefficients, rtol=1e-9, atol=1e-9)
    residual = y - design @ coefficients
    np.testing.assert_allclose(found.covariance[0], residual.T @ residual / 300, rtol=1e-7, atol=1e-10)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(-3, 3), st.floats(-3, 3), st.floats(-1e3, 1e3))
def test_regression_commutes_with_affine_maps_of_inputs_and_outputs(seed, log_in, log_out, shift):
    rng = np.random.default_rng(seed)
    model = random_gmm(rng, 3, 4)
    matrix = np.zeros((4, 4))  # inputs c0, c1 and outputs c2, c3 are mapped among themselves
    matrix[:2, :2] = 10.0**log_in * (rng.normal(size=(2, 2)) + 3.0 * np.eye(2))
    matrix[2:, 2:] = 10.0**log_out * (rng.normal(size=(2, 2)) + 3.0 * np.eye(2))
    offset = shift * np.ones(4)
    x = 2.0 * rng.normal(size=(5, 2))
    plain = regress(model, ("c0", "c1"), ("c2", "c3"), x, weights="mixture-with-priors")
    other = regress(
        mapped(model, matrix, offset), ("c0", "c1"), ("c2", "c3"), x @ matrix[:2, :2].T + offset[:2],
        weights="mixture-with-priors",
    )  # fmt: skip
    out = matrix[2:, 2:]
    tolerance = 1e-7 * (10.0**log_out + abs(shift))
    np.testing.assert_allclose(other.mean, plain.mean @ out.T + offset[2:], rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(other.covariance, out @ plain.covariance @ out.T, rtol=1e-5, atol=1e-6 * 100.0**log_out)


def test_permuting_the_states_changes_nothing():
    rng = np.random.default_rng(2)
    model = random_gmm(rng, 5)
    p = rng.permutation(5)
    other = Gmm(model.weights[p], model.means[p], model.covariances[p], model.channels)
    x = rng.normal(size=(20, 2))
    for weights in ("mixture", "mixture-with-priors"):
        first = regress(model, ("c0", "c2"), "c1", x, weights=weights)
        second = regress(other, ("c0", "c2"), "c1", x, weights=weights)
        np.testing.assert_allclose(first.mean, second.mean, rtol=1e-10)
        np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-10)


@pytest.mark.parametrize("correlation", [0.9, 0.9999, 0.99999999])
def test_inputs_that_almost_repeat_each_other_are_still_told_apart(correlation):
    inputs = np.array([[1.0, correlation], [correlation, 1.0]])
    slopes = np.array([2.0, -3.0])
    covariance = np.block([[inputs, (inputs @ slopes)[:, None]], [slopes @ inputs, slopes @ inputs @ slopes + 0.1]])
    model = Gmm([1.0], np.zeros((1, 3)), covariance[None], ("a", "b", "y"))
    np.testing.assert_allclose(Regression(model, ("a", "b"), "y").gains[0, 0], slopes, rtol=1e-6)


def test_the_conditional_agrees_with_samples_near_the_input():
    rng = np.random.default_rng(3)
    model = random_gmm(rng, 2, 2, spread=1.5)
    drawn = gmm.sample(model, 400_000, rng)
    at = 0.4
    near = drawn[np.abs(drawn[:, 0] - at) < 0.02, 1]
    found = regress(model, "c0", "c1", [[at]], weights="mixture-with-priors")
    assert found.mean[0, 0] == pytest.approx(near.mean(), abs=4.0 * near.std() / np.sqrt(len(near)))
    assert found.covariance[0, 0, 0] == pytest.approx(near.var(), rel=0.06)


def test_covariances_stay_positive_and_disagreement_adds_to_them():
    rng = np.random.default_rng(4)
    model = random_gmm(rng, 4)
    x = 5.0 * rng.normal(size=(50, 1))
    found = regress(model, "c0", ("c1", "c2"), x)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    regression = Regression(model, "c0", ("c1", "c2"))
    even = np.full(4, 0.25)
    apart = regression.predict(even, x[0]).covariance - np.einsum("k,kij->ij", even, regression.covariances)
    assert np.linalg.eigvalsh(apart).min() > -1e-12


def test_doubtful_inputs_pull_the_answer_to_the_centre_and_widen_it():
    model = random_gmm(np.random.default_rng(5), 1, 2)
    x = model.means[:, :1] + 3.0
    sharp = regress(model, "c0", "c1", x)
    doubtful = regress(model, "c0", "c1", x, input_noise={"c0": 1e6})
    assert abs(doubtful.mean[0, 0] - model.means[0, 1]) < 1e-3 * abs(sharp.mean[0, 0] - model.means[0, 1])
    assert doubtful.covariance[0, 0, 0] == pytest.approx(model.covariances[0, 1, 1], rel=1e-4)


@pytest.mark.parametrize("n_channels", [1, 2, 3, 5])
@pytest.mark.parametrize("alpha", [0.6827, 0.95])
def test_a_region_holds_as_many_samples_as_it_says(n_channels, alpha):
    rng = np.random.default_rng(6)
    model = random_gmm(rng, 1, n_channels)
    inside = gmm.in_confidence_region(model, gmm.sample(model, 20_000, rng), alpha)
    assert inside.mean() == pytest.approx(alpha, abs=0.015)


def test_the_covariance_is_that_of_the_mixture_as_a_whole():
    """Two states that are certain, 2 apart, as likely as each other: all of the variance, 1, is their disagreement."""
    near = np.array([[[1.0, 0.0], [0.0, 1e-8]]] * 2)
    model = Gmm([0.5, 0.5], np.array([[0.0, -1.0], [0.0, 1.0]]), near, ("x", "y"))
    found = regress(model, "x", "y", np.zeros((1, 1)), weights="mixture-with-priors")
    assert found.mean[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert found.covariance[0, 0, 0] == pytest.approx(1.0 + 1e-8, rel=1e-9)
    uneven = regress(Gmm([0.9, 0.1], model.means, near, ("x", "y")), "x", "y", np.zeros((1, 1)), weights="mixture-with-priors")
    assert uneven.covariance[0, 0, 0] == pytest.approx(4.0 * 0.9 * 0.1 + 1e-8, rel=1e-9)


def test_noise_of_an_input_counts_in_the_weights_as_in_the_lines():
    """Two states side by side; with much noise on the input nothing says which it is."""
    model = Gmm([0.5, 0.5], [[-1.0, 0.0], [1.0, 8.0]], np.array([np.diag([0.1, 0.1])] * 2), ("x", "y"))
    clear = Regression(model, "x", "y").shares(np.array([[0.9]]))
    doubtful = Regression(model, "x", "y", input_noise={"x": 100.0}).shares(np.array([[0.9]]))
    expected = np.exp(-0.5 * np.array([1.9, -0.1]) ** 2 / 100.1)
    assert clear[0, 1] > 0.999
    np.testing.assert_allclose(doubtful[0], expected / expected.sum(), rtol=1e-9)
    found = regress(model, "x", "y", np.array([[0.9]]), input_noise={"x": 100.0})
    np.testing.assert_allclose(found.mean[0, 0], 8.0 * doubtful[0, 1], rtol=1e-9)


def test_an_input_that_is_missing_leaves_the_noise_of_the_others():
    model = random_gmm(np.random.default_rng(6), 3)
    x = np.array([[0.4, np.nan]])
    noise = {"c0": 2.5, "c1": 0.7}
    found = regress(model, ("c0", "c1"), "c2", x, input_noise=noise, weights=np.array([[0.2, 0.3, 0.5]]))
    alone = regress(model, "c0", "c2", x[:, :1], input_noise={"c0": 2.5}, weights=np.array([[0.2, 0.3, 0.5]]))
    np.testing.assert_allclose(found.mean, alone.mean, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-12)


def test_an_axis_that_was_locked_says_nothing_though_rounding_does():
    """A constant 1e6 m away varies by rounding alone, and that goes with everything."""
    rounding = 1e-18
    covariance = np.array([[rounding, 0.0, 0.5 * rounding**0.5], [0.0, 1.0, 2.0], [0.5 * rounding**0.5, 2.0, 5.0]])
    model = Gmm([1.0], [[1e6, 0.0, 0.0]], covariance[None], ("locked", "free", "y"))
    gains = Regression(model, ("locked", "free"), "y").gains[0, 0]
    np.testing.assert_allclose(gains, [0.0, 2.0], rtol=1e-12)


def test_inputs_that_repeat_each_other_have_finite_gains():
    """What goes with their difference is rounding: divided by a variance of 1e-17 it would be a gain of hundreds."""
    covariance = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 1e-13], [1.0, 1.0 + 1e-13, 2.0]])
    gains = conditional_lines(np.zeros((1, 3)), covariance[None], np.array([0, 1]), np.array([2])).gains[0, 0]
    assert np.abs(gains).max() < 10.0
    assert gains.sum() == pytest.approx(1.0, rel=1e-6)


def test_an_input_in_a_tiny_unit_is_not_taken_for_one_that_repeats_others():
    scale = np.diag([1.0, 1e-9, 1.0])
    covariance = scale @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 3.0]]) @ scale
    gains = conditional_lines(np.zeros((1, 3)), covariance[None], np.array([0, 1]), np.array([2])).gains[0, 0]
    np.testing.assert_allclose(gains, [1.0, 1e9], rtol=1e-9)
