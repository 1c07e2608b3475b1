"""The compiled kernels say what their readable twins say: every size, every instruction set, every raggedness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.errors import ParameterError
from comanip.fitting import baum_welch
from comanip.fitting import gmm as mixtures
from comanip.fitting.baum_welch import Chain
from comanip.fitting.coordinates import Lessons
from comanip.fitting.hmm import weights_of
from comanip.kernels.plan import MARGIN, WHOLE, WIDE_MARGIN, plan
from comanip.models import hmm
from comanip.models.chains import log_of
from comanip.models.filtering import ForwardFilter
from comanip.models.gaussian import whitening
from comanip.models.gmr import Regression
from comanip.models.hmm import Hmm
from comanip.models.rollout import RollOuts, roll_out
from toys import agree, random_covariances, random_gmm, random_hmm, resident, same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
LEVELS = kernels.native.levels() if kernels.native else []


def chain(rng, n_states, n_channels, left_right=False):
    p = random_hmm(rng, n_states, n_channels)
    if not left_right:
        return Chain(p.initial, p.transition, p.means, p.covariances)
    rows = p.transition * np.tri(n_states, k=1) * np.tri(n_states).T
    return Chain(np.eye(n_states)[0], rows / rows.sum(axis=1, keepdims=True), p.means, p.covariances)


def lessons_of(rng, lengths, n_channels):
    z = 1.5 * rng.normal(size=(int(np.sum(lengths)), n_channels))
    d = n_channels
    return Lessons(z, np.asarray(lengths), np.zeros(d), np.ones(d), tuple(f"c{i}" for i in range(d)))


def check_e_step(p, lessons):
    total, found = baum_welch.expect(p, lessons)
    expected_total, expected = baum_welch._expect(p, whitening(p.means, p.covariances), lessons.z, lessons.lengths)
    assert total == pytest.approx(expected_total, rel=1e-10)
    for a, b in zip(found, expected, strict=True):
        agree(a, b)
    assert (found.transitions[p.transition == 0.0] == 0.0).all()
    weights = weights_of(p, lessons)
    agree(weights, baum_welch.expectations_of(p, whitening(p.means, p.covariances), lessons.z, lessons.lengths).weights)


@pytest.mark.parametrize(
    ("d", "k"), [(1, 1), (1, 5), (2, 2), (3, 5), (4, 9), (7, 10), (14, 17), (33, 8), (60, 3), (2, 64), (9, 33)]
)
@pytest.mark.parametrize("left_right", [False, True])
def test_e_step_for_sizes_from_1_to_64(level, d, k, left_right):
    rng = np.random.default_rng(d * 100 + k)
    check_e_step(chain(rng, k, d, left_right), lessons_of(rng, rng.integers(1, 40, size=11), d))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.integers(1, 200), min_size=1, max_size=25),
    st.integers(1, 4),
    st.integers(1, 6),
    st.integers(0, 10**6),
    st.booleans(),
)
def test_e_step_for_ragged_lengths(lengths, d, k, seed, left_right):
    rng = np.random.default_rng(seed)
    for name in LEVELS:
        kernels.native.use(name)
        check_e_step(chain(rng, k, d, left_right), lessons_of(rng, lengths, d))
    kernels.native.use(LEVELS[0])


@pytest.mark.parametrize("lengths", [[3000], [2000, 3], [700] * 9, [1] * 40, [5000] + [10] * 100])
def test_e_step_for_long_and_for_many_sequences(level, lengths):
    rng = np.random.default_rng(len(lengths))
    check_e_step(chain(rng, 6, 3), lessons_of(rng, lengths, 3))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.integers(1, 20_000), min_size=1, max_size=60), st.sampled_from([2, 4, 8, 16]), st.integers(0, 2**32))
def test_a_plan_counts_every_frame_once(lengths, width, seed):
    margins = np.random.default_rng(seed).choice([MARGIN, WIDE_MARGIN, WHOLE], size=len(lengths))
    found = plan(np.array(lengths), width, margins)
    begin, count_from, count_to, end = found.pieces.T
    starts = np.cumsum([0, *lengths])
    same(np.concatenate([np.arange(a, b) for a, b in zip(count_from, count_to, strict=True)]),
                                  np.arange(starts[-1]))  # fmt: skip
    for s, (a, b) in enumerate(zip(found.first[:-1], found.first[1:], strict=True)):
        assert (begin[a], end[b - 1]) == (starts[s], starts[s + 1])
        assert (count_from[a + 1 : b] - begin[a + 1 : b] >= np.minimum(margins[s], count_from[a + 1 : b] - starts[s])).all()
        assert (end[a : b - 1] - count_to[a : b - 1] >= np.minimum(margins[s], starts[s + 1] - count_to[a : b - 1])).all()
        assert margins[s] != WHOLE or b == a + 1
    assert sorted(found.order.tolist()) == list(range(len(found.pieces)))
    assert found.lanes[-1] == len(found.pieces)
    assert (len(found.lanes) - 1) % width == 0
    assert (np.diff(found.lanes) >= 0).all()


@pytest.mark.parametrize("lengths", [[9000], [1700] * 3, [6000, 40, 3000]])
@pytest.mark.parametrize("left_right", [False, True])
def test_pieces_of_long_sequences_say_what_the_whole_would(level, lengths, left_right):
    rng = np.random.default_rng(sum(lengths))
    lessons = lessons_of(rng, lengths, 3)
    assert (np.diff(lessons.groups.plan.first) > 1).any()
    check_e_step(chain(rng, 6, 3, left_right), lessons)
    assert left_right or (lessons.groups._margins == MARGIN).all()


def remembers(stay):
    """Two states that look alike but for a glance at the beginning: what comes later says nothing of where it is."""
    transition = np.array([[stay, 1.0 - stay, 0.0], [1.0 - stay, stay, 0.0], [0.5, 0.5, 0.0]])
    return Chain(np.array([0.9, 0.1, 0.0]), transition, np.array([[0.0], [1e-3], [40.0]]), np.ones((3, 1, 1)))


@pytest.mark.parametrize(("stay", "margin"), [(0.6, MARGIN), (0.95, WIDE_MARGIN), (0.99999, WHOLE)])
def test_a_chain_that_remembers_is_cut_with_care_or_not_at_all(level, stay, margin):
    rng = np.random.default_rng(3)
    lessons = Lessons(rng.normal(size=(9000, 1)), np.array([9000]), np.zeros(1), np.ones(1), ("x",))
    check_e_step(remembers(stay), lessons)
    assert lessons.groups._margins.tolist() == [margin]
    model = Hmm(*remembers(stay), ("x",))
    np.testing.assert_allclose(hmm.log_likelihood(model, [lessons.z]), hmm._log_likelihood(model, lessons.z, lessons.lengths),
                               rtol=1e-12)  # fmt: skip


def test_where_a_piece_fails_its_sequence_goes_whole_and_then_to_the_twin(level):
    p = Chain(np.eye(3)[0], np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]),
              np.array([[0.0], [50.0], [100.0]]), np.ones((3, 1, 1)))  # fmt: skip
    bad = np.concatenate([np.repeat([0.0, 50.0, 100.0], 1500), np.zeros(500)])
    good = np.repeat([0.0, 50.0, 100.0], 1500)
    lessons = Lessons(np.concatenate([bad, good])[:, None], np.array([5000, 4500]), np.zeros(1), np.ones(1), ("x",))
    sums = kernels.e_step(lessons.z, lessons.groups, p.initial, p.transition, whitening(p.means, p.covariances).arrays)
    assert sums.failed.tolist() == [True, False]
    check_e_step(p, lessons)


def test_a_frame_without_explanation_gives_numbers(level):
    rng = np.random.default_rng(0)
    for left_right in (False, True):
        lessons = lessons_of(rng, [50, 60, 70] * 4, 3)
        lessons.z[[5, 100, 333], 1] = 1e5
        p = chain(rng, 5, 3, left_right)
        total, found = baum_welch.expect(p, lessons)
        expected_total, expected = baum_welch._expect(p, whitening(p.means, p.covariances), lessons.z, lessons.lengths)
        assert total == pytest.approx(expected_total, rel=1e-10)
        assert all(np.isfinite(a).all() for a in found)
        agree(found.transitions, expected.transitions, tolerance=1e-8)  # the log-likelihood is 1e10: 6 digits behind the point


def test_where_scaling_leaves_float64_the_twin_takes_the_sequence(level):
    """Left-right, and each lesson ends where only the first state could be: every path has a weight below 1e-308."""
    p = Chain(np.eye(3)[0], np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]),
              np.array([[0.0], [50.0], [100.0]]), np.ones((3, 1, 1)))  # fmt: skip
    z = np.concatenate([np.repeat([0.0, 50.0, 100.0, 0.0], 10), np.repeat([0.0, 50.0, 100.0], 10), np.zeros(20)])[:, None]
    lessons = Lessons(z, np.array([40, 30, 20]), np.zeros(1), np.ones(1), ("x",))
    sums = kernels.e_step(z, lessons.groups, p.initial, p.transition, whitening(p.means, p.covariances).arrays)
    assert sums.failed.tolist() == [True, False, False]
    check_e_step(p, lessons)
    model = Hmm(p.initial, p.transition, p.means, p.covariances, ("x",))
    found = hmm.log_likelihood(model, [z[:40], z[40:70]])
    np.testing.assert_allclose(found, hmm._log_likelihood(model, z[:70], np.array([40, 30])), rtol=1e-12)


@pytest.mark.parametrize("n", [1, 9])
def test_a_state_that_the_first_frame_rules_out_and_all_others_prove(level, n):
    """Of its density there only a bound is known, which is no evidence: the twin has to say how bad that start was."""
    p = Chain(np.full(2, 0.5), np.eye(2), np.array([[0.0], [100.0]]), np.ones((2, 1, 1)))
    z = np.tile([0.0, 100.0, 100.0, 100.0], n)[:, None]
    lessons = Lessons(z, np.full(n, 4), np.zeros(1), np.ones(1), ("x",))
    sums = kernels.e_step(z, lessons.groups, p.initial, p.transition, whitening(p.means, p.covariances).arrays)
    assert sums.failed.all()
    check_e_step(p, lessons)


@pytest.mark.parametrize("lengths", [[300] * 400, [2000, 17] + [50] * 1000, [50_000]])  # threads start where they pay
def test_threads_change_no_bit(level, lengths):
    rng = np.random.default_rng(1)
    lessons, p = lessons_of(rng, lengths, 4), chain(rng, 7, 4)
    white = whitening(p.means, p.covariances).arrays
    for ask in (kernels.e_step, kernels.posteriors):
        one, *others = [ask(lessons.z, lessons.groups, p.initial, p.transition, white, n_threads=n) for n in (1, 2, 5, 64)]
        for other in others:
            for a, b in zip(one, other, strict=True):
                same(a, b)


@pytest.mark.parametrize(("d", "k", "n"), [(1, 1, 1), (3, 5, 63), (3, 5, 64), (7, 10, 9001), (20, 3, 100)])
def test_mixture(level, d, k, n, monkeypatch):
    rng = np.random.default_rng(n)
    model, z = random_gmm(rng, k, d), 2.0 * rng.normal(size=(n, d))
    p = mixtures._Mixture(model.weights, model.means, model.covariances)
    total, found = mixtures._expect(p, z, gamma=True)
    monkeypatch.setattr(kernels, "native", None)
    expected_total, expected = mixtures._expect(p, z, gamma=True)
    assert total == pytest.approx(expected_total, rel=1e-10)
    for a, b in zip(found, expected, strict=True):
        agree(a, b)


@pytest.mark.parametrize(("d", "k"), [(1, 1), (3, 5), (7, 17), (2, 64)])
def test_likelihood_and_best_path(level, d, k, monkeypatch):
    rng = np.random.default_rng(k)
    model = random_hmm(rng, k, d)
    sequences = [hmm.sample(model, int(n), rng).frames for n in (1, 2, 300, 77)]
    found, paths = hmm.log_likelihood(model, sequences), [hmm.viterbi(model, x) for x in sequences]
    posteriors = [hmm.posteriors(model, x) for x in sequences]
    monkeypatch.setattr(kernels, "native", None)
    np.testing.assert_allclose(found, hmm.log_likelihood(model, sequences), rtol=1e-10)
    for x, path, posterior in zip(sequences, paths, posteriors, strict=True):
        same(path, hmm.viterbi(model, x))
        agree(posterior.weights, hmm.posteriors(model, x).weights)


@pytest.mark.parametrize("n_threads", [1, 3])
def test_many_sequences_together_are_as_each_alone(level, n_threads, monkeypatch):
    rng = np.random.default_rng(4)
    model = random_hmm(rng, 5, 3)
    sequences = [hmm.sample(model, n, rng).frames for n in (30, 1, 200, 64, 7, 64, 90, 3, 3000, 12)]
    sequences[3][5, 1] = np.nan  # the twins take this one, and its neighbours know nothing of it
    together = (
        hmm.viterbi_of_all(model, sequences, n_threads=n_threads),
        hmm.posteriors_of_all(model, iter(sequences), n_threads=n_threads),
        hmm.log_likelihood(model, sequences, n_threads=n_threads),
    )
    monkeypatch.setattr(kernels, "native", None)
    for x, path, found, likelihood in zip(sequences, *together, strict=True):
        same(path, hmm.viterbi(model, x))
        expected = hmm.posteriors(model, x)
        agree(found.weights, expected.weights)
        assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-10)
        assert likelihood == pytest.approx(expected.log_likelihood, rel=1e-10)


def test_of_equally_good_ways_the_first(level):
    """Five states that nobody can tell apart, alone and side by side."""
    model = Hmm(np.full(5, 0.2), np.full((5, 5), 0.2), np.zeros((5, 1)), np.ones((5, 1, 1)), ("x",))
    sequences = [np.linspace(0.0, 1.0, n)[:, None] for n in (30, 7, 64, 2000, 1, 12, 40, 40, 5)]
    for path in (*hmm.viterbi_of_all(model, sequences), hmm.viterbi(model, sequences[0])):
        assert not path.any()


@pytest.mark.parametrize("call", [hmm.viterbi_of_all, hmm.posteriors_of_all, hmm.log_likelihood])
def test_no_sequence_at_all_is_said(call):
    with pytest.raises(ParameterError, match="there is no sequence"):
        call(random_hmm(np.random.default_rng(0), 2, 1), [])


@pytest.mark.parametrize(("d", "k"), [(1, 1), (3, 5), (14, 10), (60, 3), (2, 64)])
@pytest.mark.parametrize("options", [{}, {"transition_floor": 0.0, "gate": np.inf}, {"transition_floor": 0.0, "patience": 1}])
def test_a_tick(level, d, k, options, monkeypatch):
    rng = np.random.default_rng(d)
    model = random_hmm(rng, k, d)
    x = hmm.sample(model, 100, rng).frames
    x[[7, 30, 31, 32, 33]] += 1e3
    x[50:53, 0] = np.nan
    x[60] = 1e300
    native = ForwardFilter(model, **options)
    monkeypatch.setattr(kernels, "native", None)
    twin = ForwardFilter(model, **options)
    for xi in x:
        agree(native.step(xi), twin.step(xi))
        assert native.last_log_likelihood == pytest.approx(twin.last_log_likelihood, rel=1e-10, abs=1e-10)
    assert native.log_likelihood == pytest.approx(twin.log_likelihood, rel=1e-10)
    assert native.restarts == twin.restarts


def test_a_tick_takes_lists_and_slices_like_its_twin(level):
    model = random_hmm(np.random.default_rng(0), 3, 2)
    a, b, c = ForwardFilter(model), ForwardFilter(model), ForwardFilter(model)
    wide = np.arange(8.0).reshape(2, 4)
    expected = a.step(np.array([0.0, 2.0]))
    agree(b.step([0.0, 2.0]), expected)
    agree(c.step(wide[0, ::2]), expected)


@pytest.mark.parametrize(("d", "k"), [(2, 1), (3, 5), (14, 10)])
def test_regression_lines(level, d, k, monkeypatch):
    rng = np.random.default_rng(d)
    model = random_gmm(rng, k, d)
    native = Regression(model, model.channels[1:], model.channels[:1])
    monkeypatch.setattr(kernels, "native", None)
    twin = Regression(model, model.channels[1:], model.channels[:1])
    for _ in range(10):
        h, x = rng.dirichlet(np.ones(k)), rng.normal(size=d - 1)
        agree(native.mean(h, x), twin.mean(h, x))
        agree(native.mean(h, x, out=np.empty(1)), twin.mean(h, x))
        agree(native.mean(h, x.tolist()), twin.mean(h, x))


@pytest.mark.parametrize(("d", "f", "n"), [(1, 1, 1), (2, 3, 70), (3, 0, 64), (1, 1, 129)])
@pytest.mark.parametrize("evidence", [None, "position", ("force", "position", "velocity")])
def test_roll_outs(level, d, f, n, evidence, monkeypatch):
    rng = np.random.default_rng(n)
    channels = [f"{g}.{i}" for g, m in (("position", d), ("force", f), ("velocity", d)) for i in range(m)]
    p = random_hmm(rng, 5, len(channels))
    model = Hmm(p.initial, p.transition, p.means, p.covariances, tuple(channels))
    if f == 0 and evidence == ("force", "position", "velocity"):
        evidence = ("position", "velocity")
    start, force = rng.normal(size=(n, d)), rng.normal(size=(n, 30, f))
    found = [
        roll_out(model, start, x, dt=0.01, evidence=evidence, n_threads=m) for x, m in ((force, 1), (force, 2), (force[0], 1))
    ]
    monkeypatch.setattr(kernels, "native", None)
    expected = roll_out(model, start, force, dt=0.01, evidence=evidence)
    for one, other in zip(found[0], found[1], strict=True):
        same(one, other)
    for one, other in zip(found[0], expected, strict=True):
        agree(one, other)
    for one, other in zip(found[2], roll_out(model, start, force[0], dt=0.01, evidence=evidence), strict=True):
        agree(one, other)


def test_roll_outs_of_an_hour_lose_no_weight(level, monkeypatch):
    """Weights shrink by what a frame is less likely than in its best state: again and again they would come to nothing."""
    rng = np.random.default_rng(0)
    p = random_hmm(rng, 4, 3)
    model = Hmm(p.initial, p.transition, p.means, p.covariances, ("position.z", "force.z", "velocity.z"))
    start, force = rng.normal(size=(3, 1)), rng.normal(size=(3000, 1))
    found = roll_out(model, start, force, dt=1e-3)
    monkeypatch.setattr(kernels, "native", None)
    for one, other in zip(found, roll_out(model, start, force, dt=1e-3), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)


@pytest.mark.parametrize("native", [True, False])
def test_roll_outs_write_where_they_are_told(native, monkeypatch):
    if not native:
        monkeypatch.setattr(kernels, "native", None)
    rng = np.random.default_rng(0)
    p = random_hmm(rng, 3, 3)
    model = Hmm(p.initial, p.transition, p.means, p.covariances, ("position.z", "force.z", "velocity.z"))
    start, force = rng.normal(size=(5, 1)), rng.normal(size=(7, 1))
    fresh, kept = roll_out(model, start, force, dt=0.01), RollOuts(np.full((5, 7, 1), np.nan), np.full((5, 7, 1), np.nan))
    found = roll_out(model, start, force, dt=0.01, out=kept)
    assert found.position is kept.position
    assert found.velocity is kept.velocity
    for one, other in zip(found, fresh, strict=True):
        same(one, other)
    for wrong in (np.empty((5, 6, 1)), np.empty((5, 7, 1), dtype=np.float32), np.empty((10, 7, 1))[::2]):
        with pytest.raises(ParameterError, match=r"out\.velocity must be float64 \(5, 7, 1\), C-contiguous"):
            roll_out(model, start, force, dt=0.01, out=RollOuts(kept.position, wrong))


def test_ten_thousand_calls_leave_no_memory_behind():
    import tracemalloc

    rng = np.random.default_rng(0)
    lessons, p = lessons_of(rng, [30, 20, 9], 3), chain(rng, 4, 3)
    model = random_hmm(rng, 4, 3)
    log_initial, log_transition, white = log_of(p.initial), log_of(p.transition), whitening(p.means, p.covariances).arrays

    def everything():
        kernels.e_step(lessons.z, lessons.groups, p.initial, p.transition, white)
        kernels.mixture(lessons.z, log_initial, white)
        kernels.decode(lessons.z, lessons.lengths, log_initial, log_transition, white)
        ForwardFilter(model).step(lessons.z[0])

    for _ in range(100):
        everything()
    before = resident()
    tracemalloc.start()
    for _ in range(2500):
        everything()
    python_bytes = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert python_bytes < 200_000
    assert resident() - before < 3_000_000


def test_shapes_that_do_not_fit_are_refused():
    rng = np.random.default_rng(0)
    p = chain(rng, 3, 2)
    white = whitening(p.means, random_covariances(rng, 3, 2)).arrays
    groups = kernels.planned(np.array([10]))
    with pytest.raises(ValueError, match="expected"):
        kernels.e_step(np.zeros((10, 2)), groups, p.initial[:2], p.transition, white)
    with pytest.raises(ValueError, match="plan"):
        kernels.e_step(np.zeros((9, 2)), groups, p.initial, p.transition, white)
    sound = groups.plan
    beyond, out_of_order = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 0])
    for wrong in ({"order": sound.order + 1}, {"pieces": sound.pieces + beyond}, {"pieces": sound.pieces + out_of_order}):
        groups.plan = sound._replace(**wrong)
        with pytest.raises(ValueError, match="plan"):
            kernels.e_step(np.zeros((10, 2)), groups, p.initial, p.transition, white)


@pytest.mark.parametrize("level", LEVELS, indirect=True)
@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("nats", [(712.0, 300.0), (380.0, 300.0), (45.0, 40.0), (5000.0, 900.0)])
def test_a_path_that_falls_below_float64_and_turns_out_the_best_is_not_lost(level, alone, nats):
    """Held beside its state for long, then there again: who cannot go back must have been there all the time."""
    away, back = nats
    centre, variance, least = 0.5, 1e-3, 20
    frames = np.concatenate([[centre - variance * away] * least, [centre + variance * back] * 2 * least])[:, None]
    means, covariances = np.array([[0.0], [1.0]]), np.full((2, 1, 1), variance)
    model = Hmm(np.full(2, 0.5), np.eye(2), means, covariances, ("a",))
    given = [frames] if alone else [frames, frames[least:], frames, frames[: least + 3]] * 6
    found = hmm.log_likelihood(model, given)
    np.testing.assert_allclose(found, [hmm._log_likelihood(model, x, np.array([len(x)]))[0] for x in given], rtol=1e-9)
    lessons = Lessons(np.concatenate(given), np.array([len(x) for x in given]), np.zeros(1), np.ones(1), ("a",))
    check_e_step(Chain(model.initial, model.transition, means, covariances), lessons)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 5), st.integers(1, 3), st.integers(0, 2**31))
def test_glitches_and_hands_held_beside_their_states(n_states, n_channels, seed):
    rng = np.random.default_rng(seed)
    p = chain(rng, n_states, n_channels, left_right=bool(rng.integers(2)))
    p = p._replace(covariances=p.covariances * 10.0 ** rng.uniform(-4.0, 0.0, (n_states, 1, 1)))
    model = Hmm(*p, tuple("abc"[:n_channels]))
    given = []
    for _ in range(int(rng.integers(1, 20))):
        x = p.means[np.sort(rng.integers(n_states, size=rng.integers(2, 60)))]
        for _ in range(int(rng.integers(4))):
            at = rng.integers(len(x))
            x[at : at + rng.integers(1, 10)] = p.means[rng.integers(n_states)]
        given.append(x + 0.05 * rng.normal(size=x.shape))
    expected = [hmm._log_likelihood(model, x, np.array([len(x)]))[0] for x in given]
    np.testing.assert_allclose(hmm.log_likelihood(model, given), expected, rtol=1e-9, atol=1e-9)
