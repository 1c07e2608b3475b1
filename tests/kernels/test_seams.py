"""Long lessons are cut into pieces: what the pieces say together is what the whole lesson says, also after a long dwell."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.fitting.baum_welch import Chain
from comanip.fitting.coordinates import Lessons
from comanip.fitting.hmm import fit_hmm, weights_of
from comanip.models import chains, hmm
from comanip.models.chains import log_of
from comanip.models.gaussian import log_density
from comanip.models.hmm import Hmm, sample

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")


def both(model, x):
    """Log-likelihood of one lesson x (T, D): compiled, and by the twin."""
    return hmm.log_likelihood(model, [x])[0], hmm._log_likelihood(model, x, np.array([len(x)]))[0]


def pieces_of(model, x, single=False):
    """In how many pieces the compiled kernels took the lesson in the end, and how far its log-likelihood is from the twin's."""
    groups = kernels.planned(np.array([len(x)]), single=single)
    found, failed = kernels.likelihoods(x, groups, model.initial, model.transition, model.whitening.arrays, single=single)
    assert not failed.any()
    return len(groups.plan.pieces), found[0] - hmm._log_likelihood(model, x, np.array([len(x)]))[0]


def beside_its_state(offset, n_rest=700, n_moved=4300):
    """A lesson that rests `offset` standard deviations off, beside its state, until behind a seam, and then goes on.

    Pieces that begin in the rest think that it has gone on already: nothing but the frames before them speaks against it. All
    agree on where it is, as the rest to come could be nowhere else.
    """
    model = Hmm([1.0, 0.0], [[1.0 - 1e-9, 1e-9], [0.0, 1.0]], [[0.0], [4.0]], [[[1.0]], [[1.0]]], ("x",))
    rng = np.random.default_rng(1)
    rest = 1.0 + offset + 0.05 * rng.normal(size=n_rest)
    return model, np.concatenate([rest, 4.0 + 0.3 * rng.normal(size=n_moved)])[:, None]


def test_what_the_filter_was_surprised_by_is_counted_once_and_whole(level):
    for n_rest in range(400, 1000, 7):
        model, x = beside_its_state(0.95, n_rest)
        assert hmm.log_likelihood(model, [x])[0] == pytest.approx(whole(n_rest), rel=1e-12), n_rest


@cache
def whole(n_rest):
    """The twin's likelihood of `beside_its_state(0.95, n_rest)`, once for all instruction sets."""
    model, x = beside_its_state(0.95, n_rest)
    return hmm._log_likelihood(model, x, np.array([len(x)]))[0]


@pytest.mark.parametrize("single", [False, True])
def test_pieces_that_agree_on_the_state_may_differ_in_surprise(level, single):
    """Of the frame at the seam all know from what follows that it is in the last state. What came before had that at e^-53: to
    get there a lesson must go through a state 12 standard deviations away. A piece that begins behind the way does not know."""
    transition = [[1.0 - 1e-9, 1e-9, 0.0], [0.0, 1.0 - 1e-9, 1e-9], [0.0, 0.0, 1.0]]
    model = Hmm([1.0, 0.0, 0.0], transition, [[0.0], [12.0], [1.5]], np.ones((3, 1, 1)), ("x",))
    cut = kernels.planned(np.array([6000]), single=single).plan.pieces
    seam = int(cut[1, 1])
    x = np.zeros((6000, 1))
    x[seam - 70] = 5.0  # the cheapest place to go through
    x[seam - 69 : seam] = 0.75  # halfway between the first state and the last: the margin tells nothing
    x[seam:] = 2.2
    n_pieces, apart = pieces_of(model, x, single)
    assert n_pieces == len(cut)
    assert abs(apart) < (2e-2 if single else 1e-7)


def with_dwell(rng, n_states, n_channels, cyclic):
    """States that last for 10 to 10,000 frames, some of which look alike: a task that comes back to where it rested."""
    stay = 1.0 - 10.0 ** -rng.uniform(1.0, 4.0, size=n_states)
    transition = np.diag(stay) + np.diag(1.0 - stay[:-1], k=1)
    transition[-1, 0] = 1.0 - stay[-1] if cyclic else 0.0
    transition[-1, -1] = stay[-1] if cyclic else 1.0
    means = rng.choice([0.1, 0.5, 2.0]) * rng.normal(size=(n_states, n_channels))
    means[-1] = means[0]
    covariances = np.array([np.diag(rng.uniform(0.02, 1.0, size=n_channels)) for _ in range(n_states)])
    return Hmm(np.eye(n_states)[0], transition, means, covariances, tuple(f"c{i}" for i in range(n_channels)))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6), n_states=st.integers(2, 10), n_channels=st.integers(1, 4), length=st.integers(3000, 14_000),
    cyclic=st.booleans(), drifts=st.booleans(),
)  # fmt: skip
def test_likelihood_and_sums_of_lessons_with_dwell_equal_the_twins(seed, n_states, n_channels, length, cyclic, drifts):
    rng = np.random.default_rng(seed)
    model = with_dwell(rng, n_states, n_channels, cyclic)
    x = sample(model, length, rng).frames
    if drifts:  # slower than noise: what people do
        x = 0.3 * x + 0.003 * np.cumsum(rng.normal(size=x.shape), axis=0)
    got, expected = both(model, x)
    assert got == pytest.approx(expected, rel=1e-11)
    lessons = Lessons(x, np.array([length]), np.zeros(n_channels), np.ones(n_channels), model.channels)
    chain = Chain(model.initial, model.transition, model.means, model.covariances)
    log_b = log_density(x, model.means, model.covariances)[None]
    twin = chains.expectations(log_b, lessons.lengths, log_of(model.initial), log_of(model.transition))
    np.testing.assert_allclose(weights_of(chain, lessons), twin.weights, atol=1e-8)


def resting_lessons(rng, n_lessons, n_rest):
    """Lifts that begin with a rest that creeps, and end with one where the next lesson would begin: (T, 2) position, velocity."""
    lessons = []
    for _ in range(n_lessons):
        rest, hold = (int(n_rest * rng.uniform(0.7, 1.3)) for _ in range(2))
        s = np.linspace(0.0, 1.0, 150)
        up = 0.3 * (10 * s**3 - 15 * s**4 + 6 * s**5)
        path = np.concatenate([np.zeros(rest), up, np.full(hold, 0.3), up[::-1], np.zeros(rest)])
        path += 2e-4 * np.cumsum(rng.normal(size=len(path)))
        lessons.append(np.column_stack([path, np.gradient(path, 0.01)]) + 1e-4 * rng.normal(size=(len(path), 2)))
    return lessons


@pytest.mark.parametrize("topology", ["left-right", "cyclic"])
@pytest.mark.parametrize("n_states", [5, 8, 10])
def test_the_likelihood_of_long_lessons_never_falls(topology, n_states):
    rng = np.random.default_rng(n_states)
    lessons = resting_lessons(rng, 2, 3000)
    fit = fit_hmm(lessons, n_states, channels=("position.z", "velocity.z"), topology=topology, max_iterations=40)
    assert (np.diff(fit.log_likelihood) >= -1e-9 * np.abs(fit.log_likelihood[:-1])).all()
    again = sum(both(fit.model, x)[1] for x in lessons)
    assert fit.log_likelihood[-1] == pytest.approx(again, rel=1e-9)
