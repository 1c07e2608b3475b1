"""comanip study: what persons did and said, to paired differences; and files that are no study."""

from __future__ import annotations

import json
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ParameterError, RecordingError
from comanip.formats import read
from comanip.learned import file as skill_file
from comanip.page.conditions import read_plan
from comanip.page.numbers import encoded, numbers, robot
from comanip.page.study import ENOUGH, analysis, difference, read_person, recordings
from comanip.tasks import named
from page.node import ran
from pictures import is_drawn

CONDITIONS = ("default", "mass-damper", "damping")
EFFORT = {"default": 4.0, "mass-damper": 15.0, "damping": 60.0}


def written(
    folder: Path, name: str, rng: np.random.Generator, *, spread: float = 0.2, trials: int = 4, complete: bool = True
) -> Path:
    lines: list[dict] = [{
        "type": "study", "version": 1, "participant": name, "seed": 3, "order": list(CONDITIONS), "conditions": list(CONDITIONS), "trials": trials,
        "task": "lift", "axes": ["z"], "load_mass_kg": 2.0, "load_share": 0.5, "gravity_m_per_s2": [-9.80665], "made_by": "test",
    }]  # fmt: skip
    hand = float(np.exp(spread * rng.normal()))
    for block, condition in enumerate(CONDITIONS):
        for trial in range(trials):
            effort = EFFORT[condition] * hand * float(np.exp(spread * rng.normal()))
            verdict = {
                "success": condition != "damping",
                "effort_n2s": effort,
                "peak_n": effort**0.5,
                "duration_s": 2.0 + block,
                "end_error_m": None,
            }
            channels = {"position": [[0.85], [0.86]], "force": [[0.0], [1.0]], "sensor_force": [[-9.8], [-9.0]]}
            lines.append(
                {
                    "type": "trial",
                    "block": block + 1,
                    "condition": condition,
                    "trial": trial + 1,
                    "seed": trial,
                    "dt_s": 0.01,
                    "verdict": verdict,
                    "channels": channels,
                }
            )
        lines.append(
            {"type": "answers", "block": block + 1, "condition": condition, "ease": 7 - 2 * block, "predictability": 6 - block}
        )
    lines.append({"type": "preference", "block": 1, "condition": "default", "comment": "<b>x</b>"})
    if complete:
        lines.append({"type": "end", "reason": "complete"})
    file = folder / f"{name}.jsonl"
    file.write_text("\n".join(map(json.dumps, lines)) + "\n")
    return file


def test_the_known_order_of_three_laws_is_found_from_one_person_and_from_many(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for count, pairs in ((1, 4), (ENOUGH - 1, 4 * (ENOUGH - 1)), (8, 8)):
        found = analysis([read_person(written(tmp_path, f"p{count}-{n}", rng)) for n in range(count)])
        effort = found["differences"]["effort"]
        assert [d.pairs for d in effort.values()] == [pairs] * 3
        assert all(d.told and d.mean < 0.0 for d in effort.values()), effort
        assert found["differences"]["success"]["default - damping"].mean == pytest.approx(1.0)
        assert found["prefer"] == {"default": count, "mass-damper": 0, "damping": 0}
        assert found["means"]["default"]["effort"] < found["means"]["mass-damper"]["effort"] < found["means"]["damping"]["effort"]


def test_the_interval_of_a_difference_holds_its_true_value_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    held = [d.low < 0.5 < d.high for d in (difference((0.5 + rng.normal(size=6)).tolist()) for _ in range(2000))]
    assert 0.935 < np.mean(held) < 0.965
    assert difference([1.0]).high == np.inf
    assert difference([]).pairs == 0


def test_a_person_who_stopped_counts_as_far_as_trials_are_pairs(tmp_path: Path) -> None:
    file = written(tmp_path, "p", np.random.default_rng(3))
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:8], '{"type":"end","reason":"broken off"}']))
    person = read_person(file)
    assert not person.complete
    found = analysis([person])
    assert found["differences"]["effort"]["default - mass-damper"].pairs == 2
    assert found["differences"]["effort"]["default - damping"].pairs == 0


