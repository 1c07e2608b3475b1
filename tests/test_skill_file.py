"""Skill files: exact, strict, whole or not at all."""

from __future__ import annotations

import json

import numpy as np
import pytest

from comanip import whole_file as sealed
from comanip.errors import SkillFileError
from comanip.learned import file as skill_file


def test_a_skill_comes_back_bit_for_bit(skills, tmp_path):
    for role, learned in skills.items():
        skill_file.save(learned, tmp_path / "skill.json")
        again = skill_file.load(tmp_path / "skill.json")
        for part in ("initial", "transition", "means", "covariances"):
            assert getattr(again.model, part).tobytes() == getattr(learned.model, part).tobytes()
        assert again.clock.means.tobytes() == learned.clock.means.tobytes()
        assert (again.role, again.axes, again.dt, again.law) == (role, ("z",), learned.dt, "default")
        assert again.notes == learned.notes
        assert [f.name for f in tmp_path.iterdir()] == ["skill.json"]


def damaged(content, **changes):
    return json.dumps({**content, **changes})


def test_every_kind_of_damage_is_refused_with_the_file_and_a_reason(skills, tmp_path):
    content = skill_file.to_json(skills["leader"])
    text, path = json.dumps(content), tmp_path / "skill.json"
    nan = {**content["model"], "initial": [float("nan")] * 10}
    broken = {
        "not a skill file": ["", "{", "[1, 2]", "\x80\x04pickle", "<html>", "{}", '{"format": "other"}', "[" * 100_000],
        "version": [damaged(content, version=0), damaged(content, version="x"), damaged(content, version=True)],
        "update comanip": [damaged(content, version=7)],
        "unknown fields": [damaged(content, extra=1)],
        "missing fields": [json.dumps({k: v for k, v in content.items() if k != "clock"})],
        "sha256": [damaged(content, role="follower"), damaged(content, model=nan), text.replace('"dt_s": 0.01', '"dt_s": 0.02')],
        "appears twice": [text[:-1] + ', "role": "leader"}'],
    }
    for reason, variants in broken.items():
        for variant in variants:
            path.write_text(variant, encoding="utf-8")
            with pytest.raises(SkillFileError, match=reason) as error:
                skill_file.load(path)
            assert str(error.value).startswith(str(path))


def test_no_truncation_and_no_flipped_digit_goes_unnoticed(skills, tmp_path):
    path = tmp_path / "skill.json"
    skill_file.save(skills["leader"], path)
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        path.write_bytes(good[: int(rng.integers(0, len(good) - 2))])
        with pytest.raises(SkillFileError):
            skill_file.load(path)
    digits = [i for i, b in enumerate(good) if chr(b).isdigit()]
    for i in rng.choice(digits, 60):
        flipped = bytearray(good)
        flipped[i] = ord("0") + (flipped[i] - ord("0") + int(rng.integers(1, 10))) % 10
        path.write_bytes(bytes(flipped))
        try:
            skill_file.load(path)
        except SkillFileError:
            continue
        assert json.loads(flipped) == json.loads(good)  # a digit beyond float64's last place is no change


def test_a_model_that_is_no_model_is_refused_even_with_a_right_hash(skills, tmp_path):
    content = skill_file.to_json(skills["leader"])
    content["model"] = {**content["model"], "transition": (np.array(content["model"]["transition"]) * 2).tolist()}
    content["sha256"] = skill_file.digest(content)
    (tmp_path / "skill.json").write_text(json.dumps(content))
    with pytest.raises(SkillFileError, match="transition must sum to 1"):
        skill_file.load(tmp_path / "skill.json")


def test_a_failed_write_leaves_the_old_file(skills, tmp_path, monkeypatch):
    path = tmp_path / "skill.json"
    skill_file.save(skills["leader"], path)
    before = path.read_bytes()
    monkeypatch.setattr(sealed.os, "fsync", lambda fd: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        skill_file.save(skills["follower"], path)
    assert path.read_bytes() == before
    assert [f.name for f in tmp_path.iterdir()] == ["skill.json"]
