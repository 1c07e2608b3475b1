"""exp and log within one unit in the last place, the same in Python and in C."""

from __future__ import annotations

import ctypes
import math
import subprocess
from decimal import Decimal, localcontext
from importlib.resources import files

import numpy as np
import pytest

from comanip.export.loaded import STRICT, compiler
from comanip.signals.exponential import exponential, logarithm
from toys import same

GLUE = """
#include <math.h>
%s
void both(const double *x, double *e, double *l, int n);
void both(const double *x, double *e, double *l, int n) {
    for (int i = 0; i < n; i++) e[i] = exponential(x[i]), l[i] = logarithm(x[i]);
}
"""
EDGES = [0.0, -0.0, 1.0, -1.0, 5e-324, 2.2250738585072014e-308, 1e308, 709.78, 709.79, 710.0, -708.4, -745.1, -745.2, -800.0,
         math.inf, -math.inf, math.nan, 0.5 * math.log(2.0), math.sqrt(0.5)]  # fmt: skip


def numbers(n):
    rng = np.random.default_rng(4)
    bits = rng.integers(0, 2**63, n, dtype=np.uint64).view(float)
    return np.concatenate([EDGES, rng.uniform(-745.0, 709.7, n), rng.uniform(-20.0, 0.0, n), rng.uniform(0.5, 2.0, n), bits])


@pytest.mark.parametrize(("ours", "right"), [(exponential, Decimal.exp), (logarithm, Decimal.ln)])
def test_within_one_unit_in_the_last_place(ours, right):
    with localcontext() as context:
        context.prec = 40
        for x in numbers(150):
            if not (-700.0 < x < 709.0 if ours is exponential else 0.0 < x < math.inf):
                continue
            true = right(Decimal(float(x)))
            assert abs(Decimal(ours(float(x))) - true) <= Decimal(math.ulp(float(true))), x


def test_beyond_float64_as_the_standard_library():
    assert [exponential(x) for x in (-math.inf, -746.0, 710.0, math.inf, 0.0)] == [0.0, 0.0, math.inf, math.inf, 1.0]
    assert [logarithm(x) for x in (0.0, -0.0, math.inf, 1.0)] == [-math.inf, -math.inf, math.inf, 0.0]
    assert all(map(math.isnan, (exponential(math.nan), logarithm(math.nan), logarithm(-1.0))))
    assert exponential(-744.0) == pytest.approx(math.exp(-744.0), abs=5e-324)


@pytest.mark.skipif(compiler() is None, reason="no C compiler (cc, gcc or clang) on this machine")
def test_the_same_bits_in_c(tmp_path):
    text = files("comanip.kernels").joinpath("_exponential.h").read_text(encoding="utf-8")
    (tmp_path / "both.c").write_text(GLUE % text)
    subprocess.run([compiler(), *STRICT, "-O2", "-fPIC", "-shared", "both.c", "-o", "both.so", "-lm"], cwd=tmp_path, check=True)
    x = numbers(2000)
    found = np.zeros((2, len(x)))
    double = ctypes.POINTER(ctypes.c_double)
    ctypes.CDLL(str(tmp_path / "both.so")).both(*[a.ctypes.data_as(double) for a in (x, *found)], len(x))
    with np.errstate(all="ignore"):
        expected = np.array([[function(v) for v in x.tolist()] for function in (exponential, logarithm)])
    same(found, expected)
    assert (np.signbit(found) == np.signbit(expected))[~np.isnan(expected)].all()
