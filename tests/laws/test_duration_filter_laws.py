"""The filter with durations is the recursion it names, and its clock belongs to who sets it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.fitting.hmm import fit_hmm
from comanip.fitting.hsmm import fit_hsmm
from comanip.models import hsmm
from comanip.models.durations import of_mean, table
from comanip.models.filtering import DurationFilter, ForwardFilter
from comanip.models.hmm import Hmm
from comanip.models.hsmm import Hsmm, durations_s, explicit_durations
from toys import CHANNELS, lifts, random_hmm, random_hsmm

MODEL = fit_hsmm([x[::2] for x in lifts()], 5, channels=CHANNELS).model


def run(one, sequence, **options):
    return np.array([one.step(np.asarray(xi, dtype=float), **options).copy() for xi in sequence])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("left_right", [False, True])
def test_without_floor_and_gate_its_likelihood_is_the_models(seed, left_right):
    rng = np.random.default_rng(seed)
    model = random_hsmm(rng, 4, 3, longest=6, left_right=left_right)
    x = hsmm.sample(model, 50, rng).frames
    one = DurationFilter(model, transition_floor=0.0, gate=np.inf)
    weights = run(one, x)
    assert one.log_likelihood == pytest.approx(hsmm.log_likelihood(model, [x])[0], rel=1e-10)
    for t in (1, 2, 17, 50):
        np.testing.assert_allclose(weights[t - 1], hsmm.posteriors(model, x[:t]).weights[-1], atol=1e-10)


@pytest.mark.parametrize("floor", [0.0, 1e-6])
def test_with_geometric_durations_it_is_the_forward_filter(floor):
    rng = np.random.default_rng(1)
    model = random_hmm(rng, 3, 2)
    x = rng.normal(size=(40, 2))
    x[11] = np.nan
    durations = DurationFilter(explicit_durations(model, 300), transition_floor=floor)
    np.testing.assert_allclose(run(durations, x), run(ForwardFilter(model, transition_floor=floor), x), atol=1e-9)


def rest_and_lift(frames=80.0, longest=300):
    """A rest of about `frames` frames, then a motion, then rest: taught with a spread of a tenth."""
    p = table(of_mean(np.full(3, frames), 100.0, longest), longest)
    return Hsmm([1.0, 0.0, 0.0], [[0, 1, 0], [0, 0, 1], [0, 0, 1]], p, [[0.0], [3.0], [6.0]], np.ones((3, 1, 1)), ("x",))


def leaves(filtered, frames, **options):
    """After how many ticks the first state is no longer the likeliest."""
    for t, xi in enumerate(frames):
        if filtered.step(np.atleast_1d(xi), **options)[0] < 0.5:
            return t
    return None


NOTHING = np.full((2000, 1), np.nan)


def test_a_leaders_rest_ends_when_taught_and_an_hmm_does_not_know_when():
    model = rest_and_lift()
    assert durations_s(model, 1.0).mean_s[0] == pytest.approx(80.0, rel=0.01)
    assert leaves(DurationFilter(model), NOTHING) == pytest.approx(80.0, rel=0.1)
    rest = 0.3 * np.random.default_rng(0).normal(size=(2000, 1))  # the hand is seen at rest, so evidence alone would never leave
    ended = DurationFilter(model)
    held = [ended.remaining[0] for xi in rest[:60] if ended.step(xi) is not None]
    np.testing.assert_allclose(np.array(held[:40]) + np.arange(40), 80.0, rtol=0.05)  # it counts down
    stay = 1.0 - 1.0 / 80.0
    chain = np.array([[stay, 1.0 - stay, 0.0], [0.0, stay, 1.0 - stay], [0.0, 0.0, 1.0]])
    early = DurationFilter(model), ForwardFilter(Hmm(model.initial, chain, model.means, model.covariances, model.channels))
    for xi in NOTHING[:40]:
        after = [one.step(xi)[0] for one in early]
    assert after[0] > 0.999  # half-way through, nothing has ended
    assert after[1] < 0.7  # the HMM has given away a third of its belief


@pytest.mark.parametrize(("rate", "expected"), [(1.0, 80), (0.5, 160), (0.1, 800), (2.0, 40), (3.7, 21.6)])
def test_the_clock_of_durations_runs_at_the_rate_of_its_owner(rate, expected):
    assert leaves(DurationFilter(rest_and_lift()), NOTHING, rate=rate) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("rate", [0.0, np.nan, -1.0])
def test_a_follower_at_rate_0_never_leaves_rest_by_the_clock_and_at_once_by_evidence(rate):
    rest = 0.3 * np.random.default_rng(0).normal(size=(5000, 1))
    waits = DurationFilter(rest_and_lift())
    assert leaves(waits, rest, rate=rate) is None
    assert waits.weights[0] > 0.999
    assert leaves(waits, np.full((5, 1), 4.0), rate=rate) <= 1
    assert leaves(DurationFilter(rest_and_lift()), NOTHING, rate=rate) is None


def test_on_a_lesson_it_says_when_a_state_will_end_and_an_hmm_does_not(lessons):
    channels = ("position.z", "force.z", "velocity.z")
    for role in ("leader", "follower"):
        *taught, other = [lesson.array(channels)[::4] for lesson in lessons[role]]
        model, geometric = (fit(taught, 5, channels=channels).model for fit in (fit_hsmm, fit_hmm))
        usual = 1.0 / np.maximum(1.0 - np.diagonal(geometric.transition), 1e-9)
        one, path, off = DurationFilter(model), hsmm.viterbi(model, other), []
        ends = np.append(np.flatnonzero(np.diff(path)) + 1, len(path))
        for t, xi in enumerate(other[: ends[-2]]):
            state = int(one.step(xi).argmax())
            if state == path[t]:
                left = ends[ends > t][0] - t
                off.append((abs(one.remaining[state] - left), abs(usual[state] - left)))
        assert np.mean(off, axis=0)[0] < 0.6 * np.mean(off, axis=0)[1], role


def test_a_partner_slower_than_taught_is_followed_by_evidence():
    slow = np.repeat([0.0, 3.0, 6.0], 200)[:, None] + 0.3 * np.random.default_rng(1).normal(size=(600, 1))
    weights = run(DurationFilter(rest_and_lift()), slow)
    assert (weights.argmax(axis=1) == np.repeat([0, 1, 2], 200)).mean() > 0.97


def test_a_missing_channel_is_the_marginal_over_the_others_and_one_lost_tick_leaves_no_trace():
    lesson = lifts(1, seed=3)[0][::2]
    clean = run(DurationFilter(MODEL), lesson)
    holes = lesson.copy()
    holes[:, 1] = np.nan
    chosen = DurationFilter(MODEL, channels=[CHANNELS[0], CHANNELS[2]])
    np.testing.assert_allclose(run(DurationFilter(MODEL), holes), run(chosen, lesson[:, [0, 2]]), atol=1e-12)
    for nonsense in ([np.nan] * 3, [0.1, 20.0, 0.1], [0.1, -1e5, 0.1], [np.inf, 0.0, 0.0], [1e308, -1e308, np.nan]):
        broken = lesson.copy()
        broken[50] = nonsense
        after = run(DurationFilter(MODEL), broken)
        assert np.isfinite(after).all()
        assert np.abs(after[65:] - clean[65:]).max() < 1e-3, nonsense


values = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.tuples(values, values, values, values), min_size=1, max_size=30), st.sampled_from([0.0, 1e-6, 1e-2]))
def test_whatever_comes_in_the_weights_are_a_distribution(ticks, floor):
    one = DurationFilter(MODEL, transition_floor=floor)
    for *xi, rate in ticks:
        weights = one.step(np.array(xi), rate)
        assert np.isfinite(weights).all()
        assert weights.min() >= 0.0
        assert weights.sum() == pytest.approx(1.0, abs=1e-9)
        assert np.isfinite(one.remaining).all()


def test_two_runs_from_the_same_reset_are_equal():
    lesson = lifts(1, seed=4)[0][::2]
    one = DurationFilter(MODEL)
    first = run(one, lesson, rate=0.7)
    one.reset()
    np.testing.assert_array_equal(run(one, lesson, rate=0.7), first)


def test_without_a_floor_patience_ends_and_durations_start_afresh():
    one = DurationFilter(rest_and_lift(), transition_floor=0.0, gate=np.inf, patience=3)
    run(one, np.repeat([0.0, 3.0, 6.0], 80)[:, None])
    weights = run(one, [[-2.0]] * 3)
    assert weights[1, 2] > 0.99  # nothing leads back
    assert weights[2, 0] > 0.99
    assert one.restarts == 1
    assert one.remaining[0] == pytest.approx(80.0, rel=0.01)
