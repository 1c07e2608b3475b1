"""Weights of several guesses: never negative, right where the right ones are known, none for what misleads."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from comanip.evaluation.stacking import nonnegative, weights
from comanip.evaluation.takes import folds_of


def best_subset(square, cross):
    """The minimum over all subsets of weights that are positive: slow and plain."""
    found, least = np.zeros(len(cross)), 0.0
    for size in range(1, len(cross) + 1):
        for used in map(list, combinations(range(len(cross)), size)):
            w = np.zeros(len(cross))
            w[used] = np.linalg.lstsq(square[np.ix_(used, used)], cross[used], rcond=None)[0]
            cost = w @ square @ w / 2 - cross @ w
            if (w >= 0.0).all() and cost < least:
                found, least = w, cost
    return found, least


@pytest.mark.parametrize("seed", range(20))
def test_weights_are_the_best_of_all_that_are_not_negative(seed):
    rng = np.random.default_rng(seed)
    a, y = rng.normal(size=(rng.integers(3, 20), 5)), rng.normal(size=5)
    a[:, 1] = a[:, 0] if seed % 4 == 0 else a[:, 1]
    square, cross = a.T @ a, a.T @ (a @ y + rng.normal(size=len(a)))
    found, least = nonnegative(square, cross), best_subset(square, cross)[1]
    assert (found >= 0.0).all()
    assert found @ square @ found / 2 - cross @ found == pytest.approx(least, rel=1e-6, abs=1e-9)


def test_a_mixture_is_found_and_what_misleads_gets_nothing():
    rng = np.random.default_rng(0)
    guesses = [rng.normal(size=(3, 40, 2)) for _ in range(4)]
    truth = [0.3 * g[0] + 0.6 * g[1] - 0.5 * g[2] for g in guesses]
    assert weights(guesses, [0.3 * g[0] + 0.6 * g[1] for g in guesses]) == pytest.approx([0.3, 0.6, 0.0], abs=1e-6)
    assert weights(guesses, truth)[2] == 0.0


def test_a_long_lesson_counts_as_much_as_a_short_one():
    rng = np.random.default_rng(1)
    short, long = rng.normal(size=(2, 50, 1)), rng.normal(size=(2, 5000, 1))
    found = weights([short, long], [short[0], long[1]])
    assert found.min() > 0.3  # counted by frames, the short one's would have a hundredth


def test_doubt_takes_off_what_few_lessons_cannot_vouch_for():
    rng = np.random.default_rng(2)
    guesses = [rng.normal(size=(2, 60, 1)) for _ in range(2)]
    exact, noisy = [g[0] for g in guesses], [g[0] + 2.0 * rng.normal(size=(60, 1)) for g in guesses]
    assert weights(guesses, exact, 3.0) == pytest.approx([1.0, 0.0], abs=1e-6)
    assert weights(guesses, noisy, 3.0)[0] < 0.7 * weights(guesses, noisy)[0]
    assert weights([], []).shape == (0,)
    assert not weights([np.zeros((2, 0, 1))], [np.zeros((0, 1))]).any()


def test_pieces_of_one_take_are_in_one_fold(lessons):
    from dataclasses import replace

    named = [
        replace(x, name=n, source="a") for x, n in zip(lessons["leader"], ("a#0", "a#1", "b", "c", "d#0", "d#1"), strict=True)
    ]
    folds = folds_of(named, 3)
    assert sorted(i for fold in folds for i in fold) == list(range(6))
    assert any({0, 1} <= set(fold) for fold in folds)
    assert any({4, 5} <= set(fold) for fold in folds)


@pytest.mark.parametrize("seed", range(40))
def test_weights_of_guesses_that_resemble_each_other_leave_nothing_to_gain(seed):
    """The conditions of Karush, Kuhn and Tucker: no slope at weights above zero, none downhill at those that are zero."""
    rng = np.random.default_rng([7, seed])
    a = rng.normal(size=(30, 1)) + 0.2 * rng.normal(size=(30, 9))
    square, cross = a.T @ a, a.T @ (a @ rng.normal(size=9) + rng.normal(size=30))
    found = nonnegative(square, cross)
    slope = square @ found - cross
    assert (found >= 0.0).all()
    assert slope.min() > -1e-6 * np.abs(cross).max()
    assert slope[found > 0.0] == pytest.approx(0.0, abs=1e-6 * np.abs(cross).max())


def test_doubt_is_the_error_of_one_lesson_however_many_there_are():
    """w of one guess: w ← Σ gy / (Σ gg + doubt · mean error), three rounds; means over frames, sums over lessons."""
    rng = np.random.default_rng(3)
    guesses = [rng.normal(size=(1, 50, 1)) for _ in range(4)]
    truth = [g[0] + rng.normal(size=(50, 1)) for g in guesses]
    gg, gy = (sum(float((g[0] * x).mean()) for g, x in zip(guesses, xs, strict=True)) for xs in ([g[0] for g in guesses], truth))
    w = gy / gg
    for _ in range(3):
        wrong = np.mean([float(((w * g[0] - y) ** 2).mean()) for g, y in zip(guesses, truth, strict=True)])
        w = gy / (gg + 3.0 * wrong)
    assert weights(guesses, truth, 3.0) == pytest.approx([w], rel=1e-6)
