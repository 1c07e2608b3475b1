"""Names and notes out of files are text, in every place where they are shown; and messages speak of flags on the command line."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import comanip
from comanip.commands.flag_words import NAMED, OTHERWISE, in_flags
from comanip.commands.flags import DataFlags, LearnFlags
from comanip.evaluation.shown import for_drawing, for_html, plain_text
from forked import run

ROOT = Path(comanip.__file__).parent
UGLY = "[/red]a\x1b[31m<b>$x^$\u202egpj"


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("[/red]", "[/red]"),
        ("a\x1b[31m\x07", "a\\x1b[31m\\x07"),
        ("\u202egpj.exe\u2066", "\\u202egpj.exe\\u2066"),
        ("two\nlines\tand\u2028three", "two lines and\\u2028three"),
        ("\udcff", "\\udcff"),
        ("größe 日本 می‌خواهم", "größe 日本 می‌خواهم"),
    ],
)
def test_what_cannot_be_seen_stands_as_its_code(given, shown):
    assert plain_text(given) == shown


def test_html_and_formulas_are_text():
    assert for_html('<a b="c">') == "&lt;a b=&quot;c&quot;&gt;"
    assert for_drawing("_a $x$") == r" _a \$x\$"


@pytest.fixture(scope="module")
def ugly(tmp_path_factory, lessons):
    """A recording whose name holds all of it, and a skill learned from such."""
    folder = tmp_path_factory.mktemp("ugly")
    try:
        for n, lesson in enumerate(lessons["follower"][:3]):
            rows = np.column_stack([np.arange(len(lesson)) * lesson.dt, lesson.position, lesson.velocity, lesson.force])
            np.savetxt(folder / f"{UGLY}{n}.csv".replace("/", "∕"), rows, delimiter=",", header="t,z,vz,Fz", comments="")
    except OSError:
        pytest.skip("this file system has no such names")
    return folder


def hidden(text: str) -> list[str]:
    return [c for c in text if c in "\x1b\u202e\x07"]


@pytest.mark.parametrize(
    "words",
    [
        ("learn", "{}", "--role", "follower", "-o", "s.json"),
        ("inspect", "{}"),
        ("evaluate", "--leave-one-out", "{}"),
        ("convert", "{0}", "x.csv"),
        ("learn", "absent\x1b[31m.csv"),
        ("learn", "{}", "--role", "[/red]\x1b"),
        ("inspect", "{}", "--plot", "x.png"),
    ],
)
def test_terminal_shows_names_as_text(ugly, tmp_path, words):
    files = sorted(ugly.glob("*.csv"))
    given = [f for w in words for f in (files if w == "{}" else files[:1] if w == "{0}" else [w])]
    done = run(*given, cwd=tmp_path)
    assert hidden(done.stdout + done.stderr) == []
    assert "Traceback" not in done.stderr
    if words[0] in ("inspect", "evaluate"):
        assert "[∕red]a" in done.stdout.replace("\n", "")


def test_pictures_show_names_as_text(skills, tmp_path):
    from comanip.evaluation import drawing

    drawing.save(drawing.skills({UGLY: skills["leader"], "_b $": skills["follower"]}), tmp_path / "skills.svg")
    with drawing.taste():
        figure = drawing.blank(4.0, 2.0, title=UGLY * 6, caption=UGLY)
    text = drawing.to_svg(figure)
    assert hidden(text) == []
    title = figure.texts[0]
    assert title.get_window_extent().x1 <= figure.bbox.x1  # a long title is wrapped, not cut


def test_report_shows_names_as_text():
    from comanip.web import report

    trial = {"success": 0.5, "interval": (0.1, 0.9), "effort": 1.0, "peak_force_n": 2.0, "failures": {UGLY: 1}, "partners": 2}
    row = report._trial_row(UGLY, "<law>", trial)
    assert "<b>" not in row
    assert "&lt;law&gt;" in row
    assert hidden(row) == []
    assert "</script" not in report._script({"a": "</script><b>"})


def flags() -> set[str]:
    """All flags of all commands."""
    from comanip.commands import app, on_the_page

    shared = {name for one in (DataFlags, LearnFlags) for name in one.__dataclass_fields__}
    commands = [
        f for one in (app, on_the_page) for f in vars(one).values() if inspect.isfunction(f) and f.__module__ == one.__name__
    ]
    own = {name for command in commands for name in inspect.signature(command).parameters}
    return {"--" + name.replace("_", "-") for name in shared | own}


def messages() -> list[tuple[str, str]]:
    """(where, text) of everything that may reach a user: in raise, warn, suspect, notes; what is filled in stands as {}."""
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            call = node.exc if isinstance(node, ast.Raise) else node if isinstance(node, ast.Call) else None
            if not isinstance(call, ast.Call):
                continue
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            if not (isinstance(node, ast.Raise) or name in ("suspect", "warn", "say", "append")):
                continue
            for argument in call.args:
                inside = {id(v) for one in ast.walk(argument) if isinstance(one, ast.JoinedStr) for v in one.values}
                for part in ast.walk(argument):
                    if isinstance(part, ast.JoinedStr):
                        text = "".join(v.value if isinstance(v, ast.Constant) else "{}" for v in part.values)
                        found.append((f"{path.relative_to(ROOT)}:{node.lineno}", text))
                    elif (
                        id(part) not in inside
                        and isinstance(part, ast.Constant)
                        and isinstance(part.value, str)
                        and " " in part.value
                    ):
                        found.append((f"{path.relative_to(ROOT)}:{node.lineno}", part.value))
    return found


# rooms whose messages a command can pass on; peers are for Python alone
AT_THE_TERMINAL = (
    "formats/", "lessons/", "fitting/", "learned/", "models/", "skills/", "safety/", "plants/", "devices/", "people/", "tasks/",
    "trials/", "evaluation/", "web/", "commands/", "interaction", "teaching", "reproduction", "loop", "parallel",
)  # fmt: skip
ONLY_IN_PYTHON = (  # no command can be the reason of these
    "Columns(position=",  # a wrong type in place of Columns
    "rng=numpy.random.default_rng(seed)",  # commands always pass one
    "weights={} does not fit",  # of a regression
    "pass robot=...",  # of a film of a recording
    "_unit={}",  # {} is position, velocity or force
)
ARGUMENTS = sorted({f for one in (DataFlags, LearnFlags) for f in one.__dataclass_fields__ if "_" in f} | set(OTHERWISE))


def test_every_message_of_the_library_speaks_of_flags_at_the_terminal():
    texts = [
        (where, text)
        for where, text in messages()
        if where.startswith(AT_THE_TERMINAL) and not any(words in text for words in ONLY_IN_PYTHON)
    ]
    assert len(texts) > 400
    left = []
    for where, text in texts:
        told = in_flags(text)
        for name in ARGUMENTS:
            if re.search(rf"(?<![\w.\-/]){name}(?![\w.])", told) and f"metadata {name}" not in told:
                left.append((where, told))
        left += [(where, told) for word in re.findall(r"(?<![\w\-])([a-z_]+)=(?!=)", told.replace("--frame sensor=", ""))]
        left += [(where, word) for word in re.findall(r"--[a-z][a-z\-]+", told) if word not in flags()]
    assert left == []


def test_every_flag_that_a_message_is_turned_into_exists():
    for name in (*NAMED, *OTHERWISE):
        told = in_flags(f"state {name}")
        assert told.removeprefix("state ") in flags(), told


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("allowed: finite numbers; drop such frames with drop_bad", "allowed: finite numbers; --drop-bad drops such frames"),
        (
            "state its noise with allow_constant=<standard deviation>",
            "state its noise with --allow-constant (a standard deviation)",
        ),
        ("state units, for example position_unit='m'", "state units, for example --position-unit m"),
        ("state position_unit, or widen the range (plausible=...)", "state --position-unit, or take it as it is with --any-size"),
        ('ignore the stamps with time="none" and state rate_hz', "ignore the stamps with --time none and state --rate-hz"),
        ("say which, for example position=z velocity=vz", "say which, for example --position z --velocity vz"),
        ("name it (time=...) or state the rate", "name it (--time ...) or state the rate"),
        ("say which with time=", "say which with --time"),
        ("state it: frames={'ft': ...} (--frame ft=...), one of same", "state it: --frame ft=..., one of same"),
        ("a/time=none.csv: no position", "a/time=none.csv: no position"),
        ("out/drop_bad.csv: no such file", "out/drop_bad.csv: no such file"),
        ("hand.sensor_force is raw", "hand.sensor_force is raw"),
    ],
)
def test_arguments_become_flags_and_names_of_files_and_channels_do_not(said, told):
    assert in_flags(said) == told


def test_the_flag_that_a_message_recommends_helps(tmp_path):
    """A dead channel: refused with --allow-constant, learned with it."""
    for n in range(3):
        t = np.arange(0.0, 3.0, 0.01)
        z = 0.3 * (t / 3.0) ** 2 * (3.0 - 2.0 * t / 3.0) + 0.01 * n
        rows = np.column_stack([t, z, np.gradient(z, t), np.full(len(t), 1.0)])
        np.savetxt(tmp_path / f"a{n}.csv", rows, delimiter=",", header="t,z,vz,Fz", comments="")
    files = sorted(tmp_path.glob("a*.csv"))
    refused = run("learn", *files, "--role", "follower", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--allow-constant" in refused.stderr
    assert run("learn", *files, "--role", "follower", "--allow-constant", 0.1, cwd=tmp_path).returncode == 0
