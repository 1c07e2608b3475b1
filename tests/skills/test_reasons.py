"""The envelope's reasons by number, as the Python says them and as C does."""

from __future__ import annotations

from math import nan

import pytest

from comanip.safety.limits import Limits
from comanip.safety.reasons import NAMES, WHOLE, number_of, said_of, same

LIMITS = Limits()


def test_each_reason_without_a_number_comes_back_as_its_own():
    assert len(set(WHOLE.values())) == len(WHOLE)
    for name, said in WHOLE.items():
        assert said_of(NAMES.index(name), nan, 60.0, LIMITS) == said
        assert NAMES[number_of(said)] == name


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("OLD", 52.4, "force 52 ms old"),
        ("LATE", 30.1, "late 30 ms"),
        ("POSITION_JUMP", 0.0234, "position jump 0.023 m"),
        ("TOO_STRONG", 61.2, "force 61 N > 60 N"),
        ("TOO_HEAVY", 29.6, "the object weighs 30 N on this hand > 22 N: too heavy to carry"),
        ("FORCE_JUMPED", 2.04, "force jumped 2.0 N at rest: sensor? tare, then re-arm"),
        ("NOT_FOLLOWING", 0.052, "does not follow: 0.052 m off"),
        ("PUSHED", 12.3, "pushed along with 12 N: sensor, or a weight on it?"),
    ],
)
def test_each_reason_with_a_number_is_said_with_it_and_known_by_what_is_said(name, value, said):
    assert said_of(NAMES.index(name), value, 60.0, LIMITS) == said
    assert NAMES[number_of(said)] == name


def test_what_c_does_not_have_is_no_reason_of_it():
    assert number_of("nobody says so") == number_of("blocked by something") == -1
    assert NAMES[number_of("policy: ValueError('two\\nlines')")] == "POLICY"
    assert NAMES[number_of("policy: two\nlines")] == "POLICY"


def test_two_are_one_reason_with_one_number_or_with_none():
    assert same(1, 2.0, 1, 2.0)
    assert same(1, nan, 1, nan)
    assert not same(1, 2.0, 2, 2.0)
    assert not same(2, 2.0, 1, 2.0)
    assert not same(1, 2.0, 2, 3.0)
    assert not same(1, 2.0, 1, 3.0)
    assert not same(1, 2.0, 1, nan)
    assert not same(1, nan, 1, 2.0)
