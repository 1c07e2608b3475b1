"""What an estimator of the peers' interfaces cannot use it refuses, in one line that names the argument."""

import warnings

import numpy as np
import pytest

from comanip import GMM, MVN, GaussianHMM
from comanip.models.chains import log_of
from comanip.models.gaussian import log_density
from comanip.peers import mvn

X = np.random.default_rng(0).normal(size=(180, 2))


def known(**changes):
    """A model of two states and two features, set by hand, with `changes`."""
    model = GaussianHMM(2, "diag", init_params="", n_iter=3)
    values = {
        "startprob_": [1.0, 0.0], "transmat_": [[0.9, 0.1], [0.1, 0.9]], "means_": [[0.0, 0.0], [3.0, 3.0]],
        "covars_": np.ones((2, 2)), **changes,
    }  # fmt: skip
    for name, value in values.items():
        setattr(model, name, np.array(value))
    return model


USES = {
    "fit": lambda m: m.fit(X),
    "score": lambda m: m.score(X),
    "predict": lambda m: m.predict(X),
    "predict_proba": lambda m: m.predict_proba(X),
    "decode": lambda m: m.decode(X),
    "sample": lambda m: m.sample(3),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transmat_": [[1.2, -0.2], [0.1, 0.9]]}, "transmat_ must be probabilities, none below 0; got -0.2"),
        ({"startprob_": [1.5, -0.5]}, "startprob_ must be probabilities, none below 0; got -0.5"),
        ({"startprob_": [np.nan, 1.0]}, "startprob_ must be probabilities, none below 0; got nan"),
        ({"transmat_": [[0.5, 0.4], [0.1, 0.9]]}, "transmat_ must sum to 1"),
        ({"means_": [[np.nan, 0.0], [3.0, 3.0]]}, "mean of state 0, feature 0 is nan"),
        ({"means_": [[0.0, 0.0], [3.0, np.inf]]}, "mean of state 1, feature 1 is inf"),
        ({"covars_": np.ones((2, 3))}, "covars_ are of 3 features, and means_ of 2"),
        ({"means_": [[0.0], [3.0]]}, "covars_ are of 2 features, and means_ of 1"),
    ],
)
def test_parameters_that_cannot_be_are_refused_whatever_is_done_with_them(use, change, message):
    with pytest.raises(ValueError, match=message):
        USES[use](known(**change))


@pytest.mark.parametrize("use", sorted(set(USES) - {"sample"}))
@pytest.mark.parametrize("covariance_type", ["diag", "full", "tied", "spherical"])
def test_parameters_of_another_width_than_the_data_are_refused(use, covariance_type):
    model = GaussianHMM(2, covariance_type, init_params="", n_iter=3)
    model.startprob_, model.transmat_, model.means_ = np.array([0.5, 0.5]), np.full((2, 2), 0.5), np.array([[0.0], [3.0]])
    model.covars_ = {"diag": np.ones((2, 1)), "full": np.ones((2, 1, 1)), "tied": np.eye(1), "spherical": np.ones(2)}[
        covariance_type
    ]
    with pytest.raises(ValueError, match="X has 2 features, but GaussianHMM is expecting 1 features"):
        USES[use](model)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("covariance_type", ["diag", "full", "tied", "spherical"])
def test_covariances_that_are_not_finite_are_refused_where_they_are_set(covariance_type, value):
    model = GaussianHMM(2, covariance_type)
    covars = {"diag": np.ones((2, 2)), "full": np.tile(np.eye(2), (2, 1, 1)), "tied": np.eye(2), "spherical": np.ones(2)}[
        covariance_type
    ]
    covars.flat[0] = value
    with pytest.raises(ValueError, match="not finite"):
        model.covars_ = covars


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"params": "xyz"}, "params is made of the letters s"),
        ({"init_params": "q"}, "init_params is made of the letters s"),
        ({"implementation": "fast"}, "implementation must be 'log' or 'scaling'; got 'fast'"),
        ({"n_iter": -1}, "n_iter must be a whole number of at least 0; got -1"),
        ({"n_components": 2.5}, "n_components must be a whole number"),
        ({"min_covar": np.nan}, "min_covar must be a variance"),
    ],
)
def test_an_option_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        GaussianHMM(**options).fit(X)


