"""Choosing the number of states."""

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.fitting.selection import select_states
from toys import CHANNELS, lifts


@pytest.mark.parametrize("criterion", ["bic", "cross-validation"])
def test_the_number_of_processes_changes_no_score(criterion):
    def scores(n_jobs):
        return select_states(
            lifts(4), range(2, 5), channels=CHANNELS, criterion=criterion, restarts=2, rng=np.random.default_rng(3), n_jobs=n_jobs
        ).scores

    np.testing.assert_array_equal(scores(1), scores(2))


@pytest.mark.parametrize("criterion", ["bic", "cross-validation"])
def test_durations_are_scored_as_what_they_are(criterion):
    data = [x[::4] for x in lifts(4)]
    found = {m: select_states(data, [3], channels=CHANNELS, criterion=criterion, model=m) for m in ("hmm", "hsmm")}
    assert found["hsmm"].scores[0] < found["hmm"].scores[0]  # lifts of much the same length: durations say something
    with pytest.raises(ParameterError, match="hmm, hsmm; got 'crf'"):
        select_states(data, [3], channels=CHANNELS, model="crf")
