"""A short hammering of the envelope; `python tests/hammer_envelope.py` is the long one."""

from __future__ import annotations

import pytest

from hammer_envelope import hammer


@pytest.mark.parametrize("seed", [1, 2])
def test_no_invariant_breaks_and_the_adversary_stays_within_walls_and_budget(seed):
    worst = hammer(10_000, 6, seed)
    assert worst["energy beyond the budget [J]"] > -0.1  # it does find what there is to take