def test_numbers_whose_squares_leave_float64_are_named():
    with pytest.raises(ValueError, match=r"value too large: sample 0, feature 0"):
        GaussianHMM(2, random_state=0).fit(X * 1e200)
    with pytest.raises(ValueError, match="value too large"):
        GMM(2, random_state=0).from_samples(X * 1e200)


def test_one_number_is_a_length_as_with_hmmlearn():
    a, b = GaussianHMM(2, random_state=0).fit(X, 180), GaussianHMM(2, random_state=0).fit(X)
    np.testing.assert_array_equal(a.means_, b.means_)
    with pytest.raises(ValueError, match="sum to 180 samples; got 179"):
        GaussianHMM(2).fit(X, 179)


@pytest.mark.parametrize("currstate", [-1, 3, 1.5, True])
def test_a_state_to_go_on_from_is_one_of_the_model(currstate):
    with pytest.raises(ValueError, match="currstate must be"):
        GaussianHMM(3, random_state=0).fit(X).sample(3, currstate=currstate)


def test_the_score_of_the_states_that_are_best_one_by_one_is_that_paths_log_probability():
    lengths = [100, 80]
    model = GaussianHMM(3, random_state=0).fit(X, lengths)
    found, states = model.decode(X, lengths, algorithm="map")
    log_b = log_density(X, model.means_, model.covars_)[np.arange(180), states]
    steps = log_of(model.transmat_)[states[:-1], states[1:]]
    expected = log_b.sum() + steps.sum() - steps[99] + log_of(model.startprob_)[states[[0, 100]]].sum()
    assert found == pytest.approx(expected, rel=1e-12)
    best, path = model.decode(X, lengths)
    assert found <= best
    model.algorithm = "map"
    np.testing.assert_array_equal(model.predict(X, lengths), states)
    steps = log_of(model.transmat_)[path[:-1], path[1:]]
    score = log_density(X, model.means_, model.covars_)[np.arange(180), path].sum() + steps.sum() - steps[99]
    assert best == pytest.approx(score + log_of(model.startprob_)[path[[0, 100]]].sum(), rel=1e-12)


