"""The compiled kernels of explicit durations say what their readable twins say, as in test_twins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.models import hsmm
from comanip.models.durations import of_mean, table
from comanip.models.filtering import DurationFilter
from comanip.models.gaussian import whitening
from comanip.models.hsmm import Hsmm
from toys import agree, random_hsmm, resident, same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
LEVELS = kernels.native.levels() if kernels.native else []


def check_e_step(model, frames, lengths):
    white = whitening(model.means, model.covariances)
    found = kernels.segments(
        frames, lengths, model.initial, model.transition, model.durations, white.arrays, weights=True
    )  # fmt: skip
    assert not found.failed.any()
    expected = hsmm._twin(model, white, frames, lengths)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-10)
    for name in ("moments", "transitions", "first", "durations", "weights"):
        agree(getattr(found, name), getattr(expected, name))
    assert (found.transitions[model.transition == 0.0] == 0.0).all()
    assert (found.durations[model.durations == 0.0] == 0.0).all()


def frames_of(model, lengths, rng):
    return np.concatenate([hsmm.sample(model, int(n), rng).frames for n in lengths])


@pytest.mark.parametrize(
    ("d", "k", "longest"),
    [(1, 1, 1), (1, 5, 3), (2, 2, 8), (3, 5, 9), (4, 9, 16), (7, 10, 31), (14, 17, 5), (33, 8, 12), (60, 3, 20), (2, 64, 7)],
)
@pytest.mark.parametrize("left_right", [False, True])
def test_e_step_for_sizes_from_1_to_64(level, d, k, longest, left_right):
    rng = np.random.default_rng(d * 100 + k)
    model = random_hsmm(rng, k, d, longest=longest, left_right=left_right)
    lengths = rng.integers(1, 60, size=9)
    check_e_step(model, frames_of(model, lengths, rng), lengths)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.integers(1, 120), min_size=1, max_size=20),
    st.integers(1, 4),
    st.integers(1, 6),
    st.integers(1, 40),
    st.integers(0, 10**6),
    st.booleans(),
)
def test_e_step_for_ragged_lengths(lengths, d, k, longest, seed, left_right):
    rng = np.random.default_rng(seed)
    model = random_hsmm(rng, k, d, longest=longest, left_right=left_right)
    frames, lengths = frames_of(model, lengths, rng), np.array(lengths)
    for name in LEVELS:
        kernels.native.use(name)
        check_e_step(model, frames, lengths)
    kernels.native.use(LEVELS[0])


def test_durations_of_five_and_of_five_hundred_frames(level):
    rng = np.random.default_rng(0)
    p = random_hsmm(rng, 4, 2)
    durations = table(of_mean(np.array([5.0, 500.0, 60.0, 200.0]), 30.0, 700), 700)
    model = Hsmm(p.initial, p.transition, durations, p.means, p.covariances, p.channels)
    lengths = np.array([1500, 700, 3])
    check_e_step(model, frames_of(model, lengths, rng), lengths)


def test_a_frame_without_explanation_gives_numbers(level):
    rng = np.random.default_rng(0)
    for left_right in (False, True):
        model = random_hsmm(rng, 5, 3, longest=30, left_right=left_right)
        lengths = np.array([50, 60, 70])
        frames = frames_of(model, lengths, rng)
        frames[[5, 100, 133], 1] = 1e5
        found = hsmm.segment_sums(model, frames, lengths, weights=True)
        expected = hsmm._twin(model, whitening(model.means, model.covariances), frames, lengths)
        np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-10)
        agree(found.durations, expected.durations, tolerance=1e-8)  # relative logarithms of 1e9 have 7 digits behind the point
        agree(found.weights, expected.weights, tolerance=1e-8)


@pytest.mark.parametrize("kind", ["too long for its states", "ends where it began", "far from all", "worse and worse"])
def test_where_scaling_leaves_float64_the_twin_takes_the_sequence(level, kind):
    p = table(of_mean(np.array([10.0, 10.0, 10.0]), 50.0, 30), 30)
    model = Hsmm(np.eye(3)[0], [[0, 1, 0], [0, 0, 1], [0, 0, 1]], p, [[0.0], [50.0], [100.0]], np.ones((3, 1, 1)), ("x",))
    good = np.repeat([0.0, 50.0, 100.0], 10)
    bad = {
        "too long for its states": np.repeat([0.0, 50.0, 100.0], [200, 10, 10]),
        "ends where it began": np.repeat([0.0, 50.0, 100.0, 0.0], 10),
        "far from all": np.concatenate([good, np.full(30, -1e4)]),
        "worse and worse": np.concatenate([good, np.linspace(100.0, 60.0, 200)]),
    }[kind]
    frames, lengths = np.concatenate([good, bad, good])[:, None], np.array([30, len(bad), 30])
    white = whitening(model.means, model.covariances)
    sums = kernels.segments(frames, lengths, model.initial, model.transition, model.durations, white.arrays)
    assert sums.failed.tolist() == [False, True, False]
    found, expected = hsmm.segment_sums(model, frames, lengths, weights=True), hsmm._twin(model, white, frames, lengths)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-10)
    for name in ("moments", "transitions", "first", "durations", "weights"):
        agree(getattr(found, name), getattr(expected, name), tolerance=1e-8)


def test_a_path_that_was_lost_under_the_least_number_and_matters_later_is_noticed(level):
    """Either state lasts 20 frames. Ten frames rule the second out, beyond 1e-308; eleven more rule out the first even more."""
    p = np.zeros((2, 24))
    p[:, 19] = 1.0
    model = Hsmm([0.5, 0.5], [[0.0, 1.0], [1.0, 0.0]], p, [[0.0], [14.0]], np.ones((2, 1, 1)), ("x",))
    frames, lengths = np.repeat([0.0, 14.0], [9, 11])[:, None], np.array([20])
    white = whitening(model.means, model.covariances)
    assert kernels.segments(frames, lengths, model.initial, model.transition, model.durations, white.arrays).failed[0]
    found = hsmm.segment_sums(model, frames, lengths, weights=True)
    assert found.log_likelihood[0] == pytest.approx(hsmm._twin(model, white, frames, lengths).log_likelihood[0], rel=1e-12)
    assert found.weights[:, 1].min() > 0.999


@pytest.mark.parametrize("lengths", [[100] * 40, [900, 17] + [50] * 30])
def test_threads_change_no_bit(level, lengths):
    rng = np.random.default_rng(1)
    model = random_hsmm(rng, 7, 4, longest=20)
    frames, white = frames_of(model, lengths, rng), whitening(model.means, model.covariances).arrays
    one, *others = [
        kernels.segments(frames, np.array(lengths), model.initial, model.transition, model.durations, white, weights=True,
                         n_threads=n)
        for n in (1, 2, 64)
    ]  # fmt: skip
    for other in others:
        for a, b in zip(one, other, strict=True):
            same(a, b)


@pytest.mark.parametrize(("d", "k", "longest"), [(1, 1, 1), (3, 5, 16), (14, 10, 33), (60, 3, 8), (2, 64, 7)])
@pytest.mark.parametrize("options", [{}, {"transition_floor": 0.0, "gate": np.inf}, {"transition_floor": 0.0, "patience": 1}])
def test_a_tick(level, d, k, longest, options, monkeypatch):
    rng = np.random.default_rng(d)
    model = random_hsmm(rng, k, d, longest=longest)
    x = hsmm.sample(model, 100, rng).frames
    x[[7, 30, 31, 32, 33]] += 1e3
    x[50:53, 0] = np.nan
    x[60] = 1e300
    rates = rng.choice([0.0, 0.1, 0.5, 1.0, 1.0, 2.5, -1.0, np.nan], size=100)
    native = DurationFilter(model, **options)
    monkeypatch.setattr(kernels, "native", None)
    twin = DurationFilter(model, **options)
    for xi, rate in zip(x, rates.tolist(), strict=True):
        agree(native.step(xi, rate), twin.step(xi, rate))
        agree(native.remaining, twin.remaining, tolerance=1e-9)
        assert native.last_log_likelihood == pytest.approx(twin.last_log_likelihood, rel=1e-10, abs=1e-10)
    assert native.log_likelihood == pytest.approx(twin.log_likelihood, rel=1e-10)
    assert native.restarts == twin.restarts


def test_a_tick_takes_lists_slices_and_whole_rates_like_its_twin(level):
    model = random_hsmm(np.random.default_rng(0), 3, 2)
    filters = [DurationFilter(model) for _ in range(3)]
    wide = np.arange(8.0).reshape(2, 4)
    for _ in range(3):
        expected = filters[0].step(np.array([0.0, 2.0]))
        agree(filters[1].step([0.0, 2.0], 1), expected)
        agree(filters[2].step(wide[0, ::2]), expected)


def test_thousands_of_calls_leave_no_memory_behind():
    rng = np.random.default_rng(0)
    model = random_hsmm(rng, 4, 3, longest=20)
    x, lengths = frames_of(model, [30, 20, 9], rng), np.array([30, 20, 9])

    def everything():
        hsmm.segment_sums(model, x, lengths, weights=True)
        DurationFilter(model).step(x[0])

    for _ in range(100):
        everything()
    before = resident()
    for _ in range(2500):
        everything()
    assert resident() - before < 3_000_000


def test_shapes_that_do_not_fit_are_refused():
    rng = np.random.default_rng(0)
    model = random_hsmm(rng, 3, 2)
    white = whitening(model.means, model.covariances).arrays
    with pytest.raises(ValueError, match="expected"):
        kernels.segments(np.zeros((10, 2)), np.array([10]), model.initial[:2], model.transition, model.durations, white)
    with pytest.raises(ValueError, match="starts"):
        kernels.segments(np.zeros((10, 2)), np.array([11]), model.initial, model.transition, model.durations, white)