@pytest.mark.parametrize(
    ("line", "text", "says"),
    [
        (0, "{", "line 1: not JSON"),
        (0, '{"type":"trial"}', "no record of type study"),
        (0, '{"type":"study","version":2}', "version 2"),
        (0, '{"type":"study","version":1,"conditions":"x"}', "conditions is a list"),
        (1, "[1]", "line 2: a record is an object"),
        (1, '{"type":"<script>"}', "unknown type"),
        (1, '{"type":"trial","condition":"other","trial":1}', "condition 'other' is unknown"),
        (1, '{"type":"trial","condition":"default","trial":"1"}', "trial is a whole number"),
        (1, '{"type":"trial","condition":"default","trial":true}', "trial is a whole number"),
        (1, '{"type":"trial","condition":"default","trial":2}', "stands there twice"),
        (1, '{"type":"trial","condition":"default","trial":1,"dt_s":-1}', "dt_s is from"),
        (1, '{"type":"trial","condition":"default","trial":1,"verdict":{"success":[]}}', "success is true or false"),
        (
            1,
            '{"type":"trial","condition":"default","trial":1,"verdict":{"success":true,"effort_n2s":1e400}}',
            "is a number or null",
        ),
        (1, '{"type":"trial","condition":"default","trial":1,"channels":"x"}', "channels is an object"),
        (1, '{"type":"trial","condition":"default","trial":1,"channels":{"position":[[1],[2,3]]}}', "rows of 1 numbers"),
        (1, '{"type":"trial","condition":"default","trial":1,"channels":{"a\\n":[1]}}', "rows of 1 numbers"),
        (0, '{"type":"study","version":1,"conditions":["a","a"]}', "each once"),
        (0, '{"type":"study","version":1,"conditions":["a"],"axes":3}', "axes is a list"),
        (5, '{"type":"answers","condition":"default","ease":true,"predictability":1}', "ease is from 1 to 7"),
        (1, '{"type":"trial","condition":"default","trial":1,"verdict":3}', "verdict is an object"),
        (5, '{"type":"answers","condition":"default","ease":9,"predictability":1}', "ease is from 1 to 7"),
    ],
)
def test_what_is_no_study_is_refused_with_file_and_line(line: int, text: str, says: str, tmp_path: Path) -> None:
    file = written(tmp_path, "p", np.random.default_rng(4))
    lines = file.read_text().splitlines()
    lines[line] = text
    file.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match=says) as said:
        read_person(file)
    assert str(file) in str(said.value)
    assert "\n" not in str(said.value)


def test_names_of_somebody_elses_file_stay_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from comanip.commands.app import app

    nasty = "[red]x[/red] <img src=x onerror=alert(1)> $\\alpha$ \x1b[31m ../../etc"
    file = written(tmp_path, "p", np.random.default_rng(7))
    file.write_text(file.read_text().replace('"default"', json.dumps(nasty)))
    out = tmp_path / "trials"
    app(["study", str(file), "-o", str(out), "--plot", str(tmp_path / "study.png")], result_action="return_value")
    told = capsys.readouterr().out
    assert "[red]x" in told.replace("\n", "")
    assert "\x1b[31m" not in told
    assert {one.parent for one in tmp_path.rglob("*.mcap")} == {out}
    assert is_drawn(tmp_path / "study.png")


def test_studies_of_other_conditions_are_not_thrown_together(tmp_path: Path) -> None:
    one, other = (written(tmp_path, name, np.random.default_rng(5)) for name in "ab")
    other.write_text(other.read_text().replace("damping", "rigid"))
    with pytest.raises(RecordingError, match="analyse them apart"):
        analysis([read_person(one), read_person(other)])


def test_every_trial_is_a_recording_that_can_be_kept(tmp_path: Path) -> None:
    from comanip.commands.app import app

    file = written(tmp_path, "p", np.random.default_rng(6))
    app(["study", str(file), "-o", str(tmp_path / "trials"), "--plot", str(tmp_path / "study.png")], result_action="return_value")
    kept = sorted((tmp_path / "trials").glob("*.mcap"))
    assert len(kept) == 12
    (one,) = read(kept[0])
    assert one.metadata["load_mass_kg"] == 2.0
    assert one["hand.position"].values.tolist() == [[0.85], [0.86]]
    assert is_drawn(tmp_path / "study.png")
    assert len(list(recordings(read_person(file)))) == 12


def test_orders_of_numbers_that_follow_each_other_are_balanced_and_run_through_all_of_them(tmp_path: Path) -> None:
    script = "answer([3, 4].map(count => Array.from({ length: 48 }, (_, seed) => orderOf(seed, count))));"
    for orders, count in zip(ran(tmp_path, script, modules={"study": "orderOf"}), (3, 4), strict=True):
        all_orders = set(permutations(range(count)))
        assert {tuple(order) for order in orders[: len(all_orders)]} == all_orders
        assert orders[: 48 - len(all_orders)] == orders[len(all_orders) :]
        for n in range(0, 48, count):
            places = np.array(orders[n : n + count])
            assert all(sorted(places[:, k]) == list(range(count)) for k in range(count)), places


