"""A change of unit or of world frame changes no answer."""

import numpy as np
import pytest

from comanip.fitting.gmm import fit_gmm
from comanip.fitting.hmm import fit_hmm
from comanip.models import hmm
from comanip.models.filtering import ForwardFilter
from comanip.models.gmr import regress
from toys import CHANNELS, lifts

DATA = lifts(4)
SCALES = [1e6, 1e-6, 1e3, 1e-3]


def answers(fit, scale, shift):
    """Predicted velocities of one demonstration, and the states of it, brought back to the original units."""
    x = DATA[0] * scale + shift
    forward = ForwardFilter(fit.model)
    weights = np.array([forward.step(xi).copy() for xi in x])
    found = regress(fit.model, ("position", "force"), "velocity", x[:, :2], weights=weights)
    return (found.mean[:, 0] - shift[2]) / scale[2], found.covariance[:, 0, 0] / scale[2] ** 2, weights


PLAIN = fit_hmm(DATA, 5, channels=CHANNELS)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("channel", range(3))
def test_t3_a_unit_a_million_times_larger_or_smaller_changes_no_answer(channel, scale):
    scales = np.ones(3)
    scales[channel] = scale
    fit = fit_hmm([x * scales for x in DATA], 5, channels=CHANNELS)
    assert fit.n_iterations == PLAIN.n_iterations
    for found, expected in zip(answers(fit, scales, np.zeros(3)), answers(PLAIN, np.ones(3), np.zeros(3)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("channel", range(3))
def test_t4_a_world_frame_a_million_units_away_changes_no_answer(channel):
    shift = np.zeros(3)
    shift[channel] = 1e6
    fit = fit_hmm([x + shift for x in DATA], 5, channels=CHANNELS)
    assert fit.notes == ()  # no channel looks like another because both are far from zero
    for found, expected in zip(answers(fit, np.ones(3), shift), answers(PLAIN, np.ones(3), np.zeros(3)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_differences_of_likelihood_have_no_unit():
    scales = np.array([1e3, 1e-2, 1e3])
    other = fit_hmm([x * scales for x in DATA], 5, channels=CHANNELS)
    np.testing.assert_allclose(np.diff(other.log_likelihood), np.diff(PLAIN.log_likelihood), rtol=1e-6, atol=1e-6)
    n_frames = sum(len(x) for x in DATA)
    assert other.log_likelihood[-1] - PLAIN.log_likelihood[-1] == pytest.approx(-n_frames * np.log(scales).sum())
    assert PLAIN.log_likelihood[-1] == pytest.approx(hmm.log_likelihood(PLAIN.model, DATA).sum())


def test_a_mixture_does_not_care_for_units_either():
    scales = np.array([1e6, 1.0, 1e-6])
    plain, other = fit_gmm(DATA, 4, channels=CHANNELS), fit_gmm([x * scales for x in DATA], 4, channels=CHANNELS)
    np.testing.assert_allclose(other.model.means / scales, plain.model.means, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(other.model.weights, plain.model.weights, rtol=1e-6)
