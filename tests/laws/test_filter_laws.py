"""The filter is eq. (4), whatever is missing and whatever a sensor says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip.fitting.hmm import fit_hmm
from comanip.models import hmm
from comanip.models.filtering import ForwardFilter
from comanip.models.gaussian import marginal, normalised
from comanip.models.hmm import Hmm
from toys import CHANNELS, lifts, random_hmm

MODEL = fit_hmm(lifts(), 5, channels=CHANNELS).model


def run(forward, sequence):
    return np.array([forward.step(xi).copy() for xi in sequence])


@pytest.mark.parametrize("seed", range(5))
def test_without_floor_and_gate_the_filter_equals_the_forward_pass(seed):
    rng = np.random.default_rng(seed)
    model = random_hmm(rng, 4, 3)
    x = hmm.sample(model, 60, rng).frames
    forward = ForwardFilter(model, transition_floor=0.0, gate=np.inf)
    log_alpha, _, log_likelihood = hmm.forward_backward(model, x)
    np.testing.assert_allclose(run(forward, x), normalised(log_alpha), rtol=1e-9, atol=1e-12)
    assert forward.log_likelihood == pytest.approx(log_likelihood, rel=1e-10)


def test_on_a_demonstration_floor_and_gate_change_little():
    demonstration = lifts(6, seed=1)[-1]
    exact = run(ForwardFilter(MODEL, transition_floor=0.0, gate=np.inf), demonstration)
    robust = run(ForwardFilter(MODEL), demonstration)
    assert np.abs(exact - robust).sum(axis=1).mean() < 0.01


@pytest.mark.parametrize("missing", [(0,), (1,), (2,), (0, 2)])
def test_a_missing_channel_is_the_marginal_over_the_others(missing):
    present = [c for c in range(3) if c not in missing]
    reduced = Hmm(
        MODEL.initial, MODEL.transition, *marginal(MODEL.means, MODEL.covariances, np.array(present)),
        tuple(CHANNELS[c] for c in present),
    )  # fmt: skip
    demonstration = lifts(1, seed=2)[0]
    holes = demonstration.copy()
    holes[:, missing] = np.nan
    expected = run(ForwardFilter(reduced), demonstration[:, present])
    np.testing.assert_allclose(run(ForwardFilter(MODEL), holes), expected, rtol=1e-9, atol=1e-12)
    chosen = ForwardFilter(MODEL, channels=[CHANNELS[c] for c in present])
    np.testing.assert_allclose(run(chosen, demonstration[:, present]), expected, rtol=1e-9, atol=1e-12)
    together = hmm.log_likelihood(MODEL, [holes])
    np.testing.assert_allclose(together, hmm.log_likelihood(reduced, [demonstration[:, present]]), rtol=1e-10)


def test_with_nothing_present_the_weights_move_by_the_dynamics_alone():
    forward = ForwardFilter(MODEL, transition_floor=0.0)
    forward.step(lifts(1)[0][0])
    before = forward.weights.copy()
    after = forward.step(np.full(3, np.nan))
    np.testing.assert_allclose(after, before @ MODEL.transition, rtol=1e-12)
    assert forward.last_log_likelihood == 0.0


def test_a_tick_of_nonsense_leaves_no_trace():
    demonstration = lifts(1, seed=3)[0]
    clean = run(ForwardFilter(MODEL), demonstration)
    for nonsense in ([np.nan] * 3, [0.1, 20.0, 0.1], [0.1, -1e5, 0.1], [np.inf, 0.0, 0.0], [1e308, -1e308, np.nan]):
        forward = ForwardFilter(MODEL)
        run(forward, demonstration[:100])
        forward.step(np.array(nonsense))
        after = run(forward, demonstration[101:])
        assert np.isfinite(after).all()
        assert np.abs(after[30:] - clean[131:]).max() < 1e-3, nonsense


def test_one_tick_favours_no_state_by_more_than_the_gate():
    for xi in ([0.1, 1e4, 0.1], [-50.0, 0.0, 0.0]):
        forward = ForwardFilter(MODEL, gate=20.0, transition_floor=1e-6)
        before = forward.step(lifts(1)[0][0]).copy() @ ((1.0 - 1e-6) * MODEL.transition + 1e-6 / 5)
        after = forward.step(np.array(xi))
        odds = np.log(after / before)
        assert np.ptp(odds) == pytest.approx(20.0)


values = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.tuples(values, values, values), min_size=1, max_size=30), st.sampled_from([0.0, 1e-6, 1e-2]))
def test_whatever_comes_in_the_weights_are_a_distribution(ticks, floor):
    forward = ForwardFilter(MODEL, transition_floor=floor)
    for xi in ticks:
        weights = forward.step(np.array(xi))
        assert np.isfinite(weights).all()
        assert weights.min() >= 0.0
        assert weights.sum() == pytest.approx(1.0, abs=1e-9)
        assert np.isfinite(forward.log_likelihood)


def test_two_runs_from_the_same_reset_are_equal():
    demonstration = lifts(1, seed=4)[0]
    forward = ForwardFilter(MODEL)
    first = run(forward, demonstration)
    forward.reset()
    np.testing.assert_array_equal(run(forward, demonstration), first)


def test_without_a_floor_patience_ends_and_the_weights_start_afresh():
    model = Hmm([1.0, 0.0], [[0.5, 0.5], [0.0, 1.0]], [[0.0], [10.0]], np.ones((2, 1, 1)), ("x",))
    forward = ForwardFilter(model, transition_floor=0.0, gate=np.inf, patience=3)
    run(forward, [[0.0]] + [[10.0]] * 20)
    weights = run(forward, [[0.0]] * 3)
    assert weights[1, 1] > 0.99  # the chain forbids the way back
    assert weights[2, 0] > 0.99
    assert forward.restarts == 1
