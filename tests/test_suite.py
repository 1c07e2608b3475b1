"""Rules for tests, held by a test: the same examples everywhere, no limit in seconds, no picture judged by its size in bytes."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture import providers

FILES = sorted(Path(__file__).parent.rglob("test_*.py"))
RULES = {  # what must not stand in a test -> why
    r"derandomize ?= ?False|register_profile|load_profile": "examples are the same everywhere: conftest.py",
    r"assert [^\n]*(perf_counter|monotonic|time\.time)\(\) - \w+ <": "a slow machine is no fault",
    r"\.(png|svg|pdf)[^\n]*st_size >": "a picture that is large may be empty: pictures.is_drawn",
}


def broken(text: str) -> list[str]:
    return [why for rule, why in RULES.items() if re.search(rule, text)]


def test_no_test_breaks_a_rule():
    here = Path(__file__)
    assert {f.name: found for f in FILES if f != here and (found := broken(f.read_text()))} == {}


@pytest.mark.parametrize(
    "planted",
    [
        "@settings(derandomize=False)",
        "    assert time.perf_counter() - start < 0.1",
        '    assert (tmp_path / "lift.png").stat().st_size > 10_000',
    ],
)
def test_a_planted_one_is_found(planted):
    assert len(broken(planted)) == 1


def drawn() -> list[int]:
    """What Hypothesis tries for a whole number."""
    found = []

    @settings(max_examples=60)
    @given(st.integers())
    def tries(n):
        found.append(n)

    tries()
    return found


def test_examples_are_the_same_whatever_was_loaded_before(tmp_path, monkeypatch):
    """By itself Hypothesis also tries the numbers of modules that are loaded: then the order of tests decides."""
    before = drawn()
    file = tmp_path / "planted_numbers.py"
    file.write_text("\n".join(f"N{i} = {7919 * i + 100_003}" for i in range(400)))
    module = types.ModuleType("planted_numbers")
    module.__file__ = str(file)
    monkeypatch.setitem(sys.modules, "planted_numbers", module)
    assert drawn() == before
    assert len(providers._get_local_constants()) == 0
    assert settings().derandomize
