"""What an error or a note shows is text, whatever a file calls its columns."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from comanip.errors import ParameterError, RecordingError, check_generator, given, plain
from comanip.formats import Columns, read
from comanip.lessons.demonstration import demonstrations

ODD = {
    "a\nb": "a b",
    "a\r\nb": "a  b",
    "\x1b[31mred\x1b[0m": "\\x1b[31mred\\x1b[0m",
    "\x1b]0;title\x07": "\\x1b]0;title\\x07",
    "abc\u202edef": "abc\\u202edef",
    "\u2066x\u2069": "\\u2066x\\u2069",
    "nul\0": "nul\\x00",
    "c1\x9b": "c1\\x9b",
    "lone \ud800": "lone \\ud800",
    "mark\ufeff": "mark\\ufeff",
    "持ち上げ ü é": "持ち上げ ü é",
    "narrow\u202fblank": "narrow blank",
    "[red]x[/red] <b>": "[red]x[/red] <b>",
}


@pytest.mark.parametrize("text", ODD)
def test_text_is_one_line_without_anything_that_steers(text):
    assert plain(text) == ODD[text]
    assert plain(plain(text)) == plain(text)
    assert str(RecordingError(text)) == ODD[text]


def test_long_text_is_cut_and_says_so():
    assert plain("x" * 10_000, 100) == "x" * 100 + "... (9900 more characters)"
    assert len(given(list(range(10_000)))) < 150


def test_errors_pickle_as_they_are():
    error = pickle.loads(pickle.dumps(RecordingError("a\nb")))
    assert (type(error), str(error)) == (RecordingError, "a b")


def test_the_names_of_a_files_columns_reach_no_terminal(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,z,\x1b[2Jclear\u202e\n0,1,2\n0.1,1,2\n".replace("\x1b", "\u009b"))
    with pytest.raises(RecordingError) as error:
        demonstrations(read(path, Columns(position="z")))
    assert "\u009b" not in str(error.value)
    with pytest.raises(Exception, match="clear") as error:
        read(path, Columns(position="w"))
    assert not set("\u009b\u202e") & set(str(error.value))


def test_a_seed_is_no_generator():
    check_generator(np.random.default_rng(0))
    with pytest.raises(ParameterError, match=r"rng is 1 \(int\); allowed: a numpy Generator, .*default_rng\(1\)"):
        check_generator(1)
