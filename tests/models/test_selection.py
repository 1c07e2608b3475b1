"""Choosing the number of states."""

import numpy as np
import pytest

from comanip.models.selection import select_states
from toys import CHANNELS, lifts


@pytest.mark.parametrize("criterion", ["bic", "cross-validation"])
def test_the_number_of_processes_changes_no_score(criterion):
    def scores(n_jobs):
        return select_states(
            lifts(4), range(2, 5), channels=CHANNELS, criterion=criterion, restarts=2, rng=np.random.default_rng(3), n_jobs=n_jobs
        ).scores

    np.testing.assert_array_equal(scores(1), scores(2))
