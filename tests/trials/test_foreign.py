"""Partners from a file: what it may hold, and one line for each mistake."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import Partner
from comanip.trials import draw_case
from comanip.trials.foreign import PartnersFrom
from comanip.trials.judging import judge
from comanip.trials.running import one_run

SPRING = """
    def reset(self, position):
        self.home = position.copy()

    def force(self, time, position, velocity, out):
        out[:] = self.carried + 200.0 * (self.home - position) - 20.0 * velocity
"""
PLAIN = f"class Plain:\n    carried = 9.8\n{SPRING}"
TOLD = (
    f"class Told:\n    def __init__(self, case, rng):\n        self.carried, self.luck = case.carried_n, rng.uniform()\n{SPRING}"
)
FUNCTION = f"{PLAIN}\ndef partner(case, rng):\n    made = Plain()\n    made.carried = case.carried_n\n    return made\n"


@pytest.fixture
def case():
    return draw_case("follower", np.random.default_rng(4))


def made(tmp_path, text, case, name="people.py"):
    (tmp_path / name).write_text(text)
    return PartnersFrom(str(tmp_path / name))(case, np.random.default_rng(0))


@pytest.mark.parametrize(("text", "kind"), [(PLAIN, "Plain"), (TOLD, "Told"), (FUNCTION, "Plain")])
def test_a_class_or_a_function_makes_a_partner(tmp_path, case, text, kind):
    person, out = made(tmp_path, text, case), np.zeros(1)
    assert isinstance(person, Partner)
    assert type(person.person).__name__ == kind
    person.reset(np.full(1, 0.85))
    person.force(0.0, np.full(1, 0.85), np.zeros(1), out)
    assert out[0] == pytest.approx(9.8 if text == PLAIN else case.carried_n)


def test_several_classes_take_turns_by_the_case(tmp_path, case):
    kinds = [type(made(tmp_path, PLAIN + TOLD, replace(case, seed=n)).person).__name__ for n in range(4)]
    assert kinds == ["Plain", "Told", "Plain", "Told"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class Broken(:\n", "SyntaxError"),
        ("import no_such_module_at_all\n", "ModuleNotFoundError"),
        ("x = 1\n", "holds no partner: give a function"),
        ("class Mute:\n    def reset(self, position): ...\n", "holds no partner"),
        ("class Half:\n    def force(self, time, position, velocity, out): ...\n", "Half gives Half, which lacks reset or force"),
        ("def partner(case, rng):\n    return 3\n", "partner gives int, which lacks reset or force"),
    ],
)
def test_a_mistake_in_the_file_is_said(tmp_path, case, text, said):
    with pytest.raises(ParameterError, match=said) as caught:
        made(tmp_path, text, case)
    assert "people.py" in str(caught.value)


def test_no_file_and_no_python_file_are_said(tmp_path, case):
    with pytest.raises(ParameterError, match=r"absent\.py: no such file; --partners-from takes a Python file"):
        PartnersFrom(str(tmp_path / "absent.py"))(case, np.random.default_rng(0))
    with pytest.raises(ParameterError, match="not a Python file"):
        made(tmp_path, PLAIN, case, name="people.txt")


GOES = """
from comanip.people.partners import Arm, HumanLeader, Legs

def partner(case, rng):
    arm = Arm(carried_n=case.carried_n)
    person = HumanLeader(Legs(((2.0, 1.6, 0.28),), feedforward_kg=0.5 * case.beam_mass_kg), arm, rng=rng)
    person.goal_m, person.onset_s, person.stop_s = STATED
    return person
"""


@pytest.mark.parametrize(
    ("stated", "failures"),
    [
        ("0.28, 2.0, 3.6", ()),
        ("0.20, 2.0, 3.6", ("missed the partner's goal",)),
        ("0.28, 5.0, 3.6", ("moved before the partner",)),
    ],
)
def test_a_partner_with_plans_of_his_own_is_judged_by_them(tmp_path, skills, stated, failures):
    (tmp_path / "goes.py").write_text(GOES.replace("STATED", stated))
    case = replace(draw_case("follower", np.random.default_rng(4)), onset_s=0.5, lift_m=0.3, force_noise_n=0.05)
    recording, verdict = one_run(case, skills, "default", partner=PartnersFrom(str(tmp_path / "goes.py")))
    assert verdict.failures == failures
    recording.metadata["stated"]["stop_s"] = 0.9  # then the force of his whole lift is left over
    assert judge(case, recording).residual_force_n > 1.5 * verdict.residual_force_n


def test_a_plan_that_is_no_number_is_refused(tmp_path, case):
    with pytest.raises(ParameterError, match=r"people\.py: Plain\.goal_m must be a finite number; got 'high'"):
        made(tmp_path, PLAIN.replace("carried = 9.8", "carried, goal_m = 9.8, 'high'"), case)


def test_the_command_line_tries_a_skill_with_them(tmp_path):
    (tmp_path / "people.py").write_text(TOLD)
    words = ["--role", "follower", "--partners-from", "people.py", "--partners", "2", "--workers", "1", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "comanip", "trial", *words], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    result = json.loads(done.stdout)["follower"]["default"]
    assert result["partners"] == 2
    assert 0.0 <= result["interval"][0] <= result["success"] <= result["interval"][1] <= 1.0
    assert {"effort", "peak_force_n", "residual_force_n", "behaviours", "failures", "role_right"} <= set(result)
    assert result["peak_force_n"] < 5.0  # a spring at rest
