"""The board: a score is that of the worst task and role, and files that cannot both be true are refused."""

from __future__ import annotations

import copy
import json

import pytest

from comanip.errors import ParameterError
from comanip.trials import success_interval
from comanip.trials.board import LEAST_PARTNERS, entries, gathered

NUMBERS = {"effort": 2.0, "time_s": 1.5, "peak_force_n": 4.0}


def of(good, n=LEAST_PARTNERS, safe=(3, 20)):
    by = {"steady": {"partners": n, "successes": good}, "blocks": {"partners": safe[1], "successes": safe[0]}}
    return {**NUMBERS, "behaviours": by}


def result(**by_role):
    about = {
        "format": 1, "comanip": "1", "numpy": "2", "python": "3", "plant": "beam", "tasks": ["lift"], "by_task": False,
        "cases_sha256": "abc", "policies_sha256": {}, "skills_sha256": {},
    }  # fmt: skip
    return {**by_role, "about": about}


def written(folder, **results):
    for name, content in results.items():
        (folder / f"{name}.json").write_text(content if isinstance(content, str) else json.dumps(content))
    return folder


def test_a_score_is_that_of_the_worst_role_and_task(tmp_path):
    laws = {"ours": (95, 90), "leads alone": (100, 0), "follows alone": (0, 100), "nothing": (0, 0)}
    leader, follower = ({law: of(good[n]) for law, good in laws.items()} for n in range(2))
    other = result(slide={"leader": {"ours": of(70)}, "follower": {"ours": of(99)}})
    other["about"] |= {"by_task": True, "tasks": ["slide"]}
    ranked = {one.law: one for one in entries(gathered(written(tmp_path, a=result(leader=leader, follower=follower), b=other)))}
    assert next(iter(ranked)) == "ours"
    assert {law: one.worst.score for law, one in ranked.items()} == {
        "ours": 0.7,
        "leads alone": 0,
        "follows alone": 0,
        "nothing": 0,
    }
    assert (ranked["ours"].worst.task, ranked["ours"].worst.role) == ("slide", "leader")
    assert ranked["ours"].worst.interval == success_interval(70, LEAST_PARTNERS)
    assert ranked["ours"].safe == (12, 80)
    assert not any(one.lacks for one in ranked.values())


def test_what_was_tried_too_little_is_listed_and_not_ranked(tmp_path):
    few = result(leader={"few": of(9, 9), "lone": of(100)}, follower={"few": of(100)})
    lacks = {one.law: one.lacks for one in entries(gathered(written(tmp_path, a=few)))}
    assert lacks == {"few": "9 partners who behave < 100", "lone": "not tried as follower"}


def test_kinds_of_people_count_by_what_they_do(tmp_path):
    kinds = {
        "usual": {"success": 0.5, "partners": 10}, "plain": {"success": 1.0, "partners": 10},
        "releases slowly": {"success": 0.2, "partners": 10},
    }  # fmt: skip
    (row,) = gathered(written(tmp_path, a=result(leader={"law": {**NUMBERS, "kinds": kinds}})))
    assert (row.steady, row.safe) == ((15, 20), (2, 10))


def test_two_files_that_cannot_both_be_true_are_refused(tmp_path):
    one = result(leader={"law": of(90)})
    same, other, newer = copy.deepcopy(one), result(leader={"law": of(91)}), result(leader={"law": of(92)})
    newer["about"]["comanip"] = "2"
    assert len(gathered(written(tmp_path, a=one, b=same, d=newer))) == 2
    with pytest.raises(ParameterError, match=r"c\.json: law as leader on lift differs from .*a\.json, with the same partners"):
        gathered(written(tmp_path, c=other))


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"about": {}}', '{"about": {"format": 1}, "leader": 3}', '{"about": 3}'])
def test_what_is_no_result_is_named(tmp_path, content):
    with pytest.raises(ParameterError, match=r"odd\.json: no result of `comanip trial --json`"):
        gathered(written(tmp_path, odd=content))


def test_a_newer_format_and_an_empty_folder_are_said(tmp_path):
    with pytest.raises(ParameterError, match=r"holds no \.json; make one"):
        gathered(tmp_path)
    newer = result(leader={})
    newer["about"]["format"] = 9
    with pytest.raises(ParameterError, match="result of format 9; this comanip reads up to 1"):
        gathered(written(tmp_path, a=newer))
