"""A row of a recording is laid in C, and is the row that numpy lays; what C does not take, numpy does."""

import gc
import weakref

import numpy as np
import pytest

from comanip import kernels
from comanip.recording import Recorder

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
LAYOUT = {"a": (2, "m", ("x", "z")), "b": (1, "", ("t",)), "c": (3, "N", ("x", "y", "z"))}


def recorders():
    compiled, plain = Recorder(LAYOUT), Recorder(LAYOUT)
    plain._compiled = None
    return compiled, plain


def same(compiled, plain):
    for name in LAYOUT:
        one, other = compiled.recording({})[name], plain.recording({})[name]
        np.testing.assert_array_equal(one.time, other.time)
        np.testing.assert_array_equal(one.values, other.values)


class Subclass(np.ndarray):
    pass


ODD = {
    "another array": lambda x: x.copy(),
    "two dimensions": lambda x: x[None],
    "strided": lambda x: np.repeat(x, 2)[::2],
    "float32": lambda x: x.astype(np.float32),
    "whole numbers": lambda x: x.astype(np.int64),
    "truth": lambda x: x > 0.0,
    "other byte order": lambda x: x.astype(">f8"),
    "a list": lambda x: x.tolist(),
    "a subclass": lambda x: x.view(Subclass),
    "read-only": lambda x: np.frombuffer(x.tobytes()),
}


@pytest.mark.parametrize("odd", ODD)
def test_whatever_comes_is_laid_as_numpy_lays_it(odd):
    rng, a, c = np.random.default_rng(0), np.empty(2), np.empty(3)
    compiled, plain = recorders()
    for k in range(2500):  # the block doubles twice
        a[:], c[:] = rng.normal(size=2), rng.normal(size=3)
        values = [a, float(rng.normal()), ODD[odd](c) if k % 3 else c]
        for recorder in (compiled, plain):
            recorder.add(0.01 * k, list(values))
        np.testing.assert_array_equal(compiled.row, plain.row)
    same(compiled, plain)


def test_a_usual_row_is_taken():
    """Else all tests here would be of numpy."""
    compiled, _ = recorders()
    values = [np.zeros(2), 1.0, np.zeros(3)]
    assert compiled._compiled.lay(compiled._rows, 0, 0.5, values)
    assert compiled._rows[0].tolist() == [0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    "values",
    [[np.zeros(2), 1.0], [np.zeros(2), 1.0, np.zeros(4)], [np.zeros(2), 1.0, np.zeros(2)], [np.zeros(9), 1.0, 2.0],
     [np.zeros(2), 1.0, np.zeros(3), 2.0]],
)  # fmt: skip
def test_a_row_of_another_width_is_refused_as_numpy_refuses_it(values):
    for recorder in recorders():
        with pytest.raises(ValueError, match="Output array"):
            recorder.add(0.0, values)
        assert recorder._count == 0


@pytest.mark.parametrize("values", [[np.zeros(2), 1.0, np.zeros(4)], [np.zeros(3), np.zeros(3), 1.0]])
def test_nothing_is_written_behind_a_row(values):
    compiled, _ = recorders()
    compiled._rows[:] = 7.0
    assert not compiled._compiled.lay(compiled._rows, 0, 0.0, values)
    assert (compiled._rows[1:] == 7.0).all()


def test_no_row_outside_the_block():
    compiled, _ = recorders()
    values = [np.zeros(2), 1.0, np.zeros(3)]
    for which in (-1, len(compiled._rows)):
        assert not compiled._compiled.lay(compiled._rows, which, 0.0, values)
    frozen = compiled._rows.copy()
    frozen.setflags(write=False)
    assert not compiled._compiled.lay(frozen, 0, 0.0, values)


def test_arrays_are_let_go_with_the_recorder():
    compiled, _ = recorders()
    array = np.zeros(2)
    gone = weakref.ref(array)
    compiled.add(0.0, [array, 1.0, np.zeros(3)])
    del array
    assert gone() is not None
    del compiled
    gc.collect()
    assert gone() is None
