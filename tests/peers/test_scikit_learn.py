"""The estimators live where scikit-learn's do: clones, pipelines, its own checks."""

import numpy as np
import pytest

from comanip import GaussianHMM, GaussianMixtureRegressor

sklearn_base = pytest.importorskip("sklearn.base")

NOT_A_TABLE_OF_INDEPENDENT_ROWS = "a hidden Markov model reads rows in time: their order and their neighbours matter"
LENGTHS_SECOND = "the second argument is hmmlearn's `lengths`; a y passed there is ignored"
EXPECTED_TO_FAIL = {
    "check_fit_score_takes_y": LENGTHS_SECOND,
    "check_n_features_in_after_fitting": "it calls score(X, y=y) by keyword. " + LENGTHS_SECOND,
    "check_methods_sample_order_invariance": NOT_A_TABLE_OF_INDEPENDENT_ROWS,
    "check_methods_subset_invariance": NOT_A_TABLE_OF_INDEPENDENT_ROWS,
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("estimator", "expected"),
    [
        (GaussianHMM(random_state=0), EXPECTED_TO_FAIL),
        (GaussianHMM(2, "full", random_state=0), EXPECTED_TO_FAIL),
        (GaussianMixtureRegressor(random_state=0), {}),
        (GaussianMixtureRegressor(2, init_params="kmeans++", random_state=0), {}),
    ],
)
def test_scikit_learns_own_checks_pass_but_for_those_argued(estimator, expected):
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    results = checks.check_estimator(estimator, expected_failed_checks=expected, on_fail=None, on_skip=None)
    failed = [r["check_name"] for r in results if r["status"] == "failed"]
    assert failed == []
    needless = [r["check_name"] for r in results if r["check_name"] in expected and r["status"] == "passed"]
    assert needless == []
    assert sum(r["status"] == "passed" for r in results) >= 30


def test_a_clone_has_the_parameters_and_nothing_learned():
    model = GaussianHMM(3, "full", random_state=1, tol=0.5).fit(np.random.default_rng(0).normal(size=(50, 2)))
    twin = sklearn_base.clone(model)
    assert twin.get_params() == model.get_params()
    assert not hasattr(twin, "means_")
    assert repr(twin) == "GaussianHMM(covariance_type='full', n_components=3, random_state=1, tol=0.5)"
    with pytest.raises(ValueError, match="Invalid parameter 'n_states'"):
        twin.set_params(n_states=3)


def test_a_target_in_the_place_of_lengths_is_ignored_and_lengths_are_not():
    x = np.random.default_rng(0).normal(size=(30, 2))
    plain = GaussianHMM(2, random_state=0).fit(x)
    with_target = GaussianHMM(2, random_state=0).fit(x, np.arange(30) % 3)
    np.testing.assert_array_equal(plain.means_, with_target.means_)
    split = GaussianHMM(2, random_state=0).fit(x, [10, 20])
    assert not np.array_equal(plain.transmat_, split.transmat_)


def test_it_works_in_a_pipeline():
    pipeline = pytest.importorskip("sklearn.pipeline")
    preprocessing = pytest.importorskip("sklearn.preprocessing")
    x = np.random.default_rng(0).normal(size=(60, 2)) * [1e3, 1e-3]
    steps = pipeline.make_pipeline(preprocessing.StandardScaler(), GaussianHMM(2, random_state=0))
    assert steps.fit(x).predict(x).shape == (60,)


def test_the_regressor_is_one_to_scikit_learn():
    metrics = pytest.importorskip("sklearn.metrics")
    selection = pytest.importorskip("sklearn.model_selection")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(200, 2))
    y = np.column_stack([np.sin(x[:, 0]) + 0.1 * rng.normal(size=200), x @ [1.0, -2.0]])
    model = GaussianMixtureRegressor(4, init_params="kmeans++", random_state=0).fit(x, y)
    assert sklearn_base.is_regressor(model)
    assert model.score(x, y) == pytest.approx(metrics.r2_score(y, model.predict(x)), abs=1e-12)
    weights = rng.uniform(size=200)
    assert model.score(x, y, weights) == pytest.approx(metrics.r2_score(y, model.predict(x), sample_weight=weights), abs=1e-12)
    scores = selection.cross_val_score(GaussianMixtureRegressor(4, init_params="kmeans++", random_state=0), x, y[:, 0])
    assert scores.min() > 0.7
    search = selection.GridSearchCV(GaussianMixtureRegressor(init_params="kmeans++", random_state=0), {"n_components": [1, 5]})
    assert search.fit(x, y[:, 0]).best_params_ == {"n_components": 5}


@pytest.mark.parametrize(
    ("y", "weights", "message"),
    [
        (np.zeros(3), None, "as many samples"),
        (np.zeros((4, 2)), None, "y has 2 outputs, and fit had 1"),
        (np.array([0.0, np.nan, 0.0, 0.0]), None, "Input y contains NaN: sample 1"),
        (np.zeros(4), [1.0, 1.0], "sample_weight must be"),
        (np.zeros(4), [-1.0, 1.0, 1.0, 1.0], "sample_weight must be"),
    ],
)
def test_the_regressors_score_refuses_what_does_not_fit(y, weights, message):
    rng = np.random.default_rng(0)
    model = GaussianMixtureRegressor(random_state=0).fit(rng.normal(size=(20, 1)), rng.normal(size=20))
    with pytest.raises(ValueError, match=message):
        model.score(np.zeros((4, 1)), y, weights)
