"""Every example runs in a folder of its own, warns of nothing, and stands in the list."""

from __future__ import annotations

from pathlib import Path

import pytest

import forked

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(EXAMPLES.glob("[0-9]*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_an_example_runs_and_says_what_it_found(script, tmp_path):
    done = forked.script(script, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_the_list_names_each_example_once():
    listed = [line.split("`")[1] for line in (EXAMPLES / "README.md").read_text().splitlines() if line.startswith("| `")]
    assert listed == [script.name for script in SCRIPTS]