def test_the_command_line_makes_a_page_and_says_what_it_cannot(
    skills, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from comanip.commands.app import app
    from comanip.errors import MismatchError

    files = [tmp_path / f"{role}.json" for role in skills]
    for role, file in zip(skills, files, strict=True):
        skill_file.save(skills[role], file)
    out = str(tmp_path / "lift.html")
    app(["export", *map(str, files), "--to", "page", "-o", out], result_action="return_value")
    assert 'name="generator" content="comanip"' in (tmp_path / "lift.html").read_text()[:2000]
    assert "lift.html" in capsys.readouterr().out
    for more, says in (
        (["--role", "leader"], "--role is not for --to page"),
        (["--task", "turn"], "turns"),
        (["--task", "slide"], "axes"),
        (["-o", str(tmp_path / "lift.json")], "ends in .html"),
    ):
        where = [] if "-o" in more else ["-o", out]
        with pytest.raises((ParameterError, MismatchError), match=says):
            app(["export", *map(str, files), "--to", "page", *where, *more], result_action="return_value")
    for flag, value in (("--task", "lift"), ("--study", "study.toml")):
        with pytest.raises(ParameterError, match=f"{flag} is for --to page"):
            app(["export", str(files[0]), "--to", "c", flag, value, "-o", str(tmp_path / "x.c")], result_action="return_value")


PLAN = """trials = 2
practice = 0
role = "follower"
[[conditions]]
name = "<b>ours"
skill = "follower.json"
law = "even"
[[conditions]]
name = "led"
role = "leader"
skill = "leader.json"
[[conditions]]
name = "told nothing"
role = "auto"
skill = ["leader.json", "follower.json"]
[[conditions]]
name = "damper"
damping_ns_per_m = 40
mass_kg = 0
"""


@pytest.fixture(scope="module")
def plans(skills, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a leader and a follower, for studies to compare."""
    folder = tmp_path_factory.mktemp("plans")
    for role in ("leader", "follower"):
        skill_file.save(skills[role], folder / f"{role}.json")
    return folder


def test_a_study_compares_what_its_file_names_each_told_its_own_role(skills, plans: Path) -> None:
    (plans / "study.toml").write_text(PLAN)
    task = named("lift")
    plan = read_plan(plans / "study.toml", task, dt=0.01)
    assert (plan["trials"], plan["practice"], plan["role"]) == (2, 0, "follower")
    ours, led, auto, damper = plan["conditions"]
    assert [one["name"] for one in plan["conditions"]] == ["<b>ours", "led", "told nothing", "damper"]
    assert [one["role"] for one in plan["conditions"]] == ["follower", "leader", "auto", "follower"]
    for one, role, law in ((ours, "follower", "even"), (led, "leader", None), (auto, "auto", None)):
        assert one["robot"]["numbers"] == encoded(numbers(robot(skills, role, dt=0.01, law=law), task))
    assert ours["robot"]["numbers"] != encoded(numbers(robot(skills, "follower", dt=0.01), task))
    assert led["ends"] == (skills["leader"].ends - task.start).tolist()
    assert len(auto["sha256"]) == 2
    assert damper["robot"] == {"kind": "mass-damper", "kg": 0.0, "ns_per_m": 40.0}


@pytest.mark.parametrize(
    ("text", "other", "says"),
    [
        ("trials = 2", "trials = true", "trials: is True; allowed: whole numbers from 1"),
        ("trials = 2", "trials = 0", "trials: is 0"),
        ("trials = 2", "trails = 2", "trails: unknown key; there are: trials"),
        ('role = "follower"\n[', 'role = "both"\n[', "role: is 'both'; allowed: leader, follower, auto"),
        ('"<b>ours"', '" "', r"conditions\[1\].name: must be a text"),
        ('"led"', '"damper"', r"conditions\[4\].name: 'damper' stands there twice"),
        ('"follower.json"\nlaw', '"none.json"\nlaw', r"conditions\[1\].skill: .*none.json: cannot be read"),
        ('"follower.json"\nlaw', '"leader.json"\nlaw', r"conditions\[1\].skill: role is 'follower': give follower; got 'leader'"),
        ('["leader.json", "follower.json"]', '"leader.json"', r"conditions\[3\].skill: role is 'auto': give follower and leader"),
        ('["leader.json", "follower.json"]', "[1]", r"conditions\[3\].skill: must be a file"),
        ('law = "even"', 'law = "evn"', r"conditions\[1\]: law 'evn' is unknown"),
        ('law = "even"', 'law = "paper"', r"conditions\[1\]: the page runs the default law alone"),
        ('law = "even"', "mass_kg = 2", r"conditions\[1\].mass_kg: a robot with a skill has none"),
        ("mass_kg = 0", "mass_kg = -1", r"conditions\[4\].mass_kg: is -1; allowed: a number from 0"),
        ("mass_kg = 0", "mass_kg = nan", r"conditions\[4\].mass_kg: is nan"),
        ("damping_ns_per_m = 40", "damping_ns_per_m = 0", r"conditions\[4\]: mass_kg and damping_ns_per_m are both 0"),
        ("mass_kg = 0", 'mass_kg = 0\nrole = "leader"', r"conditions\[4\].role: is 'leader', and a robot without a skill"),
        (PLAN, "trials = 2", "conditions: a study compares 2 to 6"),
        (PLAN, "[[", "not TOML"),
    ],
)
def test_a_study_that_cannot_be_is_one_line_with_file_and_key(text: str, other: str, says: str, plans: Path) -> None:
    assert text in PLAN
    (plans / "wrong.toml").write_text(PLAN.replace(text, other, 1))
    with pytest.raises(ParameterError, match=says) as said:
        read_plan(plans / "wrong.toml", named("lift"), dt=0.01)
    assert str(plans / "wrong.toml") in str(said.value)
    assert "\n" not in str(said.value)
