"""exp and log by a fixed sequence of IEEE operations, as in kernels/_exponential.h: a C library's differ in the last bit.

Both are within one unit in the last place (tests/kernels/test_exponential.py). A robot's tick calls no others, so that it is the
same on every machine, in Python and in C.
"""

from __future__ import annotations

from math import frexp, inf, isinf, ldexp, nan

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # k multiples of the first are exact
PER_LN2 = 1.44269504088896338700e00
ROUNDS = 6755399441055744.0  # 1.5 * 2**52: added and taken off, it leaves the nearest whole number
SQRT_HALF = 0.70710678118654752440


def exponential(x: float) -> float:
    """e**x; 0 or inf where that is beyond float64, NaN of NaN. The series of e**r to r**13, r within ln(2) / 2."""
    if not x > -745.2:
        return x if x != x else 0.0
    if x > 709.8:
        return inf
    times = (x * PER_LN2 + ROUNDS) - ROUNDS
    high, low = x - times * LN2_HIGH, times * LN2_LOW
    r = high - low
    lost, r2 = (high - r) - low, r * r
    r4 = r2 * r2
    first = (1.0 / 2.0 + r * (1.0 / 6.0)) + r2 * (1.0 / 24.0 + r * (1.0 / 120.0))
    second = (1.0 / 720.0 + r * (1.0 / 5040.0)) + r2 * (1.0 / 40320.0 + r * (1.0 / 362880.0))
    third = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) + r2 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    y = 1.0 + (r + (r2 * (first + r4 * (second + r4 * third)) + lost))
    k = int(times)
    return y * ldexp(1.0, 1023) * ldexp(1.0, k - 1023) if k > 1023 else ldexp(y, k)


def logarithm(x: float) -> float:
    """ln(x); -inf of 0, NaN below. x = 2**k (1 + f), and the series of artanh(f / (2 + f)) to its 21st power."""
    if not x > 0.0:
        return -inf if x == 0.0 else nan
    if isinf(x):
        return x
    part, k = frexp(x)
    if part < SQRT_HALF:
        part, k = part * 2.0, k - 1
    f = part - 1.0
    s, half = f / (2.0 + f), 0.5 * f * f
    z = s * s
    near = 2.0 / 3.0 + z * (2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * (2.0 / 11.0))))
    far = 2.0 / 13.0 + z * (2.0 / 15.0 + z * (2.0 / 17.0 + z * (2.0 / 19.0 + z * (2.0 / 21.0))))
    rest = z * (near + z * z * z * z * z * far)
    return k * LN2_HIGH - ((half - (s * (half + rest) + k * LN2_LOW)) - f)
