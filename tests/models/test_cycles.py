"""Tasks that repeat: one cycle is found, and learned, and the way back from its last state to its first."""

import warnings

import numpy as np
import pytest

from comanip import kernels
from comanip.errors import ComanipWarning
from comanip.fitting import cycles
from comanip.fitting.hmm import fit_hmm
from comanip.fitting.hsmm import fit_hsmm
from comanip.fitting.streaming import fit_stream
from comanip.models.filtering import ForwardFilter
from comanip.models.gmr import regress
from toys import Stored, lifts

DT = 0.01
CHANNELS = ("position.x", "force.x", "velocity.x")
CRANK = tuple(f"{q}.{a}" for q in ("position", "force", "velocity") for a in "xz")


def phase_of(rng, period_s, n_cycles, rest_s):
    """Cycles (T,) since the start of a lesson that rests at both ends and whose tempo wavers by a tenth."""
    n = int((n_cycles * period_s + 2.0 * rest_s) / DT)
    tempo = 1.0 + 0.1 * np.sin(np.linspace(0.0, 2.0 * np.pi, n) + rng.uniform(0.0, 6.0))
    return np.clip(np.cumsum(tempo) * DT / period_s - rest_s / period_s, 0.0, n_cycles)


def saw(rng, *, n_cycles=5, rest_s=0.7, period_s=None):
    """A lesson of sawing (T, 3): position, force, velocity. Force alone does not tell velocity."""
    phase = phase_of(rng, rng.uniform(1.0, 1.4) if period_s is None else period_s, n_cycles, rest_s)
    x = 0.15 * (1.0 + 0.03 * rng.normal()) * (1.0 - np.cos(2.0 * np.pi * phase)) + 1e-4 * np.cumsum(rng.normal(size=len(phase)))
    force = 20.0 * (x - 0.15) + 6.0 * np.sin(2.0 * np.pi * phase + 0.5) + 0.3 * rng.normal(size=len(x))
    return np.column_stack([x, force, np.gradient(x, DT)])


def crank(rng):
    """A lesson of turning a crank five times (T, 6)."""
    phase = phase_of(rng, rng.uniform(1.5, 2.0), 5, 0.5)
    x = 0.2 * np.column_stack([np.cos(2.0 * np.pi * phase), np.sin(2.0 * np.pi * phase)])
    v = np.gradient(x, DT, axis=0)
    return np.column_stack([x + 1e-3 * rng.normal(size=x.shape), 12.0 * v + 0.5 * rng.normal(size=v.shape), v])


def lessons_of(make, seed=0, n=6):
    rng = np.random.default_rng(seed)
    return [make(rng) for _ in range(n)]


def one_step_r2(model, lesson, d):
    """R² of velocity from position and force of a lesson not seen, frame by frame."""
    forward = ForwardFilter(model)
    weights = np.array([forward.step(x).copy() for x in lesson])
    found = regress(model, ("position", "force"), "velocity", lesson[:, : 2 * d], weights=weights).mean
    apart = lesson[:, 2 * d :] - found
    return 1.0 - (apart**2).sum() / ((lesson[:, 2 * d :] - lesson[:, 2 * d :].mean(axis=0)) ** 2).sum()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rest_s", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("n_cycles", [3, 5, 12])
def test_the_period_is_found_within_a_tenth_whatever_the_rests_at_both_ends(seed, rest_s, n_cycles):
    rng = np.random.default_rng(seed)
    period_s = rng.uniform(0.5, 3.0)
    x = saw(rng, n_cycles=n_cycles, rest_s=rest_s, period_s=period_s)
    found = cycles.period_of((x - x.mean(axis=0)) / x.std(axis=0), 5)
    assert found is not None
    assert found * DT == pytest.approx(period_s, rel=0.12)


@pytest.mark.parametrize("seed", range(20))
def test_what_happens_once_has_no_period(seed):
    for x in lifts(1, seed=seed):
        assert cycles.period_of((x - x.mean(axis=0)) / x.std(axis=0), 5) is None


@pytest.mark.parametrize("fit", [fit_hmm, fit_hsmm])
@pytest.mark.parametrize("n_states", [4, 7])
@pytest.mark.parametrize(("make", "channels"), [(saw, CHANNELS), (crank, CRANK)])
def test_a_cyclic_model_learns_one_cycle_and_its_way_back(fit, n_states, make, channels):
    if kernels.native is None and fit is fit_hsmm and (make, n_states) != (saw, 4):
        pytest.skip("takes 1 to 4 minutes where nothing is compiled; the saw with 4 states is learned there, too")
    lessons = lessons_of(make)
    learned = fit(lessons[:4], n_states, channels=channels, topology="cyclic").model
    assert learned.n_states == n_states
    assert learned.transition[-1, 0] > 0.005
    assert (learned.transition[np.arange(n_states - 1), np.arange(1, n_states)] > 0.005).all()
    assert learned.initial.argmax() == 0
    if fit is fit_hmm:  # once round is a period: the states' mean durations add up to it
        durations = 1.0 / (1.0 - np.diagonal(learned.transition))
        assert 0.8 * 120 < durations.sum() < 2.2 * 120


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("make", "channels", "n_states"), [(saw, CHANNELS, 6), (saw, CHANNELS, 10), (crank, CRANK, 8)])
def test_the_next_velocity_of_a_lesson_not_seen_is_predicted(seed, make, channels, n_states):
    lessons = lessons_of(make, seed)
    learned = fit_hmm(lessons[:4], n_states, channels=channels, topology="cyclic").model
    for lesson in lessons[4:]:
        assert one_step_r2(learned, lesson, len(channels) // 3) >= 0.8


def test_it_explains_lessons_not_seen_better_than_one_that_goes_through_once():
    lessons = lessons_of(saw)
    from comanip.models.hmm import log_likelihood

    round_and_round, once = (
        fit_hmm(lessons[:4], 6, channels=CHANNELS, topology=topology).model for topology in ("cyclic", "left-right")
    )
    assert log_likelihood(round_and_round, lessons[4:]).sum() > log_likelihood(once, lessons[4:]).sum() + 500.0


def test_where_nothing_repeats_it_says_so_once():
    with pytest.warns(ComanipWarning, match="no demonstration repeats itself"):
        fit = fit_hmm(lifts(3), 4, channels=CHANNELS, topology="cyclic", restarts=3, rng=np.random.default_rng(0))
    assert sum("repeats itself" in note for note in fit.notes) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit_hmm(lessons_of(saw), 4, channels=CHANNELS, topology="cyclic")


def test_restarts_begin_elsewhere_in_the_cycle_and_end_no_lower():
    lessons = lessons_of(saw)
    one = fit_hmm(lessons, 5, channels=CHANNELS, topology="cyclic")
    best = fit_hmm(lessons, 5, channels=CHANNELS, topology="cyclic", restarts=4, rng=np.random.default_rng(0))
    assert best.log_likelihood[-1] >= one.log_likelihood[-1]
    assert best.model.transition[-1, 0] > 0.005


def test_streamed_from_shards_it_is_the_same_model(tmp_path):
    lessons = lessons_of(saw)
    for i in range(3):
        np.savez(tmp_path / f"{i}.npz", *lessons[2 * i : 2 * i + 2])
    streamed = fit_stream([tmp_path / f"{i}.npz" for i in range(3)], 6, channels=CHANNELS, read=Stored(), topology="cyclic")
    whole = fit_hmm(lessons, 6, channels=CHANNELS, topology="cyclic")
    np.testing.assert_allclose(streamed.model.means, whole.model.means, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(streamed.model.transition, whole.model.transition, atol=1e-6)
