"""Turning the axes of a task turns what is learned, and changes nothing else."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from comanip.errors import TrainingError
from comanip.fitting.gmm import fit_gmm
from comanip.fitting.hmm import fit_hmm
from comanip.fitting.hsmm import fit_hsmm
from comanip.fitting.streaming import fit_stream
from comanip.models.filtering import ForwardFilter
from comanip.models.gmr import regress
from toys import Stored

GROUPS = ("position", "force", "velocity")
CHANNELS = tuple(f"{group}.{axis}" for group in GROUPS for axis in "xyz")


def carries(n=4, seed=0, n_frames=160):
    """Lessons (T, 9) along a curve in space; one direction hardly moves, so that its floor matters."""
    rng = np.random.default_rng(seed)
    lessons = []
    for _ in range(n):
        s = np.clip(np.linspace(-0.1, 1.1, int(n_frames * rng.uniform(0.9, 1.1))), 0.0, 1.0)
        lift, aside = 10 * s**3 - 15 * s**4 + 6 * s**5, np.sin(np.pi * s) ** 2
        x = np.column_stack([0.4 * lift, 0.2 * aside, 0.3 * lift**2]) * (1.0 + 0.03 * rng.normal(size=3))
        x += np.array([2e-4, 5e-7, 2e-4]) * np.cumsum(rng.normal(size=x.shape), axis=0)
        v = np.gradient(x, 0.01, axis=0)
        lessons.append(np.hstack([x, 9.0 * v + np.array([0.3, 1e-3, 0.5]) * rng.normal(size=x.shape), v]))
    return lessons


def strokes(n=4, seed=0):
    """Lessons (T, 9) that go round five times."""
    rng = np.random.default_rng(seed)
    lessons = []
    for _ in range(n):
        phase = 2.0 * np.pi * np.linspace(0.0, 5.0, int(500 * rng.uniform(0.9, 1.1)))
        x = 0.2 * np.column_stack([np.cos(phase), 0.5 * np.sin(phase), 1e-3 * np.cos(2.0 * phase)])
        v = np.gradient(x, 0.01, axis=0)
        lessons.append(np.hstack([x + 1e-3 * rng.normal(size=x.shape), 9.0 * v + 0.3 * rng.normal(size=x.shape), v]))
    return lessons


LESSONS, STROKES = carries(), strokes()


def turned(seed):
    """One rotation of all three groups, (9, 9); seed 0 changes the axes' order and signs."""
    one = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    if seed:
        one = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    return np.kron(np.eye(3), one)


def same(found, expected, rotation):
    """The model learned from turned lessons is the turned model, to 1e-9 of each group's size."""
    size = np.repeat([np.abs(expected.means[:, g : g + 3]).max() for g in (0, 3, 6)], 3)
    assert (np.abs(found.means - expected.means @ rotation.T) <= 1e-9 * size).all()
    covariances = rotation @ expected.covariances @ rotation.T
    assert (np.abs(found.covariances - covariances) <= 1e-9 * size[:, None] * size).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fit", [fit_hmm, fit_hsmm, fit_gmm])
@pytest.mark.parametrize("guess", ["time", "kmeans"])
def test_a_model_of_turned_lessons_is_the_turned_model(fit, guess, seed):
    options = {"channels": CHANNELS, "initial_guess": guess, "max_iterations": 25}
    r = turned(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plain = fit(LESSONS, 5, rng=np.random.default_rng(1), **options)
        other = fit([x @ r.T for x in LESSONS], 5, rng=np.random.default_rng(1), **options)
    same(other.model, plain.model, r)
    np.testing.assert_allclose(other.log_likelihood, plain.log_likelihood, rtol=1e-9)
    if fit is not fit_gmm:
        np.testing.assert_allclose(other.model.transition, plain.model.transition, atol=1e-9)


@pytest.mark.parametrize("topology", ["left-right", "cyclic", "free"])
def test_also_of_a_task_that_repeats(topology):
    r, options = turned(5), {"channels": CHANNELS, "topology": topology, "max_iterations": 25}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plain, other = fit_hmm(STROKES, 5, **options), fit_hmm([x @ r.T for x in STROKES], 5, **options)
    same(other.model, plain.model, r)


def test_also_streamed(tmp_path):
    r, models = turned(2), []
    for name, lessons in (("plain", LESSONS), ("turned", [x @ r.T for x in LESSONS])):
        np.savez(tmp_path / f"{name}.npz", *lessons)
        models.append(fit_stream([tmp_path / f"{name}.npz"], 5, channels=CHANNELS, read=Stored(), max_iterations=10).model)
    same(models[1], models[0], r)


def test_what_it_predicts_is_turned_too():
    r = turned(3)
    plain, other = fit_hmm(LESSONS, 5, channels=CHANNELS).model, fit_hmm([x @ r.T for x in LESSONS], 5, channels=CHANNELS).model
    answers = []
    for model, x in ((plain, LESSONS[0]), (other, LESSONS[0] @ r.T)):
        forward = ForwardFilter(model)
        weights = np.array([forward.step(xi).copy() for xi in x])
        answers.append(regress(model, ("position", "force"), "velocity", x[:, :6], weights=weights).mean)
    np.testing.assert_allclose(answers[1], answers[0] @ r[:3, :3].T, atol=1e-7)


def test_a_group_of_one_channel_and_names_without_a_group_keep_their_own_spread():
    lessons = [x[:, [0, 3, 6]] for x in LESSONS]
    a = fit_hmm(lessons, 4, channels=("position.x", "force.x", "velocity.x")).model
    b = fit_hmm(lessons, 4, channels=("p", "f", "v")).model
    np.testing.assert_array_equal(a.means, b.means)
    scaled = fit_hmm([x * [1.0, 1e3, 1.0] for x in lessons], 4, channels=("p", "f", "v")).model
    np.testing.assert_allclose(scaled.means / [1.0, 1e3, 1.0], b.means, rtol=1e-6, atol=1e-9)


def test_a_dead_axis_among_living_ones_is_still_refused_and_its_stated_noise_kept():
    lessons = [x.copy() for x in LESSONS]
    for x in lessons:
        x[:, 4] = 2.5
    with pytest.raises(TrainingError, match=r"force\.y is constant"):
        fit_hmm(lessons, 4, channels=CHANNELS)
    with pytest.warns(match=r"force\.y is constant"):
        fit = fit_hmm(lessons, 4, channels=CHANNELS, allow_constant={"force.y": 0.2})
    np.testing.assert_allclose(fit.model.covariances[:, 4, 4], 0.04, rtol=1e-6)
