"""The check of the humanoid over many runs: its claims hold on a few, and each falls when its number is wrong."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")
pytest.importorskip("matplotlib")

from comanip.experiments import physics_check


@pytest.fixture(scope="module")
def found():
    return physics_check.numbers(1, lessons=1, runs=0)


def failed(found):
    return [c.text for c in physics_check.claims(found) if not c.passed]


def test_every_claim_holds_on_the_first_lessons(found):
    assert failed(found) == []
    assert len(found.weights) == 2


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"force_rms_n": 0.31}, "the simulator's truth"),
        ({"peak_n": 0.5}, "something to feel"),
        ({"first_third_n": 0.1}, "role's sign"),
        ({"tilt_deg": 2.1}, "level"),
        ({"limits": 1.0}, "limit"),
        ({"lean_deg": 10.0}, "stands"),
        ({"stopped": "the simulator warned"}, "ended early"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_one_lesson_that_is_not_so_refutes_it(found, wrong, said):
    lessons = {**found.lessons, "leader": [found.lessons["leader"][0]._replace(**wrong)]}
    assert any(said in text for text in failed(found._replace(lessons=lessons)))


def test_a_weight_that_is_wrong_refutes_it(found):
    assert any("weighs" in text for text in failed(found._replace(weights=[2.05])))


def test_its_table_and_drawing_name_both_roles(found):
    assert "1 lessons, robot as leader" in physics_check.table(found)
    assert "robot as follower" in physics_check.table(found)
    assert len(physics_check.draw(found).axes) == 3
