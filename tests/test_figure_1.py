"""Fig. 1 is a run in physics: its claims hold, and a partner who pulls the other way refutes them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pictures import is_drawn

pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")

from comanip.errors import ParameterError
from comanip.experiments import figure_1


@pytest.fixture(scope="module")
def found():
    return figure_1.numbers(0)


def test_every_claim_of_figure_1_holds(found):
    assert [c.text for c in figure_1.claims(found) if not c.passed] == []


def test_a_lesson_with_another_force_refutes_figure_1(found):
    force = found.lesson["hand.true_force"]
    other = found.lesson.with_channels({"hand.true_force": replace(force, values=-force.values)})
    failed = [c.text for c in figure_1.claims(found._replace(lesson=other)) if not c.passed]
    assert any("feels the force that it feels there" in text for text in failed)


def test_its_picture_is_drawn(found, tmp_path):
    try:
        picture = figure_1.draw(found, tmp_path / "figure_1.png")
    except ParameterError as problem:
        pytest.skip(str(problem))
    assert is_drawn(picture)
