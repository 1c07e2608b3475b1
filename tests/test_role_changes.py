"""The figure of the changes of role: its claims, and what planted defects do to them."""

from __future__ import annotations

import numpy as np
import pytest

from pictures import is_drawn

pytest.importorskip("matplotlib")
from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import at_most
from comanip.experiments import role_changes


@pytest.fixture(scope="module")
def found(skills):
    return role_changes.numbers(0, learned=dict(skills))


def failed(found):
    return [claim.text for claim in role_changes.claims(found) if not claim.passed]


def ideal(found):
    """The same lift as a robot would play it that knows: the role at once, no force above 9 N, and the height that is wanted."""
    t = found.time
    leads = ((t > role_changes.HANDS_OVER_S) & (t < role_changes.INSISTS_S)).astype(float)
    told = np.zeros_like(found.role)
    told[:, 1] = 1.0
    height = np.where(t > role_changes.END_S - 2.0, role_changes.INSISTED_M, found.height)
    return found._replace(role=told, blend=leads, force=np.clip(found.force, -9.0, 9.0), height=height)


def test_each_claim_holds_or_fails_as_is_known(found):
    """Strictly: a claim that holds again is taken off the known ones in `role_changes.claims`."""
    assert [(c.text, c.measured, c.known) for c in role_changes.claims(found) if not c.as_known] == []
    assert 0 < sum(bool(c.known) for c in role_changes.claims(found)) < 4


def test_a_role_that_is_known_and_played_in_time_passes(found):
    assert failed(ideal(found)) == []


def test_what_would_refute_a_claim_does(found):
    found = ideal(found)
    t = found.time
    defects = {
        "before: motion": found._replace(role=np.eye(4)[np.zeros(len(t), dtype=int)]),
        "before: ticks": found._replace(blend=np.where(t < 2.0, 1.0, found.blend)),
        "the partner hands over": found._replace(blend=np.zeros_like(t)),
        "the partner insists": found._replace(blend=np.ones_like(t)),
        "offers": found._replace(blend=np.where(t > 9.0, (t * 2).astype(int) % 2, found.blend)),
        "no jump": found._replace(commanded=found.commanded + 0.2 * (t > 5.0)),
        "largest |F|": found._replace(force=np.where(t > 9.0, 12.0, found.force)),
        "distance of the end": found._replace(height=found.height + 0.05 * (t > 9.0)),
    }
    before = {c.text: c.measured for c in role_changes.claims(found)}
    assert {text for text in before if text.startswith(tuple(defects))} == set(before), "a defect for each claim"
    for words, spoilt in defects.items():
        (claim,) = [c for c in role_changes.claims(spoilt) if c.text.startswith(words)]
        assert not claim.passed
        assert claim.measured > before[claim.text]


def test_what_is_known_to_fail_and_holds_is_wrong_too():
    late = at_most("late", 2.0, 1.0, refuted_by="later", known="not mended yet")
    assert late.as_known
    assert late.verdict == "known to fail (not mended yet)"
    mended = late._replace(passed=True)
    assert not mended.as_known
    assert mended.verdict == "pass (no longer known to fail: not mended yet)"
    assert not at_most("late", 2.0, 1.0, refuted_by="later").as_known
    assert at_most("in time", 1.0, 1.0, refuted_by="later").as_known


def test_it_draws(found, tmp_path):
    wide = found._replace(role=np.column_stack([found.role, found.role[:, :1]])[:, :4])
    assert is_drawn(figures.save(role_changes.draw(wide), tmp_path / "role_changes.png"))
