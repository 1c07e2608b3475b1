"""What runs can be pickled and copied, in mid-run too: the copy goes on alike, and the two do not touch each other."""

import copy
import pickle

import numpy as np
import pytest

from comanip.fitting.hmm import fit_hmm
from comanip.fitting.hsmm import fit_hsmm
from comanip.interfaces import Command, Observation
from comanip.models.filtering import DurationFilter, ForwardFilter
from comanip.models.gmr import Regression
from comanip.skills.paper import PaperLaw, PaperSkill
from toys import CHANNELS, lifts

WAYS = [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
LESSONS = lifts(3)
HMM, HSMM = fit_hmm(LESSONS, 4, channels=CHANNELS), fit_hsmm(LESSONS, 4, channels=CHANNELS)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("kind", "model"), [(ForwardFilter, HMM.model), (DurationFilter, HSMM.model)])
def test_a_filter_goes_on_in_its_copy(way, kind, model):
    one = kind(model)
    for x in LESSONS[0][:60]:
        one.step(x)
    other = way(one)
    before = one.weights.copy()
    np.testing.assert_array_equal(other.weights, before)
    for x in LESSONS[0][60:120]:
        other.step(x)
    np.testing.assert_array_equal(one.weights, before)
    for x in LESSONS[0][60:120]:
        one.step(x)
    np.testing.assert_array_equal(one.weights, other.weights)
    assert one.log_likelihood == other.log_likelihood
    for both in (one, other):
        both.step(np.array([np.nan, 1.0, 0.0]))  # the readable tick, too
    np.testing.assert_array_equal(one.weights, other.weights)


@pytest.mark.parametrize("way", WAYS)
def test_a_regression_and_a_fit_are_the_same_in_their_copies(way):
    one = Regression(HMM.model, ("position", "force"), "velocity")
    h = np.full(4, 0.25)
    np.testing.assert_array_equal(way(one).mean(h, np.array([0.1, 2.0])), one.mean(h, np.array([0.1, 2.0])))
    np.testing.assert_array_equal(way(HMM).model.means, HMM.model.means)
    np.testing.assert_array_equal(way(HSMM).model.durations, HSMM.model.durations)


@pytest.mark.parametrize("way", WAYS)
def test_the_papers_skill_goes_on_in_its_copy(way):
    one = PaperSkill(
        HMM.model, axes=("z",), dt=0.01, model_dt=0.01, workspace=np.array([[-0.1, 0.5]]), law=PaperLaw(integrator="exact")
    )
    obs, a, b = Observation(1), Command(1), Command(1)
    one.reset(obs)
    for k in range(40):
        obs.time, obs.force[:] = 0.01 * k, 2.0
        one.step(obs, a)
        obs.position[:], obs.velocity[:] = a.position, a.velocity
    other = way(one)
    for k in range(40, 60):
        obs.time = 0.01 * k
        one.step(obs, a)
        other.step(obs, b)
        np.testing.assert_array_equal(a.velocity, b.velocity)
    np.testing.assert_array_equal(one.diagnostics["weights"], other.diagnostics["weights"])
