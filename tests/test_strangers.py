"""Partners of other kinds: they are what they say they are, and the default law works with each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.experiments import strangers
from comanip.trials import draw_case
from comanip.trials.foreign import PartnersFrom
from comanip.trials.running import one_run

QUIET = {"onset_s": 0.5, "force_bias_n": 0.0, "stiffness_n_per_m": 200.0, "damping_ns_per_m": 25.0}


def drawn(role):
    return replace(draw_case(role, np.random.default_rng(12)), **QUIET)


def held(kind, speed=0.0, seconds=3.0):
    """(T,) force beyond the weight [N] on a hand that goes away at `speed` [m/s]."""
    case = drawn("follower" if kind in strangers.LEADING else "leader")
    person, out, forces = kind(case, np.random.default_rng(0)), np.zeros(1), []
    person.reset(np.array([0.85]))
    for n in range(round(seconds * 1000)):
        person.force(0.001 * n, np.array([0.85 + 0.001 * n * speed]), np.array([speed]), out)
        forces.append(out[0] - case.carried_n)
    return np.array(forces)


@pytest.mark.parametrize("kind", strangers.LEADING)
def test_who_leads_pulls_up_at_a_hand_that_stays_and_not_before_he_means_to(kind):
    force = held(kind)
    assert abs(force[:400].mean()) < 0.5
    assert force[2000:].mean() > 4.0


@pytest.mark.parametrize("kind", strangers.FOLLOWING)
def test_who_follows_resists_a_hand_that_goes_and_leaves_one_alone_that_stays(kind):
    assert abs(held(kind).mean()) < 0.3
    going = held(kind, speed=0.1)
    assert going[50:150].mean() < -0.5
    assert -25.0 < going[500:].mean() < 0.1


def test_the_default_law_works_nine_times_in_ten(skills):
    runs = {
        (role, kind.__name__): one_run(drawn(role), skills, "default", partner=kind)[1].failures
        for role, kinds in (("follower", strangers.LEADING), ("leader", strangers.FOLLOWING))
        for kind in kinds
    }
    failed = {who: why for who, why in runs.items() if why}
    assert len(failed) <= 0.1 * len(runs), failed


def test_the_file_gives_partners_to_a_trial():
    make, case = PartnersFrom(strangers.__file__), drawn("follower")
    made = [type(make(replace(case, seed=n), np.random.default_rng(0)).person).__name__ for n in range(9)]
    assert made == [kind.__name__ for kind in (*strangers.LEADING, strangers.LEADING[0])]