def test_states_that_no_transition_joins_have_probability_0():
    """State 0 leads to 3, and 1 and 2 lead to 4: at first 0 is the likeliest, and then 4."""
    ways = GaussianHMM(5, "diag", init_params="")
    ways.startprob_, ways.means_, ways.covars_ = np.array([0.4, 0.3, 0.3, 0.0, 0.0]), np.zeros((5, 1)), np.ones((5, 1))
    ways.transmat_ = np.eye(5)[[3, 4, 4, 3, 4]]
    found, states = ways.decode(np.zeros((2, 1)), algorithm="map")
    assert (found, states.tolist()) == (-np.inf, [0, 4])
    assert ways.decode(np.zeros((2, 1)))[0] == pytest.approx(np.log(0.4) - np.log(2.0 * np.pi), rel=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_mixture_refuses_samples_that_are_no_numbers(bad):
    x = X.copy()
    x[7, 1] = bad
    for learn in (GMM(2, random_state=0).from_samples, MVN().from_samples):
        with pytest.raises(ValueError, match="sample 7, feature 1"):
            learn(x)
    model = GMM(2, random_state=0).from_samples(X)
    for use in (model.to_responsibilities, model.to_probability_density, model.to_mahalanobis_distance):
        with pytest.raises(ValueError, match="sample 7, feature 1"):
            use(x)
    with pytest.raises(ValueError, match="sample 7, feature 0"):
        model.predict([0], x[:, 1:])


@pytest.mark.parametrize("locked", [0.0, 0.1, 0.5, 1e6])
def test_a_locked_axis_says_nothing_about_the_others(locked):
    rng = np.random.default_rng(0)
    a = rng.normal(size=200)
    x = np.column_stack([a, np.full(200, locked), 2.0 * a + 0.1 * rng.normal(size=200)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = GMM(2, random_state=0).from_samples(x, init_params="kmeans++")
        given = model.condition([1], [locked])
        np.testing.assert_allclose(given.means, model.means[:, [0, 2]], rtol=1e-9)
        np.testing.assert_allclose(given.priors, model.priors, rtol=1e-9)
        alone = GMM(2, model.priors, model.means[:, [0, 2]], model.covariances[:, [[0], [2]], [0, 2]])
        inputs = rng.normal(size=(20, 1))
        both = np.column_stack([inputs, np.full(20, locked)])
        np.testing.assert_allclose(model.predict([0, 1], both), alone.predict([0], inputs), rtol=1e-6, atol=1e-9)
        one = MVN().from_samples(x)
        np.testing.assert_allclose(one.condition([1], [locked]).mean, one.mean[[0, 2]], rtol=1e-9)
        np.testing.assert_allclose(one.predict([1], [[locked]])[0], [one.mean[[0, 2]]], rtol=1e-9)


@pytest.mark.parametrize("model", [GMM(2, random_state=0).from_samples(X), MVN().from_samples(X)])
def test_features_count_from_the_end_where_negative_as_everywhere(model):
    x = [[0.5], [-1.0]]
    means = (lambda i: model.predict(i, x)) if isinstance(model, GMM) else (lambda i: model.predict(i, x)[0])
    np.testing.assert_array_equal(means([-1]), means([1]))
    name = "means" if isinstance(model, GMM) else "mean"
    np.testing.assert_array_equal(getattr(model.condition([-2], [0.3]), name), getattr(model.condition([0], [0.3]), name))
    np.testing.assert_array_equal(getattr(model.marginalize([-1]), name), getattr(model.marginalize([1]), name))
    np.testing.assert_array_equal(getattr(model.marginalize([False, True]), name), getattr(model.marginalize([1]), name))
    for bad, message in (([2], "from -2 to 1"), ([-3], "from -2 to 1"), ([0, 0], "each feature once"), ([0.5], "whole numbers"),
                         ([1, -1], "each feature once")):  # fmt: skip
        for use in (
            model.marginalize,
            lambda i: model.condition(i, np.zeros(len(i))),
            lambda i: model.predict(i, [[0.0] * len(i)]),
        ):
            with pytest.raises(ValueError, match=message):
                use(bad)
    with pytest.raises(ValueError, match="nothing is left to predict"):
        model.predict([0, 1], [[0.0, 0.0]])


def test_nothing_given_leaves_the_mean():
    model = GMM(3, random_state=0).from_samples(X, init_params="kmeans++")
    np.testing.assert_allclose(model.predict([], np.empty((2, 0))), np.tile(model.to_mvn().mean, (2, 1)), rtol=1e-12)
    np.testing.assert_array_equal(model.condition([], []).means, model.means)


@pytest.mark.parametrize(
    "use",
    [
        lambda m: m.predict([0], [[0.5, 0.6]]),
        lambda m: m.to_responsibilities(np.ones((4, 1))),
        lambda m: m.to_probability_density(np.ones((4, 3))),
        lambda m: m.to_mahalanobis_distance(np.ones((4, 3))),
        lambda m: m.condition([0], [1.0, 2.0]),
        lambda m: m.is_in_confidence_region([0.0], 0.5),
        lambda m: m.extract_mvn(0).is_in_confidence_region([0.0], 0.5),
    ],
)
def test_samples_of_another_width_are_told_the_right_one(use):
    with pytest.raises(ValueError, match=r"X must be \(n_samples, [12]\) for this (GMM|MVN); got"):
        use(GMM(3, random_state=0).from_samples(X, init_params="kmeans++"))


def test_one_column_as_a_flat_array_is_told_how_to_be_a_table():
    for learn in (GMM(2).from_samples, MVN().from_samples):
        with pytest.raises(ValueError, match="Expected 2D array, got 1D array"):
            learn(X[:, 0])


def test_no_samples_have_the_width_of_some():
    model = GMM(2, random_state=0).from_samples(X)
    assert model.sample(0).shape == (0, 2)
    assert model.sample_confidence_region(0, 0.5).shape == (0, 2)
    assert MVN([0.0, 0.0], np.eye(2)).sample(0).shape == (0, 2)
    assert MVN([0.0, 0.0], np.eye(2)).sample_confidence_region(0, 0.5).shape == (0, 2)
    assert known().sample(0)[0].shape == (0, 2)
    for bad in (-1, 2.5):
        with pytest.raises(ValueError, match="n_samples must be a whole number"):
            model.sample(bad)


@pytest.mark.parametrize("alpha", [0.0, -0.1, 95, 1.0001, np.nan, np.inf, "a", None])
def test_a_share_that_is_none_is_refused_before_anything_is_drawn(alpha):
    for model in (GMM(1, [1.0], [[0.0, 0.0]], [np.eye(2)], random_state=0), MVN([0.0, 0.0], np.eye(2))):
        for n in (0, 2):
            with pytest.raises(ValueError, match="alpha is the share"):
                model.sample_confidence_region(n, alpha)
        with pytest.raises(ValueError, match="alpha is the share"):
            model.is_in_confidence_region([0.0, 0.0], alpha)


def test_a_region_that_holds_next_to_nothing_is_drawn_from_at_once(monkeypatch):
    model = MVN([1.0, -2.0, 0.5], np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 3.0]]), random_state=0)
    found = model.sample_confidence_region(500, 1e-9)
    assert all(model.is_in_confidence_region(x, 1e-9) for x in found)
    ways = []
    for rare in (0.0, 1.0):  # thrown away, and at once: the same distribution
        monkeypatch.setattr(mvn, "RARE", rare)
        found = model.sample_confidence_region(2000, 0.4)
        ways.append(np.array([model.squared_mahalanobis_distance(x) for x in found]))
        np.testing.assert_allclose(found.mean(axis=0), model.mean, atol=0.06)
    np.testing.assert_allclose(*(np.quantile(way, [0.1, 0.5, 0.9]) for way in ways), rtol=0.1)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (([1.0], [[0.0, 0.0]], [[[1.0, 2.0], [2.0, 1.0]]]), "covariance of component 0 is not positive definite"),
        (([1.0], [[0.0, 0.0]], [[[1.0, 0.0], [0.0, -1.0]]]), "covariance of component 0 is not positive definite"),
        (([1.0], [[0.0, 0.0]], [[[1.0, 0.5], [0.0, 1.0]]]), "symmetric"),
        (([1.0], [[0.0, 0.0]], [[[1.0, np.nan], [np.nan, 1.0]]]), "component 0 is not finite"),
        (([1.0], [[0.0, np.inf]], [np.eye(2)]), "mean of state 0, feature 1 is inf"),
        (([1.5, -0.5], [[0.0, 0.0], [3.0, 3.0]], [np.eye(2)] * 2), "priors must be probabilities, none below 0; got -0.5"),
        (([0.5, 0.4], [[0.0, 0.0], [3.0, 3.0]], [np.eye(2)] * 2), "priors must sum to 1"),
        (([0.5, 0.5], [[0.0, 0.0], [3.0, 3.0]], [np.eye(3)] * 2), r"covariances must have shape \(2, 2, 2\)"),
    ],
)
def test_a_mixture_that_cannot_be_is_refused_whatever_is_done_with_it(parts, message):
    model = GMM(len(parts[0]), *parts, random_state=0)
    uses = [
        lambda: model.to_probability_density([[0.0, 0.0]]), lambda: model.to_responsibilities([[3.0, 3.0]]), model.to_mvn,
        lambda: model.condition([0], [1.0]), lambda: model.predict([0], [[1.0]]), lambda: model.sample(2),
        lambda: model.marginalize([0]), lambda: model.from_samples(X),
    ]  # fmt: skip
    for use in uses:
        with pytest.raises(ValueError, match=message):
            use()
    if len(parts[0]) == 1:
        with pytest.raises(ValueError, match=message):
            MVN(parts[1][0], parts[2][0]).to_probability_density([[0.0, 0.0]])
