"""A short run of `fuzz_settings`: an altered robot, task, mapping, skill or partner is used or refused in one line."""

from __future__ import annotations

import pytest

import fuzz_settings
from comanip.errors import ComanipError, ParameterError
from comanip.tasks import TASKS, read_task


@pytest.mark.parametrize("kind", fuzz_settings.KINDS)
def test_altered_settings_are_used_or_refused_in_one_line(kind):
    _, refused, wrong = fuzz_settings.fuzz(kind, 200, seed=1)
    assert wrong == []
    assert refused > 60


@pytest.mark.parametrize("kind", ["robot", "task", "mapping"])
@pytest.mark.parametrize(
    "content", [b"a = " + b"[" * 100_000, b"\xff\xfe", b"a" * 100_000, b"a = 1\na = 2", b"", b"[a]\nb.c = {d = 1}"]
)
def test_what_no_mutation_finds_is_refused_in_one_line_too(tmp_path, kind, content):
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    try:
        fuzz_settings.KINDS[kind][2](path)
    except ComanipError as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 1000
        assert "a.toml" in str(error)
    else:
        assert kind == "mapping", "an empty mapping maps nothing"
        assert content == b""


@pytest.mark.parametrize("old", ["duration_s = 2.2", "duration_s = [1.6, 4.0]", "shortest_s = 1.8", "size_sd_m = 0.025"])
def test_a_task_that_would_fill_the_memory_is_refused(tmp_path, old):
    text = TASKS["lift"].read_text()
    name, _, value = old.partition(" = ")
    changed = text.replace(old, f"{name} = {'[1.0, 1e9]' if '[' in value else '1e9'}")
    assert changed != text, f"{name} in the lift"
    (tmp_path / "a.toml").write_text(changed)
    with pytest.raises(ParameterError, match=r"allowed: >=? 0 and <= (3600|1e\+06)"):
        read_task(tmp_path / "a.toml")
